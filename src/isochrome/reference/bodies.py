"""Bodies in closed form: disc, ring, a plate with a round hole, a beam in four-point bending.

Disc and ring are pressed on the top (0, -R) and the bottom (0, R) by point loads; origin at the
CENTRE, x to the right, z downward. The plate is under tension along x, and large against its hole.
The beam's inner rollers press from above: eta, from mid-height, is positive DOWNWARD, where it is
stretched. Plane stress or strain alike: no stress depends on elastic constants. N, mm, MPa.
"""

from functools import lru_cache

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import ArrayLike

from isochrome.errors import InputError
from isochrome.reference.cauchy import (
    SLACK,
    Complexes,
    Floats,
    StressComponents,
    check_finite,
    check_positive,
    complex_points,
    coordinates,
    plane_points,
)

_UNDER = 1e-150  # distance over the radius that is none: its inverse square has no number


def disc_stress(
    x_mm: ArrayLike, z_mm: ArrayLike, *, load_n: float, diameter_mm: float, thickness_mm: float
) -> StressComponents:
    """Stress in a disc pressed along its vertical diameter.

    Two radial (Flamant) fields and the uniform tension 2 P/(π D d) sum up, with s = x - iz, to
    (sx - sz) + 2i txz = (4 P R/(π d)) (R² - r²) / (s² + R²)²
    sx + sz = (2 P/(π R d)) [1 - 2 R² Re 1/(s² + R²)]

    Source: Frocht (1948), Photoelasticity, vol. 2; Timoshenko & Goodier, Theory of Elasticity,
    chapter on polar coordinates; the complex form was derived from theirs.

    Parameters
    ----------
    x_mm, z_mm : array_like, of shapes that broadcast
        Place to the right of the disc's centre and below it, mm.
    load_n, diameter_mm, thickness_mm : float
        Load P, N, diameter D = 2 R and thickness d, mm.

    Returns
    -------
    StressComponents
        The stress in the broadcast shape, MPa; NaN outside and under the loads.
    """
    unit, inverse, rim_distance = _disc_terms(x_mm, z_mm, load_n, diameter_mm, thickness_mm)
    total = 2.0 * unit * (1.0 - 2.0 * inverse.real)
    return StressComponents.from_invariants(4.0 * unit * rim_distance * np.square(inverse), total)


def disc_principal_difference(
    x_mm: ArrayLike, z_mm: ArrayLike, *, load_n: float, diameter_mm: float, thickness_mm: float
) -> Floats:
    """Principal difference sigma1 - sigma2 in the disc.

    sigma1 - sigma2 = (4 P R/(π d)) (R² - r²) / ((R² + r²)² - 4 R² z²)

    Source: as in `disc_stress`.

    Parameters
    ----------
    x_mm, z_mm : array_like, of shapes that broadcast
        Place to the right of the disc's centre and below it, mm.
    load_n, diameter_mm, thickness_mm : float
        Load P, N, diameter D = 2 R and thickness d, mm.

    Returns
    -------
    ndarray, in the broadcast shape
        The difference, MPa; NaN outside and under the loads.
    """
    unit, inverse, rim_distance = _disc_terms(x_mm, z_mm, load_n, diameter_mm, thickness_mm)
    return np.asarray(4.0 * unit * rim_distance * np.square(np.abs(inverse)))


def disc_centre_difference(*, load_n: float, diameter_mm: float, thickness_mm: float) -> float:
    """Principal difference at the disc's centre: what a calibration reads.

    sigma1 - sigma2 = 8 P / (π D d)

    Source: Frocht (1948), Photoelasticity, vol. 2.

    Parameters
    ----------
    load_n, diameter_mm, thickness_mm : float
        Load P, N, diameter D = 2 R and thickness d, mm.

    Returns
    -------
    float
        The difference, MPa.
    """
    check_positive(load_n=load_n, diameter_mm=diameter_mm, thickness_mm=thickness_mm)
    return float(8.0 * load_n / (np.pi * diameter_mm * thickness_mm))


def _disc_terms(
    x_mm: ArrayLike, z_mm: ArrayLike, load_n: float, diameter_mm: float, thickness_mm: float
) -> tuple[float, Complexes, Floats]:
    """2 P/(π D d), R²/(s² + R²), s = x - iz, 1 - r²/R²; NaN outside and under the loads."""
    check_positive(load_n=load_n, diameter_mm=diameter_mm, thickness_mm=thickness_mm)
    x, z = plane_points(x_mm, z_mm)
    unit, radius = 2.0 * load_n / (np.pi * diameter_mm * thickness_mm), diameter_mm / 2.0
    s = complex_points(x / radius, -z / radius)
    # s² + 1 as a product, and 1 - r² as one: near a load and near the rim they keep their digits
    product = (s + 1j) * (s - 1j)
    r = np.abs(s)
    inside = (r <= 1.0 + SLACK) & (np.abs(product) > _UNDER)
    inverse = np.where(inside, 1.0 / np.where(inside, product, 1.0), complex(np.nan, np.nan))
    return unit, inverse, np.where(inside, np.clip((1.0 - r) * (1.0 + r), 0.0, None), np.nan)


