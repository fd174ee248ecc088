"""Where a search of one frame starts: values over all that a cold scene may be wrong by."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.search_descent import Space
from isochrome.fit.search_field import BULK, FRICTION, LEFT, LOAD, SHEAR, WEAR
from isochrome.fit.search_pixels import SearchPixels

Array = NDArray[Any]

WIDEST_LOAD = 4.2
"""Factor in load, either way, that is tried."""

_CONTACT_LOADS, _BODY_LOADS = 24, 96
"""Loads tried: in a contact the far pixels, of low order, keep a basin of 10 %; a disc has none."""

_SHEAR_STEP = 0.2
_MOST_SHEAR = 0.5
"""Largest Q/P that is tried where friction itself is unknown."""

_WEAR = np.geomspace(0.3, 3.3, 5)
_PLACES = np.linspace(-0.075, 0.075, 5)
"""Places tried across, in widths of the picture."""

_BULK_FRINGES = np.arange(-12, 13) / 3.0

_ROWS = 40


def starting_rows(theta: Array, space: Space, *, contact: bool) -> Array:
    """Rows θ (m, 7) over load, shear or friction, wear and place about a scene's; bulk stays."""
    choices = [np.array([value]) for value in theta]
    free = set(space.free.tolist())
    if LOAD in free:
        count = _CONTACT_LOADS if contact else _BODY_LOADS
        choices[LOAD] = theta[LOAD] + np.log(WIDEST_LOAD) * np.linspace(-1.0, 1.0, count)
    if SHEAR in free:
        limit = 0.9 * abs(theta[FRICTION])
        if FRICTION in free:
            limit = max(limit, _MOST_SHEAR)
        choices[SHEAR] = _middles(limit)
    elif FRICTION in free and not space.held:
        choices[FRICTION] = _middles(max(0.6, 1.5 * abs(theta[FRICTION])))
    if WEAR in free:
        choices[WEAR] = theta[WEAR] + np.log(_WEAR)
    if LEFT in free and contact:
        choices[LEFT] = theta[LEFT] + space.size[LEFT] * _PLACES
    return space.allowed(np.array(list(product(*choices))))


def best_of_scan(pixels: SearchPixels, rows: Array, space: Space, count: int) -> Array:
    """The best `count` starts (count, 7) among rows θ (m, 7), each with many bulk stresses."""
    bulks = _BULK_FRINGES * space.size[BULK] if BULK in space.free else np.zeros(1)
    chi = np.concatenate(list(_scanned(pixels, rows, bulks)))
    order = np.argsort(chi, axis=None, kind="stable")[:count]
    order = order[np.isfinite(chi.ravel()[order])]
    row, bulk = np.unravel_index(order, chi.shape)
    starts = rows[row].copy()
    starts[:, BULK] += bulks[bulk]
    return starts


def _scanned(pixels: SearchPixels, rows: Array, bulks: Array) -> Iterator[Array]:
    """chi (some, bulks) of the rows, some at a time: bulk stress only adds to their fields."""
    for first in range(0, len(rows), _ROWS):
        field = pixels.field.difference(rows[first : first + _ROWS])
        chi = np.empty((len(field), len(bulks)))
        for i, bulk in enumerate(bulks):
            chi[:, i] = pixels.misfit(pixels.signal(field + bulk if bulk else field)).chi
        yield chi


def _middles(limit: float) -> Array:
    """Values about zero, to `limit` either way, at the middles of equal steps."""
    count = 2 * max(1, int(np.ceil(limit / _SHEAR_STEP)))
    return limit * (2.0 * np.arange(count) + 1.0 - count) / count
