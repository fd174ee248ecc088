"""Stress at any places by direct sums over the loaded nodes: no grid, no FFT, double precision."""

from __future__ import annotations

import numpy as np

from isochrome.stress.field import StressComponents
from isochrome.stress.half_plane.hats import Complexes, Floats, cauchy_of_hat

_AT_ONCE = 1 << 17
"""Pairs of place and node evaluated at once: some tens of MB of scratch at most."""


def difference_and_trace(
    x_mm: Floats, z_mm: Floats, nodes_mm: Floats, pressure_mpa: Floats, shear_mpa: Floats
) -> tuple[Complexes, Floats]:
    """(sigma_x - sigma_z) + 2i tau_xz and sigma_x + sigma_z at any places.

    Parameters as `stress_components`. Returns two arrays of the places' shape, MPa.
    Source: see `isochrome.stress.half_plane.pixel_sums`.
    """
    x, z = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(z_mm, float))
    shape, x, z = x.shape, x.ravel(), z.ravel()
    difference, trace = np.zeros(x.size, complex), np.zeros(x.size)
    loaded = np.flatnonzero((pressure_mpa != 0.0) | (shear_mpa != 0.0))
    if len(loaded):
        h = float(nodes_mm[1] - nodes_mm[0])
        t, p, q = nodes_mm[loaded], pressure_mpa[loaded], shear_mpa[loaded]
        step = max(1, _AT_ONCE // len(loaded))
        for start in range(0, x.size, step):
            part = slice(start, start + step)
            first, second = cauchy_of_hat(x[part, None] - t, z[part, None], h)
            shear = _sum(first, q)
            difference[part] = -2 / np.pi * (z[part] * _sum(second, p + 1j * q) + shear)
            trace[part] = -2 / np.pi * (shear.real + _sum(first.imag, p))
    return difference.reshape(shape), trace.reshape(shape)


def _sum(kernel: Floats | Complexes, traction: Floats | Complexes) -> Complexes:
    """Sums over the nodes; not by BLAS, whose threads wait for each other on a busy machine."""
    return np.asarray(np.einsum("ij,j->i", kernel, traction))


def stress_components(
    x_mm: Floats, z_mm: Floats, nodes_mm: Floats, pressure_mpa: Floats, shear_mpa: Floats
) -> StressComponents:
    """Compute all three stress components at any places, by direct sums over the loaded nodes.

    Source: see `isochrome.stress.half_plane.pixel_sums`.

    Parameters
    ----------
    x_mm : ndarray
        Places along the surface (mm).
    z_mm : ndarray
        Depths (mm), not negative; of a shape that broadcasts with that of `x_mm`.
    nodes_mm : ndarray (n,)
        Places of the surface nodes (mm), uniform.
    pressure_mpa : ndarray (n,)
        Pressure at the nodes (MPa).
    shear_mpa : ndarray (n,)
        Shear at the nodes (MPa).

    Returns
    -------
    StressComponents
        Stress (MPa) of the places' shape, float64.

    Examples
    --------
    >>> import isochrome
    >>> static, *_ = isochrome.scene_states(isochrome.load_scene("line-contact-wear"))
    >>> surface = static.surface
    >>> tractions = surface.grid.x_mm, surface.pressure_mpa, surface.shear_mpa
    >>> stress = isochrome.stress_components(0.0, 0.3, *tractions)
    >>> print(f"{stress.sigma_z.item():.1f} MPa")
    -14.6 MPa
    """
    difference, trace = difference_and_trace(x_mm, z_mm, nodes_mm, pressure_mpa, shear_mpa)
    return StressComponents.from_invariants(difference, trace)
