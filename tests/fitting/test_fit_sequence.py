"""A worn sequence as one run: what frames owe to their history, and what they tell of it."""

import json

import numpy as np
import pytest

from fitting.engine_frames import fit_jointly, prepared, within, written
from isochrome import fitting
from isochrome.errors import InputError
from isochrome.output import read_csv, write_tiff
from isochrome.scene import load_scene, parse_scene
from isochrome.simulation import scene_states, simulate
from scene_texts import PAPER_CONTACT, SMALL_CAMERA, WEARING_CONTACT

DISTANCES = (0.0, 31.0, 77.0, 155.0, 233.0)
RISING = {"distance_m": DISTANCES, "value": (0.12, 0.18, 0.24, 0.28, 0.30)}
CAMERA = SMALL_CAMERA.replace("left_mm = -2.0", "left_mm = -1.97").replace("= 0.0\n", "= 0.004\n")
WORN = WEARING_CONTACT.replace("= 0.25\n", "= 0.25\nstatic_state_first = true\n")
WORN += f"distances_m = {list(DISTANCES)}\n{CAMERA}noise_grey = 3.0\nseed = 7\n"
LOAD, FRICTION, WEAR = "load.normal_n", "friction.coefficient", "wear.coefficient_mm2_per_n"
PLACE = ("camera.left_mm", "camera.top_mm")


def scene(**values):
    return parse_scene(WORN).with_values({k.replace("__", "."): v for k, v in values.items()})


def rendered(truth):
    """Prepared frames of a scene, in its own order."""
    return [prepared(image, truth) for image in simulate(truth).frames]


# What a frame shows of its history


def test_a_scene_of_one_state_is_exactly_the_runs_own():
    whole = scene(friction__coefficient=RISING, wear__law="sarkar")
    whole = fitting.with_numerics(whole, nodes_per_pixel=4, tolerance=1e-4, room=1.2)
    shared = fitting.SharedRun(tuple(fitting.frame_distance(whole, i) for i in range(6)))
    for i, state in enumerate(scene_states(whole)):
        one = fitting.state_scene(whole, i)
        assert fitting.frame_distance(whole, i) == (None if i == 0 else DISTANCES[i - 1])
        there = shared(one).surface
        assert there.friction == state.surface.friction
        # the run is the same one: rounding
        assert there.pressure_mpa == pytest.approx(state.surface.pressure_mpa, abs=1e-9)


def test_a_frame_alone_is_worn_as_much_as_in_the_run_at_its_own_load_and_friction():
    load = {"distance_m": (0.0, 233.0), "value": (40.0, 50.0)}
    whole = scene(friction__coefficient=RISING, wear__law="dissipated_energy", load__normal_n=load)
    alone = fitting.alone_scene(whole, 4)
    assert alone.load.normal_n == whole.load_at(155.0)
    assert alone.friction.coefficient == 0.28 and alone.wear.law == "dissipated_energy"
    area = [fitting.local_values(s, (155.0,))[0, 2] for s in (alone, whole)]
    assert area[0] == pytest.approx(area[1], rel=1e-9)
    assert (
        fitting.alone_scene(whole, 1).wear is None
        and fitting.alone_scene(whole, 0).friction is None
    )


def test_values_between_frames_hold_since_the_frame_before():
    table = fitting.stepwise({31.0: 2.0, 77.0: 3.0, 155.0: 5.0})
    at = dict(zip(table["distance_m"], table["value"], strict=True))
    distance = np.array(list(at))
    assert np.all(np.diff(distance) > 0.0)
    middle = np.interp([10.0, 50.0, 100.0, 150.0], distance, list(at.values()))
    assert middle.tolist() == [2.0, 3.0, 5.0, 5.0]


