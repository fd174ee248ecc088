"""Disc under diametral compression by two point loads, in closed form.

Axes: origin at the disc's CENTRE, x to the right, z downward; the loads press on the top (0, -R)
and the bottom (0, R). Plane stress or plane strain alike: the stresses do not depend on elastic
constants. N, mm, MPa.
"""

import numpy as np
from numpy.typing import ArrayLike

from isochrome.reference.cauchy import (
    Complexes,
    Floats,
    StressField,
    check_positive,
    complex_points,
    plane_points,
)

_RIM_SLACK = 1e-9  # of the radius: a rim point's rounding must not put it outside
_UNDER = 1e-150  # distance over the radius that is none: its inverse square has no number


def disc_stress(
    x_mm: ArrayLike, z_mm: ArrayLike, *, load_n: float, diameter_mm: float, thickness_mm: float
) -> StressField:
    """Stress in a disc pressed along its vertical diameter.

    Two radial (Flamant) fields and the uniform tension 2 P/(π D d) sum up, with s = x - iz, to
    (sx - sz) + 2i txz = (4 P R/(π d)) (R² - r²) / (s² + R²)²
    sx + sz = (2 P/(π R d)) [1 - 2 R² Re 1/(s² + R²)]

    Source: Frocht (1948), Photoelasticity, vol. 2; Timoshenko & Goodier, Theory of Elasticity,
    chapter on polar coordinates; the complex form was derived from theirs.

    Parameters
    ----------
    x_mm : array_like, of a shape that broadcasts
        Place to the right of the disc's centre, mm.
    z_mm : array_like, of a shape that broadcasts
        Place below the disc's centre, mm.
    load_n : float
        Load P, N.
    diameter_mm : float
        Diameter D = 2 R, mm.
    thickness_mm : float
        Thickness d, mm.

    Returns
    -------
    StressField
        The stress in the broadcast shape, MPa; NaN outside and under the loads.

    Raises
    ------
    InputError
        For P, D or d not above zero, or coordinates that are not finite.
    """
    x, z = _points_in_disc(x_mm, z_mm, load_n, diameter_mm, thickness_mm)
    inverse, rim_distance = _inverse_distances(x, z, diameter_mm / 2.0)
    unit = 2.0 * load_n / (np.pi * diameter_mm * thickness_mm)
    total = 2.0 * unit * (1.0 - 2.0 * inverse.real)
    difference = 4.0 * unit * rim_distance * np.square(inverse)
    return StressField.of(total, difference)


def disc_principal_difference(
    x_mm: ArrayLike, z_mm: ArrayLike, *, load_n: float, diameter_mm: float, thickness_mm: float
) -> Floats:
    """Principal difference sigma1 - sigma2 in the disc.

    sigma1 - sigma2 = (4 P R/(π d)) (R² - r²) / ((R² + r²)² - 4 R² z²)

    Source: as in `disc_stress`.

    Parameters
    ----------
    x_mm : array_like, of a shape that broadcasts
        Place to the right of the disc's centre, mm.
    z_mm : array_like, of a shape that broadcasts
        Place below the disc's centre, mm.
    load_n : float
        Load P, N.
    diameter_mm : float
        Diameter D = 2 R, mm.
    thickness_mm : float
        Thickness d, mm.

    Returns
    -------
    ndarray, in the broadcast shape
        The difference, MPa; NaN outside and under the loads.

    Raises
    ------
    InputError
        For P, D or d not above zero, or coordinates that are not finite.
    """
    x, z = _points_in_disc(x_mm, z_mm, load_n, diameter_mm, thickness_mm)
    inverse, rim_distance = _inverse_distances(x, z, diameter_mm / 2.0)
    unit = 2.0 * load_n / (np.pi * diameter_mm * thickness_mm)
    return np.asarray(4.0 * unit * rim_distance * np.square(np.abs(inverse)))


def disc_centre_difference(*, load_n: float, diameter_mm: float, thickness_mm: float) -> float:
    """Principal difference at the disc's centre: what a calibration reads.

    sigma1 - sigma2 = 8 P / (π D d)

    Source: Frocht (1948), Photoelasticity, vol. 2.

    Parameters
    ----------
    load_n : float
        Load P, N.
    diameter_mm : float
        Diameter D = 2 R, mm.
    thickness_mm : float
        Thickness d, mm.

    Returns
    -------
    float
        The difference, MPa.

    Raises
    ------
    InputError
        Unless all are above zero.
    """
    check_positive(load_n=load_n, diameter_mm=diameter_mm, thickness_mm=thickness_mm)
    return float(8.0 * load_n / (np.pi * diameter_mm * thickness_mm))


def _points_in_disc(
    x_mm: ArrayLike, z_mm: ArrayLike, load_n: float, diameter_mm: float, thickness_mm: float
) -> tuple[Floats, Floats]:
    check_positive(load_n=load_n, diameter_mm=diameter_mm, thickness_mm=thickness_mm)
    return plane_points(x_mm, z_mm)


def _inverse_distances(x: Floats, z: Floats, radius: float) -> tuple[Complexes, Floats]:
    """R²/(s² + R²), s = x - iz, and 1 - r²/R²; NaN outside the disc and under the loads."""
    s = complex_points(x / radius, -z / radius)
    # s² + 1 as a product, and 1 - r² as one: near a load and near the rim they keep their digits
    product = (s + 1j) * (s - 1j)
    r = np.abs(s)
    inside = (r <= 1.0 + _RIM_SLACK) & (np.abs(product) > _UNDER)
    inverse = np.where(inside, 1.0 / np.where(inside, product, 1.0), complex(np.nan, np.nan))
    return inverse, np.where(inside, np.clip((1.0 - r) * (1.0 + r), 0.0, None), np.nan)
