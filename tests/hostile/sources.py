"""Frames that are no files, cannot be read, vanish, or change while they are read."""

import os
from functools import partial
from pathlib import Path

from hostile.attack import Case, after, case, hostile
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
case(SOURCES, "link to a device without end",
     after(lambda p: (p / "z.tif").symlink_to("/dev/zero"), process("z.tif")), "z.tif",
     "is not a file", "name the file itself")  # fmt: skip
case(SOURCES, "standard input as frames", lambda _: process("/dev/stdin"), "/dev/stdin",
     "cannot be read", "folder")  # fmt: skip
case(SOURCES, "dash as frames",
     lambda _: ["process", "--scene", "plain.toml", "--out", "out", "--", "-"], "-",
     "no such file or folder", "check its name")  # fmt: skip
case(SOURCES, "pipe as a scene", after(lambda p: (os.mkfifo(p / "p.toml"), stack(p / "f.tif")),
     lambda p: process("f.tif", "p.toml")), "p.toml", "")  # fmt: skip
case(SOURCES, "device without end as a scene",
     after(lambda p: stack(p / "f.tif"), process("f.tif", "/dev/zero")), "/dev/zero",
     "")  # fmt: skip
case(SOURCES, "folder that is named as a stack",
     after(lambda p: (p / "x.tif").mkdir(), process("x.tif")), "x.tif", "holds no image",
     "name a folder with frames")  # fmt: skip
case(SOURCES, "empty stack", after(lambda p: (p / "e.tif").touch(), process("e.tif")), "e.tif",
     "0 bytes", "copy it again")  # fmt: skip


@hostile(SOURCES, "1.png", "0 bytes", "copy it again")
def empty_image_in_a_folder(place: Path) -> list[str]:
    (place / "d").mkdir()
    image(place / "d" / "0.png")
    (place / "d" / "1.png").touch()
    return process("d")


case(SOURCES, "stack that may not be read",
     after(lambda p: (stack(p / "f.tif"), (p / "f.tif").chmod(0)), process("f.tif")), "f.tif",
     "Permission denied")  # fmt: skip
case(SOURCES, "video that may not be read",
     after(lambda p: video(p / "f.mkv").chmod(0), process("f.mkv")), "f.mkv",
     "Permission denied")  # fmt: skip


@hostile(SOURCES, "d", "Permission denied")
def folder_that_may_not_be_read(place: Path) -> list[str]:
    (place / "d").mkdir()
    image(place / "d" / "0.png")
    (place / "d").chmod(0)
    return process("d")


case(SOURCES, "scene that may not be read",
     after(lambda p: (stack(p / "f.tif"), (p / "plain.toml").chmod(0)), process("f.tif")),
     "plain.toml", "Permission denied")  # fmt: skip
case(SOURCES, "frames that are a link to themselves",
     after(lambda p: (p / "loop.tif").symlink_to("loop.tif"), process("loop.tif")), "loop.tif",
     "check its name")  # fmt: skip


@hostile(SOURCES, "plain.toml")
def scene_that_is_a_link_to_itself(place: Path) -> list[str]:
    (place / "plain.toml").unlink()
    (place / "plain.toml").symlink_to("plain.toml")
    stack(place / "f.tif")
    return process("f.tif")


case(SOURCES, "frames of a name of three hundred letters", lambda _: process("f" * 300 + ".tif"),
     "File name too long", "check its name")  # fmt: skip
case(SOURCES, "name that is a broken pattern",
     after(lambda p: stack(p / "f.tif"), process("[!f*.tif")), "no such file",
     "check its name")  # fmt: skip


def meanwhile(do) -> None:
    """Do something once the first frame has been read."""
    from isochrome.frames import FrameReader

    prepare = FrameReader._prepare

    def watched(reader, raw):
        if raw.index == 1:
            do()
        return prepare(reader, raw)

    FrameReader._prepare = watched


def vanish() -> None:
    meanwhile(lambda: os.unlink("d/2.png"))


def shrink() -> None:
    meanwhile(lambda: os.truncate("f.tif", 500))


def write_on(at: int, data: bytes) -> None:
    """Write into the recording, `at` bytes from its end."""
    for name in filter(os.path.exists, ("f.tif", "f.mkv")):
        with open(name, "r+b") as file:
            file.seek(at, os.SEEK_END)
            file.write(data)


def change() -> None:
    """Another recording of the same size, written over it."""
    meanwhile(lambda: write_on(-9, b"something"))


def grow() -> None:
    meanwhile(lambda: write_on(0, b"more"))


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
    SOURCES.append(Case(make, says, inside=do, touches=True, label=label))
