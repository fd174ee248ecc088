"""Exports are read by the readers of their formats: HDF5 and netCDF, ImageJ's tags, CSV."""

import shutil
import sys

import h5py
import netCDF4
import numpy as np
import pytest
import tifffile
import xarray

from isochrome import runs
from isochrome.errors import InputError
from isochrome.frames import open_tiff
from isochrome.output import read_csv
from runs.counting import COLS, ROWS, truth

NAMES = ["erstes Bild ü", "second", "", "fourth"]
COLUMNS = {
    "chi": [1.0, 1.5, float("nan"), 2.0], "n_max_row_px": [3, None, 4, 5], "branch": [1, 2, 3, 4],
    "load.normal_n": [44.0, 45.0, 46.0, 1 / 3], "warnings": ["", "weak; schwach µ", "", ""],
}  # fmt: skip
TIMES = [0.0, 0.1, 0.2, 0.3]
SCENE = "[specimen]\nthickness_mm = 4.0\n"


def pictures():
    found = np.stack([truth(i) for i in range(4)])
    found[2, :2] = np.nan
    return found


def centres(count):
    """Centres of pixels of 0.02 mm."""
    return 0.02 * (np.arange(count) + 0.5)


def write_run(folder, *, times=TIMES, rows=ROWS, every=1):
    """A dataset of four frames, of each of which, or of one of so many, there is a picture."""
    layout = runs.RunLayout(
        axes={"frame": 4}, shape={"row": rows, "col": COLS},
        layers=(runs.Layer("fringe_order", "1", "fringe order N"),), chunk=2, every=every,
    )  # fmt: skip
    runs.create_store(folder / "run.zarr", layout)
    axes = {"time_s": times, "label": NAMES, "frame": [0, 1, 2, 3]}
    places = {
        "x_mm": runs.Column(("col",), centres(COLS), {"units": "mm"}),
        "z_mm": runs.Column(("row",), centres(rows), {"units": "mm"}),
    }
    if every > 1:
        numbers = np.arange(0, 4, every)
        places["key_frame"] = runs.Column(
            ("key_frame",), numbers, {"long_name": "number of the frame"}
        )
    runs.add_columns(
        folder / "run.zarr",
        {name: runs.column(values, "frame", name) for name, values in COLUMNS.items()},
        {name: runs.column(values, "frame", name) for name, values in axes.items()} | places,
        {"scene": SCENE, "seed": 3},
    )
    import zarr

    zarr.open_group(folder / "run.zarr")["fringe_order"][:] = pictures()[::every, :rows]
    runs.seal(folder, {})
    return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run") / "Lauf 1")


@pytest.fixture
def run(written, tmp_path):
    """A dataset of four frames, a tenth of a second apart, pixels of 0.02 mm."""
    return shutil.copytree(written, tmp_path / "Lauf 1")


def test_netcdf_is_plain_hdf5_with_scales_units_and_text(run):
    """Which netCDF's own library reads, too."""
    (path,) = runs.export(run, "netcdf")
    assert path == run / "run.nc"
    with netCDF4.Dataset(path) as file:
        assert file.data_model == "NETCDF4" and file["warnings"][1] == "weak; schwach µ"
        order = file["fringe_order"]
        assert order.dimensions == ("frame", "row", "col")
        np.testing.assert_array_equal(np.ma.filled(order[...], np.nan), pictures())
    with h5py.File(path) as file:
        order = file["fringe_order"]
        np.testing.assert_array_equal(order[...], pictures())
        assert order.dtype == np.float32
        assert order.attrs["units"] == "1"
        # dimension scales are how netCDF-4 names axes, and what MATLAB's ncinfo shows
        assert [order.dims[k][0].name for k in range(3)] == ["/frame", "/row", "/col"]
        assert file["load_normal_n"].attrs["units"] == "N"
        assert file["x_mm"].attrs["units"] == "mm"
        # those alone that lie on its own axes: others are not to be read with it
        assert set(order.attrs["coordinates"].split()) == {"x_mm", "z_mm", "time_s", "label"}
        assert set(file["chi"].attrs["coordinates"].split()) == {"time_s", "label"}
        assert file["label"].asstr()[...].tolist() == NAMES
        assert file.attrs["scene"] == "[specimen]\nthickness_mm = 4.0\n"


