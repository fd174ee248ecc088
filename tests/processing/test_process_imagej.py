"""The maps of `process` in ImageJ: scale, origin, labels, display range and colours."""

from zlib import crc32

import numpy as np
import pytest
import tifffile
from matplotlib import colormaps

import isochrome
from imagej_heads import has_whole_head, heads_of
from imagej_program import read_by_imagej
from isochrome.output import imagej_view, read_csv
from isochrome.scene import dump_scene, load_scene

PIXEL, LEFT, TOP, ASIDE = 4.0 / 82, -2.0, 0.25, 0.03


@pytest.fixture(scope="module")
def processed(tmp_path_factory):
    """A folder of two frames of a small contact, and its result."""
    home = tmp_path_factory.mktemp("imagej")
    scene = load_scene("line-contact-wear").with_values(
        {
            "wear.distances_m": [0.0, 77.0], "friction.static_state_first": False,
            "camera.width_px": 82, "camera.height_px": 62, "camera.pixel_mm": PIXEL,
            "camera.left_mm": LEFT, "camera.top_mm": TOP, "camera.noise_grey": 1.0,
        }
    )  # fmt: skip
    isochrome.simulate(scene, home / "simulated")
    stated = scene.with_values({"camera.left_mm": LEFT + ASIDE})  # as a user measures it
    (home / "scene.toml").write_text(dump_scene(stated), "utf-8")
    found = isochrome.process(home / "simulated" / "frames.tif", home / "scene.toml", home / "out")
    return home / "out", found


@pytest.mark.parametrize("name", ["fringe_order", "confidence", "normalised"])
def test_a_map_tells_imagej_where_it_is_and_how_it_is_shown(processed, name):
    folder, found = processed
    with tifffile.TiffFile(folder / f"{name}.tif") as tif:
        known = tif.imagej_metadata
        assert len(tif.series) == 1 and tif.series[0].shape == (2, 62, 82)
        across = tif.pages.first.tags["XResolution"].value
    assert known["unit"] == "mm" and across[0] / across[1] == pytest.approx(1.0 / PIXEL, rel=1e-6)
    assert known["Labels"] == read_csv(folder / "frames.csv")["label"]
    # pixels from the first one's upper left corner to x = z = 0: where the block stood, to a few of
    # the fit's ± (0.002 px), not 0.6 px aside as the scene states it
    assert known["xorigin"] == pytest.approx(-LEFT / PIXEL, abs=0.01)
    assert known["yorigin"] == pytest.approx(-TOP / PIXEL, abs=0.01)
    highest = max(found.columns["n_max"]) if name == "fringe_order" else 1.0
    assert known["max"] == pytest.approx(highest) and known["min"] == 0.0
    assert known["Ranges"] == pytest.approx((0.0, highest))
    assert np.shape(known["LUTs"])[-2:] == (3, 256)


def test_what_imagej_is_told_leaves_the_frames_as_they_are(processed):
    """Against the store, which is another file; read as it lies on disk, and mapped."""
    folder, found = processed
    order = tifffile.imread(folder / "fringe_order.tif")
    np.testing.assert_array_equal(order, found.dataset["fringe_order"].values)
    np.testing.assert_array_equal(tifffile.memmap(folder / "fringe_order.tif", mode="r"), order)
    with isochrome.frames.open_frames(folder / "normalised.tif") as reader:
        assert reader.count() == 2 and reader.pixel_mm == pytest.approx(PIXEL, rel=1e-6)


def test_a_map_has_the_display_range_of_what_it_shows():
    """Whatever its values are: a cyclic map's two ends are one direction."""
    span = (0.2, 0.7)
    ranges = {
        name: imagej_view(name, span)["Ranges"]
        for name in ("isoclinic", "sigma_1_direction", "confidence", "normalised", "fringe_order")
    }
    assert ranges["isoclinic"] == ranges["sigma_1_direction"] == (-90.0, 90.0)
    assert ranges["confidence"] == ranges["normalised"] == (0.0, 1.0)
    assert ranges["fringe_order"] == (0.0, 0.7)
    assert imagej_view("tau_xz", (-0.2, 0.7))["Ranges"] == (-0.7, 0.7)


def test_every_tiff_of_a_run_has_the_whole_head(processed, tmp_path):
    """What simulate, process and export leave; the tractions' are looked at where they are made."""
    folder, _ = processed
    home = folder.parent
    isochrome.simulate(home / "scene.toml", tmp_path / "parts", components=True)
    isochrome.export(folder, to="tiff", out=tmp_path / "exported")
    for left in (folder, tmp_path / "parts", tmp_path / "exported"):
        heads = heads_of(left)
        assert heads
        for name, head in heads.items():
            assert has_whole_head(*head, placed=True), (left.name, name, head)


@pytest.mark.long
def test_imagej_itself_shows_the_maps_in_their_place_and_colours(processed, tmp_path):
    """The program, not a reader of its metadata: it looks for colours in another place."""
    folder, found = processed
    isochrome.export(folder, to="tiff", out=tmp_path / "exported")
    exported = next((tmp_path / "exported").rglob("fringe_order.tif"))
    scene, parts = folder.parent / "scene.toml", tmp_path / "parts"
    isochrome.simulate(scene, parts, components=True)
    maps = {
        folder / "fringe_order.tif": "viridis", folder / "normalised.tif": "gray",
        exported: "viridis", parts / "sigma_1.tif": "RdBu_r",
        parts / "sigma_1_direction.tif": "hsv", parts / "frames.tif": "gray",
    }  # fmt: skip
    known = dict(zip(maps, read_by_imagej(*maps), strict=True))
    for path, colours in maps.items():
        told, pictures = known[path], tifffile.imread(path).astype("<f4")
        table = np.rint(255 * colormaps[colours](np.arange(256))[:, :3])
        np.testing.assert_array_equal(told["colours"], table, err_msg=path.name)
        assert (told["frames"], told["slices"], told["unit"]) == (2, 1, "mm")
        assert told["pixel"] == pytest.approx([PIXEL, PIXEL], rel=1e-6)
        pictures[np.isnan(pictures)] = np.nan  # of one kind
        for page, picture in zip(told["pages"], pictures, strict=True):
            assert page["crc32"] == crc32(picture.tobytes())
    place = known[folder / "fringe_order.tif"]
    assert place["origin"] == pytest.approx([-LEFT / PIXEL, -TOP / PIXEL], abs=0.01)
    assert place["origin"] == known[exported]["origin"]
    highest = pytest.approx([0.0, max(found.columns["n_max"])], rel=1e-6)
    assert all(page["range"] == highest for page in place["pages"])
    labels = [page["label"] for page in place["pages"]]
    assert labels == read_csv(folder / "frames.csv")["label"]


def test_frames_in_colour_have_labels_and_origin_too(tmp_path):
    scene = load_scene("ring").with_values(
        {
            "load.normal_n": 60.0, "camera.width_px": 96, "camera.height_px": 96,
            "camera.pixel_mm": 0.48, "polariscope.light": "white",
            "camera.colour": True,
        }
    )  # fmt: skip
    isochrome.simulate(scene, tmp_path / "colour")
    heads = heads_of(tmp_path / "colour")
    assert has_whole_head(*heads["frames.tif"], placed=True, coloured=True)
