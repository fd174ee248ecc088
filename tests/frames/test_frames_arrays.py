"""Frames from arrays: read as a file of the same pixels; what is no frames is refused in a line."""

import pickle
from collections import UserList
from functools import partial

import numpy as np
import pandas as pd
import pytest
import tifffile
import xarray as xr

from isochrome import load_scene, open_frames
from isochrome.errors import InputError
from isochrome.frames import load_mask, load_no_load
from isochrome.scene import ArrayFrames, Roi, frames_of
from refusals import refusal

RNG = np.random.default_rng(3)
GREY = RNG.integers(0, 4096, (3, 20, 24)).astype(np.uint16)
COLOUR = RNG.integers(0, 256, (3, 20, 24, 3)).astype(np.uint8)


class Lazy:
    """Frames made when they are asked for, as a reader of PIMS gives them."""

    def __init__(self, count, make=lambda index: GREY[index % 3]):
        self.count, self.make, self.asked = count, make, []

    def __len__(self):
        return self.count

    def __getitem__(self, index):
        self.asked.append(index)
        return self.make(index)


def images(given, **options):
    with open_frames(given, **options) as reader:
        return [frame.image for frame in reader]


def axes(values, dims=("frame", "row", "col"), **coords):
    return xr.DataArray(values, dims=dims, coords=coords)


GIVEN = {
    "array": GREY, "other byte order": GREY.astype(">u2"),
    "not in one piece": np.asfortranarray(GREY), "list": list(GREY), "tuple": tuple(GREY),
    "own list": UserList(GREY), "lazy": Lazy(3), "read only": np.broadcast_to(GREY, GREY.shape),
    "xarray": axes(GREY), "list of xarray": list(axes(GREY)),
}  # fmt: skip


@pytest.mark.parametrize("name", GIVEN)
@pytest.mark.parametrize(
    "options",
    [
        {"bit_depth": 12},
        {"roi": Roi(top_px=2, left_px=3, height_px=10, width_px=12)},
        {"rotate_deg": 90, "flip": "vertical"},
    ],
    ids=["whole", "roi", "turned"],
)
def test_an_array_is_read_as_the_file_of_its_pixels(tmp_path, name, options):
    tifffile.imwrite(tmp_path / "stack.tif", GREY, photometric="minisblack")
    wanted = images(tmp_path / "stack.tif", **options)
    found = images(GIVEN[name], **options)
    assert [image.dtype for image in found] == [np.uint16] * 3 and np.array_equal(found, wanted)


def test_a_dask_array_is_computed_frame_by_frame():
    dask = pytest.importorskip("dask.array")
    lazy = dask.from_array(GREY, chunks=(1, 20, 24))
    assert np.array_equal(images(lazy), GREY) and np.array_equal(images(axes(lazy)), GREY)
    with open_frames(lazy) as reader:
        assert next(frame.image for frame in reader.iterate(2, 3)).tolist() == GREY[2].tolist()


@pytest.mark.parametrize("channel", ["red", "blue", "mean", None])
def test_colours_of_an_array_are_red_green_and_blue(tmp_path, channel):
    tifffile.imwrite(tmp_path / "stack.tif", COLOUR, photometric="rgb")
    options = {"channel": channel, "wavelength_nm": 600.0}
    wanted = images(tmp_path / "stack.tif", **options)
    assert np.array_equal(images(COLOUR, **options), wanted)
    assert np.array_equal(images(COLOUR[0], **options), wanted[:1])  # one frame in colour
    assert np.array_equal(images(list(COLOUR), **options), wanted)


def test_a_frame_is_a_copy():
    with open_frames(GREY[0]) as reader:
        assert reader.count() == 1 and reader.kind == "array" and reader.shape == (20, 24)
        assert reader.dtype == np.uint16 and reader.bit_depth == 16
        assert np.array_equal(next(iter(reader)).image, GREY[0])
    # what is done with a frame is not done to the caller's array
    mine = GREY.copy()
    for image in images(mine):
        image[:] = 0
    assert np.array_equal(mine, GREY)


def test_only_what_is_asked_for_is_made():
    lazy = Lazy(900_000)
    with open_frames(lazy) as reader:
        assert reader.count() == 900_000
        frames = reader.iterate(800_000)
        assert next(frames).index == 800_000
    assert set(lazy.asked) == {0, 800_000}


