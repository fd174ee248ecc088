"""A disc in a frame: its rim, its field of orders, and how these rise with the load.

The free rim carries no principal difference, so that in a dark field it is as dark as the air and
fringes begin a little inside: the circle is a start, which the whole-field fit corrects.

sigma1 - sigma2 = (8 P/(pi D d)) (1 - rho^2)/((1 + rho^2)^2 - 4 zeta^2), rho = r/R, zeta = z/R along
the loads (Frocht 1948; see `reference.round_bodies`): the centre order scales all of it. One
image's scan of it has many minima. Several loads tell them apart: their centre orders lie on one
line, N = k P + N0, and the line with the least sum of relative misfits picks every image's start.

Whatever stress the disc holds already along the loads' directions, a pixel sees under the loads P
I = c + a cos(2 pi k h P) + b sin(2 pi k h P): h(x) is the disc's known field over its centre value,
k the centre's fringes per N, and a, b, c (with the stress's order in them) are free at every pixel.
The k that explains most of the variation, pooled over the disc, needs no start and no illumination.
(A Lomb-Scargle periodogram; Lomb, Astrophys. Space Sci. 39, 1976, 447-462.) Where frames of known
loads tell a, b, c and k, one more frame has one unknown, its load.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.result import ImageFit, View
from isochrome.calibration.shot import FINEST, LARGEST_TILT, RIM, Shot
from isochrome.errors import PhysicsError
from isochrome.estimation import (
    Observation,
    frame_light,
    jackknife_variance,
    linear_costs,
    prepare,
    solve_linear,
    total_degree,
)

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]

RAYS = 180
"""Directions in which the rim is looked for."""


@dataclass(frozen=True)
class Circle:
    """A circle about a centre at `row` and `col`, with its points' `scatter`, all px."""

    row: float
    col: float
    radius: float
    scatter: float


def find_rim(frame: Observation) -> Circle:
    """Find the disc: the largest patch where the intensity changes, unlike the air at the corners.

    PhysicsError where there is no disc, or the frame cuts it.
    """
    patch = _patch(frame)
    rows, cols = np.nonzero(patch)
    dr, dc = rows - rows.mean(), cols - cols.mean()
    sector = ((np.arctan2(dr, dc) / (2.0 * np.pi) + 0.5) * RAYS).astype(int) % RAYS
    order = np.lexsort((np.hypot(dr, dc), sector))
    outermost = order[np.flatnonzero(np.diff(np.append(sector[order], -1)))]  # of each sector
    circle = fit_circle(np.stack([rows[outermost], cols[outermost]], axis=1).astype(float))
    height, width = patch.shape
    spare, middle = RIM * circle.radius, np.array([circle.row, circle.col])
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
    """Fit a circle to points (n, 2), px, by least squares on radial distances, outliers
    down-weighted (soft L1); its `scatter` is the median distance.
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


LOAD_ZONE = 0.25
"""Radii about each load point that are left out: the contact there is not a point."""

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


def load_field(rows: Array, cols: Array, geometry: ArrayLike) -> tuple[Array, Complexes]:
    """The loads' field over its centre value: its size h and its direction, seen by a residual.

    Parameters: `rows`, `cols` (n,), px; `geometry`, row, column, radius (px) and angle of the loads
    from the column direction (rad). Returns h (n,) and v (n,) such that the order is |N h + v D_0|
    for a residual D_0 in the image's axes.
    """
    row, col, radius, angle = np.asarray(geometry, dtype=float)
    place = (cols - col - 1j * (rows - row)) / radius
    below = 1.0 + (place * np.exp(-1j * angle)) ** 2
    size = np.square(np.abs(below)) + 1e-12
    return (1.0 - np.square(np.abs(place))) / size, below**2 / size * np.exp(2j * angle)


def disc_order(grid: DiscPixels, params: ArrayLike) -> Array:
    """Fringe order (rows, cols) on a grid, 0 outside the disc, by its `params`: the centre order,
    and the geometry of `load_field`.
    """
    order, *geometry = np.asarray(params, dtype=float)
    return np.asarray(order * np.maximum(load_field(grid.rows, grid.cols, geometry)[0], 0.0))


def disc_mask(grid: DiscPixels, params: ArrayLike, *, within: float) -> NDArray[np.bool_]:
    """Pixels where the point-load field holds and the camera resolves it, True = valid.

    Left out: the rim (beyond `within` radii), a zone about each load point, and fringes finer
    than the pixels show.
    """
    _, row, col, radius, angle = np.asarray(params, dtype=float)
    place = (grid.cols - col + 1j * (grid.rows - row)) / radius
    load = 1j * np.exp(-1j * angle)
    clear = np.minimum(np.abs(place - load), np.abs(place + load)) > LOAD_ZONE
    slopes = np.gradient(disc_order(grid, params), float(grid.step))
    return np.asarray((np.abs(place) < within) & clear & (np.hypot(*slopes) < FINEST))


def disc_geometry(values: ArrayLike, rim: float) -> dict[str, float]:
    """A disc's row, column, radius (px) and angle (rad), and the radius of the `rim` as found."""
    row, col, radius, angle = (float(v) for v in np.asarray(values, dtype=float))
    return {
        "centre_row_px": row,
        "centre_col_px": col,
        "radius_px": radius,
        "rim_radius_px": rim,
        "load_angle_deg": float(np.degrees(angle)),
    }


