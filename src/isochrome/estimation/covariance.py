"""Covariance of fitted unknowns, as the residuals show it and not as the weights hoped.

Also what residuals tell of the noise: how much of it is local, and how far neighbours agree; and
what data can tell at best: which unknowns they determine, and the Cramér-Rao bound of those.
"""

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

_FEWEST = 8
"""Blocks that tell a noise."""

UNDETERMINED = 1e-10
"""Part of a parameter's effect that illumination and background must leave to determine it."""


def gradient_covariance(rows: Array, residual: Array, keep: Mask) -> Array:
    """The gradient's covariance as the residuals show it: White's Σ r² j jᵀ (p, p) times their
    correlation over blocks, and what Σ g gᵀ of the sums g = Σ r j along rows or columns is more.
    Source: White (1980), Econometrica 48, 817; Cameron, Gelbach & Miller (2011), J. Bus. Econ.
    Stat. 29, 238.
    """
    weighted = rows * residual
    wider = block_correlation(keep, residual)
    near = np.asarray((weighted @ weighted.T).astype(float) * wider)
    middle = near
    for axis in (0, 1):
        if line_correlation(keep, residual, axis) <= wider:
            continue
        line = np.nonzero(keep)[1 - axis]
        sums = np.array([np.bincount(line, row * residual) for row in rows])
        middle = middle + positive_part(sums @ sums.T - near, np.sqrt(np.diag(near)))
    return middle


def positive_part(matrix: Array, scale: Array, least: float = 0.0) -> Array:
    """A symmetric matrix (p, p) less directions of eigenvalues, over a scale, up to `least`."""
    size = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    part = (vectors * np.where(values > least, values, 0.0)) @ vectors.T
    return np.asarray(part * np.outer(size, size))


def sandwich(inverse: Array, middle: Array) -> Array:
    """Covariance N⁻¹ M N⁻¹ (..., p, p), M the gradient's: White (1980), Econometrica 48, 817."""
    return np.asarray(inverse @ middle @ inverse)


def white_covariance(
    inverse: Array, rows: Array, residual: Array, keep: Mask, *, linear: int
) -> Array:
    """Covariance N⁻¹ M N⁻¹ n/(n - k) of the values, with M of `gradient_covariance`, N = Σ j jᵀ of
    `rows` j (p, n) less what the linear unknowns explain, k = p + linear. Source: MacKinnon & White
    (1985), J. Econometrics 29, 305-325.
    """
    freedom = residual.size / max(1, residual.size - len(rows) - linear)
    return sandwich(inverse, gradient_covariance(rows, residual, keep)) * freedom


def jackknife_variance(values: Array) -> Array:
    """Variance (B - 1) var(values) of a value from its estimates (B, ...) without one of B blocks
    of the data. Source: Wu (1986), Ann. Statist. 14, 1261; Künsch (1989), ibid. 17, 1217.
    """
    return np.asarray((len(values) - 1) * np.var(values, axis=0))


def standard_uncertainty(covariance: Array, determined: Mask) -> Array:
    """Roots of a covariance's diagonal (p,), inf where not determined; of an inverse information
    the Cramér-Rao bound: Kay (1993), Statistical Signal Processing I, 3.7.
    """
    return np.where(determined, np.sqrt(np.maximum(np.diag(covariance), 0.0)), np.inf)


def is_determined(information: Array, squares: Array) -> Mask:
    """Which unknowns leave an effect that the linear ones cannot take up: `information` (p, p) is
    without these, `squares` (p,) its diagonal with them known.
    """
    return np.asarray(np.diag(information) > UNDETERMINED * squares)


def block_correlation(keep: Mask, residual: Array, *, most_px: int = 16) -> float:
    """Variance of the residuals' sums over blocks of 4 x 4 pixels, or up to `most_px` where larger
    ones show clearly more, over that of independent ones; 1 at least.
    """
    ratio = 1.0
    for side in (side for side in _SUMS_PX if side <= most_px):
        sums, wider = _sum_ratio(_blocks(keep, residual, side))
        chance = 0.0 if side == _SUMS_PX[0] else _CLEAR * np.sqrt(2.0 / max(1, sums))
        if wider <= ratio * (1.0 + chance):
            break
        ratio = wider
    return ratio


def line_correlation(keep: Mask, residual: Array, axis: int) -> float:
    """Variance of residuals' sums along rows (axis 1) or columns (0), which many sensors give a
    noise of their own, over independent ones'; 1 where chance makes as much.
    """
    image = _picture(keep, residual)
    sums, ratio = _sum_ratio(image if axis else image.T)
    return ratio if ratio > 1.0 + _CLEAR * np.sqrt(2.0 / max(1, sums)) else 1.0


