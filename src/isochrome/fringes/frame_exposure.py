"""How long a colour frame was exposed against its no-load frames, from its own colours.

A frame's light is I_c = e (D_c + A_c s_c(N)), with the background D and the contrast A of the
no-load frames and one factor e: another exposure, gain or lamp. Three channels share one unknown
order, so that two equations a pixel are left for e: with a wrong one the colours are none of the
table's. Where orders are low all channels go as N², and a longer exposure looks like a higher
order: e is then as uncertain as the table's own error makes it, and the order with it.
Source of the projection that leaves every pixel its own order: Golub & Pereyra (1973), SIAM J.
Numer. Anal. 10, 413.

Illumination and background of a colour frame, found from the frame itself.

With no-load frames nothing of this is needed. Without: orders are looked up with a first guess of
the background D (a number a channel) and the contrast A (a smooth surface a channel), and both
are corrected by least squares on I_c = D_c + A_c s_c(N) in which each pixel's own order is free
(its direction dI/dN is projected out), then orders are looked up again, and so on. The first
rounds allow for a poor guess in the misfit that the choice of orders reckons with. What the frame
cannot tell (a frame of low orders says little of A) is then seen in the covariance.
Source of the projection: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import channel_light
from isochrome.fringes.colour_table import ColourTable, candidate_orders, choose_orders
from isochrome.fringes.windows import Array, Mask, block_means, nearest_known, valid_means

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
        """Variance that it leaves the order (...,), fringes²: (u Σ s s'/Σ s'²)² with the table's
        slope s'.
        """
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
    """Find a frame's exposure over that of both its no-load frames."""
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
    as_well = alike.cost - best.cost < _AS_WELL * count
    # low orders look like higher ones of a shorter exposure, and these seem to tell it
    spread = max(best.spread, alike.spread) if as_well else best.spread
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
    changes = (np.abs(np.diff(choice.order, axis=axis)) for axis in (0, 1))
    rough = sum(float(np.nansum(np.minimum(change, 1.0))) for change in changes)
    misfit = float(np.nansum(np.minimum(choice.misfit, _FARTHEST)))
    # of the two equations a block: else a shorter exposure, with more noise, would fit better
    complete = variance[np.isfinite(variance).all(axis=-1)]
    noise = 2.0 * float(np.log(factor**2 * complete).mean(axis=-1).sum())
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
    residual = across(root * (signal[inside] - table.signal[place]))
    size = np.sum(residual**2, axis=1)
    weight = (1.0 / (1.0 + (size / (9.0 * max(float(np.median(size)), 1e-12))) ** 2))[:, None]
    information = float(np.sum(weight * column**2)) + EXPECTED**-2
    shared = np.hypot(_ERROR, 0.5 * float(table.spread.max()))
    by_table = shared * float(np.sum(weight * np.abs(column) * root)) / information
    step = float(np.sum(weight * column * residual)) / information
    return step, float(np.hypot(information**-0.5, by_table))


BLOCKS = 12_000
"""Blocks of pixels that the search works on, about."""

DOUBTS = (0.12, 0.12, 0.08, 0.05, 0.03, 0.015, 0.006, 0.006)
"""How far the ends are taken to be off in each round, of full light."""

UNEVEN = 0.3
"""Expected size of a surface's terms over its mean."""

UNLIKE = 0.1
"""Expected difference of two channels' surfaces, over their means."""

BACKGROUND_OFF = 0.05
"""Expected error of the background's first guess, of full light."""

COLOURFUL = 0.2
"""Contrast with white, of full light, of the orders that the fit is made on: what is white in the
frame might be white of any order."""

_FARTHEST_COLOUR = 20.0
_MEDIAN_OF_TWO = 1.386  # of chi² with two degrees of freedom


@dataclass(frozen=True)
class _Small:
    """The frame in blocks: `light`, its `noise`, the no-load frames `low` and `full` (rows, cols,
    channels), blocks with `enough` trusted pixels, and the `surface` terms (terms, rows, cols).
    """

    light: Array
    noise: Array
    low: Array | None
    full: Array | None
    enough: Mask
    surface: Array

    def ends(self, theta: Array) -> tuple[Array, Array]:
        """Background and contrast (rows, cols, channels) of the unknowns."""
        shape, frame_part = self.parts(theta)
        low = np.broadcast_to(frame_part, self.light.shape) if self.low is None else self.low
        return low, self.full - low if self.full is not None else spread_out(shape, self.surface)

    def parts(self, theta: Array) -> tuple[Array, Array]:
        """The surfaces' coefficients (channels, terms), and the backgrounds (channels,)."""
        channels = self.light.shape[2]
        terms = len(self.surface)
        size = channels * terms if self.full is None else 0
        return theta[:size].reshape(-1, terms), theta[size:]

    def design(self, ideal: Array, inside: Mask) -> Array:
        """dI/dtheta (pixels, channels, unknowns) where the table's signal is `ideal`."""
        columns = []
        one = np.eye(ideal.shape[1])
        if self.full is None:
            terms = self.surface[:, inside].T
            block = ideal[:, :, None, None] * one[:, :, None] * terms[:, None, None, :]
            columns.append(block.reshape(*ideal.shape, -1))
        if self.low is None:
            share = np.ones_like(ideal) if self.full is None else 1.0 - ideal
            columns.append(share[:, :, None] * one)
        return np.concatenate(columns, axis=2)


