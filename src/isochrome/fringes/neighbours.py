"""What two neighbouring patches say of the order half-way between them, and how far they differ."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fringes.patches import Patches

Array = NDArray[np.floating]

BEND = np.array([0.004, 0.001, 0.001, 4e-4, 4e-4, 4e-4])
"""What two quadratics differ by half-way without noise: fringes, fringes/px, fringes/px²; and"""
_STEEP_BEND = 0.03
"""the share of their own size."""
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""To the neighbours on the right, below, and on the two diagonals below."""


def pairs(patches: Patches) -> Iterator[tuple[Any, Any, Array, Array]]:
    """Slices of the patches and of their neighbours a step on, and half the way (dy, dx)."""
    m, n = patches.chi.shape
    rows = patches.rows[:, None] + 0 * patches.cols
    cols = patches.cols[None, :] + 0 * patches.rows[:, None]
    for down, right in _STEPS:
        here = np.s_[: m - down, max(0, -right) : n - max(right, 0)]
        there = np.s_[down:, max(0, right) : n + min(right, 0)]
        yield here, there, 0.5 * (rows[there] - rows[here]), 0.5 * (cols[there] - cols[here])


def moved(terms: Array, dy: Array, dx: Array) -> Array:
    """A quadratic's terms (..., 6) about a place that is (dy, dx) from its middle."""
    n, gx, gy, hxx, hxy, hyy = np.moveaxis(terms, -1, 0)
    return np.stack(
        [
            n + gx * dx + gy * dy + 0.5 * hxx * dx * dx + hxy * dx * dy + 0.5 * hyy * dy * dy,
            gx + hxx * dx + hxy * dy,
            gy + hxy * dx + hyy * dy,
            hxx,
            hxy,
            hyy,
        ],
        axis=-1,
    )


def scale_of(a: Array, b: Array, variance: Array) -> Array:
    """How far two quadratics of one smooth field may differ, a standard deviation (..., 6)."""
    size = np.hypot(a, b)
    size[..., 0] = size[..., 1:3].max(axis=-1)
    return np.sqrt(variance + BEND**2 + (_STEEP_BEND * size) ** 2)