RADII = (0.985, 1.015, 1.05)
ANGLES_DEG = np.linspace(-LARGEST_TILT, LARGEST_TILT, 7)
MOST_AT_REST = 0.5
"""Largest part of the highest load's order that may be there at zero load."""


@dataclass(frozen=True)
class Scan:
    """One image's scan: the rim, `geometries` (g, 4), row, column, radius and angle, and the `chi`
    of each and of each centre order in ORDERS (g, orders), inf = wrong contrast; `smooth_chi`, that
    of a smooth image without fringes.
    """

    circle: Circle
    geometries: Array
    chi: Array
    smooth_chi: float

    @property
    def curve(self) -> Array:
        """The least chi of each centre order in ORDERS."""
        return np.asarray(self.chi.min(axis=0))

    def starts(self, order: float) -> Array:
        """The best four starts (4, 5) with a centre order near `order`."""
        near = np.flatnonzero(np.abs(ORDERS - order) <= 0.35)
        flat = self.chi[:, near]
        best = np.argsort(flat, axis=None, kind="stable")[:4]
        places, columns = np.unravel_index(best, flat.shape)
        return np.column_stack([ORDERS[near[columns]], self.geometries[places]])


def scan_disc(shot: Shot) -> Scan:
    """Find a disc's rim and scan its centre order; raises PhysicsError where no disc is seen.

    The middle of the disc serves, where the order depends least on centre, radius and angle; the
    background takes all that is smooth, so that only fringes count.
    """
    circle = find_rim(shot)
    sizes = product(circle.radius * np.array(RADII), np.radians(ANGLES_DEG))
    geometries = np.array([[circle.row, circle.col, *size] for size in sizes])
    middle = MIDDLE * float(geometries[0, 2])
    grid = thin_grid(shot.light.shape, replace(circle, radius=middle / 1.08), 3000)
    near = np.hypot(grid.rows - circle.row, grid.cols - circle.col) < middle
    light, sigma, valid = (m[grid.pick] for m in (shot.light, shot.sigma, shot.valid))
    lamp = frame_light(near.shape, terms=(total_degree(1), total_degree(2)))
    problem = prepare(light, mask=valid & near, sigma=sigma, light=lamp)
    columns = problem.columns
    chi = []
    for geometry in geometries:
        unit = disc_order(grid, [1.0, *geometry])[problem.keep]
        wave = 0.5 * np.cos(2.0 * np.pi * ORDERS[:, None] * unit)
        signals = 0.5 + wave if shot.bright else 0.5 - wave
        cost, lit = linear_costs(*columns, problem.data[None], signals)
        mean = np.maximum(cost[:, 0], 0.0) / problem.size
        chi.append(np.where(lit[:, 0] > 0.0, np.sqrt(mean), np.inf))
    smooth = solve_linear(problem, np.zeros(problem.size))
    return Scan(circle, geometries, np.array(chi), float(np.sqrt(smooth.cost / problem.size)))


