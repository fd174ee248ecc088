"""The rise of the order with load, pixel by pixel, whatever stress the disc already holds.

With an arbitrary residual order n(x) along the same principal directions, a pixel sees
I = c + a cos(2 pi k h P) + b sin(2 pi k h P) over the loads P: h(x) is the disc's known field over
its centre value, k the centre's fringes per N, and a, b, c (with n in them) are free at every
pixel. The k that explains most of the variation, pooled over the disc, needs no start, no
illumination and no knowledge of n. (A Lomb-Scargle periodogram; Lomb, Astrophys. Space Sci. 39,
1976, 447-462.)

A disc's load, read against frames of known loads: whatever stress the disc already holds.

Frozen stress bends the fringes of a disc so that its closed form describes no single frame. But it
is the same in all of them: under the load P a pixel sees
I = c + a cos(2 pi k h P) + b sin(2 pi k h P), h the disc's own field over its centre value, and a,
b, c are told by frames of known loads, pixel by pixel. So is the rise k of the centre's order with
the load, and one more frame has one unknown, its load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import (
    ORDERS,
    Circle,
    DiscPixels,
    disc_image,
    disc_order,
    find_rim,
)
from isochrome.calibration.result import ImageFit, View
from isochrome.calibration.shot import Shot
from isochrome.errors import PhysicsError
from isochrome.estimation import jackknife_variance

Array = NDArray[np.float64]

FEWEST_LOADS = 5
"""Three numbers a pixel are free: fewer loads leave nothing to judge k by."""

ANGLES_DEG = (-6.0, -3.0, 0.0, 3.0, 6.0)
SIDE = 90
THIN = 4
"""Columns of which one is looked at while a rise is searched for."""
WITHIN, ALONG = 0.8, 0.6
"""Radii about the centre, and along the loads, that are used."""


@dataclass(frozen=True)
class Overlay:
    """All images on the unit disc: `stack` (n, m, m), its `grid` in radii, `loads` (n,)."""

    stack: Array
    grid: DiscPixels
    loads: Array

    @property
    def used(self) -> NDArray[np.bool_]:
        """Pixels (m, m) away from the rim and from the loads."""
        x, z = self.grid.cols, self.grid.rows
        return (x**2 + z**2 < WITHIN**2) & (np.abs(z) < ALONG)

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
    """Share of the variation over the loads that each slope explains, pooled over the pixels."""
    field, used = images.field(angle)[:, ::THIN], images.used[:, ::THIN]
    data = images.stack[:, :, ::THIN][:, used]
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


ENOUGH = 1e-6
"""Relative fall of the misfit, or relative move, below which a step is the last."""

MEMORY_PX = 4.0
"""Pixels of a frame over which the overlaid images' noise and misfit are correlated, at least."""


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
    flat = fitted.jacobian.reshape(-1, fitted.jacobian.shape[-1])
    variance = np.diag(np.linalg.pinv(flat.T @ flat))[: len(orders) - 1]
    angle, scale, z, x = place
    field, used = images.field(*place), images.used
    residual, waves = pixel_waves(images.stack[:, used], orders, field[used])
    spread = np.sqrt(np.mean(residual**2, axis=1) * len(orders) / (len(orders) - 3))
    errors = MEMORY_PX * np.sqrt(np.concatenate([[variance.mean()], variance])) * spread.mean()
    offset = _centre_order(images, waves, shots[0].bright)
    rest = np.polynomial.polynomial.polyfit(images.loads, orders + offset, 1)[0]
    orders = orders + offset - np.round(rest)
    fits = []
    for i, (shot, circle) in enumerate(zip(shots, rims, strict=True)):
        row, col = circle.row + z * circle.radius, circle.col + x * circle.radius
        left, sigma = np.full(field.shape, np.nan), float(np.median(shot.sigma))
        left[used] = residual[i]
        view = View(
            image=images.stack[i], model=images.stack[i] - left, residual=left, sigma=sigma,
            cut=np.s_[len(field) // 2, :], order=orders[i] * field,
            position_mm=0.5 * diameter_mm * images.grid.cols[0],
            pixel_mm=(0.5 * diameter_mm * float(images.grid.step),) * 2,
        )  # fmt: skip
        place, chi = [orders[i], row, col, scale * circle.radius, angle], float(spread[i] / sigma)
        error = float(errors[i])
        fits.append(disc_image(shot, place, circle.radius, spread=error, chi=chi, view=view))
    return tuple(fits)


@dataclass(frozen=True)
class OrdersFit:
    """Every image's centre order (n,), the first's as it was given; `place`: the loads' angle, the
    disc's scale, z and x (4,); `rest` (n, m) and its `jacobian` (n, m, n + 3) by the orders but the
    first, then the place.
    """

    orders: Array
    place: Array
    rest: Array
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
    result = least_squares(
        left, start, x_scale=size, bounds=(start - room, start + room), ftol=ENOUGH, xtol=ENOUGH
    )
    orders = np.concatenate([first[:1], result.x[: count - 1]])
    residual, jacobian = result.fun.reshape(count, -1), result.jac.reshape(count, -1, start.size)
    return OrdersFit(orders, result.x[count - 1 :], residual, jacobian)


def _centre_order(images: Overlay, waves: Array, bright: bool) -> float:
    """Order at the centre beside N_i, from the phase: I ~ -cos 2 pi (h N_i + n) in a dark field."""
    near = np.hypot(images.grid.cols, images.grid.rows)[images.used] < 0.1
    a, b = waves[:, near].sum(axis=1) * (-1.0 if bright else 1.0)
    return float(np.arctan2(b, -a) / (2.0 * np.pi))


BEYOND = 1.5
"""Times the largest known load up to which a load is looked for."""

STEP = 0.02
"""Fringes at the centre between the loads that are tried."""

TOLD = 0.3
"""Share of a frame's variation that the known loads must explain at the least."""

APART, CLEARER = 0.5, 0.8
"""Another load, so many fringes away, must leave more: the best leaves less than this of it."""

STRIPS_ACROSS, STRIPS_ALONG = 4, 4
"""Blocks of the disc that are left out one after another."""


@dataclass(frozen=True)
class LoadSeries:
    """Frames of known loads laid over each other on the unit disc, and their numbers in the set."""

    images: Overlay
    numbers: tuple[int, ...]


@dataclass(frozen=True)
class LoadReading:
    """A load that was read."""

    load_n: float
    standard_uncertainty: float  # N: the frame's own, and how well the known loads agree
    explained: float  # share of the frame's variation that the known loads explain
    chi: float  # what they leave over the frame's noise
    rim: Circle  # the disc's outline
    beyond: float  # how far it is outside of the known loads, over their range; 0 inside


def lay_series(shots: Sequence[Shot], numbers: Sequence[int]) -> LoadSeries:
    """Lay numbered frames of known loads over each other; PhysicsError where no disc is seen."""
    return LoadSeries(overlay(shots, [find_rim(shot) for shot in shots]), tuple(numbers))


def read_load(series: LoadSeries, shot: Shot, number: int) -> LoadReading:
    """Read the load of a frame against the frames of known loads, itself left out of them.

    All orders N_i are fitted with a, b, c free at every pixel; the line N = k P + N0 gives (N -
    N0)/k. u² = u_J² + s² (1 + wᵀ w) (n - 2)/(n - 4)/k²: u_J by `jackknife_variance` over blocks of
    the disc, s the n known loads' scatter about the line, w their weights in it there; Student's t:
    Gelman et al. (2013), Bayesian Data Analysis, 3.2. PhysicsError: no disc, under five loads.
    """
    others = [i for i, other in enumerate(series.numbers) if other != number]
    known = Overlay(series.images.stack[others], series.images.grid, series.images.loads[others])
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
    load, spread = _on_line(known.loads, fit, _without_blocks(both, fit))
    light = frame.stack[0][frame.used]
    predicted = _prediction(known, fit.orders[:-1], fit.place)(float(fit.orders[-1]))
    residual = float(np.mean((light - predicted) ** 2))
    low, high = known.loads.min(), known.loads.max()
    return LoadReading(
        load_n=load, standard_uncertainty=spread, explained=float(1.0 - residual / np.var(light)),
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

    def light(order: float, constant: Array | float = 0.0) -> Array:
        phase = 2.0 * np.pi * order * field
        return np.asarray(constant + cosine * np.cos(phase) + sine * np.sin(phase))

    return partial(light, constant=np.mean(data - [light(n) for n in orders], axis=0))


def _without_blocks(images: Overlay, fit: OrdersFit) -> Array:
    """How the orders (B, n) move where one block of the disc after another is left out.

    To first order in what is left out; the first image's order is held.
    """
    used = images.used
    x, z = (
        np.broadcast_to(places, used.shape)[used] for places in (images.grid.cols, images.grid.rows)
    )
    block = _strip(x, STRIPS_ACROSS) * STRIPS_ALONG + _strip(z, STRIPS_ALONG)
    grams, pulls = [], []
    for b in np.unique(block):
        rows = fit.jacobian[:, block == b].reshape(-1, fit.jacobian.shape[-1])
        grams.append(rows.T @ rows)
        pulls.append(rows.T @ fit.rest[:, block == b].ravel())
    total, pull = np.sum(grams, axis=0), np.sum(pulls, axis=0)
    count = len(fit.orders)
    moved = np.zeros((len(grams), count))
    for i, (gram, one) in enumerate(zip(grams, pulls, strict=True)):
        moved[i, 1:] = -np.linalg.solve(total - gram, pull - one)[: count - 1]
    return moved


def _strip(place: Array, count: int) -> NDArray[np.intp]:
    """The number of the strip of equal width in which each place (m,) lies."""
    edges = np.linspace(place.min(), place.max(), count + 1)[1:-1]
    return np.searchsorted(edges, place)


def _on_line(loads: Array, fit: OrdersFit, moved: Array) -> tuple[float, float]:
    """The last image's load by the line of the others' orders, and its standard uncertainty (N)."""
    design = np.stack([loads, np.ones_like(loads)], axis=1)
    inverse = np.linalg.pinv(design)
    slope, intercept = inverse @ fit.orders[:-1]
    load = float((fit.orders[-1] - intercept) / slope)
    weights = np.array([load, 1.0]) @ inverse
    free = len(loads) - 2
    scatter = np.sum((fit.orders[:-1] - design @ (slope, intercept)) ** 2) / free
    variance = float(jackknife_variance(moved @ np.append(-weights, 1.0)))
    variance += scatter * (1.0 + weights @ weights) * free / (free - 2)
    return load, float(np.sqrt(variance) / abs(slope))
