"""Hertz line contact: elastic constants of the pair, pressure, and McEwen's stress field.

Axes: x along the surface to the right, z into the block, origin at the contact's centre.
Plane strain, N, mm, MPa; a line load is per thickness, N/mm.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.reference.cauchy import (
    Floats,
    StressField,
    check_positive,
    coordinates,
    half_plane_points,
    mcewen_terms,
)

_GOLDEN = (1.0 + np.sqrt(5.0)) / 2.0


@dataclass(frozen=True)
class LargestDifference:
    """The largest principal stress difference under a contact and where it sits.

    Parameters
    ----------
    difference_mpa : float
        The difference sigma1 - sigma2, MPa.
    depth_mm : float
        Its depth below the surface, mm.
    """

    difference_mpa: float
    depth_mm: float


def contact_modulus(
    young_mpa: float, poisson: float, other_young_mpa: float, other_poisson: float
) -> float:
    """Plane-strain contact modulus E* of a pair of bodies.

    1/E* = (1 - nu1²)/E1 + (1 - nu2²)/E2

    Source: Johnson (1985), Contact Mechanics, section 4.2.

    Parameters
    ----------
    young_mpa : float
        Young's modulus E1 of the block, MPa.
    poisson : float
        Poisson's ratio nu1 of the block.
    other_young_mpa : float
        Young's modulus E2 of the indenter, MPa; ``inf`` for a rigid body.
    other_poisson : float
        Poisson's ratio nu2 of the indenter.

    Returns
    -------
    float
        The modulus E*, MPa.

    Raises
    ------
    InputError
        For a modulus not above zero, or a Poisson's ratio outside (-1, 0.5].
    """
    _check_pair(young_mpa, poisson, other_young_mpa, other_poisson)
    return 1.0 / ((1.0 - poisson**2) / young_mpa + (1.0 - other_poisson**2) / other_young_mpa)


def coupling_modulus_inverse(
    young_mpa: float, poisson: float, other_young_mpa: float, other_poisson: float
) -> float:
    """Inverse 1/G* of the modulus that couples shear traction to normal displacement.

    1/G* = (1 - 2 nu1)/G1 - (1 - 2 nu2)/G2, with G = E / (2 (1 + nu))

    Source: Johnson (1985), Contact Mechanics, sections 2.4 (displacements) and 5.4 (dissimilar
    solids).

    Parameters
    ----------
    young_mpa : float
        Young's modulus E1 of the block, MPa.
    poisson : float
        Poisson's ratio nu1 of the block.
    other_young_mpa : float
        Young's modulus E2 of the indenter, MPa; ``inf`` for a rigid body.
    other_poisson : float
        Poisson's ratio nu2 of the indenter.

    Returns
    -------
    float
        The inverse, 1/MPa. Zero for a pair of like materials, negative when the indenter is the
        more compliant one.

    Raises
    ------
    InputError
        For a modulus not above zero, or a Poisson's ratio outside (-1, 0.5].
    """
    _check_pair(young_mpa, poisson, other_young_mpa, other_poisson)
    block = (1.0 - 2.0 * poisson) * 2.0 * (1.0 + poisson) / young_mpa
    indenter = (1.0 - 2.0 * other_poisson) * 2.0 * (1.0 + other_poisson) / other_young_mpa
    return block - indenter


def dundurs_beta(
    young_mpa: float, poisson: float, other_young_mpa: float, other_poisson: float
) -> float:
    """Dundurs' second constant beta of the pair in plane strain.

    beta = E* / (4 G*)

    Source: Johnson (1985), Contact Mechanics, section 5.4, after Dundurs.

    Parameters
    ----------
    young_mpa : float
        Young's modulus E1 of the block, MPa.
    poisson : float
        Poisson's ratio nu1 of the block.
    other_young_mpa : float
        Young's modulus E2 of the indenter, MPa; ``inf`` for a rigid body.
    other_poisson : float
        Poisson's ratio nu2 of the indenter.

    Returns
    -------
    float
        The constant, -0.5 to 0.5, without unit.

    Raises
    ------
    InputError
        For a modulus not above zero, or a Poisson's ratio outside (-1, 0.5].
    """
    pair = (young_mpa, poisson, other_young_mpa, other_poisson)
    return 0.25 * contact_modulus(*pair) * coupling_modulus_inverse(*pair)


def hertz_half_width(
    line_load_n_per_mm: float, radius_mm: float, contact_modulus_mpa: float
) -> float:
    """Half-width a of a Hertz line contact.

    a² = 4 P' R / (π E*)

    Source: Johnson (1985), Contact Mechanics, section 4.2(c).

    Parameters
    ----------
    line_load_n_per_mm : float
        Load per thickness P', N/mm, above zero.
    radius_mm : float
        Radius R of the cylinder, mm; that of the relative curvature where both bodies are curved.
    contact_modulus_mpa : float
        Contact modulus E*, MPa, above zero.

    Returns
    -------
    float
        The half-width, mm.

    Raises
    ------
    InputError
        Unless all are above zero.
    """
    check_positive(
        line_load_n_per_mm=line_load_n_per_mm,
        radius_mm=radius_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )
    return float(np.sqrt(4.0 * line_load_n_per_mm * radius_mm / (np.pi * contact_modulus_mpa)))


def hertz_peak_pressure(
    line_load_n_per_mm: float, radius_mm: float, contact_modulus_mpa: float
) -> float:
    """Largest pressure p0 of a Hertz line contact.

    p0 = 2 P' / (π a)

    Source: as in `hertz_half_width`.

    Parameters
    ----------
    line_load_n_per_mm : float
        Load per thickness P', N/mm, above zero.
    radius_mm : float
        Radius R of the cylinder, mm; that of the relative curvature where both bodies are curved.
    contact_modulus_mpa : float
        Contact modulus E*, MPa, above zero.

    Returns
    -------
    float
        The pressure, MPa.

    Raises
    ------
    InputError
        Unless all are above zero.
    """
    half_width = hertz_half_width(line_load_n_per_mm, radius_mm, contact_modulus_mpa)
    return 2.0 * line_load_n_per_mm / (np.pi * half_width)


def hertz_pressure(x_mm: ArrayLike, *, half_width_mm: float, peak_pressure_mpa: float) -> Floats:
    """Hertz pressure at x.

    p = p0 sqrt(1 - x²/a²)

    Source: Johnson (1985), Contact Mechanics, section 4.2(c).

    Parameters
    ----------
    x_mm : array_like, any shape
        Place from the contact's centre, mm.
    half_width_mm : float
        Half-width a of the contact, mm.
    peak_pressure_mpa : float
        Largest pressure p0, MPa.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, zero outside the contact.

    Raises
    ------
    InputError
        Unless a and p0 are above zero and x is finite.
    """
    check_positive(half_width_mm=half_width_mm, peak_pressure_mpa=peak_pressure_mpa)
    ratio = np.abs(coordinates("x_mm", x_mm) / half_width_mm)
    # (1 - r)(1 + r) keeps its digits at the edge where 1 - r² loses them
    return np.asarray(peak_pressure_mpa * np.sqrt(np.clip(1.0 - ratio, 0.0, None) * (1.0 + ratio)))


def hertz_stress(
    x_mm: ArrayLike, z_mm: ArrayLike, *, half_width_mm: float, peak_pressure_mpa: float
) -> StressField:
    """Stress under a frictionless Hertz line contact (McEwen's closed form).

    With n + i m = sqrt((x + iz)² - a²), k = (m² - z²)/(m² + n²):
    sx = -(p0/a) [2 (m - z) - m k],  sz = -(p0/a) m k,  txz = -(p0/a) n k

    m - z and m² - z² are written without their cancellation, so that the field keeps its digits at
    the surface, at x = ±a and thousands of half-widths away. Source: McEwen (1949), Philosophical
    Magazine 40; Johnson (1985), section 4.2(c).

    Parameters
    ----------
    x_mm : array_like, of a shape that broadcasts
        Place from the contact's centre, mm.
    z_mm : array_like, of a shape that broadcasts
        Depth below the surface, mm, not negative.
    half_width_mm : float
        Half-width a of the contact, mm.
    peak_pressure_mpa : float
        Largest pressure p0, MPa.

    Returns
    -------
    StressField
        The stress in the broadcast shape, MPa.

    Raises
    ------
    InputError
        For z below zero, coordinates that are not finite, or a or p0 not above zero.
    """
    x, z = half_plane_points(x_mm, z_mm)
    check_positive(half_width_mm=half_width_mm, peak_pressure_mpa=peak_pressure_mpa)
    root, excess, weight = mcewen_terms(x, z, half_width_mm)
    m, n, lift = root.imag, root.real, excess.imag
    k = lift * (m + z) * weight
    scale = -peak_pressure_mpa / half_width_mm
    return StressField(
        sigma_x=np.asarray(scale * lift * (2.0 * np.square(n) + m * lift) * weight),
        sigma_z=np.asarray(scale * m * k),
        tau_xz=np.asarray(scale * n * k),
    )


def hertz_largest_difference(
    *, half_width_mm: float, peak_pressure_mpa: float
) -> LargestDifference:
    """Largest sigma1 - sigma2 under a frictionless Hertz line contact, and its depth on the axis.

    sigma1 - sigma2 = 2 φ^(-5/2) p0 = 0.6006 p0 at z = φ^(-1/2) a = 0.7862 a, φ the golden ratio: on
    the axis the difference is 2 p0 / (a/z + z/a + sqrt(1 + z²/a²)), stationary there.

    Source: Johnson (1985), section 4.2(c), gives 0.30 p0 of shear at 0.78 a; the exact numbers
    follow from the equation above.

    Parameters
    ----------
    half_width_mm : float
        Half-width a of the contact, mm.
    peak_pressure_mpa : float
        Largest pressure p0, MPa.

    Returns
    -------
    LargestDifference
        The difference, MPa, and its depth, mm.

    Raises
    ------
    InputError
        Unless a and p0 are above zero.
    """
    check_positive(half_width_mm=half_width_mm, peak_pressure_mpa=peak_pressure_mpa)
    return LargestDifference(
        difference_mpa=float(2.0 * _GOLDEN**-2.5 * peak_pressure_mpa),
        depth_mm=float(_GOLDEN**-0.5 * half_width_mm),
    )


def _check_pair(young: float, poisson: float, other_young: float, other_poisson: float) -> None:
    check_positive(young_mpa=young)
    if not other_young > 0.0:
        text = message("other_young_mpa_but_must_above", other_young=other_young)
        raise InputError(text)
    for name, value in (("poisson", poisson), ("other_poisson", other_poisson)):
        if not -1.0 < value <= 0.5:
            raise InputError("but_must_lie_above", name=name, value=value)
