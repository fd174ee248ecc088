"""A half-plane's field made on a plain grid, at the places that a camera's pixels look at."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from isochrome.stress.pixels import PixelGrid

N = TypeVar("N", bound=np.inexact)

_ABOVE = 6
"""Rows above the surface that a field is continued over: a spline feels no more of them."""


def seen_by(field: NDArray[N], grid: PixelGrid, pixels: PixelGrid) -> NDArray[N]:
    """Interpolate a field (rows, cols) where pixels look, by cubic splines; 0 above the surface.

    A jump at the surface would ring in the spline: the field goes on as f(-z) = 2 f(0) - f(z), with
    its value and slope. The grid's rows lie half a pixel below the surface and at whole pixels from
    there, see `PixelGrid.around`. Without a lens the field is returned as it is.
    """
    from scipy.ndimage import map_coordinates

    if pixels.lens is None:
        return field
    x, z = pixels.places
    places = [(v - v0) / grid.pixel_mm - 0.5 for v, v0 in ((z, grid.top_mm), (x, grid.left_mm))]
    first = round(-grid.top_mm / grid.pixel_mm)
    if 0 < first < len(field):
        field = field.copy()
        near = field[first : first + min(_ABOVE, first, len(field) - first)]
        surface = 1.5 * near[0] - 0.5 * near[min(1, len(near) - 1)]
        field[first - len(near) : first] = (2.0 * surface - near)[::-1]
    found = map_coordinates(field, np.broadcast_arrays(*places), order=3, mode="nearest")
    return np.where(z >= 0.0, found, 0).astype(field.dtype)
