"""Docstrings: numpydoc's form for what users import and are given, whose examples run; else short.

Users import the names of the package, and of its rooms `reference` and `samples`. They are given
the classes that these return, with all that hangs on them, and write the keys of scenes and sets.
"""

import ast
import doctest
import importlib
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from numpydoc.docscrape import get_doc_object
from numpydoc.validate import validate
from pydantic import BaseModel

import isochrome
from package_code import HOUSE, modules, nodes, parsed

EXPORTED = sorted(set(isochrome.__all__) - {"__version__", "reference", "samples"})

LEFT_OUT = {
    "GL01": "the summary begins on the line of the quotes, as in all the code",
    "SA01": "the pages name related functions where they are of use, in the text",
}
"""Checks of numpydoc that are not asked for, and why."""

NOT_OF_OTHERS = {
    "EX01": "examples are for what users call: the exports of the package itself",
    "ES01": "one sentence is enough for many of them",
}
"""Checks that are asked for of the package's own exports alone."""

DOORS = ("reference", "samples")
"""Rooms that users import besides the package itself."""

SETTINGS = {"scene": ("Scene",), "calibration": ("CalibrationSet", "ColourSet", "WearSet")}
"""Files that users write: the docstrings of their tables are the words of their keys."""

PARTS = {
    "isochrome.calibration": ("ImageFit", "MeasuredValue", "ScalePicture", "WornDistance"),
    "isochrome.calibration.wear_coefficient": ("WearLawFit",),
    "isochrome.comparison": ("ComparedFrames", "FrameMetrics", "ScarPair"),
    "isochrome.contact": ("ContactGrid", "SurfaceState"),
    "isochrome.drafting": ("DraftValue", "OpenKey"), "isochrome.estimation": ("BudgetInput",),
    "isochrome.frames": ("Finding", "Frame"), "isochrome.output": ("FrameValues",),
    "isochrome.scene": ("ArrayFrames", "FreeCorner"),
}  # fmt: skip
"""Parts of results whose values users read, where they stand."""

LINES = 5
"""Lines that a docstring of all else may have, blank ones apart."""

NOT_YET = ("fitting/causes/", "fitting/tractions.py")
"""Where docstrings of inner names are still long: this list only gets shorter."""

every_export = pytest.mark.parametrize("name", EXPORTED)


def faults_of(path: str) -> list[tuple[str, str]]:
    """What numpydoc finds wrong with a docstring, but for what is left out."""
    return [fault for fault in validate(path)["errors"] if fault[0] not in LEFT_OUT]


def raises(function: Any) -> bool:
    """Whether a function itself has a raise statement with an exception of its own."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    return any(isinstance(node, ast.Raise) and node.exc for node in ast.walk(tree))


@every_export
def test_a_docstring_has_numpydocs_form_and_says_every_parameter(name):
    assert faults_of(f"isochrome.{name}") == []


@every_export
def test_a_function_that_raises_says_what(name):
    exported = getattr(isochrome, name)
    if raises(exported):
        assert [entry.type for entry in get_doc_object(exported)["Raises"]]


def exports_of(door: str) -> dict[str, Any]:
    """The functions and classes of ours that a room's front door lists."""
    room = importlib.import_module(f"isochrome.{door}")
    return {name: thing for name in room.__all__ if is_ours(thing := getattr(room, name))}


def is_ours(thing: Any) -> bool:
    """Whether something is a function or class of the package."""
    return callable(thing) and getattr(thing, "__module__", "").startswith("isochrome")


def returned_by(function: Any) -> Iterator[type]:
    """The classes of ours that a function's annotation says that it returns."""
    module = sys.modules[function.__module__]
    imported = {
        alias.name: node.module
        for node in nodes(Path(str(module.__file__)))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("isochrome")
        for alias in node.names
    }
    for word in re.findall(r"\w+", str(function.__annotations__.get("return"))):
        place = importlib.import_module(imported.get(word, module.__name__))
        if isinstance(thing := getattr(place, word, None), type) and is_ours(thing):
            yield thing


