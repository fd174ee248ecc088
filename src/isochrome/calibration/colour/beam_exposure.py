"""How long each image of a beam was exposed against its no-load frames.

Every pixel's order N is known, and the table t(N) is not: with u = I/A and d = D/A, A the contrast
of the no-load frames and D their background, I = e (D + A t) of each image is

    f u - d = t(N),   f = 1/e,

linear in the factors f and in the table, whose values are eliminated order by order. One factor
for all is left open, since twice the light is twice the table: it is that by which the table is
the one of some light (`band_scale`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.fringes import band_scale

Array = NDArray[Any]

ALIKE = 0.02
"""Share by which images may differ in brightness and still be of one exposure."""

SAME = 0.05
"""The same against the no-load frames: a light's bands do not tell the factor of all to better."""

_CELL = 0.02
_LEAST_PIXELS = 5


def image_exposures(
    light: Sequence[Array], dark: Array, contrast: Array, orders: Sequence[Array], *, bright: bool
) -> Array:
    """Exposure of each image of a beam over that of the no-load frames.

    Parameters: `light` of the images, NaN = not trusted, `dark` and `contrast`, of the no-load
    frames, all (rows, cols, 3); `orders` (rows, cols), NaN off the beam; `bright`, whether the
    images show the bright field. Returns the factors e (images,), 1 where there is no difference.
    Raises PhysicsError where the images have no order in common.
    """
    cells = int(max(np.nanmax(order) for order in orders) / _CELL) + 1
    sums = [_sums(*pair, dark, contrast, cells) for pair in zip(light, orders, strict=True)]
    count, lit, low = np.moveaxis(np.stack(sums), 1, 0)
    lit, low = lit / np.maximum(count, 1.0), low / np.maximum(count, 1.0)
    factors = _relative(count, lit, low)
    if np.ptp(np.log(factors)) < ALIKE:
        factors = np.ones(len(factors))
    weight = np.maximum(count.sum(axis=0), 1.0)
    table = ((factors[:, None, None] * lit - low) * count).sum(axis=0) / weight
    seen = (count.sum(axis=0) >= _LEAST_PIXELS).all(axis=1)
    places = _CELL * (np.flatnonzero(seen) + 0.5)
    away = np.log(band_scale(places, table[seen], bright=bright) / factors)
    nearest = away[np.argmin(np.abs(away))]
    if abs(nearest) < SAME:
        away = away - nearest
    return np.asarray(np.exp(away))


def _sums(light: Array, order: Array, dark: Array, contrast: Array, cells: int) -> Array:
    """Pixels, and sums of u and d, in cells of one order (3, cells, channels)."""
    sums = np.zeros((3, cells, light.shape[-1]))
    for c in range(light.shape[-1]):
        known = np.isfinite(order) & np.isfinite(light[..., c])
        cell = (order[known] / _CELL).astype(int)
        size = contrast[..., c][known]
        parts = (np.ones(len(cell)), light[..., c][known] / size, dark[..., c][known] / size)
        sums[:, :, c] = [np.bincount(cell, weights=part, minlength=cells) for part in parts]
    return sums


def _relative(count: Array, lit: Array, low: Array) -> Array:
    """Factors f of the images over that of the one with most light, by least squares.

    Parameters, all (images, cells, channels): `count` of pixels, the means `lit` of u and `low`
    of d.
    """
    whole = np.maximum(count.sum(axis=0), 1.0)
    size, back = count * lit, (count * low).sum(axis=0)
    matrix = np.diag((size * lit).sum(axis=(1, 2)))
    matrix -= np.einsum("ibc,jbc->ij", size / whole, size)
    right = (size * (low - back / whole)).sum(axis=(1, 2))
    first = int(np.argmax(np.diag(matrix)))
    others = np.arange(len(count)) != first
    factors = np.ones(len(count))
    if others.any():
        inner = matrix[np.ix_(others, others)]
        factors[others] = np.linalg.solve(inner, (right - matrix[:, first])[others])
    if not (factors > 0.0).all():
        raise PhysicsError(
            "the images' colours at one order have nothing in common, whatever their exposures; "
            "check load_n, the fringe value and the roi"
        )
    return factors
