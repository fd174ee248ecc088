"""The developers' page names modules and rooms that are there."""

from __future__ import annotations

import re
from pathlib import Path

import isochrome

HOUSE = Path(isochrome.__file__).parent
PAGE = (HOUSE / "guide" / "developers.md").read_text("utf-8")


def test_every_module_that_the_page_names_is_there():
    named = set(re.findall(r"`((?:[a-z_]+/)+[a-z_]+\.py)`", PAGE))
    homes = (HOUSE, HOUSE.parents[1])
    missing = {name for name in named if not any((home / name).is_file() for home in homes)}
    assert len(named) > 15 and not missing


def test_every_room_is_on_the_page():
    rooms = {path.parent.name for path in HOUSE.glob("*/__init__.py")}
    table = PAGE.split("| room |")[1].split("\n\n")[0]
    assert not {room for room in rooms if f"`{room}`" not in table}
