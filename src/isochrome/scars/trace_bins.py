"""A trace made ready: without its spikes, as means over equal bins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.scars.trace import Trace

Array = NDArray[Any]

MOST_BINS = 240
"""Bins of a trace: a scar of a tenth of it has 24, and their covariance is a small matrix."""

_HALF_WINDOW = 7
"""Points on each side of the running median that a spike is told from."""

_SPIKE = 7.0
"""Robust standard deviations that no rough surface reaches in ten thousand points."""


@dataclass(frozen=True)
class BinnedTrace:
    """Means of a trace over n equal bins, and how many spikes were left out.

    `x_mm` (n,): the bins' middles; `z_um` (n,): mean heights; `filled` (n,): bins without a point
    of their own, taken from their neighbours; `spikes`: points left out.
    """

    x_mm: Array
    z_um: Array
    filled: NDArray[np.bool_]
    spikes: int

    @property
    def spacing_mm(self) -> float:
        """Width of a bin, mm."""
        return float(self.x_mm[1] - self.x_mm[0])


def without_spikes(z_um: Array) -> NDArray[np.bool_]:
    """Which points are no spikes: near the running median of their neighbours (n,).

    The distance is told in robust standard deviations, 1.4826 times the median distance.
    """
    half = min(_HALF_WINDOW, (len(z_um) - 1) // 4)
    padded = np.pad(z_um, half, mode="reflect", reflect_type="odd")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    away = np.abs(z_um - np.median(windows, axis=1))
    size = 1.4826 * float(np.median(away))
    largest = float(np.abs(z_um).max())
    return np.asarray(away <= max(_SPIKE * size, 1e-9 * largest))


def bin_trace(trace: Trace) -> BinnedTrace:
    """Bin a trace, without its spikes; the line through its ends is taken off and put back.

    Means over bins of points at unequal x would carry the tilt otherwise.
    """
    x, z = trace.x_mm, trace.z_um
    slope = (z[-1] - z[0]) / (x[-1] - x[0])
    line = slope * (x - x[0])
    good = without_spikes(z - line)
    count = min(MOST_BINS, len(x) // 2 if len(x) < 2 * MOST_BINS else MOST_BINS)
    step = (x[-1] - x[0]) / count
    place = np.minimum(((x - x[0]) / step).astype(int), count - 1)
    members = np.bincount(place[good], minlength=count)
    sums = np.bincount(place[good], (z - line)[good], minlength=count)
    filled = members == 0
    middle = x[0] + step * (np.arange(count) + 0.5)
    mean = sums / np.maximum(members, 1)
    mean[filled] = np.interp(middle[filled], middle[~filled], mean[~filled])
    return BinnedTrace(middle, mean + slope * (middle - x[0]), filled, int((~good).sum()))
