"""Which causes a fit's residual asks for: score tests on the frame's blocks, without a new fit.

See `isochrome.estimation` for the test.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from isochrome.estimation import (
    ASKED,
    FIRST_DEGREES,
    RICHEST,
    ScoreProducts,
    Terms,
    light_products,
    missing_terms,
    with_chosen_terms,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.causes.blocks import BLOCK, EVEN, FrameBlocks
from isochrome.fitting.causes.cause import BLURRED, Cause
from isochrome.scene import Scene

LightTerms = tuple[Terms, Terms]
"""Polynomial products of illumination and background."""

_SUSPECTED = 10.0
"""Evidence from which a scale is accused: unlike what is freed, it is not tried by a fit."""
_OUTLIER = 6.0
"""Residual of a block, in standard deviations of a block's, beyond which it is no accident."""
_BESIDE = 2.5
"""The same beside such a block: a speck has a rim."""
_WORST_OF_NINE = 3.5
"""Mean square of the largest of nine residuals of noise alone."""
_RARE = 0.1
"""Chance that a bench has a given defect, before its frame is looked at."""
_MAD = 1.4826
"""Standard deviation over the median of the sizes, of a normal distribution."""
_MOST_OUT = 0.15
"""Largest share of the blocks that may be left out as outliers."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a frame gains by a cause, or by richer light, or by leaving blocks out.

    `cause`, or None; `terms`, the light's polynomial products then, or None; `outside`, the blocks
    (rows, cols) that are left out, or None, and those of them that a `shadow` may reach. `gain`, S
    over the noise; `evidence`, that less ln n for each unknown (or, with priors, what Bayes's
    factor takes off); `values`, at which the cause would come out, to first order.
    """

    gain: float
    evidence: float
    cause: Cause | None = None
    terms: LightTerms | None = None
    outside: Mask | None = None
    shadow: Mask | None = None
    values: tuple[float, ...] = ()

    @property
    def can_be_freed(self) -> bool:
        """Whether the frame can tell it from what it is told; else it is a suspect."""
        return self.cause is None or self.cause.free


def ask(
    frames: Iterable[FrameBlocks],
    causes: tuple[Cause, ...],
    scene: Scene,
    terms: LightTerms,
    stated: tuple[Array, Array],
) -> tuple[tuple[Asked, ...], Array]:
    """What the residual of one frame, or of several together, asks for; and what that leaves.

    Parameters: `frames`, that share whatever is freed; `causes` that they can have; their `scene`;
    `terms` of their light; `stated`, 1/u (p,) of what is known of the unknowns beforehand, and how
    far it is from what was fitted, over u (p,). Returns what noise alone does not ask for, the
    one with the most evidence first, nothing where the frames are what their scene says; and what
    the covariance (p, p) lacks for what they neither ask for nor exclude, see `_undecided`.
    """
    lights = _lights(terms)
    groups: list[Any] = [*causes, *lights]
    sizes = [1 if c.keys[0] in EVEN and not c.weight else len(c.keys) for c in causes]
    sizes += [len(light) + len(dark) for light, dark in lights]
    found_outside: list[Asked] = []

    def parts() -> Iterator[tuple[Array, Array, Array, Array]]:
        for blocks in frames:
            columns = [blocks.columns(cause) for cause in causes]
            columns += [blocks.light_columns(*_light_bases(blocks, pair)) for pair in lights]
            found_outside.append(_outliers(blocks))
            yield blocks.part(np.concatenate(columns))
        size = len(stated[0])
        yield np.empty((0, size)), np.diag(stated[0]), np.zeros((sum(sizes), size)), stated[1]

    products = ScoreProducts(parts())
    blur = None
    if BLURRED in causes:
        blur = _little_blur(products, sum(sizes[: causes.index(BLURRED)]))
    result = _scores(products, sizes, [getattr(group, "weight", ()) for group in groups])
    asked = [
        _asked(group, 0.0 if is_impossible(group, values, scene) else gain, price, values)
        for group, (gain, price, values) in zip(groups, result, strict=True)
    ]
    asked = [blur if blur is not None and a.cause is BLURRED else a for a in asked]
    left = _undecided(products, asked, sizes)
    asked = [a for a in asked if not _is_slight(a, scene)] + [_outside_of_all(found_outside)]
    asked.sort(key=lambda item: -item.evidence)
    clear = tuple(item for item in asked if item.evidence > ASKED)
    # what is known to be uncertain is asked before what is taken as exact is accused
    known = any(item.cause is not None and item.cause.weight for item in clear)
    return tuple(item for item in clear if item.can_be_freed or not known), left @ left.T


def _undecided(products: ScoreProducts, asked: list[Asked], sizes: list[int]) -> Array:
    """How far what is fitted would move by each cause or light, times the root of its chance.

    The sum of their squares is what a fit without them is more uncertain by: the variance between
    models of a mean over all of them (Raftery (1995), Sociological Methodology 25, 111-163). One
    model says that there is nothing, each other one defect: their chances are w/(1 + sum w), with
    w = exp(E/2) p/(1 - p) of an evidence E and of p before it. Each term of the light is a model of
    its own.
    Parameters: `products`; `asked`, of each group of columns; `sizes` of these. Returns (p, k).
    """
    shifts, evidences, first = [], [], 0
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
        shifts += [products.shift(columns, values) for columns, _, values in parts]
        evidences += [evidence for _, evidence, _ in parts]
    # evidences of thousands would overflow: all odds are over the largest of them
    logs = 0.5 * np.array(evidences) + np.log(_RARE / (1.0 - _RARE))
    largest = max(0.0, float(logs.max(initial=0.0)))
    odds = np.exp(logs - largest)
    chance = odds / (np.exp(-largest) + odds.sum())
    moves = [root * shift for root, shift in zip(np.sqrt(chance), shifts, strict=True)]
    return np.array(moves).T


