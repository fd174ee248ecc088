"""A grid of simulations is what each of its scenes gives alone, in one dataset."""

import numpy as np
import pytest

from isochrome import open_run
from isochrome.errors import InputError, PhysicsError
from isochrome.output import read_csv
from isochrome.runs import export
from isochrome.scene import dump_scene, parse_scene
from isochrome.simulation import simulate
from isochrome.sweeps import make_grid, sweep
from runs.counting import contents
from scene_texts import PAPER_CONTACT, camera_text
from simulation.test_simulate_scene import DISC as LARGE_DISC

DISC = parse_scene(LARGE_DISC).with_values(
    {
        "load.normal_n": 300.0, "camera.width_px": 40, "camera.height_px": 30,
        "camera.left_mm": -4.0, "camera.top_mm": 7.0, "camera.pixel_mm": 0.2,
        "camera.bit_depth": 8, "camera.noise_grey": 1.0,
    }
)  # fmt: skip
CAMERA = camera_text(160, 40, 0.025, left_mm=-2.0, top_mm=0.0, bit_depth=8)
CONTACT = parse_scene(PAPER_CONTACT + CAMERA, name="contact")


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    """Three loads and two thicknesses of a disc."""
    out = tmp_path_factory.mktemp("sweep") / "out"
    vary = ["load.normal_n=100:500:3", "specimen.thickness_mm=4,5"]
    found = sweep(DISC, vary, out)
    assert (found.points, found.failed, found.reasons) == (6, 0, ())
    return out


def test_each_point_is_that_of_its_scene_alone(grid):
    with open_run(grid) as dataset:
        assert dataset.fringe_order.dims == (
            "load_normal_n", "specimen_thickness_mm", "state", "z_mm", "x_mm",
        )  # fmt: skip
        assert dataset.load_normal_n.values.tolist() == [100.0, 300.0, 500.0]
        assert dataset.load_normal_n.attrs["units"] == "N"
        for load in (100.0, 300.0, 500.0):
            for thickness in (4.0, 5.0):
                values = {"load.normal_n": load, "specimen.thickness_mm": thickness}
                alone = simulate(DISC.with_values(values))
                there = dataset.sel(load_normal_n=load, specimen_thickness_mm=thickness)
                np.testing.assert_array_equal(there.fringe_order, alone.orders)
                np.testing.assert_array_equal(there.grey, alone.frames)
                assert there.n_max.item() == alone.history["n_max"][0]


def test_the_table_has_a_row_for_each_state_of_each_point(grid):
    table = read_csv(grid / "sweep.csv")
    assert table["load.normal_n"] == [100.0, 100.0, 300.0, 300.0, 500.0, 500.0]
    assert table["specimen.thickness_mm"] == [4.0, 5.0] * 3
    assert table["state"] == [0.0] * 6 and table["status"] == ["ok"] * 6
    with open_run(grid) as dataset:
        np.testing.assert_allclose(dataset.n_max.values.ravel(), table["n_max"], rtol=1e-8)


