r"""A point force on the edge of a half-plane, or its dipole: stress and displacement.

With ζ = x - i z from the force, P normal and Q tangential per thickness,

    (sx - sz) + 2i txz = -(2/π) [ z (P + iQ)/ζ² + Q/ζ ],    sx + sz = -(2/π) Re (Q - iP)/ζ,
    u_x - i u_z = (1+ν)/E [ κ k ln ζ + k ln ζ* - k* ζ/ζ* ],  k = -(Q - iP)/(2π),  κ = (3-ν)/(1+ν)

in plane stress, * for the conjugate; the displacement up to a rigid body's. A dipole is the
derivative of these along the force's place, d/dt = -d/dx.
Source: Muskhelishvili (1953), Some Basic Problems of the Mathematical Theory of Elasticity,
sections 32 and 93; the stress is Johnson (1985), Contact Mechanics, eq. 2.23, at one place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from isochrome.stress.field import StressComponents
from isochrome.stress.half_plane.hats import Floats


class PointForce(NamedTuple):
    """A point force on a half-plane's edge, per thickness (N/mm), or a dipole's moment (N)."""

    normal: float  # P
    tangential: float  # Q
    dipole: bool = False


def point_force_stress(x_mm: Floats, z_mm: Floats, force: PointForce) -> StressComponents:
    """Stress in the half-plane. Parameters: places from the force, of one shape (mm); `force`."""
    p, q, zeta = force.normal, force.tangential, x_mm - 1j * z_mm
    first, second = (1 / zeta**2, 2 / zeta**3) if force.dipole else (1 / zeta, 1 / zeta**2)
    difference = -2 / np.pi * (z_mm * (p + 1j * q) * second + q * first)
    trace = -2 / np.pi * ((q - 1j * p) * first).real
    return StressComponents.from_invariants(difference, trace)


def point_force_displacement(
    x_mm: Floats, z_mm: Floats, force: PointForce, poisson: float
) -> tuple[Floats, Floats]:
    """Displacement along x and z, times Young's modulus, in plane stress (N/mm).

    Parameters: places from the force, of one shape (mm); `force`; `poisson`, ν.
    """
    zeta = x_mm - 1j * z_mm
    conjugate = zeta.conj()
    k = -(force.tangential - 1j * force.normal) / (2 * np.pi)
    kappa = (3 - poisson) / (1 + poisson)
    if force.dipole:
        turned = 1 / conjugate - zeta / conjugate**2
        sum_of_terms = -(kappa * k / zeta + k / conjugate - np.conj(k) * turned)
    else:
        logs = kappa * np.log(zeta) + np.log(conjugate)
        sum_of_terms = k * logs - np.conj(k) * zeta / conjugate
    both = (1 + poisson) * sum_of_terms
    return both.real, -both.imag
