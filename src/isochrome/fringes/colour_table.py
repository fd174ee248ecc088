"""The calibration table of colour photoelasticity: the channels' signals against fringe order.

The table comes from the forward model's spectrum, from a specimen whose order is known at every
pixel, such as a beam in bending, where it is linear over the height, or, for light that nobody
measured, from a few numbers. Each channel's light is then a band that is Gaussian over the
wavelength, and the channels are mixed by the camera (crosstalk, and the camera's own colour
correction, which is negative):

    s_k(N) = ∫ g(e) (1 - cos(2 pi N r_k/(1 + b_k e))) de / 2,   t_c(N) = Σ_k M_ck s_k(N) >= 0

with g the normal distribution, r_k = l0/l_k the ratio of the reference to the band's centre, b_k
its relative width, and the rows of M of sum 1. N counts at the green band's centre: r_green = 1.

Which order each pixel's colour stands for: a colour that noise has moved may lie near the table at
several orders. Each pixel keeps all of them; the choice is the surface that costs least in misfit
and in jumps from pixel to pixel, which is found along rows and columns in both directions and
summed.
Sources: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis 30, 29, for the integral over the
band; Hirschmüller (2008), IEEE TPAMI 30, 328, for the summed scan lines.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import correlate1d

from isochrome.errors import InputError
from isochrome.estimation import STEP as DIFFERENCE
from isochrome.frames import CHANNELS
from isochrome.fringes.windows import Array, Indices, Mask
from isochrome.messages import message
from isochrome.optics import Response, make_chain, make_light, spectral_signal
from isochrome.output import check_given_table, read_csv
from isochrome.scene import Polariscope

STEP = 1.0 / 256.0
"""Of a table over N: straight pieces hold cos 2 pi k N to (2 pi k/256)²/16, 9e-5 at k = 1.5."""
LOWEST_CONTRAST = 0.02
"""Contrast of the fringes, of full light, below which a table ends: all colours are white there."""
LARGEST_ORDER = 12.0
"""Where a table ends at the latest: separate lines never lose their contrast."""
_DIRECTIONS = 16
WIDTH = 0.02
"""Standard deviation of the Gaussian over which a measured table is pooled, fringes."""


@dataclass(frozen=True)
class ColourTable:
    """Signals of the channels at N = 0, 1/256, 2/256, ..., 1 = full light."""

    signal: Array  # (orders, channels)
    # (channels,): deviation at one order from what is not the order (the direction of sigma_1
    # between real plates; the scatter of a measured table)
    spread: Array

    @property
    def highest(self) -> float:
        """The order at the table's end."""
        return STEP * (len(self.signal) - 1)

    @property
    def order(self) -> Array:
        """The orders (n,) of the table."""
        return STEP * np.arange(len(self.signal))

    @property
    def white(self) -> Array | None:
        """The signals (channels,) of all higher orders, None where the table ends before that."""
        tail = self.signal[-int(1.0 / STEP) :]
        faded = np.ptp(tail, axis=0).max() < 4.0 * LOWEST_CONTRAST
        return tail.mean(axis=0) if faded else None

    def highest_of(self, contrast: float) -> float:
        """The order up to which fringes stand out from white by `contrast`, of full light."""
        if self.white is None:
            return self.highest
        away = np.abs(self.signal - self.white).max(axis=1)
        return STEP * float(np.flatnonzero(away >= contrast)[-1])

    def place(self, order: Array) -> Indices:
        """Rows of the table that are nearest to orders (fringes)."""
        return np.clip(np.rint(order / STEP), 0, len(self.signal) - 1).astype(np.intp)

    @property
    def slope(self) -> Array:
        """ds/dN (orders, channels), by central differences; 0 at N = 0, where s is even."""
        slope = np.gradient(self.signal, STEP, axis=0)
        slope[0] = 0.0
        return slope

    @property
    def bend(self) -> Array:
        """d²s/dN² (orders, channels)."""
        return np.gradient(self.slope, STEP, axis=0)


