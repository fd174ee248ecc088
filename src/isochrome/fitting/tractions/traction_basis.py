r"""The stress difference at a frame's bins as a linear map of surface tractions.

Tractions are piecewise linear between nodes, hats whose integrals are known in closed form; what
the rest of the body adds is a regular stress of low degree. Inside Coulomb's cone |q| <= m p the
two tractions of a node are sums of two that cannot be negative,

    p = a + b,    q = m (a - b),    a >= 0,  b >= 0,

so that no pressure pulls, and no shear acts where nothing presses. With the field linear in
c = (a, b, regular modes), the whole inversion is a least-squares problem with signs.
Source: the fields are those of `stress.half_plane`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import gcd

import numpy as np
from numpy.typing import NDArray

from isochrome.fitting.arrays import Array
from isochrome.fitting.tractions.binned_pixels import Bins
from isochrome.stress import PixelGrid, RegularStress, cauchy_of_hat, regular_modes

COARSEST = 32
"""Spacing of the coarsest nodes, in units of `picture_unit`: a power of two."""


FRICTION_LIMIT = 1.0
"""Largest |q|/p that is thought of: dry contacts of solids stay well below."""

DEGREE = 2
"""Degree of the regular stress: uniform, its slopes, and the next terms of far sides."""


@dataclass(frozen=True)
class Basis:
    """Fields of unit unknowns: `columns` (bins, 2 nodes + modes), complex64.

    `nodes_px` (n,), places in pixels from the picture's left edge, multiples of `spacing_px`;
    `limit`, m; `modes`, the regular stresses, each about 1 MPa at the picture's rim.
    """

    columns: Array
    nodes_px: NDArray[np.int64]
    spacing_px: int
    limit: float
    modes: tuple[RegularStress, ...]

    @property
    def signed(self) -> int:
        """How many unknowns, the first ones, cannot be negative."""
        return 2 * self.nodes

    @property
    def nodes(self) -> int:
        """Count of nodes n."""
        return len(self.nodes_px)

    def tractions(self, unknowns: Array) -> tuple[Array, Array]:
        """Pressure and shear (n,) of the unknowns (2 n + modes,), MPa."""
        a, b = unknowns[: self.nodes], unknowns[self.nodes : 2 * self.nodes]
        return a + b, self.limit * (a - b)

    @property
    def to_tractions(self) -> Array:
        """The matrix (2 n, unknowns) from the unknowns to pressure above shear."""
        one, m = np.eye(self.nodes), self.limit
        rest = self.columns.shape[1] - self.signed
        return np.pad(np.block([[one, one], [m * one, -m * one]]), ((0, 0), (0, rest)))

    def unknowns(self, pressure: Array, shear: Array, modes: Array) -> Array:
        """The unknowns of tractions (n,), brought into the cone, and of mode amplitudes."""
        inside = np.clip(shear / self.limit, -np.abs(pressure), np.abs(pressure))
        halves = np.r_[0.5 * (pressure + inside), 0.5 * (pressure - inside)]
        result: Array = np.r_[np.maximum(0.0, halves), modes]
        return result

    def regular(self, unknowns: Array) -> RegularStress:
        """The regular stress of the unknowns."""
        total = RegularStress()
        for k, mode in enumerate(self.modes):
            total = total + mode.times(float(unknowns[2 * self.nodes + k]))
        return total

    def on_lattice(self, unknowns: Array, pixels: PixelGrid) -> tuple[Array, Array]:
        """Pressure and shear of the unknowns at the nodes of `lattice_px`, MPa."""
        places = lattice_px(pixels)
        whole = places[:: self.spacing_px]
        at = (self.nodes_px - places[0]) // self.spacing_px
        result = []
        for traction in self.tractions(unknowns):
            values = np.zeros(len(whole))
            values[at] = traction
            result.append(np.interp(places, whole, values))
        return result[0], result[1]

    def with_top(self, lower: Basis, unknowns: Array) -> Basis:
        """The basis with one unknown more: by how much of a step the surface lies higher.

        Parameters: `lower`, the basis where all bins lie one step deeper; `unknowns`, those whose
        field is moved. Returns a Basis whose last column is that field's change over the step.
        """
        c = unknowns.astype(np.complex64)
        change = (lower.columns @ c - self.columns @ c)[:, None]
        return replace(self, columns=np.concatenate([self.columns, change], axis=1))


def picture_unit(pixels: PixelGrid) -> int:
    """Pixels that stand for one of a picture 659 wide: steps along the surface scale by it."""
    return max(1, round(pixels.cols / 659.0))


def scaled_modes(pixels: PixelGrid, degree: int) -> tuple[RegularStress, ...]:
    """Regular stresses up to a degree, each about 1 MPa at the picture's rim."""
    length = 0.5 * pixels.pixel_mm * max(pixels.rows, pixels.cols)
    return tuple(mode.times(length ** -(len(mode.series) - 1.0)) for mode in regular_modes(degree))


