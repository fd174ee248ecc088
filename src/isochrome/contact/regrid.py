"""A scar on the contact's uniform grid: what its mesh holds, carried over without loss of load."""

from __future__ import annotations

import numpy as np

from isochrome.contact.scar import Scar
from isochrome.contact.surface import Floats


def scar_on_nodes(scar: Scar, x_mm: Floats) -> tuple[Floats, Floats]:
    r"""Pressure and depth of a scar at uniform nodes.

    Equation: p_i = (1/h) ∫ p(t) hat((t - x_i)/h) dt, the mean over a hat, which keeps the load and
    its moment whatever the place of the edges between the nodes. It is the difference of the mean
    loads ahead, F, in the elements to the left and right of the node, over h, and each mean is by
    Simpson's rule. Second order in h.
    Parameters: `scar`; `x_mm` (n,), uniform. Returns p (n,), MPa, and h (n,), mm.
    """
    from scipy.interpolate import CubicSpline

    spacing = float(x_mm[1] - x_mm[0])
    middle, half = 0.5 * (scar.x_mm[0] + scar.x_mm[-1]), 0.5 * (scar.x_mm[-1] - scar.x_mm[0])
    theta = np.linspace(0.0, np.pi, len(scar.x_mm))
    halves = x_mm[0] + 0.5 * spacing * np.arange(-2, 2 * len(x_mm) + 1)
    at = np.arccos(np.clip((middle - halves) / half, -1.0, 1.0))
    # both are even in θ about the edges, so that their slopes vanish there
    ahead = CubicSpline(theta, scar.ahead_n_per_mm, bc_type="clamped")(at)
    mean = (ahead[:-2:2] + 4.0 * ahead[1:-1:2] + ahead[2::2]) / 6.0
    depth = CubicSpline(theta, scar.depth_mm, bc_type="clamped")(at[2:-2:2])
    distance = np.abs(x_mm - middle) - half
    pressure = np.where(distance < spacing, -np.diff(mean) / spacing, 0.0)
    return np.maximum(pressure, 0.0), np.where(distance < 0.0, np.maximum(depth, 0.0), 0.0)
