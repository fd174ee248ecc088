"""A calibration's numbers as tables that a spreadsheet opens."""

import json

import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from isochrome.cli import app
from isochrome.output import read_csv
from scene_texts import BENDING_BEAM

from .conftest import bending_load


@pytest.fixture(scope="module")
def folder(tmp_path_factory, beam_frame):
    """A small beam under three loads, and what the command left of it, with tables for Excel."""
    home, rng = tmp_path_factory.mktemp("tables"), np.random.default_rng(0)
    text = f"{BENDING_BEAM}[camera]\npixel_mm = 0.36\n[uncertainty]\nload_percent = 0.3\n"
    for edge in (1.0, 1.5, 2.0):
        name = f"beam {edge}.tif"
        tifffile.imwrite(home / name, beam_frame(edge, rng, shape=(64, 80), pixel=0.36))
        text += f'[[image]]\nfile = "{name}"\nload_n = {bending_load(edge)}\n'
    (home / "set.toml").write_text(text, "utf-8")
    calibrate(home, "--csv", "excel")
    return home / "out"


def calibrate(home, *options):
    command = ["calibrate", "bending", str(home / "set.toml"), "--out", str(home / "out")]
    done = CliRunner().invoke(app, [*command, *options])
    assert done.exit_code == 0, done.output


@pytest.mark.long
def test_an_image_is_a_row_with_all_that_the_json_has_of_it(folder):
    table = read_csv(folder / "images.csv")
    images = json.loads((folder / "calibration.json").read_text("utf-8"))["images"]
    assert table["file"] == ["beam 1.0.tif", "beam 1.5.tif", "beam 2.0.tif"]
    assert list(table) == list(images[0])
    for name in table:
        if name != "file":
            assert table[name] == pytest.approx([image[name] for image in images], rel=1e-8)


def test_a_source_of_uncertainty_is_a_row_the_largest_share_first(folder):
    table = read_csv(folder / "budget.csv")
    found = json.loads((folder / "calibration.json").read_text("utf-8"))
    assert sorted(table["input"]) == sorted(item["name"] for item in found["budget"])
    assert table["share"] == sorted(table["share"], reverse=True)
    assert sum(table["share"]) == pytest.approx(1.0)
    parts = np.array(table["contribution_n_per_mm"])
    assert np.hypot.reduce(parts) == pytest.approx(found["standard_uncertainty"], rel=1e-6)
    relative = parts / found["fringe_value_n_per_mm"]
    assert table["relative_standard_uncertainty"] == pytest.approx(relative, rel=1e-7)
    load = table["input"].index("load")
    assert (table["standard_uncertainty"][load], table["unit"][load]) == (0.3, "%")
    assert table["relative_standard_uncertainty"][load] == pytest.approx(0.003)


@pytest.mark.long
def test_copies_for_excel_are_of_this_calibration_or_not_there(folder):
    """Those of an earlier one were of other numbers than the tables beside them."""
    text = (folder / "images_excel.csv").read_bytes()
    assert text.startswith(b"\xef\xbb\xbffile;load_n;order;")
    assert (folder / "budget_excel.csv").is_file()
    (folder / "own_excel.csv").write_text("a;b\n", "utf-8")
    calibrate(folder.parent)
    assert {p.name for p in folder.glob("*.csv")} == {"images.csv", "budget.csv", "own_excel.csv"}
