"""Sixty hostile inputs and more: each is refused in one line, and nothing has changed."""

import re
import sys

import pytest

if sys.platform != "linux":
    pytest.skip("bounds on a process are set otherwise here", allow_module_level=True)

from hostile.attack import MEMORY, run, snapshot
from hostile.bombs import BOMBS
from hostile.given import PLAIN
from hostile.heads import HEADS
from hostile.pixels import PIXELS
from hostile.places import PLACES
from hostile.scenes import SCENES
from hostile.sets import SETS
from hostile.sources import SOURCES

KINDS = (BOMBS, HEADS, PIXELS, SOURCES, PLACES, SCENES, SETS)
CASES = {case.name: case for kind in KINDS for case in kind}
QUICK = {case.name for kind in KINDS for case in kind[:4]}  # by default; in the long run all


@pytest.fixture
def place(tmp_path):
    """A folder with a scene, and an output folder that holds somebody's file."""
    folder = tmp_path / "place"
    (folder / "out").mkdir(parents=True)
    (folder / "out" / "mine.txt").write_text("mine", "utf-8")
    (folder / "plain.toml").write_text(PLAIN, "utf-8")
    yield folder
    for path in (folder, *folder.rglob("*")):
        if path.is_dir() and not path.is_symlink():
            path.chmod(0o700)


def test_there_are_sixty():
    assert len(CASES) == sum(map(len, KINDS)) >= 60  # no two of one name
    assert all(case.says for case in CASES.values())


@pytest.mark.parametrize(
    "name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.long) for n in CASES]
)
def test_hostile_input_is_refused_in_one_line_and_changes_nothing(name, place):
    case = CASES[name]
    arguments = case.make(place)
    before = snapshot(place)
    ended = run(place, arguments, file_bytes=case.file_bytes, inside=case.inside)
    assert ended.code == case.code, f"{ended.code}: {ended.err}"
    assert ended.out == ""
    assert re.fullmatch(r"isochrome: [^\n]+\n", ended.err), ended.err
    for words in case.says:
        assert words in ended.err, f"{words!r} is not said: {ended.err}"
    after = snapshot(place)
    if case.kept:
        after = {k: v for k, v in after.items() if not k.startswith(b"out.partial".hex(" "))}
    if not case.touches:
        assert after == before
    assert ended.peak < MEMORY
