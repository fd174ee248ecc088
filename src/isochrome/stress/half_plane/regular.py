r"""Stress that stays regular under a surface free of tractions: what a contact's own field lacks.

Below a contact the stress of a real body is that of a half-plane under the same tractions and a
smooth rest: stress along the surface, bending, the body's own sides and support. With ζ = x - i z
the rest is a power series of the half-plane's complex potential, 4Φ = Σ s_n ζ^n,

    sigma_x + sigma_z             = Re Σ s_n ζ^n,
    (sigma_x - sigma_z) + 2i tau  = Σ Re(s_n) ζ^n - i z Σ n s_n ζ^(n-1),

in equilibrium, compatible, and free of tractions at z = 0 for any s_n: s_0 is sigma_x along the
surface, Re s_1 its change along x (with tau = -z Re s_1), Im s_1 its change along z, pure bending.
The series converges within the distance to whatever else acts on the body.
Source: Muskhelishvili (1953), Some Basic Problems of the Mathematical Theory of Elasticity,
section 90 (potential of a half-plane whose edge is free).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from isochrome.stress.half_plane.hats import Complexes, Floats


@dataclass(frozen=True)
class RegularStress:
    """A regular stress by its power series, free of tractions on the surface."""

    series: tuple[complex, ...] = ()  # the terms s_n, MPa/mm^n; empty for no stress

    def __add__(self, other: RegularStress) -> RegularStress:
        pairs = zip_longest(self.series, other.series, fillvalue=0j)
        return RegularStress(tuple(a + b for a, b in pairs))

    def __bool__(self) -> bool:
        return any(self.series)

    def times(self, factor: float) -> RegularStress:
        """The same stress, a factor larger."""
        return RegularStress(tuple(factor * s for s in self.series))

    def difference(self, x_mm: Floats, z_mm: Floats) -> Complexes:
        """(sigma_x - sigma_z) + 2i tau_xz at places of shapes that broadcast (mm), MPa."""
        x, z = np.asarray(x_mm, float), np.asarray(z_mm, float)
        even = _power_series([s.real for s in self.series], x, z)
        slope = _power_series([n * s for n, s in enumerate(self.series)][1:], x, z)
        return np.asarray(even - 1j * z * slope)

    def trace(self, x_mm: Floats, z_mm: Floats) -> Floats:
        """sigma_x + sigma_z at places of shapes that broadcast (mm), MPa."""
        return _power_series(self.series, np.asarray(x_mm, float), np.asarray(z_mm, float)).real


def _power_series(terms: tuple[complex, ...] | list[complex], x: Floats, z: Floats) -> Complexes:
    """Σ terms_n ζ^n by Horner's rule, ζ = x - i z."""
    shape = np.broadcast_shapes(x.shape, z.shape)
    if len(terms) < 2:
        return np.full(shape, terms[0] if terms else 0.0, dtype=complex)
    zeta = x - 1j * z
    total = np.full(shape, terms[-1], dtype=complex)
    for term in reversed(terms[:-1]):
        total *= zeta
        total += term
    return total


NO_STRESS = RegularStress()
"""Nothing besides the contact's own stress."""


def uniform_stress(sigma_x_mpa: float) -> RegularStress:
    """The same stress along x everywhere, tension positive."""
    return RegularStress((complex(sigma_x_mpa),))


def regular_modes(degree: int) -> tuple[RegularStress, ...]:
    """The 2 degree + 1 real modes up to a degree n: sigma_x = x^n along the surface, and bending.

    They are s_0 = 1, s_1 = 1, s_1 = i, s_2 = 1, s_2 = i, ..., each 1 MPa/mm^n.
    """
    modes = [RegularStress((1 + 0j,))]
    for n in range(1, degree + 1):
        modes += [RegularStress((*(0j,) * n, unit)) for unit in (1 + 0j, 1j)]
    return tuple(modes)
