"""Films that begin without load: orders counted from zero, without a model or a known point."""

import subprocess
import sys

import numpy as np
import pytest
import tifffile
from tracked_films import leaves_the_same_bytes
from unloaded_films import FILMS, WHOLE, LoadedFilm, judged

from isochrome.errors import InputError, PhysicsError
from isochrome.processing import process
from real_frames import REAL, needs_real
from runs.killing import PROCESS, killed_command_ends_the_same, needs_sigkill

GAP, AFTER = 3.0, 12


@pytest.fixture(scope="module")
def followed():
    """A film, what is found in it, and what was told meanwhile."""
    film, told = LoadedFilm(3), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("isochrome.processing.kinds.followed_film.STAGE_EVERY_S", 0.0)
        return film, process(film.frames(), film.scene(), progress=told.append), told


@pytest.mark.long
def test_orders_are_counted_from_zero_through_unloading_and_pauses(followed):
    film, found, _ = followed
    kept, wrong, rms = judged(film, found).T
    assert wrong.max() == 0.0
    # frames of a quarter of the size have four times the gradient, and a tenth of a mm of noise
    # stands over fewer pixels; what is near order 0 cannot be read to 0.03 fringe
    assert kept[5:].min() > 0.7 and rms[5:].max() < 0.015


def test_the_table_says_how_high_the_orders_are_and_where_the_light_is_from(followed):
    film, found, _ = followed
    highest = np.array(found.table["n_max"], dtype=float)
    # at the edge fringes come to 7 pixels, and the last of them are not read
    assert (highest[5:] > 0.75 * film.course[5:]).all()
    assert (highest[5:] < film.course[5:] + 0.05).all()
    assert "crests that pass" in found.table["warnings"][0] and not any(found.table["warnings"][5:])
    assert np.nanmedian(np.array(found.table["chi"], dtype=float)) < 1.3


def test_the_first_pass_over_a_film_is_told_of(followed):
    film, _, told = followed
    first = [tally.done for tally in told if tally.stage == "following the fringes"]
    every = list(range(film.count))
    assert first == [0, *every, *every]  # whether it is unloaded; the highest light; the orders
    assert {tally.count for tally in told} == {film.count}
    assert not told[-1].stage and told[-1].done == film.count


def with_gap(film, jump):
    """Numbers of the frames of a film that leaves out those of one jump, and where it is."""
    before = int(np.flatnonzero(film.course > 0.3 * film.course.max())[0])
    moved = np.abs(film.course - film.course[before]) >= jump
    after = before + int(np.flatnonzero(moved[before:])[0])
    return [*range(before + 1), *range(after, min(film.count, after + AFTER))], before + 1


def test_after_a_gap_nothing_is_known_and_it_is_said():
    """Far from the hole a whole fringe more leaves the light as it is: that is the trap."""
    film = LoadedFilm(8)
    numbers, gap = with_gap(film, GAP)
    found = process(film.frames(numbers), film.scene())
    kept, wrong, _ = judged(film, found, numbers).T
    assert wrong.max() == 0.0 and kept[gap - 1] > 0.7 and not kept[gap:].any()
    assert all(f"from frame {gap - 1} to {gap}" in text for text in found.table["warnings"][gap:])


@pytest.mark.long
def test_frames_may_be_missing_where_the_order_changes_little():
    """All are left out that the largest change of 0.35 fringe allows: every second one or more."""
    film = LoadedFilm(9)
    numbers = [0]
    while numbers[-1] < film.count - 1:
        near = np.abs(film.course - film.course[numbers[-1]]) < 0.3
        ahead = numbers[-1] + 1
        while ahead < film.count - 1 and near[ahead + 1]:
            ahead += 1
        numbers.append(ahead)
    assert len(numbers) < 0.8 * film.count
    kept, wrong, _ = judged(film, process(film.frames(numbers), film.scene()), numbers).T
    assert wrong.max() == 0.0 and kept[5:].min() > 0.7


