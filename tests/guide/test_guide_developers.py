"""The developers' page names modules and rooms that are there."""

import re
from pathlib import Path

import pytest

import isochrome

HOUSE = Path(isochrome.__file__).parent
CODE = "\n".join(path.read_text("utf-8") for path in HOUSE.rglob("*.py"))
PAGE = (HOUSE / "guide" / "developers.md").read_text("utf-8")


def test_the_page_names_modules_and_rooms_that_are_there_and_the_one_rule():
    named = set(re.findall(r"`((?:[a-z_]+/)+[a-z_]+\.py)`", PAGE))
    homes = (HOUSE, HOUSE.parents[1])
    missing = {name for name in named if not any((home / name).is_file() for home in homes)}
    assert len(named) > 15 and not missing
    rooms = {path.parent.name for path in HOUSE.glob("*/__init__.py")}
    table = PAGE.split("| room |")[1].split("\n\n")[0]
    assert not {room for room in rooms if f"`{room}`" not in table}
    assert "**A defect is answered at its root: which prior, which model, which operator" in PAGE


@pytest.mark.parametrize("head", ["one frame through `process`", "one scene through `simulate`"])
def test_a_way_has_few_steps_and_types_and_all_of_them_are_there(head):
    """At most 12 steps and 14 types: who adds one takes one away, in the code as on the page."""
    way = PAGE.split(f"## The way of {head}")[1].split("\n## ")[0]
    steps = [line.split("|")[1:4] for line in way.split("\n") if re.match(r"\| \d", line)]
    types = re.findall(r"`([A-Z]\w+)`", " ".join(s[2] for s in steps if "(a `" not in s[2]))
    functions = re.findall(r"`([a-z_]+)`", " ".join(step[1] for step in steps))
    rooms = {path.parent.name for path in HOUSE.rglob("__init__.py")}
    assert 10 <= len(steps) <= 12 and 10 <= len(types) <= 14
    assert not [name for name in types if f"\nclass {name}" not in CODE]
    assert not [n for n in functions if f"\ndef {n}(" not in CODE and n not in rooms]
