"""The command line as a user runs it: another process, in a folder with an awkward name."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from commands import exit_code
from scene_texts import SMALL_CAMERA, WORN_CONTACT

SMALL_SCENE = WORN_CONTACT + SMALL_CAMERA + "noise_grey = 2.0\nseed = 3\n"


@dataclass(frozen=True)
class Run:
    """What a command said, and its exit code."""

    code: int
    out: str
    err: str

    def json(self) -> dict:
        """The one JSON object on standard output: anything more is an error."""
        assert self.out.endswith("\n") and "\n" not in self.out[:-1]
        found = json.loads(self.out)
        assert isinstance(found, dict)
        return found


def run_isochrome(folder: Path, *arguments: str) -> Run:
    """Run `python -m isochrome` in a folder, without a terminal and without the tests' settings."""
    env = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "PYTHONWARNINGS")}
    command = [sys.executable, "-m", "isochrome", *arguments]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, encoding="utf-8", check=False,
        timeout=600, env=env | {"PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    return Run(done.returncode, done.stdout, done.stderr)


@pytest.fixture(scope="session")
def run_in():
    """Run a command in a given folder."""
    return run_isochrome


@pytest.fixture(scope="session")
def captured(tmp_path_factory):
    """A folder with the small scene and its two frames, simulated by the command itself."""
    folder = tmp_path_factory.mktemp("captured")
    folder = folder / "Läufe und 場 1"
    folder.mkdir()
    (folder / "small.toml").write_text(SMALL_SCENE, "utf-8")
    done = run_isochrome(folder, "simulate", "small.toml", "--out", "Bild ü")
    assert (done.code, done.err) == (0, "")
    return folder


@pytest.fixture
def place(tmp_path, captured):
    """An empty folder to work in, named with a space and letters beyond ASCII."""
    folder = tmp_path / "Mess reihe ÄΩ場"
    folder.mkdir()
    (folder / "small.toml").write_text(SMALL_SCENE, "utf-8")
    (folder / "frames.tif").write_bytes((captured / "Bild ü" / "frames.tif").read_bytes())
    return folder


@pytest.fixture
def scene_with(place):
    """Write the small scene with some text replaced, or added at the end; returns its name."""

    def write(old, new=None, name="wrong scene.toml", encoding="utf-8"):
        text = (place / "small.toml").read_text("utf-8")
        assert new is None or text.count(old) == 1
        text = text + old if new is None else text.replace(old, new)
        (place / name).write_text(text, encoding)
        return name

    return write


@pytest.fixture
def isochrome(place):
    """Run a command in the folder, as another process."""
    return lambda *arguments: run_isochrome(place, *arguments)


def pytest_generate_tests(metafunc):
    """Where a test is marked `process_too`, its commands run as another process as well."""
    if "quick_isochrome" in metafunc.fixturenames:
        ways = ["here"]
        if metafunc.definition.get_closest_marker("process_too"):
            ways.append(pytest.param("process", marks=pytest.mark.study))
        metafunc.parametrize("quick_isochrome", ways, indirect=True)


@pytest.fixture
def quick_isochrome(request, place, monkeypatch, capfd):
    """Run a command in the folder: in this process for speed, or in another one."""
    if request.param == "process":
        return lambda *arguments: run_isochrome(place, *arguments)
    monkeypatch.chdir(place)

    def run(*arguments):
        capfd.readouterr()
        return Run(exit_code(monkeypatch, *arguments), *capfd.readouterr())

    return run
