"""Frames from a video: which library reads it, and what none may be asked."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from isochrome.frames.integrity.containers import check_whole
from isochrome.frames.readers import video_opencv, video_pyav
from isochrome.frames.source import Source, Stamp

SUFFIXES = (
    ".avi", ".mp4", ".mkv", ".mov", ".m4v", ".wmv", ".mpg", ".mpeg", ".webm", ".ts", ".mts",
)  # fmt: skip


def open_video(path: Path) -> Source:
    """Decode the first frame of a video. Returns its Source. Raises InputError.

    PyAV reads every kind of video that the tests know. Without it OpenCV reads those that it reads
    right, and the others are refused.
    """
    stamp = Stamp.of(path)
    container = check_whole(path)
    if has_pyav():
        return video_pyav.open_with_pyav(path, stamp, container)
    return video_opencv.open_with_opencv(path, stamp)


def has_pyav() -> bool:
    """Whether PyAV is installed."""
    return importlib.util.find_spec("av") is not None
