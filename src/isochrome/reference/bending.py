"""Four-point bending: the span between the inner rollers, in closed form.

Axes: eta from the neutral axis (mid-height), positive DOWNWARD like z. The inner rollers press from
above, the outer ones carry from below: the upper edge is compressed, the lower one stretched.
N, mm, MPa.
"""

import numpy as np
from numpy.typing import ArrayLike

from isochrome.errors import InputError
from isochrome.reference.cauchy import SLACK, Floats, check_positive, coordinates


def beam_moment(load_n: float, *, inner_span_mm: float, outer_span_mm: float) -> float:
    """Bending moment between the inner rollers.

    M = P (L_outer - L_inner) / 4

    Source: equilibrium of half the beam; Timoshenko, Strength of Materials, part 1.

    Parameters
    ----------
    load_n : float
        Total load P on both inner rollers, N.
    inner_span_mm, outer_span_mm : float
        Distances L_inner and L_outer of the inner and the outer rollers, mm; the latter is longer.

    Returns
    -------
    float
        The moment M, N mm.
    """
    check_positive(load_n=load_n, inner_span_mm=inner_span_mm, outer_span_mm=outer_span_mm)
    if not outer_span_mm > inner_span_mm:
        raise InputError(
            "outer_span_mm_but_must_exceed",
            outer_span_mm=outer_span_mm,
            inner_span_mm=inner_span_mm,
        )
    return load_n * (outer_span_mm - inner_span_mm) / 4.0


def beam_stress(
    eta_mm: ArrayLike,
    *,
    load_n: float,
    inner_span_mm: float,
    outer_span_mm: float,
    height_mm: float,
    thickness_mm: float,
) -> Floats:
    """Stress sigma_x along the beam between its inner rollers.

    sigma_x = M eta / I,  I = d h³ / 12;  sigma_z = tau_xz = 0, so that
    sigma1 - sigma2 = |sigma_x|

    Source: Timoshenko & Goodier, Theory of Elasticity, pure bending.

    Parameters
    ----------
    eta_mm : array_like, any shape
        Distance eta from the neutral axis, downward, mm.
    load_n : float
        Total load P on both inner rollers, N.
    inner_span_mm, outer_span_mm : float
        Distances L_inner and L_outer of the inner and the outer rollers, mm; the latter is longer.
    height_mm, thickness_mm : float
        Height h and thickness d of the beam, mm.

    Returns
    -------
    ndarray, shape of eta_mm
        The stress, MPa; NaN beyond the edges.
    """
    check_positive(height_mm=height_mm, thickness_mm=thickness_mm)
    moment = beam_moment(load_n, inner_span_mm=inner_span_mm, outer_span_mm=outer_span_mm)
    eta = coordinates("eta_mm", eta_mm)
    stress = moment * eta / (thickness_mm * height_mm**3 / 12.0)
    return np.where(np.abs(eta) <= 0.5 * height_mm * (1.0 + SLACK), stress, np.nan)
