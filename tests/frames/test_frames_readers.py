"""What every reader does besides the contract of all, and what hostile files meet."""

import pickle

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from recordings import COLS, COUNT, MOVING, ROWS, STILL, decoded, stack

from isochrome.errors import InputError
from isochrome.frames import open_frames
from isochrome.output import write_tiff
from isochrome.scene import Roi

RECORDINGS = STILL | MOVING
SOURCES = (
    "plain pages", "16 bit, big-endian", "deflate", "LZW", "ImageJ, one head", "folder of PNG",
    "folder of 16-bit RGB PNG", "folder of TIFF", "list of BMP", "glob of PNG",
    "OpenCV's MJPG in AVI", "FFV1 16 bit",
)  # fmt: skip
"""One of each way to read; test_frames_contract.py has all."""


@pytest.fixture(params=SOURCES)
def source(request, tmp_path):
    return RECORDINGS[request.param].write(tmp_path)


def write_tiff8(folder):
    write_tiff(folder / "s.tif", stack(), pixel_mm=0.01)
    return folder / "s.tif"


def test_roi_is_rows_and_columns_of_the_full_frame(source):
    roi = Roi(top_px=20, left_px=16, height_px=10, width_px=30)
    with open_frames(source) as whole, open_frames(source, roi=roi) as part:
        assert part.shape == (10, 30) and part.full_shape == (ROWS, COLS)
        for a, b in zip(whole, part, strict=True):
            np.testing.assert_array_equal(a.image[20:30, 16:46], b.image)
    with pytest.raises(InputError, match=r"lies outside .* correct frames\.roi"):
        open_frames(source, roi=Roi(top_px=90, left_px=0, height_px=10, width_px=30))


def test_reader_leaves_no_open_file_and_can_go_to_another_process(source):
    with open_frames(source) as reader:
        copy = pickle.loads(pickle.dumps(reader))
        next(iter(reader))
        assert copy.count() == COUNT
        running = iter(reader)
        next(running)
    with pytest.raises(StopIteration):  # the block's end closed it
        next(running)


def test_a_single_image_is_one_frame_and_a_tiffs_scale_is_read(tmp_path):
    Image.fromarray(stack()[5]).save(tmp_path / "x.png")
    with open_frames(tmp_path / "x.png") as reader:
        (frame,) = reader
        assert reader.kind == "image" and decoded(frame.image) == 5
    assert open_frames(write_tiff8(tmp_path)).pixel_mm == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize("suffix", ["png", "bmp", "tif", "ppm"])
def test_colour_is_rgb_and_the_channel_follows_the_wavelength(tmp_path, suffix):
    rgb = np.zeros((8, 10, 3), np.uint8) + np.array([10, 20, 60], np.uint8)
    path = tmp_path / f"c.{suffix}"
    if suffix == "tif":
        tifffile.imwrite(path, rgb, photometric="rgb")
    else:
        Image.fromarray(rgb).save(path)
    for options, name, value in (
        ({}, "green", 20),
        ({"wavelength_nm": 450}, "blue", 60),
        ({"wavelength_nm": 546}, "green", 20),
        ({"wavelength_nm": 632.8}, "red", 10),
        ({"channel": "blue", "wavelength_nm": 632.8}, "blue", 60),
        ({"channel": "mean"}, "mean", 30),
    ):
        reader = open_frames(path, **options)
        assert reader.channel == name
        assert {int(v) for f in reader for v in np.unique(f.image)} == {value}