def choose_centre_orders(scans: Sequence[Scan], loads_n: Sequence[float]) -> Array:
    """Each image's starting order (n,), from its own scan or from the line that suits all loads."""
    loads = np.asarray(loads_n, dtype=float)
    # ln chi above its minimum; a wrong contrast counts as no fringes at all
    chis = [np.minimum(s.curve, s.smooth_chi) for s in scans]
    costs = np.stack([np.log(chi / chi.min()) for chi in chis])
    if np.unique(loads).size < 2:
        return np.asarray(ORDERS[np.argmin(costs, axis=1)])
    low, high = float(loads.min()), float(loads.max())
    first, last = np.meshgrid(ORDERS, ORDERS, indexing="ij")
    slope = (last - first) / (high - low)
    at_no_load = first - slope * low
    total = np.where((slope > 0) & (np.abs(at_no_load) <= MOST_AT_REST * last), 0.0, np.inf)
    for cost, load in zip(costs, loads, strict=True):
        total += np.interp(first + slope * (load - low), ORDERS, cost)
    i, j = np.unravel_index(int(np.argmin(total)), total.shape)
    return np.asarray(ORDERS[i] + slope[i, j] * (loads - low))


FEWEST_LOADS = 5
"""Three numbers a pixel are free: fewer loads leave nothing to judge k by."""

SIDE = 90
THIN = 4
"""Columns of which one is looked at while a rise is searched for."""
WITHIN = 0.8
"""Radii about the centre that are used, and `MIDDLE` along the loads."""


@dataclass(frozen=True)
class Overlay:
    """All images on the unit disc: `stack` (n, m, m), its `grid` in radii, `loads` (n,); their
    `numbers` in a set.
    """

    stack: Array
    grid: DiscPixels
    loads: Array
    numbers: tuple[int, ...] = ()

    @property
    def used(self) -> NDArray[np.bool_]:
        """Pixels (m, m) away from the rim and from the loads."""
        x, z = self.grid.cols, self.grid.rows
        return (x**2 + z**2 < WITHIN**2) & (np.abs(z) < MIDDLE)

    def field(self, angle: float, scale: float = 1.0, z: float = 0.0, x: float = 0.0) -> Array:
        """Order over centre order (m, m) for loads at `angle` (rad), on a disc that is `scale`
        times the rim as found and lies `z`, `x` radii from it.
        """
        return disc_order(self.grid, (1.0, z, x, scale, angle))


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


