"""Frames that are no files, cannot be read, vanish, or change while they are read."""

import os
from functools import partial
from pathlib import Path

from hostile.attack import Case, case, hostile
from hostile.given import image, pictures, process, stack, video

SOURCES: list[Case] = []


def piped(place: Path, name: str) -> list[str]:
    os.mkfifo(place / name)
    return process(name)


for name, what in (("p.avi", "frames"), ("p.tif", "a stack")):
    case(SOURCES, f"pipe as {what}", partial(piped, name=name), name, "is not a file",
         "name the file itself")  # fmt: skip
case(SOURCES, "device without end as frames", lambda _: process("/dev/zero"), "/dev/zero",
     "cannot be read", "folder")  # fmt: skip


@hostile(SOURCES, "z.tif", "is not a file", "name the file itself")
def link_to_a_device_without_end(place: Path) -> list[str]:
    (place / "z.tif").symlink_to("/dev/zero")
    return process("z.tif")


case(SOURCES, "standard input as frames", lambda _: process("/dev/stdin"), "/dev/stdin",
     "cannot be read", "folder")  # fmt: skip
case(SOURCES, "dash as frames",
     lambda _: ["process", "--scene", "plain.toml", "--out", "out", "--", "-"], "-",
     "no such file or folder", "check its name")  # fmt: skip


@hostile(SOURCES, "p.toml", "")
def pipe_as_a_scene(place: Path) -> list[str]:
    os.mkfifo(place / "p.toml")
    stack(place / "f.tif")
    return process("f.tif", "p.toml")


@hostile(SOURCES, "/dev/zero", "")
def device_without_end_as_a_scene(place: Path) -> list[str]:
    stack(place / "f.tif")
    return process("f.tif", "/dev/zero")


@hostile(SOURCES, "x.tif", "holds no image", "name a folder with frames")
def folder_that_is_named_as_a_stack(place: Path) -> list[str]:
    (place / "x.tif").mkdir()
    return process("x.tif")


@hostile(SOURCES, "e.tif", "0 bytes", "copy it again")
def empty_stack(place: Path) -> list[str]:
    (place / "e.tif").touch()
    return process("e.tif")


@hostile(SOURCES, "1.png", "0 bytes", "copy it again")
def empty_image_in_a_folder(place: Path) -> list[str]:
    (place / "d").mkdir()
    image(place / "d" / "0.png")
    (place / "d" / "1.png").touch()
    return process("d")


@hostile(SOURCES, "f.tif", "Permission denied")
def stack_that_may_not_be_read(place: Path) -> list[str]:
    stack(place / "f.tif")
    (place / "f.tif").chmod(0)
    return process("f.tif")


@hostile(SOURCES, "f.mkv", "Permission denied")
def video_that_may_not_be_read(place: Path) -> list[str]:
    video(place / "f.mkv").chmod(0)
    return process("f.mkv")


@hostile(SOURCES, "d", "Permission denied")
def folder_that_may_not_be_read(place: Path) -> list[str]:
    (place / "d").mkdir()
    image(place / "d" / "0.png")
    (place / "d").chmod(0)
    return process("d")


@hostile(SOURCES, "plain.toml", "Permission denied")
def scene_that_may_not_be_read(place: Path) -> list[str]:
    stack(place / "f.tif")
    (place / "plain.toml").chmod(0)
    return process("f.tif")


@hostile(SOURCES, "loop.tif", "check its name")
def frames_that_are_a_link_to_themselves(place: Path) -> list[str]:
    (place / "loop.tif").symlink_to("loop.tif")
    return process("loop.tif")


@hostile(SOURCES, "plain.toml")
def scene_that_is_a_link_to_itself(place: Path) -> list[str]:
    (place / "plain.toml").unlink()
    (place / "plain.toml").symlink_to("plain.toml")
    stack(place / "f.tif")
    return process("f.tif")


case(SOURCES, "frames of a name of three hundred letters", lambda _: process("f" * 300 + ".tif"),
     "File name too long", "check its name")  # fmt: skip


@hostile(SOURCES, "no such file", "check its name")
def name_that_is_a_broken_pattern(place: Path) -> list[str]:
    stack(place / "f.tif")
    return process("[!f*.tif")


def meanwhile(do) -> None:
    """Do something once the first frame has been read."""
    from isochrome.frames import FrameReader

    prepare = FrameReader._prepare

    def watched(reader, raw, index):
        if index == 1:
            do()
        return prepare(reader, raw, index)

    FrameReader._prepare = watched


def vanish() -> None:
    meanwhile(lambda: os.unlink("d/2.png"))


def shrink() -> None:
    meanwhile(lambda: os.truncate("f.tif", 500))


def change() -> None:
    """Another recording of the same size, written over it."""

    def write() -> None:
        for name in ("f.tif", "f.mkv"):
            if os.path.exists(name):
                with open(name, "r+b") as file:
                    file.seek(-9, os.SEEK_END)
                    file.write(b"something")

    meanwhile(write)


def grow() -> None:
    def write() -> None:
        for name in ("f.tif", "f.mkv"):
            if os.path.exists(name):
                with open(name, "ab") as file:
                    file.write(b"more")

    meanwhile(write)


def of_video(place: Path) -> list[str]:
    video(place / "f.mkv", count=3)
    return process("f.mkv")


def of_stack(place: Path) -> list[str]:
    stack(place / "f.tif", pictures(3))
    return process("f.tif")


def of_folder(place: Path) -> list[str]:
    (place / "d").mkdir()
    for k, frame in enumerate(pictures(3)):
        image(place / "d" / f"{k}.png", frame)
    return process("d")


for make, do, says in (
    (of_folder, vanish, ("2.png", "no such file")),
    (of_stack, shrink, ("f.tif", "frame 2", "save it again")),
    (of_stack, grow, ("f.tif", "changed while it was read", "wait until its recording has ended")),
    (of_stack, change, ("f.tif", "changed while it was read", "start again")),
    (of_video, grow, ("f.mkv", "changed while it was read", "wait until its recording has ended")),
):
    what = make.__name__.removeprefix("of_")
    label = f"{what} that begins to {do.__name__} while it is read"
    SOURCES.append(Case(make, says, inside=do, touches=True, label=label, slow=do is not vanish))
