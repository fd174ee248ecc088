"""Where the specimen is: mask images, ImageJ areas and polygons, and what follows of it."""

import struct
import zipfile

import numpy as np
import pytest
import tifffile
from PIL import Image

from isochrome.calibration import load_set, read_shots
from isochrome.errors import InputError
from isochrome.estimation import prepare_frame
from isochrome.frames import load_mask, load_no_load, look_through, open_scene_frames, to_linear
from isochrome.output import write_tiff
from isochrome.scene import parse_scene

ROWS, COLS = 60, 80
FULL, PART = (ROWS, COLS), (30, 40)
ROW, COL = np.mgrid[:ROWS, :COLS]
ROI = "roi = { top_px = 10, left_px = 20, height_px = 30, width_px = 40 }\n"
CUT = np.s_[10:40, 20:60]
DISC = np.hypot(ROW - 25, COL - 40) < 12.3


def scene_of(folder, *lines, roi=ROI):
    return parse_scene("[specimen]\n[frames]\n" + roi + "\n".join(lines), folder=folder)


def save(path, values):
    Image.fromarray(np.asarray(values, dtype=np.uint8)).save(path)


def test_no_mask_keeps_every_pixel(tmp_path):
    assert load_mask(scene_of(tmp_path), PART, FULL).all()


@pytest.mark.parametrize("name", ["m.png", "m.tif", "m.bmp"])
@pytest.mark.parametrize("cut", [np.s_[:, :], CUT], ids=["full frame", "region"])
def test_mask_image_is_taken_at_either_size(tmp_path, name, cut):
    save(tmp_path / name, 255 * DISC[cut])
    found = load_mask(scene_of(tmp_path, f'mask = "{name}"'), PART, FULL)
    np.testing.assert_array_equal(found, DISC[CUT])


def test_a_mask_image_counts_what_is_stored_and_not_zero(tmp_path):
    colour = np.zeros((*FULL, 3))
    colour[DISC, 2] = 7
    save(tmp_path / "c.png", colour)
    labels = np.where(DISC, 1 + (COL > 40), 0)
    labels[25, 40] = 128
    save(tmp_path / "l.png", labels)
    for name in ("c.png", "l.png"):
        found = load_mask(scene_of(tmp_path, f'mask = "{name}"'), PART, FULL)
        np.testing.assert_array_equal(found, DISC[CUT])
    tifffile.imwrite(
        tmp_path / "m.tif", (255 * DISC).astype(np.uint8), imagej=True, photometric="miniswhite"
    )
    with tifffile.TiffFile(tmp_path / "m.tif") as file:
        assert file.is_imagej and file.pages[0].photometric == 0  # or the test says nothing
    found = load_mask(scene_of(tmp_path, 'mask = "m.tif"'), PART, FULL)
    np.testing.assert_array_equal(found, DISC[CUT])


def test_polygons_and_masks_hold_the_pixels_whose_centres_lie_in_both(tmp_path):
    corners = [[4.5, 7.5], [4.5, 30.5], [20.5, 30.5], [20.5, 7.5]]
    found = load_mask(scene_of(tmp_path, f"polygon_px = {corners}"), PART, FULL)
    wanted = np.zeros(PART, bool)
    wanted[5:21, 8:31] = True
    np.testing.assert_array_equal(found, wanted)
    turned = [[-20, 20], [15, -15], [50, 20], [15, 55]]  # may leave the frame
    found = load_mask(scene_of(tmp_path, f"polygon_px = {turned}", roi=""), FULL, FULL)
    np.testing.assert_array_equal(found, np.abs(ROW - 15) + np.abs(COL - 20) <= 35)
    save(tmp_path / "m.png", DISC)
    half = "polygon_px = [[-1, -1], [-1, 19.5], [30, 19.5], [30, -1]]"
    found = load_mask(scene_of(tmp_path, 'mask = "m.png"', half), PART, FULL)
    np.testing.assert_array_equal(found, (DISC & (COL < 20 + 19.5))[CUT])
    away = "polygon_px = [[0, 0], [0, 5], [5, 0]]"
    with pytest.raises(InputError, match="no pixel in common"):
        load_mask(scene_of(tmp_path, 'mask = "m.png"', away), PART, FULL)


