"""Decoding a video with PyAV: every frame in the order of display, with its own time stamp.

And where each of them is, by what the packets tell of it without decoding.
"""

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
from isochrome.frames.integrity.containers import Container
from isochrome.frames.integrity.packets import begins_anew, is_whole, length_bytes
from isochrome.frames.readers.pixel_formats import plane_of
from isochrome.frames.source import MAX_PIXELS, check_aspect, check_size, next_time, refusing

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

FRAME_BY_PACKET = ("rawvideo", "ffv1", "mjpeg", "png", "huffyuv", "ffvhuff", "utvideo")
"""Codecs whose every packet is one frame, in the order of display."""


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
    with open_container(path) as (container, stream):
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
def open_container(path: Path) -> Iterator[tuple[Any, Any]]:
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
    if aspect:
        check_aspect(path, aspect.numerator, aspect.denominator)


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
    result: list[Any] = frames
    return result


def checksum(frame: Any) -> int:
    """A checksum of the first plane's pixels (grey, luminance, green, or all of packed colours)."""
    return zlib.crc32(np.ascontiguousarray(plane_of(frame, 0)).data)


@dataclass(frozen=True)
class Places:
    """What is known of each frame of a video, in their order.

    `times_s` from the first (NaN: unknown), `stamps`, the file's own ticks, `sums`, checksums of
    the decoded first plane, `keys`, where decoding can begin: (frame, tick), and `end_s`. Where the
    packets alone have told it, `sums` is None, and the stamps are what frames are held against.
    """

    times_s: np.ndarray
    stamps: np.ndarray
    sums: np.ndarray | None
    keys: np.ndarray
    end_s: float | None


def by_packets(path: Path, kind: Container) -> Places | None:
    """What the packets tell; None where they may be other than a frame each.

    Parameters: `path`; `kind` of container. Raises InputError where the file cannot be opened.
    """
    ticks: list[int] = []
    keys: list[int] = []
    with open_container(path) as (container, stream):
        context = stream.codec_context
        length = length_bytes(context.extradata) if context.name == "h264" else None
        if length is None and context.name not in FRAME_BY_PACKET:
            return None
        base, packets = stream.time_base, container.demux(stream)
        while True:
            try:
                with refusing(path):
                    packet = next(packets, None)
            except InputError:  # decoding says it better
                return None
            tick = None if packet is None else packet.dts if kind == "avi" else packet.pts
            if packet is None or (packet.size == 0 and tick is None):  # the end
                break
            if packet.size == 0 or packet.is_corrupt or packet.is_discard or tick is None:
                return None
            key = packet.is_keyframe if length is None else begins_anew(bytes(packet), length)
            if key is None:
                return None
            if key:
                keys.append(len(ticks))
            ticks.append(tick)
    return _in_order(np.array(ticks, np.int64), keys, base, reordered=length is not None)


def _in_order(ticks: np.ndarray, keys: list[int], base: Any, *, reordered: bool) -> Places | None:
    """Places by the packets' ticks, which rise but where frames are `reordered`; None else."""
    stamps = np.sort(ticks) if reordered else ticks
    if len(stamps) < 2 or not (np.diff(stamps) > 0).all():
        return None
    if reordered:  # all that comes before a key frame in the file has to be shown before it
        closed = (stamps == ticks) & (np.maximum.accumulate(ticks) == ticks)
        if 0 not in keys or not closed[keys].all():
            return None
    times = np.array([float((int(tick) - int(stamps[0])) * base) for tick in stamps])
    places = np.array([(key, ticks[key]) for key in keys], np.int64)
    return Places(times, stamps, None, places, next_time(float(times[-2]), float(times[-1])))
