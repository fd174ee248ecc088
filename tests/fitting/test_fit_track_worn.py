"""Tracking on worn scars: loads that swing, slowly and fast, and starts in the middle of a run."""

import json

import numpy as np
import pytest

from fitting.test_fit_track import FRICTION, LEFT, LOAD, contact, frame_of, pulls, save
from isochrome.fitting import Tracker, placed, track
from isochrome.fitting.tracking.worn_course import PAST, WornCourse
from isochrome.frames import Frame
from isochrome.scene import load_scene
from isochrome.simulation import scene_states

WEAR = "wear.coefficient_mm2_per_n"


def worn_film(distance, load, friction, rng, camera=None):
    """A wearing contact whose load and friction are tables over distance, and its scene. The steps
    of the truth's wear err ten times less than the scene's own would."""
    base = load_scene("line-contact-wear")
    scene = contact().model_copy(update={"wear": base.wear}).with_values(camera or {})
    start = scene.with_values({"wear.distances_m": distance.tolist(), FRICTION: float(friction[0])})
    s = [0.0, *distance] if distance[0] > 0.0 else list(distance)
    first = len(s) - len(distance)
    whole = start.with_values(
        {
            key: {"distance_m": s, "value": [*values[:first], *values]}
            for key, values in ((LOAD, load.tolist()), (FRICTION, friction.tolist()))
        }
    ).with_values({"numerics.tolerance": 1e-5})
    return np.stack([frame_of(whole, state, rng) for state in scene_states(whole)]), start


def test_after_an_unworn_frame_the_wear_starts_from_the_scenes_law():
    """An unworn start has no coefficient that could be carried on: the next scar is k P s / t."""
    scene = contact().model_copy(update={"wear": load_scene("line-contact-wear").wear})
    course = WornCourse(scene, (LOAD, FRICTION, WEAR))
    values = course.own_values()
    course.take(values)
    assert course.after.worn_mm2 == 0.0
    course.passed(values)
    course.at(40.0)
    course.take(values)
    line = values[0] / scene.specimen.thickness_mm
    k = scene.wear_coefficient_at(40.0)
    assert course.after.worn_mm2 == pytest.approx(k * line * 40e3, rel=1e-6)


def test_a_step_of_a_tracked_wear_coefficient_wears_as_much_as_the_law_says():
    """Once the track has begun, the scar that grows by dk has dk P s / t more of area."""
    scene = contact().model_copy(update={"wear": load_scene("line-contact-wear").wear})
    course = WornCourse(scene, (LOAD, FRICTION, WEAR))
    course.at(40.0)
    values = course.take(np.append(course.own_values(), [44.0] * len(PAST)))
    course.passed(values)
    course.at(41.0)
    values = course.take(values[:3])

    def area():
        return course.solve(course.moved(course.tracked, values)).surface.worn_area_mm2

    before = area()
    with course.beside(WEAR, values) as step:
        more = area() - before
    assert more == pytest.approx(step * values[0] / scene.specimen.thickness_mm * 41e3, rel=1e-3)


def test_a_wear_coefficient_is_told_as_well_as_the_law_has_worn():
    """The noise leaves some area open, and k is that over P s / t: half of it at twice the way.
    In the fine noise of 16 bit the steps of the wear from frame to frame are felt: by 7 of its
    uncertainties where they err by 1e-3."""
    distance = 0.5 * np.arange(5)
    camera = {"camera.bit_depth": 16, "camera.noise_grey": 30.0, "camera.vignette": 0.0}
    frames, start = worn_film(
        distance, np.full(5, 44.0), np.full(5, 0.2), np.random.default_rng(3), camera
    )
    keys = (LOAD, FRICTION, LEFT, WEAR)
    tracker = Tracker(placed(start, frames[0].shape), keys, bit_depth=16)
    found = [
        tracker.track(Frame(i, image, None, str(i)), s)
        for i, (image, s) in enumerate(zip(frames, distance, strict=True))
    ][1:]
    sure = np.array([one.standard_uncertainty[-1] for one in found])
    assert sure * distance[1:] == pytest.approx(sure[0] * distance[1], rel=0.2)
    assert np.all(np.abs([one.values[-1] - 2e-9 for one in found]) < 4.0 * sure)


