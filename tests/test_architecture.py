"""The rooms of the house keep their order: what imports what, read from the source."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
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

TOP = ("demo", "bench", "console", "cli", "__main__", "samples")
"""Rooms at the right end: they compose all the others, and only they import each other."""

SIMULATION = ("contact", "stress", "optics", "simulate")

HEAVY = ("matplotlib", "cv2", "skimage", "tifffile", "scipy.optimize")


def modules() -> list[Path]:
    return sorted(p for p in HOUSE.rglob("*.py"))


def room_of(path: Path) -> str:
    return path.relative_to(HOUSE).parts[0].removesuffix(".py")


def of_room(room: str) -> list[Path]:
    """The modules of a room, of which there are some."""
    found = [p for p in modules() if room_of(p) == room]
    assert found, f"there is no room {room}"
    return found


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


def test_every_room_has_its_place():
    """A new one is given a place in the order, or an old one is used; none that is gone is left."""
    assert {room_of(p) for p in modules()} == {"__init__", *TOP, *ORDER}


@pytest.mark.parametrize("room", ORDER)
def test_a_room_imports_only_from_rooms_to_its_left(room):
    allowed = ORDER[: ORDER.index(room) + 1]
    wrong = {
        path.relative_to(HOUSE).as_posix(): sorted(others)
        for path in of_room(room)
        if (others := imports_of(path).difference(allowed))
    }
    assert not wrong, f"imports from rooms to the right of {room}, or at the top: {wrong}"


@pytest.mark.parametrize("leaf", LEAVES)
def test_leaves_know_nothing_of_scenes(leaf):
    used = set().union(*(imports_of(p) for p in of_room(leaf))) - {leaf}
    assert used <= set(LEAVES)


def test_reading_frames_needs_no_simulation():
    used = set().union(*(imports_of(p) for p in of_room("frames")))
    assert not used & set(SIMULATION)


DOORS = ("cli", "scene", "contact", "stress", "optics", "simulate", "output", "runs")


def test_no_drawing_or_image_library_is_imported_before_it_is_needed():
    """One door after the other: the first that lets one in is named."""
    code = f"""
import importlib, sys
for door in {DOORS!r}:
    importlib.import_module("isochrome." + door)
    print(door, *(m for m in {HEAVY!r} if m in sys.modules))
"""
    assert printed_by(code).splitlines() == list(DOORS)


def printed_by(code: str) -> str:
    """What a fresh interpreter prints."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("room", sorted({room_of(p) for p in modules()}))
def test_a_module_is_short_and_its_public_things_are_described(room):
    faults = [
        f"{path.relative_to(HOUSE).as_posix()}: {fault}"
        for path in of_room(room)
        for fault in faults_of(path)
    ]
    assert not faults, "\n".join(faults)


def faults_of(path: Path) -> Iterator[str]:
    """What is wrong with a module."""
    text = path.read_text("utf-8")
    tree = ast.parse(text)
    if len(text.splitlines()) > 300:
        yield "more than 300 lines hold more than one thing"
    if not ast.get_docstring(tree):
        yield "no docstring"
    if path.stem.startswith("_") and path.stem != "__init__":
        return  # a private module
    for name, node in described(tree):
        if not ast.get_docstring(node):
            yield f"{name} has no docstring"


def described(tree: ast.Module) -> Iterator[tuple[str, ast.AST]]:
    """The public functions, classes and methods of a module, with their names."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    for node in tree.body:
        if isinstance(node, kinds) and not node.name.startswith("_"):
            yield node.name, node
            inside = node.body if isinstance(node, ast.ClassDef) else []
            for inner in inside:
                if isinstance(inner, kinds) and not inner.name.startswith("_"):
                    yield f"{node.name}.{inner.name}", inner


COMMANDS = ("process", "simulate", "fit", "compare", "sweep")

AS_FUNCTIONS = f"""
import importlib, sys
for name in {COMMANDS!r}:
    for again in (1, 2):
        for module in [m for m in sys.modules if m.split(".")[0] == "isochrome"]:
            del sys.modules[module]  # as in an interpreter that has not heard of it
        isochrome = importlib.import_module("isochrome")
        for _ in range(again):
            getattr(isochrome, name)
        space = dict()
        exec("from isochrome import " + name + " as command", space)
        importlib.import_module("isochrome." + name + ".run")
        for function in (space["command"], getattr(isochrome, name)):
            try:
                function()
            except TypeError as error:
                print(error)
"""


def test_a_command_is_a_function_of_the_package_however_it_is_come_by():
    """The package has rooms of the same names, which importing puts in the functions' places."""
    said = [f"{name}() missing" for name in COMMANDS for _ in range(4)]
    lines = printed_by(AS_FUNCTIONS).splitlines()
    assert [line[: len(start)] for line, start in zip(lines, said, strict=True)] == said
