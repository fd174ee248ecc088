"""Where each frame of a video is, and what the packets tell of it without decoding."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.containers import Container
from isochrome.frames.decoding import opened
from isochrome.frames.h264 import begins_anew, length_bytes
from isochrome.frames.source import next_time, refusing

FRAME_BY_PACKET = ("rawvideo", "ffv1", "mjpeg", "png", "huffyuv", "ffvhuff", "utvideo")
"""Codecs whose every packet is one frame, in the order of display."""


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
    with opened(path) as (container, stream):
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
            tick = None if packet is None else _tick(packet, kind)
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


def _tick(packet: Any, kind: Container) -> int | None:
    """The tick of the frame in a packet, as `decoded` tells it."""
    tick: int | None = packet.dts if kind == "avi" else packet.pts
    return tick


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