def overlay(shots: Sequence[Shot], rims: Sequence[Circle]) -> Overlay:
    """Lay the images over each other on their rims; `shots` (n,), `rims` (n,)."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    unit = np.linspace(-WITHIN, WITHIN, SIDE)
    z, x = np.meshgrid(unit, unit, indexing="ij")
    stack = []
    for shot, rim in zip(shots, rims, strict=True):
        smooth = gaussian_filter(shot.light, max(1.0, rim.radius / 200.0))
        places = [rim.row + z * rim.radius, rim.col + x * rim.radius]
        stack.append(map_coordinates(smooth, places, order=1, mode="nearest"))
    grid = DiscPixels(z[:, :1], x[:1], unit[1] - unit[0])
    return Overlay(np.stack(stack), grid, np.array([s.load_n for s in shots]))


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


def _shares(images: Overlay, angle: float, slopes: Array) -> Array:
    """Share of the variation over the loads that each slope explains, pooled over the pixels.

    Slopes (k,) at even steps: each one's waves are those of the one before, turned by as much.
    """
    field, used = images.field(angle)[:, ::THIN], images.used[:, ::THIN]
    data, unexplained = images.stack[:, :, ::THIN][:, used], np.empty(len(slopes))
    varying, phase = data - data.mean(axis=0), 2j * np.pi * images.loads[:, None] * field[used]
    wave, turn = np.exp(slopes[0] * phase), np.exp((slopes[1] - slopes[0]) * phase)
    for k in range(len(slopes)):
        unexplained[k] = np.sum(_fit_wave(wave, varying)[0] ** 2)
        wave *= turn
    return np.asarray(1.0 - unexplained / np.sum(varying**2))


def pixel_waves(data: Array, orders: Array, field: Array) -> tuple[Array, Array]:
    """Fit c + a cos(2 pi h N_i) + b sin(2 pi h N_i) at every pixel.

    Parameters: `data` (n, m) intensities, `orders` (n,) N at the centre, `field` (m,) h.
    Returns the residuals (n, m) and the coefficients (a, b) (2, m).
    """
    residual, c = _fit_wave(np.exp(2j * np.pi * orders[:, None] * field), data - data.mean(axis=0))
    return residual, np.stack([c.real, c.imag])


def _fit_wave(wave: Any, varying: Array) -> tuple[Array, Any]:
    """The residuals (n, m) of a cos + b sin = Re(c* w) by least squares, and c = a + ib (m,).

    Of waves w without their mean, and data y (n, m) that have none: with S = sum |w|², Q = sum w²
    it is (S c + Q c*)/2 = sum w y.
    """
    wave = wave - wave.mean(axis=0)
    size, square = np.sum(wave.real**2 + wave.imag**2, axis=0), np.sum(wave * wave, axis=0)
    right = np.sum(wave * varying, axis=0)
    below = np.maximum(0.5 * (size**2 - np.abs(square) ** 2), 2e-3)
    c = (size * right - square * right.conj()) / below
    return varying - (wave * c.conj()).real, c


def fit_rise(
    shots: Sequence[Shot], rims: Sequence[Circle], images: Overlay, rise: Rise, diameter_mm: float
) -> tuple[ImageFit, ...]:
    """Fit every image's centre order with the residual order free at every pixel.

    Parameters: `shots`, their `rims` and `images`, laid over each other; `rise`, the start;
    `diameter_mm`. Returns the ImageFits; the constant that they share is known up to a whole order,
    and chosen within half an order at zero load.
    """
    fitted = fit_orders(images, rise.slope * images.loads, rise.angle)
    orders, place = fitted.orders, fitted.place
    variance = jackknife_variance(_without_blocks(images, fitted))[1:]
    angle, scale, z, x = place
    field, used = images.field(*place), images.used
    residual, waves = pixel_waves(images.stack[:, used], orders, field[used])
    spread = np.sqrt(np.mean(residual**2, axis=1) * len(orders) / (len(orders) - 3))
    errors = np.sqrt(np.concatenate([[variance.mean()], variance]))
    # its order at the centre beside N_i: I ~ -cos 2 pi (h N_i + n) in a dark field
    near = np.hypot(images.grid.cols, images.grid.rows)[used] < 0.1
    a, b = waves[:, near].sum(axis=1) * (-1.0 if shots[0].bright else 1.0)
    offset = float(np.arctan2(b, -a) / (2.0 * np.pi))
    at_no_load = np.polynomial.polynomial.polyfit(images.loads, orders + offset, 1)[0]
    orders = orders + offset - np.round(at_no_load)
    fits = []
    for i, (shot, circle) in enumerate(zip(shots, rims, strict=True)):
        row, col = circle.row + z * circle.radius, circle.col + x * circle.radius
        beside, sigma = np.full(field.shape, np.nan), float(np.median(shot.sigma))
        beside[used] = residual[i]
        view = View(
            image=images.stack[i], model=images.stack[i] - beside, residual=beside, sigma=sigma,
            cut=np.s_[len(field) // 2, :], order=orders[i] * field,
            position_mm=0.5 * diameter_mm * images.grid.cols[0],
            pixel_mm=(0.5 * diameter_mm * float(images.grid.step),) * 2,
        )  # fmt: skip
        fits.append(
            ImageFit(
                file=shot.name, load_n=shot.load_n, order=float(orders[i]),
                standard_uncertainty=float(errors[i]), chi=float(spread[i] / sigma),
                geometry=disc_geometry([row, col, scale * circle.radius, angle], circle.radius),
                view=view,
            )
        )  # fmt: skip
    return tuple(fits)


@dataclass(frozen=True)
class OrdersFit:
    """Every image's centre order (n,), the first's as it was given; `place`: the loads' angle, the
    disc's scale, z and x (4,); `residual` (n, m) and its `jacobian` (n, m, n + 3) by the orders but
    the first, then the place.
    """

    orders: Array
    place: Array
    residual: Array
    jacobian: Array


def fit_orders(images: Overlay, first: Array, angle: float) -> OrdersFit:
    """Fit the centre order of every image with the residual order free at every pixel.

    Parameters: `images` (n,); `first` (n,), the orders to start from, of which the first is kept;
    `angle` of the loads, rad. Returns an OrdersFit.
    """
    from scipy.optimize import least_squares

    used = images.used
    data, count = images.stack[:, used], len(first)

    def left(free: Array) -> Array:
        orders = np.concatenate([first[:1], free[: count - 1]])
        return pixel_waves(data, orders, images.field(*free[count - 1 :])[used])[0].ravel()

    start = np.concatenate([first[1:], [angle, 1.0, 0.0, 0.0]])
    size = np.concatenate([np.full(count - 1, 0.1), [0.05, 0.01, 0.01, 0.01]])
    room = np.concatenate([np.full(count - 1, 1.0), [0.2, 0.06, 0.06, 0.06]])
    result = least_squares(left, start, x_scale=size, bounds=(start - room, start + room))
    orders = np.concatenate([first[:1], result.x[: count - 1]])
    residual, jacobian = result.fun.reshape(count, -1), result.jac.reshape(count, -1, start.size)
    return OrdersFit(orders, result.x[count - 1 :], residual, jacobian)


BEYOND = 1.5
"""Times the largest known load up to which a load is looked for."""

STEP = 0.02
"""Fringes at the centre between the loads that are tried."""

TOLD = 0.3
"""Share of a frame's variation that the known loads must explain at the least."""

