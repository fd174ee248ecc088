"""The folder of each recording in a campaign's own: named after it, and after no other."""

from __future__ import annotations

import os
import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from isochrome.frames import FramesPath
from isochrome.runs import WORKING

SUMMARIES = ("summary.csv", "summary.json", "summary.png")
"""Files of the campaign itself, in the folder that holds those of its recordings."""

_LONGEST = 200
"""Bytes of a name; file systems take 255, and the working folder's is longer."""

_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
"""Names that Windows keeps for its devices."""


def label_of(frames: FramesPath) -> str:
    """A recording as it was named, in text that every file can hold."""
    text = str(frames) if isinstance(frames, str | Path) else f"{frames[0]} ..."
    return text.encode("utf-8", "replace").decode("utf-8")


def folder_names(recordings: Sequence[FramesPath]) -> tuple[str, ...]:
    """A folder's name for each recording: its file's without the ending, or its folder's.

    Names that are equal, but perhaps for capitals, get the name of the folder that they are in,
    and where this does not help a number. Each is one plain name: it leads to no other folder, on
    Windows neither. Parameters: `recordings`, in order. Returns the names.
    """
    places = [_place(frames) for frames in recordings]
    own = [_plain(place.name if place.is_dir() else place.stem) for place in places]
    count = Counter(_key(name) for name in own)
    taken: set[str] = set()
    found = []
    for place, name in zip(places, own, strict=True):
        if count[_key(name)] > 1:
            name = _plain(f"{place.parent.name}-{name}")
        free, number = name, 1
        while _key(free) in taken:
            number += 1
            free = f"{name}-{number}"
        taken.add(_key(free))
        found.append(free)
    return tuple(found)


def _place(frames: FramesPath) -> Path:
    first = frames if isinstance(frames, str | Path) else frames[0]
    return Path(os.path.abspath(first))


def _key(name: str) -> str:
    """The same for names that some file system takes for one."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def _plain(name: str) -> str:
    """A name that is a folder's on every system, and none of the campaign's own files'."""
    text = re.sub(r'[<>:"/\\|?*\x00-\x1f\x7f\ud800-\udfff]', "_", name)
    text = text.encode()[:_LONGEST].decode(errors="ignore").strip(" .")
    if text.casefold().endswith(WORKING):
        text = f"{text[: -len(WORKING)]}_{WORKING[1:]}"
    if _DEVICE.fullmatch(text) or text.casefold() in SUMMARIES:
        text = f"_{text}"
    return text or "recording"