def _outside_of_all(found: list[Asked]) -> Asked:
    """What frames gain without the blocks that are odd in any of them: dust lies on the glass."""
    odd = [item for item in found if item.outside is not None]
    if not odd:
        return Asked(gain=0.0, evidence=0.0)
    gain, evidence = (sum(getattr(a, name) for a in odd) for name in ("gain", "evidence"))
    outside = np.logical_or.reduce([a.outside for a in odd if a.outside is not None])
    if outside.mean() > _MOST_OUT:
        return Asked(gain=0.0, evidence=0.0)
    shadow = next((a.shadow for a in odd if a.shadow is not None), None)
    return Asked(gain=gain, evidence=evidence, outside=outside, shadow=shadow)


def _is_slight(asked: Asked, scene: Scene) -> bool:
    """Whether a suspect is off by so little that noise, or the model itself, may be."""
    if asked.cause is None or asked.can_be_freed:
        return False
    slight = asked.cause.least * float(scene.get(asked.cause.keys[0]))
    return asked.evidence < _SUSPECTED or abs(asked.values[0]) < slight


def _lights(terms: LightTerms) -> list[LightTerms]:
    """Light that a frame's model has not, by its terms: more illumination, more background."""
    light, dark = missing_terms(terms, FIRST_DEGREES)
    return [(light, ()), ((), dark)]


def _light_bases(blocks: FrameBlocks, terms: LightTerms) -> tuple[Array, Array]:
    """The images of some light at the blocks, (k, n) each, as bright as the frame's own."""
    shares = (blocks.pick(_thin_basis(blocks.data.shape, chosen)) for chosen in terms)
    light, dark = (np.float32(blocks.brightness) * image for image in shares)
    lamp = blocks.data.lamp
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
    result = []
    for size, end, weight in zip(sizes, np.cumsum(sizes), weights, strict=True):
        chosen = slice(end - size, end)
        if weight:
            result.append(products.score_with_prior(chosen, np.array(weight)))
            continue
        gain, number, values = products.score(chosen)
        result.append((gain, number * float(np.log(products.count)), values))
    return result


def richer_light(frames: Iterable[FrameBlocks], terms: LightTerms, most: int) -> LightTerms:
    """The light that frames ask for, product by product: each the one with the most evidence.

    Parameters: `frames`; `terms` of their light; `most`, by so many products. Returns the terms of
    illumination and background, the frames' own first.
    """
    more = missing_terms(terms, RICHEST)

    def parts() -> Iterator[tuple[Array, Array, Array, Array]]:
        for blocks in frames:
            columns = blocks.light_columns(*_light_bases(blocks, more))
            yield blocks.part(columns)

    return with_chosen_terms(terms, more, ScoreProducts(parts()).one_by_one(most))


def is_impossible(group: Any, values: Array, scene: Scene) -> bool:
    """Whether a cause is asked for with a negative square: a picture sharper than without blur.

    What a frame asks for so is something else, and would stand before it.
    """
    if not isinstance(group, Cause) or group.weight:
        return False
    squared = group is BLURRED or group.keys[0] in EVEN
    return squared and bool(values[0] < 0.0) and not any(scene.get(key) for key in group.keys)


def _asked(group: Any, gain: float, price: float, values: Array) -> Asked:
    evidence = gain - price
    if isinstance(group, Cause):
        return Asked(gain=gain, evidence=evidence, cause=group, values=tuple(values.tolist()))
    return Asked(gain=gain, evidence=evidence, terms=group)


def _outliers(blocks: FrameBlocks) -> Asked:
    """What leaving out the blocks gains that no noise explains; nothing where they are too many."""
    from scipy.ndimage import binary_dilation, binary_propagation

    residual = blocks.residual
    noise = max(1.0, _MAD * float(np.median(np.abs(residual))))
    price = float(np.log(len(residual)))
    if blocks.shadow is not None:  # specks are told from the rest after it
        return _without(blocks, blocks.shadow, noise, price)
    size = blocks.image_of(np.abs(residual) / noise)
    near = np.ones((3, 3), dtype=bool)
    seeds = np.maximum(size, blocks.worst / noise) > _OUTLIER
    outside = binary_propagation(seeds, near, mask=seeds | (size > _BESIDE))
    outside = binary_dilation(outside, near)
    return _without(blocks, outside, noise, price * int(blocks.pick(outside).sum()))


def _without(blocks: FrameBlocks, outside: Mask, noise: float, price: float) -> Asked:
    """What leaving out some blocks gains; nothing where they are none, or too many."""
    out = blocks.pick(outside)
    number = int(out.sum())
    if not number or number > _MOST_OUT * len(out):
        return Asked(gain=0.0, evidence=0.0)
    worst = np.maximum(blocks.residual, blocks.pick(blocks.worst))[out]
    gain = float(np.sum(worst**2)) / noise**2 - _WORST_OF_NINE * number
    return Asked(gain=gain, evidence=gain - price, outside=outside, shadow=blocks.shadow)