def spectral_table(polariscope: Polariscope, response: Response) -> ColourTable:
    """The table from the spectrum of the light, Σ_s w_cs I(N l0/l_s), and the mean over directions.
    It ends where the last contrast is 2 % of full light, at N = 12 at the latest. InputError for a
    blind channel."""
    order = STEP * np.arange(int(np.ceil(LARGEST_ORDER / STEP)) + 1)
    light = make_light(polariscope, response, highest_order=LARGEST_ORDER)
    chains = [make_chain(polariscope, wavelength_nm=float(w)) for w in light.wavelength_nm]
    ideal = all(chain.ideal for chain in chains)
    turn = np.zeros(1) if ideal else np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    orders, turns = np.broadcast_arrays(order[None, :], turn[:, None])
    reference, turned = polariscope.wavelength_nm, None if ideal else turns
    assert reference is not None
    signals = spectral_signal(
        orders.copy(), light, chains, reference_nm=reference, direction=turned
    )
    table, spread = signals.mean(axis=0), np.sqrt(signals.var(axis=0).mean(axis=0))
    return ColourTable(table[: end_of_contrast(table)], spread)


def end_of_contrast(table: Array) -> int:
    """Rows of a table up to where its last fringe in any channel has faded."""
    away = np.abs(table - table[-int(1.0 / STEP) :].mean(axis=0)).max(axis=1)
    return int(min(np.flatnonzero(away > 0.5 * LOWEST_CONTRAST)[-1] + 2, len(table)))


def measured_table(signal: Array, order: Array) -> ColourTable:
    """The table, up to the highest order seen, from a normalised image whose order is known. Around
    each order a straight line is fitted to the pixels near it, weighted by a Gaussian in order of
    0.02 fringe, so that neither a slope nor uneven sampling shifts it. NaN: not trusted, not known.
    InputError where the orders have gaps, or do not begin at 0."""
    known = np.isfinite(order) & np.isfinite(signal).all(axis=-1)
    n, s = order[known].astype(float), signal[known].astype(float)
    if len(n) < 100 or n.min() > WIDTH:
        raise InputError("colour_table_needs_pixels")
    cell = np.rint(n / STEP).astype(int)
    offset = n - STEP * cell
    sums = [
        np.bincount(cell, weights=w, minlength=cell.max() + 1)
        for w in (np.ones_like(n), offset, *s.T, *(s * offset[:, None]).T)
    ]
    number, offsets = sums[:2]
    plain, turned = np.split(np.array(sums[2:]), 2)  # the signals, and these times the offsets
    half = int(np.ceil(4.0 * WIDTH / STEP))
    away = STEP * np.arange(-half, half + 1)
    bell = np.exp(-0.5 * (away / WIDTH) ** 2)
    summed = partial(correlate1d, axis=-1, mode="constant")
    # the mirror image at N < 0 is not used: a line is unbiased at the end too
    m0 = summed(number, bell)
    m1 = summed(number, bell * away) + summed(offsets, bell)
    m2 = summed(number, bell * away**2) + 2.0 * summed(offsets, bell * away)
    if m0.min() < 3.0:
        raise InputError("colour_table_needs_pixels_every", where=STEP * int(np.argmin(m0)))
    t1 = summed(plain, bell * away) + summed(turned, bell)
    lines = ((m2 * summed(plain, bell) - m1 * t1) / np.maximum(m0 * m2 - m1**2, 1e-30)).T
    return ColourTable(np.asarray(lines), np.zeros(s.shape[1]))


SPREADS = tuple(f"{name}_spread" for name in CHANNELS)
LARGEST_SIGNAL = 3.0
"""Of full light: a camera that corrects its colours passes 1 where a channel is purest, and where
full light would saturate the frames, 1 stands for less of it."""
_COARSEST = 0.05
_MOST_SPREAD = 0.3


def table_columns(table: ColourTable) -> dict[str, Any]:
    """A table as the columns of its file, the spread repeated in every row; 1 = full light."""
    return {
        "fringe_order": table.order,
        **{name: table.signal[:, c] for c, name in enumerate(CHANNELS)},
        **{name: np.full(len(table.signal), table.spread[c]) for c, name in enumerate(SPREADS)},
    }


