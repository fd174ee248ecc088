"""The orders of fringe lines that were found in an image, from a reading of the order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.fringes.skeleton import Skeleton

_APART = 0.15
"""Fringes between a line and its half order: a crest that is no order line lies farther off."""

_MOST = 0.75
_KNOWN = 0.5


def number_lines(lines: Sequence[Skeleton], order: ArrayLike) -> list[Skeleton]:
    """Give fringe lines the half order that the reading has along them.

    Equation: k/2 nearest to the median of N along the line, where N is known on half of its points
    or more, and within 0.15 fringe of k/2 on three quarters of these; else the line's order is not
    known, as that of a crest where the order turns back.
    Parameters: `lines`, see `isochrome.fringes.skeleton`; `order` N (rows, cols), fringes, NaN =
    not known. Returns the lines in their order, each with its `order`.
    """
    field = np.asarray(order, dtype=np.float64)
    return [replace(line, order=_order_of(line, field)) for line in lines]


def _order_of(line: Skeleton, order: NDArray[np.float64]) -> float | None:
    """The half order along a line, None where it is not known."""
    rows = np.clip(np.rint(line.rows).astype(int), 0, order.shape[0] - 1)
    cols = np.clip(np.rint(line.cols).astype(int), 0, order.shape[1] - 1)
    along = order[rows, cols]
    known = along[np.isfinite(along)]
    if known.size == 0 or known.size < _KNOWN * along.size:
        return None
    level = 0.5 * np.rint(2.0 * np.median(known))
    near = np.abs(known - level) < _APART
    return float(level) if near.mean() >= _MOST else None
