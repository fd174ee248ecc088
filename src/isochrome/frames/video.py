"""Frames from a video, read from the first to the last and never by seeking.

OpenCV's habits stay in this room and in the PNG reader: its (x, y), its BGR, its frame counts.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.source import RawFrame, Source, check_same, check_size, refusing

SUFFIXES = (".avi", ".mp4", ".mkv", ".mov", ".m4v", ".wmv", ".mpg", ".mpeg", ".webm")


def quiet_cv2() -> ModuleType:
    """OpenCV with its chatter on standard error switched off, unless the user has set it."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    loud = "OPENCV_LOG_LEVEL" in os.environ
    import cv2

    if not loud:
        log = cv2.utils.logging
        log.setLogLevel(log.LOG_LEVEL_SILENT)
    return cv2


def open_video(path: Path) -> Source:
    """Decode the first frame of a video. Returns its Source. Raises InputError."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; check its name")
    with refusing(path, "not a readable video"):
        capture, grey16 = _opened(path)
        try:
            claimed = capture.get(quiet_cv2().CAP_PROP_FRAME_COUNT)
            image = _next(capture)
        finally:
            capture.release()
    if image is None:
        raise InputError(f"{path}: no frame of this video can be decoded; {CONVERT}")
    return Source(
        kind="video",
        shape=(image.shape[0], image.shape[1]),
        channels=1 if image.ndim == 2 else 3,
        dtype=image.dtype,
        sensor_bits=None,
        frames=partial(_frames, path, grey16),
        claimed=int(claimed) if math.isfinite(claimed) and claimed > 0 else None,
    )


CONVERT = "is it whole? save it as AVI (MJPG or uncompressed) or as a TIFF stack"


def _opened(path: Path, grey16: bool | None = None) -> tuple[Any, bool]:
    """An OpenCV capture, and whether it hands out the 16-bit grey frames that the file holds."""
    cv2 = quiet_cv2()
    capture = cv2.VideoCapture(os.fspath(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise InputError(f"{path}: cannot be opened as a video; {CONVERT}")
    check_size(
        path,
        int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
    )
    if grey16 is None:
        code = int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF
        grey16 = code.to_bytes(4, "little") == b"Y1\x00\x10"  # FFmpeg's code for 16-bit grey
    if grey16:  # else OpenCV makes it 8 bits and three channels
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return capture, grey16


def _next(capture: Any) -> np.ndarray | None:
    """The next frame, (row, col) or (row, col, 3) in RGB, or None at the end."""
    found, image = capture.read()
    if not found or image is None:
        return None
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])


def _frames(path: Path, grey16: bool) -> Iterator[RawFrame]:
    with refusing(path, "not a readable video"):
        capture, _ = _opened(path, grey16)
    clock = quiet_cv2().CAP_PROP_POS_MSEC
    try:
        index, last, shape = 0, -1.0, None
        while True:
            with refusing(path, f"frame {index} cannot be decoded"):
                image = _next(capture)
                # OpenCV's clock, read after a frame, is that frame's own time.
                time = float(capture.get(clock)) / 1000
            if image is None:
                break
            shape = shape or (image.shape[0], image.shape[1])
            check_same(path, image, shape, f"frame {index}")
            known = math.isfinite(time) and time > last
            last = time if known else last
            yield RawFrame(image, time if known else None, f"{path.name}[{index}]")
            index += 1
        if index == 0:
            raise InputError(f"{path}: no frame of this video can be decoded; {CONVERT}")
    finally:
        capture.release()