def read_table(path: Path) -> ColourTable:
    """Read a colour table, on the steps that it is used with; straight lines lie between its rows.
    Columns fringe_order (from 0, fringes), red, green, blue (1 = full light), and if there are any
    red_spread, green_spread, blue_spread, frames' deviation about it. InputError names what is
    wrong."""
    fix = message("make_isochrome_calibrate_colour")
    if path.exists():
        check_given_table(path, "the colour table")
    columns = read_csv(path)
    missing = [name for name in ("fringe_order", *CHANNELS) if name not in columns]
    if missing:
        raise InputError("frames_colour_table_lacks_columns", path=path, missing=missing, fix=fix)
    try:
        order = np.array(columns["fringe_order"], dtype=float)
        signal = np.array([columns[name] for name in CHANNELS], dtype=float).T
        spread = np.array([columns.get(name, [0.0])[:1] for name in SPREADS], dtype=float).ravel()
    except ValueError as error:
        raise InputError("frames_colour_table_holds_more", path=path, fix=fix) from error
    for fault in _faults(order, signal, spread):
        raise InputError(f"{path}: frames.colour_table" + fault + f"; {fix}")
    places = STEP * np.arange(int(np.floor(order[-1] / STEP + 1e-6)) + 1)
    values = [np.interp(places, order, signal[:, c]) for c in range(len(CHANNELS))]
    return ColourTable(np.stack(values, axis=1), spread)


def _faults(order: Array, signal: Array, spread: Array) -> Iterator[str]:
    """What is wrong with a table, the coarsest fault first."""
    if not (np.isfinite(order).all() and np.isfinite(signal).all() and np.isfinite(spread).all()):
        yield message("has_empty_cells_numbers")
    if len(order) < 2 or abs(order[0]) > 1e-6 or (np.diff(order) <= 0.0).any():
        yield message("fringe_order_must_rise_from")
    coarsest = np.diff(order).max()
    if coarsest > _COARSEST:
        yield message("fringe_order_goes_steps_most", coarsest=coarsest, coarsest_2=_COARSEST)
    if not 0.5 <= order[-1] <= LARGEST_ORDER:
        yield message("ends_allowed", order=order[-1], largest_order=LARGEST_ORDER)
    if signal.min() < -0.2 or signal.max() > LARGEST_SIGNAL:
        yield message("signals_from_full_light", min=signal.min(), max=signal.max())
    if np.ptp(signal, axis=0).min() < 0.1:
        yield message("channel_hardly_changes_order")
    if spread.min() < 0.0 or spread.max() > _MOST_SPREAD:
        yield message("spread_must_from", most_spread=_MOST_SPREAD)


CANDIDATES = 5
COST_OF_SLOPE = 20.0
"""Misfit (chi²) that a fringe from pixel to pixel weighs as much as."""
COST_OF_JUMP = 30.0
FARTHEST = 60.0
"""Misfit, above the best candidate's, beyond which a pixel has no further candidate."""
_EVERY = 8
_BLOCK = 16_384


@dataclass(frozen=True)
class Choice:
    """The chosen order (rows, cols), NaN where the pixel has no trusted channel pair. `misfit`, its
    chi²; `margin`, chi² by which the best other candidate, or the white of higher orders, lies
    above it (negative where the neighbours overruled the pixel)."""

    order: Array
    misfit: Array
    margin: Array


def candidate_orders(signal: Array, weight: Array, table: ColourTable) -> tuple[Array, Array]:
    """Minima of chi² = Σ_c w_c (y_c - s_c(N))², their orders and chi² (n, candidates), best first.
    Infinite where there are fewer; weight 0 where a channel is not to be trusted."""
    coarse = table.signal[::_EVERY]
    step = STEP * _EVERY
    design = np.concatenate([-2.0 * coarse.T, coarse.T**2]).astype(np.float32)
    y = np.where(weight > 0.0, signal, 0.0).astype(np.float32)
    w = weight.astype(np.float32)
    order = np.empty((len(y), CANDIDATES), dtype=np.float32)
    cost = np.empty_like(order)
    for start in range(0, len(y), _BLOCK):
        here = slice(start, start + _BLOCK)
        chi2 = np.concatenate([w[here] * y[here], w[here]], axis=1) @ design
        order[here], cost[here] = _minima(chi2, step)
        cost[here] += np.sum(w[here] * y[here] ** 2, axis=1)[:, None]
    return order, np.maximum(cost, 0.0)


