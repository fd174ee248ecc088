"""Output folders that lead elsewhere, may not be written, or have no room left."""

import errno
import os
import shutil
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from hostile.attack import Case, hostile
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


@hostile(PLACES, "out", "name another")
def out_is_a_link_to_itself(place: Path) -> list[str]:
    without_out(place)
    (place / "out").symlink_to("out")
    return processing(place)


@hostile(PLACES, "out", "name another")
def out_is_a_link_to_itself_for_simulate(place: Path) -> list[str]:
    without_out(place)
    (place / "out").symlink_to("out")
    return simulating(place)


@hostile(PLACES, "out", "/nonexistent-drive/results", "see that its drive is")
def out_is_a_link_to_a_missing_drive(place: Path) -> list[str]:
    without_out(place)
    (place / "out").symlink_to("/nonexistent-drive/results")
    return processing(place)


@hostile(PLACES, "nonexistent-drive", "name another")
def out_on_a_missing_drive(place: Path) -> list[str]:
    return [*processing(place)[:-1], "/proc/nonexistent-drive/results"]


@hostile(PLACES, "out", "name another")
def out_on_a_missing_drive_for_simulate(place: Path) -> list[str]:
    return [*simulating(place)[:-1], "/proc/nonexistent-drive/out"]


@hostile(PLACES, "out.partial", "symbolic link", "remove it")
def working_folder_is_a_link_elsewhere(place: Path) -> list[str]:
    (place / "elsewhere").mkdir()
    (place / "out.partial").symlink_to("elsewhere")
    return processing(place)


@hostile(PLACES, "out.partial", "name another")
def working_folder_is_a_file(place: Path) -> list[str]:
    (place / "out.partial").write_text("mine")
    return processing(place)


@hostile(PLACES, "out.partial", "symbolic links", "name another")
def lock_in_the_working_folder_is_a_link_elsewhere(place: Path) -> list[str]:
    (place / "out.partial").mkdir()
    (place / "elsewhere").write_text("mine")
    (place / "out.partial" / "lock").symlink_to(place / "elsewhere")
    return processing(place)


@hostile(PLACES, "d/f.tif", "beside the input", "name another")
def out_is_the_folder_of_the_frames(place: Path) -> list[str]:
    (place / "d").mkdir()
    stack(place / "d" / "f.tif")
    return [*process("d")[:-1], "d"]


@hostile(PLACES, "f.tif", "is a file", "name another")
def out_is_the_frames(place: Path) -> list[str]:
    return [*processing(place)[:-1], "f.tif"]


@hostile(PLACES, "fringe_order.tif", "beside the input", "name another")
def results_would_replace_the_frames(place: Path) -> list[str]:
    stack(place / "out" / "fringe_order.tif")
    return process("out/fringe_order.tif")


@hostile(PLACES, "out/scene.toml", "no provenance.json", "move it away", kept=True)
def results_would_replace_the_scene(place: Path) -> list[str]:
    write_scene(place, CONTACT, "out/scene.toml")
    return simulate("out/scene.toml")


@hostile(PLACES, "out/frames.tif", "no provenance.json", "move it away", kept=True)
def results_would_replace_somebodys_frames(place: Path) -> list[str]:
    stack(place / "out" / "frames.tif")
    return simulating(place)


@hostile(PLACES, "/", "top of a drive", "name a folder in it")
def out_is_the_root(place: Path) -> list[str]:
    return [*processing(place)[:-1], "/"]


@hostile(PLACES, "/dev/null", "is a file", "name another")
def out_is_a_device(place: Path) -> list[str]:
    return [*processing(place)[:-1], "/dev/null"]


@hostile(PLACES, "out", "name another")
def out_is_read_only(place: Path) -> list[str]:
    (place / "out").chmod(0o555)
    return processing(place)


@hostile(PLACES, "out", "name another")
def out_is_read_only_for_simulate(place: Path) -> list[str]:
    (place / "out").chmod(0o555)
    return simulating(place)


@hostile(PLACES, "out", "name another")
def folder_above_out_is_read_only(place: Path) -> list[str]:
    arguments = processing(place)
    without_out(place)
    place.chmod(0o555)
    return arguments


@hostile(PLACES, "File name too long", "name another")
def out_has_a_name_of_three_hundred_letters(place: Path) -> list[str]:
    return [*processing(place)[:-1], "o" * 300]


@hostile(PLACES, "File name too long", "name another")
def out_leaves_no_letters_for_the_working_folder(place: Path) -> list[str]:
    return [*processing(place)[:-1], "o" * 250]


def little_room() -> None:
    """A disk on which a kilobyte is free."""
    shutil.disk_usage = lambda path: SimpleNamespace(total=10**9, used=10**9, free=1000)  # type: ignore[assignment]


@hostile(PLACES, "out", "are free there", "make room", inside=little_room)
def disk_without_room_for_the_results(place: Path) -> list[str]:
    return processing(place)


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
                make,
                ("out", "No space left on device"),
                inside=partial(full_after, count),
                kept=True,
                slow=count not in (0, 3, 8),
                label=f"disk full after {count} writes while {make.__name__}",
            )
        )

for most in (0, 1000):
    for make in (processing, simulating):
        PLACES.append(
            Case(
                make,
                ("out", "File too large"),
                file_bytes=most,
                kept=True,
                label=f"no file may hold over {most} bytes while {make.__name__}",
            )
        )