WIDEST_HOLE = 0.98
"""Largest hole over the diameter. Bending of a thin ring is a small difference of large terms: here
tractions of 1e-14 of the largest stress are left on its edges, and the digits go with 1/(R - a)."""

_EXACT = 1e-17
"""Share of the load's stress at which the series ends: a rounding."""


def ring_stress(
    x_mm: ArrayLike,
    z_mm: ArrayLike,
    *,
    load_n: float,
    diameter_mm: float,
    hole_mm: float,
    thickness_mm: float,
) -> StressComponents:
    """Stress in a ring pressed along its vertical diameter.

    The disc's field in closed form takes the point loads. What it leaves on the circle of the hole,
    r = a, is taken off by the potentials Φ = Σ A_k s^k, Ψ = Σ B_k s^k (k even, s = x - iz), whose
    tractions vanish on the rim, r = R:
    σr - iτrθ = Σ [(1 - k) A_k r^k + A_-k r^-k - B_(k-2) r^(k-2)] exp ikθ
    sx + sz = 4 Re Φ,  (sx - sz) + 2i txz = -2 (s̄ Φ' + Ψ)
    Each k takes two linear equations. Their terms fall like (a/R)^k at the hole and (a/R)^2k at the
    rim, so that a few dozen are exact, also beside the loads.

    Source: Muskhelishvili (1953), Some Basic Problems of the Mathematical Theory of Elasticity,
    section 59 (the annulus by power series); Timoshenko & Goodier (1970), Theory of Elasticity,
    section 46 (the disc's loads taken apart); first solved by Filon (1924), ICE Selected
    Engineering Papers 12.

    Parameters
    ----------
    x_mm, z_mm : array_like, of shapes that broadcast
        Place to the right of the ring's centre and below it, mm.
    load_n, diameter_mm, hole_mm, thickness_mm : float
        Load P, N, outer diameter 2 R, that of the hole, 2 a, at most 0.98 of it, and thickness d,
        mm.

    Returns
    -------
    StressComponents
        The stress in the broadcast shape, MPa; NaN outside and under the loads.
    """
    check_positive(
        load_n=load_n, diameter_mm=diameter_mm, hole_mm=hole_mm, thickness_mm=thickness_mm
    )
    if hole_mm > WIDEST_HOLE * diameter_mm:
        raise InputError(
            "hole_mm_but_must_most", widest_hole=WIDEST_HOLE, diameter_mm=diameter_mm,
            hole_mm=hole_mm,
        )  # fmt: skip
    x, z = plane_points(x_mm, z_mm)
    disc = disc_stress(x, z, load_n=load_n, diameter_mm=diameter_mm, thickness_mm=thickness_mm)
    ratio = hole_mm / diameter_mm
    s = complex_points(2.0 * x / diameter_mm, -2.0 * z / diameter_mm)
    material = np.isfinite(disc.sigma_x) & (np.abs(s) >= ratio * (1.0 - SLACK))
    unit = load_n / (np.pi * diameter_mm * thickness_mm)
    total, difference = np.full(s.shape, np.nan), np.full(s.shape, complex(np.nan, np.nan))
    s, (grow_phi, fall_phi, grow_psi, fall_psi) = s[material], _ring_series(ratio)
    grow, fall = np.square(s), np.square(ratio / s)
    orders = 2.0 * np.arange(len(grow_phi))
    phi = polyval(grow, grow_phi) + polyval(fall, fall_phi)
    psi = polyval(grow, grow_psi) + polyval(fall, fall_psi)
    # s Φ', so that s̄ Φ' = (s̄/s) s Φ' without a power of its own
    slope = polyval(grow, orders * grow_phi) - polyval(fall, orders * fall_phi)
    total[material] = 4.0 * phi.real
    difference[material] = -2.0 * (np.conj(s) / s * slope + psi)
    return StressComponents(
        sigma_x=np.asarray(disc.sigma_x + 0.5 * unit * (total + difference.real)),
        sigma_z=np.asarray(disc.sigma_z + 0.5 * unit * (total - difference.real)),
        tau_xz=np.asarray(disc.tau_xz + 0.5 * unit * difference.imag),
    )


