"""What a light of three bands leaves of colour frames: the table's bend, the illumination's relief.

A camera's tone curve and colours are not quite a power and a matrix, and no lamp is a quadratic
surface. Both rests are what the frames say across the curve of colours: along it, a rest is
nothing but another order, and the orders' scale stays the bands'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from isochrome.fringes.colour.colour_table import STEP, ColourTable
from isochrome.fringes.windows import Array, Indices

BEND_WIDTH = 0.04
"""Fringes over which the bend is smoothed, standard deviation."""

RELIEF_WIDTH = 0.03
"""The same of the relief, over the frame's longer side."""

_GAIN = 0.7
_LARGEST = 0.15
_LEAST_SLOPE = 0.3


@dataclass(frozen=True)
class RemainingLight:
    """`bend` (orders, 3), added to the bands' table; `relief` (rows, cols), a factor of the
    illumination.
    """

    bend: Array
    relief: Array

    def bent(self, table: ColourTable) -> ColourTable:
        """The bands' table with the bend; below no light there is none."""
        bend = self.bend[: len(table.signal)]
        return ColourTable(np.maximum(table.signal + bend, 0.0), table.spread)


def added_bend(place: Indices, away: Array, table: ColourTable, length: int) -> Array:
    """What pixels add to the bend: their mean rest at each order, across the curve.

    Parameters: `place` (n,), rows of the table; `away` (n, 3), signals less the table's; `table`;
    `length` of the bend. Returns (length, 3).
    """
    size, width = len(table.signal), BEND_WIDTH / STEP
    left = np.clip(away, -_LARGEST, _LARGEST).T
    sums = [np.bincount(place, weights=w, minlength=size) for w in (np.ones(len(place)), *left)]
    count, *total = gaussian_filter1d(np.array(sums), width, axis=1, mode="constant")
    mean = (np.array(total) / (count + 1.0)).T
    unit = gaussian_filter1d(table.slope, 0.5 * width, axis=0)
    unit /= np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), _LEAST_SLOPE)
    added = np.zeros((length, 3))
    added[:size] = _GAIN * (mean - unit * np.sum(unit * mean, axis=1, keepdims=True))
    return added


def added_relief(sums: Array) -> Array:
    """What frames add to the relief, over it, (rows, cols).

    Equation: Σ r·a / Σ a·a over a window and all frames, r the rests and a the signals, both
    across the curve of colours. Parameters: `sums` (2, rows, cols), of the pixels.
    """
    width = RELIEF_WIDTH * max(sums.shape[1:])
    rest, size = (gaussian_filter(part, width) for part in sums)
    return np.asarray(_GAIN * rest / (size + 0.01))