@pytest.mark.long
@pytest.mark.parametrize("bench", [{"load.tilt": 0.7}, {"contact.roughness_um": 0.3}], ids=str)
def test_a_tilted_or_rough_contact_is_followed_as_it_wears(bench):
    """Each slice goes on from its own scar; what lies between the bodies is that of the frame."""
    distance = 20.0 + 0.5 * np.arange(4)
    frames, start = worn_film(
        distance, np.full(4, 44.0), np.full(4, 0.2), np.random.default_rng(5), bench
    )
    tracker = Tracker(placed(start, frames[0].shape), (LOAD, FRICTION), bit_depth=8)
    for i, (image, s) in enumerate(zip(frames, distance, strict=True)):
        found = tracker.track(Frame(i, image, None, str(i)), s)
        assert np.abs((found.values - [44.0, 0.2]) / found.standard_uncertainty).max() < 4.0
    left = json.loads(json.dumps(tracker.course.state()))
    again = WornCourse(tracker.course.scene, (LOAD, FRICTION))
    again.resume(left)
    values = np.array([44.0, 0.2])
    for course in (tracker.course, again):
        course.at(22.0)
        course.take(values)
    one, other = (
        course.solve(course.moved((LOAD, FRICTION), values)).surface
        for course in (tracker.course, again)
    )
    assert other.wear_depth_mm == pytest.approx(one.wear_depth_mm, rel=1e-12)
    assert other.pressure_mpa == pytest.approx(one.pressure_mpa, abs=1e-7 * one.p_max_mpa)


@pytest.mark.long
@pytest.mark.parametrize("key", [WEAR, *PAST])
def test_a_contact_that_grows_beside_a_step_leaves_the_scar_on_the_wider_grid(key):
    """Four times the load asks for a wider grid: the scar, and its change by the past, go on."""
    scene = contact().model_copy(update={"wear": load_scene("line-contact-wear").wear})
    course = WornCourse(scene, (LOAD, FRICTION, WEAR))
    course.at(40.0)
    values = np.append(course.own_values(), [44.0] * len(PAST))
    course.take(values)
    nodes = course.site.grid.nodes
    with course.beside(key, values):
        course.solve(course.moved(course.tracked, np.r_[4.0 * values[0], values[1:3]]))
    assert course.site.grid.nodes > nodes
    with course.beside(key, values) as step:
        state = course.solve(course.moved(course.tracked, values[:3]))
    assert step > 0.0 and len(state.surface.wear_depth_mm) == course.site.grid.nodes


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.study)])
def test_the_load_before_is_told_with_its_uncertainty_and_is_in_that_of_the_wear(seed):
    """Worn under 47 N, seen under 43 N: how far it wore goes with the load that wore it."""
    load = np.array([47.0, 43.0, 43.1, 43.2])
    distance = np.array([77.0, 77.05, 77.1, 77.15])
    frames, start = worn_film(distance, load, np.full(4, 0.2), np.random.default_rng(seed))
    seen = start.with_values({"wear.distances_m": distance[1:].tolist()})
    tracker = Tracker(placed(seen, frames[0].shape), (LOAD, FRICTION, WEAR), bit_depth=8)
    found = [
        tracker.track(Frame(i, image, None, str(i)), s)
        for i, (image, s) in enumerate(zip(frames[1:], distance[1:], strict=True))
    ]
    (past, *_), covariance = tracker.course.past
    assert abs(past - 47.0) < 4.0 * np.sqrt(covariance[0, 0]) < 2.0
    for one, true in zip(found, load[1:], strict=True):
        pull = (one.values - [true, 0.2, 2e-9]) / one.standard_uncertainty
        assert np.abs(pull).max() < 4.0
    for one in found[1:]:  # the noise alone would tell k better
        assert one.standard_uncertainty[2] > 1.3 * one.cramer_rao_bound[2]