def test_times_and_scale_are_those_of_the_coordinates():
    x, z = 0.01 * np.arange(24) - 0.3, 0.01 * np.arange(20)
    given = axes(GREY, ("frame", "z_mm", "x_mm"), time_s=("frame", [5.0, 5.5, 6.5]), x_mm=x, z_mm=z)
    with open_frames(given) as reader:
        assert [frame.time_s for frame in reader] == [0.0, 0.5, 1.5]
        assert reader.pixel_mm == pytest.approx(0.01)
    with open_frames(GREY) as reader:
        assert {frame.time_s for frame in reader} == {None} and reader.pixel_mm is None
    from isochrome.frames import open_scene_frames

    x, z = 0.02 * np.arange(24), 0.02 * np.arange(20)
    given = axes(GREY, ("frame", "z_mm", "x_mm"), x_mm=x, z_mm=z)
    scene = load_scene({"specimen": {}, "camera": {"pixel_mm": 0.01}})
    with pytest.raises(InputError, match=r"names 0\.02 mm a pixel, and camera\.pixel_mm is 0\.01"):
        open_scene_frames(given, scene)


NAN = np.full((2, 20, 24), np.nan)


def masked():
    return np.ma.masked_less(GREY, 9)


HOSTILE = {
    "one axis": (np.zeros(5), "shape"),
    "no axis": (np.float64(3.0), "0 frames"),
    "five axes": (np.zeros((1, 1, 2, 4, 3)), "shape"),
    "four channels": (np.zeros((2, 4, 5, 4), np.uint8), "transparency"),
    "one channel": (np.zeros((2, 4, 5, 1), np.uint8), "shape"),
    "bool": (np.zeros((2, 4, 5), bool), "pixels of type bool"),
    "objects": (np.zeros((2, 4, 5), object), "pixels of type object"),
    "texts": (np.zeros((2, 4, 5), "U3"), "pixels of type str"),
    "complex": (np.zeros((2, 4, 5), complex), "pixels of type complex128"),
    "signed": (np.zeros((2, 4, 5), np.int64), "pixels of type int64"),
    "dates": (np.zeros((2, 4, 5), "M8[s]"), "pixels of type datetime64"),
    "no frame": (np.zeros((0, 4, 5), np.uint8), "0 frames"),
    "no row": (np.zeros((2, 0, 5), np.uint8), "0 x 5"),
    "no column": (np.zeros((4, 0), np.uint8), "4 x 0"),
    "empty list": ([], "empty"),
    "empty lazy": (Lazy(0), "0 frames"),
    "a thousand million frames": (Lazy(10**9), "1000000000 frames"),
    "a thousand million times one": (np.broadcast_to(GREY[0], (10**9, 20, 24)), "1000000000"),
    "a huge frame": (np.broadcast_to(np.uint8(1), (10**6, 10**6)), "1000000 x 1000000"),
    "sizes mixed": ([GREY[0], GREY[1, 2:]], "frame 1 has the shape"),
    "axes mixed": ([GREY[0], COLOUR[0]], "frame 1 has the shape"),
    "files and arrays": (["a.tif", GREY[0]], "mixed"),
    "numbers": ([1, 2, 3], "shape"),
    "ragged": ([[[1, 2], [3]]], "cannot be read"),
    "a table": (pd.DataFrame({"a": [1, 2]}), "cannot be read"),
    "a dictionary": ({"a": GREY}, "no frames in order"),
    "a set": ({1, 2}, "no frames in order"),
    "bytes": (b"abc", "no frames in order"),
    "a number": (7, "neither a file's name nor an array"),
    "nothing": (None, "neither a file's name nor an array"),
    "a dataset": (xr.Dataset({"a": axes(GREY)}), "no frames in order"),
    "a generator": ((g for g in GREY), "gone through once"),
    "masked": (masked(), "masked array"),
    "masked frames": (list(masked()), "masked array"),
    "turned axes": (axes(GREY, ("row", "col", "frame")), "transpose"),
    "swapped axes": (axes(GREY, ("frame", "x", "y")), "transpose"),
    "upside down": (
        axes(GREY, ("frame", "z_mm", "x_mm"), z_mm=-0.1 * np.arange(20)), "does not rise"
    ),
    "oblong pixels": (
        axes(GREY, ("frame", "z_mm", "x_mm"), z_mm=1.0 * np.arange(20), x_mm=2.0 * np.arange(24)),
        "x_mm does not rise",
    ),
    "times that are none": (
        axes(GREY, time_s=("frame", [0.0, np.nan, 1.0])), "time_s holds what is no number"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_no_frames_is_refused_in_one_line_before_any_is_read(name):
    given, words = HOSTILE[name]
    text = refusal(open_frames, given)
    assert words in text and len(text) < 400


def raises(index):
    if index:
        raise RuntimeError("the network\nis gone")
    return GREY[0]


BAD_LATER = {
    "negative": (-np.ones((2, 20, 24)), "light is 0 or more"),
    "negative levels": (np.full((2, 20, 24), -900.0), "light is 0 or more"),
    "too bright": (2 * np.ones((2, 20, 24)), "array[0]: holds 2"),
    "size changes": (Lazy(3, lambda i: GREY[i, i:]), "frame 1 is 19 x 24 pixels"),
    "type changes": (Lazy(3, lambda i: GREY[i].astype(["u2", "u1", "u1"][i])), "save all frames"),
    "axes change": (Lazy(3, lambda i: GREY[: i + 1] if i else GREY[0]), "frame 1"),
    "fails": (Lazy(3, raises), "frame 1 cannot be read (RuntimeError: the network)"),
}


@pytest.mark.parametrize("name", BAD_LATER)
def test_a_bad_frame_is_refused_in_one_line_by_its_number(name):
    from isochrome.frames import to_linear

    given, words = BAD_LATER[name]
    reader = open_frames(given)
    light = map(partial(to_linear, bit_depth=reader.bit_depth, allow_blank=True), reader)
    assert words in refusal(list, light)


def test_noise_about_zero_is_light_and_nan_is_not_known():
    from isochrome.frames import to_linear

    with pytest.raises(InputError, match="NaN only"):
        to_linear(next(iter(open_frames(NAN))), bit_depth=None)
    some = np.linspace(0, 1, 480).reshape(20, 24)
    some[3, 4] = np.nan
    found = to_linear(next(iter(open_frames(some))), bit_depth=None)
    assert not found.valid[3, 4] and found.valid.sum() > 400
    # A float camera's dark frames go below zero by their noise
    dark = RNG.normal(0.0, 0.02, (2, 20, 24)).astype(np.float32)
    assert np.array_equal(images(dark), dark)


def test_files_stay_files_and_arrays_go_to_other_processes():
    assert frames_of("a.tif") == "a.tif" and frames_of(["a.tif", "b.tif"]) == ("a.tif", "b.tif")
    assert frames_of(iter(["a.tif"])) == ("a.tif",) and isinstance(frames_of(GREY), ArrayFrames)
    again = pickle.loads(pickle.dumps(open_frames(GREY)))
    assert np.array_equal([frame.image for frame in again], GREY)


def test_the_digest_is_that_of_the_pixels_wherever_they_come_from():
    one, other = GREY.copy(), GREY.copy()
    other[2, 3, 4] ^= 1
    own = ArrayFrames(one).digest()
    for name, given in GIVEN.items():
        assert ArrayFrames(given).digest() == own, name
    assert own not in (ArrayFrames(other).digest(), ArrayFrames(GREY[:2]).digest())
    assert ArrayFrames(GREY.view(np.float16)).digest() != own
    timed = axes(GREY, time_s=("frame", [0.0, 1.0, 3.0]))
    assert ArrayFrames(timed).digest() != own


def test_a_scene_of_dictionaries_takes_numpy_and_arrays():
    table = {"distance_m": np.array([0, 10]), "value": np.array([0.1, 0.2])}
    scene = load_scene(
        {
            "specimen": {
                "young_gpa": np.float32(2.0), "poisson": 0.4, "thickness_mm": np.int64(4),
                "fringe_value_n_per_mm": {"value": 14.6, "standard_uncertainty": 0.1},
            },
            "indenter": {"radius_mm": 24.0, "young_gpa": 210.0, "poisson": 0.3},
            "load": {"normal_n": np.float64(44.0)},
            "friction": {"coefficient": table},
            "wear": {"coefficient_mm2_per_n": 1e-9, "distances_m": np.linspace(0, 30, 4)},
            "frames": {"polygon_px": np.array([[0, 0], [0, 9], [9, 9]])},
            "camera": {"width_px": np.int32(24), "height_px": 20, "pixel_mm": 0.01},
        }
    )  # fmt: skip
    assert scene.model == "contact" and scene.wear.distances_m == (0.0, 10.0, 20.0, 30.0)
    assert scene.uncertainties == {"specimen.fringe_value_n_per_mm": 0.1}
    assert scene.camera.width_px == 24 and scene.frames.polygon_px[2] == (9.0, 9.0)
    assert scene.friction_at(5.0) == pytest.approx(0.15)
    changed = scene.with_values({"load.normal_n": xr.DataArray(np.float32(50.0))})
    assert changed.load_at(0.0) == 50.0


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"specimen": {"thickness_mm": np.array([1.0, 2.0])}},
         "specimen.thickness_mm = [1.0, 2.0]"),
        ({"specimen": {"thickness_mm": np.True_}}, "should not be true or false"),
        ({"specimen": {}, "frames": {"mask": np.zeros(3)}}, "frames.mask"),
        ({"specimen": {}, "frames": {"mask": 3}}, "frames.mask = 3 is not allowed"),
        ({"specimen": {}, "frames": {"no_load_dark": np.zeros((2, 2, 2, 2))}}, "no_load_dark"),
        ({"specimen": {}, "frames": {"no_load_dark": []}}, "no_load_dark"),
        ({"specimen": {}, "load": GREY}, "load = "),
        ({"specimens": {}}, "did you mean 'specimen'"),
        ({"specimen": {}, "name": "mine"}, "unknown key 'name'"),
        ({"specimen": {"thickness_mm": 1e300}}, "thickness_mm"),
        ({}, "'specimen' is missing"),
    ],
)  # fmt: skip
def test_a_wrong_dictionary_is_refused_by_its_key_in_one_line(tables, words):
    text = refusal(load_scene, tables)
    assert words in text and len(text) < 400