APART, CLEARER = 0.5, 0.8
"""Another load, so many fringes away, must leave more: the best leaves less than this of it."""

STRIPS = 4
"""Strips across and along, in whose blocks the disc is left out one after another."""


@dataclass(frozen=True)
class LoadReading:
    """A load that was read."""

    load_n: float
    standard_uncertainty: float  # N: the frame's own, and how well the known loads agree
    explained: float  # share of the frame's variation that the known loads explain
    chi: float  # what they leave over the frame's noise
    rim: Circle  # the disc's outline
    beyond: float  # how far it is outside of the known loads, over their range; 0 inside


def lay_series(shots: Sequence[Shot], numbers: Sequence[int]) -> Overlay:
    """Lay numbered frames of known loads over each other; PhysicsError where no disc is seen."""
    return replace(overlay(shots, [find_rim(shot) for shot in shots]), numbers=tuple(numbers))


def read_load(series: Overlay, shot: Shot, number: int) -> LoadReading:
    """Read the load of a frame against the frames of known loads, itself left out of them.

    All orders N_i are fitted with a, b, c free at every pixel; the line N = k P + N0 gives (N -
    N0)/k. u² = u_J² + s² (1 + wᵀ w) (n - 2)/(n - 4)/k²: u_J by `jackknife_variance` over blocks of
    the disc, s the n known loads' scatter about the line, w their weights in it there; Student's t:
    Gelman et al. (2013), Bayesian Data Analysis, 3.2. PhysicsError: no disc, under five loads.
    """
    others = [i for i, other in enumerate(series.numbers) if other != number]
    known = Overlay(series.stack[others], series.grid, series.loads[others])
    count = np.unique(known.loads).size
    rise = rise_with_load(known)
    if rise is None:
        raise PhysicsError(
            "other_loads_known_least", name=shot.name, count=count, fewest_loads=FEWEST_LOADS
        )
    rim = find_rim(shot)
    frame = overlay([shot], [rim])
    start = _coarse(known, frame, rise, shot.name)
    both = replace(known, stack=np.concatenate([known.stack, frame.stack]))
    fit = fit_orders(both, np.append(rise.slope * known.loads, start), rise.angle)
    design = np.stack([known.loads, np.ones_like(known.loads)], axis=1)
    inverse, free = np.linalg.pinv(design), len(known.loads) - 2
    slope, intercept = inverse @ fit.orders[:-1]
    load = float((fit.orders[-1] - intercept) / slope)
    weights = np.array([load, 1.0]) @ inverse
    scatter = np.sum((fit.orders[:-1] - design @ (slope, intercept)) ** 2) / free
    moved = _without_blocks(both, fit) @ np.append(-weights, 1.0)
    variance = float(jackknife_variance(moved))
    variance += scatter * (1.0 + weights @ weights) * free / (free - 2)
    light = frame.stack[0][frame.used]
    predicted = _prediction(known, fit.orders[:-1], fit.place)(float(fit.orders[-1]))
    residual = float(np.mean((light - predicted) ** 2))
    low, high = known.loads.min(), known.loads.max()
    return LoadReading(
        load_n=load, standard_uncertainty=float(np.sqrt(variance) / abs(slope)),
        explained=float(1.0 - residual / np.var(light)),
        chi=float(np.sqrt(residual) / np.median(shot.sigma)), rim=rim,
        beyond=max(0.0, low - load, load - high) / float(high - low),
    )  # fmt: skip


