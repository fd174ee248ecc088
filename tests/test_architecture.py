"""The rooms of the house keep their order: what imports what, read from the source."""

import ast
import importlib
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from package_code import HOUSE, modules, nodes, parsed

ROOMS = sorted({p.relative_to(HOUSE).parts[0].removesuffix(".py") for p in modules()})

LEAVES = ("messages", "errors", "progress", "output", "runs", "figures", "reference")
"""Rooms that anybody to their right may use; they know nothing but each other."""

ORDER = (
    "messages",
    "errors",
    "progress",
    "guide",
    "reference",
    "output",
    "runs",
    "figures",
    "scene",
    "reporting",
    "contact",
    "stress",
    "optics",
    "specimens",
    "simulation",
    "sweeps",
    "frames",
    "estimation",
    "scars",
    "fitting",
    "planning",
    "fringes",
    "calibration",
    "processing",
    "drafting",
    "setup_page",
    "campaigns",  # many recordings, each by `process`
    "comparison",
)
"""From left to right; a room imports only from rooms to its left."""

TOP = ("demonstration", "folder_report", "benchmarks", "console", "cli", "__main__", "samples")
"""Rooms at the right end: they compose all the others, and only they import each other."""

SIMULATION = ("contact", "stress", "optics", "specimens", "simulation")

HEAVY = ("matplotlib", "cv2", "skimage", "tifffile", "scipy.optimize")


def room_of(path: Path) -> str:
    return path.relative_to(HOUSE).parts[0].removesuffix(".py")


def of_room(room: str) -> list[Path]:
    """The modules of a room, of which there are some."""
    found = [p for p in modules() if room_of(p) == room]
    assert found, f"there is no room {room}"
    return found


@cache
def imports_of(path: Path) -> set[str]:
    """Rooms that a module imports from, wherever in it the import stands."""
    rooms = set()
    for node in nodes(path):
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


SPECIMENS = {"contact", "half-plane", "block", "disc", "ring", "beam"}


def test_nobody_compares_with_a_specimens_name():
    """What differs from specimen to specimen is asked of its model, or of the scene."""
    found = [
        f"{path.relative_to(HOUSE).as_posix()}:{node.lineno}"
        for path in modules()
        if room_of(path) not in ("specimens", "scene")
        for node in nodes(path)
        if isinstance(node, ast.Compare | ast.MatchValue)
        and SPECIMENS & {c.value for c in ast.walk(node) if isinstance(c, ast.Constant)}
    ]
    assert not found


DOORS = ("cli", "scene", "contact", "stress", "optics", "simulation", "output", "runs")


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


MOST_MODULES, LONGEST, SHORTEST = 14, 800, 60
"""Modules in a folder, lines of a module, and lines of one that a single other module imports."""

FRONT = ("api", "result", "figure", "folder", "settings")
"""Modules that stand in several rooms, and mean the same in each."""

AN_INTERFACE = "specimens"
"""A folder whose modules are alike: one a specimen, however short."""


def test_a_folder_holds_few_modules():
    counts = Counter(p.parent for p in modules() if p.stem != "__init__")
    full = {f.relative_to(HOUSE).as_posix(): n for f, n in counts.items() if n > MOST_MODULES}
    assert not full


def test_a_module_that_one_other_imports_is_worth_its_file():
    importers = Counter(name for p in modules() for name in modules_imported_by(p))
    small = {
        p.relative_to(HOUSE).as_posix()
        for p in modules()
        if p.stem not in (*FRONT, "__init__", "__main__")
        and p.parent.name != AN_INTERFACE
        and len(p.read_text("utf-8").splitlines()) < SHORTEST
        and importers[dotted(p)] <= 1
    }
    assert not small


def dotted(path: Path) -> str:
    """The full name of a module."""
    return ".".join(("isochrome", *path.relative_to(HOUSE).with_suffix("").parts))


