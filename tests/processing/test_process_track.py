"""A tracked video: key frames as ever, a row for every frame, the same bytes by whomever."""

import numpy as np
import pytest
import tifffile
from tracked_films import LEFT, LOAD, TOP, contact, film

import isochrome.fitting.tracking.tracker
from isochrome import open_run
from isochrome.comparison import load_frame_set
from isochrome.errors import InputError
from isochrome.fitting import track
from isochrome.fitting.tracking.tracker import AGAIN, FAR, NO_FRINGES
from isochrome.messages import message
from isochrome.output import read_csv
from isochrome.processing import process
from isochrome.scene import dump_scene, parse_scene
from runs.killing import PROCESS, killed_command_ends_the_same, needs_sigkill
from stepped_sets import BEAM

SHAPE = (160, 240)
EVERY = 5
MAPS = ("normalised", "fringe_order", "confidence")


def course(count):
    """A load that swings by 3 %, and a contact that creeps along."""
    i = np.arange(count)
    return {LOAD: 44.0 * (1.0 + 0.03 * np.sin(i / 4)), LEFT: -1.9 + 0.004 * np.sin(i / 9)}


def save(folder, frames, scene=None):
    folder.mkdir(exist_ok=True)
    tifffile.imwrite(folder / "film.tif", frames, photometric="minisblack")
    (folder / "scene.toml").write_text(dump_scene(scene or contact()), "utf-8")
    return folder


def numbers(values):
    return np.array([np.nan if v in (None, "") else v for v in values], dtype=float)


def run(place, out="out", **more):
    options = {"track": True, "every": EVERY, "maps": "key"} | more
    return process(place / "film.tif", place / "scene.toml", place / out, **options)


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """Eight frames, of which 0 and 5 are key frames; the last chunk is a short one."""
    place = save(tmp_path_factory.mktemp("tracked"), film(contact(), course(8), 1))
    found = run(place)
    return place, found


def test_every_frame_has_its_values_with_their_uncertainty(tracked):
    place, found = tracked
    assert not found.warnings and found.frames is None and found.tracked
    table = read_csv(place / "out" / "frames.csv")
    assert table["frame"] == list(range(8))
    assert [k for k, at in enumerate(found.columns["picture"]) if at is not None] == [0, 5]
    assert found.columns["found_by"] == ["whole frame" if k % EVERY == 0 else "track"
                                       for k in range(8)]  # fmt: skip
    truth = course(8) | {TOP: np.zeros(8)}
    pulls = [
        (numbers(table[key]) - truth[key]) / numbers(table[f"{key} standard_uncertainty"])
        for key in truth
    ]
    # the RMS of n pulls scatters by 1/sqrt(2n)
    assert abs(np.sqrt(np.mean(np.square(pulls))) - 1.0) < 3.5 / np.sqrt(2 * 3 * 8)
    chi = numbers(table["chi"])
    # chi of 9600 pixels scatters by 0.007
    assert np.all(np.abs(chi - 1.0) < 0.04)
    # a key frame has four times the pixels of a followed one
    spread = numbers(table[f"{LOAD} standard_uncertainty"])
    assert spread[[0, 5]].max() < 0.7 * np.delete(spread, [0, 5]).min()
    summary = found.summary()
    assert summary["key"][0] == LOAD
    assert summary["mean"][0] == pytest.approx(numbers(table[LOAD]).mean(), rel=1e-8)


@pytest.mark.long
def test_key_frames_are_processed_as_without_tracking(tracked, tmp_path):
    place, found = tracked
    alone = save(tmp_path / "alone", tifffile.imread(place / "film.tif")[[0, 5]])
    process(alone / "film.tif", alone / "scene.toml", alone / "out")
    for name in MAPS:
        pictures = tifffile.imread(place / "out" / f"{name}.tif")
        np.testing.assert_array_equal(pictures, tifffile.imread(alone / "out" / f"{name}.tif"))
    theirs = read_csv(alone / "out" / "frames.csv")
    for key in (LOAD, LEFT, "chi", "n_max", "kept_share", "noise"):
        own = [found.columns[key][k] for k in (0, 5)]
        assert own == pytest.approx(theirs[key], rel=1e-8)  # nine digits are written


