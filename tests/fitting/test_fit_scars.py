"""Frames and measured scars together: what each says counts by its own noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

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


def frame_of(scene, keys, values, sensitivity, inputs):
    """What a frame might say of a scene: ± of 1, 2 and 5 %, of which some are alike."""
    share = np.array([0.01, 0.02, 0.05])[-len(keys) :] * values
    alike = 0.6 * np.ones((len(keys), len(keys))) + 0.4 * np.eye(len(keys))
    noise = alike * np.outer(share, share)
    covariance = noise + (sensitivity * inputs.spread**2) @ sensitivity.T
    return fitting.FrameFit(
        scene=scene.with_values(dict(zip(keys, values.tolist(), strict=True))), keys=keys,
        values=values, standard_uncertainty=np.sqrt(np.diag(covariance)), covariance=covariance,
        noise_uncertainty=share, inputs=inputs, sensitivity=sensitivity, cramer_rao_bound=share,
        information=np.linalg.inv(noise), freedom=1000, chi=1.0, others=(), converged=True,
        plain=False, positive=True,
    )  # fmt: skip


def both_by_search(fit, load, area, spread, keys):
    """The least of a frame's misfit and a scar's, W = k P s/t, by a search without derivatives."""
    scene, distance_mm = fit.scene, 155e3
    weight = np.linalg.inv(
        fit.covariance - (fit.sensitivity * fit.inputs.spread**2) @ fit.sensitivity.T
    )

    def cost(share):
        values = dict(zip(keys, fit.values * (1.0 + share), strict=True))
        worn = values[WEAR] * values.get(LOAD, load) * distance_mm / scene.specimen.thickness_mm
        away = fit.values * share
        return away @ weight @ away + ((area - worn) / spread) ** 2

    found = minimize(
        cost, np.zeros(len(keys)), method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 9000, "maxfev": 9000},
    )  # fmt: skip
    return fit.values * (1.0 + found.x)


def test_a_frames_scar_moves_its_values_to_the_least_misfit_of_both():
    scene, keys = scene_of([77.0], **TRUTH), (LOAD, FRICTION, WEAR)
    worn = TRUTH[WEAR] * TRUTH[LOAD] * 155e3 / scene.specimen.thickness_mm
    area = fitting.MeasuredArea("155.csv", 155.0, 1.04 * worn, 0.02 * worn)
    fit = frame_of(
        scene, keys, np.array(list(TRUTH.values())), np.empty((3, 0)), fitting.inputs_of_rows([])
    )
    sequence = replace(fitting.make_sequence(scene, 1, keys, ()), areas=(area,))
    both = fitting.with_scars(fitting.fit_of_each(sequence, [fit]), fit)
    expected = both_by_search(fit, TRUTH[LOAD], area.area_mm2, area.standard_uncertainty_mm2, keys)
    # the search ends within 1e-6 of an uncertainty; W's bend over its steps is far below
    assert np.abs((both.values - expected) / fit.standard_uncertainty).max() < 1e-4
    row = (
        np.array([1.0 / TRUTH[LOAD], 0.0, 1.0 / TRUTH[WEAR]]) * worn / area.standard_uncertainty_mm2
    )
    exact = np.linalg.inv(np.linalg.inv(fit.covariance) + np.outer(row, row))
    # the areas' slope at the fitted values, 3 % beside the frame's own
    np.testing.assert_allclose(both.standard_uncertainty, np.sqrt(np.diag(exact)), rtol=0.03)
    assert (both.standard_uncertainty <= fit.standard_uncertainty).all()


def test_the_budget_of_a_frame_with_scars_holds_what_the_load_does_to_both():
    """A load that is held moves what the frame says and what the scar says, which may cancel."""
    scene, keys = scene_of([77.0], **TRUTH), (FRICTION, WEAR)
    worn = TRUTH[WEAR] * TRUTH[LOAD] * 155e3 / scene.specimen.thickness_mm
    area = fitting.MeasuredArea("155.csv", 155.0, worn, 0.03 * worn)
    inputs = fitting.inputs_of_rows([(LOAD, TRUTH[LOAD], 0.9)])
    sensitivity = np.array([[-3e-3], [2e-11]])
    values = np.array([TRUTH[FRICTION], TRUTH[WEAR]])
    fit = frame_of(scene, keys, values, sensitivity, inputs)
    sequence = replace(fitting.make_sequence(scene, 1, keys, ()), areas=(area,))
    both = fitting.with_scars(fitting.fit_of_each(sequence, [fit]), fit)
    step = 0.05
    moved = replace(fit, values=values + step * sensitivity[:, 0])
    ends = [
        both_by_search(one, load, area.area_mm2, area.standard_uncertainty_mm2, keys)
        for one, load in ((fit, TRUTH[LOAD]), (moved, TRUTH[LOAD] + step))
    ]
    change = (ends[1] - ends[0]) / step
    told = [item.sensitivity for row in both.budget for item in row if item.input == LOAD]
    # a one-sided difference over .1 % of the load
    np.testing.assert_allclose(told, change, rtol=5e-3)


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
