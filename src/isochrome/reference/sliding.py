"""Sliding line contacts in closed form, without and with elastic coupling.

Axes: x along the surface to the right, z into the block; q = mu p acts on the block along +x (a
negative coefficient of friction: along -x). Plane strain, N, mm, MPa. Without coupling (like
materials, or beta taken as zero) the pressure is Hertz's; with it the pressure leans and the
contact moves.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from isochrome.errors import InputError
from isochrome.reference.cauchy import (
    Complexes,
    Floats,
    StressField,
    check_finite,
    check_positive,
    complex_points,
    coordinates,
    half_plane_points,
    mcewen_terms,
    stress_from_transforms,
)
from isochrome.reference.hertz import hertz_stress

_FAR = 4.0  # half-widths beyond which the transform is summed as a series in a/s
_TERMS = 30  # of that series: 4^-30 is below the rounding of double precision


@dataclass(frozen=True, kw_only=True)
class CoupledContact:
    """A parabolic cylinder sliding on a block of another material: the contact and its pressure.

    p = scale (1 + ξ/a)^(1/2 - ε) (1 - ξ/a)^(1/2 + ε),  ξ = x - centre

    Parameters
    ----------
    exponent : float
        The exponent ε, without unit.
    half_width_mm : float
        Half-width a of the contact, mm.
    centre_mm : float
        Middle of the contact from the cylinder's axis, mm.
    peak_mm : float
        Place of the largest pressure from the cylinder's axis, mm.
    peak_pressure_mpa : float
        The largest pressure, MPa.
    scale_mpa : float
        The pressure `scale` of the equation, MPa.
    friction : float
        Friction coefficient mu.
    """

    exponent: float
    half_width_mm: float
    centre_mm: float
    peak_mm: float
    peak_pressure_mpa: float
    scale_mpa: float
    friction: float


def sliding_hertz_stress(
    x_mm: ArrayLike,
    z_mm: ArrayLike,
    *,
    half_width_mm: float,
    peak_pressure_mpa: float,
    friction: float,
) -> StressField:
    """Stress under a sliding Hertz contact without elastic coupling.

    To McEwen's field (`hertz_stress`, index p; n, m, k as there) the traction q = mu p adds
    mu (p0/a) [2 (n - x) + n k] to sx,  mu txz_p to sz,  mu sx_p to txz.
    On the surface sx = -p - 2 mu p0 x/a inside the contact: compressed ahead, pulled behind.

    Source: McEwen (1949), Philosophical Magazine 40; Johnson (1985), Contact Mechanics, section
    7.2.

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
    friction : float
        Friction coefficient mu.

    Returns
    -------
    StressField
        The stress in the broadcast shape, MPa.

    Raises
    ------
    InputError
        For z below zero, a or p0 not above zero, or anything that is not finite.
    """
    check_finite(friction=friction)
    normal = hertz_stress(
        x_mm, z_mm, half_width_mm=half_width_mm, peak_pressure_mpa=peak_pressure_mpa
    )
    x, z = half_plane_points(x_mm, z_mm)
    root, excess, weight = mcewen_terms(x, z, half_width_mm)
    k = excess.imag * (root.imag + z) * weight
    pull = (friction * peak_pressure_mpa / half_width_mm) * (2.0 * excess.real + root.real * k)
    return StressField(
        sigma_x=np.asarray(normal.sigma_x + pull),
        sigma_z=np.asarray(normal.sigma_z + friction * normal.tau_xz),
        tau_xz=np.asarray(normal.tau_xz + friction * normal.sigma_x),
    )


def coupled_contact(
    line_load_n_per_mm: float,
    radius_mm: float,
    contact_modulus_mpa: float,
    *,
    friction: float,
    beta: float,
) -> CoupledContact:
    """Contact of a sliding parabolic cylinder with elastic coupling: width, place, pressure.

    tan(π ε) = mu beta,  a² = 4 P' R / (π E* (1 - 4 ε²)),  centre at x = -2 ε a,
    scale = E* a cos(π ε) / (2 R), largest pressure scale (1-2ε)^(1/2-ε) (1+2ε)^(1/2+ε) at -4 ε a

    The surface rises behind and sinks ahead, so that the contact moves to -x when mu beta > 0.
    Source: Johnson (1985), section 7.2; Hills, Nowell & Sackfield (1993), Mechanics of Elastic
    Contacts.

    Parameters
    ----------
    line_load_n_per_mm : float
        Load per thickness P', N/mm, above zero.
    radius_mm : float
        Radius R of the cylinder, mm, above zero.
    contact_modulus_mpa : float
        Contact modulus E*, MPa, above zero.
    friction : float
        Friction coefficient mu; negative: traction along -x.
    beta : float
        Dundurs' second constant, see `dundurs_beta`.

    Returns
    -------
    CoupledContact
        The contact.

    Raises
    ------
    InputError
        For P', R or E* not above zero, beta outside -0.5 to 0.5, or anything that is not finite.
    """
    check_positive(
        line_load_n_per_mm=line_load_n_per_mm,
        radius_mm=radius_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )
    check_finite(friction=friction)
    if not abs(beta) <= 0.5:
        raise InputError("beta_but_dundurs_constant", beta=beta)
    e = float(np.arctan(friction * beta) / np.pi)
    a_squared = 4.0 * line_load_n_per_mm * radius_mm / (np.pi * contact_modulus_mpa)
    a = float(np.sqrt(a_squared / (1.0 - 4.0 * e**2)))
    scale = float(contact_modulus_mpa * a * np.cos(np.pi * e) / (2.0 * radius_mm))
    return CoupledContact(
        exponent=e, half_width_mm=a, centre_mm=-2.0 * e * a, peak_mm=-4.0 * e * a,
        peak_pressure_mpa=scale * (1.0 - 2.0 * e) ** (0.5 - e) * (1.0 + 2.0 * e) ** (0.5 + e),
        scale_mpa=scale, friction=float(friction),
    )  # fmt: skip


def coupled_pressure(x_mm: ArrayLike, contact: CoupledContact) -> Floats:
    """Pressure of a sliding contact with elastic coupling.

    p = scale (1 + ξ/a)^(1/2 - ε) (1 - ξ/a)^(1/2 + ε),  ξ = x - centre

    Source: as in `coupled_contact`; derived again from the displacement equation.

    Parameters
    ----------
    x_mm : array_like, any shape
        Place from the cylinder's axis, mm.
    contact : CoupledContact
        The contact, from `coupled_contact`.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, zero outside the contact.

    Raises
    ------
    InputError
        For x that is not finite.
    """
    ratio = (coordinates("x_mm", x_mm) - contact.centre_mm) / contact.half_width_mm
    behind, ahead = np.clip(1.0 + ratio, 0.0, None), np.clip(1.0 - ratio, 0.0, None)
    e = contact.exponent
    return np.asarray(contact.scale_mpa * behind ** (0.5 - e) * ahead ** (0.5 + e))


def coupled_stress(x_mm: ArrayLike, z_mm: ArrayLike, contact: CoupledContact) -> StressField:
    """Stress under a sliding contact with elastic coupling.

    (sx - sz) + 2i txz and sx + sz follow from F(s) = ∫ p(t)/(s - t) dt, with α = 1/2 - ε,
    F = (π scale / (a cos π ε)) [s - 2 ε a - (s + a)^α (s - a)^(1 - α)],  s = ξ + iz, and q = mu p

    Source: Muskhelishvili (1953), Singular Integral Equations, for the transform; Johnson (1985),
    section 2.4, for the stresses.

    Parameters
    ----------
    x_mm : array_like, of a shape that broadcasts
        Place from the cylinder's axis, mm.
    z_mm : array_like, of a shape that broadcasts
        Depth below the surface, mm, not negative.
    contact : CoupledContact
        The contact, from `coupled_contact`.

    Returns
    -------
    StressField
        The stress in the broadcast shape, MPa.

    Raises
    ------
    InputError
        For z below zero, or coordinates that are not finite.
    """
    x, z = half_plane_points(x_mm, z_mm)
    a = contact.half_width_mm
    points = complex_points((x - contact.centre_mm) / a, z / a)
    value, slope = _jacobi_transform(points, contact.exponent)
    strength = np.pi * contact.scale_mpa / np.cos(np.pi * contact.exponent)
    return stress_from_transforms(
        strength * value, strength * slope * points.imag, contact.friction
    )


def _jacobi_transform(points: Complexes, e: float) -> tuple[Complexes, Complexes]:
    """s - 2ε - (s + 1)^(1/2 - ε) (s - 1)^(1/2 + ε) and its slope (0 on the surface, see caller)."""
    value, slope = np.zeros_like(points), np.zeros_like(points)
    far = np.abs(points) > _FAR
    near, below = ~far, ~far & (points.imag > 0.0)
    s = points[near]
    value[near] = s - 2.0 * e - (s + 1.0) ** (0.5 - e) * (s - 1.0) ** (0.5 + e)
    s = points[below]
    slope[below] = 1.0 - (s + 2.0 * e) * (s + 1.0) ** (-0.5 - e) * (s - 1.0) ** (e - 0.5)
    # (1 + u)^(1/2-ε) (1 - u)^(1/2+ε) = Σ c_n u^n, u = 1/s; c_0 and c_1 cancel against s - 2ε
    c = [1.0, -2.0 * e]
    for n in range(1, _TERMS):
        c.append((-2.0 * e * c[n] + (n - 2) * c[n - 1]) / (n + 1))
    series = np.array([0.0, 0.0, *c[2:]])
    u = 1.0 / points[far]
    value[far] = -np.polynomial.polynomial.polyval(u, series) / u
    slope[far] = np.polynomial.polynomial.polyval(u, series * (np.arange(series.size) - 1.0))
    return value, slope