def test_netcdf_gives_all_that_went_into_the_run_again(tmp_path):
    """What was put in, not what xarray makes of the store; of every second frame a picture."""
    run = write_run(tmp_path / "run", every=2)
    (path,) = runs.export(run, "netcdf", tmp_path / "elsewhere")
    assert path == tmp_path / "elsewhere" / "run.nc"
    with xarray.open_dataset(path, engine="h5netcdf") as again:
        assert dict(again.sizes) == {"key_frame": 2, "frame": 4, "row": ROWS, "col": COLS}
        assert set(again.coords) == {"time_s", "label", "frame", "x_mm", "z_mm", "key_frame"}
        assert set(again.data_vars) == {"fringe_order", *map(runs.identifier, COLUMNS)}
        order = again.fringe_order
        assert order.dims == ("key_frame", "row", "col") and order.dtype == np.float32
        assert order.attrs == {"units": "1", "long_name": "fringe order N"}
        np.testing.assert_array_equal(order.values, pictures()[::2])
        assert set(order.coords) == {"x_mm", "z_mm", "key_frame"}
        for name, values in COLUMNS.items():
            assert again[runs.identifier(name)].dims == ("frame",)
            known = [np.nan if v is None else v for v in values]
            np.testing.assert_array_equal(again[runs.identifier(name)].values, known, name)
        assert again.branch.dtype == np.int64
        assert again["load_normal_n"].attrs["units"] == "N"
        assert again.n_max_row_px.attrs["units"] == "pixel"
        assert again.label.values.tolist() == NAMES
        np.testing.assert_array_equal(again.time_s.values, TIMES)
        np.testing.assert_array_equal(again.frame.values, [0, 1, 2, 3])
        np.testing.assert_array_equal(again.x_mm.values, centres(COLS))
        np.testing.assert_array_equal(again.z_mm.values, centres(ROWS))
        assert (again.attrs["scene"], again.attrs["seed"]) == (SCENE, 3)
        assert again.key_frame.values.tolist() == [0, 2]
        assert again.key_frame.attrs["long_name"] == "number of the frame"


def test_whole_numbers_come_back_whole_where_some_are_not_known(run):
    """Stored as floats, for no whole number says that it is not known."""
    with runs.open_run(run) as dataset:
        found = runs.column_values(dataset.n_max_row_px)
    assert found == [3, None, 4, 5] and [type(v) for v in found] == [int, type(None), int, int]


def test_tiff_has_its_scale_time_and_labels_where_imagej_looks(run, tmp_path):
    (path,) = runs.export(run, "tiff", tmp_path / "for imagej")
    assert open_tiff(path).pixel_mm == pytest.approx(0.02, rel=1e-6)
    with tifffile.TiffFile(path) as tif:
        np.testing.assert_array_equal(tif.asarray(), pictures())
        meta = tif.imagej_metadata
        assert (meta["unit"], meta["images"]) == ("mm", 4)
        assert meta["finterval"] == pytest.approx(0.1) and meta["tunit"] == "s"
        assert meta["Labels"] == NAMES


@pytest.mark.parametrize(
    ("last", "even"), [(0.30009, True), (0.3002, False), (0.35, False), (float("nan"), False)]
)
def test_an_interval_is_given_where_the_times_are_even_to_a_thousandth(tmp_path, last, even):
    """Of steps of 0.1 s the last is longer by 0.9 and by 2 thousandths of their mean."""
    (path,) = runs.export(write_run(tmp_path / "run", times=[*TIMES[:3], last]), "tiff")
    with tifffile.TiffFile(path) as tif:
        assert ("finterval" in tif.imagej_metadata) == even


def test_pictures_that_imagej_cannot_hold_have_their_scale_in_centimetres(tmp_path):
    """Single rows; above 4 GB they are written the same way."""
    (path,) = runs.export(write_run(tmp_path / "run", rows=1), "tiff")
    with tifffile.TiffFile(path) as tif:
        np.testing.assert_array_equal(tif.asarray(), pictures()[:, :1])
        tags = tif.pages[0].tags
        per_cm, unit = tags["XResolution"].value, tags["ResolutionUnit"].value
    # 0.02 mm: 500 pixels in a centimetre
    assert unit == 3 and per_cm[0] / per_cm[1] == pytest.approx(500.0, rel=1e-6)


def test_csv_is_the_table_of_all_but_pictures(run):
    (path,) = runs.export(run, "csv")
    table = read_csv(path)
    assert {"frame", "time_s", "label", *map(runs.identifier, COLUMNS)} == set(table)
    assert table["frame"] == [0.0, 1.0, 2.0, 3.0] and table["label"] == NAMES
    np.testing.assert_array_equal(table["n_max_row_px"], [3.0, np.nan, 4.0, 5.0])


def test_pictures_of_some_frames_have_their_own_labels_and_times_and_no_rows(tmp_path):
    """Of a tracked video: every second frame has a picture here."""
    run = write_run(tmp_path / "run", every=2)
    (path,) = runs.export(run, "tiff")
    with tifffile.TiffFile(path) as tif:
        np.testing.assert_array_equal(tif.asarray(), pictures()[::2])
        assert tif.imagej_metadata["Labels"] == NAMES[::2]
        assert tif.imagej_metadata["finterval"] == pytest.approx(0.2)
    table = read_csv(*runs.export(run, "csv"))
    assert "key_frame" not in table and table["frame"] == [0.0, 1.0, 2.0, 3.0]


def test_a_wrong_format_or_folder_or_a_missing_library_is_said(run, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"--to mat: .*netcdf, tiff, csv"):
        runs.export(run, "mat")
    with pytest.raises(InputError, match=r"holds no run\.zarr"):
        runs.export(tmp_path, "csv")
    monkeypatch.setitem(sys.modules, "h5netcdf", None)
    with pytest.raises(InputError, match=r"pip install isochrome\[netcdf\]"):
        runs.export(run, "netcdf")
    assert not (run / "run.nc").exists()
