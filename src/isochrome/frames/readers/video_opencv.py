"""Frames from a video by OpenCV, where PyAV is not installed: read in order, never by seeking.

OpenCV says neither why it stops nor what it has guessed: only what it reads right is read, and
where it is in doubt whether it did, the video is refused. It scales a frame whose size changes in
mid-recording, and hands out what FFmpeg has made up for a damaged one: so only codecs are read
whose frames have no size of their own, and nothing is made up. Its BGR and (x, y) stay in this
module.
"""

from __future__ import annotations

import math
import os
from collections.abc import Generator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.source import (
    Extent,
    RawFrame,
    Source,
    Stamp,
    StoredForm,
    check_aspect,
    check_size,
    next_time,
    refusing,
)

GREY16, GREY8 = b"Y1\x00\x10", b"Y800"
KNOWN = (GREY16, GREY8, b"I420", b"444P", b"422P", b"BGR\x00", b"BGR\x18", b"RGB\x18",
         b"G3\x00\x08", b"YUY2", b"UYVY", b"NV12")  # fmt: skip
"""FFmpeg's codes of the pixels that OpenCV hands out without loss of bits."""

PLAIN = (b"\0\0\0\0", b"HFYU", b"FFVH", b"ULRG", b"ULRA", b"ULY0", b"ULY2", b"ULY4", b"ULH0",
         b"ULH2", b"ULH4", b"DIB ", b"Y800", b"GREY", b"I420", b"YUY2", b"UYVY")  # fmt: skip
"""Codes of uncompressed video, HuffYUV and Ut Video."""

INSTALL = "run 'pip install isochrome[video]' (PyAV), which reads it right"


def quiet_cv2() -> ModuleType:
    """OpenCV with its chatter on standard error switched off, unless the user has set it."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    # a damaged frame ends the reading, and is not made up; nothing but the file is opened
    os.environ.setdefault(
        "OPENCV_FFMPEG_CAPTURE_OPTIONS",
        "err_detect;crccheck+explode|protocol_whitelist;file|threads;1",
    )
    loud = "OPENCV_LOG_LEVEL" in os.environ
    import cv2

    if not loud and hasattr(cv2, "setLogLevel"):  # until version 5
        cv2.setLogLevel(0)
    elif not loud:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2


def open_with_opencv(path: Path, stamp: Stamp) -> Source:
    """Decode the first frame of a video. Returns its Source. Raises InputError.

    Parameters: `path`; `stamp`, the file's when it was first looked at.
    """
    with refusing(path, "not a readable video"):
        capture, code = _opened(path)
        try:
            claimed = capture.get(quiet_cv2().CAP_PROP_FRAME_COUNT)
            image = _taken(capture, code) if capture.grab() else None
        finally:
            capture.release()
    if image is None:
        raise InputError(f"{path}: no frame of this video can be decoded by OpenCV; {INSTALL}")
    form = StoredForm.of(image)
    count = int(claimed) if math.isfinite(claimed) and claimed > 0 else None
    video = _Video(path, stamp, form, count)
    return Source(
        kind="video",
        form=form,
        sensor_bits=8 * image.dtype.itemsize,
        frames=video.frames,
        extent=video.extent,
        files=(path,),
        claimed=count,
        start_s=0.0,
    )


class _Video:
    """One video file, decoded from its start each time."""

    def __init__(self, path: Path, stamp: Stamp, form: StoredForm, claimed: int | None) -> None:
        self.path, self.stamp, self.form, self.claimed = path, stamp, form, claimed
        self._extent: Extent | None = None

    def extent(self) -> Extent:
        """Decode all frames once, and count them."""
        if self._extent is None:
            times = [frame.time_s for frame in self.frames(None)]
            self._extent = Extent(len(times), next_time(*times[-2:]) if len(times) > 1 else None)
        return self._extent

    def frames(self, start: int | None) -> Generator[RawFrame]:
        """Frames from `start` on; those before are decoded, but not converted.

        All, without their pixels, where `start` is None.
        """
        path = self.path
        self.stamp.check(path)
        with refusing(path, "not a readable video"):
            capture, code = _opened(path)
        clock = quiet_cv2().CAP_PROP_POS_MSEC
        index, first, last = 0, None, -1.0
        empty = np.zeros((0, 0), self.form.dtype)
        try:
            while capture.grab():
                # OpenCV's clock, read after a frame, is that frame's own time.
                now = float(capture.get(clock)) / 1000
                first = now if first is None else first
                if not (math.isfinite(now) and now - first > last):
                    raise InputError(
                        f"{path}: OpenCV does not tell when frame {index} was taken; {INSTALL}, or "
                        "says what is wrong"
                    )
                last = now - first
                image = empty
                if start is not None and index >= start:
                    with refusing(path, f"frame {index} cannot be decoded"):
                        image = _taken(capture, code)
                        self.form.check(path, image, f"frame {index}")
                if start is None or index >= start:
                    yield RawFrame(image, last, f"{path.name}[{index}]")
                index += 1
            self._check_end(index)
        finally:
            capture.release()

    def _check_end(self, count: int) -> None:
        self.stamp.check(self.path)
        if self.claimed is not None and count != self.claimed:
            raise InputError(
                f"{self.path}: OpenCV decodes {count} frames and the head claims {self.claimed}; "
                f"whether it is damaged after frame {count - 1}, or its head is wrong, it does not "
                f"tell: {INSTALL}, or says what is wrong"
            )


def _opened(path: Path) -> tuple[Any, bytes]:
    """An OpenCV capture, and FFmpeg's code of its pixels."""
    cv2 = quiet_cv2()
    capture = cv2.VideoCapture(os.fspath(path.absolute()), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise InputError(f"{path}: cannot be opened by OpenCV; {INSTALL}, if it is whole")
    rows, cols = capture.get(cv2.CAP_PROP_FRAME_HEIGHT), capture.get(cv2.CAP_PROP_FRAME_WIDTH)
    check_size(path, int(rows), int(cols), 6)
    code = (int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF).to_bytes(4, "little")
    codec = (int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF).to_bytes(4, "little")
    if codec not in PLAIN:
        raise InputError(
            f"{path}: is compressed by {codec.decode('ascii', 'replace')}, of which OpenCV hides "
            f"damaged frames and changes of size; {INSTALL}, or says what is wrong"
        )
    if code not in KNOWN:
        raise InputError(
            f"{path}: holds pixels of the kind {code!r}, which OpenCV may cut to 8 bits; {INSTALL}"
        )
    sides = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    check_aspect(path, *sides)
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # pixels stay where the sensor had them
    if code == GREY16:  # else OpenCV makes it 8 bits and three channels
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    return capture, code


def _taken(capture: Any, code: bytes) -> np.ndarray:
    """The grabbed frame, (row, col) or (row, col, 3) in RGB."""
    found, image = capture.retrieve()
    if not found or image is None:
        raise ValueError("OpenCV gives no picture for it")
    if image.ndim == 3 and code == GREY8:
        return np.ascontiguousarray(image[..., 0])
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])
