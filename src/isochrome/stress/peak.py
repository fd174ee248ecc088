"""The largest shear stress under a window, and where it is, the surface included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.stress.direct import difference_and_trace
from isochrome.stress.hats import Floats
from isochrome.stress.pixels import PixelGrid
from isochrome.stress.rows import convolve_rows, make_band

_GROWTH = 1.2
"""Ratio of neighbouring depths of the scan; at depth z nothing is finer than about z."""
_ACROSS = 17
"""Places each way of the coarse scan that takes in the window's far corners."""
_RIVALS = 6
"""Local maxima of the scan that are climbed before the highest is kept."""
_NEARLY = 0.8
"""Share of the scan's largest value that a rival must have: the scan loses a few per cent."""


@dataclass(frozen=True)
class ShearPeak:
    """The largest shear stress (sigma_1 - sigma_2)/2 in the plane, MPa, and its place, mm."""

    shear_mpa: float
    x_mm: float
    z_mm: float


@dataclass(frozen=True)
class _Box:
    left: float
    right: float
    top: float
    bottom: float


@dataclass(frozen=True)
class _Tractions:
    """Loaded nodes and what acts there; `bulk` besides."""

    nodes: Floats
    pressure: Floats
    shear: Floats
    spacing: float
    bulk: float

    def size(self, x: Floats, z: Floats) -> Floats:
        """|(sigma_x - sigma_z) + 2i tau_xz| at places of one shape, MPa."""
        field, _ = difference_and_trace(x, z, self.nodes, self.pressure, self.shear)
        return np.abs(field + self.bulk)


def largest_shear(
    nodes_mm: Floats,
    pressure_mpa: Floats,
    shear_mpa: Floats | None,
    *,
    within: PixelGrid | tuple[float, float, float, float],
    bulk_mpa: float = 0.0,
) -> ShearPeak:
    """The largest (sigma_1 - sigma_2)/2 in the material under a window, its surface included.

    A scan on graded depths finds the hills, direct sums climb the highest ones, to 1e-7 of their
    width. The peak lies inside the window, or on its edge. At the surface the value is that of the
    traction as the nodes resolve it: where the friction's traction ends steeply, as beside a worn
    edge, sigma_x there grows with the logarithm of the edge's steepness, and so with a finer grid.

    Parameters: `nodes_mm` (n,), uniform; `pressure_mpa`, `shear_mpa` (n,), None for no shear;
    `within`, a PixelGrid or (left, right, top, bottom) in mm, z from the surface; `bulk_mpa`,
    stress along x besides the contact's. Returns a ShearPeak. Raises InputError where the window
    holds no material. Source: see `isochrome.stress.halfplane`.
    """
    box = _material(within)
    shear = np.zeros_like(pressure_mpa) if shear_mpa is None else shear_mpa
    loaded = np.flatnonzero((pressure_mpa != 0.0) | (shear != 0.0))
    if not len(loaded):
        return ShearPeak(0.5 * abs(bulk_mpa), 0.5 * (box.left + box.right), box.top)
    part = slice(loaded[0], loaded[-1] + 1)
    spacing = float(nodes_mm[1] - nodes_mm[0])
    loads = _Tractions(nodes_mm[part], pressure_mpa[part], shear[part], spacing, bulk_mpa)
    x, z, size = _rivals(loads, box)
    step = np.stack([np.maximum(spacing, 0.1 * z), np.maximum(0.5 * spacing, 0.2 * z)])
    x, z, size = _climb(loads, box, x, z, size, step, 0.05)
    best = slice(size.argmax(), size.argmax() + 1)
    x, z, size = _climb(loads, box, x[best], z[best], size[best], 0.05 * step[:, best], 1e-7 / 0.05)
    return ShearPeak(0.5 * float(size[0]), float(x[0]), float(z[0]))


def _material(within: PixelGrid | tuple[float, float, float, float]) -> _Box:
    """The part of a window that is in the material."""
    if isinstance(within, PixelGrid):
        wide, high = within.cols * within.pixel_mm, within.rows * within.pixel_mm
        left, top = within.left_mm, within.top_mm
        within = left, left + wide, top, top + high
    left, right, top, bottom = within
    if not (left <= right and max(top, 0.0) <= bottom):
        raise InputError(
            f"the window from x = {left:g} to {right:g} mm and z = {top:g} to {bottom:g} mm holds "
            "no material, which begins at z = 0; move the window"
        )
    return _Box(left, right, max(top, 0.0), bottom)