@pytest.mark.long
def test_a_wearing_contact_is_followed_on_the_scar_of_its_own_history(tmp_path):
    i = np.arange(18)
    distance, friction = 12.0 * i, 0.1 + 0.15 * np.minimum(i / 11.0, 1.0)
    frames, start = worn_film(distance, np.full(18, 44.0), friction, np.random.default_rng(4))
    save(tmp_path, frames)
    result = track(tmp_path / "film.tif", start, (LOAD, FRICTION))
    assert result.searched == (0,)
    assert result.distance_m == pytest.approx(distance)
    # 0.7e-4, and 2.5e-4 at most: noise; the bars of a wear sequence are 5e-4 and 3e-3
    assert np.sqrt(np.mean((result.values[:, 0] / 44.0 - 1.0) ** 2)) < 2e-4
    assert np.all(np.abs(result.values[:, 1] - friction) < 7e-4)


@pytest.mark.long
def test_a_track_that_begins_at_a_low_load_finds_which_load_wore_the_scar(tmp_path):
    """77 m under 45.4 N, a film from 42 N up to 46 N: on a scar worn by 42 N it was lost."""
    load = np.concatenate(([45.4], np.linspace(42.0, 46.0, 7)))
    friction = np.full(load.size, 0.2)
    distance = 77.0 + 0.05 * np.arange(load.size)
    frames, start = worn_film(distance, load, friction, np.random.default_rng(6))
    save(tmp_path, frames[1:])
    start = start.with_values({"wear.distances_m": distance[1:].tolist()})
    keys = (LOAD, FRICTION, LEFT, WEAR)
    result = track(tmp_path / "film.tif", start, keys, as_stated=True)
    assert result.searched == (0,)
    assert np.all(result.chi < 1.05)
    pull = (result.values[:, 0] - load[1:]) / result.standard_uncertainty[:, 0]
    # seven of them with chance alone, of which one in 100 exceeds 1.6; 5 and more on the wrong scar
    assert np.sqrt(np.mean(pull**2)) < 1.6


@pytest.mark.study  # of a worn contact: the sample film, in tests/processing
def test_a_new_contact_under_a_load_that_swings_far_is_followed_with_its_wear(tmp_path):
    """By 20 %, from the unworn contact on: where the load fell, k fell by 11 %, and its scar with
    it. Boxes reached behind the scars that were kept, and wore on by loads of long ago."""
    i = np.arange(16)
    load = 44.0 * (1.0 + 0.2 * np.sin(2.0 * np.pi * i / 20.0))
    frames, start = worn_film(0.1 * i, load, np.full(i.size, 0.2), np.random.default_rng(6))
    save(tmp_path, frames)
    result = track(tmp_path / "film.tif", start, (LOAD, LEFT, WEAR), as_stated=True)
    assert result.searched == (0,)
    pull = (result.values - np.stack([load, np.full(16, -1.9), np.full(16, 2e-9)], axis=1))[1:]
    pull /= result.standard_uncertainty[1:]
    # neighbours share their scar, so that k's pulls are of fewer draws than the load's
    assert np.all(np.sqrt(np.mean(pull**2, axis=0)) < [1.4, 1.4, 2.0])


@pytest.mark.long
def test_a_course_of_loads_before_a_film_wears_what_the_scenes_table_wears():
    """To a hundred thousandth of the depth, that of the wear's steps."""
    scene = contact().model_copy(update={"wear": load_scene("line-contact-wear").wear})
    course, s = WornCourse(scene, (LOAD, FRICTION, WEAR)), 77.0
    course.at(s)
    before = [44.0, 46.0, 50.0]
    values = np.append(course.own_values(), before)
    values[:2] = 52.8, 0.2
    course.take(values)
    course.passed(values)
    (found,) = course.state()["last"]["parts"]  # no slices: the load is even
    to_go = np.array([1.0, 0.1, 0.01, 0.001, 0.0])
    table = {"distance_m": (s * (1.0 - to_go)).tolist(), "value": [44.0, *before, 52.8]}
    whole = scene.with_values({LOAD: table, FRICTION: 0.2, "wear.distances_m": [s]})
    numerics = course.site.scene.numerics.model_copy(update={"tolerance": 1e-4})
    (state,) = scene_states(whole.model_copy(update={"numerics": numerics}))
    depth = state.surface.wear_depth_mm
    assert np.abs(np.array(found["depth_mm"]) - depth).max() < 3e-4 * depth.max()


