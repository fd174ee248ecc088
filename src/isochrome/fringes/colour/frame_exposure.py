r"""How long a colour frame was exposed against its no-load frames, from its own colours.

A frame's light is I_c = e (D_c + A_c s_c(N)), with the background D and the contrast A of the
no-load frames and one factor e: another exposure, gain or lamp. Three channels share one unknown
order, so that two equations a pixel are left for e: with a wrong one the colours are none of the
table's. Where orders are low all channels go as N², and a longer exposure looks like a higher
order: e is then as uncertain as the table's own error makes it, and the order with it.
Source of the projection that leaves every pixel its own order: Golub & Pereyra (1973), SIAM J.
Numer. Anal. 10, 413.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isochrome.fringes.colour.colour_branch import candidate_orders, choose_orders
from isochrome.fringes.colour.colour_table import ColourTable
from isochrome.fringes.windows import Array, Mask, block_means, valid_means

EXPECTED = 0.5
"""Standard deviation of ln e before anything is known: exposures of 1 : 2.6 are two of these."""

UNTOLD = 0.1
"""Standard uncertainty of ln e from which on a frame does not tell its exposure."""

_SURE = 2.0
_LEAST = 0.02
_BLOCKS = 1_500
_FEWEST = 50
_TRIALS = np.exp(np.arange(-1.5, 1.51, 0.1))
_STARTS = 3
_ROUNDS = 8
_REST = 1e-3
_ERROR = 0.003  # of a table, of full light, that neighbouring orders share
_DOUBT = 0.003
_FARTHEST = 25.0
_LOWEST = 0.15
"""Order below which colours of one hue say nothing of the exposure but through noise."""

_FITS, _AS_WELL = 4.0, 0.5
_LEAST_SLOPE = 0.5
_ROUGH = 20.0


@dataclass(frozen=True)
class FrameExposure:
    """A frame's exposure over that of its no-load frames."""

    factor: float = 1.0  # e; 1 where the colours do not speak against it
    uncertainty: float = 0.0  # standard, of ln e

    @property
    def told(self) -> bool:
        """Whether the frame's colours tell it."""
        return self.uncertainty < UNTOLD

    def order_variance(self, signal: Array, table: ColourTable, order: Array) -> Array:
        """Variance that it leaves the order (...,), fringes²: (u Σ s s'/Σ s'²)².

        Parameters: `signal` s (..., channels); `table`, for the slope s'; `order` (...,).
        """
        if not self.uncertainty:
            return np.zeros(order.shape)
        known = np.isfinite(signal) & np.isfinite(order)[..., None]
        slope = np.where(known, table.slope[table.place(np.nan_to_num(order))], 0.0)
        size = np.sum(slope**2, axis=-1)
        rate = np.sum(slope * np.where(known, signal, 0.0), axis=-1) / (size + _LEAST_SLOPE**2)
        return np.asarray((self.uncertainty * rate) ** 2)


@dataclass(frozen=True)
class _Blocks:
    """A frame in blocks: light I and background D over the contrast A, and the light's noise."""

    light: Array
    dark: Array
    noise: Array

    def signal(self, factor: float) -> Array:
        return self.light / factor - self.dark

    def variance(self, factor: float, table: ColourTable) -> Array:
        return np.asarray((self.noise / factor) ** 2 + table.spread**2 + _DOUBT**2)


@dataclass(frozen=True)
class _End:
    """Where a search rests: the `factor` e and the uncertainty `spread` of ln e.

    `misfit` of the colours, chi²; the `cost` adds -2 ln of the noise's own share of the likelihood
    and what the order's changes from block to block cost; `highest`, the order that a fiftieth of
    the blocks pass.
    """

    misfit: float
    cost: float
    highest: float
    factor: float
    spread: float


def find_exposure(
    light: Array, table: ColourTable, *, sigma: Array, dark: Array, bright: Array, valid: Mask
) -> FrameExposure:
    """Find a frame's exposure over that of both its no-load frames.

    Parameters: `light`, `sigma`, its noise, `dark`, `bright`, the no-load frames, and `valid`, all
    (rows, cols, channels); `table`. Returns a FrameExposure.
    """
    small = _in_blocks(light, sigma, dark, bright, valid)
    count = int(np.isfinite(small.light).all(axis=-1).sum())
    if count < _FEWEST:
        return FrameExposure(1.0, EXPECTED)
    alike, _ = _at(small, table, 1.0)
    if alike.highest < _LOWEST:
        return FrameExposure(1.0, EXPECTED)
    best = _rested(small, table, 1.0)
    if best.misfit > _FITS * count:  # no order gives these colours: it began too far away
        starts = _starts(small, table)
        best = min((best, *(_rested(small, table, s) for s in starts)), key=lambda end: end.cost)
    spread = best.spread
    as_well = alike.cost - best.cost < _AS_WELL * count
    if as_well:
        # low orders look like higher ones of a shorter exposure, and these seem to tell it
        spread = max(spread, alike.spread)
    spread = float((spread**-2 + EXPECTED**-2) ** -0.5)
    away = abs(np.log(best.factor))
    same = away < _LEAST or (as_well and away < _SURE * spread)
    return FrameExposure(1.0 if same else best.factor, spread)


