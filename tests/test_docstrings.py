"""Docstrings of what the package exports: in numpydoc's form, complete, and their examples run."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import textwrap
from pathlib import Path
from typing import Any

import pytest
from numpydoc.docscrape import get_doc_object
from numpydoc.validate import validate

import isochrome

EXPORTED = sorted(set(isochrome.__all__) - {"__version__", "reference", "samples"})

LEFT_OUT = {
    "GL01": "the summary begins on the line of the quotes, as in all the code",
    "SA01": "the pages name related functions where they are of use, in the text",
}
"""Checks of numpydoc that are not asked for, and why."""

NOT_OF_ROOMS = {
    "EX01": "examples are for what users call: the exports of the package itself",
    "ES01": "one sentence is enough for many of them",
}
"""Checks that are asked for of the package's own exports alone."""

HOUSE = Path(isochrome.__file__).parent

DOORS = sorted(
    "/".join(stub.parent.relative_to(HOUSE).parts)
    for stub in HOUSE.rglob("__init__.pyi")
    if stub.parent != HOUSE
)
"""The folders of the package that have a front door."""

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


def exports_of(door: str) -> list[str]:
    """The functions and classes of ours that a front door lists, by their full names."""
    tree = ast.parse((HOUSE / door / "__init__.pyi").read_text("utf-8"))
    names = [
        a.asname or a.name for n in tree.body if isinstance(n, ast.ImportFrom) for a in n.names
    ]
    room = ".".join(("isochrome", *door.split("/")))
    offered = {name: getattr(importlib.import_module(room), name) for name in names}
    return [
        f"{room}.{name}"
        for name, thing in offered.items()
        if callable(thing) and getattr(thing, "__module__", "").startswith("isochrome")
    ]


@pytest.mark.parametrize("door", DOORS)
def test_what_a_front_door_exports_has_numpydocs_form(door):
    exports = exports_of(door)
    faulty = {
        path.rpartition(".")[2]: faults
        for path in exports
        if (faults := [fault for fault in faults_of(path) if fault[0] not in NOT_OF_ROOMS])
    }
    assert not faulty, f"not in numpydoc's form: {faulty}"


def test_what_a_front_door_exports_is_found():
    assert exports_of("output") and "isochrome.output.SUFFIXES" not in exports_of("output")


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


@every_export
def test_its_examples_run(name, tmp_path, monkeypatch):
    """Those that take long, or need a user's own images, are marked as skipped in the text."""
    monkeypatch.chdir(tmp_path)
    exported = getattr(isochrome, name)
    (found,) = doctest.DocTestFinder(recurse=False).find(exported, name, globs={})
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
