"""Two parallel edges in a picture, found along every row or column, and how far apart they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from isochrome.errors import PhysicsError

Array = NDArray[np.float64]

SMOOTH_PX = 1.5
"""Standard deviation of the Gaussian whose slope finds an edge: the slope's peak is then nearly
Gaussian itself, and three pixels give its place."""

OFF_PX = 1.5
"""How far from its line a point may lie."""

LEAST_SHARE = 0.6
"""Share of the rows or columns in which both edges must be found."""

LEAST_POINTS = 20
"""Rows or columns that a picture must have them in at least."""

FINDER_PX = 0.01
"""What the place of an edge may be off by alike in all rows, by where in a pixel it lies."""

_ROUNDS = 10
_CLEAR = 3.0


@dataclass(frozen=True, kw_only=True)
class EdgePair:
    """Two edges: the points (n, 2) of each, column and row (px), their distances (n, 2) from their
    lines, and the lines' `distance_px` along their normal with its standard uncertainty.
    `spreading` is the change of the distance along the edges, where it is clear.
    """

    points: tuple[Array, Array]
    residual_px: tuple[Array, Array]
    distance_px: float
    standard_uncertainty: float
    spreading: float


def find_edge_pair(image: Array, *, name: str) -> EdgePair:
    """Find the two edges, upright or lying, whichever more rows or columns show.

    Parameters: `image` (rows, cols), any grey levels; `name`, for messages. Returns the EdgePair.
    Raises PhysicsError where there are not two straight ones.
    """
    tries = [(_along(picture), turned) for picture, turned in ((image, False), (image.T, True))]
    (lines, turned) = max(tries, key=lambda found: 0 if found[0] is None else len(found[0][0]))
    if lines is None:
        raise PhysicsError(
            f"{name}: no two straight edges are found; show one bar or specimen, dark before "
            "bright or bright before dark, with both its edges through the picture from side to "
            "side, sharp and in ordinary light"
        )
    across, first, second = lines
    return _pair(across, (first, second), turned)


def _along(image: Array) -> tuple[Array, Array, Array] | None:
    """Rows in which both edges lie on their lines, and the edges' columns; None for too few."""
    slope = gaussian_filter1d(image, SMOOTH_PX, axis=1, order=1, mode="nearest")
    row = np.arange(len(image), dtype=float)
    rising, falling = _peaks(slope), _peaks(-slope)
    good = np.isfinite(rising) & np.isfinite(falling)
    for _ in range(_ROUNDS):
        if good.sum() < max(LEAST_POINTS, LEAST_SHARE * len(image)):
            return None
        off = [np.abs(edge - _robust(row, edge, good)) for edge in (rising, falling)]
        new = (off[0] < OFF_PX) & (off[1] < OFF_PX)
        if np.array_equal(new, good):
            break
        good = new
    if good.sum() < max(LEAST_POINTS, LEAST_SHARE * len(image)):
        return None
    return row[good], rising[good], falling[good]


def _peaks(slope: Array) -> Array:
    """Where each row is steepest, to a part of a pixel; NaN at the picture's sides.

    The peak of a Gaussian through three pixels: that of a parabola through their logarithms.
    """
    best = np.argmax(slope, axis=1)
    inside = (best > 0) & (best < slope.shape[1] - 1)
    row, middle = np.arange(len(slope)), np.clip(best, 1, slope.shape[1] - 2)
    three = [slope[row, middle + k] for k in (-1, 0, 1)]
    usable = inside & (np.min(three, axis=0) > 0.0)
    low, top, high = (np.log(np.where(usable, value, 1.0)) for value in three)
    bend = low - 2.0 * top + high
    usable &= bend < 0.0
    shift = 0.5 * (low - high) / np.where(usable, bend, 1.0)
    return np.where(usable, middle + shift, np.nan)


def _robust(row: Array, edge: Array, good: NDArray[np.bool_]) -> Array:
    """A line through points of which some are wrong: the median of the slopes, and of the rest."""
    x, y = row[good], edge[good]
    half = x.size // 2
    slope = float(np.median((y[half : 2 * half] - y[:half]) / (x[half : 2 * half] - x[:half])))
    return np.asarray(slope * row + np.median(y - slope * x))


def _pair(across: Array, edges: tuple[Array, Array], turned: bool) -> EdgePair:
    """The two lines with one direction, and what their points' scatter makes of the distance."""
    x = across - across.mean()
    slopes = [float(x @ edge / (x @ x)) for edge in edges]
    slope, middles = float(np.mean(slopes)), [float(edge.mean()) for edge in edges]
    long = float(np.hypot(1.0, slope))
    residual = [(e - m - slope * x) / long for e, m in zip(edges, middles, strict=True)]
    distance = abs(middles[1] - middles[0]) / long
    scatter = [float(np.sqrt(r @ r / (r.size - 2))) for r in residual]
    noise = math.hypot(*scatter) / np.sqrt(x.size)
    tilt = math.hypot(*scatter) / (2.0 * float(np.sqrt(x @ x)))
    turn = distance * slope / long**2 * tilt  # what the direction's noise does to the distance
    apart = abs(slopes[1] - slopes[0])
    clear = apart > _CLEAR * 2.0 * tilt
    order = 1 if turned else -1
    points = [np.stack([across, edge][::order], axis=-1) for edge in edges]
    normal = np.array([-slope, 1.0][::order]) / long
    return EdgePair(
        points=(points[0], points[1]),
        residual_px=(residual[0][:, None] * normal, residual[1][:, None] * normal),
        distance_px=distance,
        standard_uncertainty=float(np.sqrt(noise**2 + turn**2 + 2.0 * FINDER_PX**2)),
        spreading=apart * float(np.ptp(x)) / distance if clear else 0.0,
    )
