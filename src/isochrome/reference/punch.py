"""Contacts that are not Hertz's: flat punch, blunt wedge, Westergaard's wavy surface.

Axes: x along the surface to the right, z into the block, origin at the middle of the punch, at the
wedge's tip or on a crest of the wave. Frictionless, plane strain, N, mm, MPa; a line load is per
thickness, N/mm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from isochrome.reference._common import (
    Floats,
    StressField,
    check_positive,
    complex_points,
    coordinates,
    edge_root,
    half_plane_points,
    stress_from_transforms,
)


def punch_pressure(x_mm: ArrayLike, *, half_width_mm: float, line_load_n_per_mm: float) -> Floats:
    """Pressure under a rigid flat punch at x, MPa; shape of `x_mm`, inf at the two corners.

    p = P' / (π sqrt(a² - x²)) for |x| < a, zero outside

    `x_mm` any shape, from the punch's middle; `half_width_mm` a and `line_load_n_per_mm` P' per
    thickness scalars. Raises InputError unless a and P' are above zero and x is finite.
    Source: Johnson (1985), Contact Mechanics, section 2.8.
    """
    check_positive(half_width_mm=half_width_mm, line_load_n_per_mm=line_load_n_per_mm)
    ratio = np.abs(coordinates("x_mm", x_mm) / half_width_mm)
    with np.errstate(divide="ignore"):
        inverse_root = 1.0 / np.sqrt(np.clip(1.0 - ratio, 0.0, None) * (1.0 + ratio))
    mean_scale = line_load_n_per_mm / (np.pi * half_width_mm)
    return np.asarray(np.where(ratio <= 1.0, mean_scale * inverse_root, 0.0))


def punch_stress(
    x_mm: ArrayLike, z_mm: ArrayLike, *, half_width_mm: float, line_load_n_per_mm: float
) -> StressField:
    """Stress under a rigid flat frictionless punch, MPa; NaN at its two corners, x = ±a, z = 0.

    (sx - sz) + 2i txz and sx + sz follow from F(s) = ∫ p(t)/(s - t) dt = P' / sqrt(s² - a²),
    F' = -P' s / (s² - a²)^(3/2), s = x + iz

    `x_mm`, `z_mm` >= 0: any shapes that broadcast; `half_width_mm` a and `line_load_n_per_mm` P'
    scalars. Returns a StressField of the broadcast shape. Raises InputError for z < 0, a or P' <= 0
    or coordinates that are not finite. Source: Johnson (1985), sections 2.4 and 2.8.
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
    """Half-width a of the contact of a blunt symmetric wedge, mm.

    a = P' / (E* m)

    Scalars: `line_load_n_per_mm` P' per thickness; `slope` m, the rise of either face over its run
    (small: a blunt wedge); `contact_modulus_mpa` E*. Raises InputError unless all are above zero.
    Source: Johnson (1985), Contact Mechanics, section 5.2.
    """
    check_positive(
        line_load_n_per_mm=line_load_n_per_mm, slope=slope, contact_modulus_mpa=contact_modulus_mpa
    )
    return line_load_n_per_mm / (contact_modulus_mpa * slope)


def wedge_pressure(
    x_mm: ArrayLike, *, half_width_mm: float, slope: float, contact_modulus_mpa: float
) -> Floats:
    """Pressure under a blunt symmetric wedge at x, MPa; shape of `x_mm`, inf at the tip.

    p = (E* m / π) arcosh(a / |x|) for |x| < a, zero outside

    `x_mm` any shape, from the tip; `half_width_mm` a, `slope` m and `contact_modulus_mpa` E*
    scalars, as in `wedge_half_width`. Raises InputError unless they are above zero and x is finite.
    Source: Johnson (1985), Contact Mechanics, section 5.2.
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
    """Mean pressure p* that just closes the gap under a wavy surface, MPa.

    p* = π E* Δ / λ

    Scalars: `amplitude_mm` Δ, half the height from trough to crest of the wave
    Δ cos(2 π x/λ); `wavelength_mm` λ; `contact_modulus_mpa` E*. Raises InputError unless all are
    above zero. Source: Westergaard (1939), Journal of Applied Mechanics 6; Johnson (1985),
    Contact Mechanics, section 13.2.
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
    """Half-width a of each strip of contact on a wavy surface, mm; λ/2 once contact is full.

    sin²(π a/λ) = p_mean / p*

    Scalars: `mean_pressure_mpa` p_mean over a wavelength; the others as in
    `wavy_full_contact_pressure`, with its sources. Raises InputError unless all are above zero.
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
    """Pressure on a wavy surface at x, MPa, zero where the gap is open; shape of `x_mm`.

    p = 2 p* |cos ψ| sqrt(sin² ψ_a - sin² ψ), ψ = π x/λ, ψ_a = π a/λ, while p_mean < p*;
    p = p_mean + p* cos 2ψ from there on

    `x_mm` any shape, from a crest; the scalars as in `wavy_half_width`, with its sources. Raises
    InputError unless they are above zero and x is finite.
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
