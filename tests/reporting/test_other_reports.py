"""The pages of a simulation and of calibrations, beside the run and made anew of its folder."""

import base64
import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
import tifffile
from pages import HOSTILE, Page, charts_of, data_of, decoded
from PIL import Image

import isochrome
from isochrome.calibration import load_set, save_calibration
from isochrome.errors import InputError
from isochrome.reporting import paper_rows
from isochrome.scene import parse_scene
from made_calibrations import dots_in, three_colours
from scene_texts import SMALL_CAMERA, WORN_CONTACT
from shipped_sets import some_of_a_shipped_set
from stepped_sets import CIRCULAR, as_steps

K, LOAD_N = 2e-9, 44.0


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """The folder of a small worn contact."""
    home = tmp_path_factory.mktemp("simulated")
    scene = isochrome.parse_scene(WORN_CONTACT + SMALL_CAMERA + "noise_grey = 2.0\n", name="worn")
    isochrome.simulate(scene, home / "out")
    return home / "out"


def wear_set(folder, name="wear.toml"):
    """Volumes by Archard's law, k = 2e-9 mm²/N."""
    rows = ((s, K * LOAD_N * 1e3 * s) for s in (31.0, 77.0, 155.0))
    path = folder / name
    path.write_text(
        "# my own volumes\n"
        + "".join(
            f"[[volume]]\ndistance_m = {s}\nnormal_n = {LOAD_N}\n"
            f"value_mm3 = {{ value = {volume}, standard_uncertainty = {0.01 * volume} }}\n"
            for s, volume in rows
        ),
        "utf-8",
    )
    return path


def wear_calibration(home):
    """The folder of such a set's calibration."""
    path = wear_set(home)
    save_calibration(isochrome.calibrate_wear(path), home / "out", source=path)
    return home / "out"


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """The folder of a wear calibration."""
    return wear_calibration(tmp_path_factory.mktemp("worn"))


