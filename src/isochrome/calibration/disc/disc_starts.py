"""Starts for a disc's fit: rim, then a scan of centre order, radius and load direction.

One image's scan has many minima. Several loads tell them apart: their centre orders lie on one
line, N = k P + N0, and the line with the least sum of relative misfits picks every image's start.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import ORDERS, scan_orders
from isochrome.calibration.disc.disc_rim import Circle, find_rim
from isochrome.calibration.order_line import check_order
from isochrome.calibration.shot import Shot

Array = NDArray[np.float64]

RADII = (0.985, 1.015, 1.05)
ANGLES_DEG = (-7.5, -5.0, -2.5, 0.0, 2.5, 5.0, 7.5)
LARGEST_RESIDUAL = 2.0
"""Order at zero load beyond which a line through the loads is not believed."""

MOST_AT_REST = 0.5
"""Largest part of the highest load's order that may be there at zero load."""

CLEAR = 0.5
"""Part of the misfit without fringes that an image's own order leaves at the most."""

SLOPE_SLACK = 0.05
"""How far a line's slope may be from the rise that the pixels show."""


@dataclass(frozen=True)
class Scan:
    """One image's scan: the rim, its `geometries` (g, 4), `chi` (g, orders) and `smooth_chi`."""

    circle: Circle
    geometries: Array
    chi: Array
    smooth_chi: float

    @property
    def curve(self) -> Array:
        """The least chi of each centre order in ORDERS."""
        return np.asarray(self.chi.min(axis=0))

    def starts(self, order: float, *, reach: float = 0.35, count: int = 4) -> Array:
        """The best `count` starts (count, 5) with a centre order within `reach` of `order`."""
        near = np.flatnonzero(np.abs(ORDERS - order) <= reach)
        flat = self.chi[:, near]
        best = np.argsort(flat, axis=None, kind="stable")[:count]
        places, columns = np.unravel_index(best, flat.shape)
        return np.column_stack([ORDERS[near[columns]], self.geometries[places]])


def scan_disc(shot: Shot) -> Scan:
    """Find a disc's rim and scan its centre order; raises PhysicsError where no disc is seen."""
    circle = find_rim(shot)
    geometries = np.array(
        [
            [circle.row, circle.col, circle.radius * factor, np.radians(angle)]
            for factor in RADII
            for angle in ANGLES_DEG
        ]
    )
    return Scan(circle, geometries, *scan_orders(shot, geometries))


def choose_centre_orders(
    scans: Sequence[Scan], loads_n: Sequence[float], *, rise_per_n: float | None = None
) -> Array:
    """Each image's starting order, from its own scan or from the line that suits all loads.

    Parameters: `scans` (n,), `loads_n` (n,); `rise_per_n`, the line's slope where it is known
    (fringe/N, to 5 %), see `rise_with_load`. Returns the orders (n,).
    """
    loads = np.asarray(loads_n, dtype=float)
    costs = np.stack([_relative(s) for s in scans])
    if np.unique(loads).size < 2:
        result: Array = ORDERS[np.argmin(costs, axis=1)]
        return result
    low, high = float(loads.min()), float(loads.max())
    first, last = np.meshgrid(ORDERS, ORDERS, indexing="ij")
    slope = (last - first) / (high - low)
    rest = first - slope * low
    limit = np.minimum(LARGEST_RESIDUAL, MOST_AT_REST * last)
    total = np.where((slope > 0) & (np.abs(rest) <= limit), 0.0, np.inf)
    if rise_per_n is not None:
        total[np.abs(slope / rise_per_n - 1.0) > SLOPE_SLACK] = np.inf
    for cost, load in zip(costs, loads, strict=True):
        total += np.interp(first + slope * (load - low), ORDERS, cost)
    i, j = np.unravel_index(int(np.argmin(total)), total.shape)
    line = ORDERS[i] + slope[i, j] * (loads - low)
    return np.asarray(line)


def check_scans(scans: Sequence[Scan], shots: Sequence[Shot]) -> None:
    """Refuse loads that contradict the orders which the images show each by itself.

    Parameters: `scans` and `shots` (n,). Raises PhysicsError as `line.check_order`; says nothing
    where an image's own order is not clear.
    """
    if all(np.min(s.curve) < CLEAR * s.smooth_chi for s in scans):
        orders = [ORDERS[int(np.argmin(s.curve))] for s in scans]
        check_order([s.load_n for s in shots], orders, tuple(s.name for s in shots))


def _relative(scan: Scan) -> Array:
    """ln chi above its minimum; a wrong contrast counts as no fringes at all."""
    filled = np.minimum(scan.curve, scan.smooth_chi)
    result: Array = np.log(filled / filled.min())
    return result