def find_ends(
    light: Array,
    table: ColourTable,
    *,
    sigma: Array,
    dark: Array | None,
    bright: Array | None,
    valid: Mask,
) -> tuple[Array, Array, Array]:
    """Background D and contrast A of every pixel and channel from a loaded frame.

    It is (rows, cols, channels); the third is the variance (rows, cols), fringes², that their
    uncertainty gives to the order. `sigma` is the light's noise; `dark`, `bright` the no-load
    frames that there are. InputError where nothing has contrast, or no colour is the table's.
    """
    factor = max(1, int(np.sqrt(valid[..., 0].size / BLOCKS)))
    mean = partial(valid_means, valid=valid, by=factor)
    low, full = (None if frame is None else mean(frame) for frame in (dark, bright))
    enough = block_means(valid.astype(float), factor) > 0.5
    surface = channel_light(*enough.shape[:2])
    small = _Small(mean(light), mean(sigma) / factor, low, full, enough, surface)
    first = _first_guess(small, table)
    theta, hold = first, _prior(first, small)
    colourful = table.highest_of(COLOURFUL)
    for doubt in DOUBTS:
        low, contrast = small.ends(theta)
        usable = small.enough & (contrast > 0.0)
        over = np.where(usable, contrast, 1.0)
        signal = np.where(usable, (small.light - low) / over, np.nan)
        off = doubt * (0.3 + np.clip(np.nan_to_num(signal), 0.0, 1.2))
        variance = (small.noise / over) ** 2 + off**2 + table.spread**2
        choice = choose_orders(signal, variance, table)
        inside = (choice.order < colourful) & (choice.misfit < _FARTHEST_COLOUR)
        inside &= table.coloured(signal, COLOURFUL)
        if np.count_nonzero(inside) < 100:
            raise InputError("frame_colours_not_table")
        place = table.place(choice.order[inside])
        ideal, slope = table.signal[place], table.slope[place]
        root = np.where(usable, 1.0 / (over * np.sqrt(variance)), 0.0)[inside]
        residual = root * (small.light[inside] - low[inside] - contrast[inside] * ideal)
        design = root[:, :, None] * small.design(ideal, inside)
        along = root * over[inside] * slope
        change, covariance = correction(design, residual, along, hold, first - theta)
        theta = theta + change
    rate = np.einsum("pc,pcn->pn", along, design)
    rate /= np.sum(along**2 + (root * over[inside] * _LEAST_SLOPE) ** 2, axis=1)[:, None]
    spread = np.einsum("pn,nm,pm->p", rate, covariance, rate)
    averaged = replace(
        small, light=light, low=dark, full=bright, surface=channel_light(*light.shape[:2])
    )
    known = np.full(inside.shape, np.nan)
    known[inside] = spread
    sizes = zip(light.shape[:2], inside.shape, strict=True)
    grid = np.ix_(*(np.arange(n) * m // n for n, m in sizes))
    return *averaged.ends(theta), nearest_known(known, inside)[grid]


def _first_guess(small: _Small, table: ColourTable) -> Array:
    """The unknowns from the darkest and the brightest places of each channel."""
    if not small.enough.any(axis=(0, 1)).all():
        raise InputError("channel_saturated_masked_all")
    trusted = np.where(small.enough, small.light, np.nan)
    lowest, highest = np.nanpercentile(trusted, (0.5, 99.5), axis=(0, 1))
    background = lowest if small.low is None else np.median(small.low, axis=(0, 1))
    gain = (highest - background) / (table.signal.max(axis=0) - table.signal.min(axis=0))
    if not (gain > 0.0).all():
        raise InputError("frame_shows_no_fringes_normalise")
    shape = np.zeros((len(gain), len(small.surface)))
    shape[:, 0] = 0.9 * gain
    parts = ((small.full, shape.ravel()), (small.low, lowest))
    return np.concatenate([part for given, part in parts if given is None])


def _prior(first: Array, small: _Small) -> Array:
    """What is expected of the unknowns before the fit, as a matrix of normal equations."""
    shape, frame_part = small.parts(first)
    unit = np.eye(len(first))
    rows = []
    terms = len(small.surface)
    for c, size in enumerate(shape[:, 0]):
        for here in range(c * terms + 1, (c + 1) * terms):
            rows.append(unit[here] / (UNEVEN * size))
            if c + 1 < len(shape):
                other = unit[here + terms] / (UNLIKE * shape[c + 1, 0])
                rows.append(unit[here] / (UNLIKE * size) - other)
    rows += [unit[shape.size + c] / BACKGROUND_OFF for c in range(len(frame_part))]
    expected = np.array(rows)
    return np.asarray(expected.T @ expected)


def correction(
    design: Array, residual: Array, along: Array, hold: Array, back: Array
) -> tuple[Array, Array]:
    """Change of the unknowns with every pixel's order free, and their covariance.

    Parameters, all weighted by 1/sigma: `design` (pixels, channels, unknowns), `residual` and
    `along`, dI/dN (pixels, channels); `hold`, the prior's normal equations; `back`, from the
    unknowns to the prior's own.
    """
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    flat = design - unit[:, :, None] * np.einsum("pc,pcn->pn", unit, design)[:, None, :]
    across_unit = residual - unit * np.sum(unit * residual, axis=1, keepdims=True)
    size = np.sum(across_unit**2, axis=1)
    usual = max(float(np.median(size)), 1e-12)
    weight = 1.0 / (1.0 + (size / (9.0 * usual)) ** 2)
    normal = np.einsum("p,pcn,pcm->nm", weight, flat, flat, optimize=True) + hold
    right = np.einsum("p,pcn,pc->n", weight, flat, across_unit) + hold @ back
    scale = max(1.0, usual / _MEDIAN_OF_TWO)
    inverse = np.linalg.inv(normal)
    return inverse @ right, scale * inverse


def spread_out(shape: Array, surface: Array) -> Array:
    """Surfaces (rows, cols, channels) of coefficients (channels, k) over terms (k, rows, cols)."""
    return np.moveaxis(np.tensordot(shape, surface, axes=1), 0, -1)
