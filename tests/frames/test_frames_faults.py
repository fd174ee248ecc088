"""Faulty and saturated pixels are masked, by the frame itself and by the no-load frames."""

import json
from pathlib import Path

import numpy as np
import pytest

from isochrome.estimation import prepare_frame
from isochrome.frames import Frame, find_outliers, load_no_load, normalise, open_frames, to_linear
from isochrome.output import write_tiff
from isochrome.scene import load_scene, parse_scene

CONTACT = Path(__file__).resolve().parents[2] / "sample_images" / "line-contact-wear"
ROWS, COLS = 120, 160
ROW, COL = np.mgrid[:ROWS, :COLS].astype(float)
SIGNAL = np.sin(np.pi * 0.03 * COL) ** 2
RNG = np.random.default_rng
DEAD, HOT, GLARE = (40, 67), (70, 16), np.hypot(ROW - 90, COL - 120) < 6
"""The dead pixel lies on a dark fringe (order 2 at column 66.7), the hot one on a bright (0.5)."""


def captured(light, seed, sigma=1.0):
    raw = np.clip(np.rint(255 * light + sigma * RNG(seed).standard_normal(light.shape)), 0, 254)
    raw[DEAD], raw[HOT] = 0, 254
    return raw.astype(np.uint8)


@pytest.fixture
def case(tmp_path):
    """A frame whose faults do not show in it, and the scene with no-load frames that show them."""
    for name, level, seed in (("dark", 0.01, 1), ("bright", 0.99, 2)):
        stack = np.stack([captured(np.full(SIGNAL.shape, level), seed + 10 * i) for i in range(3)])
        write_tiff(tmp_path / f"{name}.tif", stack)
    frame = captured(0.01 + 0.98 * SIGNAL, 3)
    text = '[frames]\nno_load_dark = "dark.tif"\nno_load_bright = "bright.tif"\n'
    return frame, parse_scene("[specimen]\n[camera]\nbit_depth = 8\n" + text, folder=tmp_path)


def test_fault_that_hides_in_a_fringe_is_masked_by_the_no_load_frame_that_shows_it(case):
    frame, scene = case
    dark, bright = load_no_load(scene)
    own = to_linear(frame, bit_depth=8)
    assert own.valid[DEAD] and own.valid[HOT]  # or the no-load frames were not needed
    assert not bright.valid[DEAD] and not dark.valid[HOT]
    wanted = np.zeros((ROWS, COLS), bool)
    wanted[DEAD] = wanted[HOT] = True
    np.testing.assert_array_equal(~normalise(own, dark, bright).valid, wanted)
    data = prepare_frame(Frame(0, frame, None, "f"), scene, bit_depth=8, no_load=(dark, bright))
    np.testing.assert_array_equal(~data.valid, wanted)


def test_saturated_pixels_of_frame_and_no_load_frame_are_masked(case):
    frame, scene = case
    dark, bright = load_no_load(scene)
    frame[GLARE] = 255
    full = to_linear(np.where(COL < 5, 255, np.rint(255 * bright.image)), bit_depth=8)
    valid = normalise(to_linear(frame, bit_depth=8), dark, full).valid
    assert not valid[GLARE].any() and not valid[COL < 5].any()
    assert valid[~GLARE & (COL > 5)].mean() > 0.999  # the two faulty pixels of 19 000 besides


def test_all_faulty_pixels_of_the_sample_frames_are_masked_and_hardly_another():
    faults = json.loads((CONTACT / "truth.json").read_text("utf-8"))["camera_faults"]
    wanted = np.array(faults["dead_row_col"] + faults["hot_row_col"])
    row, col, radius = faults["glare_row_col_radius_px"]
    dark, bright = load_no_load(load_scene(CONTACT / "scene.toml"))
    frames = list(open_frames(CONTACT / "captured.tif"))
    assert len(frames) == 6
    for frame in frames:
        masked = ~(to_linear(frame.image, bit_depth=8).valid & dark.valid & bright.valid)
        assert masked[tuple(wanted.T)].all()
        masked[tuple(wanted.T)] = False
        rows, cols = np.nonzero(masked)
        # outside the glare, which is saturated and whose edge the blur carries on for two pixels,
        # one pixel in 100 000 may be a chance of noise
        assert np.count_nonzero(np.hypot(rows - row, cols - col) > radius + 2) <= 3


@pytest.mark.parametrize("sigma", [0.5, 3.0, 10.0])
def test_noise_alone_gives_no_faulty_pixel(sigma):
    flat = np.rint(120 + sigma * RNG(4).standard_normal((400, 500))).astype(np.uint8)
    # eight deviations beyond the neighbours: a normal noise does not reach that once in 200 000
    assert not find_outliers(flat).any()
