"""The disc's order field on a frame's pixels, and a scan of its centre order.

sigma1 - sigma2 = (8 P/(pi D d)) (1 - rho^2)/((1 + rho^2)^2 - 4 zeta^2), rho = r/R, zeta = z/R along
the loads (Frocht 1948; see `isochrome.reference.disc`): the centre order scales all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.rim import Circle
from isochrome.calibrate.shot import Shot
from isochrome.fit import polynomial_basis
from isochrome.fit.linear import evaluate_prepared, prepare, solve_linear

Array = NDArray[np.float64]

LOAD_ZONE = 0.25
"""Radii about each load point that are left out: the contact there is not a point."""

RIM_ZONE = 0.03
"""Part of the radius at the rim that is left out."""

FINEST = 0.25
"""Fringes a pixel beyond which a pixel is left out."""

ORDERS = np.arange(0.4, 16.0, 0.06)
"""Centre orders that are scanned."""


@dataclass(frozen=True)
class Grid:
    """A thinned frame: `rows` (m, 1) and `cols` (1, n) of its pixels, and their spacing `step`."""

    rows: Array
    cols: Array
    step: int


def thin_grid(shape: tuple[int, ...], circle: Circle, pixels: int) -> Grid:
    """Every `step`-th pixel of the square about a circle, about `pixels` of them."""
    step = max(1, int(np.sqrt(4.0 * circle.radius**2 / pixels)))
    reach = 1.08 * circle.radius
    axes = [
        np.arange(max(0, int(c - reach)), min(n, int(c + reach) + 2), step, dtype=float)
        for c, n in zip((circle.row, circle.col), shape, strict=True)
    ]
    return Grid(axes[0][:, None], axes[1][None, :], step)


def disc_order(grid: Grid, params: ArrayLike) -> Array:
    """Fringe order on a grid; 0 outside the disc.

    Parameters: `params`, (centre order, row, column, radius in px, angle of the loads from the
    column direction, rad). Returns (rows, cols).
    """
    order, row, col, radius, angle = np.asarray(params, dtype=float)
    x, z = (grid.cols - col) / radius, (grid.rows - row) / radius
    along = z * np.cos(angle) + x * np.sin(angle)
    square = x**2 + z**2
    below = (1.0 + square) ** 2 - 4.0 * along**2
    return np.asarray(order * np.clip(1.0 - square, 0.0, None) / np.maximum(below, 1e-6))


def disc_signal(grid: Grid, params: ArrayLike, *, bright: bool = False) -> Array:
    """sin^2(pi N) of `disc_order`, or cos^2 in a bright field."""
    wave = np.square(np.sin(np.pi * disc_order(grid, params)))
    return np.asarray(1.0 - wave if bright else wave)


def disc_mask(grid: Grid, params: ArrayLike, *, within: float = 1.0 - RIM_ZONE) -> Array:
    """Pixels where the point-load field holds and the camera resolves it, True = valid.

    Left out: the rim (beyond `within` radii), a zone about each load point, and fringes finer
    than the pixels show.
    """
    _, row, col, radius, angle = np.asarray(params, dtype=float)
    x, z = (grid.cols - col) / radius, (grid.rows - row) / radius
    along = z * np.cos(angle) + x * np.sin(angle)
    across = x * np.cos(angle) - z * np.sin(angle)
    inside = x**2 + z**2 < within**2
    clear = np.minimum(*(np.hypot(across, along - s) for s in (-1.0, 1.0))) > LOAD_ZONE
    slopes = np.gradient(disc_order(grid, params), float(grid.step))
    return np.asarray(inside & clear & (np.hypot(*slopes) < FINEST))


def scan_orders(
    shot: Shot, geometries: ArrayLike, *, bright: bool = False, within: float = 0.6
) -> tuple[Array, float]:
    """chi of each centre order in ORDERS (columns) for each geometry (rows), inf = wrong contrast.

    The second value is the chi of a smooth image without fringes.

    The middle of the disc serves, where the order depends least on centre, radius and angle; the
    background takes all that is smooth, so that only fringes count.
    Parameters: `shot`; `geometries` (g, 4): row, column, radius, angle; `within`, radii.
    """
    table = np.atleast_2d(np.asarray(geometries, dtype=float))
    first = table[0]
    circle = Circle(first[0], first[1], within * first[2] / 1.08, 0.0)
    grid = thin_grid(shot.image.shape, circle, 3000)
    pick = np.ix_(grid.rows[:, 0].astype(int), grid.cols[0].astype(int))
    near = np.hypot(grid.rows - first[0], grid.cols - first[1]) < within * first[2]
    shape = near.shape
    problem = prepare(
        shot.image[pick],
        mask=shot.mask[pick] & near,
        sigma=shot.sigma[pick],
        illumination=polynomial_basis((shape[0], shape[1]), 1),
        background=polynomial_basis((shape[0], shape[1]), 2),
    )
    chi = np.empty((len(table), ORDERS.size))
    for i, geometry in enumerate(table):
        unit = disc_order(grid, [1.0, *geometry])
        for j, order in enumerate(ORDERS):
            wave = np.square(np.sin(np.pi * order * unit))
            chi[i, j] = evaluate_prepared(problem, 1.0 - wave if bright else wave).chi
    smooth = solve_linear(problem, np.zeros(problem.size))
    return chi, float(np.sqrt(smooth.cost / problem.size))
