"""`process` as a long run: killed, stopped, with workers; one dataset of all that it found."""

import shlex
import signal
import sys
import time

import numpy as np
import pytest
import tifffile

import isochrome
from campaigns.conftest import COLS, ROWS, SCENE, film, true_orders, write_no_load
from isochrome import open_run
from isochrome.errors import InputError
from isochrome.frames import FrameReader, open_tiff
from isochrome.output import read_csv, write_tiff
from isochrome.processing import process
from runs import killing
from runs.counting import contents

PLACED = SCENE.replace("[frames]", "left_mm = -1.0\ntop_mm = 0.0\n\n[frames]")
KNOWN = "known_order = [{ row_px = 2, col_px = 1, order = 0.0 }]\n"
"""With it the orders are read, which takes most of the time."""


def test_a_bad_frame_is_said_while_the_next_one_is_still_read(tmp_path, monkeypatch):
    make_set(tmp_path, 3)
    frames = film(3, 0)
    frames[0] = 255
    write_tiff(tmp_path / "film.tif", frames)
    prepare = FrameReader._prepare

    def slowly(reader, raw):
        time.sleep(0.3 * raw.index)
        return prepare(reader, raw)

    monkeypatch.setattr(FrameReader, "_prepare", slowly)
    with pytest.raises(InputError, match="all white"):
        process(tmp_path / "film.tif", tmp_path / "scene.toml", tmp_path / "out")


def make_set(folder, count, *, known=False):
    """A stack of known orders in a dark field, 20 grey levels in darkness and 220 in the light."""
    write_tiff(folder / "film.tif", film(count, 0))
    write_no_load(folder)
    (folder / "scene.toml").write_text(PLACED + KNOWN * known, "utf-8")
    return folder


@pytest.fixture
def place(tmp_path):
    return make_set(tmp_path, 12)


def test_a_run_is_one_dataset_with_named_axes_and_units(tmp_path):
    place = make_set(tmp_path, 3, known=True)
    found = process(place / "film.tif", place / "scene.toml", place / "out")
    with open_run(place / "out") as dataset:
        assert dict(dataset.sizes) == {"frame": 3, "z_mm": ROWS, "x_mm": COLS}
        for name in ("fringe_order", "confidence", "normalised"):
            stack = tifffile.imread(place / "out" / f"{name}.tif")
            assert dataset[name].dims == ("frame", "z_mm", "x_mm")
            assert dataset[name].dtype == np.float32
            np.testing.assert_array_equal(dataset[name].values, stack)
        error = dataset.fringe_order.values - true_orders(3, 0)
        # on the right branch where it is read, which is nearly everywhere
        assert np.nanmax(np.abs(error)) < 0.25 and np.isfinite(error).mean() > 0.75
        # centres of the pixels, half a pixel from the edges that the scene names
        np.testing.assert_allclose(dataset.x_mm, -1.0 + 0.05 * (np.arange(COLS) + 0.5))
        np.testing.assert_allclose(dataset.z_mm, 0.05 * (np.arange(ROWS) + 0.5))
        # the stacks of maps have the camera's scale, for ImageJ
        assert open_tiff(place / "out" / "fringe_order.tif").pixel_mm == pytest.approx(
            0.05, rel=1e-6
        )
        assert dataset.col.dims == ("x_mm",) and dataset.row.dims == ("z_mm",)
        assert dataset.x_mm.attrs["units"] == "mm"
        assert dataset.name.values.tolist() == [f"film.tif[{i}]" for i in range(3)]
        assert {"distance_m", "time_s", "label"} <= set(dataset.coords)
        assert dataset.status.values.tolist() == ["ok"] * 3 and dataset.chi.dims == ("frame",)
        assert dataset.attrs["scene"].startswith("[specimen]\n")
        assert "film.tif" in dataset.attrs["inputs_sha256"]
        assert dataset.attrs["isochrome"] == isochrome.__version__ and dataset.attrs["seed"] == 0
        for name, values in found.columns.items():
            if name in ("chi", "distance_m"):
                assert dataset[name].isnull().all()  # nothing to fit, no distance to tell
            else:
                assert dataset[name].values.tolist() == values, name


