"""Tracking a contact through a video: values, uncertainties, lost tracks, worn runs, refusals."""

import numpy as np
import pytest
import tifffile

from fitting.engine_frames import light_of
from isochrome.errors import InputError
from isochrome.fitting import Tracker, placed, track
from isochrome.fitting.tracking.tracker import NO_FRINGES
from isochrome.frames import Frame
from isochrome.messages import message
from isochrome.optics import expose
from isochrome.output import read_csv
from isochrome.scene import load_scene
from isochrome.simulation import scene_states

LOAD, FRICTION, LEFT = "load.normal_n", "friction.coefficient", "camera.left_mm"
SHAPE = (200, 300)


def contact():
    """The paper's case at half its resolution, sliding, as a camera with noise sees it."""
    scene = load_scene("line-contact-wear")
    return scene.model_copy(update={"wear": None}).with_values(
        {
            LOAD: 44.0, FRICTION: 0.2, "friction.static_state_first": False,
            "camera.width_px": SHAPE[1], "camera.height_px": SHAPE[0], "camera.pixel_mm": 0.0125,
            LEFT: -1.9, "camera.vignette": 0.3, "camera.brightness": 0.85,
            "camera.background": 0.05, "camera.noise_grey": 3.0,
        }
    )  # fmt: skip


def frame_of(scene, state, rng):
    return expose(light_of(scene, state), scene.camera, rng=rng)


def film(scene, courses, rng):
    """A frame for each set of values of some keys."""
    frames = []
    for values in zip(*courses.values(), strict=True):
        here = scene.with_values(dict(zip(courses, map(float, values), strict=True)))
        frames.append(frame_of(here, scene_states(here)[-1], rng))
    return np.stack(frames)


def save(folder, frames):
    tifffile.imwrite(folder / "film.tif", frames, photometric="minisblack")


def drifting(count):
    """A load that drifts and swings by 5 %, friction that rises, a contact that creeps along."""
    i = np.arange(count)
    return {
        LOAD: 44.0 * (1.0 + 0.05 * np.sin(2 * np.pi * i / 40) + 0.02 * i / count),
        FRICTION: 0.2 + 0.03 * i / count,
        LEFT: -1.9 + 0.004 * np.sin(i / 9),
    }


def pulls(result, courses):
    truth = np.column_stack([courses[key] for key in result.keys])
    return (result.values - truth) / result.standard_uncertainty


@pytest.mark.parametrize(
    ("count", "keys"),
    [
        pytest.param(16, (LOAD, LEFT), marks=pytest.mark.long),
        pytest.param(40, (LOAD, FRICTION, LEFT), marks=pytest.mark.study),
    ],
)
def test_a_drifting_and_swinging_contact_is_followed_with_its_uncertainty(tmp_path, count, keys):
    courses = {key: values for key, values in drifting(count).items() if key in keys}
    save(tmp_path, film(contact(), courses, np.random.default_rng(1)))
    start = contact().with_values({LOAD: 46.0, LEFT: -1.91})
    result = track(tmp_path / "film.tif", start, tuple(courses), out=tmp_path / "out")
    assert result.searched == (0,) and not result.warnings
    # chi of 14400 pixels scatters by 0.006
    assert np.all(np.abs(result.chi - 1.0) < 0.03)
    share = result.values[:, 0] / courses[LOAD] - 1.0
    # the bar of 659 x 494 pixels, held with 5.4 times fewer
    assert np.sqrt(np.mean(share**2)) < 5e-4
    # the RMS of n pulls scatters by 1/sqrt(2n)
    spread = np.sqrt(np.mean(pulls(result, courses) ** 2))
    assert abs(spread - 1.0) < 3.5 / np.sqrt(2 * result.values.size)
    assert np.all(result.standard_uncertainty < 1.2 * result.cramer_rao_bound)
    table = read_csv(tmp_path / "out" / "fit.csv")
    assert len(table["value"]) == count * len(keys) and set(table["key"]) == set(courses)
    rows = np.array(table["value"]).reshape(result.values.shape)
    assert rows == pytest.approx(result.values, rel=1e-8)  # nine digits are written
    for name in ("scene.toml", "fit.json", "provenance.json", "fit.png"):
        assert (tmp_path / "out" / name).stat().st_size > 0


@pytest.mark.long
def test_a_load_that_jumps_is_lost_told_and_found_again(tmp_path):
    load = np.r_[np.full(4, 44.0), np.full(4, 80.0)]
    rng = np.random.default_rng(2)
    save(tmp_path, film(contact(), {LOAD: load}, rng))
    result = track(tmp_path / "film.tif", contact(), (LOAD,))
    assert result.searched == (0, 4)
    assert any("frame 4" in text and "no track to follow" in text for text in result.warnings)
    assert np.all(np.abs(pulls(result, {LOAD: load})) < 4.0)


@pytest.mark.long
def test_a_frame_without_fringes_has_no_values_and_the_next_are_found(tmp_path):
    rng = np.random.default_rng(3)
    frames = film(contact(), {LOAD: np.full(3, 44.0)}, rng)
    frames[1] = np.clip(rng.normal(120.0, 3.0, SHAPE), 0, 255).astype(np.uint8)
    save(tmp_path, frames)
    result = track(tmp_path / "film.tif", contact(), (LOAD,))
    assert np.isnan(result.values[1]).all() and np.isnan(result.standard_uncertainty[1]).all()
    assert f"frame 1: {message(NO_FRINGES)}" in result.warnings
    assert np.all(np.abs(result.values[[0, 2], 0] / 44.0 - 1.0) < 2e-3)


def test_between_two_solved_contacts_a_frame_is_what_the_mechanics_make_of_it():
    """Values of ten standard uncertainties beside: by what turns the field, and by a contact."""
    scene = placed(contact(), SHAPE)
    image = frame_of(scene, scene_states(scene)[-1], np.random.default_rng(1))
    keys = (LOAD, FRICTION, LEFT)
    tracker = Tracker(scene, keys, bit_depth=8)
    found = tracker.track(Frame(0, image, None, "0"), None)
    model = tracker._model
    values = found.values + 10.0 * found.standard_uncertainty * [1.0, -1.0, 1.0]
    by_turns = model.at(values).residual
    start = model.at(found.values).residual
    model.stand(values)
    solved = model.at(values).residual
    assert np.linalg.norm(solved - by_turns) < 0.02 * np.linalg.norm(solved - start)


@pytest.mark.parametrize(
    ("change", "keys", "said"),
    [
        ({}, ("frames.gamma",), "cannot be tracked"),
        ({}, ("specimen.young_gpa",), "cannot be tracked"),
        ({"friction.static_state_first": True}, (LOAD,), "static_state_first"),
    ],
)
def test_what_cannot_be_tracked_is_refused(tmp_path, change, keys, said):
    frames = np.random.default_rng(5).integers(40, 90, (2, *SHAPE)).astype(np.uint8)
    save(tmp_path, frames)
    with pytest.raises(InputError, match=said):
        track(tmp_path / "film.tif", contact().with_values(change), keys, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
