"""What data can tell at best: which unknowns they determine, and the Cramér-Rao bound of those."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation.covariance import standard_uncertainty

Array = NDArray[Any]

UNDETERMINED = 1e-10
"""Part of a parameter's effect that illumination and background must leave to determine it."""


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
