"""A disc in a frame: its rim, its field of orders, and how these rise with the load.

The free rim carries no principal difference, so that in a dark field it is as dark as the air and
fringes begin a little inside: the circle is a start, which the whole-field fit corrects.

sigma1 - sigma2 = (8 P/(pi D d)) (1 - rho^2)/((1 + rho^2)^2 - 4 zeta^2), rho = r/R, zeta = z/R along
the loads (Frocht 1948; see `reference.bodies`): the centre order scales all of it. One
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
    """The largest patch of changing light, unlike the air's. PhysicsError for none, or one cut."""
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
    patch = ndimage.binary_fill_holes(labels == int(np.argmax(sizes)))
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
    """Circle by least squares on points (n, 2), px, with soft L1; `scatter`, a median distance."""
    from scipy.optimize import least_squares

    centre = points.mean(axis=0)
    radius = float(np.median(np.hypot(*(points - centre).T)))

    def distance(p: Array) -> Array:
        return np.asarray(np.hypot(points[:, 0] - p[0], points[:, 1] - p[1]) - p[2])

    scale = max(0.5, 0.01 * radius)
    result = least_squares(distance, [*centre, radius], loss="soft_l1", f_scale=scale)
    row, col, size = (float(v) for v in result.x)
    return Circle(row, col, size, float(np.median(np.abs(distance(result.x)))))


LOAD_ZONE = 0.25
"""Radii about each load point that are left out: the contact there is not a point."""

ORDERS = np.arange(0.4, 16.0, 0.06)
"""Centre orders that are scanned."""

MIDDLE = 0.6
"""Radii about the centre from which they are."""


