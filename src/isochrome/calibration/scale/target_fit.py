r"""The camera that shows a plane target's points where they are found, by least squares.

With g = i + √-1 j the points' columns and rows, c a target's place, s the spacing in pixels of the
picture's middle, and w the place on the plane that the lens of `isochrome.stress` looks at from a
point's place in the picture, the residual is

    r = w(u, v; roll, distortion, keystone) - c - s g.

All points weigh the same; their noise is their residual's own scatter, so that what the model does
not describe widens the uncertainties.
Source: Zhang (2000), IEEE Trans. Pattern Anal. Mach. Intell. 22, 1330-1334, for a plane target.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import PhysicsError
from isochrome.stress import Lens

Array = NDArray[np.float64]

SHARED = ("spacing_px", "keystone_x", "keystone_z", "distortion")
"""The unknowns that all pictures share; each has a place and a roll besides."""

_LARGEST = 0.1
"""Distortion or keystone beyond which the lens's model is not meant to hold."""

_CLEAR = 13.8
"""Square of two values over their covariance that chance exceeds once in a thousand."""

_FINDER_PX = 0.005
"""What a point's place is uncertain by at least: no finder is better, whatever its residuals."""

_ALIKE = 4.0
"""Standard deviations of chance by which neighbours' residuals must be alike to count."""


@dataclass(frozen=True, kw_only=True)
class TargetFit:
    """The camera of a target's pictures.

    `values` and `spread`, by the names of SHARED; `rolls_deg`, each picture's roll and its standard
    uncertainty; `residual_px`, (rows, columns, 2) of each; `rms_px` of a coordinate; `likeness`,
    the correlation of neighbours' residuals, 0 where it is not clear; `shortening`, by how much
    the target is seen shorter in one direction than across it, 0 where that is not clear.
    """

    values: dict[str, float]
    spread: dict[str, float]
    rolls_deg: tuple[tuple[float, float], ...]
    residual_px: tuple[Array, ...]
    rms_px: float
    likeness: float
    shortening: float


def fit_target(places: Sequence[Array], shape: tuple[int, int]) -> TargetFit:
    """Fit the camera to the places of a target's points, (rows, columns, 2) px, in pictures.

    Parameters: `places`, one array a picture, see `target_places`; `shape` (rows, cols) of the
    pictures. Returns the TargetFit. Raises PhysicsError where the lens lies beyond its model.
    """
    from scipy.optimize import least_squares

    seen = [p[..., 0] - 0.5 * (shape[1] - 1) + 1j * (p[..., 1] - 0.5 * (shape[0] - 1))
            for p in places]  # fmt: skip
    grids, starts = zip(*(_start(s) for s in seen), strict=True)
    spacing = float(np.mean([start[0] for start in starts]))
    first = np.concatenate([[spacing, 0.0, 0.0, 0.0], *(start[1:] for start in starts)])

    def residual(values: Array) -> Array:
        left = _residual(values, seen, grids, shape)
        return np.concatenate([part.ravel().view(float) for part in left])

    options = {"method": "trf", "jac": "3-point", "x_scale": "jac", "xtol": 1e-12, "ftol": 1e-12}
    best = least_squares(residual, first, **options)
    if np.abs(best.x[1:4]).max() > _LARGEST:
        raise PhysicsError(
            f"the target is seen with keystone {best.x[1]:.3f}, {best.x[2]:.3f} and distortion "
            f"{best.x[3]:.3f}, and the lens's model holds to {_LARGEST:g}; set the camera square, "
            "or let the target fill the picture"
        )
    left = _residual(best.x, seen, grids, shape)
    more = least_squares(residual, np.append(best.x, [0.0, 0.0]), **options)
    shortening = _shortening(more.x, more.jac, more.fun)
    # a shortening is a cause of its own, and no likeness
    likeness = _likeness(_residual(more.x, seen, grids, shape) if shortening else left)
    # as of a first-order process in both directions: so many points are worth one
    scatter = max(float(np.sqrt(2.0 * best.cost / (best.fun.size - best.x.size))), _FINDER_PX)
    widened = scatter * (1.0 + likeness) / (1.0 - likeness)
    spread = widened * np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    rolls = zip(np.degrees(best.x[6::3]), np.degrees(spread[6::3]), strict=True)
    turned = [np.exp(-1j * roll) * part for roll, part in zip(best.x[6::3], left, strict=True)]
    return TargetFit(
        values=dict(zip(SHARED, map(float, best.x), strict=False)),
        spread=dict(zip(SHARED, map(float, spread), strict=False)),
        rolls_deg=tuple((float(roll), float(u)) for roll, u in rolls),
        residual_px=tuple(np.stack([part.real, part.imag], axis=-1) for part in turned),
        rms_px=float(np.sqrt(np.mean(best.fun**2))),
        likeness=likeness,
        shortening=shortening,
    )


