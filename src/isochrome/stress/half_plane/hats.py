r"""One hat of traction: its Cauchy integrals, in closed form, at any place in the half-plane.

A traction that is linear between nodes is a sum of hats of half-width h. With ζ = x - i z from the
hat's node, its stresses need two integrals,

    ∫ hat/(ζ-t) dt   = second difference over h of ζ ln ζ - ζ,
    ∫ hat/(ζ-t)² dt  = second difference over h of -ln ζ,

finite everywhere and exact at z = 0: no spikes as those of stepwise constant tractions.
Source: integration by parts of the distributed load of Johnson (1985), Contact Mechanics, 2.3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]
Complexes = NDArray[np.complexfloating]

_FAR = 40.0
"""Distance over h beyond which the hat's moments replace the second differences."""


def cauchy_of_hat(
    x_mm: Floats, z_mm: Floats | float, spacing_mm: float
) -> tuple[Complexes, Complexes]:
    """∫ hat/(ζ-t) dt and ∫ hat/(ζ-t)² dt (1/mm) at ζ = x - i z, z >= 0, from the hat's node.

    Near by, second differences of ζ ln ζ and -ln ζ; far off, the hat's moments, where those would
    cancel. On the surface ln ζ is the limit from below; the second integral, infinite at a node
    there but only ever multiplied by z = 0, is given as zero. `spacing_mm` is h. Source: see the
    module.
    """
    x, z = np.broadcast_arrays(x_mm, z_mm)
    zeta: Complexes = np.empty(x.shape, complex)
    zeta.real, zeta.imag = x / spacing_mm, -(z / spacing_mm)
    far = np.square(zeta.real) + np.square(zeta.imag) > _FAR**2
    inverse: Complexes = np.divide(1.0, zeta, out=np.ones_like(zeta), where=far)
    square: Complexes = inverse * inverse
    first: Complexes = inverse * (1.0 + square * (1 / 6 + square * (1 / 15 + square / 28)))
    second: Complexes = square * (1.0 + square * (3 / 6 + square * (5 / 15 + square * 7 / 28)))
    near = zeta[~far]
    logs = [_log_from_below(near + k) for k in (-1.0, 0.0, 1.0)]
    first[~far] = (near - 1) * logs[0] - 2 * near * logs[1] + (near + 1) * logs[2]
    second[~far] = -(logs[0] - 2 * logs[1] + logs[2])
    return first, second / spacing_mm


def _log_from_below(zeta: Complexes) -> Complexes:
    """Natural logarithm with the branch of the lower half-plane; zero at zero (times zero)."""
    size = np.abs(zeta)
    angle = np.where((zeta.imag == 0.0) & (zeta.real < 0.0), -np.pi, np.angle(zeta))
    return np.log(np.where(size == 0.0, 1.0, size)) + 1j * angle
