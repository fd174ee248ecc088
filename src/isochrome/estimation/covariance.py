"""Covariance of fitted unknowns, as the residuals show it and not as the weights hoped.

Also what data can tell at best: which unknowns they determine, and the Cramér-Rao bound of those.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_BLOCK_PX = 4

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

    N⁻¹ (Σ r² j jᵀ) N⁻¹ n/(n - k), widened by the residuals' correlation over blocks.

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
    Source: White (1980), Econometrica 48, 817-838; MacKinnon & White (1985), J. Econometrics 29,
    305-325, for n/(n - k).
    """
    freedom = residual.size / max(1, residual.size - len(rows) - linear)
    wider = freedom * block_correlation(keep, residual)
    return sandwich(inverse, white_middle(rows, residual)) * wider


def block_correlation(keep: NDArray[np.bool_], residual: Array) -> float:
    """Variance of the residuals' sums over blocks of 4 x 4 pixels, over that of independent ones.

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
    rows, cols = (n - n % _BLOCK_PX for n in keep.shape)
    if rows == 0 or cols == 0:
        return 1.0
    image = np.zeros(keep.shape, np.float32)
    image[keep] = residual
    blocks = image[:rows, :cols].reshape(rows // _BLOCK_PX, _BLOCK_PX, cols // _BLOCK_PX, _BLOCK_PX)
    alone = float(np.sum(np.square(blocks), dtype=float))
    together = float(np.sum(np.square(blocks.sum(axis=(1, 3))), dtype=float))
    return max(1.0, together / max(alone, 1e-300))


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
