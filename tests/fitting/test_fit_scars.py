"""Frames and measured scars together: what each says counts by its own noise."""

import numpy as np
import pytest

import isochrome
import worn_scars
from isochrome import fitting
from isochrome.errors import InputError, PhysicsError
from scene_texts import SMALL_CAMERA, WORN_CONTACT

LOAD, FRICTION, WEAR = "load.normal_n", "friction.coefficient", "wear.coefficient_mm2_per_n"
TRUTH = {LOAD: 47.0, FRICTION: 0.22, WEAR: 1.7e-9}


def scene_of(distances, **values):
    scene = isochrome.parse_scene(WORN_CONTACT + SMALL_CAMERA + "noise_grey = 6.0\n")
    return scene.with_values({"wear.distances_m": list(distances)} | values)


def beside_traces(folder, scene, *, factor=1.0, at=(77.0, 155.0), ra_um=0.1):
    """A scene's file beside its traces, whose worn area is `factor` times that of the truth."""
    rng = np.random.default_rng(5)
    text = isochrome.dump_scene(scene)
    # an area goes with load times coefficient; the table's is of its own load
    coefficient = factor * TRUTH[WEAR] * TRUTH[LOAD] / worn_scars.LOAD_N
    for distance in at:
        x, z, _ = worn_scars.rough_trace(rng, distance, coefficient, ra_um, "ground", count=4000)
        worn_scars.write_trace(folder / f"{distance:g}.csv", x, z)
        text += f'\n[[scar]]\nfile = "{distance:g}.csv"\ndistance_m = {distance}\n'
    (folder / "scene.toml").write_text(text, "utf-8")
    return folder / "scene.toml"


@pytest.fixture(scope="module")
def one_frame(tmp_path_factory):
    folder = tmp_path_factory.mktemp("worn")
    isochrome.simulate(scene_of([77.0], **TRUTH), folder / "sim")
    return folder / "sim" / "frames.tif"


def values_of(found):
    table = found.table
    rows = zip(table["value"], table["standard_uncertainty"], strict=True)
    return dict(zip(table["key"], rows, strict=True))


def test_equations_are_the_areas_derivatives_by_the_closed_form():
    """W = k P s/t: dW/dk = P s/t, dW/dP = k s/t, and friction has no part in Archard's law."""
    scene = scene_of([77.0], **TRUTH)
    sequence = fitting.make_sequence(scene, 1, (LOAD, FRICTION, WEAR), ())
    load, friction, coefficient = TRUTH.values()
    thickness, distance_mm, spread = scene.specimen.thickness_mm, 155e3, 1e-5
    area = coefficient * load * distance_mm / thickness + 2.0 * spread
    sequence = type(sequence)(
        scene, 1, sequence.unknowns, (fitting.MeasuredArea("155.csv", 155.0, area, spread),)
    )
    found = fitting.scar_equations(sequence, np.array([load, friction, coefficient]))
    row = np.array([coefficient / load, 0.0, 1.0]) * load * distance_mm / thickness / spread
    row[0] = coefficient * distance_mm / thickness / spread
    np.testing.assert_allclose(found.normal, np.outer(row, row), rtol=1e-5)
    np.testing.assert_allclose(found.gradient, 2.0 * row, rtol=1e-5)
    assert found.cost == pytest.approx(4.0, rel=1e-6) and found.freedom == 1


@pytest.mark.long
@pytest.mark.parametrize(
    "distances", [(77.0,), pytest.param((77.0, 100.0), marks=pytest.mark.study)]
)
def test_with_scars_no_value_is_less_sure_than_by_the_frames_alone(tmp_path, distances):
    isochrome.simulate(scene_of(distances, **TRUTH), tmp_path / "sim")
    frames = tmp_path / "sim" / "frames.tif"
    start = scene_of(distances, **TRUTH).with_values({LOAD: 48.0, WEAR: 2.0e-9})
    beside, stated = beside_traces(tmp_path, start), len(distances) > 1
    alone, found = (
        isochrome.fit(frames, scene, [LOAD, FRICTION, WEAR], as_stated=stated)
        for scene in (start, beside)
    )
    alone, both = values_of(alone), values_of(found)
    for key, truth in TRUTH.items():
        value, spread = both[key]
        assert abs(value - truth) < 3.0 * spread
        assert spread <= alone[key][1]
    # frames tell k to 0.07 %, two scars to 0.9 % each: together it is 0.5 % more certain
    assert both[WEAR][1] < 0.998 * alone[WEAR][1]
    assert not found.warnings


@pytest.mark.long
def test_the_budget_of_a_frame_with_scars_holds_what_the_load_does_to_both(tmp_path, one_frame):
    """A load that is held moves what the frame says and what the scar says, which may cancel."""
    scene = scene_of([77.0], **TRUTH)
    found = []
    for load in (TRUTH[LOAD], TRUTH[LOAD] + 0.05):
        stated = scene.with_values({LOAD: {"value": load, "standard_uncertainty": 0.9}})
        beside = beside_traces(tmp_path, stated, at=(155.0,))
        found.append(isochrome.fit(one_frame, beside, [FRICTION, WEAR], as_stated=True))
    ends = [values_of(one) for one in found]
    told = {
        budget.key: item.sensitivity
        for budget in found[0].budget
        for item in budget.inputs
        if item.input == LOAD
    }
    for key in (FRICTION, WEAR):
        change = (ends[1][key][0] - ends[0][key][0]) / 0.05
        assert told[key] == pytest.approx(change, rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize(
    "law", ["sarkar", pytest.param("dissipated_energy", marks=pytest.mark.study)]
)
def test_a_single_frames_coefficient_is_that_of_the_scenes_law(tmp_path, law):
    """It was that of Archard's law, 7 and 78 % off, without a word."""
    scene = scene_of([77.0], **TRUTH).with_values({"wear.law": law})
    isochrome.simulate(scene, tmp_path / "sim")
    start = scene.with_values({LOAD: 48.0, FRICTION: 0.2, WEAR: 2.0e-9})
    found = values_of(isochrome.fit(tmp_path / "sim" / "frames.tif", start, [LOAD, FRICTION, WEAR]))
    for key, truth in TRUTH.items():
        value, spread = found[key]
        assert abs(value - truth) < 3.0 * spread


@pytest.mark.long
def test_a_scar_that_contradicts_the_frame_is_said(tmp_path, one_frame):
    scene = beside_traces(tmp_path, scene_of([77.0], **TRUTH), factor=1.3, at=(155.0,))
    found = isochrome.fit(one_frame, scene, [LOAD, FRICTION, WEAR])
    assert any("frames and scars contradict each other" in text for text in found.warnings)


def test_a_scene_whose_frames_are_no_states_of_a_run_has_no_scar(tmp_path, one_frame):
    scene = beside_traces(tmp_path, scene_of([31.0, 77.0], **TRUTH), at=(77.0,))
    with pytest.raises((InputError, PhysicsError), match="state"):
        isochrome.fit(one_frame, scene, [LOAD, WEAR])
