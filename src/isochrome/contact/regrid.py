"""A scar on the contact's uniform grid: what its mesh holds, carried over without loss of load."""

from __future__ import annotations

import numpy as np

from isochrome.contact.mesh import angle_of, angles, crowding
from isochrome.contact.scar import Scar
from isochrome.contact.surface import Floats


def scar_on_nodes(scar: Scar, x_mm: Floats) -> tuple[Floats, Floats]:
    r"""Pressure and depth of a scar at uniform nodes.

    Equation: p_i = (1/h) ∫ p(t) hat((t - x_i)/h) dt, the mean over a hat, which keeps the load and
    its moment whatever the place of the edges between the nodes. It is the difference of the mean
    loads behind, F, in the elements to the right and left of the node, over h, and each mean is by
    Simpson's rule. Second order in h.
    Parameters: `scar`; `x_mm` (n,), uniform. Returns p (n,), MPa, and h (n,), mm.
    """
    from scipy.interpolate import CubicSpline

    spacing = float(x_mm[1] - x_mm[0])
    middle, half = 0.5 * (scar.x_mm[0] + scar.x_mm[-1]), 0.5 * (scar.x_mm[-1] - scar.x_mm[0])
    phi = angles(len(scar.x_mm) - 1)
    halves = x_mm[0] + 0.5 * spacing * np.arange(-2, 2 * len(x_mm) + 1)
    at = angle_of((middle - halves) / half)
    # load per φ and depth are even in φ about the edges and zero there: their slopes vanish
    load = CubicSpline(phi, scar.pressure_mpa * crowding(phi), bc_type="clamped")
    behind = load.antiderivative()(at)
    mean = (behind[:-2:2] + 4.0 * behind[1:-1:2] + behind[2::2]) / 6.0
    depth = CubicSpline(phi, scar.depth_mm, bc_type="clamped")(at[2:-2:2])
    distance = np.abs(x_mm - middle) - half
    pressure = np.where(distance < spacing, np.diff(mean), 0.0)
    pressure *= scar.stop.line_load_n_per_mm / (spacing * pressure.sum())
    return np.maximum(pressure, 0.0), np.where(distance < 0.0, np.maximum(depth, 0.0), 0.0)