def test_frames_at_one_distance_share_what_the_course_has_there():
    twice = scene(wear__distances_m=(0.0, 77.0, 77.0))
    sequence = fitting.make_sequence(twice, 4, (WEAR,), (FRICTION, LOAD, "camera.left_mm"))
    of = {key: [u.frames for u in sequence.unknowns if u.key == key] for key in (FRICTION, LOAD)}
    assert of[FRICTION] == [(1,), (2, 3)]
    assert of[LOAD] == [(0, 1), (2, 3)]  # the static state stands where sliding begins
    assert [u.frames for u in sequence.unknowns if u.key == WEAR] == [(2, 3)]
    assert len([u for u in sequence.unknowns if u.key == "camera.left_mm"]) == 4


# The chain rule against differences of the whole simulation


def test_uncertainties_are_those_of_differences_through_the_whole_run():
    truth = scene(wear__law="sarkar", friction__coefficient=RISING)
    frames = rendered(truth)
    sequence = fitting.make_sequence(truth, 6, (WEAR, LOAD), (FRICTION,))
    values = np.array([2e-9, 44.0, *RISING["value"]])
    problem = fitting.JointProblem(frames, sequence, values, (120, 160))
    sequence, renderer = problem.sequence, problem.renderer()
    normal = problem.equations(sequence, values, renderer)
    region = fitting.fit_region(problem.first[0], (120, 160), 1, 2.0)
    # each unknown moved in the scene of all frames, and every frame rendered again
    steps, whole = 1e-3 * values, sequence.whole(values)
    wanted = np.zeros_like(normal.normal)
    for i, data in enumerate(frames):
        moved = [
            (sequence.frame(sequence.whole(ahead), ahead, i),) for ahead in values + np.diag(steps)
        ]
        here = sequence.frame(whole, values, i)
        solved = fitting.solved_along(data, here, moved, renderer=renderer, region=region)
        part = fitting.frame_equations(*solved[1:])
        wanted += part.normal / np.outer(steps, steps)
    found, exact = (np.sqrt(np.diag(np.linalg.inv(m))) for m in (normal.normal, wanted))
    # 5 %: what a frame owes to its history besides the area that was worn
    assert found == pytest.approx(exact, rel=0.05)
    assert found[:2] == pytest.approx(exact[:2], rel=0.01)


@pytest.mark.long
def test_load_friction_and_wear_each_over_distance(tmp_path):
    load = {"distance_m": (0.0, 77.0), "value": (42.0, 45.0)}
    friction = {"distance_m": (0.0, 77.0), "value": (0.15, 0.22)}
    values = {"wear__distances_m": (0.0, 77.0), "wear__law": "sarkar"}
    values["numerics__tolerance"] = 1e-3  # of the wear's steps, the same in truth and fit
    truth = scene(**values, load__normal_n=load, friction__coefficient=friction)
    progress = []
    found = fitting.fit(
        written(tmp_path, truth), scene(**values), [WEAR], per_frame=[LOAD, FRICTION],
        follow=True, as_stated=True, progress=progress.append, out=tmp_path / "out",
    )  # fmt: skip
    within(found.shared[WEAR], 2e-9)
    for own, true in zip(found.frames, (42.0, *load["value"]), strict=True):
        within(own[LOAD], true)
    for own, true in zip(found.frames[1:], friction["value"], strict=True):
        within(own[FRICTION], true)
    assert FRICTION not in found.frames[0] and found.distance_m == [None, 0.0, 77.0]
    assert found.chi == pytest.approx(1.0, abs=0.03)
    assert (
        all(tally.done <= tally.count for tally in progress)
        and progress[-1].done == progress[-1].count
    )

    # the fitted scene is the run, with its tables
    assert found.scene.wear.law == "sarkar" and found.scene.wear.distances_m == (0.0, 77.0)
    assert found.scene.load_at(77.0) == found.frames[2][LOAD]["value"]
    assert found.scene.friction_at(77.0) == found.frames[2][FRICTION]["value"]

    # what is left on disk says the same, and the fitted scene can be read again
    saved = json.loads((tmp_path / "out" / "fit.json").read_text("utf-8"))
    parts = {"value", "standard_uncertainty", "noise_uncertainty", "cramer_rao_bound"}
    assert set(saved[WEAR]) == parts and saved == json.loads(json.dumps(found.to_json()))
    again = load_scene(tmp_path / "out" / "scene.toml")
    assert (again.load, again.friction) == (found.scene.load, found.scene.friction)
    rows = read_csv(tmp_path / "out" / "fit.csv")
    assert [str(frame) for frame in rows["frame"]] == ["all", "0", "1", "1", "2", "2"]