def lattice_px(pixels: PixelGrid) -> NDArray[np.int64]:
    """Nodes a pixel apart, in pixels from the picture's left edge, beyond the widest hats' ends."""
    unit = picture_unit(pixels)
    widest = COARSEST * unit
    return np.arange(-widest, (-(-pixels.cols // widest) + 1) * widest + 1)


def make_basis(
    bins: Bins,
    pixels: PixelGrid,
    nodes_px: Array,
    spacing_px: int,
    *,
    limit: float = FRICTION_LIMIT,
    degree: int = DEGREE,
) -> Basis:
    """Fields of every node's pressure and shear, and of the regular modes, at the bins.

    Parameters: `bins`; `pixels`, the picture's place; `nodes_px` (n,), multiples of `spacing_px`;
    `limit` m of |q| <= m p; `degree` of the regular stress. Returns a Basis.
    """
    n = len(nodes_px)
    modes = scaled_modes(pixels, degree)
    columns = np.empty((len(bins.light), 2 * n + len(modes)), np.complex64)
    for side, part in bins.sides():
        press, shear = _hat_fields(bins, side, part, pixels, nodes_px, spacing_px)
        columns[part, :n] = press + limit * shear
        columns[part, n : 2 * n] = press - limit * shear
    x = pixels.left_mm + pixels.pixel_mm * (bins.col + 0.5)
    z = pixels.top_mm + pixels.pixel_mm * (bins.row + 0.5)
    for k, mode in enumerate(modes):
        columns[:, 2 * n + k] = mode.difference(x, z)
    return Basis(columns, np.asarray(nodes_px), spacing_px, limit, modes)


def _hat_fields(
    bins: Bins, side: int, part: slice, pixels: PixelGrid, nodes_px: Array, spacing_px: int
) -> tuple[Array, Array]:
    """Stress difference of unit hats of pressure and of shear at bins of one side (bins, n).

    It depends on the depth and on the distance along the surface alone, and these take few values:
    a table of them is looked up.
    """
    pixel = pixels.pixel_mm
    depth, row = np.unique(bins.row[part], return_inverse=True)
    z = (pixels.top_mm + pixel * (depth + 0.5))[:, None]
    common = gcd(side, spacing_px)
    centre = np.rint((bins.col[part] + 0.5 - 0.5 * side) / common).astype(np.int32)
    steps = centre[:, None] - (np.asarray(nodes_px) // common).astype(np.int32)
    first, last = int(steps.min()), int(steps.max())
    x = pixel * (common * np.arange(first, last + 1) + 0.5 * side)
    one, two = cauchy_of_hat(x[None, :], z, spacing_px * pixel)
    press = -2.0 / np.pi * z * two
    shear = 1j * press - 2.0 / np.pi * one
    where = row[:, None].astype(np.int32) * len(x) + (steps - first)
    return press.astype(np.complex64).ravel()[where], shear.astype(np.complex64).ravel()[where]
