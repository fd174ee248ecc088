"""Decoding a video with PyAV: every frame in the order of display, with its own time stamp."""

from __future__ import annotations

import os
import zlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.containers import Container
from isochrome.frames.ffv1 import is_whole
from isochrome.frames.pixel_formats import plane_of
from isochrome.frames.source import MAX_PIXELS, check_size, refusing

OPEN = {"protocol_whitelist": "file", "format_whitelist": "avi,mov,mp4,m4a,3gp,3g2,mj2,matroska,"
        "webm,asf,mpeg,mpegvideo,mpegts"}  # fmt: skip
"""Nothing but this one file is opened, whatever it names inside."""

DECODE = {"err_detect": "crccheck+explode", "max_pixels": str(MAX_PIXELS)}
"""A damaged frame is an error, and not something like a frame."""

PATIENCE = {"strict": "1"}
"""H.264 need not say how far its frames are out of order; those that come late are not lost."""

COVER = 0x400
"""FFmpeg's mark of a picture on the cover."""

PIXEL_BYTES = 6
"""Of a pixel in 16-bit colour, the most that is decoded."""


@dataclass(frozen=True)
class Decoded:
    """A frame as PyAV gives it: its tick and time since the first (s), None where unknown."""

    frame: Any
    tick: int | None
    time_s: float | None


def decoded(path: Path, kind: Container, key: tuple[int, int] | None = None) -> Generator[Decoded]:
    """Every frame of a video in the order of display; a damaged one is an InputError.

    Parameters: `path`; `kind` of container; `key`, the number and tick of a key frame to begin at
    (frames before it in time may come too), None for the first frame.
    """
    with opened(path) as (container, stream):
        if key is not None:
            with refusing(path, f"frame {key[0]} cannot be found again"):
                container.seek(key[1], stream=stream, backward=True, any_frame=False)
        clock = _Clock(stream, by_packet=kind == "avi")
        count = 0 if key is None else key[0]
        context = stream.codec_context
        in_slices = context.name == "ffv1" and bool(context.extradata)
        packets = container.demux(stream)
        while True:
            with refusing(path, f"frame {count} cannot be decoded"):
                packet = next(packets, None)
                if packet is None:
                    return
                if in_slices and packet.size and not is_whole(bytes(packet)):
                    raise InputError(
                        f"{path}: frame {count} is damaged; copy the file again from its source"
                    )
                frames = _decode(packet, clock, path, count)
            for frame in frames:
                yield Decoded(frame, *clock.of(frame))
                count += 1


class _Clock:
    """The time stamps of decoded frames.

    AVI knows none, only how many frames come before a packet in the order of the file, which is
    not that of display: the frames take the packets' numbers in rising order.
    """

    def __init__(self, stream: Any, *, by_packet: bool) -> None:
        self._base = stream.time_base
        self._queue: list[int] | None = [] if by_packet else None
        self._first: int | None = None
        self._last: int | None = None

    def push(self, packet: Any) -> None:
        """Take note of a packet's number, where frames take theirs from it."""
        if self._queue is not None and packet.size and packet.dts is not None:
            heappush(self._queue, packet.dts)

    def of(self, frame: Any) -> tuple[int | None, float | None]:
        """A frame's tick, and its time since the first; no time where it is not after the last."""
        tick = frame.pts
        if self._queue is not None:
            tick = heappop(self._queue) if self._queue else None
        if tick is None:
            return None, None
        self._first = tick if self._first is None else self._first
        late = self._last is None or tick > self._last
        self._last = tick if late else self._last
        return tick, float((tick - self._first) * self._base) if late else None


@contextmanager
def opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """An open container and its one video stream, ready to decode in this thread alone."""
    import av

    with refusing(path, "not a readable video"):
        container = av.open(os.fspath(path.absolute()), container_options=OPEN)
    try:
        with refusing(path, "not a readable video"):
            streams = [s for s in container.streams.video if not _is_picture(s)]
            if len(streams) != 1:
                raise InputError(
                    f"{path}: holds {len(streams)} video streams, and one is wanted; save the one "
                    "by itself ('ffmpeg -i FILE -map 0:v:0 -c copy NEW')"
                )
            stream = streams[0]
            _check_stream(stream, path)
            context = stream.codec_context
            context.options = DECODE | (PATIENCE if context.name == "h264" else {})
            context.thread_count = 1
        yield container, stream
    finally:
        container.close()


def _is_picture(stream: Any) -> bool:
    """Whether it is a picture on the cover, and no recording."""
    marks = getattr(stream, "disposition", 0)  # a number, or a flag with one, by PyAV's version
    return bool(int(getattr(marks, "value", marks)) & COVER)


def _check_stream(stream: Any, path: Path) -> None:
    context = stream.codec_context
    if context is None:
        raise InputError(
            f"{path}: its codec is not known; save it as FFV1, MJPG or uncompressed, or as a TIFF "
            "stack"
        )
    if context.height <= 0 or context.width <= 0:  # FFmpeg keeps no size that it will not decode
        raise InputError(
            f"{path}: names no frame size that can be read, up to {MAX_PIXELS} pixels; is the file "
            "damaged? crop it or save it again"
        )
    check_size(path, context.height, context.width, PIXEL_BYTES)
    aspect = stream.sample_aspect_ratio
    if aspect and aspect != 1:
        raise InputError(
            f"{path}: says that its pixels are {aspect.numerator}:{aspect.denominator}, not "
            "square; resample it to square pixels, or correct its aspect"
        )


def _decode(packet: Any, clock: _Clock, path: Path, count: int) -> list[Any]:
    """The frames that a packet completes; InputError where it, or one of them, is damaged."""
    if packet.is_corrupt:
        raise InputError(
            f"{path}: breaks off, or is damaged, after frame {count - 1}; copy it again from its "
            "source"
        )
    clock.push(packet)
    frames = packet.decode()
    if any(frame.is_corrupt for frame in frames):
        raise InputError(f"{path}: frame {count} is damaged; copy the file again from its source")
    return frames


def checksum(frame: Any) -> int:
    """A checksum of the first plane's pixels (grey, luminance, green, or all of packed colours)."""
    return zlib.crc32(np.ascontiguousarray(plane_of(frame, 0)).data)
