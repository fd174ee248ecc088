"""What a residual tells of its noise: how much of it is local, and how far neighbours agree."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Mask = NDArray[np.bool_]

_SUMS_PX = 4, 8, 16
"""Sides of the blocks whose sums tell how far noise is alike: larger ones where they show more."""

_CLEAR = 4.0
"""Standard deviations of such a ratio that chance does not reach."""

_LOCAL_PX = 16
"""Side of the blocks in which noise is told from what changes slowly: two of a JPEG's."""

_LOUDER = 1.1
"""Noise over what was expected that chance does not reach."""

_MOST = 4.0
"""Variance of a block, over the median, beyond which it is no noise."""

_PLANE, _CUBIC = 1, 3
"""Degrees of what is taken off a residual, and off the picture itself, in such a block."""


def block_correlation(keep: Mask, residual: Array) -> float:
    """Variance of the residuals' sums over blocks of pixels, over that of independent ones.

    The blocks are of 4 x 4 pixels, and larger where sums over these show clearly more.

    Parameters
    ----------
    keep : (rows, cols) array of bool
        Where the n pixels are.
    residual : (n,) array
        Their residuals.

    Returns
    -------
    float
        The ratio, 1 at least: neighbours that differ more than by chance do not make a value more
        certain.
    """
    ratio = 1.0
    for side in _SUMS_PX:
        sums, wider = _sum_ratio(_blocks(keep, residual, side))
        chance = 0.0 if side == _SUMS_PX[0] else _CLEAR * np.sqrt(2.0 / max(1, sums))
        if wider <= ratio * (1.0 + chance):
            break
        ratio = wider
    return ratio


def line_correlation(keep: Mask, residual: Array, axis: int) -> float:
    """Variance of the residuals' sums along rows or columns, over that of independent ones.

    Many sensors add to each row, or to each column, a noise of its own.

    Parameters
    ----------
    keep : (rows, cols) array of bool
        Where the n pixels are.
    residual : (n,) array
        Their residuals.
    axis : int
        1 for sums along rows, 0 along columns.

    Returns
    -------
    float
        The ratio; 1 where it is no more than chance makes it.
    """
    image = np.zeros(keep.shape, np.float32)
    image[keep] = residual
    sums, ratio = _sum_ratio(image if axis else image.T)
    return ratio if ratio > 1.0 + _CLEAR * np.sqrt(2.0 / max(1, sums)) else 1.0


def line_noise(keep: Mask, residual: Array, axis: int) -> float:
    """Variance that rows or columns have of their own, over that of independent pixels' sums.

    By the differences of neighbouring lines: what a model misses hardly changes from one to the
    next.

    Parameters
    ----------
    keep : (rows, cols) array of bool
        Where the n pixels are.
    residual : (n,) array
        Their residuals.
    axis : int
        1 for rows, 0 for columns.

    Returns
    -------
    float
        The ratio; 1 where each line's pixels are independent.
    """
    image = np.zeros(keep.shape, np.float32)
    image[keep] = residual
    sums = image.sum(axis=axis, dtype=float)
    alone = float(np.sum(np.square(image), dtype=float)) / max(1, len(sums))
    return float(np.mean(np.square(np.diff(sums)))) / max(2.0 * alone, 1e-300)


def _sum_ratio(parts: Array) -> tuple[int, float]:
    """Number of parts (parts, n), and the sum of their sums' squares over that of all squares."""
    alone = float(np.sum(np.square(parts), dtype=float))
    together = float(np.sum(np.square(parts.sum(axis=1)), dtype=float))
    return len(parts), together / max(alone, 1e-300)


def local_noise(keep: Mask, residual: Array, picture: Array) -> float:
    """Standard deviation of the noise, whatever is wrong with the model that left a residual.

    What a model misses is smooth over blocks of 16 x 16 pixels almost everywhere; noise is not,
    not even that of a compressed picture, whose finest part is gone. So it is told by what a plane
    leaves of the residual in a block, or a cubic of the picture, whichever is less. Where half of
    the blocks show no more than was expected, that is the noise; else it is their mean, since
    compression leaves more where there is more to see.

    Parameters
    ----------
    keep : (rows, cols) array of bool
        Where the n pixels are.
    residual : (n,) array
        Residuals of a model over the noise.
    picture : (n,) array
        What they were left of, over the noise.

    Returns
    -------
    float
        The standard deviation; 1 where it is no more than expected, or no block is full.
    """
    full = _blocks(keep, np.ones(residual.size, np.float32), _LOCAL_PX).all(axis=1)
    if not full.any():
        return 1.0
    left = [
        _rest(_blocks(keep, values, _LOCAL_PX)[full], degree)
        for values, degree in ((residual, _PLANE), (picture, _CUBIC))
    ]
    variance = np.minimum(*left)
    middle = float(np.median(variance))
    if middle < _LOUDER**2:
        return 1.0
    return float(np.sqrt(np.mean(np.minimum(variance, _MOST * middle))))


def _blocks(keep: Mask, values: Array, side: int) -> Array:
    """Values (n,) by square blocks of the picture (blocks, side²), 0 where there are none."""
    rows, cols = (n // side for n in keep.shape)
    image = np.zeros(keep.shape, np.float32)
    image[keep] = values
    parts = image[: rows * side, : cols * side].reshape(rows, side, cols, side)
    return parts.transpose(0, 2, 1, 3).reshape(rows * cols, side**2)


def _rest(blocks: Array, degree: int) -> Array:
    """Variance (blocks,) of what polynomials of a total degree leave in each block."""
    basis = _polynomials(degree)
    explained = np.square(blocks @ basis.T).sum(axis=1)
    freedom = blocks.shape[1] - len(basis)
    return np.asarray((np.square(blocks).sum(axis=1) - explained) / freedom)


@lru_cache(maxsize=2)
def _polynomials(degree: int) -> Array:
    """Orthonormal polynomials (k, side²) of a block."""
    step = np.linspace(-1.0, 1.0, _LOCAL_PX)
    z, x = (axis.ravel() for axis in np.meshgrid(step, step, indexing="ij"))
    powers = [x**i * z**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    return np.asarray(np.linalg.qr(np.array(powers).T)[0].T, np.float32)
