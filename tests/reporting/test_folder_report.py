"""`isochrome report FOLDER`: the page of a run from its folder alone, and what is refused."""

import base64
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from pages import Page, data_of, decoded

import isochrome
from fitting.test_fit_track import LOAD, contact, film, save
from isochrome.errors import InputError
from isochrome.output import write_tiff
from isochrome.runs import faults_of
from refusals import refusal

LOAD_N = 60.0


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder of what process and fit left of a rendered ring, with noise."""
    home = tmp_path_factory.mktemp("runs")
    scene = isochrome.load_scene("ring").with_values(
        {"load.normal_n": LOAD_N, "camera.width_px": 128, "camera.height_px": 128,
         "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0}
    )  # fmt: skip
    frames = isochrome.simulate(scene).frames
    scene = scene.with_values({LOAD: 0.8 * LOAD_N})  # what was fitted is not what was stated
    isochrome.process(frames, scene, home / "processed")
    isochrome.fit(frames, scene, [LOAD], out=home / "fitted")
    return home


def same_page(folder, out):
    """Whether the page made anew is the run's own, but for the scene's name: the folder's."""
    own = (folder / "report.html").read_text("utf-8")
    name = re.search(r"<h1><bdi>.* of ([\w-]+)", own)[1]
    file = isochrome.report(folder, out)
    assert file == out / "report.html"
    return file.read_text("utf-8").replace(f" of {folder.name}", f" of {name}") == own


@pytest.mark.long
@pytest.mark.parametrize("name", ["processed", "fitted"])
def test_the_page_made_anew_is_the_one_beside_the_run(runs, tmp_path, name):
    assert same_page(runs / name, tmp_path / "out")


@pytest.mark.long
def test_so_is_that_of_a_track(tmp_path):
    load = np.array([44.0, 44.5, 45.0])
    save(tmp_path, film(contact(), {LOAD: load}, np.random.default_rng(1)))
    isochrome.track(tmp_path / "film.tif", contact(), (LOAD,), out=tmp_path / "tracked")
    assert same_page(tmp_path / "tracked", tmp_path / "out")
    text = Page(tmp_path / "tracked" / "report.html").text
    assert "Mean of 3 frames, ± of each: load" in text and "sliding distance" not in text


def test_orders_on_the_page_are_the_runs_own_and_the_simulation_lies_on_them(runs):
    """The map of run.zarr, rounded; and what the load that was fitted makes."""
    page = Page(runs / "processed" / "report.html")
    (frame,) = data_of(page)["frames"]
    with isochrome.open_run(runs / "processed") as dataset:
        own = dataset.fringe_order.values[0]
    shown = decoded(frame["order"], *own.shape)
    assert (np.isnan(shown) == np.isnan(own)).all()
    assert np.nanmax(np.abs(shown - own)) <= 0.005 + 1e-6
    model = decoded(frame["model_order"], *own.shape)
    # noise of 1 grey level of 255 over d(light)/dN of up to 1.6, and the page's own rounding
    assert np.nanmedian(np.abs(model - own)) < 0.02
    assert [pane["key"] for pane in frame["panes"]] == [
        "experiment", "simulation", "difference", "order",
    ]  # fmt: skip


def test_the_page_states_the_load_with_its_uncertainty_and_its_own_figure(runs):
    for name in ("processed", "fitted"):
        verdict = Page(runs / name / "report.html").text
        load, spread = map(float, re.search(r"Load ([\d.]+) ± ([\d.]+) N", verdict).groups())
        assert abs(load - LOAD_N) < 4.0 * spread + 0.05
    (image,) = (one for one in Page(runs / "fitted" / "report.html").of("img") if one.get("class"))
    data = base64.b64decode(image["src"].partition(",")[2])
    assert data == (runs / "fitted" / "fit.png").read_bytes()