def line_noise(keep: Mask, residual: Array, axis: int) -> float:
    """Variance that rows (axis 1) or columns (0) have of their own, over independent pixels' sums,
    by differences of neighbours: what a model misses hardly changes from line to line.
    """
    image = _picture(keep, residual)
    sums = image.sum(axis=axis, dtype=float)
    independent = float(np.sum(np.square(image), dtype=float)) / max(1, len(sums))
    return float(np.mean(np.square(np.diff(sums)))) / max(2.0 * independent, 1e-300)


def _sum_ratio(parts: Array) -> tuple[int, float]:
    """Number of parts (parts, n), and the sum of their sums' squares over that of all squares."""
    independent = float(np.sum(np.square(parts), dtype=float))
    together = float(np.sum(np.square(parts.sum(axis=1)), dtype=float))
    return len(parts), together / max(independent, 1e-300)


def local_noise(keep: Mask, residual: Array, picture: Array) -> float:
    """Standard deviation of the noise, 1 at least, whatever is wrong with the model: what a plane
    leaves of the residual in 16 x 16 pixels, or a cubic of the picture, whichever is less, by the
    blocks' mean, since compression leaves more where there is more to see. 1 where a quintic leaves
    half of the blocks no more than expected.
    """
    residual_blocks, picture_blocks = _whole_blocks(keep, residual, picture)
    if len(residual_blocks) < _FEWEST:
        return 1.0
    if np.median(_rest(residual_blocks, degree=5)) < _LOUDER**2:  # whatever a model missed
        return 1.0
    variance = np.minimum(_rest(residual_blocks, degree=1), _rest(picture_blocks, degree=3))
    middle = float(np.median(variance))
    return max(1.0, float(np.sqrt(np.mean(np.minimum(variance, _MOST * middle)))))


def local_correlation(keep: Mask, residual: Array) -> float:
    """`block_correlation` over 4 x 4 pixels of what a plane leaves of the residual in 16 x 16, by
    the median: compression takes the noise's fine part and keeps the coarse one.
    """
    (blocks,) = _whole_blocks(keep, residual)
    if len(blocks) < _FEWEST:
        return 1.0
    single = np.maximum(_rest(blocks, degree=1), 1e-300)
    plane, side = _polynomials(degree=1), _SUMS_PX[0]
    blocks -= (blocks @ plane.T) @ plane
    count = _LOCAL_PX // side
    sums = blocks.reshape(-1, count, side, count, side).sum(axis=(2, 4)) / side
    variance = np.square(sums).sum(axis=(1, 2)) / (count**2 - len(plane))
    return max(1.0, float(np.median(variance / single)))


def _picture(keep: Mask, values: Array) -> Array:
    """Values (n,) where their pixels are (rows, cols), 0 elsewhere."""
    image = np.zeros(keep.shape, np.float32)
    image[keep] = values
    return image


def _blocks(keep: Mask, values: Array, side: int) -> Array:
    """Values (n,) by square blocks of the picture (blocks, side²), 0 where there are none."""
    rows, cols = (n // side for n in keep.shape)
    parts = _picture(keep, values)[: rows * side, : cols * side].reshape(rows, side, cols, side)
    return parts.transpose(0, 2, 1, 3).reshape(rows * cols, side**2)


def _whole_blocks(keep: Mask, *images: Array) -> list[Array]:
    """Of each image's values (n,) the blocks (b, 256) of 16 x 16 pixels that were all kept."""
    whole = _blocks(keep, np.ones(images[0].size, np.float32), _LOCAL_PX).all(axis=1)
    return [_blocks(keep, values, _LOCAL_PX)[whole] for values in images]


def _rest(blocks: Array, degree: int) -> Array:
    """Variance (blocks,) of what polynomials of a total degree leave in each block."""
    basis = _polynomials(degree)
    explained = np.square(blocks @ basis.T).sum(axis=1)
    return np.asarray((np.square(blocks).sum(axis=1) - explained) / (blocks.shape[1] - len(basis)))


@lru_cache(maxsize=3)
def _polynomials(degree: int) -> Array:
    """Orthonormal polynomials (k, side²) of a block."""
    step = np.linspace(-1.0, 1.0, _LOCAL_PX)
    z, x = (axis.ravel() for axis in np.meshgrid(step, step, indexing="ij"))
    powers = [x**i * z**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    return np.asarray(np.linalg.qr(np.array(powers).T)[0].T, np.float32)
