"""What a pixel's area makes of the fringes: less contrast, and a mean order; never aliasing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

_ROWS = 64
"""Rows at a time: what is made of them stays in the processor's cache, which halves the time."""

_TINY = 1e-15
"""Added to a sinc's argument, so that 0/0 is 1; far below what changes any other."""


def pixel_visibility(order: Array) -> tuple[Array, float]:
    """Contrast V, in 0..1, that square pixels leave of the fringes, and the share too fine to see.

    The mean of cos 2 pi N over a pixel in which N has the gradient g (fringes a pixel) is sinc(g_x)
    sinc(g_y) cos 2 pi N, sinc(x) = sin(pi x)/(pi x), taken as 0 where negative. The share: of
    pixels with fringes (N > 1/2), those with one finer than two pixels. NaN: no specimen.
    """
    visibility, fine = np.empty_like(order), 0
    for start in range(0, len(order), _ROWS):
        here = slice(start, start + _ROWS)
        above = min(start, 1)
        rows = _slope(order[start - above : start + _ROWS + 1], 0)[above:][:_ROWS]
        cols = _slope(order[here], 1)
        contrast = slope_visibility(rows, cols, out=visibility[here])
        # sinc(g_x) sinc(g_y) <= 0.651 wherever g_x² + g_y² > 1/4: few pixels need the look
        likely = contrast < 0.66
        if likely.any():
            steep = np.hypot(rows[likely], cols[likely]) > 0.5
            fine += int(np.count_nonzero(steep & (order[here][likely] > 0.5)))
    bearing = int(np.count_nonzero(order > 0.5))
    return visibility, fine / bearing if bearing else 0.0


def slope_visibility(rows: Array, cols: Array, *, out: Array | None = None) -> Array:
    """Contrast V, in 0..1, that square pixels leave where the order has slopes in fringes a pixel.

    Equation: sinc(g_x) sinc(g_y), see `pixel_visibility`; `rows` are the slopes down the picture.
    """
    return np.multiply(_sinc(rows), _sinc(cols), out=out)


def mean_order(order: Array, *, stride: int = 1) -> Array:
    """The order M (rows, cols) that square pixels show of N in their middles, NaN off the specimen.

    Over a pixel of side 1 the mean of exp(2 pi i N) is V exp(2 pi i M), M = N + (d²N/dx² +
    d²N/dz²)/24, to second order in the pixel's size; V, see `pixel_visibility`. Beside an edge N
    has the bend of the next pixel, or none. `stride`: pixels from one entry to the next.
    """
    bend = _bend(order, 0)
    bend += _bend(order, 1)
    bend *= 1.0 / (24.0 * stride**2)
    bend += order
    return bend


def _sinc(x: Array) -> Array:
    """sin(pi x)/(pi x), and nothing where it turns the fringes' contrast round."""
    angle = np.pi * x
    angle += _TINY
    value = np.sin(angle)
    value /= angle
    result: Array = np.maximum(value, 0.0, out=value)
    return result


def _slope(order: Array, axis: int) -> Array:
    """Fringes a pixel along an axis: the mean of the differences to the neighbours with an order.

    An edge of the specimen is so no fringe; 0 where there is neither neighbour.
    """
    if order.shape[axis] < 2:
        return np.zeros_like(order)
    slope = _known_slope(order, axis)
    if not math.isfinite(float(slope.max())):
        slope[~np.isfinite(order)] = 0.0
        at = _places(~np.isfinite(slope))
        total, count = np.zeros((2, len(at[0])), dtype=order.dtype)
        for step in (-1, 1):
            has, beside = _beside(at, axis, step, order.shape)
            change = np.where(has, (order[beside] - order[at]) * step, np.nan)
            known = np.isfinite(change)
            total += np.where(known, change, 0.0)
            count += known
        slope[at] = total / np.maximum(count, 1.0)
    return slope


def _places(where: NDArray[np.bool_]) -> tuple[NDArray[np.intp], ...]:
    """Rows and columns of the few pixels of a mask, a tenth of np.nonzero's time."""
    return np.unravel_index(np.flatnonzero(where), where.shape)


def _beside(
    at: tuple[NDArray[np.intp], ...], axis: int, step: int, shape: tuple[int, ...]
) -> tuple[NDArray[np.bool_], tuple[NDArray[np.intp], ...]]:
    """Whether pixels have a neighbour along an axis, and its place, or their own."""
    there = at[axis] + step
    has = (there >= 0) & (there < shape[axis])
    return has, tuple(np.where(has, there, p) if k == axis else p for k, p in enumerate(at))


def _bend(order: Array, axis: int) -> Array:
    """Second differences along an axis; beside an edge those of the next pixel, or none."""
    if order.shape[axis] < 3:
        return np.zeros_like(order)
    bend = np.empty_like(order)
    n, b = order.swapaxes(0, axis), bend.swapaxes(0, axis)
    np.multiply(n[1:-1], -2.0, out=b[1:-1])
    b[1:-1] += n[2:]
    b[1:-1] += n[:-2]
    b[0], b[-1] = b[1], b[-2]
    for step in (1, -1):
        at = _places(np.isnan(bend))
        bend[at] = bend[_beside(at, axis, step, order.shape)[1]]
    bend[np.isnan(bend)] = 0.0
    return bend


def _known_slope(order: Array, axis: int) -> Array:
    """The slope where every pixel has an order: central differences, one-sided at the borders."""
    slope = np.empty_like(order)
    n, s = order.swapaxes(0, axis), slope.swapaxes(0, axis)
    np.subtract(n[2:], n[:-2], out=s[1:-1])
    s[1:-1] *= 0.5
    s[0], s[-1] = n[1] - n[0], n[-1] - n[-2]
    return slope
