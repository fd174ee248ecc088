"""What ImageJ is told of a simulation's stacks, as tifffile's reader of its metadata gives it."""

import numpy as np
import pytest
import tifffile

import isochrome
from scene_texts import SMALL_CAMERA, WORN_CONTACT


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    home = tmp_path_factory.mktemp("imagej")
    coarse = "\n[numerics]\nspacing_mm = 0.0125\ntolerance = 1e-3\n"
    (home / "scene.toml").write_text(WORN_CONTACT + SMALL_CAMERA + coarse, "utf-8")
    isochrome.simulate(home / "scene.toml", home / "out", components=True)
    return home / "out"


@pytest.mark.parametrize("name", ["frames", "fringe_order", "sigma_1", "sigma_1_direction"])
def test_imagej_knows_scale_origin_labels_range_and_colours(folder, name):
    camera = isochrome.load_scene(folder / "scene.toml").camera
    with tifffile.TiffFile(folder / f"{name}.tif") as tif:
        known, pictures = tif.imagej_metadata, tif.asarray()
        side = tif.pages[0].tags["XResolution"].value
    assert known["unit"] == "mm"
    assert side[1] / side[0] == pytest.approx(camera.pixel_mm, rel=1e-6)
    # the middle of ImageJ's pixel (0, 0) is half a pixel from the outer edges that the scene states
    assert -known["xorigin"] * camera.pixel_mm == pytest.approx(camera.left_mm, abs=1e-6)
    assert -known["yorigin"] * camera.pixel_mm == pytest.approx(camera.top_mm, abs=1e-6)
    assert known["Labels"] == ["initial sliding", "77 m"]
    low, high = known["Ranges"]
    assert (known["min"], known["max"]) == (low, high)
    table = np.asarray(known["LUTs"])  # of one channel, tifffile gives it alone
    assert table.shape == (3, 256) and table.dtype == np.uint8
    if name == "frames":
        assert (low, high) == (0, 255)
        np.testing.assert_array_equal(table, np.tile(np.arange(256), (3, 1)))
    elif name == "fringe_order":
        assert low == 0 and high == pytest.approx(np.nanmax(pictures), rel=1e-5)
        assert table[:, 0].tolist() == [68, 1, 84]  # the dark end of viridis
    elif name == "sigma_1":
        assert low == -high and 0.3 * np.nanmax(np.abs(pictures)) < high
        assert np.ptp(table[:, 127:129].astype(int), axis=0).max() < 10  # no colour at zero
    else:
        assert (low, high) == (-90, 90)
