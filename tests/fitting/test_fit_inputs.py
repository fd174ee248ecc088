"""Stated inputs: priors of free keys, a budget of held ones, pairs that only a prior tells apart.
Sensitivities are checked by fits with the input shifted; values and coverage by frames of a
renderer that shares no code with the package's optics and camera."""

import csv
import json
from functools import cache

import numpy as np
import pytest
import tifffile

from fitting.engine_frames import prepared
from isochrome import fit, fitting
from isochrome.benchmarks import load_benchmarks
from isochrome.errors import InputError
from isochrome.scene import load_scene, parse_scene
from isochrome.simulation import simulate

case_inputs = load_benchmarks("case_inputs")
outside_camera = load_benchmarks("outside_camera")

LOAD, FRICTION = "load.normal_n", "friction.coefficient"
KEYS = (LOAD, FRICTION, "camera.left_mm", "camera.top_mm")
FRINGE_VALUE, PIXEL = "specimen.fringe_value_n_per_mm", "camera.pixel_mm"

RING = load_scene("ring").with_values({
    LOAD: 60.0, "camera.width_px": 128, "camera.height_px": 128, PIXEL: 0.36,
    "camera.noise_grey": 1.0,
})  # fmt: skip


@cache
def contact():
    """A sliding contact's scene, and its frame as it was captured."""
    scene = case_inputs.true_scene(0)
    return scene, outside_camera.frame(scene, outside_camera.Defects(), 7)


def rows_of(path):
    return list(csv.DictReader(path.read_text("utf-8").splitlines()))


def stated(scene, **percent):
    """A scene that states uncertainties, by keys with two underscores for the dot."""
    keys = {name.replace("__", ".", 1): share for name, share in percent.items()}
    return scene.with_values({
        key: {"value": scene.get(key), "standard_uncertainty": 0.01 * share * scene.get(key)}
        for key, share in keys.items()
    })  # fmt: skip


def test_what_a_stated_input_explains_of_the_residual_is_not_noise_too():
    """A modulus 1.5 of its u off: the budget has its share, and noise stays what it is."""
    scene, image = contact()
    modulus, key = scene.get("specimen.young_gpa"), "specimen.young_gpa"
    right, wrong = (
        scene.with_values({key: {"value": value, "standard_uncertainty": 0.02 * modulus}})
        for value in (modulus, 1.03 * modulus)
    )
    alike, shifted = (fitting.fit_frame(prepared(image, s), s) for s in (right, wrong))
    assert shifted.chi > 1.03 * alike.chi  # the frame contradicts it
    # derivatives are those at another place, no more
    np.testing.assert_allclose(shifted.noise_uncertainty, alike.noise_uncertainty, rtol=0.2)


@pytest.mark.long
def test_sensitivities_are_those_of_fits_with_shifted_inputs():
    scene, image = contact()
    scene = stated(
        scene, camera__pixel_mm=0.2, specimen__thickness_mm=0.5,
        specimen__fringe_value_n_per_mm=0.5, specimen__young_gpa=2.0,
        indenter__radius_mm=0.1, specimen__poisson=1.0,
    )  # fmt: skip
    data = prepared(image, scene)
    found = fitting.fit_frame(data, scene, KEYS, cold=False)
    for k, (key, value, spread) in enumerate(found.inputs.rows):
        step = 0.2 * spread
        ends = [
            fitting.fit_frame(data, scene.with_values({key: value + s}), KEYS, cold=False).values
            for s in (step, -step)
        ]
        by_refits = (ends[0] - ends[1]) / (2.0 * step)
        # 3 %: one-sided derivatives of fringes err by a per cent; 3e-3 of the larger effects of
        # others, for what hardly matters
        room = 0.03 * abs(by_refits) + 3e-3 * found.standard_uncertainty / spread
        assert np.all(abs(found.sensitivity[:, k] - by_refits) < room), key


def test_combined_uncertainty_is_noise_and_inputs_in_squares():
    (scene, image), plain = contact(), plain_fit()
    assert np.array_equal(plain.standard_uncertainty, plain.noise_uncertainty)
    known = stated(scene, camera__pixel_mm=0.2, specimen__fringe_value_n_per_mm=0.5)
    found = fitting.fit_frame(prepared(image, known), known, KEYS, cold=False)
    assert np.array_equal(found.values, plain.values)
    # errors of the inputs explain a little of any noise
    assert found.noise_uncertainty == pytest.approx(plain.noise_uncertainty, rel=0.01)
    parts = np.square(found.sensitivity * found.inputs.spread).sum(axis=1)
    combined = np.sqrt(found.noise_uncertainty**2 + parts)
    assert found.standard_uncertainty == pytest.approx(combined, rel=1e-9)
    # load and friction follow both inputs: they are not independent any more
    correlation = found.covariance[0, 1] / np.prod(found.standard_uncertainty[:2])
    own = plain.covariance[0, 1] / np.prod(plain.standard_uncertainty[:2])
    assert abs(correlation - own) > 0.3


@cache
def plain_fit():
    """The contact's fit without anything stated."""
    scene, image = contact()
    return fitting.fit_frame(prepared(image, scene), scene, KEYS, cold=False)


