"""Files that a command leaves besides its results: a figure for a paper, tables for Excel."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import isochrome
from isochrome.cli import app
from isochrome.output import write_csv, write_excel_copies

RING = {
    "load.normal_n": 60.0, "camera.width_px": 96, "camera.height_px": 96,
    "camera.pixel_mm": 0.48, "camera.noise_grey": 1.0,
}  # fmt: skip


@pytest.fixture
def scene(tmp_path) -> Path:
    path = tmp_path / "ring.toml"
    path.write_text(isochrome.dump_scene(isochrome.load_scene("ring").with_values(RING)), "utf-8")
    return path


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.output + str(done.exception or "")


def test_a_figure_for_a_paper_and_tables_for_excel_stand_beside_the_results(scene, tmp_path):
    out = tmp_path / "out"
    code, _ = run("simulate", scene, "--out", out)
    plain = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    code, text = run(
        "simulate", scene, "--out", out, "--width", "8.5cm", "--format", "SVG", "--csv", "excel",
        "--json",
    )  # fmt: skip
    assert code == 0 and json.loads(text)["figures"] == [str(out / "figure_85mm.svg")]
    left = {path.name for path in out.iterdir() if path.is_file()} - set(plain)
    assert left == {"figure_85mm.svg", "history_excel.csv", "pressure_excel.csv"}
    assert all((out / name).read_bytes() == content for name, content in plain.items())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--width", "wide"), "--width wide: give a width with its unit"),
        (("--width", "10mm"), "width = 10 mm"),
        (("--frames", "0;2"), "--frames 0;2: give whole numbers"),
        (("--format", "bmp"), "format = bmp"),
        (("--dpi", "3"), "dpi = 3"),
        (("--csv", "word"), "--csv word"),
    ],
)
def test_what_cannot_be_is_refused_before_the_work(scene, tmp_path, words, said):
    code, text = run("simulate", scene, "--out", tmp_path / "out", *words)
    assert code and said in text and not (tmp_path / "out").exists()


def test_a_table_for_excel_has_semicolons_decimal_commas_and_a_mark(tmp_path):
    columns = {
        "label": ["1.5; two", "v1.2.3", "3,4"], "load_n": [1.5, -2e-9, float("nan")],
        "frame": [0, 1, 2],
    }  # fmt: skip
    write_csv(tmp_path / "frames.csv", columns)
    before = (tmp_path / "frames.csv").read_bytes()
    assert write_excel_copies(tmp_path) == [tmp_path / "frames_excel.csv"]
    text = (tmp_path / "frames_excel.csv").read_bytes()
    assert text == (
        b'\xef\xbb\xbflabel;load_n;frame\r\n"1.5; two";1,5;0\r\nv1.2.3;-2e-09;1\r\n3,4;;2\r\n'
    )
    assert write_excel_copies(tmp_path) == [tmp_path / "frames_excel.csv"]  # no copy of a copy
    assert (tmp_path / "frames.csv").read_bytes() == before


def test_an_exported_table_is_for_excel_too(scene, tmp_path):
    isochrome.sweep(scene, {"load.normal_n": [60.0]}, tmp_path / "loads")
    (plain,) = isochrome.export(tmp_path / "loads", "csv")
    (file,) = isochrome.export(tmp_path / "loads", "excel")
    assert file.name == "run_excel.csv" and plain.is_file()
    first, *rest = file.read_text("utf-8-sig").splitlines()
    assert len(first.split(";")) == len(plain.read_text("utf-8").splitlines()[0].split(","))
    assert rest
