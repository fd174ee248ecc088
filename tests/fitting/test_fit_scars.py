"""Frames and measured scars together: what each says counts by its own noise."""

from __future__ import annotations

import numpy as np
import pytest

import isochrome
import worn_scars
from isochrome.errors import InputError, PhysicsError
from isochrome.fitting.joint.frame_sequence import MeasuredArea, make_sequence
from isochrome.fitting.joint.measured_scars import scar_equations
from scene_texts import SMALL_CAMERA, WORN_CONTACT

LOAD, FRICTION, WEAR = "load.normal_n", "friction.coefficient", "wear.coefficient_mm2_per_n"
TRUTH = {LOAD: 47.0, FRICTION: 0.22, WEAR: 1.7e-9}


def scene_of(distances, **values):
    scene = isochrome.parse_scene(WORN_CONTACT + SMALL_CAMERA + "noise_grey = 6.0\n")
    return scene.with_values({"wear.distances_m": list(distances)} | values)


def with_scars(folder, scene, *, factor=1.0, at=(77.0, 155.0), ra_um=0.1):
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
    sequence = make_sequence(scene, 1, (LOAD, FRICTION, WEAR), ())
    load, friction, coefficient = TRUTH.values()
    thickness, distance_mm, spread = scene.specimen.thickness_mm, 155e3, 1e-5
    area = coefficient * load * distance_mm / thickness + 2.0 * spread
    sequence = type(sequence)(
        scene, 1, sequence.unknowns, (MeasuredArea("155.csv", 155.0, area, spread),)
    )
    found = scar_equations(sequence, np.array([load, friction, coefficient]))
    row = np.array([coefficient / load, 0.0, 1.0]) * load * distance_mm / thickness / spread
    row[0] = coefficient * distance_mm / thickness / spread
    np.testing.assert_allclose(found.normal, np.outer(row, row), rtol=1e-5)
    np.testing.assert_allclose(found.gradient, 2.0 * row, rtol=1e-5)
    assert found.cost == pytest.approx(4.0, rel=1e-6) and found.freedom == 1


@pytest.mark.long
def test_with_scars_no_value_is_less_sure_than_by_the_frame_alone(tmp_path, one_frame):
    start = scene_of([77.0], **TRUTH).with_values({LOAD: 48.0, WEAR: 2.0e-9})
    alone = values_of(isochrome.fit(one_frame, start, [LOAD, FRICTION, WEAR]))
    found = isochrome.fit(one_frame, with_scars(tmp_path, start), [LOAD, FRICTION, WEAR])
    both = values_of(found)
    for key, truth in TRUTH.items():
        value, spread = both[key]
        assert abs(value - truth) < 3.0 * spread
        assert spread < 1.02 * alone[key][1]
    assert not found.warnings


@pytest.mark.long
def test_a_scar_that_contradicts_the_frame_is_said(tmp_path, one_frame):
    scene = with_scars(tmp_path, scene_of([77.0], **TRUTH), factor=1.3, at=(155.0,))
    found = isochrome.fit(one_frame, scene, [LOAD, FRICTION, WEAR])
    assert any("frames and scars contradict each other" in text for text in found.warnings)


def test_a_scene_whose_frames_are_no_states_of_a_run_has_no_scar(tmp_path, one_frame):
    scene = with_scars(tmp_path, scene_of([31.0, 77.0], **TRUTH), at=(77.0,))
    with pytest.raises((InputError, PhysicsError), match="state"):
        isochrome.fit(one_frame, scene, [LOAD, WEAR])