def _minima(chi2: Array, step: float) -> tuple[Array, Array]:
    """The lowest local minima of each row, best first, with their places by a parabola."""
    low = chi2 <= chi2.min(axis=1, keepdims=True) + np.float32(FARTHEST)
    rises = chi2[:, 1:] >= chi2[:, :-1]
    low[:, :-1] &= rises
    low[:, 1:] &= ~rises
    row, col = np.nonzero(low)
    value = chi2[row, col]
    ranks = np.lexsort((value, row))
    row, col, value = row[ranks], col[ranks], value[ranks]
    place = np.arange(len(row)) - np.searchsorted(row, row)
    valid = place < CANDIDATES
    row, col, value, place = row[valid], col[valid], value[valid], place[valid]
    inner = np.clip(col, 1, chi2.shape[1] - 2)
    before, middle, after = (chi2[row, inner + shift] for shift in (-1, 0, 1))
    bend = np.maximum(before - 2.0 * middle + after, 1e-6)
    shift = np.where(col == inner, np.clip(0.5 * (before - after) / bend, -0.5, 0.5), 0.0)
    order = np.zeros((len(chi2), CANDIDATES), dtype=np.float32)
    cost = np.full(order.shape, np.inf, dtype=np.float32)
    order[row, place] = step * (col + shift)
    cost[row, place] = value - 0.5 * bend * shift**2
    return order, cost


def choose_orders(signal: Array, variance: Array, table: ColourTable) -> Choice:
    """Choose an order of each pixel of two trusted channels (not NaN), guided by neighbours."""
    rows, cols, channels = signal.shape
    trusted = np.isfinite(signal)
    weight = np.where(trusted, 1.0 / variance, 0.0).reshape(-1, channels)
    known = trusted.sum(axis=-1) >= 2
    candidates = candidate_orders(np.nan_to_num(signal).reshape(-1, channels), weight, table)
    order, cost = (part.reshape(rows, cols, CANDIDATES) for part in candidates)
    cost[~known] = 0.0  # says nothing, and passes nothing on
    penalty = np.minimum(cost - cost[..., :1], FARTHEST)
    penalty[np.isinf(cost)] = np.float32(1e6)
    total = penalty.copy()
    for axis in (0, 1):
        n, c, k = (np.ascontiguousarray(np.moveaxis(a, axis, 0)) for a in (order, penalty, known))
        total += np.moveaxis(_scan(n, c, k) + _scan(n[::-1], c[::-1], k[::-1])[::-1], 0, axis)
    taken = np.argmin(total, axis=-1)[..., None]
    chosen = np.take_along_axis(order, taken, axis=-1)[..., 0]
    misfit = np.take_along_axis(cost, taken, axis=-1)[..., 0]
    others = cost.copy()
    np.put_along_axis(others, taken, np.inf, axis=-1)
    rival = others.min(axis=-1)
    if table.white is not None:
        away = np.nan_to_num(signal - table.white.astype(np.float32))
        rival = np.minimum(rival, (weight.reshape(signal.shape) * away**2).sum(axis=-1))
    margin = np.minimum(rival - misfit, FARTHEST)
    chosen, misfit = (np.where(known, part, np.nan) for part in (chosen, misfit))
    return Choice(chosen, misfit, np.where(known, margin, 0))


def _scan(order: Array, penalty: Array, known: Mask) -> Array:
    """Least cost of a path along lines that ends at each candidate, from pixels that are known."""
    text = np.zeros_like(penalty)
    for line in range(1, len(penalty)):
        so_far = penalty[line - 1] + text[line - 1]
        jump = np.abs(order[line - 1][:, :, None] - order[line][:, None, :])
        jump *= COST_OF_SLOPE
        np.minimum(jump, COST_OF_JUMP, out=jump)
        jump += so_far[:, :, None]
        best = jump.min(axis=1)
        best -= best.min(axis=1, keepdims=True)
        text[line] = np.where(known[line - 1][:, None], best, 0.0)
    return text


_PLACES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(48)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_OFF_DIAGONAL = np.nonzero(~np.eye(3, dtype=bool))


def _numbers(ratio: Any, width: Any, mixing: Any) -> Array:
    """The 2 ratios, 3 widths and 6 terms of the mixing that describe a light."""
    parts = zip((ratio, width, mixing), (2, 3, 6), strict=True)
    return np.concatenate([np.broadcast_to(part, count) for part, count in parts])