def test_the_dataset_has_pictures_of_key_frames_and_columns_of_all(tracked):
    place, found = tracked
    with open_run(place / "out") as dataset:
        assert dict(dataset.sizes) == {"frame": 8, "key_frame": 2, "z_mm": 160, "x_mm": 240}
        assert dataset.key_frame.values.tolist() == [0, 5]
        assert dataset.fringe_order.dims == ("key_frame", "z_mm", "x_mm")
        stack = tifffile.imread(place / "out" / "fringe_order.tif")
        np.testing.assert_array_equal(dataset.fringe_order.sel(key_frame=5).values, stack[1])
        assert dataset.load_normal_n.values.tolist() == found.columns[LOAD]
        assert dataset.left_mm.values == pytest.approx(course(8)[LEFT], abs=2e-3)


def test_a_complete_run_gives_its_table_again_and_its_key_frames_are_compared(tracked):
    place, _ = tracked
    found = load_frame_set(place / "out")
    assert found.signal.shape == (2, *SHAPE) and found.order.shape == (2, *SHAPE)
    assert found.labels == ("static",) * 2
    assert found.noise.shape == (2,) and np.isfinite(found.noise).all()
    place, found = tracked
    again = run(place)
    assert again.already and again.warnings == found.warnings
    assert list(again.columns) == list(found.columns)
    for name, values in found.columns.items():
        if name in ("name", "label", "found_by", "warnings", "picture", "n_max_from"):
            assert again.columns[name] == values
        else:
            np.testing.assert_array_equal(numbers(again.columns[name]), numbers(values), name)


@pytest.mark.study
@needs_sigkill
@pytest.mark.parametrize("workers", ["1", "2"])
@pytest.mark.parametrize("sliding", [False, True])
def test_killed_at_random_moments_it_ends_with_the_same_bytes(tmp_path, code, workers, sliding):
    """Values, key frames' maps, and the compact maps of all frames."""
    scene = contact(sliding=sliding)
    place = save(tmp_path / "film", film(scene, course(14), 5), scene)
    assert killed_command_ends_the_same(place, code, workers, *PROCESS, "--track", "--every", "3")


@pytest.mark.long
def test_what_happens_in_the_middle_is_told(tmp_path, monkeypatch):
    """A load that jumps is found again; frames without fringes have no values."""
    frames = film(contact(), {LOAD: [44.0, 44.0, 70.0, 70.0, 44.0, 44.0, 44.0, 44.0]}, 3)
    rng = np.random.default_rng(3)
    for k in (4, 5, 6):
        frames[k] = np.clip(rng.normal(120.0, 3.0, SHAPE), 0, 255).astype(np.uint8)
    place = save(tmp_path / "film", frames)
    searched = []
    search = isochrome.fitting.tracking.tracker.fit_frame

    def noted(data, *more, **options):
        searched.append(data.name)
        return search(data, *more, **options)

    monkeypatch.setattr(isochrome.fitting.tracking.tracker, "fit_frame", noted)
    found = process(place / "film.tif", place / "scene.toml", place / "out", track=True, every=8)
    assert found.columns["found_by"] == [
        "whole frame", "track", "search", "track", "nothing", "nothing", "nothing", "search",
    ]  # fmt: skip
    load = numbers(found.columns[LOAD])
    assert np.isnan(load[4:7]).all()
    # a few standard uncertainties of 0.007 N
    assert load[[0, 1, 2, 3, 7]] == pytest.approx([44.0, 44.0, 70.0, 70.0, 44.0], abs=0.03)
    assert set(found.warnings) == {
        f"frames 2, 7 (2 in all): {message(AGAIN)}",
        f"frames 4-6 (3 in all): {message(NO_FRINGES)}",
    }
    # neither a key frame, nor a frame that shows what was searched in vain, is searched anew
    assert [name[-3:] for name in searched] == ["[2]", "[4]", "[7]"]
    with open_run(place / "out") as dataset:
        status = dataset.status.values.tolist()
    assert [s == "flagged" for s in status] == [k in (2, 4, 5, 6, 7) for k in range(8)]


def rings():
    """A picture of fringes that no contact makes."""
    row, col = np.mgrid[: SHAPE[0], : SHAPE[1]]
    light = 110.0 + 80.0 * np.cos(2.0 * np.pi * np.hypot(row - 80, col - 120) / 40.0)
    return np.clip(light + np.random.default_rng(1).normal(0.0, 3.0, SHAPE), 0, 255)