@pytest.mark.study
@pytest.mark.parametrize("keys", [(LOAD, FRICTION, LEFT), (LOAD, FRICTION, WEAR)])
@pytest.mark.parametrize("step_m", [0.05, 0.5])
def test_a_load_that_swings_far_is_told_from_the_middle_of_a_swing_on_a_worn_scar(
    tmp_path, step_m, keys
):
    """By 20 %: one load for all the time before cannot wear that scar, and pulls were 3 to 5.
    Friction is not held to it: that of before, 1 % less here, is no unknown."""
    i = np.arange(21)
    load, friction = 44.0 * (1.0 + 0.2 * np.sin(2.0 * np.pi * i / 20.0)), 0.2 + 0.01 * i / 16.0
    frames, start = worn_film(77.0 + step_m * i, load, friction, np.random.default_rng(6))
    save(tmp_path, frames[5:])
    seen = start.with_values({"wear.distances_m": start.wear.distances_m[5:]})
    result = track(tmp_path / "film.tif", seen, keys, as_stated=True)
    assert result.searched == (0,)
    pull = (result.values[:, 0] - load[5:]) / result.standard_uncertainty[:, 0]
    # 1.2 is the bar, of 16 draws that scatter by 0.18
    assert np.sqrt(np.mean(pull**2)) < 1.2 + 2 * 0.18


@pytest.mark.study
@pytest.mark.parametrize(
    ("step_m", "count", "begin", "keys"),
    [
        pytest.param(0.05, 30, 0, (LOAD, FRICTION, LEFT), id="slowly"),
        pytest.param(0.05, 24, 5, (LOAD, FRICTION, LEFT), id="from the middle of a swing"),
        pytest.param(0.05, 24, 0, (LOAD, FRICTION, WEAR), id="with its wear coefficient"),
        pytest.param(0.5, 24, 0, (LOAD, FRICTION, LEFT), id="2000 frames an hour"),
        pytest.param(5.0, 20, 0, (LOAD, FRICTION), id="few frames an hour"),
    ],
)
def test_a_load_that_swings_on_a_worn_scar_is_followed_with_its_uncertainty(
    tmp_path, step_m, count, begin, keys
):
    i = np.arange(begin + count)
    load = 44.0 * (1.0 + 0.05 * np.sin(2.0 * np.pi * i / 20.0))
    friction = 0.2 + 0.01 * i / count
    frames, start = worn_film(77.0 + step_m * i, load, friction, np.random.default_rng(6))
    save(tmp_path, frames[begin:])
    seen = start.wear.distances_m[begin:]
    result = track(tmp_path / "film.tif", start.with_values({"wear.distances_m": seen}), keys)
    assert result.searched == (0,)
    assert np.all(np.abs(result.chi - 1.0) < 0.03)
    truth = {
        LOAD: load[begin:], FRICTION: friction[begin:], LEFT: np.full(count, -1.9),
        WEAR: np.full(count, 2e-9),
    }  # fmt: skip
    # 0.7 to 0.9e-4 in all of these; the bar of a tracked load is 5e-4
    assert np.sqrt(np.mean((result.values[:, 0] / truth[LOAD] - 1.0) ** 2)) < 2e-4
    found = pulls(result, truth)
    # of each key in its own unit: the RMS of n pulls scatters by 1/sqrt(2n); 0.1 is allowed for the
    # wear's own steps
    spread = np.sqrt(np.mean(found**2, axis=0))
    assert np.all(np.abs(spread - 1.0) < 0.1 + 3.5 / np.sqrt(2 * count))
    assert np.all(np.abs(found.mean(axis=0)) < 0.2 + 4.0 / np.sqrt(count))
