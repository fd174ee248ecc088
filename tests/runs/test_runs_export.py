"""Exports are read by the readers of their formats: HDF5 and netCDF, ImageJ's tags, CSV."""

import sys

import numpy as np
import pytest
import tifffile
import xarray

from isochrome.errors import InputError
from isochrome.output import read_csv, read_pixel_mm
from isochrome.runs import open_run
from isochrome.runs.export import export
from isochrome.runs.job import Layer, Layout
from isochrome.runs.store import Column, add_columns, column, create_store
from runs.counting import COLS, ROWS, truth

NAMES = ["erstes Bild ü", "second", "", "fourth"]


@pytest.fixture
def run(tmp_path):
    """A dataset of four frames, a tenth of a second apart, pixels of 0.02 mm."""
    folder = tmp_path / "Lauf 1"
    layer = Layer("fringe_order", "1", "fringe order N")
    create_store(folder / "run.zarr", Layout({"frame": 4}, {"row": ROWS, "col": COLS}, (layer,), 2))
    columns = {
        "chi": [1.0, 1.5, float("nan"), 2.0],
        "n_max_row_px": [3, None, 4, 5],
        "load.normal_n": [44.0, 45.0, 46.0, 1 / 3],
        "warnings": ["", "weak; schwach µ", "", ""],
    }
    axes = {"time_s": [0.0, 0.1, 0.2, 0.3], "label": NAMES, "frame": [0, 1, 2, 3]}
    places = {
        "x_mm": Column(("col",), 0.02 * (np.arange(COLS) + 0.5), {"units": "mm"}),
        "z_mm": Column(("row",), 0.02 * (np.arange(ROWS) + 0.5), {"units": "mm"}),
    }
    add_columns(
        folder / "run.zarr",
        {name: column(values, "frame", name) for name, values in columns.items()},
        {name: column(values, "frame", name) for name, values in axes.items()} | places,
        {"scene": "[specimen]\nthickness_mm = 4.0\n", "seed": 3},
    )
    import zarr

    zarr.open_group(folder / "run.zarr")["fringe_order"][:] = pictures()
    return folder


def pictures():
    found = np.stack([truth(i) for i in range(4)])
    found[2, :2] = np.nan
    return found


def test_netcdf_is_plain_hdf5_with_scales_units_and_text(run):
    h5py = pytest.importorskip("h5py")
    (path,) = export(run, "netcdf")
    assert path == run / "run.nc"
    with h5py.File(path) as file:
        order = file["fringe_order"]
        np.testing.assert_array_equal(order[...], pictures())
        assert order.dtype == np.float32
        assert order.attrs["units"] == "1"
        # dimension scales are how netCDF-4 names axes, and what MATLAB's ncinfo shows
        assert [order.dims[k][0].name for k in range(3)] == ["/frame", "/row", "/col"]
        assert file["load.normal_n"].attrs["units"] == "N"
        assert file["x_mm"].attrs["units"] == "mm"
        assert file["label"].asstr()[...].tolist() == NAMES
        assert file.attrs["scene"] == "[specimen]\nthickness_mm = 4.0\n"


def test_netcdf_is_read_by_the_reference_library(run):
    netcdf = pytest.importorskip("netCDF4")
    (path,) = export(run, "netcdf")
    with netcdf.Dataset(path) as file:
        assert file.data_model == "NETCDF4"
        assert {n: len(d) for n, d in file.dimensions.items()} == {
            "frame": 4, "row": ROWS, "col": COLS,
        }  # fmt: skip
        order = file["fringe_order"]
        assert order.dimensions == ("frame", "row", "col")
        np.testing.assert_array_equal(np.ma.filled(order[...], np.nan), pictures())
        assert file["warnings"][1] == "weak; schwach µ"
        np.testing.assert_array_equal(file["load.normal_n"][...], [44.0, 45.0, 46.0, 1 / 3])
        assert set(order.coordinates.split()) == {"x_mm", "z_mm", "time_s", "label"}


def test_netcdf_gives_the_same_dataset_again(run):
    (path,) = export(run, "netcdf")
    with xarray.open_dataset(path, engine="h5netcdf") as again, open_run(run) as own:
        xarray.testing.assert_equal(again.drop_vars(["label", "warnings"]).load(),
                                    own.drop_vars(["label", "warnings"]).load())  # fmt: skip
        assert again.warnings.values.tolist() == own.warnings.values.tolist()


def test_tiff_has_its_scale_time_and_labels_where_imagej_looks(run, tmp_path):
    (path,) = export(run, "tiff", tmp_path / "for imagej")
    assert read_pixel_mm(path) == pytest.approx(0.02, rel=1e-6)
    with tifffile.TiffFile(path) as tif:
        np.testing.assert_array_equal(tif.asarray(), pictures())
        meta = tif.imagej_metadata
        assert (meta["unit"], meta["images"]) == ("mm", 4)
        assert meta["finterval"] == pytest.approx(0.1) and meta["tunit"] == "s"
        assert meta["Labels"] == NAMES


def test_csv_is_the_table_of_all_but_pictures(run):
    (path,) = export(run, "csv")
    table = read_csv(path)
    assert {"frame", "time_s", "label", "chi", "n_max_row_px", "load.normal_n", "warnings"} == set(
        table
    )
    assert table["frame"] == [0.0, 1.0, 2.0, 3.0] and table["label"] == NAMES
    np.testing.assert_array_equal(table["n_max_row_px"], [3.0, np.nan, 4.0, 5.0])


def test_a_wrong_format_or_folder_or_a_missing_library_is_said(run, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"--to mat: .*netcdf, tiff, csv"):
        export(run, "mat")
    with pytest.raises(InputError, match=r"holds no run\.zarr"):
        export(tmp_path, "csv")
    monkeypatch.setitem(sys.modules, "h5netcdf", None)
    with pytest.raises(InputError, match=r"pip install isochrome\[netcdf\]"):
        export(run, "netcdf")
    assert not (run / "run.nc").exists()