def test_video_colour_is_rgb(tmp_path):
    video = cv2.VideoWriter(
        str(tmp_path / "c.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 20.0, (COLS, ROWS)
    )
    video.write(np.zeros((ROWS, COLS, 3), np.uint8) + np.array([200, 120, 40], np.uint8))  # BGR
    video.release()
    for channel, value in (("red", 40), ("green", 120), ("blue", 200)):
        (frame,) = open_frames(tmp_path / "c.avi", channel=channel)
        # JPEG's colour rounding: some grey levels; the channels lie 80 apart.
        assert abs(float(frame.image.mean()) - value) < 6


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P", "1"])
def test_transparency_is_dropped_and_palettes_become_values(tmp_path, mode):
    grey = Image.fromarray(np.where(stack()[3] > 120, 255, 0).astype(np.uint8))
    grey.convert(mode).save(tmp_path / "p.png")
    (frame,) = open_frames(tmp_path / "p.png")
    np.testing.assert_array_equal(frame.image, np.asarray(grey))


@pytest.mark.parametrize("bits", [8, 16])
def test_the_colours_of_a_palette_are_its_own(tmp_path, bits):
    """A TIFF's palette has 16 bits a colour: the upper eight are the grey level."""
    index = np.arange(12, dtype=f"u{bits // 8}").reshape(3, 4)
    colours = np.zeros((3, 2**bits), np.uint16)
    red, green, blue = np.arange(12) * 20, 200 - np.arange(12) * 10, np.arange(12) * 3 + 100
    colours[:, :12] = np.array([red, green, blue]) * 256 + 77
    tifffile.imwrite(tmp_path / "p.tif", index, photometric="palette", colormap=colours)
    for channel, levels in (("red", red), ("green", green), ("blue", blue)):
        (frame,) = open_frames(tmp_path / "p.tif", channel=channel)
        assert frame.image.dtype == np.uint8
        np.testing.assert_array_equal(frame.image, levels.reshape(3, 4))


def test_the_colours_that_imagej_shows_are_no_values(tmp_path):
    """Its lookup table is for the eye: the pixels' own values are the grey levels."""
    levels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    table = np.stack([np.arange(256)[::-1]] * 3).astype(np.uint8)
    tifffile.imwrite(tmp_path / "i.tif", levels, imagej=True, metadata={"LUTs": [table]})
    (frame,) = open_frames(tmp_path / "i.tif")
    np.testing.assert_array_equal(frame.image, levels)


def test_twelve_bits_in_a_pgm_are_not_stretched(tmp_path):
    values = np.array([[0, 1000, 4095]] * 4, ">u2")
    (tmp_path / "p.pgm").write_bytes(b"P5 3 4 4095\n" + values.tobytes())
    (frame,) = open_frames(tmp_path / "p.pgm", bit_depth=12)
    np.testing.assert_array_equal(frame.image, values)


def test_value_beyond_the_bit_depth_names_frame_value_and_key(tmp_path):
    data = np.zeros((3, 6, 8), np.uint16)
    data[1, 2, 3] = 1024
    write_tiff(tmp_path / "t.tif", data)
    with pytest.raises(InputError, match=r"frame 1 .*1024.*1023.*camera\.bit_depth"):
        list(open_frames(tmp_path / "t.tif", bit_depth=10))
    with pytest.raises(InputError, match=r"bit_depth = 12 does not fit"):
        open_frames(write_tiff8(tmp_path), bit_depth=12)


@pytest.mark.parametrize("suffix", ["png", "tif", "avi", "jpg", "bmp", "mp4", "pgm", "txt"])
@pytest.mark.parametrize("content", [b"", b"this is only text, whatever the name says\n" * 9])
def test_file_that_is_not_what_it_is_named_is_refused(tmp_path, capfd, suffix, content):
    path = tmp_path / f"x.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"x\.{suffix}: "):
        list(open_frames(path))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", [*SOURCES[:3], "ImageJ, one head", "folder of 16-bit RGB PNG"])
@pytest.mark.parametrize("part", [0.01, 0.3, 0.6, 0.99])
def test_truncated_file_is_refused_and_never_read_in_part(tmp_path, capfd, name, part):
    path = RECORDINGS[name].write(tmp_path)
    path = sorted(path.iterdir())[0] if path.is_dir() else path
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    with pytest.raises(InputError, match=path.name):
        assert len(list(open_frames(path))) == 0, "read in part"
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("how", [{"tile": (16, 16)}, {"compression": "zlib", "rowsperstrip": 4}])
def test_a_stack_cut_by_a_byte_is_said_to_be_truncated(tmp_path, how):
    """Its head is whole and its last frame is not: the user is told what happened to the file."""
    path = tmp_path / "t.tif"
    frames = np.random.default_rng(0).integers(1, 255, (3, 40, 60)).astype(np.uint8)
    tifffile.imwrite(path, frames, photometric="minisblack", metadata=None, **how)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InputError, match=r"frame 2 ends at byte \d+ .*truncated; copy it again"):
        list(open_frames(path))


def test_folder_without_images_list_without_names_and_missing_paths_are_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("x")
    for bad in (tmp_path, [], tmp_path / "none.tif", tmp_path / "*.png", [tmp_path / "a.png"]):
        with pytest.raises(InputError):
            open_frames(bad)


@pytest.mark.parametrize(
    ("dtype", "photometric", "words"),
    [
        *((dtype, None, "are not read; save them as") for dtype in ("i2", "u4", "c8")),
        ("u1", "miniswhite", "MINISWHITE"),  # rather than read inverted
    ],
)
def test_pixels_that_no_camera_writes_are_refused(tmp_path, dtype, photometric, words):
    tifffile.imwrite(tmp_path / "d.tif", np.zeros((6, 8), dtype), photometric=photometric)
    with pytest.raises(InputError, match=words):
        open_frames(tmp_path / "d.tif")


def test_damaged_deep_png_is_refused_and_not_decoded_in_part(tmp_path):
    path = STILL["folder of 16-bit RGB PNG"].write(tmp_path) / "frame0.png"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"frame0\.png"):
        open_frames(tmp_path)