def _start(seen: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], Array]:
    """The points' columns and rows as complex numbers, and spacing, place and roll by similarity.

    A target looks the same after a quarter or half turn, or mirrored: rows and columns are counted
    so that it lies within 45 degrees of upright, and is not mirrored.
    """
    rows, cols = seen.shape
    j, i = np.meshgrid(np.arange(rows), np.arange(cols), indexing="ij")
    grid = (i - 0.5 * (cols - 1)) + 1j * (j - 0.5 * (rows - 1))
    off = seen - seen.mean()
    if abs(np.vdot(grid.conj(), off)) > abs(np.vdot(grid, off)):
        grid = grid.conj()
    turn = np.vdot(grid, off) / np.vdot(grid, grid)
    quarter = 1j ** int(np.rint(np.angle(turn) / (0.5 * np.pi)))
    grid, turn = grid * quarter, turn / quarter
    roll = -float(np.angle(turn))  # z is down: counter-clockwise is against the angle
    place = np.exp(1j * roll) * seen.mean()
    return grid, np.array([abs(turn), place.real, place.imag, roll])


def _residual(
    values: Array,
    seen: Sequence[NDArray[np.complex128]],
    grids: Sequence[NDArray[np.complex128]],
    shape: tuple[int, int],
) -> list[NDArray[np.complex128]]:
    """Each picture's residual on the target's plane, px; two values more are a shortening."""
    spacing, keystone_x, keystone_z, distortion = values[:4]
    count = 3 * len(seen)
    strain = complex(*values[4 + count :]) if values.size > 4 + count else 0.0
    left = []
    for k, (picture, grid) in enumerate(zip(seen, grids, strict=True)):
        x, z, roll = values[4 + 3 * k : 7 + 3 * k]
        lens = Lens(
            right_mm=0.0, down_mm=0.0, half_width_mm=0.5 * shape[1], half_height_mm=0.5 * shape[0],
            roll_deg=float(np.degrees(roll)), distortion=float(distortion),
            keystone_x=float(keystone_x), keystone_z=float(keystone_z),
        )  # fmt: skip
        looked_x, looked_z = lens.looked_at(picture.real, picture.imag)
        on_plane = grid + strain * np.exp(2j * roll) * grid.conj()  # the strain is the picture's
        left.append(looked_x + 1j * looked_z - complex(x, z) - spacing * on_plane)
    return left


def _likeness(left: Sequence[NDArray[np.complex128]]) -> float:
    """Correlation of the residuals of neighbours, 0 unless it is clear."""
    products, squares, count = 0.0, 0.0, 0
    for part in left:
        for axis in (0, 1):
            a, b = (np.take(part, range(k, part.shape[axis] - 1 + k), axis) for k in (0, 1))
            products += float(np.sum((a * b.conj()).real))
            squares += 0.5 * float(np.sum(np.abs(a) ** 2 + np.abs(b) ** 2))
            count += 2 * a.size
    found = products / squares if squares > 0.0 else 0.0
    return min(found, 0.9) if found > _ALIKE / np.sqrt(count) else 0.0


def _shortening(values: Array, jac: Array, residual: Array) -> float:
    """By how much the target is shorter in one direction, where the residual clearly asks for it.

    A lens has no such thing, but a target that is seen aslant is: by 1 - cos of the angle.
    """
    strain = values[-2:]
    scatter = float(residual @ residual) / (residual.size - values.size)
    per_scatter = np.linalg.inv(jac.T @ jac)[-2:, -2:]
    square = max(scatter, _FINDER_PX**2)
    clear = float(strain @ np.linalg.solve(per_scatter, strain)) > _CLEAR * square
    return 2.0 * float(np.hypot(*strain)) if clear else 0.0
