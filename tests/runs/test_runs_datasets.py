"""What a run's dataset is like in Python: identifiers, axes in mm, pictures the right way up."""

from __future__ import annotations

import keyword

import matplotlib
import numpy as np
import pytest
import xarray
import zarr

from isochrome import runs
from isochrome.errors import InputError

matplotlib.use("Agg")
ROWS, COLS = 3, 4
MAP = np.arange(24.0, dtype=np.float32).reshape(2, ROWS, COLS)


def coordinates():
    return {
        "frame": runs.Column(("frame",), np.arange(2), {}),
        "z_mm": runs.Column(("row",), 0.1 * (np.arange(ROWS) + 0.5), {"units": "mm"}),
        "x_mm": runs.Column(("col",), 0.1 * (np.arange(COLS) + 0.5) - 0.2, {"units": "mm"}),
    }


def columns():
    return {
        "load.normal_n": runs.Column(("frame",), np.array([40.0, 41.0]), {"units": "N"}),
        "load.normal_n standard_uncertainty": runs.Column(("frame",), np.array([0.1, 0.2]), {}),
    }


@pytest.fixture
def memory():
    order = runs.Column(("frame", "row", "col"), MAP, {"units": "1", "long_name": "fringe order N"})
    return runs.make_dataset({"fringe_order": order, **columns()}, coordinates(), {})


@pytest.fixture
def folder(tmp_path):
    """A run's store with the same."""
    layer = runs.Layer("fringe_order", "1", "fringe order N")
    layout = runs.RunLayout(
        axes={"frame": 2}, shape={"row": ROWS, "col": COLS}, layers=(layer,), chunk=1
    )
    runs.create_store(tmp_path / "run.zarr", layout)
    zarr.open_group(tmp_path / "run.zarr")["fringe_order"][:] = MAP
    runs.add_columns(tmp_path / "run.zarr", columns(), coordinates(), {})
    runs.seal(tmp_path, {})
    return tmp_path


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("load.normal_n", "load_normal_n"),
        ("load.normal_n standard_uncertainty", "load_normal_n_u"),
        ("camera.left_mm noise_uncertainty", "camera_left_mm_u_noise"),
        ("friction.coefficient cramer_rao_bound", "friction_coefficient_bound"),
        ("n_max", "n_max"),
    ],
)
def test_names_are_identifiers(name, wanted):
    assert runs.identifier(name) == wanted == runs.identifier(wanted)
    assert wanted.isidentifier() and not keyword.iskeyword(wanted)


def test_a_run_on_disk_is_the_one_in_memory(memory, folder):
    with runs.open_run(folder) as stored:
        assert not stored.fringe_order.variable._in_memory  # nothing is read before it is used
        again = stored.load()
        again.attrs = {}
        xarray.testing.assert_identical(again, memory)
    assert memory.fringe_order.dims == ("frame", "z_mm", "x_mm")
    assert memory.load_normal_n_u.values.tolist() == [0.1, 0.2]
    assert memory.load_normal_n.attrs == {"units": "N", "long_name": "load.normal_n"}
    assert memory.fringe_order.sel(x_mm=0.05, z_mm=0.25, method="nearest").values.tolist() == [
        10,
        22,
    ]


def test_a_run_of_an_earlier_version_is_opened_with_todays_names(memory, folder):
    """It has the dotted keys themselves, and no long_name."""
    group = zarr.open_group(folder / "run.zarr")
    for name in ("load_normal_n", "load_normal_n_u"):
        old = group[name].attrs.asdict().pop("long_name")
        (folder / "run.zarr" / name).rename(folder / "run.zarr" / old)
    (folder / "provenance.json").write_text('{"outputs": {}}', "utf-8")  # without checksums
    with pytest.warns(UserWarning, match="as results of earlier versions, and cannot"):
        stored = runs.open_run(folder)
    with stored:
        assert set(stored.variables) == set(memory.variables)
        assert stored.load_normal_n_u.values.tolist() == [0.1, 0.2]
    with pytest.warns(UserWarning, match="cannot be verified"):
        (table,) = runs.export(folder, "csv")
    assert "load_normal_n_u" in table.read_text().splitlines()[0]


