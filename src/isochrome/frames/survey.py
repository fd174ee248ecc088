"""One pass over the frames: what `check_frames` needs to know of each."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.noise import estimate_noise, full_scale
from isochrome.frames.reader import FrameReader, Mask


@dataclass
class Survey:
    """Raw figures of each frame, in raw grey levels, and of all together.

    Of the specimen's pixels, where the frames carry its mask.
    `low`, `high`: 2nd and 98th percentile; `saturated`: share at full scale;
    `smallest`, `largest`: of the finite pixels, NaN where there are none; `not_finite`: share;
    `noise`: sigma at mid level of frames 0, 1, 3, 7, ...; `twins`: (frame, earlier equal one);
    `bits`: all values or-ed together; `failure`: why reading ended before the end.
    """

    count: int = 0
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    saturated: list[float] = field(default_factory=list)
    smallest: list[float] = field(default_factory=list)
    largest: list[float] = field(default_factory=list)
    not_finite: list[float] = field(default_factory=list)
    noise: list[float] = field(default_factory=list)
    twins: list[tuple[int, int]] = field(default_factory=list)
    untimed: int = 0
    bits: int = 0
    failure: str | None = None


def survey(reader: FrameReader) -> Survey:
    """Read all frames once, in memory that does not grow with them.

    Parameters: `reader`. Returns a Survey; an InputError on the way ends it and is kept in
    `failure`.
    """
    found, seen = Survey(), dict[bytes, int]()
    full = full_scale(reader.bit_depth)
    try:
        for frame in reader:
            _add(found, frame.image, full, frame.mask)
            key = hashlib.sha1(frame.image.data, usedforsecurity=False).digest()
            first = seen.setdefault(key, frame.index)
            if first != frame.index:
                found.twins.append((frame.index, first))
            if frame.time_s is None:
                found.untimed += 1
            if frame.index & (frame.index + 1) == 0:
                _add_noise(found, frame.image, reader.bit_depth)
            found.count += 1
    except InputError as error:
        found.failure = str(error)
    return found


def _add(found: Survey, image: np.ndarray, full: float, mask: Mask | None) -> None:
    image = image.ravel() if mask is None else image[mask]  # light off the specimen says nothing
    values = image[np.isfinite(image)]
    found.not_finite.append(1 - values.size / image.size)
    if values.size == 0:
        for figures in (found.low, found.high, found.smallest, found.largest):
            figures.append(float("nan"))
        found.saturated.append(0.0)
        return
    low, high = np.percentile(values[:: max(1, values.size // 50_000)], (2, 98))
    found.low.append(float(low))
    found.high.append(float(high))
    found.saturated.append(float(np.mean(values >= full)))
    found.smallest.append(float(values.min()))
    found.largest.append(float(values.max()))
    if image.dtype.kind == "u":
        found.bits |= int(np.bitwise_or.reduce(values, axis=None))


def _add_noise(found: Survey, image: np.ndarray, bit_depth: int | None) -> None:
    try:
        model = estimate_noise(image, bit_depth=bit_depth)
    except InputError:  # too small: said by the size's own finding
        return
    found.noise.append(float(model.sigma(np.median(image[np.isfinite(image)]))))
