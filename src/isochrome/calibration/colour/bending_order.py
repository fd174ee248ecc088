"""The order at every pixel of a beam in four-point bending whose fringe value is known.

Between the inner rollers the moment is M = P (Lo - Li)/4 and the stress rises linearly over the
height h, so that N = 12 M |y|/(h³ f_sigma) at the distance y from the neutral line: the thickness
cancels. Where that line lies and how it is tilted is found from the colours: pixels of one order
must be of one colour, on both sides of it.
Source: Timoshenko & Goodier (1970), Theory of Elasticity, art. 21.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.colour.settings import ColourBeam
from isochrome.errors import PhysicsError

Array = NDArray[Any]

LARGEST_TILT = 0.1
"""Rows a column; a beam tilted by more is asked to be turned."""

_PIXELS = 4_000
_CELL = 0.02
_ROWS = 1.5
_STEP = 0.04
_TILTS = 9
_LEAST_SHARE = 0.5
_RIM = 0.98
_LARGEST_SCATTER = 0.2


def known_beam_order(signal: Array, beam: ColourBeam, load_n: float, pixel_mm: float) -> Array:
    """The order N (rows, cols) of a beam in an image, NaN off the beam.

    Parameters: `signal` (rows, cols, 3), normalised, NaN = not trusted; `beam`; `load_n`, the
    whole load; `pixel_mm`. Returns N. Raises PhysicsError where no line splits the image into two
    sides of like colours.
    """
    from scipy.optimize import minimize

    moment = 0.25 * load_n * (beam.outer_span_mm - beam.inner_span_mm)
    slope = 12.0 * moment / (beam.height_mm**3 * beam.fringe_value_n_per_mm) * pixel_mm
    half = 0.5 * _RIM * beam.height_mm / pixel_mm
    rows, cols = np.nonzero(np.isfinite(signal).all(axis=-1))
    if len(rows) < 100:
        raise PhysicsError("fewer than 100 pixels of the beam can be trusted; check the mask")
    picked = np.random.default_rng(0).choice(len(rows), min(_PIXELS, len(rows)), replace=False)
    place = np.stack([rows[picked], cols[picked] - 0.5 * (signal.shape[1] - 1)]).astype(float)
    colours = signal[rows[picked], cols[picked]].astype(float)

    def cost(line: Array) -> float:
        return _scatter(place, colours, line, slope, half)

    step = max(_STEP / slope, 0.5)
    tops = np.arange(rows.min(), rows.max() + step, step)
    tilts = np.linspace(-LARGEST_TILT, LARGEST_TILT, _TILTS)
    starts = [np.array([top, tilt]) for top in tops for tilt in tilts]
    best = sorted(starts, key=cost)[:3]
    fine = [
        minimize(cost, start, method="Nelder-Mead", options={
            "initial_simplex": start + np.array([[0.0, 0.0], [step, 0.0], [0.0, 0.02]]),
            "xatol": 1e-4, "fatol": 1e-9, "maxiter": 300,
        })
        for start in best
    ]  # fmt: skip
    found = min(fine, key=lambda end: float(end.fun))
    if not found.fun < _LARGEST_SCATTER:
        raise PhysicsError(
            f"{100 * found.fun:.0f} % of the colours' variance is left at one order: no neutral "
            "line with a rise of the order by load_n, the spans and the fringe value is in the "
            "image; check these numbers, pixel_mm and the roi (between the inner rollers)"
        )
    grid = np.indices(signal.shape[:2]).astype(float)
    grid[1] -= 0.5 * (signal.shape[1] - 1)
    away = _away(grid, found.x)
    return np.where(np.abs(away) < half, slope * np.abs(away), np.nan)


def _away(place: Array, line: Array) -> Array:
    """Distance of (row, col from the middle) from a line of (row at the middle, rows a column)."""
    return np.asarray((place[0] - line[0] - line[1] * place[1]) / np.hypot(1.0, line[1]))


def _scatter(place: Array, colours: Array, line: Array, slope: float, half: float) -> float:
    """Share of the colours' variance that is within cells of one order."""
    away = _away(place, line)
    reach = min(half, float(away.max()), float(-away.min()))  # where there are two sides
    away = np.abs(away)
    inside = away < reach
    if np.count_nonzero(inside) < _LEAST_SHARE * len(away):
        return 1.0
    colours = colours[inside]
    width = max(_CELL, _ROWS * slope)  # so that a cell has rows of both sides
    cell = (slope * away[inside] / width).astype(int)
    count = np.maximum(np.bincount(cell), 1)
    within = 0.0
    for channel in colours.T:
        mean = np.bincount(cell, weights=channel) / count
        within += float(np.sum((channel - mean[cell]) ** 2))
    return within / float(np.sum((colours - colours.mean(axis=0)) ** 2))