def test_it_is_written_in_the_runs_own_folder_and_the_run_stays_complete(runs, tmp_path):
    folder = shutil.copytree(runs / "fitted", tmp_path / "fitted")
    (folder / "report.html").unlink()
    assert isochrome.report(folder) == folder / "report.html"
    assert (folder / "report.html").stat().st_size > 1000
    # it is a view, and the folder's record then knows the new one
    (folder / "report.html").write_text("mine")
    record = json.loads((folder / "provenance.json").read_text("utf-8"))
    assert list(faults_of(folder, record)) == ["report.html"]
    isochrome.report(folder)
    assert faults_of(folder, record) == {}


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("summary.csv", "is a campaign; name the folder of one of its recordings"),
        ("metrics.csv", "holds no provenance.json; name a folder"),
        ("notes.txt", "holds no frames.csv and no fit.json and no history.csv and no calibration."),
    ],
)
def test_a_folder_of_another_kind_is_named(tmp_path, file, words):
    (tmp_path / file).write_text("")
    with pytest.raises(InputError, match=re.escape(f"{tmp_path}: ") + words):
        isochrome.report(tmp_path)


@pytest.mark.long
def test_a_comparison_is_made_anew_of_its_two_sets(tmp_path, monkeypatch):
    """Not of sets that are others by now, or were in memory."""
    for name in ("one", "two"):
        frames = np.random.default_rng(len(name)).integers(20, 200, (2, 40, 50), dtype=np.uint8)
        write_tiff(tmp_path / f"{name}.tif", frames)
    monkeypatch.chdir(tmp_path)
    isochrome.compare("one.tif", "two.tif", "both")
    page = tmp_path / "both" / "report.html"
    before = page.read_bytes()
    page.unlink()
    assert isochrome.report("both") == Path("both") / "report.html" and page.read_bytes() == before
    write_tiff(tmp_path / "two.tif", np.zeros((2, 40, 50), np.uint8))
    with pytest.raises(InputError, match=r"one\.tif or two\.tif is another by now"):
        isochrome.report("both")
    (tmp_path / "two.tif").unlink()
    with pytest.raises(InputError, match="is another by now, or not there"):
        isochrome.report("both")
    rng = np.random.default_rng(1)
    given = rng.random((1, 40, 50)), rng.random((1, 40, 50))
    isochrome.compare(*given, "memory")
    with pytest.raises(InputError, match="memory: compared what was in memory"):
        isochrome.report("memory")


def test_no_folder_and_an_unfinished_run_are_named(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="no such folder; name one that process, fit, track"):
        isochrome.report(tmp_path / "nowhere")
    (tmp_path / "out").mkdir()
    (tmp_path / "out.partial").mkdir()
    with pytest.raises(InputError, match="run the same command again to resume"):
        isochrome.report(tmp_path / "out")
    monkeypatch.chdir(tmp_path / "out")
    for here in (".", ""):
        with pytest.raises(InputError, match="run the same command again to resume"):
            isochrome.report(here)


@pytest.mark.parametrize("name", ["scene.toml", "run.zarr", "provenance.json"])
def test_what_is_missing_of_a_run_is_named(runs, tmp_path, name):
    folder = shutil.copytree(runs / "processed", tmp_path / "run")
    gone = folder / name
    shutil.rmtree(gone) if gone.is_dir() else gone.unlink()
    with pytest.raises(InputError, match=f"holds no {re.escape(name)}"):
        isochrome.report(folder)


@pytest.mark.parametrize(
    ("run", "name", "text"),
    [
        ("processed", "provenance.json", "[]"), ("processed", "provenance.json", "{"),
        ("processed", "frames.csv", "nothing\n"), ("processed", "scene.toml", "load = 1"),
        ("processed", "scene.toml", "\udcff"), ("fitted", "fit.json", "{}"),
        ("fitted", "fit.json", "null"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_one_line_and_leaves_the_page_as_it_was(runs, tmp_path, run, name, text):
    folder = shutil.copytree(runs / run, tmp_path / "run")
    (folder / name).write_text(text, "utf-8", errors="surrogateescape")
    before = (folder / "report.html").read_bytes()
    assert str(folder) in refusal(isochrome.report, folder)
    assert (folder / "report.html").read_bytes() == before