@needs_real
@pytest.mark.long
@pytest.mark.parametrize(
    "files",
    ["ring-five-loads/*.bmp", pytest.param("disc-seven-loads/*.jpg", marks=pytest.mark.study)],
)
def test_real_frames_of_far_loads_are_refused(files, tmp_path):
    scene = SCENE if "ring" in files else SCENE + ROI
    (tmp_path / "scene.toml").write_text(scene, encoding="utf-8")
    given = ["process", str(REAL / files), "--scene", str(tmp_path / "scene.toml")]
    command = [sys.executable, "-m", "isochrome", *given, "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 3 and "cannot be followed" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_film_that_begins_under_load_is_refused():
    film = LoadedFilm(4)
    with pytest.raises(PhysicsError, match="first frame is not the unloaded specimen"):
        process(film.frames(range(12, film.count)), film.scene())


def test_a_film_whose_orders_stay_low_needs_the_bright_frame():
    film = LoadedFilm(4)
    numbers = [k for k in range(film.count) if film.course[: k + 1].max() < 1.15]
    with pytest.raises(PhysicsError, match=r"crests tell its light from 1\.25"):
        process(film.frames(numbers), film.scene())
    dark, bright = film.light
    scene = film.scene()
    scene["frames"] |= {
        "no_load_bright": np.rint(255 * (dark + bright)).astype(np.uint8),
        "no_load_dark": np.rint(255 * dark + 0 * bright).astype(np.uint8),
    }
    kept, wrong, rms = judged(film, process(film.frames(numbers), scene), numbers).T
    assert wrong.max() == 0.0 and kept[-1] > 0.5 and rms[-1] < 0.02


@pytest.mark.long
def test_the_bright_field_is_followed_too():
    film = LoadedFilm(3)
    dark, bright = film.light
    frames = film.frames().astype(float)
    turned = np.clip(np.rint(255 * (2 * dark + bright) - frames), 0, 255).astype(np.uint8)
    scene = film.scene() | {"polariscope": {"field": "bright"}}
    kept, wrong, _ = judged(film, process(turned, scene)).T
    assert wrong.max() == 0.0 and kept[3:].min() > 0.7


KNOWN = {"known_order": [{"row_px": 1, "col_px": 1, "order": 0.0}]}
DISC = {"shape": "disc", "diameter_mm": 2.0, "fringe_value_n_per_mm": 10.0}


@pytest.mark.parametrize(
    ("frames", "specimen", "words"),
    [
        (KNOWN, {}, "counted from zero"),
        ({"gamma": "unknown"}, {}, "gamma = 'unknown'"),
        ({}, DISC, "without a model"),
    ],
)
def test_what_cannot_be_counted_from_zero_is_refused(frames, specimen, words):
    scene = LoadedFilm(3).scene() | ({"load": {"normal_n": 10.0}} if specimen else {})
    scene["frames"] |= frames
    scene["specimen"] |= specimen
    with pytest.raises(InputError, match=words):
        process(LoadedFilm(3).frames(range(3)), scene)


@pytest.mark.study
def test_workers_and_chunks_give_the_same_bytes(tmp_path):
    film = LoadedFilm(3)
    assert leaves_the_same_bytes(tmp_path, film.frames(range(24)), film.scene())


@pytest.mark.study
@pytest.mark.parametrize("number", range(len(FILMS)))
def test_twelve_films_and_gaps_of_whole_size(number):
    """Wrong branches below 0.1 %, without a known point."""
    film = LoadedFilm(number, WHOLE)
    _, wrong, rms = judged(film, process(film.frames(), film.scene())).T
    assert wrong.max() < 1e-3 and np.median(rms) < 0.01
    if film.course.max() * 0.7 > GAP:  # three fringes are left after a third of its course
        numbers, gap = with_gap(film, GAP)
        found = process(film.frames(numbers), film.scene())
        kept, wrong, _ = judged(film, found, numbers).T
        assert wrong.max() < 1e-3 and not kept[gap:].any()


@pytest.mark.study
@needs_sigkill
@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_killed_run_ends_with_the_same_bytes(tmp_path, code, workers):
    tifffile.imwrite(tmp_path / "film.tif", LoadedFilm(9).frames())
    (tmp_path / "scene.toml").write_text(SCENE, "utf-8")
    assert killed_command_ends_the_same(tmp_path, code, workers, *PROCESS)


ROI = "roi = { top_px = 900, left_px = 850, height_px = 370, width_px = 370 }\n"
SCENE = (
    '[specimen]\nshape = "other"\nthickness_mm = 4.0\n[camera]\nbit_depth = 8\npixel_mm = 0.02\n'
    "[frames]\nstarts_unloaded = true\n"
)