def _in_blocks(light: Array, sigma: Array, dark: Array, bright: Array, valid: Mask) -> _Blocks:
    """Small blocks on a lattice: as few as serve, and none so wide that it blurs a fringe."""
    by = 2 if valid[..., 0].size > 4 * _BLOCKS else 1
    every = max(1, round(np.sqrt(valid[..., 0].size / by**2 / _BLOCKS)))
    share = block_means(valid.astype(float), by)[::every, ::every]
    mean, low, high, noise = (
        valid_means(part, valid, by)[::every, ::every] for part in (light, dark, bright, sigma)
    )
    contrast = np.where((share > 0.5) & (high > low), high - low, np.nan)
    return _Blocks(mean / contrast, low / contrast, noise / by / contrast)


def _starts(small: _Blocks, table: ColourTable) -> list[float]:
    """Factors at which the blocks' colours, each by itself, are nearest to the table's."""
    cost = []
    for factor in _TRIALS:
        signal = small.signal(factor)
        known = np.isfinite(signal).all(axis=-1)
        weight = 1.0 / small.variance(factor, table)[known]
        _, misfit = candidate_orders(signal[known], weight, table)
        cost.append(np.minimum(misfit[:, 0], _FARTHEST).sum())
    around = np.pad(cost, 1, constant_values=np.inf)
    low = np.flatnonzero((around[1:-1] <= around[:-2]) & (around[1:-1] <= around[2:]))
    return [float(_TRIALS[i]) for i in sorted(low, key=lambda i: cost[i])[:_STARTS]]


def _rested(small: _Blocks, table: ColourTable, factor: float) -> _End:
    """The factor at which a search from a start comes to rest."""
    for _ in range(_ROUNDS):
        end, step = _at(small, table, factor)
        if abs(step) < _REST:
            break
        factor = float(np.clip(factor * np.exp(np.clip(step, -0.3, 0.3)), *_TRIALS[[0, -1]]))
    return end


def _at(small: _Blocks, table: ColourTable, factor: float) -> tuple[_End, float]:
    """How well a factor fits, and the change of its logarithm that would fit better."""
    signal, variance = small.signal(factor), small.variance(factor, table)
    choice = choose_orders(signal.astype(np.float32), variance.astype(np.float32), table)
    step, spread = _step(signal, variance, choice.order, choice.misfit, table)
    rough = sum(
        float(np.nansum(np.minimum(np.abs(np.diff(choice.order, axis=axis)), 1.0)))
        for axis in (0, 1)
    )
    misfit = float(np.nansum(np.minimum(choice.misfit, _FARTHEST)))
    # of the two equations a block: else a shorter exposure, with more noise, would fit better
    whole = variance[np.isfinite(variance).all(axis=-1)]
    noise = 2.0 * float(np.log(factor**2 * whole).mean(axis=-1).sum())
    highest = float(np.nanpercentile(choice.order, 98.0))
    return _End(misfit, misfit + noise + _ROUGH * rough, highest, factor, spread), step


def _step(
    signal: Array, variance: Array, order: Array, misfit: Array, table: ColourTable
) -> tuple[float, float]:
    """Change of ln e with every block's order free, and its standard uncertainty.

    The background says nothing here: what does not grow with the exposure (a sensor's offset)
    stands in it too.
    """
    inside = np.isfinite(signal).all(axis=-1) & (misfit < _FARTHEST)
    if not inside.any():
        return 0.0, EXPECTED
    place = table.place(order[inside])
    root = 1.0 / np.sqrt(variance[inside])
    along = root * table.slope[place]
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)

    def across(part: Array) -> Array:
        return np.asarray(part - unit * np.sum(unit * part, axis=1, keepdims=True))

    column = across(root * table.signal[place])
    left = across(root * (signal[inside] - table.signal[place]))
    size = np.sum(left**2, axis=1)
    usual = max(float(np.median(size)), 1e-12)
    weight = (1.0 / (1.0 + (size / (9.0 * usual)) ** 2))[:, None]
    information = float(np.sum(weight * column**2)) + EXPECTED**-2
    shared = np.hypot(_ERROR, 0.5 * float(table.spread.max()))
    by_table = shared * float(np.sum(weight * np.abs(column) * root)) / information
    return float(np.sum(weight * column * left)) / information, float(
        np.hypot(information**-0.5, by_table)
    )
