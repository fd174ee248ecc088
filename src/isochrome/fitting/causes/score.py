"""Which causes a fit's residual asks for: score tests on the frame's blocks, without a new fit.

See `isochrome.estimation` for the test.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from isochrome.estimation import (
    ASKED,
    FIRST_DEGREES,
    RICHEST,
    FrameData,
    ScoreProducts,
    Terms,
    light_products,
    missing_terms,
    with_chosen_terms,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.blocks import BLOCK, FrameBlocks
from isochrome.fitting.causes.cause import BLURRED, Cause, candidates
from isochrome.fitting.frame.frame_fit import Fitted
from isochrome.scene import Scene

_SUSPECTED = 10.0
"""Evidence from which a scale is accused: unlike what is freed, it is not tried by a fit."""
_OUTLIER = 6.0
"""Residual of a block, in standard deviations of a block's, beyond which it is no accident."""
_BESIDE = 2.5
"""The same beside such a block: a speck has a rim."""
_WORST_OF_NINE = 3.5
"""Mean square of the largest of nine residuals of noise alone."""
_MAD = 1.4826
"""Standard deviation over the median of the sizes, of a normal distribution."""
_MOST_OUT = 0.15
"""Largest share of the blocks that may be left out as outliers."""


@dataclass(frozen=True)
class Asked:
    """What a frame gains by a cause, or by richer light, or by leaving blocks out.

    `cause`, or None; `terms`, the light's polynomial products then, or None; `outside`, the blocks
    (rows, cols) that are left out, or None. `gain`, S over the noise; `evidence`, that less ln n
    for each unknown (or, with priors, what Bayes's factor takes off); `values`, at which the cause
    would come out, to first order.
    """

    gain: float
    evidence: float
    cause: Cause | None = None
    terms: tuple[Terms, Terms] | None = None
    outside: Mask | None = None
    values: tuple[float, ...] = ()

    @property
    def can_be_freed(self) -> bool:
        """Whether the frame can tell it from what it is told; else it is a suspect."""
        return self.cause is None or self.cause.free


def ask(data: FrameData, fitted: Fitted) -> tuple[tuple[Asked, ...], Array]:
    """What a fit's residual asks for, the one with the most evidence first; and what that leaves.

    Parameters: `data`, the frame as it was fitted; `fitted`. Returns what noise alone does not ask
    for, nothing where the frame is what its scene says; and `_undecided` (p, p).
    """
    blocks = FrameBlocks(data, fitted)
    causes = candidates(fitted.fit.scene, fitted.fit.keys, fitted.held)
    columns = [blocks.columns(cause) for cause in causes]
    lights = _lights(blocks, data)
    groups: list[Any] = [*causes, *lights]
    columns += [blocks.light_columns(*lights[terms]) for terms in lights]
    products = ScoreProducts([blocks.part(np.concatenate(columns))])
    blur = None
    if BLURRED in causes:
        blur = _little_blur(products, sum(len(c) for c in columns[: causes.index(BLURRED)]))
    weights = [getattr(group, "weight", ()) for group in groups]
    found = _scores(products, [len(c) for c in columns], weights)
    asked = [
        _asked(group, gain, price, values)
        for group, (gain, price, values) in zip(groups, found, strict=True)
    ]
    asked = [blur if blur is not None and a.cause is BLURRED else a for a in asked]
    left = _undecided(products, asked, [len(c) for c in columns])[: len(fitted.fit.keys)]
    asked = [a for a in asked if not _is_slight(a, fitted.fit.scene)] + [_outliers(blocks)]
    asked.sort(key=lambda item: -item.evidence)
    clear = tuple(item for item in asked if item.evidence > ASKED)
    # what is known to be uncertain is asked before what is taken as exact is accused
    stated = any(item.cause is not None and item.cause.weight for item in clear)
    return tuple(item for item in clear if item.can_be_freed or not stated), left @ left.T


def _undecided(products: ScoreProducts, asked: list[Asked], sizes: list[int]) -> Array:
    """How far what is fitted would move by each cause or light, times the root of its chance.

    The sum of their squares is what a fit without them is more uncertain by: the variance between
    models of a mean over all of them, with chances 1/(1 + exp(-E/2)) of an evidence E (Raftery
    (1995), Sociological Methodology 25, 111-163). Each term of the light is a model of its own.
    Parameters: `products`; `asked`, of each group of columns; `sizes` of these. Returns (p, k).
    """
    moves, first = [], 0
    for item, size in zip(asked, sizes, strict=True):
        chosen = list(range(first, first + size))
        first += size
        if item.terms is not None:
            single = [products.score([i]) for i in chosen]
            price = float(np.log(products.count))
            parts = [([i], gain - price, v) for i, (gain, _, v) in zip(chosen, single, strict=True)]
        elif item.cause is not None and item.cause.free and not item.cause.weight:
            parts = [(chosen, item.evidence, np.array(item.values))]
        else:
            continue
        for columns, evidence, values in parts:
            chance = 1.0 / (1.0 + np.exp(-0.5 * evidence))
            moves.append(np.sqrt(chance) * products.shift(columns, values))
    return np.array(moves).T


