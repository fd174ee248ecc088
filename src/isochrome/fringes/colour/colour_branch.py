"""Which order each pixel's colour stands for: candidates, and the choice among neighbours.

A colour that noise has moved may lie near the table at several orders. Each pixel keeps all of
them; the choice is the surface that costs least in misfit and in jumps from pixel to pixel, which
is found along rows and columns in both directions and summed.
Source of the summed scan lines: Hirschmüller (2008), IEEE TPAMI 30, 328.
"""

from dataclasses import dataclass

import numpy as np

from isochrome.fringes.colour.colour_table import STEP, ColourTable
from isochrome.fringes.windows import Array, Mask

CANDIDATES = 5
COST_OF_SLOPE = 20.0
"""Misfit (chi²) that a fringe from pixel to pixel weighs as much as."""

COST_OF_JUMP = 30.0
FARTHEST = 60.0
"""Misfit, above the best candidate's, beyond which a pixel has no further candidate."""

_EVERY = 8
_BLOCK = 1 << 14


@dataclass(frozen=True)
class Choice:
    """The chosen order (rows, cols), NaN where the pixel has no trusted channel pair.

    `misfit`, chi² of the chosen candidate; `margin`, chi² by which the best other candidate, or
    the white of higher orders, lies above it (negative where the neighbours overruled the pixel).
    """

    order: Array
    misfit: Array
    margin: Array


def candidate_orders(signal: Array, weight: Array, table: ColourTable) -> tuple[Array, Array]:
    """Orders at which a colour is nearest to the table: minima of chi² = Σ_c w_c (y_c - s_c(N))².

    Orders and chi² (n, candidates), the best first, infinite where there are fewer; weight 0 where
    a channel is not to be trusted.
    """
    coarse = table.signal[::_EVERY]
    step = STEP * _EVERY
    design = np.concatenate([-2.0 * coarse.T, coarse.T**2]).astype(np.float32)
    y = np.where(weight > 0.0, signal, 0.0).astype(np.float32)
    w = weight.astype(np.float32)
    order = np.empty((len(y), CANDIDATES), dtype=np.float32)
    cost = np.empty_like(order)
    for start in range(0, len(y), _BLOCK):
        here = slice(start, start + _BLOCK)
        still = np.sum(w[here] * y[here] ** 2, axis=1)
        chi2 = np.concatenate([w[here] * y[here], w[here]], axis=1) @ design
        order[here], cost[here] = _minima(chi2, step)
        cost[here] += still[:, None]
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
    """Choose each pixel's order among its candidates, guided by its neighbours.

    Parameters: `signal` (rows, cols, channels), NaN where a channel is not to be trusted;
    `variance` of it, of the same shape; `table`. Returns a Choice. A pixel with fewer than two
    trusted channels has no order.
    """
    rows, cols, channels = signal.shape
    trusted = np.isfinite(signal)
    weight = np.where(trusted, 1.0 / variance, 0.0).reshape(-1, channels)
    known = trusted.sum(axis=-1) >= 2
    order, cost = candidate_orders(np.nan_to_num(signal).reshape(-1, channels), weight, table)
    order = order.reshape(rows, cols, CANDIDATES)
    cost = cost.reshape(rows, cols, CANDIDATES)
    cost[~known] = 0.0  # says nothing, and passes nothing on
    penalty = np.minimum(cost - cost[..., :1], FARTHEST)
    penalty[np.isinf(cost)] = np.float32(1e6)
    total = penalty.copy()
    for axis in (0, 1):
        n, c, k = (np.ascontiguousarray(np.moveaxis(a, axis, 0)) for a in (order, penalty, known))
        both = _scan(n, c, k) + _scan(n[::-1], c[::-1], k[::-1])[::-1]
        total += np.moveaxis(both, 0, axis)
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
    return Choice(
        np.where(known, chosen, np.nan), np.where(known, misfit, np.nan), np.where(known, margin, 0)
    )


def _scan(order: Array, penalty: Array, known: Mask) -> Array:
    """What the line before says to each candidate: least cost of a path that ends there.

    Parameters: `order`, `penalty` cost (lines, n, candidates); `known` (lines, n): a pixel that is
    not known passes on nothing. Returns the messages (lines, n, candidates).
    """
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
