"""Plate with a round hole under tension along x, in closed form.

Axes: origin at the hole's CENTRE, x along the tension, to the right, z downward. The plate is large
against the hole. Plane stress or plane strain alike: the stresses do not depend on elastic
constants. N, mm, MPa.
"""

import numpy as np
from numpy.typing import ArrayLike

from isochrome.reference.cauchy import (
    StressField,
    check_finite,
    check_positive,
    complex_points,
    plane_points,
)

_RIM_SLACK = 1e-9  # of the radius: a rim point's rounding must not put it into the hole


def hole_stress(
    x_mm: ArrayLike, z_mm: ArrayLike, *, tension_mpa: float, radius_mm: float
) -> StressField:
    """Stress around a round hole in a plate under tension along x.

    With w = x + iz = r exp iθ and ρ = a²/r²
    sx + sz = S (1 - 2 ρ cos 2θ)
    (sx - sz) + 2i txz = S [1 - ρ exp 2iθ - (2ρ - 3ρ²) exp 4iθ]
    so that at the rim the hoop stress is S (1 - 2 cos 2θ): 3 S across the tension, -S along it.

    Source: Kirsch (1898), Z. VDI 42, 797; Timoshenko & Goodier (1970), Theory of Elasticity,
    section 35; the complex form was derived from their polar components.

    Parameters
    ----------
    x_mm : array_like, of a shape that broadcasts
        Place to the right of the hole's centre, mm.
    z_mm : array_like, of a shape that broadcasts
        Place below the hole's centre, mm.
    tension_mpa : float
        Tension S far away, MPa; negative for a pressure.
    radius_mm : float
        Radius a of the hole, mm.

    Returns
    -------
    StressField
        The stress in the broadcast shape, MPa; NaN in the hole.

    Raises
    ------
    InputError
        For a not above zero, or S or coordinates that are not finite.
    """
    check_positive(radius_mm=radius_mm)
    check_finite(tension_mpa=tension_mpa)
    x, z = plane_points(x_mm, z_mm)
    w = complex_points(x / radius_mm, z / radius_mm)
    w[np.abs(w) < 1.0 - _RIM_SLACK] = complex(np.nan, np.nan)
    near = 1.0 / np.square(np.abs(w))
    twice = near * np.square(w)
    total = tension_mpa * (1.0 - 2.0 * near * twice.real)
    difference = tension_mpa * (1.0 - near * twice * (1.0 + (2.0 - 3.0 * near) * twice))
    return StressField.of(total, difference)
