"""The whole number of each connected part of an unwrapped field, and what it was taken from.

In this order: orders that the user knows; equilibrium and compatibility (see `anchor`); a model.
Where the first two disagree, or nothing tells, that is said.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from isochrome.fringes.anchor import balance
from isochrome.fringes.stepped.isoclinic import Direction
from isochrome.fringes.windows import Array, Mask

KnownOrder = tuple[int, int, float]
"""Row, column (pixels), and the fringe order there."""

_Seed = tuple[KnownOrder, tuple[int, int]]
"""A known order, and the pixel of the part at which it is looked up."""

_SMALLEST_SHARE = 0.02
"""Of the known pixels: a smaller part has only the user's known orders."""

_NEAR_PX = 3
_TIE = 0.1
_FAR = 0.25
"""Misfit, in fringes, of a known order beyond which it is another whole number, or wrong."""

_MODEL_MISFIT = 0.3


@dataclass(frozen=True)
class FieldPart:
    """A connected part's whole `number` m (None: open) and where that is from.

    `source` is 'known order', 'equilibrium', 'model' or 'none'.
    """

    number: int | None
    source: str


def settle(
    turns: Array,
    direction: Direction,
    known: Mask,
    *,
    known_order: Sequence[KnownOrder] = (),
    model: Callable[[], Array] | None = None,
    residual: Array | None = None,
    compatible: bool = True,
) -> tuple[Array, tuple[FieldPart, ...], tuple[str, ...]]:
    """The whole number m of each part, so that N = |turns + m|; NaN where it is open.

    `turns` φ/2π, unwrapped; `known`, where it and the continuous direction are; `known_order`,
    (row, col, N) each; `model` gives a model's order where nothing else tells; for `residual` n and
    `compatible` see `balance`. Then the parts that are not too small, largest first, and warnings.
    """
    labels, count = label(known)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    seeds = _seeds_of_parts(labels, known_order)
    warnings = [
        f"frames.known_order at row {row}, column {col} (order {order:g}) lies where nothing could "
        "be read; move it"
        for (row, col, order), _ in seeds.pop(0, [])
    ]
    numbers = np.full(turns.shape, np.nan)
    parts = []
    for index in (np.argsort(-sizes[1:]) + 1).tolist():
        if sizes[index] < _SMALLEST_SHARE * sizes[1:].sum() and index not in seeds:
            continue
        inside = labels == index
        found = balance(
            turns,
            direction.twice,
            inside,
            spread=direction.spread,
            residual=residual,
            compatible=compatible,
        )
        whole = found.whole if found else None
        number, source, notes = _part_number(turns, inside, whole, seeds.get(index, []), model)
        warnings += notes
        parts.append(FieldPart(number, source))
        if number is not None:
            numbers[inside] = number
    return numbers, tuple(parts), tuple(warnings)


def _part_number(
    turns: Array,
    inside: Mask,
    whole: int | None,
    seeds: list[_Seed],
    model: Callable[[], Array] | None,
) -> tuple[int | None, str, list[str]]:
    """The number of a part, what it is from, and what to say of it; `whole`, by equilibrium."""
    if seeds:
        number, notes = _from_seeds(turns, seeds, whole)
        return number, "none" if number is None else "known order", notes
    if whole is not None:
        return whole, "equilibrium", []
    number = _from_model(turns, inside, model()) if model else None
    if number is not None:
        note = (
            "the whole number of the order was taken from the scene's model, since the field does "
            "not determine it; a known order in [[frames.known_order]] makes it sure"
        )
        return number, "model", [note]
    note = (
        f"a part of {np.count_nonzero(inside)} pixels has no known whole number of its order, and "
        "was left out; give a point of it in [[frames.known_order]]"
    )
    return None, "none", [note]


def _seeds_of_parts(labels: Array, known_order: Sequence[KnownOrder]) -> dict[int, list[_Seed]]:
    """Known orders by the part they lie in or beside, with the pixel to look at; 0: none."""
    found: dict[int, list[_Seed]] = {}
    rows, cols = labels.shape
    for seed in known_order:
        row, col = seed[0], seed[1]
        near = [
            (abs(r - row) + abs(c - col), r, c)
            for r in range(max(0, row - _NEAR_PX), min(rows, row + _NEAR_PX + 1))
            for c in range(max(0, col - _NEAR_PX), min(cols, col + _NEAR_PX + 1))
            if labels[r, c]
        ]
        place = min(near)[1:] if near else (0, 0)
        index = int(labels[place]) if near else 0
        found.setdefault(index, []).append((seed, place))
    return found


def _from_seeds(
    turns: Array, seeds: list[_Seed], whole: int | None
) -> tuple[int | None, list[str]]:
    """The number under which |turns + m| is the known orders, and what to say of it."""
    here = np.array([turns[place] for _, place in seeds])
    orders = np.array([seed[2] for seed, _ in seeds])
    tried = np.unique(np.rint([orders - here, -orders - here])).astype(int)
    misfit = np.array([np.mean(np.abs(np.abs(here + m) - orders)) for m in tried])
    best = tried[misfit < misfit.min() + _TIE]
    if misfit.min() > _FAR:
        return None, [
            f"frames.known_order disagrees with the light by {misfit.min():.2f} fringe; correct it"
        ]
    if len(best) > 1 and whole not in best:
        return None, [
            "frames.known_order leaves two whole numbers open, on either side of zero; give a "
            "second point, of another order"
        ]
    number = whole if len(best) > 1 else int(best[0])
    if whole is not None and whole != number:
        return number, [
            "frames.known_order and the equilibrium of the field disagree by "
            f"{abs(whole - (number or 0))} fringe; check the known order"
        ]
    return number, []


def _from_model(turns: Array, inside: Mask, model: Array) -> int | None:
    """The number under which the order is nearest to a model's, low orders before high ones.

    None where the model does not single one out: a wrong load shifts high orders by whole ones.
    """
    both = inside & np.isfinite(model)
    if np.count_nonzero(both) < 0.5 * np.count_nonzero(inside):
        return None
    here, order = turns[both], model[both]
    weight = 1.0 / (0.1 + order) ** 2
    middle = [np.rint(np.median(sign * order - here)) for sign in (1, -1)]
    tried = np.unique(np.add.outer(middle, np.arange(-2, 3))).astype(int)
    misfit = np.array([np.average(np.abs(np.abs(here + m) - order), weights=weight) for m in tried])
    first, second = np.sort(misfit)[:2]
    return int(tried[misfit.argmin()]) if first < _MODEL_MISFIT and second > 2.0 * first else None