def _rivals(loads: _Tractions, box: _Box) -> tuple[Floats, Floats, Floats]:
    """Places and sizes of the scan's highest local maxima."""
    x: Floats = np.linspace(box.left, box.right, _ACROSS)[None, :]
    z: Floats = np.linspace(box.top, box.bottom, _ACROSS)[:, None]
    scans: list[tuple[Floats, Floats, Floats]] = [(x, z, loads.size(x, z))]
    reach = loads.nodes[-1] - loads.nodes[0] + 10.0 * loads.spacing
    ends = np.array(
        [max(box.left, loads.nodes[0] - reach), min(box.right, loads.nodes[-1] + reach)]
    )
    first = np.ceil((ends[0] - loads.nodes[0]) / loads.spacing)
    last = np.floor((ends[1] - loads.nodes[0]) / loads.spacing)
    if first <= last:
        x = loads.nodes[0] + loads.spacing * np.arange(first, last + 1)
        z = _depths(box, loads.spacing)
        scans.append((x[None, :], z[:, None], _scan(loads, x, z)))
    highest = max(size.max() for _, _, size in scans)
    found = []
    for x, z, size in scans:
        peaks = _is_local_maximum(size) & (size >= _NEARLY * highest)
        middle = np.broadcast_to(x > 0.5 * (loads.nodes[0] + loads.nodes[-1]), size.shape)
        # the best of each row and side: noise on a plateau must not crowd out another hill
        for side in (peaks & middle, peaks & ~middle):
            col = np.where(side, size, -1.0).argmax(axis=1)
            rows = np.flatnonzero(side.any(axis=1))
            found += [(float(size[r, col[r]]), float(x[0, col[r]]), float(z[r, 0])) for r in rows]
    best = np.array(sorted(found, reverse=True)[:_RIVALS])
    x, z = best[:, 1], best[:, 2]
    return x, z, loads.size(x, z)


def _depths(box: _Box, spacing: float) -> Floats:
    """Depths of the scan: from the surface by half spacings, then growing with depth."""
    count = max(0, int(np.ceil(np.log(max(box.bottom / spacing, 1.0)) / np.log(_GROWTH))))
    graded = spacing * np.r_[0.0, 0.5, _GROWTH ** np.arange(count + 1)]
    inside = graded[(graded > box.top) & (graded < box.bottom)]
    return np.unique(np.r_[box.top, inside, box.bottom])


def _scan(loads: _Tractions, x: Floats, z: Floats) -> Floats:
    """Size of the stress difference at columns on the nodes' lattice and at any depths."""
    band = make_band(
        slice(0, len(z)),
        z,
        len(x),
        first_mm=float(x[0] - loads.nodes[0]),
        spacing_mm=loads.spacing,
        nodes=len(loads.nodes),
        fold=1,
        deep=False,
        dtype=np.dtype(np.complex64),
    )
    field = np.empty((len(z), len(x)), np.complex64)
    both = loads.pressure + 1j * loads.shear
    convolve_rows(band, [(band.slope, both), (band.cauchy, loads.shear)], field)
    return np.abs(field + np.float32(loads.bulk))


def _is_local_maximum(size: Floats) -> NDArray[np.bool_]:
    """Where no neighbour of the eight is larger."""
    padded = np.pad(size, 1, constant_values=-1.0)
    rows, cols = size.shape
    return np.logical_and.reduce(
        [size >= padded[i : i + rows, j : j + cols] for i in range(3) for j in range(3)]
    )


def _climb(
    loads: _Tractions,
    box: _Box,
    x: Floats,
    z: Floats,
    size: Floats,
    step: Floats,
    share: float,
) -> tuple[Floats, Floats, Floats]:
    """Move each place to its best neighbour of eight, or halve its step, down to a share of it.

    No slopes: at the surface the field has cusps at the nodes. Source: pattern search, Hooke &
    Jeeves (1961), Journal of the ACM 8.
    """
    dx, dz = (d.ravel()[:, None] for d in np.meshgrid([0, -1, 1], [0, -1, 1]))
    scale = np.ones_like(x)
    while (moving := np.flatnonzero(scale > share)).size:
        near_x = np.clip(x[moving] + dx * scale[moving] * step[0, moving], box.left, box.right)
        near_z = np.clip(z[moving] + dz * scale[moving] * step[1, moving], box.top, box.bottom)
        sizes = loads.size(near_x, near_z)
        best = sizes.argmax(axis=0), np.arange(moving.size)
        stays = ~(sizes[best] > size[moving] * (1.0 + 1e-15))
        scale[moving[stays]] *= 0.5
        goes, best = moving[~stays], (best[0][~stays], best[1][~stays])
        x[goes], z[goes], size[goes] = near_x[best], near_z[best], sizes[best]
    return x, z, size