@pytest.mark.study
def test_both_commands_that_track_say_the_same(tmp_path):
    """A jump, fringes of something else, and no fringes: one engine decides what is told."""
    frames = film(contact(), {LOAD: [44.0, 44.0, 44.0, 44.0, 70.0, 70.0]}, 2)
    frames[2] = rings()
    frames[3] = np.clip(np.random.default_rng(3).normal(120.0, 3.0, SHAPE), 0, 255)
    place = save(tmp_path / "film", frames)
    found = process(place / "film.tif", place / "scene.toml", place / "out", track=True, every=9)
    one = found.over_frames
    fitted = track(place / "film.tif", place / "scene.toml", one.keys)
    other = fitted.over_frames
    known = [True, True, False, False, True, True]
    for values in (one, other):
        assert np.isfinite(values.values).all(axis=1).tolist() == known
        assert np.isfinite(values.chi).tolist() == [True, True, True, False, True, True]
    assert one.searched.tolist()[1:] == other.searched.tolist()[1:] == [False] * 3 + [True, False]
    for text in (
        "frame 2: " + message(FAR),
        "frame 3: " + message(NO_FRINGES),
        "frame 4: " + message(AGAIN),
    ):
        assert text in found.warnings and text in fitted.warnings
    # all but the first frame, of which process takes every pixel, hold the same pixels: Newton's
    # last step is a twentieth of a standard uncertainty at most
    apart = (one.values - other.values)[[1, 4, 5]] / one.standard_uncertainty[[1, 4, 5]]
    assert np.abs(apart).max() < 0.05 and one.summary().keys() == other.summary().keys()


@pytest.mark.long
def test_a_recording_that_begins_without_a_load_has_values_from_where_it_shows_one(tmp_path):
    frames = film(contact(), {LOAD: [44.0] * 8}, 7)
    light = contact().camera.background * 255
    rng = np.random.default_rng(8)
    frames[:4] = np.clip(rng.normal(light, 3.0, (4, *SHAPE)), 0, 255).astype(np.uint8)
    place = save(tmp_path / "film", frames)
    found = process(place / "film.tif", place / "scene.toml", place / "out", track=True, every=3)
    load = numbers(found.columns[LOAD])
    assert np.isnan(load[:4]).all()
    assert load[4:] == pytest.approx([44.0] * 4, abs=0.03)  # a few standard uncertainties
    assert found.columns["found_by"] == [
        "nothing", "nothing", "nothing", "nothing", "search", "track", "whole frame", "track",
    ]  # fmt: skip
    assert found.fitted.load.normal_n == pytest.approx(44.0, abs=0.03)
    order = tifffile.imread(place / "out" / "fringe_order.tif")
    assert order.shape == (8, *SHAPE)  # a page for every frame
    assert np.isnan(order[:4]).all() and np.isfinite(order[4:]).mean(axis=(1, 2)).min() > 0.9


@pytest.mark.long
def test_a_bad_frame_ends_the_run_or_is_left_out(tmp_path):
    frames = film(contact(), {LOAD: [44.0] * 4}, 4)
    frames[[1, 2]] = 0
    place = save(tmp_path / "film", frames)
    arguments = (place / "film.tif", place / "scene.toml", place / "out")
    with pytest.raises(InputError, match=r"film\.tif\[1\]"):
        process(*arguments, track=True, every=2)
    assert not (place / "out").exists() and not (place / "out.partial").exists()
    found = process(*arguments, track=True, every=2, keep_going=True)
    assert found.failed == 2
    assert found.columns["found_by"] == ["whole frame", "nothing", "nothing", "search"]
    assert np.isfinite(numbers(found.columns[LOAD])).tolist() == [True, False, False, True]
    assert found.fitted.load.normal_n == pytest.approx(44.0, abs=0.03)


@pytest.mark.parametrize(
    ("scene", "every", "said"),
    [
        (contact(), 1, "--every 1: give 2 or more"),
        (
            contact(sliding=True).with_values({"friction.static_state_first": True}), 5,
            "static_state_first = true",
        ),
        (parse_scene(BEAM + "pixel_mm = 0.05\n"), 5, "a beam cannot be tracked"),
    ],
)  # fmt: skip
def test_what_cannot_be_tracked_is_refused(tmp_path, scene, every, said):
    shape = (3, scene.camera.height_px, scene.camera.width_px)
    place = save(tmp_path / "film", np.full(shape, 90, np.uint8), scene)
    with pytest.raises(InputError, match=said):
        process(place / "film.tif", place / "scene.toml", place / "out", track=True, every=every)
    assert not (place / "out").exists() and not (place / "out.partial").exists()