def test_a_point_that_physics_refuses_is_left_empty_with_its_reason(tmp_path):
    found = sweep(CONTACT, ["load.normal_n=40,4e6"], tmp_path / "out")
    assert found.failed == 1 and len(found.reasons) == 1
    with open_run(tmp_path / "out") as dataset:
        assert dataset.status.values.tolist() == ["ok", "failed"]
        assert dataset.reason.values.tolist() == ["", found.reasons[0]]
        assert dataset.fringe_order[1].isnull().all() and dataset.p_max_mpa[1].isnull().all()
        assert not dataset.fringe_order[0].isnull().all()
    with pytest.raises(PhysicsError, match="all 2 points were refused"):
        sweep(CONTACT, ["load.normal_n=4e6,5e6"], tmp_path / "none")
    assert {p.name for p in tmp_path.iterdir()} == {"out"}


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ([], "a sweep varies something"), (["load.normal_n"], "give KEY=first:last:number"),
        (["load.normal_n=1:2"], "give KEY=first:last:number"),
        (["load.normal_n=1:2:1"], "give KEY=first:last:number"),
        (["load.normal_n=1:nan:3"], "give KEY=first:last:number"),
        (["load.normal_m=1:2:3"], r"load\.normal_m"), (["load.normal_n=-1:2:3"], r"load\.normal_n"),
        (["load.normal_n=1,1"], "each once"),
        (["load.normal_n=1:2:3", "load.normal_n=1:2:3"], "is given twice"),
        (["load.normal_n=1:9:400", "specimen.thickness_mm=1:9:400"], "160000 points"),
        (["load.normal_n=-1:9:9091", "specimen.thickness_mm=1:9:11"], "100001 points, and 100000"),
        (["camera.width_px=40,50"], "changes the number of states, pixels or steps"),
        (["specimen.plane=1,2"], r"specimen\.plane"),
    ],
)  # fmt: skip
def test_wrong_grids_are_refused_before_anything_is_computed(tmp_path, vary, words):
    with pytest.raises(InputError, match=words):
        sweep(DISC, vary, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_whole_numbers_stay_whole():
    grid = make_grid(DISC, ["camera.seed=1:3:3"])
    assert [grid.scene_at(k).camera.seed for k in range(3)] == [1, 2, 3]


@pytest.mark.long
def test_workers_and_a_second_run_change_nothing(grid, tmp_path):
    vary = ["load.normal_n=100:500:3", "specimen.thickness_mm=4,5"]
    sweep(DISC, vary, tmp_path / "out", workers=2)
    again = tmp_path / "out"
    assert contents(again) == contents(grid)
    told = []
    sweep(DISC, vary, again, progress=told.append)
    assert told == []  # complete already


def test_a_changed_response_of_the_camera_is_noticed(tmp_path):
    text = dump_scene(DISC).replace("[camera]", '[camera]\nresponse = "sensor.csv"')
    scene = parse_scene(
        text + '[polariscope]\nwavelength_nm = 587.0\nlight = "white"\n', folder=tmp_path
    )
    computed = []
    for values in ((0.2, 1.0, 0.3), (0.2, 1.0, 0.3), (0.3, 1.0, 0.2)):
        rows = zip((300, 550, 1100), values, strict=True)
        table = "wavelength_nm,grey\n" + "".join(f"{nm},{value}\n" for nm, value in rows)
        (tmp_path / "sensor.csv").write_text(table, "utf-8")
        told = []
        sweep(scene, ["load.normal_n=300"], tmp_path / "out", progress=told.append)
        computed.append(bool(told))
    assert computed == [True, False, True]


def test_other_values_are_another_run_and_none_to_go_on_with(tmp_path):
    """The number of points is the same, and so is the scene."""
    out, peaks = tmp_path / "out", []
    for loads in ((100.0,), (200.0,)):
        sweep(DISC, {"load.normal_n": loads}, out)
        table = read_csv(out / "sweep.csv")
        assert table["load.normal_n"] == list(loads)
        peaks.append(table["n_max"])
    # linear in the load
    assert peaks[1] == pytest.approx([2.0 * peaks[0][0]], rel=1e-6)


def test_places_in_mm_are_told_unless_the_camera_itself_is_varied(grid, tmp_path):
    with open_run(grid) as dataset:
        np.testing.assert_allclose(dataset.x_mm, -4.0 + 0.2 * (np.arange(40) + 0.5), atol=1e-12)
        np.testing.assert_allclose(dataset.z_mm, 7.0 + 0.2 * (np.arange(30) + 0.5), atol=1e-12)
    sweep(DISC, ["camera.left_mm=-4,-2"], tmp_path / "out")
    with open_run(tmp_path / "out") as dataset:
        assert "x_mm" not in dataset.coords and "z_mm" not in dataset.coords


def test_a_grid_is_exported_with_its_axes(grid, tmp_path):
    import tifffile
    import xarray

    (path,) = export(grid, "netcdf", tmp_path)
    with xarray.open_dataset(path, engine="h5netcdf") as dataset, open_run(grid) as own:
        assert dataset.fringe_order.dims == (*own.fringe_order.dims[:3], "row", "col")
        np.testing.assert_array_equal(dataset.fringe_order, own.fringe_order)
        np.testing.assert_array_equal(dataset.load_normal_n, [100.0, 300.0, 500.0])
    for path in export(grid, "tiff", tmp_path):
        with tifffile.TiffFile(path) as tif:
            assert tif.asarray().shape == (6, 30, 40)
            assert tif.imagej_metadata["Labels"][3] == (
                "load.normal_n = 300, specimen.thickness_mm = 5, state = 0"
            )
    (path,) = export(grid, "csv", tmp_path)
    assert read_csv(path)["n_max"] == pytest.approx(read_csv(grid / "sweep.csv")["n_max"])
