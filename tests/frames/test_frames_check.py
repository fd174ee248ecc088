"""What is wrong with a set is said before the long run."""

import numpy as np
import pytest
from recordings import written

from isochrome.frames import look_through
from isochrome.output import write_tiff
from isochrome.scene import parse_scene
from scene_texts import WEARING_CONTACT, camera_text

ROWS, COLS = 60, 80
ROW, COL = np.mgrid[:ROWS, :COLS].astype(float)
CONTACT = WEARING_CONTACT.replace("0.25\n", "0.25\nstatic_state_first = true\n")
CONTACT += "distances_m = [0, 31, 77]\n" + camera_text(COLS, ROWS, 0.01, bit_depth=8)
PLAIN = "[specimen]\n[camera]\nbit_depth = 8\n"


def fringe(i=0, full=255, level=0.9):
    light = 0.05 + (level - 0.05) * np.sin(np.pi * (0.05 * COL + 0.1 * i)) ** 2
    noise = np.random.default_rng(i).standard_normal(light.shape) * 0.01
    return np.clip(full * (light + noise), 0, full - 1)


def checked(tmp_path, frames, toml=PLAIN, dtype=np.uint8, **options):
    write_tiff(tmp_path / "f.tif", np.stack(frames).astype(dtype), **options)
    return look_through(tmp_path / "f.tif", parse_scene(toml, folder=tmp_path))


def texts(check, level):
    return " | ".join(f.text for f in check.findings if f.level == level)


def test_good_set_has_no_error_and_names_its_noise(tmp_path):
    for name in ("d", "b"):
        write_tiff(tmp_path / f"{name}.tif", fringe(9, level=0.9)[None].astype(np.uint8))
    toml = CONTACT + '[frames]\nno_load_dark = "d.tif"\nno_load_bright = "b.tif"\n'
    check = checked(tmp_path, [fringe(i) for i in range(4)], toml, pixel_mm=0.01)
    assert check.ok and check.count == 4 and check.shape == (ROWS, COLS)
    assert texts(check, "warning") == ""
    assert "camera noise about 2." in texts(check, "note")  # 1 % of 255


@pytest.mark.parametrize(
    ("frames", "level", "words"),
    [
        ([fringe(), np.zeros((ROWS, COLS))], "error", "frame 1: all black"),
        ([np.full((ROWS, COLS), 255)], "error", "frame 0: all white"),
        ([np.full((ROWS, COLS), 9)], "error", "constant"),
        ([fringe(0), np.where(COL < 20, 255, fringe(1))], "warning", "frame 1: saturated in up to"),
        ([fringe(0), fringe(1, level=0.1)], "warning", "frame 1: low contrast"),
        ([fringe(0), fringe(1, level=0.5)], "warning", "frame 1: the brightness jumps"),
        ([fringe(0), fringe(1), fringe(0)], "warning", "frame 2: the same, pixel by pixel"),
        ([fringe()], "warning", "no_load_dark and frames.no_load_bright not given"),
        ([fringe()], "note", "has no model"),
    ],
)
def test_fault_is_found_and_its_frame_named(tmp_path, frames, level, words):
    assert words in texts(checked(tmp_path, frames), level)


def test_several_faulty_frames_are_told_apart(tmp_path):
    check = checked(tmp_path, [np.zeros((ROWS, COLS))] * 3 + [fringe()])
    (black,) = [f for f in check.findings if "all black" in f.text]
    assert black.text.startswith("frames 0-2:") and black.frame == 0
    part = fringe(0, 1)
    part[3, 4] = np.nan
    check = checked(
        tmp_path, [np.full((ROWS, COLS), np.nan), part], "[specimen]\n", dtype=np.float32
    )
    assert "frame 0: no number" in texts(check, "error")
    assert "frame 1: some pixels are not finite" in texts(check, "note")


def test_a_full_scale_of_fewer_bits_is_suspected_to_the_last_level(tmp_path):
    check = checked(tmp_path, [fringe(0, 4095)], "[specimen]\n", dtype=np.uint16)
    assert "probably 12 bits; set camera.bit_depth = 12" in texts(check, "warning")
    shifted = np.floor(fringe(0, 4095)) * 16
    check = checked(tmp_path, [shifted], "[specimen]\n", dtype=np.uint16)
    assert "multiples of 16: a 12-bit sensor" in texts(check, "note")
    # 4095 is the last level of 12 bits
    for largest, bits in ((4095, 12), (4096, 14), (1023, 10)):
        frame = fringe(0, largest)
        frame[3, 4] = largest
        check = checked(tmp_path, [frame], "[specimen]\n", dtype=np.uint16)
        assert f"camera.bit_depth = {bits} " in texts(check, "warning")


def test_bit_depth_too_small_is_an_error_with_the_frame(tmp_path):
    toml = "[specimen]\n[camera]\nbit_depth = 10\n"
    check = checked(tmp_path, [fringe(0, 900), fringe(1, 4095)], toml, dtype=np.uint16)
    assert not check.ok and "frame 1" in texts(check, "error") and check.count == 1


