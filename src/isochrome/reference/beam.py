"""Four-point bending: the span between the inner rollers, in closed form.

Axes: eta from the neutral axis (mid-height), positive DOWNWARD like z. The inner rollers press from
above, the outer ones carry from below: the upper edge is compressed, the lower one stretched.
N, mm, MPa.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from isochrome.errors import InputError
from isochrome.reference._common import Floats, check_positive, coordinates

_EDGE_SLACK = 1e-9  # of the half-height: an edge point's rounding must not put it outside


def beam_moment(load_n: float, *, inner_span_mm: float, outer_span_mm: float) -> float:
    """Bending moment between the inner rollers, N mm.

    M = P (L_outer - L_inner) / 4

    Scalars: `load_n` P, the total load on both inner rollers; `inner_span_mm` L_inner and
    `outer_span_mm` L_outer between the rollers of a pair. Raises InputError unless P and the spans
    are above zero and the outer span is the longer one. Source: equilibrium of half the beam;
    Timoshenko, Strength of Materials, part 1.
    """
    check_positive(load_n=load_n, inner_span_mm=inner_span_mm, outer_span_mm=outer_span_mm)
    if not outer_span_mm > inner_span_mm:
        raise InputError(
            f"outer_span_mm is {outer_span_mm}, but must exceed inner_span_mm, {inner_span_mm}."
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
    """Stress sigma_x along the beam between its inner rollers, MPa; NaN beyond the edges.

    sigma_x = M eta / I,  I = d h³ / 12;  sigma_z = tau_xz = 0, so that
    sigma1 - sigma2 = |sigma_x|

    `eta_mm` any shape, from the neutral axis, downward; `height_mm` h and `thickness_mm` d scalars,
    the others as in `beam_moment`. Returns the shape of `eta_mm`. Raises InputError for h or d not
    above zero, for eta that is not finite, and where `beam_moment` does. Source: Timoshenko &
    Goodier, Theory of Elasticity, pure bending.
    """
    check_positive(height_mm=height_mm, thickness_mm=thickness_mm)
    moment = beam_moment(load_n, inner_span_mm=inner_span_mm, outer_span_mm=outer_span_mm)
    eta = coordinates("eta_mm", eta_mm)
    stress = moment * eta / (thickness_mm * height_mm**3 / 12.0)
    inside = np.abs(eta) <= 0.5 * height_mm * (1.0 + _EDGE_SLACK)
    return np.asarray(np.where(inside, stress, np.nan))
