"""What a stress field is, and a field made on a plain grid at the places that pixels look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from isochrome.stress.pixels import PixelGrid

Floats = NDArray[np.floating]
StressDifference = NDArray[np.complexfloating]
"""(sigma_x - sigma_z) + 2i tau_xz (rows, cols), MPa. Its modulus is sigma_1 - sigma_2."""


@dataclass(frozen=True)
class StressComponents:
    """Plane stress components on a pixel grid, MPa, tension positive.

    Parameters
    ----------
    sigma_x : ndarray (rows, cols)
        Normal stress along the surface (MPa).
    sigma_z : ndarray (rows, cols)
        Normal stress across it (MPa).
    tau_xz : ndarray (rows, cols)
        Shear stress (MPa).
    """

    sigma_x: Floats
    sigma_z: Floats
    tau_xz: Floats

    @property
    def difference(self) -> StressDifference:
        """(sigma_x - sigma_z) + 2i tau_xz."""
        return (self.sigma_x - self.sigma_z) + 2j * self.tau_xz

    @property
    def principal(self) -> tuple[Floats, Floats]:
        """Principal stresses sigma_1 >= sigma_2 in the plane (MPa)."""
        mean, radius = 0.5 * (self.sigma_x + self.sigma_z), 0.5 * np.abs(self.difference)
        return mean + radius, mean - radius

    @property
    def largest_shear(self) -> Floats:
        """Largest shear stress in the plane, (sigma_1 - sigma_2)/2 (MPa)."""
        return np.asarray(0.5 * np.abs(self.difference))

    @classmethod
    def from_invariants(cls, difference: StressDifference, trace: Floats) -> StressComponents:
        """Components from (sigma_x - sigma_z) + 2i tau_xz and sigma_x + sigma_z, of one shape."""
        real = difference.real
        return cls(0.5 * (trace + real), 0.5 * (trace - real), 0.5 * difference.imag)


def principal_direction(difference: StressDifference) -> Floats:
    """Direction θ of sigma_1, rad in (-π/2, π/2], counter-clockwise from +x as the camera sees it.

    Equation: tan 2φ = 2 tau_xz / (sigma_x - sigma_z) from x towards z; since z points down in the
    image, θ = -φ. Source: Timoshenko & Goodier (1970), section 9.
    """
    return np.asarray(-0.5 * np.angle(difference), dtype=float)


N = TypeVar("N", bound=np.inexact)

_ABOVE = 6
"""Rows above the surface that a field is continued over: a spline feels no more of them."""


def seen_by(field: NDArray[N], grid: PixelGrid, pixels: PixelGrid) -> NDArray[N]:
    """Interpolate a field (rows, cols) where pixels look, by cubic splines; 0 above the surface.

    A jump at the surface would ring in the spline: the field goes on as f(-z) = 2 f(0) - f(z), with
    its value and slope. The grid's rows lie half a pixel below the surface and at whole pixels from
    there, see `PixelGrid.around`. Without a lens the field is returned as it is.
    """
    from scipy.ndimage import map_coordinates

    if pixels.lens is None:
        return field
    x, z = pixels.places
    places = [(v - v0) / grid.pixel_mm - 0.5 for v, v0 in ((z, grid.top_mm), (x, grid.left_mm))]
    first = round(-grid.top_mm / grid.pixel_mm)
    if 0 < first < len(field):
        field = field.copy()
        near = field[first : first + min(_ABOVE, first, len(field) - first)]
        surface = 1.5 * near[0] - 0.5 * near[min(1, len(near) - 1)]
        field[first - len(near) : first] = (2.0 * surface - near)[::-1]
    sampled = map_coordinates(field, np.broadcast_arrays(*places), order=3, mode="nearest")
    return np.where(z >= 0.0, sampled, 0).astype(field.dtype)
