"""Line contacts in closed form: Hertz's with McEwen's stress field, sliding ones, and others.

Axes: x along the surface to the right, z into the block, origin at the contact's centre, of a
coupled one on the cylinder's axis, at a wedge's tip, or on a crest of a wave; q = mu p acts on the
block along +x (a negative coefficient of friction: along -x). Plane strain, N, mm, MPa; a line load
is per thickness, N/mm. Without coupling (like materials, or beta taken as zero) the pressure of a
sliding contact is Hertz's; with it the pressure leans and the contact moves. Punch, wedge and
Westergaard's wavy surface are frictionless.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.constants import golden

from isochrome.errors import InputError
from isochrome.reference.cauchy import (
    Floats,
    StressComponents,
    check_finite,
    check_positive,
    complex_points,
    coordinates,
    edge_root,
    half_plane_points,
    mcewen_terms,
    stress_from_transforms,
)


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
    young_mpa, poisson : float
        Young's modulus E1, MPa, and Poisson's ratio nu1 of the block, above -1 and up to 0.5.
    other_young_mpa, other_poisson : float
        Those of the indenter, E2 and nu2; a modulus of ``inf`` for a rigid body.

    Returns
    -------
    float
        The modulus E*, MPa.
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
    young_mpa, poisson : float
        Young's modulus E1, MPa, and Poisson's ratio nu1 of the block, above -1 and up to 0.5.
    other_young_mpa, other_poisson : float
        Those of the indenter, E2 and nu2; a modulus of ``inf`` for a rigid body.

    Returns
    -------
    float
        The inverse, 1/MPa. Zero for a pair of like materials, negative when the indenter is the
        more compliant one.
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
    young_mpa, poisson : float
        Young's modulus E1, MPa, and Poisson's ratio nu1 of the block, above -1 and up to 0.5.
    other_young_mpa, other_poisson : float
        Those of the indenter, E2 and nu2; a modulus of ``inf`` for a rigid body.

    Returns
    -------
    float
        The constant, -0.5 to 0.5, without unit.
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
        Load per thickness P', N/mm.
    radius_mm, contact_modulus_mpa : float
        Radius R of the cylinder, mm, that of the relative curvature where both bodies are curved,
        and contact modulus E*, MPa.

    Returns
    -------
    float
        The half-width, mm.
    """
    check_positive(
        line_load_n_per_mm=line_load_n_per_mm, radius_mm=radius_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )  # fmt: skip
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
        Load per thickness P', N/mm.
    radius_mm, contact_modulus_mpa : float
        Radius R of the cylinder, mm, that of the relative curvature where both bodies are curved,
        and contact modulus E*, MPa.

    Returns
    -------
    float
        The pressure, MPa.
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
    half_width_mm, peak_pressure_mpa : float
        Half-width a of the contact, mm, and largest pressure p0, MPa.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, zero outside the contact.
    """
    check_positive(half_width_mm=half_width_mm, peak_pressure_mpa=peak_pressure_mpa)
    ratio = np.abs(coordinates("x_mm", x_mm) / half_width_mm)
    # (1 - r)(1 + r) keeps its digits at the edge where 1 - r² loses them
    return np.asarray(peak_pressure_mpa * np.sqrt(np.clip(1.0 - ratio, 0.0, None) * (1.0 + ratio)))


def hertz_stress(
    x_mm: ArrayLike, z_mm: ArrayLike, *, half_width_mm: float, peak_pressure_mpa: float
) -> StressComponents:
    """Stress under a frictionless Hertz line contact (McEwen's closed form).

    With n + i m = sqrt((x + iz)² - a²), k = (m² - z²)/(m² + n²):
    sx = -(p0/a) [2 (m - z) - m k],  sz = -(p0/a) m k,  txz = -(p0/a) n k

    m - z and m² - z² are written without their cancellation, so that the field keeps its digits at
    the surface, at x = ±a and thousands of half-widths away. Source: McEwen (1949), Philosophical
    Magazine 40; Johnson (1985), section 4.2(c).

    Parameters
    ----------
    x_mm, z_mm : array_like, of shapes that broadcast
        Place from the contact's centre and depth below the surface, not negative, mm.
    half_width_mm, peak_pressure_mpa : float
        Half-width a of the contact, mm, and largest pressure p0, MPa.

    Returns
    -------
    StressComponents
        The stress in the broadcast shape, MPa.
    """
    x, z = half_plane_points(x_mm, z_mm)
    check_positive(half_width_mm=half_width_mm, peak_pressure_mpa=peak_pressure_mpa)
    root, excess, weight = mcewen_terms(x, z, half_width_mm)
    m, n, lift = root.imag, root.real, excess.imag
    k = lift * (m + z) * weight
    scale = -peak_pressure_mpa / half_width_mm
    return StressComponents(
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
    half_width_mm, peak_pressure_mpa : float
        Half-width a of the contact, mm, and largest pressure p0, MPa.

    Returns
    -------
    LargestDifference
        The difference, MPa, and its depth, mm.
    """
    check_positive(half_width_mm=half_width_mm, peak_pressure_mpa=peak_pressure_mpa)
    return LargestDifference(
        difference_mpa=float(2.0 * golden**-2.5 * peak_pressure_mpa),
        depth_mm=float(golden**-0.5 * half_width_mm),
    )


def _check_pair(young: float, poisson: float, other_young: float, other_poisson: float) -> None:
    check_positive(young_mpa=young)
    if not other_young > 0.0:
        raise InputError("other_young_mpa_but_must_above", other_young=other_young)
    for name, value in (("poisson", poisson), ("other_poisson", other_poisson)):
        if not -1.0 < value <= 0.5:
            raise InputError("but_must_lie_above", name=name, value=value)


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
) -> StressComponents:
    """Stress under a sliding Hertz contact without elastic coupling.

    To McEwen's field (`hertz_stress`, index p; n, m, k as there) the traction q = mu p adds
    mu (p0/a) [2 (n - x) + n k] to sx,  mu txz_p to sz,  mu sx_p to txz.
    On the surface sx = -p - 2 mu p0 x/a inside the contact: compressed ahead, pulled behind.

    Source: McEwen (1949), Philosophical Magazine 40; Johnson (1985), Contact Mechanics, section
    7.2.

    Parameters
    ----------
    x_mm, z_mm : array_like, of shapes that broadcast
        Place from the contact's centre and depth below the surface, not negative, mm.
    half_width_mm, peak_pressure_mpa : float
        Half-width a of the contact, mm, and largest pressure p0, MPa.
    friction : float
        Friction coefficient mu.

    Returns
    -------
    StressComponents
        The stress in the broadcast shape, MPa.
    """
    check_finite(friction=friction)
    normal = hertz_stress(
        x_mm, z_mm, half_width_mm=half_width_mm, peak_pressure_mpa=peak_pressure_mpa
    )
    x, z = half_plane_points(x_mm, z_mm)
    root, excess, weight = mcewen_terms(x, z, half_width_mm)
    k = excess.imag * (root.imag + z) * weight
    pull = (friction * peak_pressure_mpa / half_width_mm) * (2.0 * excess.real + root.real * k)
    return StressComponents(
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
        Load per thickness P', N/mm.
    radius_mm, contact_modulus_mpa : float
        Radius R of the cylinder, mm, and contact modulus E*, MPa.
    friction : float
        Friction coefficient mu; negative: traction along -x.
    beta : float
        Dundurs' second constant, see `dundurs_beta`, -0.5 to 0.5.

    Returns
    -------
    CoupledContact
        The contact.
    """
    check_positive(
        line_load_n_per_mm=line_load_n_per_mm, radius_mm=radius_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )  # fmt: skip
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
    """
    ratio = (coordinates("x_mm", x_mm) - contact.centre_mm) / contact.half_width_mm
    behind, ahead = np.clip(1.0 + ratio, 0.0, None), np.clip(1.0 - ratio, 0.0, None)
    e = contact.exponent
    return np.asarray(contact.scale_mpa * behind ** (0.5 - e) * ahead ** (0.5 + e))


def coupled_stress(x_mm: ArrayLike, z_mm: ArrayLike, contact: CoupledContact) -> StressComponents:
    """Stress under a sliding contact with elastic coupling.

    (sx - sz) + 2i txz and sx + sz follow from F(s) = ∫ p(t)/(s - t) dt, with α = 1/2 - ε,
    F = (π scale / (a cos π ε)) [s - 2 ε a - (s + a)^α (s - a)^(1 - α)],  s = ξ + iz, and q = mu p

    Source: Muskhelishvili (1953), Singular Integral Equations, for the transform; Johnson (1985),
    section 2.4, for the stresses.

    Parameters
    ----------
    x_mm, z_mm : array_like, of shapes that broadcast
        Place from the cylinder's axis and depth below the surface, not negative, mm.
    contact : CoupledContact
        The contact, from `coupled_contact`.

    Returns
    -------
    StressComponents
        The stress in the broadcast shape, MPa.
    """
    x, z = half_plane_points(x_mm, z_mm)
    a = contact.half_width_mm
    points = complex_points((x - contact.centre_mm) / a, z / a)
    # s - 2ε - (s + 1)^(1/2 - ε) (s - 1)^(1/2 + ε) and its slope, which does not count at z = 0
    e = contact.exponent
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
    strength = np.pi * contact.scale_mpa / np.cos(np.pi * e)
    return stress_from_transforms(
        strength * value, strength * slope * points.imag, contact.friction
    )


def punch_pressure(x_mm: ArrayLike, *, half_width_mm: float, line_load_n_per_mm: float) -> Floats:
    """Pressure under a rigid flat punch at x.

    p = P' / (π sqrt(a² - x²)) for |x| < a, zero outside

    Source: Johnson (1985), Contact Mechanics, section 2.8.

    Parameters
    ----------
    x_mm : array_like, any shape
        Place from the punch's middle, mm.
    half_width_mm, line_load_n_per_mm : float
        Half-width a of the contact, mm, and load per thickness P', N/mm.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, inf at the two corners.
    """
    check_positive(half_width_mm=half_width_mm, line_load_n_per_mm=line_load_n_per_mm)
    ratio = np.abs(coordinates("x_mm", x_mm) / half_width_mm)
    with np.errstate(divide="ignore"):
        inverse_root = 1.0 / np.sqrt(np.clip(1.0 - ratio, 0.0, None) * (1.0 + ratio))
    mean_scale = line_load_n_per_mm / (np.pi * half_width_mm)
    return np.asarray(np.where(ratio <= 1.0, mean_scale * inverse_root, 0.0))


def punch_stress(
    x_mm: ArrayLike, z_mm: ArrayLike, *, half_width_mm: float, line_load_n_per_mm: float
) -> StressComponents:
    """Stress under a rigid flat frictionless punch.

    (sx - sz) + 2i txz and sx + sz follow from F(s) = ∫ p(t)/(s - t) dt = P' / sqrt(s² - a²),
    F' = -P' s / (s² - a²)^(3/2), s = x + iz

    Source: Johnson (1985), sections 2.4 and 2.8.

    Parameters
    ----------
    x_mm, z_mm : array_like, of shapes that broadcast
        Place from the punch's middle and depth below the surface, not negative, mm.
    half_width_mm, line_load_n_per_mm : float
        Half-width a of the contact, mm, and load per thickness P', N/mm.

    Returns
    -------
    StressComponents
        The stress in the broadcast shape, MPa; NaN at the two corners, x = ±a, z = 0.
    """
    x, z = half_plane_points(x_mm, z_mm)
    check_positive(half_width_mm=half_width_mm, line_load_n_per_mm=line_load_n_per_mm)
    points = complex_points(x, z)
    root = edge_root(points, half_width_mm)
    corner = root == 0.0
    root = np.where(corner, 1.0, root)
    transform = np.where(corner, complex(np.nan, np.nan), line_load_n_per_mm / root)
    return stress_from_transforms(transform, -transform * ((points / root) * (z / root)))


def wedge_half_width(
    line_load_n_per_mm: float, *, slope: float, contact_modulus_mpa: float
) -> float:
    """Half-width a of the contact of a blunt symmetric wedge.

    a = P' / (E* m)

    Source: Johnson (1985), Contact Mechanics, section 5.2.

    Parameters
    ----------
    line_load_n_per_mm : float
        Load per thickness P', N/mm.
    slope, contact_modulus_mpa : float
        Rise m of either face over its run, small: a blunt wedge; contact modulus E*, MPa.

    Returns
    -------
    float
        The half-width, mm.
    """
    check_positive(
        line_load_n_per_mm=line_load_n_per_mm, slope=slope, contact_modulus_mpa=contact_modulus_mpa
    )
    return line_load_n_per_mm / (contact_modulus_mpa * slope)


def wedge_pressure(
    x_mm: ArrayLike, *, half_width_mm: float, slope: float, contact_modulus_mpa: float
) -> Floats:
    """Pressure under a blunt symmetric wedge at x.

    p = (E* m / π) arcosh(a / |x|) for |x| < a, zero outside

    Source: Johnson (1985), Contact Mechanics, section 5.2.

    Parameters
    ----------
    x_mm : array_like, any shape
        Place from the tip, mm.
    half_width_mm : float
        Half-width a of the contact, mm.
    slope, contact_modulus_mpa : float
        Rise m of either face over its run, small: a blunt wedge; contact modulus E*, MPa.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, inf at the tip.
    """
    check_positive(
        half_width_mm=half_width_mm, slope=slope, contact_modulus_mpa=contact_modulus_mpa
    )
    ratio = np.minimum(np.abs(coordinates("x_mm", x_mm) / half_width_mm), 1.0)
    root = np.sqrt((1.0 - ratio) * (1.0 + ratio))
    with np.errstate(divide="ignore"):  # arcosh(1/r), with its digits kept at the edge
        shape = np.log1p(root) - np.log(ratio)
    return np.asarray(contact_modulus_mpa * slope / np.pi * shape)


def wavy_full_contact_pressure(
    *, amplitude_mm: float, wavelength_mm: float, contact_modulus_mpa: float
) -> float:
    """Mean pressure p* that just closes the gap under a wavy surface.

    p* = π E* Δ / λ

    Source: Westergaard (1939), Journal of Applied Mechanics 6; Johnson (1985), Contact Mechanics,
    section 13.2.

    Parameters
    ----------
    amplitude_mm, wavelength_mm : float
        Amplitude Δ of the wave Δ cos(2 π x/λ), half its height, and wavelength λ, mm.
    contact_modulus_mpa : float
        Contact modulus E*, MPa.

    Returns
    -------
    float
        The pressure p*, MPa.
    """
    check_positive(
        amplitude_mm=amplitude_mm,
        wavelength_mm=wavelength_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )
    return float(np.pi * contact_modulus_mpa * amplitude_mm / wavelength_mm)


def wavy_half_width(
    mean_pressure_mpa: float,
    *,
    amplitude_mm: float,
    wavelength_mm: float,
    contact_modulus_mpa: float,
) -> float:
    """Half-width a of each strip of contact on a wavy surface.

    sin²(π a/λ) = p_mean / p*

    Source: as in `wavy_full_contact_pressure`.

    Parameters
    ----------
    mean_pressure_mpa : float
        Mean pressure p_mean over a wavelength, MPa.
    amplitude_mm, wavelength_mm : float
        Amplitude Δ of the wave Δ cos(2 π x/λ), half its height, and wavelength λ, mm.
    contact_modulus_mpa : float
        Contact modulus E*, MPa.

    Returns
    -------
    float
        The half-width, mm; λ/2 once contact is full.
    """
    check_positive(mean_pressure_mpa=mean_pressure_mpa)
    full = wavy_full_contact_pressure(
        amplitude_mm=amplitude_mm, wavelength_mm=wavelength_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )  # fmt: skip
    return float(wavelength_mm / np.pi * np.arcsin(np.sqrt(min(mean_pressure_mpa / full, 1.0))))


def wavy_pressure(
    x_mm: ArrayLike,
    *,
    mean_pressure_mpa: float,
    amplitude_mm: float,
    wavelength_mm: float,
    contact_modulus_mpa: float,
) -> Floats:
    """Pressure on a wavy surface at x.

    p = 2 p* |cos ψ| sqrt(sin² ψ_a - sin² ψ), ψ = π x/λ, ψ_a = π a/λ, while p_mean < p*;
    p = p_mean + p* cos 2ψ from there on

    Source: as in `wavy_full_contact_pressure`.

    Parameters
    ----------
    x_mm : array_like, any shape
        Place from a crest, mm.
    mean_pressure_mpa : float
        Mean pressure p_mean over a wavelength, MPa.
    amplitude_mm, wavelength_mm : float
        Amplitude Δ of the wave Δ cos(2 π x/λ), half its height, and wavelength λ, mm.
    contact_modulus_mpa : float
        Contact modulus E*, MPa.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, zero where the gap is open.
    """
    check_positive(mean_pressure_mpa=mean_pressure_mpa)
    full = wavy_full_contact_pressure(
        amplitude_mm=amplitude_mm, wavelength_mm=wavelength_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )  # fmt: skip
    psi = np.pi * coordinates("x_mm", x_mm) / wavelength_mm
    if mean_pressure_mpa >= full:
        return np.asarray(mean_pressure_mpa + full * np.cos(2.0 * psi))
    under_root = np.clip(mean_pressure_mpa / full - np.square(np.sin(psi)), 0.0, None)
    return np.asarray(2.0 * full * np.abs(np.cos(psi)) * np.sqrt(under_root))
