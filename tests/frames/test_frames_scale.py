"""The pixel's size and the frames' times: the file's and the scene's must agree."""

import numpy as np
import pytest
import tifffile

from isochrome.errors import InputError
from isochrome.fitting import PreparedFrames
from isochrome.frames import look_through, open_frames, open_scene_frames, with_file_scale
from isochrome.output import write_tiff
from isochrome.processing import process
from isochrome.scene import check_pixel, load_scene, parse_scene

FRAMES = np.random.default_rng(1).integers(20, 200, (2, 40, 60)).astype(np.uint8)
BARE = '[specimen]\nshape = "other"\n[camera]\nbit_depth = 8\n'


def stack(tmp_path, pixel_mm=0.01, name="s.tif"):
    write_tiff(tmp_path / name, FRAMES, pixel_mm=pixel_mm)
    return tmp_path / name


@pytest.mark.parametrize("ours", [0.0101, 0.0099, 10.0])
def test_another_pixel_size_in_the_scene_is_refused_with_both_named(tmp_path, ours):
    path, scene = stack(tmp_path), parse_scene(BARE + f"pixel_mm = {ours}\n")
    with pytest.raises(InputError, match=rf"s\.tif: names 0\.01 mm .*camera\.pixel_mm is {ours:g}"):
        open_scene_frames(path, scene)
    with pytest.raises(InputError, match=r"camera\.pixel_mm"):
        process(path, scene, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
    found = look_through(path, scene)
    assert not found.ok and found.count == 2  # the rest is looked at all the same
    assert any("names 0.01 mm" in f.text for f in found.findings if f.level == "error")


def test_a_size_rounded_to_three_digits_is_the_same_size(tmp_path):
    """The scene's own stands, and so do all results that are counted by it."""
    scene = parse_scene(BARE + "pixel_mm = 0.00607\n")
    path = stack(tmp_path, 0.0060674)
    reader = open_scene_frames(path, scene)
    assert reader.pixel_mm == pytest.approx(0.0060674, rel=1e-5)
    assert with_file_scale(scene, reader).camera.pixel_mm == 0.00607
    with pytest.raises(InputError, match="names 0"):  # half a per cent is the limit
        open_scene_frames(stack(tmp_path, 0.0061007, "far.tif"), scene)


def test_a_no_load_frame_of_another_scale_is_refused(tmp_path):
    stack(tmp_path, 0.02, "dark.tif")
    text = BARE + 'pixel_mm = 0.01\n[frames]\nno_load_dark = "dark.tif"\n'
    with pytest.raises(InputError, match=r"dark\.tif: names 0\.02 mm"):
        process(stack(tmp_path), parse_scene(text, folder=tmp_path))


def test_a_missing_size_is_taken_from_the_file_but_for_a_disc(tmp_path):
    path = stack(tmp_path)
    reader = open_frames(path)
    for text in (BARE, '[specimen]\nshape = "other"\n'):
        taken = with_file_scale(parse_scene(text), reader)
        assert taken.camera.pixel_mm == pytest.approx(0.01, rel=1e-6)
    own = parse_scene(BARE + "pixel_mm = 0.01004\n")
    assert with_file_scale(own, reader) is own
    disc = load_scene("line-contact-wear")
    assert with_file_scale(disc, open_frames(stack(tmp_path, None))) is disc
    rim = parse_scene(
        '[specimen]\nshape = "disc"\ndiameter_mm = 30\nthickness_mm = 5\n'
        "fringe_value_n_per_mm = 10\n[load]\nnormal_n = 100\n"
    )
    assert with_file_scale(rim, reader) is rim


@pytest.mark.long
def test_fit_and_process_work_with_the_files_size(tmp_path):
    text = (
        "[specimen]\nyoung_gpa = 2.1\npoisson = 0.4\nthickness_mm = 4\nfringe_value_n_per_mm = 15\n"
        "[indenter]\nradius_mm = 25\nyoung_gpa = 210\npoisson = 0.3\n[load]\nnormal_n = 40\n"
        "[camera]\nbit_depth = 8\nleft_mm = -0.3\ntop_mm = 0\n"
    )
    data = PreparedFrames(stack(tmp_path), parse_scene(text))
    assert data.scene.camera.pixel_mm == pytest.approx(0.01, rel=1e-6)
    names = {"dark": 5, "bright": 220}
    for name, level in names.items():
        write_tiff(tmp_path / f"{name}.tif", np.full_like(FRAMES[:1], level), pixel_mm=0.01)
    keys = "".join(f"no_load_{name} = '{tmp_path / name}.tif'\n" for name in names)
    found = process(stack(tmp_path), parse_scene(BARE + "[frames]\n" + keys))
    assert set(found.columns["pixel_mm"]) == {data.scene.camera.pixel_mm}


@pytest.mark.parametrize(
    ("how", "names"),
    [
        ({"imagej": True, "resolution": (100, 50), "metadata": {"axes": "TYX", "unit": "mm"}},
         "square pixels"),
        ({"ome": True, "metadata": {"axes": "TYX", "PhysicalSizeX": 6, "PhysicalSizeY": 7}},
         "square pixels"),
        ({"ome": True, "metadata": {"axes": "CYX"}}, "colour channels"),
        ({"imagej": True, "metadata": {"axes": "CYX"}}, "colour channels"),
    ],
)  # fmt: skip
def test_files_that_are_no_frames_of_square_pixels_are_refused(tmp_path, how, names):
    tifffile.imwrite(tmp_path / "s.tif", FRAMES, **how)
    with pytest.raises(InputError, match=names):
        open_frames(tmp_path / "s.tif")


@pytest.mark.parametrize("way", ["imagej", "ome"])
def test_slices_at_several_times_are_refused(tmp_path, way):
    data = np.stack([FRAMES] * 3)
    tifffile.imwrite(tmp_path / "s.tif", data, metadata={"axes": "TZYX"}, **{way: True})
    with pytest.raises(InputError, match="2 slices at each of 3 times"):
        open_frames(tmp_path / "s.tif")


def test_several_series_or_slices_are_refused(tmp_path):
    with tifffile.TiffWriter(tmp_path / "s.ome.tif", ome=True) as tif:
        tif.write(FRAMES, metadata={"axes": "TYX"})
        tif.write(FRAMES, metadata={"axes": "TYX"})
    with pytest.raises(InputError, match="2 image series"):
        open_frames(tmp_path / "s.ome.tif")


@pytest.mark.parametrize("given", [True, False], ids=["of its frames", "of the camera"])
@pytest.mark.parametrize(("pixel", "newtons", "allowed"), [
    (0.22, 44.0, True),  # 145 mm, 194 contacts of 0.747 mm
    (0.24, 44.0, False),
    (0.09, 0.1, True),  # a light touch in a lens's wide view: 1700 contacts
])  # fmt: skip
def test_a_picture_is_no_wider_than_200_contacts(given, pixel, newtons, allowed):
    values = {"camera.pixel_mm": pixel, "load.normal_n": newtons}
    scene = load_scene("line-contact-wear").with_values(values)
    shape = (494, 659) if given else None
    if allowed:
        check_pixel(scene, shape)
        return
    with pytest.raises(InputError, match=r"pixel_mm = 0\.24 makes the picture 158 mm.*not in µm"):
        check_pixel(scene, shape)
