"""Means and sums over blocks and windows of pixels, and the types of maps and masks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

Array = NDArray[Any]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


def block_means(values: Array, by: int) -> Array:
    """Means over blocks of by x by pixels; a rim narrower than a block is left out.

    Parameters: `values` (rows, cols, ...); `by`, pixels a side. Returns (rows // by, cols // by,
    ...).
    """
    rows, cols = (n // by for n in values.shape[:2])
    cut = values[: rows * by, : cols * by]
    return np.asarray(cut.reshape(rows, by, cols, by, *values.shape[2:]).mean(axis=(1, 3)))


def valid_means(values: Array, valid: Mask, by: int) -> Array:
    """Means over the valid pixels of each block; about nought where there are none.

    Parameters: `values` and `valid`, True = trusted, of one shape, and `by` as in `block_means`.
    """
    share = block_means(valid.astype(float), by)
    return block_means(np.where(valid, values, 0.0), by) / np.maximum(share, 1e-9)


def gaussian_sum(values: Array, width_px: float) -> Array:
    """Sum over a Gaussian window whose weight is 1 in the middle.

    Parameters: `values` (rows, cols), nought where masked; `width_px`, the window's standard
    deviation. Returns (rows, cols), single precision.
    The square of such a window is one of width/√2: it gives the variance of a pooled sum.
    """
    area = 2.0 * np.pi * width_px**2
    return np.asarray(area * gaussian_filter(values.astype(np.float32), width_px, mode="constant"))


def pooled(values: Array, width_px: float) -> Array:
    """Mean over a Gaussian window, in single precision.

    Parameters: `values` (rows, cols), real or complex, nought where masked; `width_px`, the
    window's standard deviation. Returns (rows, cols).
    """
    single = np.complex64 if np.iscomplexobj(values) else np.float32
    return np.asarray(gaussian_filter(values.astype(single), width_px))


def nearest_known(values: Array, known: Mask) -> Array:
    """Values (rows, cols), those of unknown pixels from the nearest known one."""
    near = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(near)])


def innermost(where: Mask) -> tuple[int, int]:
    """Row and column of the pixel of a mask (rows, cols) that lies farthest from its edge."""
    depth = distance_transform_edt(np.pad(where, 1))[1:-1, 1:-1]
    row, col = np.unravel_index(depth.argmax(), depth.shape)
    return int(row), int(col)


def masked(values: Array, known: Mask) -> Array:
    """Values (rows, cols) float32, NaN where they are not known."""
    return np.where(known, values, np.nan).astype(np.float32)


def beside_jumps(order: Array, largest: float) -> Mask:
    """Pixels (rows, cols) on either side of a step of the order that is larger (fringes)."""
    found = np.zeros(order.shape, dtype=bool)
    for axis in (0, 1):
        jump = np.abs(np.diff(order.swapaxes(0, axis), axis=0)) > largest
        here = found.swapaxes(0, axis)
        here[1:] |= jump
        here[:-1] |= jump
    return found
