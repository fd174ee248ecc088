"""Frames asked for by their numbers, from a file that stays open as long as they come in order."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

from isochrome.errors import InputError
from isochrome.frames.reader import Frame, FrameReader

_FAR = 300
"""Frames that are sooner passed over than left out by opening their file anew."""


class Onward:
    """The frames of a `reader`; it may be handed to other processes and shared by threads."""

    def __init__(self, reader: FrameReader) -> None:
        self.reader = reader
        self._open = threading.local()

    def __getstate__(self) -> dict[str, Any]:
        return {"reader": self.reader}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["reader"])  # type: ignore[misc]

    def frame(self, index: int) -> Frame:
        """The frame of a number from 0. Raises InputError where it is bad or no longer there."""
        frames: Iterator[Frame] | None = getattr(self._open, "frames", None)
        at: int = getattr(self._open, "at", 0)
        if frames is None or not at <= index <= at + _FAR:
            frames, at = self.reader.iterate(index), index
        for frame in frames:
            at += 1
            if frame.index == index:
                self._open.frames, self._open.at = frames, at
                return frame
        raise InputError(
            f"{self.reader.path}: breaks off after {at} frames, and had more when it was counted; "
            "is it still being written?"
        )

    def close(self) -> None:
        """Close the file."""
        self.reader.close()
        self._open = threading.local()
