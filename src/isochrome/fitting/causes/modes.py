"""Tractions besides the contact's model, and their stress: what a real contact has of its own.

About the model's pressure p and shear q = mu p the tractions are a Gaussian process,

    dp, dq ~ GP(0, (a p_max)^2 exp(-dx^2 / 2 l^2)),    integral of dp = integral of dq = 0,

over the contact and a third beside it; dp carries its own friction mu dp. Without their integrals
the scene's load and friction stay those of all tractions together. Both are hats on nodes, whose
stress is known in closed form and, on a grid of pixels, a table of the distance alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from isochrome.contact import SurfaceState
from isochrome.fitting.arrays import Array
from isochrome.scene import AddedTractions, Scene
from isochrome.stress import PixelGrid, cauchy_of_hat

SIZES = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Amplitudes a, of the largest pressure: a clean contact's, to one on a grain; but for the last
those of what no cause explains, in fringes or as a share of those there."""
LENGTHS = (0.12, 0.3, 0.8)
"""Lengths l, of half the contact's width."""
_REACH, _NODES = 4.0 / 3.0, 49
"""Nodes lie over so many widths of contact, and are about so many."""
_LEAST = 1e-4
"""Share of the largest variance below which a mode of the process is left out."""


@dataclass(frozen=True)
class TractionModes:
    """Hats of pressure and shear on `nodes_mm` (n,), `spacing_mm` apart, the outermost nought.
    `half_width_mm`, of the contact; `largest_mpa`, its pressure; `friction`, mu.
    """

    nodes_mm: Array
    spacing_mm: float
    half_width_mm: float
    largest_mpa: float
    friction: float

    @cached_property
    def inner(self) -> Array:
        """The nodes that may be loaded (n - 2,)."""
        return self.nodes_mm[1:-1]

    def root(self, length: float) -> Array:
        """L (2 (n - 2), r) of the covariance L L' of the hats, pressure before shear, of size 1."""
        x = (self.inner[:, None] - self.inner[None, :]) / (length * self.half_width_mm)
        kernel = np.exp(-0.5 * x**2)
        sums = kernel.sum(axis=1)
        kernel -= np.outer(sums, sums) / sums.sum()
        values, vectors = np.linalg.eigh(kernel)
        chosen = values > _LEAST * values[-1]
        return np.kron(np.eye(2), self.largest_mpa * vectors[:, chosen] * np.sqrt(values[chosen]))

    def fields(self, grid: PixelGrid) -> Array:
        """(sigma_x - sigma_z) + 2i tau_xz (2 (n - 2), rows, cols) of unit hats at pixels' middles.
        Where the pixels look without a lens: what it moves these by is a change of a change.
        """
        pitch = grid.pixel_mm
        fine = max(1, round(pitch / self.spacing_mm))  # table steps a pixel
        apart = round(self.spacing_mm * fine / pitch)  # table steps a node
        step = pitch / fine
        count = len(self.inner)
        size = fine * (grid.cols - 1) + apart * (count - 1) + 1
        x = grid.x_mm[0] - self.inner[-1] + step * np.arange(size)
        below = grid.z_mm > 0.0
        z = np.where(below, grid.z_mm, pitch)[:, None]
        one, two = cauchy_of_hat(x[None, :], z, self.spacing_mm)
        press = (-2.0 / np.pi * z * two * below[:, None]).astype(np.complex64)
        shear = 1j * press - (2.0 / np.pi * one * below[:, None]).astype(np.complex64)
        both = press + np.complex64(self.friction) * shear, shear
        result = np.empty((2, count, grid.rows, grid.cols), np.complex64)
        for part, table in zip(result, both, strict=True):
            for k, image in enumerate(part):
                first = apart * (count - 1 - k)
                image[:] = table[:, first : first + fine * (grid.cols - 1) + 1 : fine]
        return result.reshape(-1, grid.rows, grid.cols)

    def added(self, values: Array) -> AddedTractions:
        """The scene's key for the hats' values (2 (n - 2),)."""
        pressure, shear = np.pad(values.reshape(2, -1), ((0, 0), (1, 1)))
        return AddedTractions(
            x_mm=tuple(self.nodes_mm.tolist()),
            pressure_mpa=tuple(pressure.tolist()),
            shear_mpa=tuple((shear + self.friction * pressure).tolist()),
        )

    def values_of(self, added: AddedTractions | None) -> Array:
        """The hats' values (2 (n - 2),) of the scene's key."""
        if added is None:
            return np.zeros(2 * len(self.inner))
        pressure, shear = np.array([added.pressure_mpa, added.shear_mpa])[:, 1:-1]
        return np.concatenate((pressure, shear - self.friction * pressure))


def traction_modes(scene: Scene, surface: SurfaceState, pitch_mm: float) -> TractionModes:
    """The hats about a contact: on the nodes that its scene has already, or on new ones.
    `pitch_mm`, of the pixels that their stress is wanted at: a whole number of spacings, or one of
    them, is a whole number of the other.
    """
    left_mm, right_mm = surface.edges_mm
    middle, width = 0.5 * (left_mm + right_mm), right_mm - left_mm
    added = scene.added_tractions
    if added is not None:
        nodes = np.array(added.x_mm)
        spacing = float(nodes[1] - nodes[0])
    else:
        steps = _REACH * width / (_NODES - 1) / pitch_mm
        spacing = pitch_mm * max(1, round(steps)) if steps >= 0.7 else pitch_mm / round(1.0 / steps)
        half = int(np.ceil(0.5 * _REACH * width / spacing))
        nodes = middle + spacing * np.arange(-half, half + 1)
    return TractionModes(
        nodes_mm=nodes,
        spacing_mm=spacing,
        half_width_mm=0.5 * width,
        largest_mpa=surface.p_max_mpa,
        friction=float(scene.friction_at(0.0)),
    )