def modules_imported_by(path: Path) -> set[str]:
    """Modules from which a module takes names, those behind front doors included."""
    return {
        behind_the_door(node.module or "", alias.name)
        for node in nodes(path)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


@cache
def behind_the_door(module: str, name: str) -> str:
    """The module that a front door takes a name from; `module` itself where it is no door."""
    stub = HOUSE.joinpath(*module.split(".")[1:]) / "__init__.pyi"
    if not module.startswith("isochrome") or not stub.is_file():
        return module
    for node in parsed(stub).body:
        if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
            return behind_the_door(f"{module}.{node.module}", name)
    return f"{module}.{name}"


def test_module_names_stand_once():
    """But for those that mean the same in every room."""
    names = Counter(p.stem for p in modules() if p.stem not in (*FRONT, "__init__", "__main__"))
    assert not [name for name, count in names.items() if count > 1]


def test_public_names_stand_once():
    """A class or function that others may use has a name of its own in the whole package."""
    names = Counter(
        node.name
        for p in modules()
        if p.stem != "__main__"
        for node in parsed(p).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
    )
    assert not [name for name, count in names.items() if count > 1]


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_is_entered_by_its_front_door(room):
    """What a room takes from another stands in the other's stub, and is imported from there."""
    inside = {
        f"{path.relative_to(HOUSE).as_posix()}: {node.module}"
        for path in of_room(room)
        for node in nodes(path)
        if isinstance(node, ast.ImportFrom)
        and (parts := (node.module or "").split("."))[0] == "isochrome"
        and len(parts) > 2
        and parts[1] != room
    }
    assert not inside


def test_a_front_door_offers_what_it_lists():
    """Each name of each stub is there, and its `__all__` is what it imports."""
    stubs = sorted(HOUSE.rglob("__init__.pyi"))
    assert len(stubs) > 15
    for stub in stubs:
        tree = parsed(stub)
        names = [a.name for n in tree.body if isinstance(n, ast.ImportFrom) for a in n.names]
        door = importlib.import_module(dotted(stub).removesuffix(".__init__"))
        assert sorted(set(door.__all__) - {"__version__"}) == sorted(names)
        assert set(names) <= set(dir(door))
        for name in set(names) - {
            "reference",
            "samples",
        }:  # whose functions are named after the samples
            assert not isinstance(getattr(door, name), ModuleType), f"{stub}: {name}"


@pytest.mark.parametrize("room", ROOMS)
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
    tree = parsed(path)
    if len(text.splitlines()) > LONGEST:
        yield f"more than {LONGEST} lines"
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


MOST_BY_POSITION = 6
"""Fields of a dataclass that may be built without their names."""


def test_a_dataclass_of_many_fields_is_built_by_keyword():
    """But for a list that only gets shorter."""
    found = {
        path.relative_to(HOUSE).as_posix()
        for path in modules()
        for node in nodes(path)
        if isinstance(node, ast.ClassDef) and built_by_position(node)
    }
    assert not found, "give kw_only=True to their large dataclasses"


def built_by_position(node: ast.ClassDef) -> bool:
    """Whether a class is a dataclass of many fields that may be given without their names."""
    decorators = [d for d in node.decorator_list if "dataclass" in ast.unparse(d)]
    fields = [f for f in node.body if isinstance(f, ast.AnnAssign)]
    fields = [f for f in fields if "ClassVar" not in ast.unparse(f.annotation)]
    by_name = any("kw_only=True" in ast.unparse(d) for d in decorators)
    return bool(decorators) and len(fields) > MOST_BY_POSITION and not by_name


COMMANDS = ("process", "simulate", "fit", "compare", "sweep")

HOMES = {
    "process": "isochrome.processing.api", "simulate": "isochrome.simulation.api",
    "fit": "isochrome.fitting.api", "compare": "isochrome.comparison.api",
    "sweep": "isochrome.sweeps.api",
}  # fmt: skip

AS_FUNCTIONS = f"""
import importlib, sys
HOMES = {HOMES!r}
for name in {COMMANDS!r}:
    for again in (1, 2):
        for module in [m for m in sys.modules if m.split(".")[0] == "isochrome"]:
            del sys.modules[module]  # as in an interpreter that has not heard of it
        isochrome = importlib.import_module("isochrome")
        for _ in range(again):
            getattr(isochrome, name)
        space = dict()
        exec("from isochrome import " + name + " as command", space)
        importlib.import_module(HOMES[name])
        for function in (space["command"], getattr(isochrome, name)):
            try:
                function()
            except TypeError as error:
                print(error)
"""


@pytest.mark.long
def test_a_command_is_a_function_of_the_package_however_it_is_come_by():
    """Importing the room that holds it does not put a module in the function's place."""
    said = [f"{name}() missing" for name in COMMANDS for _ in range(4)]
    lines = printed_by(AS_FUNCTIONS).splitlines()
    assert [line[: len(start)] for line, start in zip(lines, said, strict=True)] == said


MOST_IMPORTED = 150
"""Modules of ours that a contact's simulation may import, of some 350: the others wait."""


@pytest.mark.long
def test_a_contact_run_imports_what_it_needs():
    code = """
import sys, isochrome
scene = isochrome.load_scene("line-contact-wear")
scene = scene.model_copy(update={"wear": None})
isochrome.simulate(scene)
print(len([name for name in sys.modules if name.split(".")[0] == "isochrome"]))
"""
    assert int(printed_by(code)) <= MOST_IMPORTED


SIZES = {"fontsize", "labelsize", "size_pt", "lw", "linewidth", "linewidths", "mew"}
"""Keywords of a drawing that are a number of points."""

COLOURS_OF = {"color", "colour", "c", "facecolor", "edgecolor", "mfc", "cmap"}
"""Keywords of a drawing that are a colour, or a map of colours."""

A_COLOUR = re.compile(r"#[0-9a-fA-F]{3,8}|C\d")

NO_COLOUR = {"none", "white"}
"""What a marker is filled with that is open."""


def looks_of(walked: Iterable[ast.AST]) -> Iterator[str]:
    """Sizes and colours that a module sets by a literal of its own."""
    for node in walked:
        pairs: list[tuple[object, ast.expr]] = []
        if isinstance(node, ast.keyword):
            pairs = [(node.arg, node.value)]
        elif isinstance(node, ast.Dict):
            pairs = [(k.value, v) for k, v in zip(node.keys, node.values, strict=True)
                     if isinstance(k, ast.Constant)]  # fmt: skip
        elif isinstance(node, ast.Constant) and A_COLOUR.fullmatch(str(node.value)):
            yield f"{node.lineno}: {node.value}"
        for name, value in pairs:
            if not isinstance(value, ast.Constant) or value.value in (None, True):
                continue
            if name in SIZES and value.value != 0:  # no line at all is no look
                yield f"{value.lineno}: {name} = {value.value}"
            if name in COLOURS_OF and value.value not in NO_COLOUR:
                yield f"{value.lineno}: {name} = {value.value!r}"


def drawing(path: Path) -> bool:
    """Whether a module draws: it imports the figures' room."""
    return "figures" in imports_of(path) or room_of(path) == "figures"


def test_one_file_holds_the_look_of_all_figures():
    """Sizes, widths and colours stand in `figures/style.py`, and so do heads and legends."""
    found = {}
    for path in modules():
        if not drawing(path) or path.name == "style.py":
            continue
        faults = list(looks_of(nodes(path)))
        faults += [
            f"{node.lineno}: {node.func.attr}"
            for node in nodes(path)
            if isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in ("suptitle", "legend")
        ]
        if faults:
            found[path.relative_to(HOUSE).as_posix()] = faults
    assert not found