@lru_cache(maxsize=8)
def _ring_series(ratio: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Powers of (s/R)² and (a/s)², from 0 on, in Φ and in Ψ, for a load of 2π R d, the disc's Φ
    1 - 2/(s² + 1). With α = A_k, γ = A_-k (R/a)^k, R = 1, ρ = a/R, its tractions D at the hole and
    the rim's equations for B_(k-2) and B_(-k-2) put in, k = 2, 4, ...:
      (1 - k) (ρ^k - ρ^(k-2)) α + (1 - ρ^(2k-2)) γ = -D_k
      (ρ^(2k+2) - 1) α + (1 + k) (ρ^(k+2) - ρ^k) γ = -D_-k ρ^(k+2)
    """
    # a term falls like (a/R)^(k-2); k² stands before it, which two more outweigh
    count = 4 + int(np.ceil(np.log(_EXACT) / (2.0 * np.log(ratio))))
    k = 2.0 * np.arange(1, count)
    sign = (-1.0) ** np.arange(1, count)
    thin = 1.0 - ratio**2
    # of the disc: A_k = -2 (-1)^(k/2) for k >= 2, B_k = -2 (k + 2) (-1)^(k/2); none for k < 0
    onto = -2.0 * sign * (1.0 - k) * ratio**k - 2.0 * sign * k * ratio ** (k - 2.0)
    back = -2.0 * sign * ratio ** (2.0 * k + 2.0)
    first = (k - 1.0) * ratio ** (k - 2.0) * thin, -np.expm1((2.0 * k - 2.0) * np.log(ratio))
    second = np.expm1((2.0 * k + 2.0) * np.log(ratio)), -(k + 1.0) * ratio**k * thin
    determinant = first[0] * second[1] - first[1] * second[0]
    grow = (-onto * second[1] + first[1] * back) / determinant
    fall = (-first[0] * back + second[0] * onto) / determinant
    # k = 0: 2 A_0 = B_-2 on the rim, 2 A_0 - B_-2/ρ² = -D_0 = 2 at the hole
    uniform = -(ratio**2) / thin
    grow_psi = (1.0 - k) * grow + fall * ratio**k  # B_(k-2)
    # B_(-k-2) a^(-k-2) from the hole, not from the rim: no difference of large terms
    fall_psi = (1.0 + k) * fall + (grow - 2.0 * sign) * ratio**k
    of_phi = np.r_[uniform, grow, 0.0], np.r_[0.0, fall, 0.0]
    return *of_phi, np.r_[grow_psi, 0.0, 0.0], np.r_[0.0, -2.0 / thin, fall_psi]


def hole_stress(
    x_mm: ArrayLike, z_mm: ArrayLike, *, tension_mpa: float, radius_mm: float
) -> StressComponents:
    """Stress around a round hole in a plate under tension along x.

    With w = x + iz = r exp iθ and ρ = a²/r²
    sx + sz = S (1 - 2 ρ cos 2θ)
    (sx - sz) + 2i txz = S [1 - ρ exp 2iθ - (2ρ - 3ρ²) exp 4iθ]
    so that at the rim the hoop stress is S (1 - 2 cos 2θ): 3 S across the tension, -S along it.

    Source: Kirsch (1898), Z. VDI 42, 797; Timoshenko & Goodier (1970), Theory of Elasticity,
    section 35; the complex form was derived from their polar components.

    Parameters
    ----------
    x_mm, z_mm : array_like, of shapes that broadcast
        Place to the right of the hole's centre and below it, mm.
    tension_mpa : float
        Tension S far away, MPa; negative for a pressure.
    radius_mm : float
        Radius a of the hole, mm.

    Returns
    -------
    StressComponents
        The stress in the broadcast shape, MPa; NaN in the hole.
    """
    check_positive(radius_mm=radius_mm)
    check_finite(tension_mpa=tension_mpa)
    x, z = plane_points(x_mm, z_mm)
    w = complex_points(x / radius_mm, z / radius_mm)
    w[np.abs(w) < 1.0 - SLACK] = complex(np.nan, np.nan)
    near = 1.0 / np.square(np.abs(w))
    twice = near * np.square(w)
    total = tension_mpa * (1.0 - 2.0 * near * twice.real)
    difference = tension_mpa * (1.0 - near * twice * (1.0 + (2.0 - 3.0 * near) * twice))
    return StressComponents.from_invariants(difference, total)


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
            "outer_span_mm_but_must_exceed", outer_span_mm=outer_span_mm,
            inner_span_mm=inner_span_mm,
        )  # fmt: skip
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
