"""Output folders that lead elsewhere, may not be written, or have no room left."""

import errno
import os
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from hostile.attack import Case, after, case, hostile
from hostile.given import CONTACT, process, simulate, stack, write_scene

PLACES: list[Case] = []


def processing(place: Path) -> list[str]:
    """Frames and a scene with which nothing is wrong."""
    stack(place / "f.tif")
    return process("f.tif")


def simulating(place: Path) -> list[str]:
    write_scene(place, CONTACT)
    return simulate()


def without_out(place: Path) -> None:
    shutil.rmtree(place / "out")


def linked(place: Path, target: str, then: Callable[[Path], list[str]]) -> list[str]:
    """An `out` that is a link."""
    without_out(place)
    (place / "out").symlink_to(target)
    return then(place)


def read_only(place: Path, then: Callable[[Path], list[str]]) -> list[str]:
    (place / "out").chmod(0o555)
    return then(place)


AWAY = "/nonexistent-drive/results"
case(PLACES, "out is a link to itself", lambda p: linked(p, "out", processing), "out",
     "name another")  # fmt: skip
case(PLACES, "out is a link to itself for simulate", lambda p: linked(p, "out", simulating),
     "out", "name another")  # fmt: skip
case(PLACES, "out is a link to a missing drive", lambda p: linked(p, AWAY, processing),
     "out", AWAY, "see that its drive is")  # fmt: skip
case(PLACES, "out is read only", lambda p: read_only(p, processing), "out", "name another")
case(PLACES, "out is read only for simulate", lambda p: read_only(p, simulating), "out",
     "name another")  # fmt: skip
case(PLACES, "out on a missing drive",
     lambda p: [*processing(p)[:-1], "/proc/nonexistent-drive/results"], "nonexistent-drive",
     "name another")  # fmt: skip
case(PLACES, "out on a missing drive for simulate",
     lambda p: [*simulating(p)[:-1], "/proc/nonexistent-drive/out"], "out",
     "name another")  # fmt: skip
case(PLACES, "working folder is a link elsewhere",
     after(lambda p: ((p / "elsewhere").mkdir(), (p / "out.partial").symlink_to("elsewhere")),
     lambda p: processing(p)), "out.partial", "symbolic link", "remove it")  # fmt: skip
case(PLACES, "working folder is a file",
     after(lambda p: (p / "out.partial").write_text("mine"), lambda p: processing(p)),
     "out.partial", "name another")  # fmt: skip


@hostile(PLACES, "out.partial", "symbolic links", "name another")
def lock_in_the_working_folder_is_a_link_elsewhere(place: Path) -> list[str]:
    (place / "out.partial").mkdir()
    (place / "elsewhere").write_text("mine")
    (place / "out.partial" / "lock").symlink_to(place / "elsewhere")
    return processing(place)


case(PLACES, "out is the folder of the frames",
     after(lambda p: ((p / "d").mkdir(), stack(p / "d" / "f.tif")), [*process("d")[:-1], "d"]),
     "d/f.tif", "beside the input", "name another")  # fmt: skip
case(PLACES, "out is the frames", lambda p: [*processing(p)[:-1], "f.tif"], "f.tif", "is a file",
     "name another")  # fmt: skip
case(PLACES, "results would replace the frames",
     after(lambda p: stack(p / "out" / "fringe_order.tif"), process("out/fringe_order.tif")),
     "fringe_order.tif", "beside the input", "name another")  # fmt: skip
case(PLACES, "results would replace the scene",
     after(lambda p: write_scene(p, CONTACT, "out/scene.toml"), simulate("out/scene.toml")),
     "out/scene.toml", "no provenance.json", "move it away", kept=True)  # fmt: skip
case(PLACES, "results would replace somebodys frames",
     after(lambda p: stack(p / "out" / "frames.tif"), lambda p: simulating(p)), "out/frames.tif",
     "no provenance.json", "move it away", kept=True)  # fmt: skip
case(PLACES, "out is the root", lambda p: [*processing(p)[:-1], "/"], "/", "top of a drive",
     "name a folder in it")  # fmt: skip
case(PLACES, "out is a device", lambda p: [*processing(p)[:-1], "/dev/null"], "/dev/null",
     "is a file", "name another")  # fmt: skip


@hostile(PLACES, "out", "name another")
def folder_above_out_is_read_only(place: Path) -> list[str]:
    arguments = processing(place)
    without_out(place)
    place.chmod(0o555)
    return arguments


case(PLACES, "out has a name of three hundred letters", lambda p: [*processing(p)[:-1], "o" * 300],
     "File name too long", "name another")  # fmt: skip
case(PLACES, "out leaves no letters for the working folder",
     lambda p: [*processing(p)[:-1], "o" * 250], "File name too long", "name another")  # fmt: skip


def little_room() -> None:
    """A disk on which a kilobyte is free."""
    shutil.disk_usage = lambda path: SimpleNamespace(total=10**9, used=10**9, free=1000)  # type: ignore[assignment]


case(PLACES, "disk without room for the results", lambda p: processing(p), "out", "are free there",
     "make room", inside=little_room)  # fmt: skip


def full_after(count: int) -> None:
    """A disk that is full once so many files were opened for writing, made, or renamed."""
    left = [count]
    home = os.getcwd()

    def watch(event: str, arguments: tuple) -> None:
        writes = event in ("os.mkdir", "os.rename", "os.truncate") or (
            event == "open"
            and isinstance(arguments[2], int)
            and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        )
        if not writes or not isinstance(arguments[0], str | bytes):
            return
        if not os.fsdecode(os.path.abspath(arguments[0])).startswith(home):
            return
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, "No space left on device")

    sys.addaudithook(watch)


FULL = (0, 1, 2, 3, 5, 8, 13, 21, 34)
"""Writes after which the disk is full."""

for count in FULL:
    for make in (processing, simulating):
        PLACES.append(
            Case(
                make, ("out", "No space left on device"), inside=partial(full_after, count),
                kept=True,
                label=f"disk full after {count} writes while {make.__name__}",
            )
        )  # fmt: skip

for most in (0, 1000):
    for make in (processing, simulating):
        PLACES.append(
            Case(
                make, ("out", "File too large"), file_bytes=most, kept=True,
                label=f"no file may hold over {most} bytes while {make.__name__}",
            )
        )  # fmt: skip