def with_load(value, spread):
    """The contact's fit under a prior of its load."""
    scene, image = contact()
    known = scene.with_values({LOAD: {"value": value, "standard_uncertainty": spread}})
    return fitting.fit_frame(prepared(image, known), known, KEYS, cold=False)


def test_a_prior_far_sharper_than_the_frame_is_the_value():
    off = contact()[0].get(LOAD) + 0.1
    found = with_load(off, 1e-6)
    assert found.values[0] == pytest.approx(off, abs=1e-5)
    assert found.standard_uncertainty[0] == pytest.approx(1e-6, rel=1e-3)
    assert found.noise_uncertainty[0] < 1e-8


def test_a_prior_as_sharp_as_the_frame_meets_it_half_way():
    plain = plain_fit()
    spread = plain.cramer_rao_bound[0]
    found = with_load(plain.values[0] + 10.0 * spread, spread)
    # both ends are some fiftieths of it from their least; without its pull a search stops 0.5 short
    assert found.values[0] - plain.values[0] == pytest.approx(5.0 * spread, abs=0.1 * spread)
    assert found.cramer_rao_bound[0] == pytest.approx(spread / np.sqrt(2.0), rel=0.05)


def test_a_prior_far_wider_than_the_frame_changes_nothing():
    plain, found = plain_fit(), with_load(44.5, 50.0)
    assert abs(found.values - plain.values).max() < 0.05 * plain.standard_uncertainty.max()
    # derivatives by both sides with a prior, by one without: a per cent
    assert found.standard_uncertainty == pytest.approx(plain.standard_uncertainty, rel=0.03)


def test_load_and_fringe_value_of_a_ring_are_told_apart_by_a_prior_alone(tmp_path):
    simulate(RING, out=tmp_path / "ring")
    path = tmp_path / "ring" / "frames.tif"
    with pytest.raises(InputError, match=r"cannot both be free.*standard_uncertainty"):
        fit(path, RING, [LOAD, FRINGE_VALUE])
    known = stated(RING, specimen__fringe_value_n_per_mm=0.5)
    found = fit(path, known, [LOAD, FRINGE_VALUE])
    # N = P/(f d) is all that a ring tells: f stays as stated, and P is as uncertain as f
    f, load = found.shared[FRINGE_VALUE], found.shared[LOAD]
    assert f["standard_uncertainty"] == pytest.approx(0.005 * RING.get(FRINGE_VALUE), rel=0.05)
    assert load["standard_uncertainty"] / load["value"] == pytest.approx(0.005, rel=0.05)
    ratio = load["value"] / f["value"] / (60.0 / RING.get(FRINGE_VALUE))
    assert ratio == pytest.approx(1.0, abs=2e-4)
    # held, it does the same to the load through the budget
    held = fit(path, known, [LOAD], as_stated=True)
    spread = held.shared[LOAD]["standard_uncertainty"]
    assert spread == pytest.approx(load["standard_uncertainty"], rel=0.05)
    (budget,) = held.budget
    assert [item.input for item in budget.inputs] == [FRINGE_VALUE, "image noise"]
    assert budget.inputs[0].share > 0.99
    assert budget.inputs[0].sensitivity == pytest.approx(60.0 / RING.get(FRINGE_VALUE), rel=0.02)


def test_a_key_that_is_stated_as_exact_is_not_freed(tmp_path):
    exact = {"value": 60.0, "standard_uncertainty": 0}
    with pytest.raises(InputError, match=r"load\.normal_n is stated as exact"):
        fit(tmp_path / "none.tif", RING.with_values({LOAD: exact}), [LOAD])


@pytest.mark.long
def test_all_that_is_left_names_the_inputs_and_their_shares(tmp_path):
    scene, image = contact()
    known = stated(scene, specimen__fringe_value_n_per_mm=0.5, load__normal_n=0.5)
    tifffile.imwrite(tmp_path / "frame.tif", image)
    options = {"as_stated": True, "out": tmp_path / "out"}
    found = fit(tmp_path / "frame.tif", known, list(KEYS), **options)
    own = found.to_json()[LOAD]
    assert own["standard_uncertainty"] > 10.0 * own["noise_uncertainty"]
    assert [set(item) for item in own["budget"]] == [
        {"input", "value", "standard_uncertainty", "sensitivity", "share"}
    ] * 3
    assert sum(item["share"] for item in own["budget"]) == pytest.approx(1.0)
    rows = rows_of(tmp_path / "out" / "budget.csv")
    assert [(row["frame"], row["key"]) for row in rows[:3]] == [("all", LOAD)] * 3
    assert rows[0]["input"] == FRINGE_VALUE
    assert (tmp_path / "out" / "budget.png").stat().st_size > 1000
    table = rows_of(tmp_path / "out" / "fit.csv")
    assert float(table[0]["noise_uncertainty"]) == pytest.approx(own["noise_uncertainty"])
    exact = [PIXEL, "specimen.thickness_mm", "indenter.radius_mm", "specimen.young_gpa",
             "indenter.young_gpa", "specimen.poisson", "indenter.poisson"]  # fmt: skip
    assert list(found.taken_as_exact) == exact
    assert "taken as exact" in repr(found)
    # what was stated of the load is known better now, and the scene says so
    again = load_scene(tmp_path / "out" / "scene.toml")
    assert again.uncertainties[LOAD] == pytest.approx(own["standard_uncertainty"])
    assert again.uncertainties[FRINGE_VALUE] == known.uncertainties[FRINGE_VALUE]
    kept = fit(tmp_path / "frame.tif", known, list(KEYS), **options)
    assert kept.already and kept.to_json() == json.loads(json.dumps(found.to_json()))