def _is_slight(asked: Asked, scene: Scene) -> bool:
    """Whether a suspect is off by so little that noise, or the model itself, may be."""
    if asked.cause is None or asked.can_be_freed:
        return False
    slight = asked.cause.least * float(scene.get(asked.cause.keys[0]))
    return asked.evidence < _SUSPECTED or abs(asked.values[0]) < slight


def _lights(blocks: FrameBlocks, data: FrameData) -> dict[Any, Any]:
    """Light that a frame's model has not, by its terms: more illumination, background, both."""
    more = missing_terms(data.lamp.terms, FIRST_DEGREES)
    return {pair: _light_bases(blocks, data, pair) for pair in ((more[0], ()), ((), more[1]))}


def _light_bases(
    blocks: FrameBlocks, data: FrameData, terms: tuple[Terms, Terms]
) -> tuple[Array, Array]:
    """The images of some light at the blocks, (k, n) each."""
    light, dark = (blocks.pick(_thin_basis(data.shape, chosen)) for chosen in terms)
    lamp = data.lamp
    if lamp.bright is not None:
        light = light * blocks.thin(lamp.bright if lamp.dark is None else lamp.bright - lamp.dark)
    return light, dark


@lru_cache(maxsize=4)
def _thin_basis(shape: tuple[int, int], terms: Terms) -> Array:
    """A frame's polynomial products at every third pixel."""
    down, across = (np.linspace(-1.0, 1.0, n)[::BLOCK] for n in shape)
    return light_products((down, across), terms)


def _little_blur(products: ScoreProducts, index: int) -> Asked | None:
    """A blur that is asked for and too little to be freed, which is fitted before others are asked.

    It looks like a band of light. Parameters: `products`; `index` of its column. Returns what it
    gains, None where it is not asked for, or large enough to be freed.
    """
    gain, _, values = products.score([index])
    blur = _asked(BLURRED, gain, float(np.log(products.count)), values)
    if blur.evidence <= ASKED or not 0.0 < blur.values[0] < BLURRED.least**2:
        return None
    products.take(index)
    return blur


def _scores(
    products: ScoreProducts, sizes: list[int], weights: list[tuple[float, ...]]
) -> list[tuple[float, float, Array]]:
    """Gain, price and values of each group of columns, beside what is fitted."""
    found = []
    for size, end, weight in zip(sizes, np.cumsum(sizes), weights, strict=True):
        chosen = slice(end - size, end)
        if weight:
            found.append(products.score_with_prior(chosen, np.array(weight)))
            continue
        gain, number, values = products.score(chosen)
        found.append((gain, number * float(np.log(products.count)), values))
    return found


def richer_light(data: FrameData, fitted: Fitted, most: int) -> tuple[Terms, Terms]:
    """The light that a frame asks for, product by product: each the one with the most evidence.

    Parameters: `data`, the frame as it was fitted; `fitted`; `most`, by so many products. Returns
    the terms of illumination and background, the frame's own first.
    """
    blocks = FrameBlocks(data, fitted)
    more = missing_terms(data.lamp.terms, RICHEST)
    columns = blocks.light_columns(*_light_bases(blocks, data, more))
    chosen = ScoreProducts([blocks.part(columns)]).one_by_one(most)
    return with_chosen_terms(data.lamp.terms, more, chosen)


def _asked(group: Any, gain: float, price: float, values: Array) -> Asked:
    evidence = gain - price
    if isinstance(group, Cause):
        return Asked(gain, evidence, cause=group, values=tuple(values.tolist()))
    return Asked(gain, evidence, terms=group)


def _outliers(blocks: FrameBlocks) -> Asked:
    """What leaving out the blocks gains that no noise explains; nothing where they are too many."""
    from scipy.ndimage import binary_dilation, binary_propagation

    residual = blocks.residual
    noise = max(1.0, _MAD * float(np.median(np.abs(residual))))
    size = blocks.image_of(np.abs(residual) / noise)
    near = np.ones((3, 3), dtype=bool)
    seeds = np.maximum(size, blocks.worst / noise) > _OUTLIER
    outside = binary_propagation(seeds, near, mask=seeds | (size > _BESIDE))
    outside = binary_dilation(outside, near)
    out = blocks.pick(outside)
    count, number = len(residual), int(out.sum())
    if not number or number > _MOST_OUT * count:
        return Asked(0.0, 0.0)
    gain = float(np.sum(np.maximum(residual, blocks.pick(blocks.worst))[out] ** 2)) / noise**2
    gain -= _WORST_OF_NINE * number
    return Asked(gain, gain - number * float(np.log(count)), outside=outside)
