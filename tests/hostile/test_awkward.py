"""What is awkward and right: names, places and clocks that have to be taken as they are."""

import re
import sys
import zlib

import pytest

if sys.platform != "linux":
    pytest.skip("bounds on a process are set otherwise here", allow_module_level=True)

from hostile.attack import run
from hostile.given import PLAIN, picture, process, stack

NAMES = ("-two words.", "Öl µ 七\nline", "~", "*?[x] a$b^{$", "CON", "NUL.tif", "n" * 240)


def backwards() -> None:
    """A machine whose clock goes back an hour at each look."""
    import time

    now = [2e9]

    def earlier() -> float:
        now[0] -= 3600.0
        return now[0]

    time.time = earlier


@pytest.fixture
def place(tmp_path):
    (tmp_path / "plain.toml").write_text(PLAIN, "utf-8")
    return tmp_path


def check_done(ended):
    assert ended.code == 0, ended.err
    assert "Traceback" not in ended.err
    assert all(re.match(r"warning: ", line) for line in ended.err.splitlines()), ended.err


@pytest.mark.long
@pytest.mark.parametrize(  # names of devices are files' here
    "name",
    [pytest.param(n, marks=pytest.mark.study) if n in ("CON", "NUL.tif") else n for n in NAMES],
)
def test_any_name_that_the_system_can_hold_will_do(place, name):
    (place / f"d{name}").mkdir()
    (place / f"{name}.toml").write_text(PLAIN, "utf-8")
    stack(place / f"{name}.tif", picture(0, 32, 32)[None])
    arguments = ["process", "--scene", f"{name}.toml", "--out", f"d{name}/{name[:200]}"]
    check_done(run(place, [*arguments, "--", f"{name}.tif"]))
    assert (place / f"d{name}" / name[:200] / "frames.csv").is_file()


@pytest.mark.long
def test_results_may_lie_in_a_folder_of_their_own_in_that_of_the_frames(place):
    (place / "d").mkdir()
    stack(place / "d" / "f.tif", picture(0, 32, 32)[None])
    for again in ([], ["--restart"]):
        check_done(run(place, [*process("d")[:-1], "d/out", *again]))


@pytest.mark.long
def test_a_link_to_another_folder_is_followed_for_results(place):
    """As to a larger drive; a link in it, under the name of a result, is replaced."""
    (place / "elsewhere").mkdir()
    (place / "mine.csv").write_text("mine", "utf-8")
    (place / "elsewhere" / "frames.csv").symlink_to(place / "mine.csv")
    (place / "out").symlink_to("elsewhere")
    stack(place / "f.tif", picture(0, 32, 32)[None])
    check_done(run(place, process("f.tif")))
    assert (place / "out").is_symlink() and not (place / "elsewhere" / "frames.csv").is_symlink()
    assert (place / "mine.csv").read_text("utf-8") == "mine"


@pytest.mark.long
def test_a_machine_whose_clock_goes_backwards_ends_its_run(place):
    stack(place / "f.tif", picture(0, 32, 32)[None])
    check_done(run(place, process("f.tif"), inside=backwards))


@pytest.mark.long
def test_the_lock_of_a_dead_process_is_taken_over(place):
    (place / "out.partial").mkdir()
    (place / "out.partial" / "lock").touch()
    (place / "out.partial" / "owner.txt").write_text("process 999999 on nowhere", "utf-8")
    stack(place / "f.tif", picture(0, 32, 32)[None])
    check_done(run(place, process("f.tif")))
    assert not (place / "out.partial").exists()


MANIFESTS = (b"\xff", b"[]", b"{}", b'{"identity": 1, "layout": [], "token": "../.."}')


@pytest.mark.long
@pytest.mark.parametrize(
    ("body", "right"), [*((body, True) for body in MANIFESTS), (MANIFESTS[2], False)]
)
def test_a_manifest_that_is_none_begins_anew(place, body, right):
    (place / "out.partial").mkdir()
    (place / "out.partial" / "manifest.json").write_bytes(
        b"%08x\n" % (zlib.crc32(body) + (not right)) + body
    )
    stack(place / "f.tif", picture(0, 32, 32)[None])
    check_done(run(place, process("f.tif")))


def test_frames_smaller_than_a_patch_are_said_to_be(place):
    """12 x 12 pixels once ended in a traceback."""
    stack(place / "f.tif", picture(0, 12, 12)[None])
    ended = run(place, process("f.tif"))
    assert ended.code == 3 and ended.err.count("\n") == 1
    assert "nothing could be read" in ended.err and "smaller than a patch of 13" in ended.err
