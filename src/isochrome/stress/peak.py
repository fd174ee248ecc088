"""The largest shear stress under a window, and where it is, the surface included."""

from dataclasses import dataclass

import numpy as np

from isochrome.errors import InputError
from isochrome.stress.field import PixelGrid
from isochrome.stress.half_plane import NO_STRESS, Box, Floats, Loads, RegularStress, find_hills


@dataclass(frozen=True)
class ShearPeak:
    """The largest shear stress (sigma_1 - sigma_2)/2 in the plane, and its place; z is depth."""

    shear_mpa: float
    x_mm: float
    z_mm: float


def largest_shear(
    nodes_mm: Floats,
    pressure_mpa: Floats,
    shear_mpa: Floats | None,
    *,
    within: PixelGrid | tuple[float, float, float, float],
    regular: RegularStress = NO_STRESS,
) -> ShearPeak:
    """Find the largest (sigma_1 - sigma_2)/2 in the material under a window, its surface included.

    A scan on graded depths finds the hills, direct sums climb the highest, to 1e-7 of their width.
    The window may be (left, right, top, bottom), mm. At the surface the value is the traction's at
    its uniform nodes: beside a worn edge, where friction ends steeply, sigma_x grows with the
    logarithm of that steepness, so with a finer grid. InputError: no material, or not finite.
    """
    box = _material(within)
    shear = np.zeros_like(pressure_mpa) if shear_mpa is None else shear_mpa
    for name, traction in (("pressure_mpa", pressure_mpa), ("shear_mpa", shear)):
        if not np.isfinite(traction).all():
            raise InputError("holds_nan_infinity_give", name=name)
    loaded = np.flatnonzero((pressure_mpa != 0.0) | (shear != 0.0))
    if not len(loaded):
        return _without_loads(regular, box)
    part = slice(max(loaded[0] - 1, 0), loaded[-1] + 2)  # two nodes at least
    spacing = float(nodes_mm[1] - nodes_mm[0])
    loads = Loads(nodes_mm[part], pressure_mpa[part], shear[part], spacing, regular)
    x, z, size = find_hills(loads, box)
    step = np.stack([np.maximum(spacing, 0.1 * z), np.maximum(0.5 * spacing, 0.2 * z)])
    x, z, size = _climb(loads, box, x, z, size, step, 0.05)
    best = slice(size.argmax(), size.argmax() + 1)
    x, z, size = _climb(loads, box, x[best], z[best], size[best], 0.05 * step[:, best], 1e-7 / 0.05)
    return ShearPeak(0.5 * float(size[0]), float(x[0]), float(z[0]))


def _without_loads(regular: RegularStress, box: Box) -> ShearPeak:
    """The largest shear of a regular stress alone: polynomials of low degree need no finer scan."""
    x, z = np.linspace(box.left, box.right, 65), np.linspace(box.top, box.bottom, 65)
    shear = 0.5 * np.abs(regular.difference(x[None, :], z[:, None]))
    row, col = np.unravel_index(int(shear.argmax()), shear.shape)
    return ShearPeak(float(shear[row, col]), float(x[col]), float(z[row]))


def _material(within: PixelGrid | tuple[float, float, float, float]) -> Box:
    """The part of a window that is in the material."""
    if isinstance(within, PixelGrid):
        wide, high = within.cols * within.pixel_mm, within.rows * within.pixel_mm
        left_mm, top = within.left_mm, within.top_mm
        within = left_mm, left_mm + wide, top, top + high
    left_mm, right, top, bottom = within
    if not (left_mm <= right and max(top, 0.0) <= bottom):
        raise InputError("window_from_mm_mm", left_mm=left_mm, right=right, top=top, bottom=bottom)
    return Box(left_mm, right, max(top, 0.0), bottom)


def _climb(
    loads: Loads, box: Box, x: Floats, z: Floats, size: Floats, step: Floats, share: float
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