_RATIO, _WIDTH = np.log(540.0 / np.array([600.0, 460.0])), np.log(0.06)
_CORRECTED_MIXING = (-1.5, 0.1, -0.5, -0.15, -0.05, -0.1)
"""That of the sRGB signals of equal-energy light (IEC 61966-2-1)."""
SENSOR = _numbers(_RATIO, _WIDTH, 0.0)
"""Numbers of a bare sensor in equal-energy white light, whose channels do not mix."""
CORRECTED = _numbers(_RATIO, _WIDTH, _CORRECTED_MIXING)
"""Numbers of a camera that corrects its colours for a display (sRGB)."""
LIKELY = _numbers(0.05, 0.4, 0.2)
"""Expected deviations of a light's numbers from one of these."""
NUMBERS = len(LIKELY)
FOUND_ERROR = 0.03
"""How far a found light's signals are taken to be off, of full light."""


@dataclass(frozen=True)
class BandLight:
    """The bands of red, green and blue: the reference over the centre, width over the centre.
    `mixing` (3, 3), rows of sum 1: what each channel takes from each band."""

    ratio: Array
    width: Array
    mixing: Array

    def bands(self, order: Array, *, bright: bool = False) -> Array:
        """Light s (n, 3) of the bands at orders N (n,); `bright`, in the bright field."""
        centres = zip(self.ratio, self.width, strict=True)
        turns = (ratio / np.maximum(1.0 + width * _PLACES, 0.3) for ratio, width in centres)
        waves = [np.cos(2.0 * np.pi * np.outer(order, each)) @ _WEIGHTS for each in turns]
        return np.asarray(0.5 + (0.5 if bright else -0.5) * np.stack(waves, axis=1))


def band_light(numbers: Array) -> BandLight:
    """The light of its numbers (11,): log r of red and blue, log b of all, M off its diagonal."""
    red, blue = np.exp(numbers[:2])
    mixing = np.zeros((3, 3))
    mixing[_OFF_DIAGONAL] = numbers[5:11]
    mixing += np.diag(1.0 - mixing.sum(axis=1))
    return BandLight(np.array([red, 1.0, blue]), np.exp(numbers[2:5]), mixing)


def band_table(numbers: Array, *, bright: bool, highest_order: float) -> tuple[ColourTable, Array]:
    """A light's table, up to where its last contrast fades, and how it changes (orders, 3, 11). By
    the numbers of `band_light`. What a camera cannot show, less than no light, is 0."""
    order = STEP * np.arange(int(np.ceil(highest_order / STEP)) + 1)
    light = band_light(numbers)
    bands = light.bands(order, bright=bright)
    plain = bands @ light.mixing.T
    last = end_of_contrast(plain)
    change = np.zeros((last, 3, NUMBERS))
    for i in range(5):
        step = DIFFERENCE * np.eye(NUMBERS)[i]
        ahead, behind = (
            band_light(numbers + s).bands(order[:last], bright=bright) for s in (step, -step)
        )
        change[..., i] = (ahead - behind) @ light.mixing.T / (2.0 * DIFFERENCE)
    rows, cols = _OFF_DIAGONAL
    change[:, rows, 5 + np.arange(6)] = bands[:last, cols] - bands[:last, rows]
    change *= (plain[:last] > 0.0)[..., None]
    return ColourTable(np.maximum(plain, 0.0)[:last], np.zeros(3)), change


def band_scale(order: Array, signal: Array, *, bright: bool = False) -> float:
    """How much light signals (n, 3) at known orders have over those of a light of three bands. Of
    signals that are known up to one factor: light of any bands is half full on the mean over many
    orders, so that bands and factor are found together."""
    from scipy.optimize import least_squares

    def misfit(unknowns: Array, start: Array) -> Array:
        light = band_light(unknowns[:NUMBERS])
        model = light.bands(order, bright=bright) @ light.mixing.T
        away = (signal - np.exp(unknowns[NUMBERS]) * model) / FOUND_ERROR
        return np.concatenate([away.ravel(), (unknowns[:NUMBERS] - start) / LIKELY])

    top = float(np.log(np.percentile(signal, 98.0)))
    ends = [
        least_squares(misfit, np.append(start, top), args=(start,), max_nfev=40)
        for start in (SENSOR, CORRECTED)
    ]
    return float(np.exp(min(ends, key=lambda end: float(end.cost)).x[NUMBERS]))