def thin_pixels(
    shape: tuple[int, ...], circle: Circle, pixels: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows (m,) and columns (n,) at even steps over the square about a circle, about `pixels`."""
    step = max(1, int(np.sqrt(4.0 * circle.radius**2 / pixels)))
    reach = 1.08 * circle.radius
    rows, cols = (
        np.arange(max(0, int(c - reach)), min(n, int(c + reach) + 2), step)
        for c, n in zip((circle.row, circle.col), shape, strict=True)
    )
    return rows, cols


def load_field(
    rows: NDArray[Any], cols: NDArray[Any], geometry: ArrayLike
) -> tuple[Array, Complexes]:
    """The loads' field over its centre value, h (n,), and v (n,) such that the order is |N h + v D|
    for a residual D in the image's axes. `geometry`: row, column, radius (px) and angle of the
    loads from the column direction (rad).
    """
    share, below = _loaded(rows, cols, geometry)
    turn = np.exp(2j * float(np.asarray(geometry, dtype=float)[3]))
    return share, below**2 / (np.square(np.abs(below)) + 1e-12) * turn


def _loaded(rows: NDArray[Any], cols: NDArray[Any], geometry: ArrayLike) -> tuple[Array, Complexes]:
    """h (n,), and 1 + w² of the places w over the radius, turned until the loads lie along i."""
    row, col, radius, angle = np.asarray(geometry, dtype=float)
    place = (cols - col - 1j * (rows - row)) * (np.exp(-1j * angle) / radius)
    below = 1.0 + place**2
    lengths = (np.square(w.real) + np.square(w.imag) for w in (place, below))
    return (1.0 - next(lengths)) / (next(lengths) + 1e-12), below


def disc_order(params: ArrayLike, rows: NDArray[Any], cols: NDArray[Any]) -> Array:
    """Fringe order (n,), 0 outside the disc, by the centre order and `load_field`'s geometry."""
    order, *geometry = np.asarray(params, dtype=float)
    return np.asarray(order * np.maximum(_loaded(rows, cols, geometry)[0], 0.0))


def disc_mask(
    params: ArrayLike, rows: NDArray[Any], cols: NDArray[Any], *, within: float
) -> NDArray[np.bool_]:
    """Pixels (m, n) off the rim and the load points, whose fringes are not finer than they show."""
    _, row, col, radius, angle = np.asarray(params, dtype=float)
    place = (cols - col + 1j * (rows[:, None] - row)) / radius
    load = 1j * np.exp(-1j * angle)
    clear = np.minimum(np.abs(place - load), np.abs(place + load)) > LOAD_ZONE
    slopes = np.gradient(disc_order(params, rows[:, None], cols), float(rows[1] - rows[0]))
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
    """Scan a disc's centre order in its middle, which depends least on the geometry, under a
    background that takes all that is smooth. PhysicsError where no disc is seen.
    """
    circle = find_rim(shot)
    sizes = product(circle.radius * np.array(RADII), np.radians(ANGLES_DEG))
    geometries = np.array([[circle.row, circle.col, *size] for size in sizes])
    middle = MIDDLE * float(geometries[0, 2])
    rows, cols = thin_pixels(shot.light.shape, replace(circle, radius=middle / 1.08), 3000)
    near = np.hypot(rows[:, None] - circle.row, cols - circle.col) < middle
    light, sigma, valid = (m[np.ix_(rows, cols)] for m in (shot.light, shot.sigma, shot.valid))
    lamp = frame_light(near.shape, terms=(total_degree(1), total_degree(2)))
    problem = prepare(light, mask=valid & near, sigma=sigma, light=lamp)
    columns = problem.columns
    chi = []
    for geometry in geometries:
        unit = disc_order([1.0, *geometry], rows[:, None], cols)[problem.keep]
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
    """Images `stack` (n, m, m) on the unit disc, at `places` (m,) along both sides, in radii."""

    stack: Array
    places: Array
    loads: Array
    numbers: tuple[int, ...] = ()

    @property
    def used(self) -> NDArray[np.bool_]:
        """Pixels (m, m) away from the rim and from the loads."""
        x, z = self.places, self.places[:, None]
        return (x**2 + z**2 < WITHIN**2) & (np.abs(z) < MIDDLE)

    def field(self, angle: float, scale: float = 1.0, z: float = 0.0, x: float = 0.0) -> Array:
        """Order over centre order (m, m) for loads at `angle` (rad), on a disc that is `scale`
        times the rim as found and lies `z`, `x` radii from it.
        """
        return disc_order((1.0, z, x, scale, angle), self.places[:, None], self.places)


@dataclass(frozen=True)
class Rise:
    """Slope k (fringe/N), loads' angle (rad), its share of the variation and the next best's, of
    the slope `rival`, which makes a fringe more, or less, between the loads.
    """

    slope: float
    angle: float
    explained: float
    runner_up: float
    rival: float

    @property
    def clear(self) -> bool:
        """Whether the slope explains most of the variation, and clearly more than any other."""
        return self.explained > 0.5 and self.explained > 1.25 * self.runner_up


def overlay(shots: Sequence[Shot], rims: Sequence[Circle], numbers: Sequence[int] = ()) -> Overlay:
    """Lay images (n,) over each other on their rims."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    unit, stack = np.linspace(-WITHIN, WITHIN, SIDE), []
    z, x = np.meshgrid(unit, unit, indexing="ij")
    for shot, rim in zip(shots, rims, strict=True):
        smooth = gaussian_filter(shot.light, max(1.0, rim.radius / 200.0))
        places = [rim.row + z * rim.radius, rim.col + x * rim.radius]
        stack.append(map_coordinates(smooth, places, order=1, mode="nearest"))
    return Overlay(np.stack(stack), unit, np.array([s.load_n for s in shots]), tuple(numbers))


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
    others = np.where(far, shares.max(axis=0), 0.0)
    rival = int(np.argmax(others))
    return Rise(
        slope=float(slopes[best]), angle=float(angles[i]), explained=float(shares[i, best]),
        runner_up=float(others[rival]), rival=float(slopes[rival]),
    )  # fmt: skip


def _shares(images: Overlay, angle: float, slopes: Array) -> Array:
    """Share of the variation over the loads that each slope explains, pooled over the pixels; at
    even steps, as each one's waves are those of the one before, turned by as much.
    """
    field, used = images.field(angle)[:, ::THIN], images.used[:, ::THIN]
    data, unexplained = images.stack[:, :, ::THIN][:, used], np.empty(len(slopes))
    varying, phase = data - data.mean(axis=0), 2j * np.pi * images.loads[:, None] * field[used]
    wave, turn = np.exp(slopes[0] * phase), np.exp((slopes[1] - slopes[0]) * phase)
    for k in range(len(slopes)):
        unexplained[k] = np.sum(_fit_wave(wave, varying)[0] ** 2)
        wave *= turn
    return np.asarray(1.0 - unexplained / np.sum(varying**2))


def pixel_waves(data: Array, orders: Array, field: Array) -> tuple[Array, Complexes]:
    """Residuals (n, m) of c + a cos(2 pi h N_i) + b sin(2 pi h N_i) at every pixel, and a + ib;
    `data` (n, m), `orders` (n,) N at the centre, `field` (m,) h.
    """
    return _fit_wave(np.exp(2j * np.pi * orders[:, None] * field), data - data.mean(axis=0))


def _fit_wave(wave: Complexes, varying: Array) -> tuple[Array, Complexes]:
    """Residuals (n, m) of Re(c* w) by least squares, and c (m,), of waves w less their mean and
    data y that have none: with S = sum |w|², Q = sum w² it is (S c + Q c*)/2 = sum w y.
    """
    wave = wave - wave.mean(axis=0)
    size, square = np.sum(wave.real**2 + wave.imag**2, axis=0), np.sum(wave * wave, axis=0)
    right = np.sum(wave * varying, axis=0)
    below = np.maximum(0.5 * (size**2 - np.abs(square) ** 2), 2e-3)
    c = (size * right - square * right.conj()) / below
    return varying - (wave * c.conj()).real, c


def fit_rise(
    shots: Sequence[Shot], rims: Sequence[Circle], images: Overlay, rise: Rise, diameter_mm: float
) -> list[ImageFit]:
    """Every image's centre order, from a `rise`, with the residual order free at every pixel. Their
    common constant is known up to a whole order: within half an order at zero load.
    """
    orders, place, moved = fit_orders(images, rise.slope * images.loads, rise.angle)
    variance = jackknife_variance(moved)[1:]
    angle, scale, z, x = place
    field, used = images.field(*place), images.used
    residual, waves = pixel_waves(images.stack[:, used], orders, field[used])
    spread = np.sqrt(np.mean(residual**2, axis=1) * len(orders) / (len(orders) - 3))
    errors = np.sqrt(np.concatenate([[variance.mean()], variance]))
    # its order at the centre beside N_i: I ~ -cos 2 pi (h N_i + n) in a dark field
    near = np.hypot(images.places, images.places[:, None])[used] < 0.1
    wave = waves[near].sum() * (-1.0 if shots[0].bright else 1.0)
    offset = float(np.angle(-wave.conj()) / (2.0 * np.pi))
    at_no_load = np.polynomial.polynomial.polyfit(images.loads, orders + offset, 1)[0]
    orders = orders + offset - np.round(at_no_load)
    position_mm, fits = 0.5 * diameter_mm * images.places, list[ImageFit]()
    for i, (shot, circle) in enumerate(zip(shots, rims, strict=True)):
        row, col = circle.row + z * circle.radius, circle.col + x * circle.radius
        beside, sigma = np.full(field.shape, np.nan), float(np.median(shot.sigma))
        beside[used] = residual[i]
        view = View(
            image=images.stack[i], model=images.stack[i] - beside, residual=beside, sigma=sigma,
            cut=np.s_[len(field) // 2, :], order=orders[i] * field, position_mm=position_mm,
            pixel_mm=(float(position_mm[1] - position_mm[0]),) * 2,
        )  # fmt: skip
        fits.append(
            ImageFit(
                file=shot.name, load_n=shot.load_n, order=float(orders[i]),
                standard_uncertainty=float(errors[i]), chi=float(spread[i] / sigma),
                geometry=disc_geometry([row, col, scale * circle.radius, angle], circle.radius),
                view=view,
            )
        )  # fmt: skip
    return fits


STRIPS = 4
"""Strips across and along, in whose blocks the disc is left out one after another."""


def fit_orders(images: Overlay, first: Array, angle: float) -> tuple[Array, Array, Array]:
    """Fit all centre orders with the residual order free at every pixel, from the orders `first`
    (n,), whose first is kept. Returns the orders (n,), the loads' angle, the disc's scale, z and x
    (4,), and how the orders move (b, n) where one block of the disc is left out, to first order.
    """
    from scipy.optimize import least_squares

    used, count = images.used, len(first)
    data = images.stack[:, used]

    def left(free: Array) -> Array:
        orders = np.concatenate([first[:1], free[: count - 1]])
        return pixel_waves(data, orders, images.field(*free[count - 1 :])[used])[0].ravel()

    start = np.concatenate([first[1:], [angle, 1.0, 0.0, 0.0]])
    size = np.concatenate([np.full(count - 1, 0.1), [0.05, 0.01, 0.01, 0.01]])
    room = np.concatenate([np.full(count - 1, 1.0), [0.2, 0.06, 0.06, 0.06]])
    result = least_squares(left, start, x_scale=size, bounds=(start - room, start + room))
    residual, jacobian = result.fun.reshape(count, -1), result.jac.reshape(count, -1, start.size)
    strips = []  # of equal width, in which each place lies
    for index in np.nonzero(used)[::-1]:
        place = images.places[index]
        edges = np.linspace(place.min(), place.max(), STRIPS + 1)[1:-1]
        strips.append(np.searchsorted(edges, place))
    block = strips[0] * STRIPS + strips[1]
    grams, pulls = [], []
    for b in np.unique(block):
        rows = jacobian[:, block == b].reshape(-1, start.size)
        grams.append(rows.T @ rows)
        pulls.append(rows.T @ residual[:, block == b].ravel())
    without, pull = np.sum(grams, axis=0) - grams, np.sum(pulls, axis=0) - pulls
    moved = np.zeros((len(grams), count))
    moved[:, 1:] = -np.linalg.solve(without, pull[..., None])[:, : count - 1, 0]
    return np.append(first[:1], result.x[: count - 1]), result.x[count - 1 :], moved


BEYOND = 1.5
"""Times the largest known load up to which a load is looked for."""

STEP = 0.02
"""Fringes at the centre between the loads that are tried."""

TOLD = 0.3
"""Share of a frame's variation that the known loads must explain at the least."""

APART, CLEARER = 0.5, 0.8
"""Another load, so many fringes away, must leave more: the best leaves less than this of it."""


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
    return overlay(shots, [find_rim(shot) for shot in shots], numbers)


def read_load(series: Overlay, shot: Shot, number: int) -> LoadReading:
    """Read a load against the other frames of known loads by the line N = k P + N0 through all
    orders, with a, b, c free at every pixel: u² = u_J² + s² (1 + wᵀ w) (n - 2)/(n - 4)/k², u_J by
    `jackknife_variance`, s the n known loads' scatter, w their weights; Student's t: Gelman et al.
    (2013), Bayesian Data Analysis, 3.2. PhysicsError: no disc, under five loads, none clear.
    """
    others = [i for i, other in enumerate(series.numbers) if other != number]
    known = Overlay(series.stack[others], series.places, series.loads[others])
    rise = rise_with_load(known)
    if rise is None:
        count = np.unique(known.loads).size
        raise PhysicsError(
            "other_loads_known_least", name=shot.name, count=count, fewest_loads=FEWEST_LOADS
        )
    rim = find_rim(shot)
    frame = overlay([shot], [rim])
    light, proportional = frame.stack[0][frame.used], rise.slope * known.loads
    predict = _prediction(known, proportional, known.field(rise.angle))
    tried = np.arange(STEP, BEYOND * proportional.max(), STEP)
    costs = np.array([np.mean((light - predict(order)) ** 2) for order in tried])
    best = int(np.argmin(costs))
    away = np.abs(tried - tried[best]) > APART
    lowest = (costs < np.roll(costs, 1)) & (costs < np.roll(costs, -1)) & away
    explained = 1.0 - costs[best] / np.var(light)
    if explained < TOLD or np.any(costs[lowest] * CLEARER < costs[best]):
        raise PhysicsError(
            "frames_known_loads_explain", name=shot.name, explained=100 * max(0.0, explained)
        )
    both = replace(known, stack=np.concatenate([known.stack, frame.stack]))
    orders, place, moved = fit_orders(both, np.append(proportional, tried[best]), rise.angle)
    design = np.stack([known.loads, np.ones_like(known.loads)], axis=1)
    inverse, free = np.linalg.pinv(design), len(known.loads) - 2
    slope, intercept = inverse @ orders[:-1]
    load = float((orders[-1] - intercept) / slope)
    weights = np.array([load, 1.0]) @ inverse
    scatter = np.sum((orders[:-1] - design @ (slope, intercept)) ** 2) / free
    variance = float(jackknife_variance(moved @ np.append(-weights, 1.0)))
    variance += scatter * (1.0 + weights @ weights) * free / (free - 2)
    predicted = _prediction(known, orders[:-1], known.field(*place))(float(orders[-1]))
    residual = float(np.mean((light - predicted) ** 2))
    low, high = known.loads.min(), known.loads.max()
    return LoadReading(
        load_n=load, standard_uncertainty=float(np.sqrt(variance) / abs(slope)),
        explained=float(1.0 - residual / np.var(light)),
        chi=float(np.sqrt(residual) / np.median(shot.sigma)), rim=rim,
        beyond=max(0.0, low - load, load - high) / float(high - low),
    )  # fmt: skip


def _prediction(known: Overlay, orders: Array, field: Array) -> Callable[[float], Array]:
    """The light (m,) that frames of known loads make of another centre order, on the `field`."""
    data, field = known.stack[:, known.used], field[known.used]
    waves = pixel_waves(data, orders, field)[1].conj()

    def light(order: float) -> Array:
        return np.asarray((waves * np.exp(2j * np.pi * order * field)).real)

    constant = np.mean(data - [light(n) for n in orders], axis=0)
    return lambda order: constant + light(order)