@pytest.mark.long
def test_a_scale_that_is_off_is_fitted_with_its_prior_and_looks_like_a_modulus_without():
    """Of a contact with a free place a pixel and a modulus are one direction."""
    scene, image = contact()
    off = scene.with_values({PIXEL: 1.004 * scene.get(PIXEL)})
    suspect = fitting.fit_with_causes(prepared(image, off), off, KEYS, cold=False)
    assert [cause.keys for cause in suspect.causes] == [("specimen.young_gpa",)]
    assert "specimen.young_gpa = " in fitting.cause_messages(suspect)[0]
    known = stated(off, camera__pixel_mm=0.3)
    found = fitting.fit_with_causes(prepared(image, known), known, KEYS, cold=False)
    assert [cause.keys for cause in found.causes] == [(PIXEL,)]
    at = dict(zip(found.fit.keys, range(len(found.fit.keys)), strict=True))
    values, spread = found.fit.values, found.fit.standard_uncertainty
    assert abs(values[at[PIXEL]] - scene.get(PIXEL)) < 4.0 * spread[at[PIXEL]]
    assert abs(values[at[LOAD]] - scene.get(LOAD)) < 4.0 * spread[at[LOAD]]
    alone = suspect.stated.fit
    assert abs(alone.values[0] - scene.get(LOAD)) > 50.0 * alone.standard_uncertainty[0]


def test_nothing_is_freed_where_all_that_is_stated_is_right():
    scene, image = contact()
    known = stated(scene, camera__pixel_mm=0.2, specimen__young_gpa=2.0, indenter__radius_mm=0.1)
    assert fitting.fit_with_causes(prepared(image, known), known, KEYS, cold=False).causes == ()


@pytest.mark.long
def test_frames_that_share_a_key_have_a_budget_too(tmp_path):
    loads = 58.0, 62.0
    scenes = [RING.with_values({LOAD: load, "camera.seed": k}) for k, load in enumerate(loads)]
    images = [simulate(scene).frames[-1] for scene in scenes]
    path = tmp_path / "two.tif"
    tifffile.imwrite(path, np.array(images))
    place = {"camera.left_mm": -23.04, "camera.top_mm": -3.04}
    known = stated(RING, specimen__fringe_value_n_per_mm=0.5).with_values(place)
    # f is held, and fitted with its prior: either way it is all that is uncertain of the loads
    for shared in (list(place), [FRINGE_VALUE, *place]):
        found = fit(path, known, shared, per_frame=[LOAD])
        for own, load in zip(found.frames, loads, strict=True):
            assert abs(own[LOAD]["value"] - load) < 4.0 * own[LOAD]["noise_uncertainty"]
            assert own[LOAD]["standard_uncertainty"] / load == pytest.approx(0.005, rel=0.02)
        assert {b.frame for b in found.budget} == {None, 0, 1}
        assert all(b.inputs[0].input == FRINGE_VALUE for b in found.budget if b.key == LOAD)
    # the value as stated
    assert found.shared[FRINGE_VALUE]["value"] == pytest.approx(RING.get(FRINGE_VALUE), rel=1e-3)


def test_only_what_fringes_follow_is_an_input():
    scene = parse_scene(case_inputs._SCENE)
    values = {"camera.brightness": 0.8, "frames.sliding_speed_mm_per_s": 2.0, PIXEL: 0.018}
    known = scene.with_values({
        key: {"value": value, "standard_uncertainty": 0.01} for key, value in values.items()
    })  # fmt: skip
    assert fitting.stated_inputs(known).keys == (PIXEL,)
    assert PIXEL in fitting.taken_as_exact(scene, (LOAD,)) and PIXEL not in fitting.taken_as_exact(
        known, (LOAD,)
    )
    assert LOAD not in fitting.taken_as_exact(scene, (LOAD,))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["held", pytest.param("asked", marks=pytest.mark.study)])
def test_the_whole_uncertainty_covers_inputs_that_are_off_by_chance(kind):
    rows = [case_inputs.judged(kind, seed) for seed in range(6)]
    pulls = np.array([(row.load_pull, row.friction_pull) for row in rows])
    # of 6 draws of 95 % at least 4 in 99.8 of 100 cases (binomial)
    assert np.all((abs(pulls) < case_inputs.COVERED).sum(axis=0) >= 4)
    # the 0.1 and 99.9 % points of the RMS of 6 normal pulls; `isochrome bench inputs` has more
    size = np.sqrt(np.mean(pulls**2, axis=0))
    assert np.all((size > 0.25) & (size < 1.94))