def scene_of(**frames):
    return load_scene({"specimen": {}, "camera": {"bit_depth": 12}, "frames": frames})


def test_no_load_frames_and_mask_are_arrays_as_well(tmp_path):
    inside = np.zeros((20, 24), bool)
    inside[4:, 5:] = True
    tifffile.imwrite(tmp_path / "dark.tif", GREY, photometric="minisblack")
    tifffile.imwrite(tmp_path / "bright.tif", GREY[0])
    tifffile.imwrite(tmp_path / "mask.tif", inside.astype(np.uint8))
    roi = {"top_px": 1, "left_px": 2, "height_px": 18, "width_px": 20}
    named = scene_of(no_load_dark="dark.tif", no_load_bright="bright.tif", mask="mask.tif", roi=roi)
    named = named.model_copy(update={"folder": tmp_path})
    arrays = scene_of(no_load_dark=GREY, no_load_bright=GREY[0], mask=inside, roi=roi)
    for one, other in zip(load_no_load(named), load_no_load(arrays), strict=True):
        assert np.array_equal(one.image, other.image) and np.array_equal(one.valid, other.valid)
    shapes = (18, 20), (20, 24)
    assert np.array_equal(load_mask(named, *shapes), load_mask(arrays, *shapes))


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (np.zeros((2, 20, 24), bool), "one picture"), (np.zeros((20, 24), object), "one picture"),
        (np.zeros((20, 24), bool), "leaves no pixel"), (np.ones((20, 24), bool), "masks nothing"),
        (np.eye(7, dtype=bool), "make the mask of one of these sizes"),
        (GREY[0], "many grey levels"),
    ],
)  # fmt: skip
def test_an_array_that_is_no_mask_is_refused(mask, words):
    assert words in refusal(load_mask, scene_of(mask=mask), (20, 24), (20, 24))


def test_a_no_load_array_of_another_size_is_refused():
    with pytest.raises(InputError, match="same camera settings"):
        load_no_load(scene_of(no_load_dark=GREY), full_shape=(21, 24))
