"""The rooms of the house keep their order: what imports what, read from the source."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import isochrome

HOUSE = Path(isochrome.__file__).parent

LEAVES = ("errors", "progress", "output", "runs", "figures", "reference")
"""Rooms that anybody to their right may use; they know nothing but each other."""

ORDER = (
    "errors",
    "progress",
    "reference",
    "output",
    "runs",
    "figures",
    "scene",
    "contact",
    "stress",
    "optics",
    "simulate",
    "sweep",
    "frames",
    "fit",
    "fringes",
    "calibrate",
    "process",
    "campaign",  # many recordings, each by `process`
    "compare",
)
"""From left to right; a room imports only from rooms to its left."""

TOP = ("demo", "bench", "console", "cli", "__main__", "check", "samples")
"""Rooms at the right end: they compose all the others, and only they import each other."""

SIMULATION = ("contact", "stress", "optics", "simulate")

HEAVY = ("matplotlib", "cv2", "skimage", "tifffile", "scipy.optimize")


def modules() -> list[Path]:
    return sorted(p for p in HOUSE.rglob("*.py"))


def room_of(path: Path) -> str:
    return path.relative_to(HOUSE).parts[0].removesuffix(".py")


def imports_of(path: Path) -> set[str]:
    """Rooms that a module imports from, wherever in it the import stands."""
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import; write it in full"
            names = [node.module or ""]
            if node.module == "isochrome":
                names = [f"isochrome.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        rooms |= {n.split(".")[1] for n in names if n.startswith("isochrome.")}
    return rooms


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(HOUSE)))
def test_a_room_imports_only_from_rooms_to_its_left(path):
    room = room_of(path)
    if room in ("__init__", *TOP):
        return
    assert room in ORDER, f"{room} is a new room: give it a place in the order, or use an old one"
    wrong = {
        other
        for other in imports_of(path) - {room}
        if other not in ORDER or ORDER.index(other) > ORDER.index(room)
    }
    assert not wrong, f"{path.relative_to(HOUSE)} imports {sorted(wrong)}, to the right of {room}"


@pytest.mark.parametrize("leaf", LEAVES)
def test_leaves_know_nothing_of_scenes(leaf):
    inside = [p for p in modules() if room_of(p) == leaf]
    assert inside
    used = set().union(*(imports_of(p) for p in inside)) - {leaf}
    assert used <= set(LEAVES)


def test_reading_frames_needs_no_simulation():
    used = set().union(*(imports_of(p) for p in modules() if room_of(p) == "frames"))
    assert not used & set(SIMULATION)


def test_the_command_line_imports_nothing_heavy_before_it_is_needed():
    if not any((HOUSE / name).exists() for name in ("cli.py", "cli")):
        pytest.skip("no command line yet")
    code = f"import sys, isochrome.cli; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "room", ["scene", "contact", "stress", "optics", "simulate", "output", "runs"]
)
def test_a_room_imports_no_drawing_or_image_library_at_its_door(room):
    code = f"import sys, isochrome.{room}; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(HOUSE)))
def test_a_module_is_short_and_its_public_things_are_described(path):
    text = path.read_text("utf-8")
    # beyond 300 lines a module holds more than one thing
    assert len(text.splitlines()) <= 300
    tree = ast.parse(text)
    assert ast.get_docstring(tree), f"{path.name} has no docstring"
    if path.stem.startswith("_") and path.stem != "__init__":
        return  # a private module
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    for node in tree.body:
        if isinstance(node, kinds) and not node.name.startswith("_"):
            assert ast.get_docstring(node), f"{path.name}: {node.name} has no docstring"
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for inner in node.body:
                if isinstance(inner, kinds) and not inner.name.startswith("_"):
                    assert ast.get_docstring(inner), f"{path.name}: {node.name}.{inner.name}"


@pytest.mark.parametrize("again", [1, 2])
@pytest.mark.parametrize("name", ["process", "simulate", "fit", "compare", "sweep"])
def test_a_command_is_a_function_of_the_package_however_it_is_come_by(name, again):
    """The package has rooms of the same names, which importing puts in the functions' places."""
    code = (
        f"import isochrome; isochrome.{name}; " * again
        + f"""
from isochrome import {name} as command
import isochrome.{name}.run
for function in (command, isochrome.{name}):
    try:
        function()
    except TypeError as error:
        print(error)
"""
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.count(f"{name}() missing") == 2, done.stdout