def test_a_simulations_pictures_and_orders_are_those_of_its_stacks(simulated, tmp_path):
    page = Page(simulated / "report.html")
    frames, orders = (tifffile.imread(simulated / n) for n in ("frames.tif", "fringe_order.tif"))
    shown = data_of(page)["frames"]
    assert [one["number"] for one in shown] == list(range(len(orders)))
    pictures = [i for i in page.of("img") if "rendered frame of frame" in (i.get("alt") or "")]
    for one, picture, frame, order in zip(shown, pictures, frames, orders, strict=True):
        assert [pane["key"] for pane in one["panes"]] == ["rendered", "order"]
        assert is_shown(picture, frame, frames.max())
        own = decoded(one["order"], *order.shape)
        assert (np.isnan(own) == np.isnan(order)).all()
        assert np.nanmax(np.abs(own - order)) <= 0.005 + 1e-6
    with open(simulated / "history.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    ends = [f"{float(row['p_max_mpa']):.4g}" for row in (rows[0], rows[-1])]
    assert f"largest pressure {ends[0]} to {ends[1]} MPa" in page.text
    assert "Under the rendered frame" in page.text and "experiment" not in page.text
    assert "two standard uncertainties" not in page.text  # a simulation has none
    assert [one["alt"].split(" over ")[0] for one in charts_of(page)] == [
        "largest pressure (MPa)", "contact width (mm)", "wear depth (µm)", "worn area (mm²)",
        "largest fringe order (fringes)", "largest shear stress (MPa)",
    ]  # fmt: skip
    assert "coefficient_mm2_per_n" in page.text and "SHA-256 of the code" in page.text
    assert same_but_for_the_name(simulated, tmp_path, "worn")


def is_shown(picture, frame, brightest):
    """Whether a picture is a frame in 64 levels, from 0 to the brightest pixel that is shown."""
    data = base64.b64decode(picture["src"].partition(",")[2])
    grey = np.asarray(Image.open(io.BytesIO(data)).convert("L"), float)
    return np.abs(grey - frame * (255.0 / brightest)).max() <= 0.5 * 255.0 / 63.0 + 1.0


def same_but_for_the_name(folder, out, name):
    """Whether the page made anew is the run's own; the scene then goes by its folder's name."""
    own = (folder / "report.html").read_text("utf-8")
    made = isochrome.report(folder, out).read_text("utf-8")
    return made.replace(f"Simulation of {folder.name}", f"Simulation of {name}") == own


@pytest.mark.parametrize(
    ("values", "note"),
    [
        ({"camera.colour": True}, "the mean of its three colours is shown"),
        ({"polariscope.step": as_steps(CIRCULAR)}, "the first of its phase steps is shown"),
    ],
)
def test_other_cameras_have_their_pages(tmp_path, values, note):
    scene = isochrome.load_scene("ring").with_values(
        {"load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
         "camera.pixel_mm": 0.36} | values
    )  # fmt: skip
    isochrome.simulate(scene, tmp_path / "out")
    page = Page(tmp_path / "out" / "report.html")
    assert note in page.text and "contact width" not in page.text  # a ring's history has none
    (shown,) = data_of(page)["frames"]
    frames, order = (
        tifffile.imread(tmp_path / "out" / n) for n in ("frames.tif", "fringe_order.tif")
    )
    (picture,) = (i for i in page.of("img") if "rendered frame of" in (i.get("alt") or ""))
    frame = frames.reshape(-1, 128, 128, 3).mean(axis=3)[0] if "colours" in note else frames[0]
    assert is_shown(picture, frame, frame.max())
    own = decoded(shown["order"], 128, 128)
    assert np.nanmax(np.abs(own - order.reshape(128, 128))) <= 0.005 + 1e-6
    assert same_but_for_the_name(tmp_path / "out", tmp_path / "again", "ring")


@pytest.mark.long
def test_a_comparisons_page_states_the_experiments_camera_light_and_specimen(simulated, tmp_path):
    isochrome.compare(simulated, simulated, tmp_path / "out")
    page, own = Page(tmp_path / "out" / "report.html"), Page(simulated / "report.html")
    table = own.text[own.text.rindex("For a paper") :]
    for words in ("camera", "light", "pixel", "fringe value f_sigma", "thickness"):
        row = re.search(rf"{words}.{{5}}", table)
        assert row is not None and row[0] in page.text, words
    assert "Scene of the experiment" in page.text and "coefficient_mm2_per_n" in page.text
    assert same_bytes(tmp_path / "out", tmp_path / "again")
    bare = tmp_path / "frames.tif"
    bare.write_bytes((simulated / "frames.tif").read_bytes())
    isochrome.compare(bare, bare, tmp_path / "bare")
    assert "f_sigma" not in Page(tmp_path / "bare" / "report.html").text


def test_the_fringe_value_stands_with_its_uncertainty_and_the_day_of_its_calibration():
    text = """[specimen]
fringe_value_n_per_mm = { value = 14.6, standard_uncertainty = 0.066, date = "2026-11-25" }
"""
    rows = dict(paper_rows(parse_scene(text), {}))
    assert rows["fringe value f_sigma"].startswith("14.600 ± 0.066 N/mm per fringe")
    assert rows["date of f_sigma"] == "2026-11-25"
    without = text.replace(', date = "2026-11-25"', "")
    rows = dict(paper_rows(parse_scene(without), {}))
    assert rows["date of f_sigma"].startswith("not stated in the scene")


def test_a_wear_calibrations_page_states_k_and_its_settings(worn, tmp_path):
    page = Page(worn / "report.html")
    found = json.loads((worn / "calibration.json").read_text("utf-8"))
    value, spread = map(
        float, re.search(r"k = \(([\d.]+) ± ([\d.]+)\)e-9 mm²/N", page.text).groups()
    )
    assert value == pytest.approx(2.0, abs=spread)
    assert spread == pytest.approx(1e9 * found["standard_uncertainty"], rel=0.06)  # two digits
    assert "# my own volumes" in page.text and "Settings" in page.text
    assert re.search(r"date of the calibration\d{4}-\d\d-\d\d", page.text)
    for item in found["budget"]:
        assert item["input"] in page.text
    for words in ("By distance (calibration.json)", "SHA-256 of", "The wear laws"):
        assert words in page.text
    assert same_bytes(worn, tmp_path)
    (image,) = (one for one in Page(worn / "report.html").of("img") if one.get("class") == "whole")
    data = base64.b64decode(image["src"].partition(",")[2])
    assert data == (worn / "calibration.png").read_bytes()


def same_bytes(folder, out):
    """Whether the page made anew is the run's own."""
    own = (folder / "report.html").read_bytes()
    return isochrome.report(folder, out).read_bytes() == own


def test_a_scales_page_states_the_pixel(tmp_path):
    picture = tmp_path / "a <script>window.stolen = 1<script>.tif"
    found = isochrome.calibrate_scale(picture, **dots_in(picture))
    save_calibration(found, tmp_path / "out", source=[picture])
    page = Page(tmp_path / "out" / "report.html")
    value, spread = map(
        float, re.search(r"pixel = ([\d.]+) ± ([\d.]+) mm", page.text, re.I).groups()
    )
    assert abs(value - found.pixel_mm.value) <= spread
    assert "By image (scale.json)" in page.text and len(page.inside["script"]) == 2
    assert picture.name in page.text and same_bytes(tmp_path / "out", tmp_path / "again")


def test_the_page_of_colours_states_gamma_and_each_warning(tmp_path):
    found = three_colours(gamma_uncertainty=0.03, exposures=(1.0, 0.9), warnings=HOSTILE[:4])
    save_calibration(found, tmp_path / "out")
    page = Page(tmp_path / "out" / "report.html")
    highest = found.colour_table.highest
    assert f"Gamma = 2.200 ± 0.030; orders = up to {highest:.2f} at 540 nm" in page.text
    assert all(re.sub(r"\s+", " ", name) in page.text for name in HOSTILE[:4])
    assert len(page.inside["script"]) == 2 and not charts_of(page)
    assert same_bytes(tmp_path / "out", tmp_path / "again")


@pytest.mark.long
@pytest.mark.parametrize(
    ("specimen", "images"),
    [("bending", (0, 3)), pytest.param("disc", (0, 2), marks=pytest.mark.study)],
)
def test_the_page_of_a_fringe_value_states_it(tmp_path, specimen, images):
    given = some_of_a_shipped_set(tmp_path, specimen, images)
    found = getattr(isochrome, f"calibrate_{specimen}")(given)
    save_calibration(found, tmp_path / "out", source=given)
    page = Page(tmp_path / "out" / "report.html")
    said = re.search(r"f_sigma = ([\d.]+) ± ([\d.]+) N/mm per fringe \(standard unc", page.text)
    value, spread = map(float, said.groups())
    assert abs(value - 14.6) < 4.0 * spread  # of the shipped sets, as their truth.json states
    assert f"chi = {found.chi:.2f} (about 1" in page.text
    assert f"calibrate {specimen}" in page.text and all(
        one.file in page.text for one in found.images
    )
    assert all(item.name in page.text for item in found.budget)
    settings = load_set(given)
    assert "lightwavelength not stated, dark field" in page.text
    assert f"camera{settings.camera.bit_depth} bit" in page.text
    assert specimen == "disc" or f"pixel{settings.camera.pixel_mm:g}" in page.text
    record = json.loads((tmp_path / "out" / "provenance.json").read_text("utf-8"))
    hashed = {Path(name).name for name in record["inputs_sha256"]}
    assert {given.name, *(one.file for one in found.images)} <= hashed
    assert same_bytes(tmp_path / "out", tmp_path / "again")


@pytest.mark.parametrize("name", ["calibration.png", "provenance.json"])
def test_what_is_missing_of_a_calibration_is_named(tmp_path, name):
    folder = wear_calibration(tmp_path)
    (folder / name).unlink()
    with pytest.raises(InputError, match=f"holds no {re.escape(name)}"):
        isochrome.report(folder)


@pytest.mark.filterwarnings("ignore:.*cannot be verified")
@pytest.mark.parametrize(
    "text", ["{}", "null", "{", '{"fringe_value_n_per_mm": 1, "warnings": []}']
)
def test_a_damaged_calibration_is_one_line(tmp_path, text):
    folder = wear_calibration(tmp_path)
    (folder / "calibration.json").write_text(text, "utf-8")
    with pytest.raises(InputError, match=r"calibration\.json: has .* bytes, and .* were left; run"):
        isochrome.report(folder)
    # of results of earlier versions nobody knows how they were
    (folder / "provenance.json").write_text('{"outputs": {}}', "utf-8")
    with pytest.raises(InputError, match=r"out: cannot be read .*run calibrate again$") as refused:
        isochrome.report(folder)
    assert "\n" not in str(refused.value)
