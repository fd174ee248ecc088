"""The disc's rim in a frame: where fringes begin, and a circle through the outermost of them.

The free rim carries no principal difference, so that in a dark field it is as dark as the air and
fringes begin a little inside: the circle is a start, which the whole-field fit corrects.

The disc's order field on a frame's pixels, and a scan of its centre order.

sigma1 - sigma2 = (8 P/(pi D d)) (1 - rho^2)/((1 + rho^2)^2 - 4 zeta^2), rho = r/R, zeta = z/R along
the loads (Frocht 1948; see `reference.brazilian_disc`): the centre order scales all of it.

Starts for a disc's fit: rim, then a scan of centre order, radius and load direction.

One image's scan has many minima. Several loads tell them apart: their centre orders lie on one
line, N = k P + N0, and the line with the least sum of relative misfits picks every image's start.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.order_line import check_order
from isochrome.calibration.result import ImageFit, View
from isochrome.calibration.shot import Shot
from isochrome.errors import PhysicsError
from isochrome.estimation import (
    MOSTLY,
    Observation,
    SeparableProblem,
    prepare,
    smooth_light,
    solve_all,
    solve_linear,
)

Array = NDArray[np.float64]

RAYS = 180
"""Directions in which the rim is looked for."""

_SPARE = 0.03
"""How far a circle may leave the frame, over its radius: about what its outline is uncertain by."""


@dataclass(frozen=True)
class Circle:
    """A circle in pixels.

    Parameters
    ----------
    row, col : float
        The centre, px.
    radius : float
        The radius, px.
    scatter : float
        Its points' scatter, px.
    """

    row: float
    col: float
    radius: float
    scatter: float


def find_rim(frame: Observation) -> Circle:
    """Find the disc: the largest patch where the intensity changes, unlike the air at the corners.

    Parameters
    ----------
    frame : Observation
        A frame that holds the whole disc with air in its corners.

    Returns
    -------
    Circle
        The circle through its outline.

    Raises
    ------
    PhysicsError
        Where there is no disc, or the frame cuts it.
    """
    patch = _patch(frame)
    rows, cols = np.nonzero(patch)
    centre = np.array([rows.mean(), cols.mean()])
    points = _outline(patch, centre)
    circle = fit_circle(points)
    height, width = patch.shape
    spare, middle = _SPARE * circle.radius, np.array([circle.row, circle.col])
    low, high = middle - circle.radius, middle + circle.radius
    inside = np.all((low >= -spare) & (high <= np.array(patch.shape) + spare))
    edge = np.concatenate([patch[0], patch[-1], patch[:, 0], patch[:, -1]])
    if not inside or np.count_nonzero(edge) > 0.1 * min(height, width):
        raise PhysicsError(
            "disc_rim_leaves_frame", name=frame.name, row=circle.row, col=circle.col,
            radius=circle.radius, height=height, width=width,
        )  # fmt: skip
    if circle.scatter > 0.12 * circle.radius:
        raise PhysicsError(
            "no_round_disc_seen", name=frame.name, radius=circle.scatter / circle.radius
        )
    return circle


def fit_circle(points: Array) -> Circle:
    """Fit a circle by least squares on radial distances, outliers down-weighted (soft L1).

    Parameters
    ----------
    points : (n, 2) array
        Row and column of each point, px.

    Returns
    -------
    Circle
        The circle; its `scatter` is the median distance.
    """
    from scipy.optimize import least_squares

    centre = points.mean(axis=0)
    radius = float(np.median(np.hypot(*(points - centre).T)))

    def distance(p: Array) -> Array:
        return np.asarray(np.hypot(points[:, 0] - p[0], points[:, 1] - p[1]) - p[2])

    result = least_squares(
        distance, [*centre, radius], loss="soft_l1", f_scale=max(0.5, 0.01 * radius)
    )
    row, col, size = (float(v) for v in result.x)
    return Circle(row, col, size, float(np.median(np.abs(distance(result.x)))))


def _patch(frame: Observation) -> NDArray[np.bool_]:
    from scipy import ndimage

    size = min(frame.light.shape)
    blur = max(2.0, size / 250.0)
    image = np.where(frame.valid, frame.light, np.median(frame.light))
    slope = ndimage.gaussian_gradient_magnitude(image, blur)
    corner = max(4, size // 25)
    ends = (slice(0, corner), slice(-corner, None))
    air = np.median([np.median(slope[r, c]) for r in ends for c in ends])
    noise = float(np.median(frame.sigma)) / (2.0 * np.sqrt(2.0 * np.pi) * blur**2)
    limit = max(6.0 * noise, 3.0 * float(air), 0.05 * float(np.percentile(slope, 98)))
    steps = max(2, size // 40)  # beyond the border too, which a closing would eat
    closed = ndimage.binary_closing(np.pad(slope > limit, steps), iterations=steps)
    labels, count = ndimage.label(closed[steps:-steps, steps:-steps])
    if count == 0:
        raise PhysicsError("nothing_but_even_light", name=frame.name)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray(ndimage.binary_fill_holes(labels == int(np.argmax(sizes))))


def _outline(patch: NDArray[np.bool_], centre: Array) -> Array:
    """The outermost patch pixel in each of RAYS sectors, (n, 2)."""
    rows, cols = np.nonzero(patch)
    dr, dc = rows - centre[0], cols - centre[1]
    sector = ((np.arctan2(dr, dc) / (2.0 * np.pi) + 0.5) * RAYS).astype(int) % RAYS
    order = np.lexsort((np.hypot(dr, dc), sector))
    last = np.flatnonzero(np.diff(np.append(sector[order], -1)))
    chosen = order[last]
    return np.stack([rows[chosen], cols[chosen]], axis=1).astype(float)


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
    order, row, col, radius, angle = np.asarray(params, dtype=float)
    x, z = (grid.cols - col) / radius, (grid.rows - row) / radius
    square, along = x**2 + z**2, z * np.cos(angle) + x * np.sin(angle)
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
        image=shot.light[grid.pick], model=np.where(np.isfinite(residual), model, np.nan),
        residual=residual, sigma=float(np.median(shot.sigma)),
        cut=np.s_[int(np.argmin(np.abs(grid.rows - values[1]))), :], order=order,
        position_mm=(grid.cols[0] - values[2]) * pixel_mm, pixel_mm=(pixel_mm * grid.step,) * 2,
    )  # fmt: skip


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


RADII = (0.985, 1.015, 1.05)
ANGLES_DEG = (-7.5, -5.0, -2.5, 0.0, 2.5, 5.0, 7.5)
LARGEST_RESIDUAL = 2.0
"""Order at zero load beyond which a line through the loads is not believed."""

MOST_AT_REST = 0.5
"""Largest part of the highest load's order that may be there at zero load."""

