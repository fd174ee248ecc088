"""Covariance of fitted unknowns, as the residuals show it and not as the weights hoped.

Also what data can tell at best: which unknowns they determine, and the Cramér-Rao bound of those.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation.correlation import block_correlation, line_correlation

Array = NDArray[Any]

UNDETERMINED = 1e-10
"""Part of a parameter's effect that illumination and background must leave to determine it."""


def white_middle(rows: Array, residual: Array) -> Array:
    """The middle Σ r² j jᵀ of White's covariance.

    Parameters
    ----------
    rows : (p, n) array
        Derivatives j, over the noise.
    residual : (n,) array
        Residuals r, over the noise.

    Returns
    -------
    (p, p) array
        The gradient's covariance as the residuals show it.
    """
    weighted = rows * residual
    return np.asarray((weighted @ weighted.T).astype(float))


def gradient_covariance(rows: Array, residual: Array, keep: NDArray[np.bool_]) -> Array:
    """The gradient's covariance as the residuals show it, with what neighbours and lines share.

    White's middle, times the residuals' correlation over blocks; and where rows or columns show
    more than these, what Σ g gᵀ of their sums g = Σ r j along each is more.

    Parameters
    ----------
    rows : (p, n) array
        Derivatives j, over the noise.
    residual : (n,) array
        Residuals r, over the noise.
    keep : (rows, cols) array of bool
        Where the n pixels are.

    Returns
    -------
    (p, p) array
        The covariance.

    Notes
    -----
    Source: White (1980), Econometrica 48, 817-838; Cameron, Gelbach & Miller (2011), J. Bus. Econ.
    Stat. 29, 238-249, for sums along two directions.
    """
    wider = block_correlation(keep, residual)
    near = white_middle(rows, residual) * wider
    middle = near
    for axis in (0, 1):
        if line_correlation(keep, residual, axis) <= wider:
            continue
        line = np.nonzero(keep)[1 - axis]
        sums = np.array([np.bincount(line, row * residual) for row in rows])
        middle = middle + _positive_part(sums @ sums.T - near, np.sqrt(np.diag(near)))
    return middle


def _positive_part(matrix: Array, scale: Array) -> Array:
    """A symmetric matrix (p, p) without what would make variances less, in units of a scale."""
    size = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    part = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return np.asarray(part * np.outer(size, size))


def sandwich(inverse: Array, middle: Array) -> Array:
    """Covariance N⁻¹ M N⁻¹ of least squares whose weights are no inverse variances.

    Parameters
    ----------
    inverse : (..., p, p) array
        Inverse N⁻¹ of the normal equations.
    middle : (..., p, p) array
        The gradient's true covariance M.

    Returns
    -------
    (..., p, p) array
        Covariance of the values.

    Notes
    -----
    Source: White (1980), Econometrica 48, 817-838.
    """
    return np.asarray(inverse @ middle @ inverse)


def white_covariance(
    inverse: Array, rows: Array, residual: Array, keep: NDArray[np.bool_], *, linear: int
) -> Array:
    """Covariance of the values, right whatever the weights were.

    N⁻¹ M N⁻¹ n/(n - k), M of `gradient_covariance`.

    Parameters
    ----------
    inverse : (p, p) array
        Inverse N⁻¹ of the normal equations N = Σ j jᵀ.
    rows : (p, n) array
        Derivatives j over the noise, less what the linear unknowns explain.
    residual : (n,) array
        Residuals r over the noise.
    keep : (rows, cols) array of bool
        Where the n pixels are.
    linear : int
        Number of linear unknowns, so that k = p + linear.

    Returns
    -------
    (p, p) array
        Covariance of the values.

    Notes
    -----
    Source: MacKinnon & White (1985), J. Econometrics 29, 305-325, for n/(n - k).
    """
    freedom = residual.size / max(1, residual.size - len(rows) - linear)
    return sandwich(inverse, gradient_covariance(rows, residual, keep)) * freedom


def jackknife_variance(values: Array) -> Array:
    """Variance of a value from its estimates with one of B blocks of the data left out.

    (B - 1) var(values), which holds where the pixels of a block depend on each other.

    Parameters
    ----------
    values : (B, ...) array
        The estimates.

    Returns
    -------
    (...) array
        Their variance.

    Notes
    -----
    Source: Wu (1986), Ann. Statist. 14, 1261-1295; Künsch (1989), Ann. Statist. 17, 1217-1241.
    """
    return np.asarray((len(values) - 1) * np.var(values, axis=0))


def standard_uncertainty(covariance: Array, determined: NDArray[np.bool_]) -> Array:
    """Standard uncertainties, the roots of a covariance's diagonal.

    Parameters
    ----------
    covariance : (p, p) array
        Covariance of the unknowns.
    determined : (p,) array of bool
        Which of them are determined.

    Returns
    -------
    (p,) array
        The standard uncertainties, inf where an unknown is not determined.
    """
    return np.where(determined, np.sqrt(np.maximum(np.diag(covariance), 0.0)), np.inf)


def is_determined(information: Array, squares: Array) -> NDArray[np.bool_]:
    """Which unknowns leave an effect that the linear ones cannot take up.

    Parameters
    ----------
    information : (p, p) array
        Normal equations, the linear unknowns eliminated.
    squares : (p,) array
        Their diagonal with the linear unknowns known.

    Returns
    -------
    (p,) array of bool
        True where an unknown is determined.
    """
    return np.asarray(np.diag(information) > UNDETERMINED * squares)


def information_bound(inverse: Array, determined: NDArray[np.bool_]) -> Array:
    """The Cramér-Rao bound: no unbiased estimate has a smaller standard uncertainty.

    It is sqrt(diag(F⁻¹)).

    Parameters
    ----------
    inverse : (p, p) array
        Inverse F⁻¹ of the Fisher information.
    determined : (p,) array of bool
        Which unknowns are determined, see `is_determined`.

    Returns
    -------
    (p,) array
        The bound, inf where an unknown is not determined.

    Notes
    -----
    Source: Kay (1993), Fundamentals of Statistical Signal Processing I, section 3.7.
    """
    return standard_uncertainty(inverse, determined)
