"""Where the hills of the stress difference stand: a scan whose rows get sparser with depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from isochrome.stress.half_plane.direct import difference_and_trace
from isochrome.stress.half_plane.hats import Floats
from isochrome.stress.half_plane.regular import RegularStress
from isochrome.stress.half_plane.rows import convolve_rows, make_band

_GROWTH = 1.2
"""Ratio of neighbouring depths of the scan; at depth z nothing is finer than about z."""
_ACROSS = 17
"""Places each way of the coarse scan that takes in the window's far corners."""
_RIVALS, _PARTS = 6, 24
"""Local maxima by depth, and by part of the load, that are climbed before the highest is kept."""
_NEARLY = 0.8
"""Share of the scan's largest value that a rival must have: the scan loses a few per cent."""


class Box(NamedTuple):
    """A part of the material, its outer edges in mm; z from the surface."""

    left: float
    right: float
    top: float
    bottom: float


@dataclass(frozen=True)
class Loads:
    """Loaded nodes and what acts there; a `regular` stress besides."""

    nodes: Floats
    pressure: Floats
    shear: Floats
    spacing: float
    regular: RegularStress

    def size(self, x: Floats, z: Floats) -> Floats:
        """|(sigma_x - sigma_z) + 2i tau_xz| at places of one shape, MPa."""
        field, _ = difference_and_trace(x, z, self.nodes, self.pressure, self.shear)
        return np.abs(field + self.regular.difference(x, z))


def find_hills(loads: Loads, box: Box) -> tuple[Floats, Floats, Floats]:
    """Places and sizes of the scans' highest local maxima: by depth, and by part of the load.

    By both, so that neither the noise on a plateau nor the many cusps of a rough traction at the
    surface crowd out another hill. Parameters: `loads`; `box`, where to look. Returns x, z (mm)
    and the size of the stress difference (MPa), three arrays of some ten.
    """
    scans = _scans(loads, box)
    highest = max(size.max() for _, _, size in scans)
    found = []
    for x, z, size in scans:
        row, col = np.nonzero(_is_local_maximum(size) & (size >= _NEARLY * highest))
        found.append(np.stack([size[row, col], x[col], z[row]]))
    size, x, z = np.concatenate(found, axis=1)
    parts = np.floor(_PARTS * (x - loads.nodes[0]) / np.ptp(loads.nodes))
    kept = np.union1d(_best_of_each(z, size)[:_RIVALS], _best_of_each(parts, size)[:_RIVALS])
    return x[kept], z[kept], loads.size(x[kept], z[kept])


def _best_of_each(label: Floats, size: Floats) -> NDArray[np.intp]:
    """Indices of the largest size of each label, the largest first."""
    order = np.argsort(-size)
    _, first = np.unique(label[order], return_index=True)
    return np.asarray(order[np.sort(first)])


def _scans(loads: Loads, box: Box) -> list[tuple[Floats, Floats, Floats]]:
    """Columns, depths and sizes of a coarse scan of all the window and of fine ones at the load.

    The fine ones reach a load's length beyond the load: a column at each node on graded depths,
    and four to a spacing near the surface, where hills lie between the cusps at the nodes.
    """
    x: Floats = np.linspace(box.left, box.right, _ACROSS)
    z: Floats = np.linspace(box.top, box.bottom, _ACROSS)
    scans = [(x, z, loads.size(x[None, :], z[:, None]))]
    h, start, end = loads.spacing, loads.nodes[0], loads.nodes[-1]
    left, right = max(box.left, start + start - end), min(box.right, end + end - start)
    count = int(np.ceil(np.log(max(box.bottom / h, 1.0)) / np.log(_GROWTH)))
    for step, depths in (
        (1.0, h * _GROWTH ** np.arange(count + 1)),
        (0.25, 0.25 * h * np.arange(9)),
    ):
        x = start + h * step * np.arange(
            np.ceil((left - start) / h / step), np.floor((right - start) / h / step) + 1
        )
        inside = depths[(depths > box.top) & (depths < box.bottom)]
        z = np.unique(np.r_[box.top, inside, box.bottom])
        if x.size:
            scans.append((x, z, _scan(loads, x, z, round(1.0 / step))))
    return scans


def _scan(loads: Loads, x: Floats, z: Floats, split: int) -> Floats:
    """Size of the stress difference at any depths, at columns `split` to a spacing."""
    size = np.empty((len(z), len(x)))
    both = loads.pressure + 1j * loads.shear
    for start in range(min(split, len(x))):
        cols = x[start::split]
        band = make_band(
            slice(0, len(z)),
            z,
            len(cols),
            first_mm=float(cols[0] - loads.nodes[0]),
            spacing_mm=loads.spacing,
            nodes=len(loads.nodes),
            fold=1,
            deep=False,
            dtype=np.dtype(np.complex64),
        )
        field = np.empty((len(z), len(cols)), np.complex64)
        convolve_rows(band, [(band.slope, both), (band.cauchy, loads.shear)], field)
        field += loads.regular.difference(cols[None, :], z[:, None]).astype(np.complex64)
        size[:, start::split] = np.abs(field)
    return size


def _is_local_maximum(size: Floats) -> NDArray[np.bool_]:
    """Where no neighbour of the eight is larger."""
    padded = np.pad(size, 1, constant_values=-1.0)
    rows, cols = size.shape
    result: NDArray[np.bool_] = np.logical_and.reduce(
        [size >= padded[i : i + rows, j : j + cols] for i in range(3) for j in range(3)]
    )
    return result