@pytest.mark.long
def test_a_set_too_long_to_keep_is_read_in_each_pass_and_fitted_as_if_it_were_kept(tmp_path):
    """Of more than eight frames each pass reads the file again."""
    size = {"camera.width_px": 80, "camera.height_px": 60, "camera.pixel_mm": 0.05}
    small = parse_scene(PAPER_CONTACT + WORN[WORN.index("[camera]") :]).with_values(size)
    images = np.stack(
        [simulate(small.with_values({"camera.seed": seed})).frames[0] for seed in range(9)]
    )
    write_tiff(tmp_path / "film.tif", images, pixel_mm=0.05)
    read = fitting.fit(tmp_path / "film.tif", small, [LOAD])
    kept = fit_jointly(
        [prepared(image, small) for image in images], fitting.make_sequence(small, 9, (LOAD,), ()),
        np.array([read.shared[LOAD]["value"]]), shape=(60, 80),
    )  # fmt: skip
    within(read.shared[LOAD], 44.0)
    assert read.frame_chi == pytest.approx(kept.frame_chi, rel=1e-6)
    # from there no step is left but those below a thirtieth of a standard uncertainty
    apart = abs(read.shared[LOAD]["value"] - kept.values[0])
    assert apart < 0.05 * kept.standard_uncertainty[0]
    # nine frames know a load three times better than one
    one = fit_jointly(
        [prepared(images[0], small)],
        fitting.make_sequence(small, 1, (LOAD,), ()), np.array([44.0]), shape=(60, 80),
    )  # fmt: skip
    ratio = one.standard_uncertainty[0] / kept.standard_uncertainty[0]
    assert ratio == pytest.approx(3.0, rel=0.15)


def test_a_frame_count_that_is_not_the_scenes(tmp_path):
    path = written(tmp_path, scene(wear__distances_m=(0.0, 77.0)))
    with pytest.raises(InputError, match="3 frames, and the scene has 6 states"):
        fitting.fit(path, scene(), [LOAD])


@pytest.mark.study
def test_pulls_of_wear_and_friction_over_seeds():
    size = {"camera__pixel_mm": 0.0125, "camera__width_px": 320, "camera__height_px": 240}
    truth = scene(**size, wear__law="sarkar", friction__coefficient=RISING)
    sequence = fitting.make_sequence(truth, 6, (WEAR, LOAD), (FRICTION, *PLACE))
    true = np.array([2e-9, 44.0, *RISING["value"], *(-1.97,) * 6, *(0.004,) * 6])
    pulls = []
    for seed in range(6):
        frames = rendered(truth.with_values({"camera.seed": seed}))
        found = fit_jointly(frames, sequence, true, shape=(240, 320))
        assert found.chi == pytest.approx(1.0, abs=0.02)
        assert np.all(found.standard_uncertainty < 1.2 * found.cramer_rao_bound)
        pulls.append((found.values - true) / found.standard_uncertainty)
    size = np.sqrt(np.mean(np.square(pulls)))
    inside = np.mean(np.abs(pulls) < 1.96)
    # 6 seeds x 19 unknowns: 114 pulls, of which neighbours hang together; their RMS is known to
    # 0.08, the share to 2.4 %: two of each
    assert 0.84 < size < 1.16 and 0.90 < inside < 0.998