def test_a_map_is_drawn_the_right_way_up_in_mm(memory, folder):
    with runs.open_run(folder) as stored:
        for run in (memory, stored, memory.isel(frame=[0, 1])):
            shown = run.fringe_order.isel(frame=1)
            assert isinstance(shown, runs.RunArray)
            axes = shown.plot().axes
            assert axes.get_ylim() == pytest.approx((0.3, 0.0))  # z down
            assert axes.get_xlim() == pytest.approx((-0.2, 0.2))
            assert axes.get_aspect() == 1.0
            assert "x_mm" in axes.get_xlabel() and "z_mm" in axes.get_ylabel()
            matplotlib.pyplot.close(axes.figure)

    grid = memory.fringe_order.plot(col="frame")
    assert all(axes.get_ylim() == pytest.approx((0.3, 0.0)) for axes in grid.axs.flat)
    matplotlib.pyplot.close(grid.fig)


def test_lines_histograms_and_what_the_caller_wants_otherwise_are_xarrays(memory):
    (line,) = memory.load_normal_n.plot()
    low, high = line.axes.get_ylim()
    assert low < high
    matplotlib.pyplot.close(line.axes.figure)
    assert len(memory.fringe_order.plot()) == 3  # a histogram: counts, edges, bars
    matplotlib.pyplot.close("all")
    upwards = memory.fringe_order[0].plot(yincrease=True).axes
    assert upwards.get_ylim() == pytest.approx((0.0, 0.3))
    matplotlib.pyplot.close("all")


def test_without_a_scale_the_axes_are_rows_and_columns():
    order = runs.Column(("frame", "row", "col"), MAP, {})
    places = {
        "row": runs.Column(("row",), np.arange(ROWS), {}),
        "col": runs.Column(("col",), np.arange(COLS), {}),
    }
    run = runs.make_dataset({"fringe_order": order}, places, {})
    assert run.fringe_order.dims == ("frame", "row", "col")
    assert run.fringe_order[0].plot().axes.get_ylim() == pytest.approx((2.5, -0.5))
    matplotlib.pyplot.close("all")


def elsewhere(memory, aside):
    return memory.assign_coords(x_mm=memory.x_mm.values + aside)


@pytest.mark.parametrize(
    "made",
    [
        lambda one, other: one - other, lambda one, other: one > other,
        lambda one, other: np.hypot(one, other), lambda one, other: xarray.DataArray(one) - other,
        lambda one, other: one.copy().__isub__(other),
        lambda one, other: abs(np.sqrt(one)) * other[0],
        lambda one, other: one - other.to_dataset(),
    ],
)  # fmt: skip
def test_maps_of_other_places_are_refused_in_any_arithmetic(memory, made):
    other = elsewhere(memory, 0.03)
    wanted = r"x_mm from -0\.1\d to 0\.\d+ mm \(3 x 4 pixels\).*simulate\(found\.fitted\).*compare"
    with pytest.raises(InputError, match=wanted):
        made(memory.fringe_order, other.fringe_order)
    assert made(memory.fringe_order, memory.fringe_order.copy()) is not None


def test_datasets_of_other_places_are_refused(memory):
    maps, other = memory[["fringe_order"]], elsewhere(memory, 0.4)[["fringe_order"]]
    with pytest.raises(InputError, match="show other places"):
        maps - other
    with pytest.raises(InputError, match="show other places"):  # two columns would be left of these
        maps.isel(x_mm=slice(0, 3)) - maps.isel(x_mm=slice(1, 4))
    same = maps - maps.copy()
    assert type(same) is type(memory) and not same.fringe_order.values.any()


def test_arithmetic_of_one_place_is_xarrays(memory):
    order = memory.fringe_order
    np.testing.assert_array_equal((order - order[0]).values, MAP - MAP[0])
    np.testing.assert_array_equal((2.0 * order - MAP).values, MAP)
    np.testing.assert_array_equal((MAP - order).values, 0.0 * MAP)
    part = order.sel(x_mm=slice(-0.1, 0.1))  # of the same pixels
    np.testing.assert_array_equal((order - part).values, 0.0 * MAP[:, :, 1:3])
    assert all(
        type(made) is runs.RunArray for made in (order - order[0], np.abs(order), 1.0 / order)
    )


def test_a_map_without_a_scale_is_not_spread_over_one_that_has_it(memory):
    bare = xarray.DataArray(MAP[0], dims=("row", "col"))
    with pytest.raises(InputError, match=r"camera\.pixel_mm"):
        memory.fringe_order - bare