@pytest.mark.long
def test_a_complete_run_gives_its_table_again_until_scene_or_input_change(place):
    first = process(place / "film.tif", place / "scene.toml", place / "out")
    before = contents(place / "out")
    again = process(place / "film.tif", place / "scene.toml", place / "out")
    assert again.already and not first.already and again.warnings == first.warnings
    assert list(again.columns) == list(first.columns)
    for name, values in first.columns.items():
        np.testing.assert_array_equal(np.array(again.columns[name]), np.array(values), name)
    assert contents(place / "out") == before
    process(place / "film.tif", place / "scene.toml", place / "out")
    text = PLACED.replace("top_mm = 0.0", "top_mm = 1.0")
    (place / "scene.toml").write_text(text, "utf-8")
    found = process(place / "film.tif", place / "scene.toml", place / "out")
    assert not found.already
    dark = tifffile.imread(place / "dark.tif")
    write_tiff(place / "dark.tif", dark[None] + np.uint8(1))
    assert not process(place / "film.tif", place / "scene.toml", place / "out").already


@pytest.mark.long
def test_a_frame_that_fails_ends_the_run_or_is_left_out(tmp_path):
    place = make_set(tmp_path, 3, known=True)
    frames = film(3, 0)
    frames[1] = 0
    write_tiff(place / "film.tif", frames)
    with pytest.raises(InputError, match=r"film\.tif\[1\]"):
        process(place / "film.tif", place / "scene.toml", place / "out")
    assert not (place / "out").exists() and not (place / "out.partial").exists()
    found = process(place / "film.tif", place / "scene.toml", place / "out", keep_going=True)
    assert found.failed == 1 and found.warnings[0].startswith("frame 1: film.tif[1]")
    with open_run(place / "out") as dataset:
        status = dataset.status.values.tolist()
        assert status == ["ok", "failed", "ok"]
        assert dataset.fringe_order[1].isnull().all() and (dataset.confidence[1] == 0).all()
        assert not dataset.fringe_order[2].isnull().all()
    table = read_csv(place / "out" / "frames.csv")
    assert table["warnings"][1] == found.columns["warnings"][1]


@pytest.mark.long
def test_two_workers_leave_the_same_files(place):
    process(place / "film.tif", place / "scene.toml", place / "one")
    process(place / "film.tif", place / "scene.toml", place / "two", workers=2)
    assert contents(place / "two") == contents(place / "one")


@pytest.mark.study
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_cluster_leaves_the_same_files(place, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.chdir(place)
    process("film.tif", "scene.toml", "one")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        process("film.tif", "scene.toml", "two", cluster=cluster.scheduler_address)
    assert contents(place / "two") == contents(place / "one")


@pytest.mark.study
@killing.needs_sigkill
@pytest.mark.parametrize("workers", ["1", "2"])
def test_killed_at_random_moments_it_ends_with_the_same_bytes(tmp_path, code, workers):
    make_set(tmp_path, 160)
    assert killing.killed_command_ends_the_same(tmp_path, code, workers, *killing.PROCESS)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to another process there")
def test_ctrl_c_keeps_what_is_finished_and_names_the_command(tmp_path, code):
    place = make_set(tmp_path, 80)  # eight chunks
    again = ["isochrome", "process", "film.tif", "--scene", "scene.toml", "--out", "out"]
    run = killing.start(place, code, "-m", *again)
    killing.wait_until(
        lambda: killing.finished_chunks(place / "out") >= 2, "it finished no chunks", run=run
    )
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130
    assert said.count("\n") == 1 and said.startswith("isochrome: stopped; ")
    assert "of 80 are finished and kept in " in said
    assert said.rstrip().endswith(f"to resume: isochrome {shlex.join(again[1:])}")
    assert not (place / "out").exists()
    killing.finished(killing.start(place, code, "-m", *again))
    assert tifffile.imread(place / "out" / "normalised.tif").shape == (80, ROWS, COLS)