def test_a_closed_free_boundary_is_the_specimens_outline_and_an_open_one_is_not(tmp_path):
    outline = (
        "free_boundary = [{ row_px = [4.5, 4.5, 20.5, 20.5%s], col_px = [2.5, 9.5, 9.5, 2.5%s] }]"
    )
    inside = np.zeros(PART, dtype=bool)
    inside[5:21, 3:10] = True
    found = load_mask(scene_of(tmp_path, outline % (", 4.5", ", 2.5")), PART, FULL)
    np.testing.assert_array_equal(found, inside)
    assert load_mask(scene_of(tmp_path, outline % ("", "")), PART, FULL).all()
    beyond = outline.replace("20.5", "80.5") % (", 4.5", ", 2.5")
    crossed = "free_boundary = [{ row_px = [0, 9, 0, 9, 0], col_px = [0, 9, 9, 0, 0] }]"
    with pytest.raises(InputError, match=r"frames\.free_boundary\[1\]: the sides after corners"):
        load_mask(scene_of(tmp_path, crossed), PART, FULL)
    assert load_mask(scene_of(tmp_path, beyond), PART, FULL)[29, 5]


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ("[[0, 0], [20, 20], [0, 20], [20, 0]]", r"after corners 1 and 3 cross"),
        ("[[0, 0], [10, 10], [20, 20]]", "one line"),
        ("[[0, 0], [0, 29], [39, 29], [39, 0]]", "swapped"),
        ("[[40, 70], [40, 90], [90, 70]]", r"no pixel of the region .* \(30, 40\)"),
    ],
)
def test_polygon_that_cannot_be_meant_is_refused(tmp_path, corners, words):
    with pytest.raises(InputError, match=words):
        load_mask(scene_of(tmp_path, f"polygon_px = {corners}"), PART, FULL)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("polygon_px = [[0, 0], [1, 1]]", r"frames\.polygon_px.*3"),
        ("polygon_px = [[0, 0], [1, nan], [2, 3]]", r"polygon_px\[2\]\[2\]"),
        ("polygon_px = [[0, 0], [1, 1, 1], [2, 3]]", r"polygon_px\[2\]"),
        ('mask = ""', r"frames\.mask"),
    ],
)
def test_scene_refuses_keys_that_say_nothing(tmp_path, line, words):
    with pytest.raises(InputError, match=words):
        scene_of(tmp_path, line)


def test_mask_images_that_cannot_be_meant_are_refused_by_name(tmp_path):
    def refused(name, words):
        with pytest.raises(InputError, match=words):
            load_mask(scene_of(tmp_path, f'mask = "{name}"'), PART, FULL)

    refused("absent.png", r"absent\.png.*no such file")
    save(tmp_path / "odd.png", DISC[:50])
    refused("odd.png", r"odd\.png.*\(50, 80\).*\(60, 80\).*\(30, 40\)")
    save(tmp_path / "empty.png", np.zeros(FULL))
    refused("empty.png", "leaves no pixel")
    save(tmp_path / "away.png", ROW > 50)
    refused("away.png", "leaves no pixel of the region")
    save(tmp_path / "all.png", np.ones(FULL))
    refused("all.png", "masks nothing")
    save(tmp_path / "picture.png", (ROW * COL) % 200)
    refused("picture.png", "picture")
    save(tmp_path / "lossy.jpg", 255 * DISC)
    refused("lossy.jpg", "PNG or TIFF")
    save(tmp_path / "two.tif", 255 * DISC)
    write_tiff(tmp_path / "two.tif", np.zeros((2, *FULL), np.uint8))
    refused("two.tif", "2 pages")


def write_roi(path, *areas):
    roifile = pytest.importorskip("roifile")
    rois = []
    for kind, values in areas:
        if kind == "FREEHAND":
            roi = roifile.ImagejRoi.frompoints(np.array(values))
        else:
            roi = roifile.ImagejRoi()
            roi.roitype = roifile.ROI_TYPE[kind]
            roi.left, roi.top, roi.right, roi.bottom = values
        rois.append(roi)
    if path.suffix == ".roi":
        rois[0].tofile(path)
    else:
        roifile.roiwrite(path, rois, name=[f"{i}.roi" for i in range(len(rois))], mode="w")


def test_imagej_areas_are_counted_from_the_corners_of_the_full_frames_pixels(tmp_path):
    write_roi(tmp_path / "r.roi", ("RECT", (25, 12, 45, 30)))
    found = load_mask(scene_of(tmp_path, 'mask = "r.roi"'), PART, FULL)
    wanted = (COL >= 25) & (COL < 45) & (ROW >= 12) & (ROW < 30)
    np.testing.assert_array_equal(found, wanted[CUT])
    oval = ("OVAL", (20, 10, 40, 30))
    triangle = ("FREEHAND", [[45, 12], [57, 12], [45, 24]])
    write_roi(tmp_path / "r.zip", oval, triangle)
    found = load_mask(scene_of(tmp_path, 'mask = "r.zip"'), PART, FULL)
    x, y = COL + 0.5, ROW + 0.5
    wanted = np.hypot(x - 30, y - 20) <= 10
    wanted |= (x >= 45) & (y >= 12) & (x - 45 + y - 12 <= 12)
    np.testing.assert_array_equal(found, wanted[CUT])