CLEAR = 0.5
"""Part of the misfit without fringes that an image's own order leaves at the most."""

SLOPE_SLACK = 0.05
"""How far a line's slope may be from the rise that the pixels show."""


@dataclass(frozen=True)
class Scan:
    """One image's scan: the rim, its `geometries` (g, 4), `chi` (g, orders) and `smooth_chi`."""

    circle: Circle
    geometries: Array
    chi: Array
    smooth_chi: float

    @property
    def curve(self) -> Array:
        """The least chi of each centre order in ORDERS."""
        return np.asarray(self.chi.min(axis=0))

    def starts(self, order: float, *, reach: float = 0.35, count: int = 4) -> Array:
        """The best `count` starts (count, 5) with a centre order within `reach` of `order`."""
        near = np.flatnonzero(np.abs(ORDERS - order) <= reach)
        flat = self.chi[:, near]
        best = np.argsort(flat, axis=None, kind="stable")[:count]
        places, columns = np.unravel_index(best, flat.shape)
        return np.column_stack([ORDERS[near[columns]], self.geometries[places]])


def scan_disc(shot: Shot) -> Scan:
    """Find a disc's rim and scan its centre order; raises PhysicsError where no disc is seen."""
    circle = find_rim(shot)
    geometries = np.array([
        [circle.row, circle.col, circle.radius * factor, np.radians(angle)]
        for factor in RADII
        for angle in ANGLES_DEG
    ])  # fmt: skip
    return Scan(circle, geometries, *scan_orders(shot, geometries))


def choose_centre_orders(
    scans: Sequence[Scan], loads_n: Sequence[float], *, rise_per_n: float | None = None
) -> Array:
    """Each image's starting order, from its own scan or from the line that suits all loads.

    Parameters: `scans` (n,), `loads_n` (n,); `rise_per_n`, the line's slope where it is known
    (fringe/N, to 5 %), see `rise_with_load`. Returns the orders (n,).
    """
    loads = np.asarray(loads_n, dtype=float)
    # ln chi above its minimum; a wrong contrast counts as no fringes at all
    chis = [np.minimum(s.curve, s.smooth_chi) for s in scans]
    costs = np.stack([np.log(chi / chi.min()) for chi in chis])
    if np.unique(loads).size < 2:
        return np.asarray(ORDERS[np.argmin(costs, axis=1)])
    low, high = float(loads.min()), float(loads.max())
    first, last = np.meshgrid(ORDERS, ORDERS, indexing="ij")
    slope = (last - first) / (high - low)
    rest = first - slope * low
    limit = np.minimum(LARGEST_RESIDUAL, MOST_AT_REST * last)
    total = np.where((slope > 0) & (np.abs(rest) <= limit), 0.0, np.inf)
    if rise_per_n is not None:
        total[np.abs(slope / rise_per_n - 1.0) > SLOPE_SLACK] = np.inf
    for cost, load in zip(costs, loads, strict=True):
        total += np.interp(first + slope * (load - low), ORDERS, cost)
    i, j = np.unravel_index(int(np.argmin(total)), total.shape)
    return np.asarray(ORDERS[i] + slope[i, j] * (loads - low))


def check_scans(scans: Sequence[Scan], shots: Sequence[Shot]) -> None:
    """Refuse loads that contradict the orders which the images show each by itself.

    Parameters: `scans` and `shots` (n,). Raises PhysicsError as `line.check_order`; says nothing
    where an image's own order is not clear.
    """
    if all(np.min(s.curve) < CLEAR * s.smooth_chi for s in scans):
        orders = [ORDERS[int(np.argmin(s.curve))] for s in scans]
        check_order([s.load_n for s in shots], orders, tuple(s.name for s in shots))
