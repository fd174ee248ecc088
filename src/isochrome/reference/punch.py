"""Contacts that are not Hertz's: flat punch, blunt wedge, Westergaard's wavy surface.

Axes: x along the surface to the right, z into the block, origin at the middle of the punch, at the
wedge's tip or on a crest of the wave. Frictionless, plane strain, N, mm, MPa; a line load is per
thickness, N/mm.
"""

import numpy as np
from numpy.typing import ArrayLike

from isochrome.reference.cauchy import (
    Floats,
    StressComponents,
    check_positive,
    complex_points,
    coordinates,
    edge_root,
    half_plane_points,
    stress_from_transforms,
)


def punch_pressure(x_mm: ArrayLike, *, half_width_mm: float, line_load_n_per_mm: float) -> Floats:
    """Pressure under a rigid flat punch at x.

    p = P' / (π sqrt(a² - x²)) for |x| < a, zero outside

    Source: Johnson (1985), Contact Mechanics, section 2.8.

    Parameters
    ----------
    x_mm : array_like, any shape
        Place from the punch's middle, mm.
    half_width_mm : float
        Half-width a of the contact, mm.
    line_load_n_per_mm : float
        Load per thickness P', N/mm, above zero.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, inf at the two corners.

    Raises
    ------
    InputError
        Unless a and P' are above zero and x is finite.
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
    x_mm : array_like, of a shape that broadcasts
        Place from the punch's middle, mm.
    z_mm : array_like, of a shape that broadcasts
        Depth below the surface, mm, not negative.
    half_width_mm : float
        Half-width a of the contact, mm.
    line_load_n_per_mm : float
        Load per thickness P', N/mm, above zero.

    Returns
    -------
    StressComponents
        The stress in the broadcast shape, MPa; NaN at the two corners, x = ±a, z = 0.

    Raises
    ------
    InputError
        For z below zero, a or P' not above zero, or coordinates that are not finite.
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
        Load per thickness P', N/mm, above zero.
    slope : float
        Rise of either face over its run, m; small: a blunt wedge.
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
    slope : float
        Rise of either face over its run, m; small: a blunt wedge.
    contact_modulus_mpa : float
        Contact modulus E*, MPa, above zero.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, inf at the tip.

    Raises
    ------
    InputError
        Unless a, m and E* are above zero and x is finite.
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
    amplitude_mm : float
        Amplitude Δ of the wave Δ cos(2 π x/λ), mm: half the height from trough to crest.
    wavelength_mm : float
        Wavelength λ, mm.
    contact_modulus_mpa : float
        Contact modulus E*, MPa, above zero.

    Returns
    -------
    float
        The pressure p*, MPa.

    Raises
    ------
    InputError
        Unless all are above zero.
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
    amplitude_mm : float
        Amplitude Δ of the wave Δ cos(2 π x/λ), mm: half the height from trough to crest.
    wavelength_mm : float
        Wavelength λ, mm.
    contact_modulus_mpa : float
        Contact modulus E*, MPa, above zero.

    Returns
    -------
    float
        The half-width, mm; λ/2 once contact is full.

    Raises
    ------
    InputError
        Unless all are above zero.
    """
    check_positive(mean_pressure_mpa=mean_pressure_mpa)
    full = wavy_full_contact_pressure(
        amplitude_mm=amplitude_mm,
        wavelength_mm=wavelength_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )
    closed = min(mean_pressure_mpa / full, 1.0)
    return float(wavelength_mm / np.pi * np.arcsin(np.sqrt(closed)))


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
    amplitude_mm : float
        Amplitude Δ of the wave Δ cos(2 π x/λ), mm: half the height from trough to crest.
    wavelength_mm : float
        Wavelength λ, mm.
    contact_modulus_mpa : float
        Contact modulus E*, MPa, above zero.

    Returns
    -------
    ndarray, shape of x_mm
        The pressure, MPa, zero where the gap is open.

    Raises
    ------
    InputError
        Unless the scalars are above zero and x is finite.
    """
    check_positive(mean_pressure_mpa=mean_pressure_mpa)
    full = wavy_full_contact_pressure(
        amplitude_mm=amplitude_mm,
        wavelength_mm=wavelength_mm,
        contact_modulus_mpa=contact_modulus_mpa,
    )
    psi = np.pi * coordinates("x_mm", x_mm) / wavelength_mm
    if mean_pressure_mpa >= full:
        return np.asarray(mean_pressure_mpa + full * np.cos(2.0 * psi))
    under_root = np.clip(mean_pressure_mpa / full - np.square(np.sin(psi)), 0.0, None)
    return np.asarray(2.0 * full * np.abs(np.cos(psi)) * np.sqrt(under_root))
