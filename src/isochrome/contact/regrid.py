"""A scar on the contact's uniform grid: what its mesh holds, carried over without loss of load."""

from __future__ import annotations

import numpy as np

from isochrome.contact.scar import Scar
from isochrome.contact.surface import Floats

_STEEPEST = 2.0
"""Largest exponent of θ at an edge; a root of the distance is 1."""


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
    theta = np.linspace(0.0, np.pi, len(scar.x_mm))
    halves = x_mm[0] + 0.5 * spacing * np.arange(-2, 2 * len(x_mm) + 1)
    at = np.arccos(np.clip((middle - halves) / half, -1.0, 1.0))
    behind = _load_behind(theta, scar.pressure_mpa, at)
    mean = (behind[:-2:2] + 4.0 * behind[1:-1:2] + behind[2::2]) / 6.0
    # the depth is even in θ about the edges, so that its slope vanishes there
    depth = CubicSpline(theta, scar.depth_mm, bc_type="clamped")(at[2:-2:2])
    distance = np.abs(x_mm - middle) - half
    pressure = np.where(distance < spacing, np.diff(mean), 0.0)
    pressure *= scar.stop.line_load_n_per_mm / (spacing * pressure.sum())
    return np.maximum(pressure, 0.0), np.where(distance < 0.0, np.maximum(depth, 0.0), 0.0)


def _load_behind(theta: Floats, pressure: Floats, at: Floats) -> Floats:
    """∫_0^θ p sin θ dθ at any θ: a power of θ up to the first node, a spline of p sin θ beyond.

    Local, so that a steep edge does not show elsewhere, as in the mesh's own series it would; and
    with p ~ θ^g there, g from the first two nodes, as a worn edge has it: 1 at first, 0 in the end.
    """
    from scipy.interpolate import CubicSpline

    first, inner = theta[1], slice(1, -1)
    flow = (pressure * np.sin(theta))[inner]
    left, right = _exponent(pressure), _exponent(pressure[::-1])
    slopes = (1.0 + left) * flow[0] / first, -(1.0 + right) * flow[-1] / first
    spline = CubicSpline(theta[inner], flow, bc_type=((1, slopes[0]), (1, slopes[1])))
    middle = spline.antiderivative()
    before = flow[0] * first / (2.0 + left)
    after = flow[-1] * first / (2.0 + right)
    total = before + float(middle(theta[-2])) + after
    behind = before + middle(np.clip(at, first, theta[-2]))
    behind = np.where(at < first, before * (at / first) ** (2.0 + left), behind)
    beyond = np.maximum(theta[-1] - at, 0.0) / first
    return np.where(at > theta[-2], total - after * beyond ** (2.0 + right), behind)


def _exponent(pressure: Floats) -> float:
    """g of p ~ θ^g at an edge, from the nodes at one and two steps from it."""
    return float(np.clip(np.log2(pressure[2] / pressure[1]), 0.0, _STEEPEST))
