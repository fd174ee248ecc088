"""Every command as a user runs it, in a folder with letters beyond ASCII."""

import csv
import json
import shlex
import subprocess
import sys
import tomllib
from importlib.metadata import version

import numpy as np
import pytest
import tifffile
from typer.main import get_command

from isochrome.cli import app
from isochrome.cli.options import EXAMPLES, examples_of
from isochrome.frames import open_tiff

COMMANDS = [
    (), ("demo",), ("simulate",), ("process",), ("compare",), ("calibrate",),
    ("calibrate", "bending"), ("calibrate", "disc"), ("calibrate", "colour"),
    ("calibrate", "scale"), ("calibrate", "wear"), ("fit",), ("check",), ("setup",), ("bench",),
    ("sweep",), ("plan",), ("export",), ("report",), ("verify",), ("guide",), ("init",),
]  # fmt: skip

HISTORY = (
    "state", "distance_m", "p_max_mpa", "contact_width_mm", "wear_depth_um", "worn_area_mm2",
    "n_max", "n_max_x_mm", "n_max_z_mm",
)  # fmt: skip

HEAVY = ("numpy", "scipy", "matplotlib", "skimage", "cv2", "pydantic")


def columns_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def files_in(folder):
    found = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    return {"run.zarr" if name.startswith("run.zarr/") else name for name in found}


@pytest.fixture(scope="module")
def processed(captured, run_in):
    """The small scene's frames, processed by the command; the folder and what was printed."""
    done = run_in(
        captured, "process", "Bild ü/frames.tif", "--scene", "small.toml", "--out", "Ergebnis",
        "--json",
    )  # fmt: skip
    assert (done.code, done.err) == (0, "")
    return captured, done.json()


def test_help_imports_nothing_heavy():
    code = (
        "import sys\n"
        "sys.argv = ['isochrome', '--help']\n"
        "from isochrome.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print([m for m in {HEAVY!r} if m in sys.modules], file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, encoding="utf-8"
    )
    assert done.stderr.strip() == "[]"


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: " ".join(c) or "isochrome")
def test_help_of_every_command(quick_isochrome, command):
    done = quick_isochrome(*command, "--help")
    assert (done.code, done.err) == (0, "") and "Usage: " in done.out
    if command in ((), ("calibrate",)):
        names = [c[-1] for c in COMMANDS if c[:-1] == command and c]
        assert all(name in done.out for name in names)
    else:
        assert "--json" in done.out
        assert ("--out FOLDER" in done.out or "--out  " in done.out) == (
            command not in (("check",), ("guide",), ("setup",), ("verify",))
        )
        shown = " ".join(done.out.split())
        assert all(example in shown for example in examples_of(" ".join(command)).split("\n\n"))


def test_every_command_has_two_examples_and_their_options_are_its_own():
    """What an example names is read by the command's own parser, which refuses what it lacks."""
    by_command = {
        words: examples_of(words).split("\n\n")[1:]
        for words in {" ".join(c) for c in COMMANDS} - {"", "calibrate"}
    }
    assert sum(map(len, by_command.values())) == len(EXAMPLES.splitlines())
    for words, examples in by_command.items():
        assert len(examples) == 2
        for line in examples:
            program, *arguments = shlex.split(line)
            assert program == "isochrome" and len(line) <= 78, line
            assert " ".join(arguments[: len(words.split())]) == words
            command = get_command(app)
            for word in words.split():
                command = command.commands[word]
            command.make_context(words, arguments[len(words.split()) :])


def test_help_names_the_completion_and_the_version_is_the_packages(quick_isochrome):
    done = quick_isochrome("--version")
    assert (done.code, done.out, done.err) == (0, f"isochrome {version('isochrome')}\n", "")
    assert "--install-completion" in quick_isochrome("--help").out


def test_simulate_leaves_what_the_contract_names(captured):
    out = captured / "Bild ü"
    assert files_in(out) == {
        "history.csv", "frames.tif", "fringe_order.tif", "pressure.csv", "scene.toml",
        "provenance.json", "simulation.png", "report.html",
    }  # fmt: skip
    history = columns_of(out / "history.csv")
    assert set(HISTORY) <= set(history) and history["distance_m"] == ["0", "77"]
    assert float(history["wear_depth_um"][1]) == pytest.approx(2.477, abs=0.01)
    pressure = columns_of(out / "pressure.csv")
    assert set(pressure) == {"state", "x_mm", "pressure_mpa", "shear_mpa", "wear_depth_um"}
    for name, dtype in (("frames.tif", np.uint8), ("fringe_order.tif", np.float32)):
        stack = tifffile.imread(out / name)
        assert (stack.shape, stack.dtype) == ((2, 120, 160), dtype)
        assert open_tiff(out / name).pixel_mm == pytest.approx(0.025, rel=1e-6)
    assert tomllib.loads((out / "scene.toml").read_text("utf-8"))["load"] == {"normal_n": 44.0}
    came = json.loads((out / "provenance.json").read_text("utf-8"))
    assert came["seed"] == 3 and came["isochrome"] == version("isochrome")


@pytest.mark.long
def test_process_leaves_what_the_contract_names(processed):
    folder, found = processed
    out = folder / "Ergebnis"
    assert files_in(out) == {
        "frames.csv", "fringe_order.tif", "confidence.tif", "normalised.tif", "scene.toml",
        "fitted_scene.toml", "provenance.json", "process.png", "report.html", "run.zarr",
        *(f"records/{k:08d}.json" for k in range(2)),
    }  # fmt: skip
    for name in ("fringe_order", "confidence", "normalised"):
        stack = tifffile.imread(out / f"{name}.tif")
        assert (stack.shape, stack.dtype) == ((2, 120, 160), np.float32)
        assert open_tiff(out / f"{name}.tif").pixel_mm == pytest.approx(0.025, rel=1e-6)
    table = columns_of(out / "frames.csv")
    assert set(table) == set(found["frames"])
    assert found["model"] == "contact" and found["warnings"] == []
    for chi in found["frames"]["chi"]:
        assert 0.95 < chi < 1.05


@pytest.mark.process_too
def test_check_finds_nothing_wrong_with_simulated_frames(quick_isochrome):
    done = quick_isochrome("check", "frames.tif", "--scene", "small.toml")
    assert (done.code, done.err) == (0, "") and done.out.endswith("2 frames read: no error found\n")


@pytest.mark.study
def test_demo_runs_from_anywhere(isochrome, place):
    done = isochrome("demo", "--out", "Vorführung", "--json")
    assert done.code == 0
    summary = done.json()
    assert max(summary["metrics"]["order_rms_fringe"]) < 0.01
    assert len(summary["film"]["load.normal_n"]) == 23
    said = {text for part in ("frames", "film") for text in summary[part]["warnings"] if text}
    assert said and all(any(text in whole for whole in summary["warnings"]) for text in said)
    assert (place / "Vorführung" / "comparison" / "comparison.png").is_file()
