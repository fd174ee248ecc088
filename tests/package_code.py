"""The package's own code, parsed and walked once by all the tests that read it."""

import ast
from functools import cache
from pathlib import Path

import isochrome

HOUSE = Path(isochrome.__file__).parent


@cache
def modules() -> list[Path]:
    return sorted(HOUSE.rglob("*.py"))


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax of a module, or of a front door's stub."""
    return ast.parse(path.read_text("utf-8"))


@cache
def nodes(path: Path) -> list[ast.AST]:
    """Every node of a module, as `ast.walk` gives them."""
    return list(ast.walk(parsed(path)))
