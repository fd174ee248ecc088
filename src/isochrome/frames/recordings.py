"""Which recordings some names stand for: files, folders and globs, as a command line gives them."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from pathlib import Path

from isochrome.errors import InputError
from isochrome.frames.opening import KNOWN, matches
from isochrome.frames.readers import tiff, video
from isochrome.frames.readers.signature import signature_of
from isochrome.frames.reading import FramesPath
from isochrome.frames.source import natural_key


def recordings_of(names: Sequence[str | Path], *, join: bool = False) -> tuple[FramesPath, ...]:
    """The recordings that files, folders and globs stand for, in order, for `open_frames`.

    A folder, video or TIFF stack is one each, images one to a file are one together; no video is
    decoded to tell. Globs are in natural order (part2 before part10), and so are names in the
    alphabet's order, as a shell makes them of a glob; others stay. `join`: all are parts of one.
    InputError where a name stands for nothing, or images stand among recordings.
    """
    if not names:
        raise InputError("no frames are named; name at least one file or folder")
    if join and len(names) == 1:
        return (names[0],)
    places = [place for name in _in_order(names) for place in _places(name)]
    folders = [place for place in places if os.path.isdir(place)]
    if join and folders:
        raise InputError(
            f"{folders[0]}: is a folder, which is a recording by itself, and --join is for files; "
            "name the files of one recording"
        )
    if len(names) == 1 and len(places) == 1:
        return (names[0],)
    for place in places:
        if place not in folders and place.suffix.lower() not in KNOWN:
            raise InputError(
                f"{place}: frames cannot be read from a file of this kind; known are "
                f"{', '.join(KNOWN)}; leave it out, as 'runs/*.avi' leaves out all but .avi files"
            )
    if join:
        return (tuple(places),)
    single = [place for place in places if _holds_several(place) is False]
    if not single:
        return tuple({os.path.abspath(place): place for place in places}.values())
    whole = [place for place in places if _holds_several(place)]
    if whole:
        raise InputError(
            f"{single[0]}: is a single image and {whole[0]} a whole recording; images, one to a "
            "file, are a recording together, and videos, stacks and folders are one each: name "
            "the ones or the others (parts of one recording: --join)"
        )
    return (names[0],) if len(names) == 1 else (tuple(places),)


def one_recording(names: Sequence[str | Path], *, join: bool = False) -> FramesPath:
    """The one recording that names stand for, see `recordings_of`; InputError where they are
    several.
    """
    found = recordings_of(names, join=join)
    if len(found) > 1:
        raise InputError(
            f"{found[0]}, {found[1]}{' ...' if len(found) > 2 else ''}: {len(found)} recordings, "
            "and one is wanted here; name one of them, or add --join if they are the parts of one"
        )
    return found[0]


def _in_order(names: Sequence[str | Path]) -> list[str | Path]:
    """Names in natural order where they are in the alphabet's, by the letters or by the codes."""
    texts = [str(name) for name in names]
    letters = ["".join(c for c in text.casefold() if c.isalnum()) for text in texts]
    expanded = texts == sorted(texts) or letters == sorted(letters)
    return sorted(names, key=natural_key) if expanded else list(names)


def _places(name: str | Path) -> list[Path]:
    """The files and folders that a name stands for; itself where it is no glob."""
    if os.path.lexists(name) or not glob.has_magic(os.fspath(name)):
        return [Path(name)]
    return list(matches(name))


def _holds_several(place: Path) -> bool | None:
    """Whether a place holds a recording by itself, None where a file does not tell."""
    if place.is_dir():
        return True
    try:
        kind = signature_of(place).kind
        return tiff.holds_several(place) if kind == "tiff" else kind == "video"
    except InputError:  # said of it when it is its turn
        return place.suffix.lower() in video.SUFFIXES or None
