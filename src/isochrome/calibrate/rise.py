"""The rise of the order with load, pixel by pixel, whatever stress the disc already holds.

With an arbitrary residual order n(x) along the same principal directions, a pixel sees
I = c + a cos(2 pi k h P) + b sin(2 pi k h P) over the loads P: h(x) is the disc's known field over
its centre value, k the centre's fringes per N, and a, b, c (with n in them) are free at every
pixel. The k that explains most of the variation, pooled over the disc, needs no start, no
illumination and no knowledge of n. (A Lomb-Scargle periodogram; Lomb, Astrophys. Space Sci. 39,
1976, 447-462.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.calibrate.disc_field import ORDERS
from isochrome.calibrate.rim import Circle
from isochrome.calibrate.shot import Shot

Array = NDArray[np.float64]

FEWEST_LOADS = 5
"""Three numbers a pixel are free: fewer loads leave nothing to judge k by."""

ANGLES_DEG = (-6.0, -3.0, 0.0, 3.0, 6.0)
SIDE = 90
WITHIN, ALONG = 0.8, 0.6
"""Radii about the centre, and along the loads, that are used."""


@dataclass(frozen=True)
class Overlay:
    """All images on the unit disc: `stack` (n, m, m), `z` and `x` (m, m) in radii, `loads` (n,)."""

    stack: Array
    z: Array
    x: Array
    loads: Array

    @property
    def used(self) -> NDArray[np.bool_]:
        """Pixels (m, m) away from the rim and from the loads."""
        return (self.x**2 + self.z**2 < WITHIN**2) & (np.abs(self.z) < ALONG)

    def field(self, angle: float, scale: float = 1.0, z: float = 0.0, x: float = 0.0) -> Array:
        """Order over centre order (m, m) for loads at `angle` (rad), on a disc that is `scale`
        times the rim as found and lies `z`, `x` radii from it.
        """
        z_here, x_here = (self.z - z) / scale, (self.x - x) / scale
        along = z_here * np.cos(angle) + x_here * np.sin(angle)
        square = x_here**2 + z_here**2
        below = np.maximum((1.0 + square) ** 2 - 4.0 * along**2, 1e-6)
        return np.asarray((1.0 - square) / below)


@dataclass(frozen=True)
class Rise:
    """`slope` k (fringe/N) for loads at `angle` (rad): its share of the variation `explained`,
    and the best share of any other slope, `runner_up`.
    """

    slope: float
    angle: float
    explained: float
    runner_up: float

    @property
    def clear(self) -> bool:
        """Whether the slope explains most of the variation, and clearly more than any other."""
        return self.explained > 0.5 and self.explained > 1.25 * self.runner_up


def overlay(shots: Sequence[Shot], circles: Sequence[Circle]) -> Overlay:
    """Lay the images over each other on their rims; `shots` (n,), `circles` (n,)."""
    unit = np.linspace(-WITHIN, WITHIN, SIDE)
    z, x = np.meshgrid(unit, unit, indexing="ij")
    stack = np.stack([_on_unit_disc(s, c, z, x) for s, c in zip(shots, circles, strict=True)])
    return Overlay(stack, z, x, np.array([s.load_n for s in shots]))


def rise_with_load(images: Overlay) -> Rise | None:
    """Find the centre order's rise with load; None below five different loads."""
    loads = images.loads
    if np.unique(loads).size < FEWEST_LOADS:
        return None
    slopes = np.arange(ORDERS[0], ORDERS[-1], 0.04) / loads.max()
    angles = np.radians(ANGLES_DEG)
    shares = np.stack([_shares(images, angle, slopes) for angle in angles])
    i, best = np.unravel_index(int(np.argmax(shares)), shares.shape)
    far = np.abs(slopes - slopes[best]) * np.ptp(loads) > 1.0
    runner = float(shares[:, far].max()) if far.any() else 0.0
    return Rise(float(slopes[best]), float(angles[i]), float(shares[i, best]), runner)


def _on_unit_disc(shot: Shot, circle: Circle, z: Array, x: Array) -> Array:
    from scipy.ndimage import gaussian_filter, map_coordinates

    smooth = gaussian_filter(shot.image, max(1.0, circle.radius / 200.0))
    places = [circle.row + z * circle.radius, circle.col + x * circle.radius]
    return np.asarray(map_coordinates(smooth, places, order=1, mode="nearest"))


def _shares(images: Overlay, angle: float, slopes: Array) -> Array:
    """Share of the variation over the loads that each slope explains, pooled over the pixels."""
    field, used = images.field(angle), images.used
    data = images.stack[:, used]
    total = float(np.sum((data - data.mean(axis=0)) ** 2))
    left = [
        float(np.sum(pixel_waves(data, slope * images.loads, field[used])[0] ** 2))
        for slope in slopes
    ]
    return 1.0 - np.array(left) / total


def pixel_waves(data: Array, orders: Array, field: Array) -> tuple[Array, Array]:
    """Fit c + a cos(2 pi h N_i) + b sin(2 pi h N_i) at every pixel.

    Parameters: `data` (n, m) intensities, `orders` (n,) N at the centre, `field` (m,) h.
    Returns the residuals (n, m) and the coefficients (a, b) (2, m).
    """
    phase = 2.0 * np.pi * orders[:, None] * field
    wave = np.stack([np.cos(phase), np.sin(phase)])
    wave -= wave.mean(axis=1, keepdims=True)
    rest = data - data.mean(axis=0)
    cc, ss = np.einsum("kln,kln->kn", wave, wave)
    cs = np.einsum("ln,ln->n", wave[0], wave[1])
    cy, sy = np.einsum("kln,ln->kn", wave, rest)
    below = np.maximum(cc * ss - cs**2, 1e-3)
    coefficients = np.stack([(cy * ss - sy * cs) / below, (sy * cc - cy * cs) / below])
    return rest - np.einsum("kln,kn->ln", wave, coefficients), coefficients
