"""A disc's load, read against frames of known loads: whatever stress the disc already holds.

Frozen stress bends the fringes of a disc so that its closed form describes no single frame. But it
is the same in all of them: under the load P a pixel sees
I = c + a cos(2 pi k h P) + b sin(2 pi k h P), h the disc's own field over its centre value, and a,
b, c are told by frames of known loads, pixel by pixel (see `order_slope`). So is the rise k of the
centre's order with the load, and one more frame has one unknown, its load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.disc.disc_field import Circle, find_rim
from isochrome.calibration.disc.order_slope import (
    FEWEST_LOADS,
    OrdersFit,
    Overlay,
    Rise,
    fit_orders,
    overlay,
    pixel_waves,
    rise_with_load,
)
from isochrome.calibration.shot import Shot
from isochrome.errors import PhysicsError
from isochrome.estimation import jackknife_variance

Array = NDArray[np.float64]

BEYOND = 1.5
"""Times the largest known load up to which a load is looked for."""

STEP = 0.02
"""Fringes at the centre between the loads that are tried."""

TOLD = 0.3
"""Share of a frame's variation that the known loads must explain at the least."""

APART, CLEARER = 0.5, 0.8
"""Another load, so many fringes away, must leave more: the best leaves less than this of it."""

ACROSS, ALONG = 4, 4
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
    predicted = _Prediction.of(known, fit.orders[:-1], fit.place).light(float(fit.orders[-1]))
    residual = float(np.mean((light - predicted) ** 2))
    low, high = known.loads.min(), known.loads.max()
    return LoadReading(
        load_n=load,
        standard_uncertainty=spread,
        explained=float(1.0 - residual / np.var(light)),
        chi=float(np.sqrt(residual) / np.median(shot.sigma)),
        rim=rim,
        beyond=max(0.0, low - load, load - high) / float(high - low),
    )


def _coarse(known: Overlay, frame: Overlay, rise: Rise, name: str) -> float:
    """The centre order with which the known frames predict this one best (fringes)."""
    predict = _Prediction.of(known, rise.slope * known.loads, np.array([rise.angle, 1.0, 0.0, 0.0]))
    light = frame.stack[0][frame.used]
    tried = np.arange(STEP, BEYOND * rise.slope * known.loads.max(), STEP)
    residual = np.array([np.mean((light - predict.light(order)) ** 2) for order in tried])
    best = int(np.argmin(residual))
    away = np.abs(tried - tried[best]) > APART
    lowest = (residual < np.roll(residual, 1)) & (residual < np.roll(residual, -1)) & away
    explained = 1.0 - residual[best] / np.var(light)
    if explained < TOLD or np.any(residual[lowest] * CLEARER < residual[best]):
        raise PhysicsError(
            "frames_known_loads_explain", name=name, explained=100 * max(0.0, explained)
        )
    return float(tried[best])


@dataclass(frozen=True)
class _Prediction:
    """What frames of known loads make of another: the constant c, and a, b, and h of each pixel."""

    constant: Array
    waves: Array
    field: Array

    @classmethod
    def of(cls, known: Overlay, orders: Array, place: Array) -> _Prediction:
        """Parameters: `known` (n,); their `orders` (n,); `place`, see `fit_orders`."""
        used, field = known.used, known.field(*place)[known.used]
        data = known.stack[:, used]
        waves = pixel_waves(data, orders, field)[1]
        bare = cls(np.zeros_like(field), waves, field)
        return replace(bare, constant=np.mean(data - [bare.light(n) for n in orders], axis=0))

    def light(self, order: float) -> Array:
        """The light (m,) of a frame whose order at the centre is `order`."""
        phase = 2.0 * np.pi * order * self.field
        return np.asarray(
            self.constant + self.waves[0] * np.cos(phase) + self.waves[1] * np.sin(phase)
        )


def _without_blocks(images: Overlay, fit: OrdersFit) -> Array:
    """How the orders (B, n) move where one block of the disc after another is left out.

    To first order in what is left out; the first image's order is held.
    """
    used = images.used
    x, z = (
        np.broadcast_to(places, used.shape)[used] for places in (images.grid.cols, images.grid.rows)
    )
    block = _strip(x, ACROSS) * ALONG + _strip(z, ALONG)
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
