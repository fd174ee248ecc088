"""A set in which nothing can be read is refused as a whole: exit code 3, and no results."""

import numpy as np
import pytest
import tifffile
from tracked_films import LOAD, contact, film

from isochrome.errors import PhysicsError
from isochrome.fitting import track
from isochrome.processing import process
from isochrome.scene import dump_scene, parse_scene

SHAPE = (30, 44)
NOTHING = "nothing could be read in any of"
STEPPED = "[specimen]\nthickness_mm = 4.0\n"
PLAIN = STEPPED + '[frames]\nno_load_dark = "dark.tif"\nno_load_bright = "bright.tif"\n'
KNOWN = PLAIN + "[[frames.known_order]]\nrow_px = 2\ncol_px = 2\norder = 0.0\n"


def save(place, frames):
    tifffile.imwrite(place / "film.tif", frames, photometric="minisblack")


@pytest.fixture(scope="module")
def negatives():
    """Two frames of a contact with light and dark exchanged: nowhere are its fringes."""
    return 255 - film(contact(SHAPE), {LOAD: [44.0] * 2}, 2)


@pytest.fixture
def place(tmp_path, negatives):
    save(tmp_path, negatives)
    (tmp_path / "scene.toml").write_text(dump_scene(contact(SHAPE)), "utf-8")
    return tmp_path


def nothing_is_left(place):
    assert sorted(p.name for p in place.iterdir()) == ["film.tif", "scene.toml"]


@pytest.mark.long
@pytest.mark.parametrize(
    "means", [pytest.param({}, marks=pytest.mark.study), {"track": True, "every": 2}]
)
def test_frames_without_the_scenes_fringes_are_no_result(place, negatives, means):
    """They ended with exit code 0 and a folder of empty maps."""
    count = 2 if means else 1
    save(place, negatives[:count])
    with pytest.raises(
        PhysicsError, match=f"{NOTHING} its {count} frames? .*chi.*correct the scene"
    ):
        process(place / "film.tif", place / "scene.toml", place / "out", **means)
    nothing_is_left(place)


@pytest.mark.long
def test_a_track_that_never_began_is_no_result(place):
    with pytest.raises(PhysicsError, match=f"{NOTHING} the 2 frames.*correct the scene"):
        track(place / "film.tif", place / "scene.toml", (LOAD,), out=place / "out")
    nothing_is_left(place)


def normal(level, seed, shape=SHAPE):
    """Noise of one grey level about a level."""
    return np.rint(level + np.random.default_rng(seed).standard_normal(shape)).astype(np.uint8)


@pytest.fixture
def lit(place):
    """No-load frames of 20 grey levels in darkness and 220 in the light, beside the film."""
    for name, level, seed in (("dark", 20, 1), ("bright", 220, 2)):
        tifffile.imwrite(place / f"{name}.tif", normal(level, seed), photometric="minisblack")
    return place


def test_nothing_is_kept_of_long_work_that_came_to_nothing(lit, monkeypatch):
    """The mended scene was refused beside it: the run in the working folder had another one."""
    monkeypatch.setattr("isochrome.runs.execution.WORTH_KEEPING_S", 0.0)
    save(lit, normal(120, 3)[None])
    with pytest.raises(PhysicsError, match=NOTHING) as refused:
        process(lit / "film.tif", parse_scene(KNOWN, folder=lit), lit / "out")
    assert "finished and kept" not in str(refused.value) and not list(lit.glob("out*"))


@pytest.mark.parametrize("out", ["out", None])
@pytest.mark.parametrize(
    ("text", "words"), [(KNOWN, "say that it is not"), (STEPPED, "not normalised.*check")]
)
def test_known_orders_that_lead_nowhere_and_no_contrast_are_no_result(lit, out, text, words):
    """Half of the light all over is a quarter of a fringe, and not the order 0 that is known."""
    save(lit, normal(120, 3)[None])
    with pytest.raises(PhysicsError, match=rf"{NOTHING} its 1 frame \(.*{words}"):
        process(lit / "film.tif", parse_scene(text, folder=lit), out and lit / out)
    assert not list(lit.glob("out*"))


def test_steps_without_an_order_or_with_all_frames_left_out_are_no_result(place):
    steps = "".join(
        f"[[polariscope.step]]\npolariser_deg = 90.0\ninput_plate_deg = 45.0\n"
        f"output_plate_deg = {plate}\nanalyser_deg = {analyser}\n"
        for plate, analyser in ((-45.0, 0.0), (-45.0, 90.0), (0.0, 0.0), (45.0, 45.0))
    )
    save(place, np.random.default_rng(5).normal(120.0, 3.0, (4, *SHAPE)).astype(np.uint8))
    with pytest.raises(PhysicsError, match=f"{NOTHING} its 1 frame"):
        process(place / "film.tif", parse_scene(STEPPED + steps), place / "out")
    nothing_is_left(place)
    # `keep_going` leaves out what fails; where that is all, there is no result to keep
    save(place, np.zeros((2, *SHAPE), np.uint8))
    with pytest.raises(PhysicsError, match=rf"{NOTHING} its 2 frames \(.*all black"):
        process(place / "film.tif", place / "scene.toml", place / "out", keep_going=True)
    nothing_is_left(place)


def test_one_frame_that_is_read_makes_a_result(lit):
    order = 1.4 * (np.arange(SHAPE[1]) / SHAPE[1]) ** 1.5 + np.zeros((SHAPE[0], 1))
    fringes = normal(20.0 + 200.0 * np.sin(np.pi * order) ** 2, 4)
    save(lit, np.stack([normal(120, 3), 0 * fringes, fringes]))  # one tells nothing, one is black
    done = process(lit / "film.tif", parse_scene(KNOWN, folder=lit), lit / "out", keep_going=True)
    spreads = done.columns["order_uncertainty"]
    assert 0.0 < spreads[2] < 0.03 and not any(value and value > 0.0 for value in spreads[:2])
    found = tifffile.imread(lit / "out" / "fringe_order.tif")
    assert np.isnan(found[:2]).all()
    assert (tifffile.imread(lit / "out" / "confidence.tif")[:2] == 0.0).all()
    assert np.isfinite(found[2]).mean() > 0.5 and np.nanmax(np.abs(found[2] - order)) < 0.25
