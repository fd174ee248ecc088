"""The page of files and columns: words from files.toml, units from the names."""

import ast
import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from package_code import HOUSE, modules, nodes

WORDS = Path(__file__).with_name("files.toml")

HEAD = """# Every file and column

A unit stands in the name of its column. An empty cell, NaN, or empty text is not known. Tables are
CSV with a header line; maps are 32-bit TIFF stacks, a page a frame, with the scale in them.

**Columns that are keys of the scene** (`load.normal_n`, `friction.coefficient`, ...) hold the value
that was fitted, in the key's unit; beside each stands `KEY standard_uncertainty`.

"""

NO_OUTPUT = {
    "zarr.json": "a part of run.zarr", "truth.json": "of the sample images",
    "set.toml": "of the sample images", "captured.tif": "of the sample images",
    "fields.toml": "what the set-up page and `init` ask for",
}  # fmt: skip
"""File names in the code that no command leaves as a result of its own, and why."""


@cache
def words() -> dict[str, Any]:
    return tomllib.loads(WORDS.read_text("utf-8"))


def files() -> dict[str, list[str]]:
    """Every file: which command leaves it, when, and what it is."""
    return {
        name: told
        for part, own in words().items()
        if part != "columns"
        for name, told in own.items()
    }


def columns() -> set[str]:
    """Every column that has words; a scene's key is written KEY."""
    return {name for own in words()["columns"].values() for name in own}


def page() -> str:
    from scene_keys import unit

    lines = [HEAD, "## Files\n\n"]
    for part, own in words().items():
        if part == "columns":
            continue
        lines.append(f"### {part[0].upper()}{part[1:]}\n\n")
        lines.append("| file | left by | when | what it is |\n|---|---|---|---|\n")
        lines += [f"| `{name}` | {' | '.join(told)} |\n" for name, told in own.items()]
        lines.append("\n")
    lines.append("## Columns\n\n")
    for table, own in words()["columns"].items():
        lines.append(f"### {table}\n\n| column | unit | meaning |\n|---|---|---|\n")
        lines += [f"| `{name}` | {unit(name)} | {_cell(told)} |\n" for name, told in own.items()]
        lines.append("\n")
    return "".join(lines).rstrip("\n") + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def has_words(column: str, known: set[str]) -> bool:
    """Whether a column is on the page, by its name or as one of a scene's key."""
    if column in known:
        return True
    key, _, rest = column.partition(" ")
    if "." not in key:
        return False
    return not rest or rest == "standard_uncertainty" or f"KEY {rest}" in known


def _is_layer(function: ast.expr) -> bool:
    return isinstance(function, ast.Name) and function.id == "Layer"


@cache
def left_by_the_code() -> set[str]:
    """File names that stand in the code of the rooms whose commands leave files."""
    found = set()
    for path in modules():
        place = path.relative_to(HOUSE).as_posix()
        if place.startswith(("samples", "benchmarks", "guide", "cli", "demonstration")):
            continue
        told = {id(n.value) for n in nodes(path) if isinstance(n, ast.Expr)}
        for node in nodes(path):
            text = node.value if isinstance(node, ast.Constant) and id(node) not in told else None
            if (
                isinstance(text, str)
                and path.name != "messages.py"
                and re.fullmatch(r"[a-z_0-9]+\.(csv|tif|png|json|toml|zip|zarr|nc|txt|html)", text)
            ):
                found.add(text)
            if isinstance(node, ast.Call) and _is_layer(node.func):
                name = node.args[0]
                if isinstance(name, ast.Constant) and not any(
                    k.arg == "stack" for k in node.keywords
                ):
                    found.add(f"{name.value}.tif")
    return found - set(NO_OUTPUT)
