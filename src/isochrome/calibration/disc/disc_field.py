"""The disc's order field on a frame's pixels, and a scan of its centre order.

sigma1 - sigma2 = (8 P/(pi D d)) (1 - rho^2)/((1 + rho^2)^2 - 4 zeta^2), rho = r/R, zeta = z/R along
the loads (Frocht 1948; see `reference.brazilian_disc`): the centre order scales all of it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.disc.disc_rim import Circle
from isochrome.calibration.result import ImageFit, View
from isochrome.calibration.shot import Shot
from isochrome.estimation import (
    MOSTLY,
    SeparableProblem,
    prepare,
    smooth_light,
    solve_all,
    solve_linear,
)

Array = NDArray[np.float64]

LOAD_ZONE = 0.25
"""Radii about each load point that are left out: the contact there is not a point."""

RIM_ZONE = 0.03
"""Part of the radius at the rim that is left out."""

FINEST = 0.25
"""Fringes a pixel beyond which a pixel is left out."""

ORDERS = np.arange(0.4, 16.0, 0.06)
"""Centre orders that are scanned."""

MIDDLE = 0.6
"""Radii about the centre from which they are."""


@dataclass(frozen=True)
class DiscPixels:
    """A thinned frame: `rows` (m, 1) and `cols` (1, n) of its pixels, and their spacing `step`."""

    rows: Array
    cols: Array
    step: float

    @property
    def pick(self) -> tuple[NDArray[np.intp], ...]:
        """The pixels as an index into the frame."""
        return np.ix_(self.rows[:, 0].astype(int), self.cols[0].astype(int))


def thin_grid(shape: tuple[int, ...], circle: Circle, pixels: int) -> DiscPixels:
    """Every `step`-th pixel of the square about a circle, about `pixels` of them."""
    step = max(1, int(np.sqrt(4.0 * circle.radius**2 / pixels)))
    reach = 1.08 * circle.radius
    axes = [
        np.arange(max(0, int(c - reach)), min(n, int(c + reach) + 2), step, dtype=float)
        for c, n in zip((circle.row, circle.col), shape, strict=True)
    ]
    return DiscPixels(axes[0][:, None], axes[1][None, :], step)


def disc_order(grid: DiscPixels, params: ArrayLike) -> Array:
    """Fringe order on a grid; 0 outside the disc.

    Parameters: `params`, (centre order, row, column, radius in px, angle of the loads from the
    column direction, rad). Returns (rows, cols).
    """
    order, *geometry = np.asarray(params, dtype=float)
    square, along, _ = disc_places(grid.rows, grid.cols, geometry)
    below = (1.0 + square) ** 2 - 4.0 * along**2
    return np.asarray(order * np.clip(1.0 - square, 0.0, None) / np.maximum(below, 1e-6))


def disc_places(rows: Array, cols: Array, geometry: ArrayLike) -> tuple[Array, Array, Array]:
    """Squared distance from a disc's centre, and distances along and across the loads, in radii.

    Parameters: `rows`, `cols`, px; `geometry`, row, column, radius, angle, see `disc_order`.
    """
    row, col, radius, angle = np.asarray(geometry, dtype=float)
    x, z = (cols - col) / radius, (rows - row) / radius
    along, across = (z * np.cos(angle) + x * np.sin(angle), x * np.cos(angle) - z * np.sin(angle))
    return x**2 + z**2, along, across


def squared_wave(phase: Array, bright: bool) -> Array:
    """Ideal circular polariscope, 0..1: sin^2 of pi N in a dark field, cos^2 in a bright one."""
    wave = np.square(np.sin(phase))
    return np.asarray(1.0 - wave if bright else wave)


def disc_mask(
    grid: DiscPixels, params: ArrayLike, *, within: float = 1.0 - RIM_ZONE
) -> NDArray[np.bool_]:
    """Pixels where the point-load field holds and the camera resolves it, True = valid.

    Left out: the rim (beyond `within` radii), a zone about each load point, and fringes finer
    than the pixels show.
    """
    square, along, across = disc_places(grid.rows, grid.cols, np.asarray(params)[1:])
    clear = np.minimum(*(np.hypot(across, along - s) for s in (-1.0, 1.0))) > LOAD_ZONE
    slopes = np.gradient(disc_order(grid, params), float(grid.step))
    return np.asarray((square < within**2) & clear & (np.hypot(*slopes) < FINEST))


def disc_image(
    shot: Shot, values: ArrayLike, rim: float, *, spread: float, chi: float, view: View
) -> ImageFit:
    """The result of one image.

    Parameters: `values` (5,), see `disc_order`; `rim`, the radius as found, px; `spread`, the
    order's standard uncertainty; `chi`; `view`.
    """
    order, row, col, radius, angle = (float(v) for v in np.asarray(values, dtype=float))
    geometry = {
        "centre_row_px": row,
        "centre_col_px": col,
        "radius_px": radius,
        "rim_radius_px": rim,
        "load_angle_deg": float(np.degrees(angle)),
    }
    return ImageFit(
        file=shot.name, load_n=shot.load_n, order=order, standard_uncertainty=spread, chi=chi,
        geometry=geometry, view=view,
    )  # fmt: skip


def disc_view(
    shot: Shot,
    grid: DiscPixels,
    values: Array,
    diameter_mm: float,
    *,
    model: Array,
    residual: Array,
    order: Array,
) -> View:
    """The view of one image, cut along its disc's horizontal diameter.

    Parameters: `values` (5,), see `disc_order`; `model`, `residual`, `order` on the `grid`.
    """
    pixel_mm = 0.5 * diameter_mm / float(values[3])
    return View(
        image=shot.light[grid.pick],
        model=np.where(np.isfinite(residual), model, np.nan),
        residual=residual,
        sigma=float(np.median(shot.sigma)),
        cut=np.s_[int(np.argmin(np.abs(grid.rows - values[1]))), :],
        order=order,
        position_mm=(grid.cols[0] - values[2]) * pixel_mm,
        pixel_mm=(pixel_mm * grid.step,) * 2,
    )


def scan_orders(shot: Shot, geometries: ArrayLike) -> tuple[Array, float]:
    """chi of each centre order in ORDERS (columns) for each geometry (rows), inf = wrong contrast.

    The second value is the chi of a smooth image without fringes.

    The middle of the disc serves, where the order depends least on centre, radius and angle; the
    background takes all that is smooth, so that only fringes count.
    Parameters: `shot`; `geometries` (g, 4): row, column, radius, angle.
    """
    table = np.atleast_2d(np.asarray(geometries, dtype=float))
    first = table[0]
    circle = Circle(first[0], first[1], MIDDLE * first[2] / 1.08, 0.0)
    grid = thin_grid(shot.light.shape, circle, 3000)
    near = np.hypot(grid.rows - first[0], grid.cols - first[1]) < MIDDLE * first[2]
    problem = prepare(
        shot.light[grid.pick],
        mask=shot.valid[grid.pick] & near,
        sigma=shot.sigma[grid.pick],
        **smooth_light(near.shape, (1, 2)).bases,
    )
    chi = [
        _scanned(problem, np.pi * disc_order(grid, [1.0, *geometry])[problem.keep], shot.bright)
        for geometry in table
    ]
    smooth = solve_linear(problem, np.zeros(problem.size))
    return np.array(chi), float(np.sqrt(smooth.cost / problem.size))


def _scanned(problem: SeparableProblem, unit: Array, bright: bool) -> Array:
    """chi of each centre order in ORDERS for phases `unit` (n,) of order 1, all solved at once."""
    light, dark, data = problem.light, problem.dark, problem.data
    ka, kc = len(light), len(dark)
    wave = squared_wave(ORDERS[:, None] * unit, bright)
    gram = np.empty((ORDERS.size, ka + kc, ka + kc))
    gram[:, :ka, :ka] = (wave**2 @ _products(light, light)).reshape(-1, ka, ka)
    gram[:, :ka, ka:] = (wave @ _products(light, dark)).reshape(-1, ka, kc)
    gram[:, ka:, :ka] = gram[:, :ka, ka:].transpose(0, 2, 1)
    gram[:, ka:, ka:] = problem.dark_gram
    right = np.empty((ORDERS.size, ka + kc))
    right[:, :ka], right[:, ka:] = wave @ (light * data).T, dark @ data
    coefficients = solve_all(gram, right[..., None])[..., 0]
    cost = data @ data - np.sum(right * coefficients, axis=1)
    negative = np.mean(coefficients[:, :ka] @ light <= 0.0, axis=1)
    good = np.isfinite(cost) & (negative <= MOSTLY)
    freedom = max(1, problem.size - ka - kc)
    return np.where(good, np.sqrt(np.maximum(cost, 0.0) / freedom), np.inf)


def _products(first: Array, second: Array) -> Array:
    """Products of all pairs of images (n, k l)."""
    return np.asarray((first[:, None] * second[None]).reshape(-1, first.shape[1]).T)
