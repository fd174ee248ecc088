"""The init command: options, questions on a terminal, and one JSON object."""

import json
import sys

import pytest
from typer.testing import CliRunner

from isochrome import drafting
from isochrome.cli import app
from isochrome.errors import InputError
from isochrome.samples import samples_path

DISC = str(samples_path() / "disc" / "disc-560N.png")
GIVEN = ["--shape", "other", "--pixel-mm", "0.13"]


def run(*words, **more):
    return CliRunner().invoke(app, ["init", DISC, *words], **more)


def test_a_scene_is_written_and_what_is_open_is_said(tmp_path):
    result = run(*GIVEN, "--out", str(tmp_path))
    assert result.exit_code == 0 and "to fill in: specimen.thickness_mm" in result.stdout
    assert (tmp_path / "scene.toml").is_file() and (tmp_path / "scene.png").is_file()


def test_json_is_one_object_with_the_values_and_their_origin(tmp_path):
    result = run(*GIVEN, "--out", str(tmp_path), "--json")
    found = json.loads(result.stdout)
    pixel = next(value for value in found["values"] if value["key"] == "camera.pixel_mm")
    assert pixel["value"] == 0.13 and pixel["origin"] == "given" and found["out"] == str(tmp_path)


def test_a_scene_that_is_there_stays_without_replace(tmp_path):
    (tmp_path / "scene.toml").write_text("mine")
    result = run(*GIVEN, "--out", str(tmp_path))
    assert isinstance(result.exception, InputError) and "--replace" in str(result.exception)
    assert (tmp_path / "scene.toml").read_text() == "mine"
    assert run(*GIVEN, "--out", str(tmp_path), "--replace").exit_code == 0


@pytest.mark.parametrize("terminal", [True, False])
def test_what_is_not_given_is_asked_for_on_a_terminal_alone(monkeypatch, terminal):
    """Thickness and load are asked for, in this order; the diameter is given."""
    asked = {}

    def take(frames, known, out, *, replace):
        asked.update(known)
        raise InputError("enough")

    monkeypatch.setattr(drafting, "init", take)
    monkeypatch.setattr("isochrome.cli.sys", FakeSystem(terminal))
    words = ["--shape", "disc", "--diameter-mm", "50", "--fringe-value-n-per-mm", "14.6"]
    result = run(*words, input="6\n560\n")
    assert str(result.exception) == "enough"
    assert (asked.get("thickness_mm"), asked.get("load_n")) == (
        (6.0, 560.0) if terminal else (None,) * 2
    )
    assert ("thickness of the specimen along the light (mm), usually" in result.output) == terminal


class FakeSystem:
    """`sys` whose standard input is a terminal, or none."""

    def __init__(self, terminal):
        self.stdin = type("Input", (), {"isatty": lambda _: terminal})()
        self.argv = sys.argv