def test_what_the_scene_says_is_held_against_the_frames(tmp_path):
    check = checked(tmp_path, [fringe(i)[:-2] for i in range(3)], CONTACT, pixel_mm=0.02)
    errors = texts(check, "error")
    assert "3 frames, and the scene has 4 states" in errors and "58 rows x 80 columns" in errors
    assert "names 0.02 mm a pixel" in errors
    toml = PLAIN + "[[polariscope.step]]\npolariser_deg = 0.0\nanalyser_deg = 90.0\n" * 2
    toml += "[[frames.known_order]]\nrow_px = 60\ncol_px = 3\norder = 0.0\n"
    errors = texts(checked(tmp_path, [fringe(i) for i in range(3)], toml), "error")
    assert "3 frames are not a multiple of the polariscope's 2 steps" in errors
    assert "known_order[1] at row 60" in errors
    toml = PLAIN + "[[frames.known_line]]\nrow_px = [3, 60.5]\ncol_px = [4, 4]\norder = 1.0\n"
    toml += "[[frames.free_boundary]]\nrow_px = [-0.5, 59.5, 0]\ncol_px = [0, 0, 81]\n"
    errors = texts(checked(tmp_path, [fringe()], toml), "error")
    assert "known_line[1], point 2 at row 60.5, column 4 lies outside 60 x 80 pixels" in errors
    assert "free_boundary[1], point 3 at row 0, column 81 lies outside" in errors
    toml = CONTACT + "[frames]\nsliding_speed_mm_per_s = 5.0\n"
    assert "carry no time" in texts(checked(tmp_path, [fringe()], toml), "error")


def test_neither_a_ring_nor_a_missing_path_is_an_exception(tmp_path):
    check = checked(tmp_path, [fringe()], '[specimen]\nshape = "ring"\n')
    assert "a ring has no model without specimen.hole_mm" in texts(check, "warning") and check.ok
    nothing = look_through(tmp_path / "none.tif", parse_scene(PLAIN))
    assert not nothing.ok and nothing.count == 0 and "none.tif" in texts(nothing, "error")


def test_no_load_frames_of_other_size_or_exposure_are_reported(tmp_path):
    toml = PLAIN + '[frames]\nno_load_bright = "b.tif"\n'
    write_tiff(tmp_path / "b.tif", fringe(0, level=0.4)[None].astype(np.uint8))
    assert "no_load_bright only" in texts(checked(tmp_path, [fringe()], toml), "warning")
    write_tiff(tmp_path / "b.tif", fringe()[None, 1:].astype(np.uint8))
    assert "no_load_bright is (59, 80)" in texts(checked(tmp_path, [fringe()], toml), "error")


STEPS = PLAIN + "".join(
    f"[[polariscope.step]]\npolariser_deg = {a}\nanalyser_deg = {a - 90}\n" for a in (90, 112.5)
)


def test_a_stepped_set_needs_no_dark_and_bright_frames_but_no_load_steps_that_fit(tmp_path):
    assert texts(checked(tmp_path, [fringe(0), fringe(1)], STEPS), "warning") == ""
    toml = STEPS + '[frames]\nno_load_steps = "n.tif"\n'
    frames = [fringe(0), fringe(1)]
    assert "n.tif" in texts(checked(tmp_path, frames, toml), "error")
    write_tiff(tmp_path / "n.tif", np.stack(frames).astype(np.uint8))
    assert checked(tmp_path, frames, toml).ok
    write_tiff(tmp_path / "n.tif", frames[0][None].astype(np.uint8))
    assert "holds 1 frames" in texts(checked(tmp_path, frames, toml), "error")
    write_tiff(tmp_path / "n.tif", np.stack(frames)[:, :50].astype(np.uint8))
    assert "capture both with the same camera" in texts(checked(tmp_path, frames, toml), "error")


def test_what_is_just_beyond_a_threshold_is_reported_and_what_is_just_below_is_not(tmp_path):
    """One pixel of a hundred saturated, and a brightness that jumps by a fifth, are the limits."""
    for rows, words in ((1, False), (2, True)):  # of 60 rows, 40 of 80 columns: 0.8 %, 1.7 %
        frame = fringe()
        frame[:rows, :40] = 255
        said = texts(checked(tmp_path, [frame]), "warning")
        assert ("saturated in up to" in said) == words
    for level, words in ((0.76, False), (0.66, True)):  # 16 % and 27 % less than 0.9
        said = texts(checked(tmp_path, [fringe(0), fringe(1, level=level)]), "warning")
        assert ("the brightness jumps" in said) == words


def test_an_exposure_other_than_the_no_load_frames_is_reported_from_either_side(tmp_path):
    """15 % more light than no_load_bright, or 5 % of full scale less than no_load_dark."""
    toml = PLAIN + '[frames]\nno_load_bright = "b.tif"\nno_load_dark = "d.tif"\n'
    for bright, dark, said in (
        (0.85, 0.04, ()),
        (0.73, 0.04, ("no_load_bright only",)),
        (0.85, 0.2, ("no_load_dark begins at",)),
    ):
        write_tiff(tmp_path / "b.tif", fringe(9, level=bright)[None].astype(np.uint8))
        flat = np.full((1, ROWS, COLS), 255 * dark)
        write_tiff(tmp_path / "d.tif", flat.astype(np.uint8))
        found = texts(checked(tmp_path, [fringe()], toml), "warning")
        for words in ("no_load_bright only", "no_load_dark begins at"):
            assert (words in found) == (words in said)


@pytest.mark.parametrize(
    ("codec", "pixels", "lossy"), [("ffv1", "gray", False), ("mjpeg", "yuvj420p", True)]
)
def test_a_video_that_keeps_its_noise_is_not_said_to_lose_it(tmp_path, codec, pixels, lossy):
    """FFV1, which the guide recommends, was said to be compressed with loss."""
    path = written("v.mkv" if codec == "ffv1" else "v.avi", codec, pixels)(tmp_path)
    notes = texts(look_through(path, parse_scene(PLAIN)), "note")
    assert ("compressed with loss" in notes) == lossy