def _coarse(known: Overlay, frame: Overlay, rise: Rise, name: str) -> float:
    """The centre order with which the known frames predict this one best (fringes)."""
    predict = _prediction(known, rise.slope * known.loads, np.array([rise.angle, 1.0, 0.0, 0.0]))
    light = frame.stack[0][frame.used]
    tried = np.arange(STEP, BEYOND * rise.slope * known.loads.max(), STEP)
    residual = np.array([np.mean((light - predict(order)) ** 2) for order in tried])
    best = int(np.argmin(residual))
    away = np.abs(tried - tried[best]) > APART
    lowest = (residual < np.roll(residual, 1)) & (residual < np.roll(residual, -1)) & away
    explained = 1.0 - residual[best] / np.var(light)
    if explained < TOLD or np.any(residual[lowest] * CLEARER < residual[best]):
        raise PhysicsError(
            "frames_known_loads_explain", name=name, explained=100 * max(0.0, explained)
        )
    return float(tried[best])


def _prediction(known: Overlay, orders: Array, place: Array) -> Callable[[float], Array]:
    """The light (m,) that frames of known loads make of another, by its order at the centre.

    Parameters: `known` (n,); their `orders` (n,); `place`, see `fit_orders`.
    """
    used, field = known.used, known.field(*place)[known.used]
    data = known.stack[:, used]
    cosine, sine = pixel_waves(data, orders, field)[1]

    def light(order: float) -> Array:
        phase = 2.0 * np.pi * order * field
        return np.asarray(cosine * np.cos(phase) + sine * np.sin(phase))

    constant = np.mean(data - [light(n) for n in orders], axis=0)
    return lambda order: constant + light(order)


def _without_blocks(images: Overlay, fit: OrdersFit) -> Array:
    """How the orders (B, n) move where one block of the disc after another is left out.

    To first order in what is left out; the first image's order is held.
    """
    used = images.used
    strips = []  # of equal width, in which each place lies
    for places in (images.grid.cols, images.grid.rows):
        place = np.broadcast_to(places, used.shape)[used]
        edges = np.linspace(place.min(), place.max(), STRIPS + 1)[1:-1]
        strips.append(np.searchsorted(edges, place))
    block = strips[0] * STRIPS + strips[1]
    grams, pulls = [], []
    for b in np.unique(block):
        rows = fit.jacobian[:, block == b].reshape(-1, fit.jacobian.shape[-1])
        grams.append(rows.T @ rows)
        pulls.append(rows.T @ fit.residual[:, block == b].ravel())
    total, pull = np.sum(grams, axis=0), np.sum(pulls, axis=0)
    count = len(fit.orders)
    moved = np.zeros((len(grams), count))
    for i, (gram, one) in enumerate(zip(grams, pulls, strict=True)):
        moved[i, 1:] = -np.linalg.solve(total - gram, pull - one)[: count - 1]
    return moved