def test_imagej_composite_area_has_holes(tmp_path):
    """Bytes by hand: a composite is a path of moves (0), lines (1) and closes (4) in floats."""
    pytest.importorskip("roifile")

    def square(low, high):
        return [0, low, low, 1, high, low, 1, high, high, 1, low, high, 4]

    path = square(22, 38) + square(27, 33)
    head = bytearray(64)
    head[:4], head[4:6], head[6] = b"Iout", struct.pack(">h", 227), 1
    head[8:16] = struct.pack(">hhhh", 22, 22, 38, 38)
    head[36:40] = struct.pack(">i", len(path))
    data = bytes(head) + struct.pack(f">{len(path)}f", *path)
    with zipfile.ZipFile(tmp_path / "h.zip", "w") as file:
        file.writestr("h.roi", data)
    found = load_mask(scene_of(tmp_path, 'mask = "h.zip"'), PART, FULL)
    nearer = np.maximum(np.abs(ROW + 0.5 - 30), np.abs(COL + 0.5 - 30))
    np.testing.assert_array_equal(found, ((nearer < 8) & (nearer > 3))[CUT])


def test_imagej_files_without_an_area_are_refused(tmp_path):
    write_roi(tmp_path / "line.roi", ("LINE", (25, 12, 45, 30)))
    (tmp_path / "bad.roi").write_bytes(b"Iout" + bytes(10))
    write_roi(tmp_path / "none.zip")
    write_roi(tmp_path / "away.roi", ("RECT", (0, 0, 15, 9)))
    cases = {"line.roi": "line, which", "bad.roi": "not a readable", "none.zip": "holds no ROI"}
    for name, words in (cases | {"away.roi": "full frame", "absent.zip": "no such file"}).items():
        with pytest.raises(InputError, match=words):
            load_mask(scene_of(tmp_path, f'mask = "{name}"'), PART, FULL)


def fringes(seed=0):
    light = 0.5 - 0.35 * np.cos(2 * np.pi * 0.06 * COL)
    noise = 3 * np.random.default_rng(seed).standard_normal(FULL)
    return np.clip(np.rint(255 * light + noise), 0, 255).astype(np.uint8)


def test_frames_carry_the_mask_to_every_reading(tmp_path):
    write_tiff(tmp_path / "f.tif", np.stack([fringes(0), fringes(1)]))
    write_tiff(tmp_path / "dark.tif", np.full((1, *FULL), 9, np.uint8))
    save(tmp_path / "m.png", DISC)
    scene = scene_of(tmp_path, 'mask = "m.png"', 'no_load_dark = "dark.tif"')
    with open_scene_frames(tmp_path / "f.tif", scene) as reader:
        frames = list(reader)
    assert len(frames) == 2
    for frame in frames:
        light = to_linear(frame.image, bit_depth=8, mask=frame.mask)
        np.testing.assert_array_equal(light.valid, DISC[CUT])
        data = prepare_frame(frame, scene, bit_depth=8)
        np.testing.assert_array_equal(data.valid, DISC[CUT])
        # what the camera saw elsewhere stays: a mask must make no edge in the light
        np.testing.assert_allclose(data.light, frame.image / 255, rtol=1e-6)
    assert load_no_load(scene, full_shape=FULL)[0].valid.all()
    with open_scene_frames(tmp_path / "f.tif", scene_of(tmp_path)) as reader:
        assert next(iter(reader)).mask is None
    with pytest.raises(InputError, match=r"\(30, 40\).*mask \(60, 80\)"):
        to_linear(frames[0].image, bit_depth=8, mask=DISC)


def test_calibration_images_are_masked_too(tmp_path):
    write_tiff(tmp_path / "f.tif", fringes()[None])
    save(tmp_path / "m.png", DISC)
    (tmp_path / "set.toml").write_text(
        "[disc]\ndiameter_mm = 30\nthickness_mm = 6\n[camera]\nbit_depth = 8\n"
        f'[frames]\nmask = "m.png"\n{ROI}[[image]]\nfile = "f.tif"\nload_n = 100\n',
        encoding="utf-8",
    )
    (shot,) = read_shots(load_set(tmp_path / "set.toml"))
    np.testing.assert_array_equal(shot.valid, DISC[CUT])


def test_check_judges_the_specimen_and_says_how_much_of_the_frame_it_is(tmp_path):
    frame = fringes()
    frame[~DISC] = 255  # a lamp beside the specimen
    write_tiff(tmp_path / "f.tif", frame[None])
    save(tmp_path / "m.png", DISC)
    checked = look_through(tmp_path / "f.tif", scene_of(tmp_path, 'mask = "m.png"'))
    text = " | ".join(f.text for f in checked.findings)
    assert f"{100 * DISC[CUT].mean():.1f} % of the pixels" in text and "saturated" not in text
    plain = look_through(tmp_path / "f.tif", scene_of(tmp_path))
    assert any("saturated" in f.text for f in plain.findings)
    wrong = look_through(tmp_path / "f.tif", scene_of(tmp_path, 'mask = "gone.png"'))
    assert not wrong.ok and "gone.png" in wrong.findings[0].text