def tables_of(annotation: Any) -> Iterator[type]:
    """The tables that a settings file may have, by the annotations of its fields."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from tables_of(field.annotation)
    for inner in get_args(annotation):
        yield from tables_of(inner)


def given_to_users() -> dict[str, type]:
    """The classes that users are given or write, and those they are made from, by full names."""
    things = [getattr(isochrome, name) for name in EXPORTED]
    things += [thing for door in DOORS for thing in exports_of(door).values()]
    classes = [thing for thing in things if isinstance(thing, type)]
    classes += [c for thing in things if inspect.isfunction(thing) for c in returned_by(thing)]
    for room, names in PARTS.items():
        classes += [getattr(importlib.import_module(room), name) for name in names]
    for room, names in SETTINGS.items():
        tops = [getattr(importlib.import_module(f"isochrome.{room}"), name) for name in names]
        classes += [table for top in tops for table in tables_of(top)]
    return {
        f"{base.__module__}.{base.__qualname__}": base
        for given in classes
        for base in given.__mro__
        if is_ours(base)
    }


GIVEN = given_to_users()

USED = {*EXPORTED, *(name for door in DOORS for name in exports_of(door))}
USED |= {path.rpartition(".")[2] for path in GIVEN}
"""Names of the functions and classes that keep the whole form."""


@pytest.mark.parametrize("door", DOORS)
def test_what_a_room_for_users_exports_has_numpydocs_form(door):
    paths = [f"isochrome.{door}.{name}" for name in exports_of(door)]
    faulty = {
        path: faults
        for path in paths
        if (faults := [fault for fault in faults_of(path) if fault[0] not in NOT_OF_OTHERS])
    }
    assert not faulty, f"not in numpydoc's form: {faulty}"


@pytest.mark.parametrize("path", sorted(path for path in GIVEN if "._" not in path))
def test_what_users_are_given_has_numpydocs_form(path):
    """Its fields are said as Parameters or as Attributes, in the order that serves a reader."""
    said = get_doc_object(GIVEN[path])
    left_out = {*NOT_OF_OTHERS, "PR01", "PR03"}
    assert not [fault for fault in faults_of(path) if fault[0] not in left_out]
    own = [name for name in vars(GIVEN[path]).get("__annotations__", {}) if name[0] != "_"]
    assert not own or said["Parameters"] or said["Attributes"]


def test_what_users_are_given_is_found():
    """Results, the tables of a scene and of a set; and nothing that only other rooms see."""
    names = {path.rpartition(".")[2] for path in GIVEN}
    assert {"Processed", "RunDataset", "Comparison", "Indenter", "WearTrace", "Result"} <= names
    assert not {"Observation", "FrameFit", "PixelGrid"} & names


def texts_of(tree: ast.AST, name: str = "", used: bool = False) -> Iterator[tuple[str, str]]:
    """Names and docstrings of a module's constants, functions and classes, but for the used."""
    body = list(getattr(tree, "body", []))
    for before, node in zip([None, *body], body, strict=False):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inner = f"{name}.{node.name}" if name else node.name
            whole = not name and node.name in USED
            whole = whole or (isinstance(tree, ast.ClassDef) and used and node.name[0] != "_")
            if not whole and (text := ast.get_docstring(node)):
                yield inner, text
            yield from texts_of(node, inner, whole)
        elif isinstance(node, ast.Expr) and isinstance(before, ast.Assign | ast.AnnAssign):
            value = node.value
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield ast.unparse(before), value.value


def is_long(text: str) -> bool:
    """Whether a docstring has more than a few lines, or a section of numpydoc."""
    return "----" in text or sum(bool(line.strip()) for line in text.split("\n")) > LINES


def test_all_else_is_said_in_a_few_lines():
    """What the name does not say: equation, unit, shape, source. A module has its method."""
    places = {path.relative_to(HOUSE).as_posix(): path for path in modules()}
    long = [
        f"{place}: {name}"
        for place, path in places.items()
        if not place.startswith(NOT_YET)
        for name, text in texts_of(parsed(path))
        if is_long(text)
    ]
    assert not long, "shorten their docstrings: " + ", ".join(long)


def undocumented(frames: int, scene: str) -> int:
    """Do something with frames.

    More of it.

    Parameters
    ----------
    frames : int
        How many.

    Returns
    -------
    int
    """
    if not frames:
        raise ValueError(scene)
    return frames


def test_what_is_missing_is_noticed():
    """A parameter, what is returned, and an example; a raise statement is seen."""
    codes = {code for code, _ in faults_of(f"{__name__}.undocumented")}
    assert codes == {"PR01", "RT03", "EX01"}
    assert raises(undocumented) and not raises(faults_of)


LONG = {"init", "process", "process_campaign", "report", "check", "fit", "open_run"}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] * (n in LONG)) for n in EXPORTED]
)
def test_its_examples_run(name, tmp_path, monkeypatch):
    """Those that take long, or need a user's own images, are marked as skipped in the text."""
    monkeypatch.chdir(tmp_path)
    finder = doctest.DocTestFinder(recurse=False)
    (found,) = finder.find(getattr(isochrome, name), name, globs={})
    assert found.examples
    said: list[str] = []
    result = doctest.DocTestRunner().run(found, out=said.append)
    assert result.failed == 0, "".join(said)


def test_few_examples_are_skipped():
    skipped = {
        name
        for name in EXPORTED
        for found in doctest.DocTestFinder(recurse=False).find(getattr(isochrome, name), name)
        for example in found.examples
        if example.options.get(doctest.SKIP)
    }
    slow = {"bench", "calibrate_bending", "calibrate_disc", "demo", "write_into_scene"}
    own_images = {"calibrate_colour", "track"}
    assert skipped == slow | own_images | {"setup"}  # which serves until somebody ends it
