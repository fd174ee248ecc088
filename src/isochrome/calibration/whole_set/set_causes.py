"""What a set of images shows besides its specimen: asked of its residual, and then freed.

Nothing is freed where nothing is asked: see `isochrome.estimation` for the test.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.whole_set.set_model import (
    BAND,
    BLUR,
    GAMMA,
    LENS,
    SHARED,
    SetFit,
    SetModel,
)
from isochrome.estimation import (
    ASKED,
    FEW_TERMS,
    FIRST_DEGREES,
    HALF,
    LITTLE,
    MOST_TERMS,
    RICHEST,
    ScoreProducts,
    Terms,
    missing_terms,
    stays_poor,
    total_degree,
    with_chosen_terms,
)

Array = NDArray[np.float64]

_ROUNDS, _LIGHTS, _PASSES, _TONES = 8, 4, 4, 2
_CLEAR = 3.5
"""Standard uncertainties from what is stated below which a key is not kept free."""

_NEXT = total_degree(4), total_degree(2)
"""Light that is begun with where a quadratic is far off: what single images may have as well."""

_NOT_COMMON, _ALIKE = 1.5, 1.01
"""Chi of the images with one light over that with light of their own, at which they have none in
common: before more is free, and in the end."""

_LARGE = 1.03
"""Residual over noise from which single pixels are looked at before anything is asked."""

_ODD = 6.0
"""Residual in noises beyond which a pixel is no accident, and is left out with its neighbours."""

_MOST_ODD = 0.1


def free_set(model: SetModel, start: Array, *, rival: float) -> SetFit | None:
    """Fit a set with all that it asks for: lens, light, contrast, tone, specks left out.

    Parameters: `model`, plain; `start`, its unknowns; `rival`, chi of the images by themselves.
    Returns the SetFit, None where the set asks for nothing, or what it asks for cannot be fitted,
    or the images have no common light.
    """
    fit = model.fit(start)
    if fit.chi > _NOT_COMMON * rival:
        fit = replace(model, terms=_NEXT).fit(fit.values)
    if not fit.point.positive or fit.chi > _NOT_COMMON * rival:
        return None
    first = fit
    if fit.chi > _LARGE:
        fit = _without_specks(fit)
    for _ in range(_ROUNDS):
        before = fit.chi
        keys, light = asked(fit)
        if keys:
            wider, begun = fit.model.freed(fit.values, (*fit.model.free, *keys))
            fit = wider.fit(begun)
            for _ in range(_TONES if GAMMA in wider.free else 0):
                again = fit.levelled()
                fit = again.model.fit(again.values)
        elif light:
            fit = _with_light(fit)
        else:
            break
        fit = _without_specks(fit)
        if stays_poor(before, fit.chi, LITTLE):
            return None
    fit = _pruned(fit)
    if not (fit.converged and fit.point.positive) or fit.chi > _ALIKE * rival:
        return None
    left_out = 1.0 - fit.point.pixels / first.point.pixels
    plain = not fit.model.free and fit.model.terms == first.model.terms and not left_out
    return None if plain and not model.held else replace(fit, left_out=left_out)


def asked(fit: SetFit) -> tuple[tuple[str, ...], bool]:
    """What a fit's residual asks for most: shared keys, or richer light (True), or nothing."""
    fit = fit.levelled()
    held = tuple(key for key in SHARED if key not in fit.model.free)
    if fit.model.shots[0].no_load_light is not None:
        held = tuple(key for key in held if key != GAMMA)  # the no-load frames would need it too
    lights = missing_terms(fit.model.terms, FIRST_DEGREES)
    products = _products(fit, held, lights)
    lens = [i for i, key in enumerate(held) if key in LENS]
    groups = [[i] for i, key in enumerate(held) if key not in LENS]
    first = np.cumsum([len(held), *map(len, lights)])
    groups += [list(range(start, end)) for start, end in pairwise(first)]
    least = np.log(products.count)
    evidence = [gain - size * least for gain, size, _ in map(products.score, groups)]
    if lens:
        # one may be asked for where all together are not
        parts = [products.score(part) for part in (lens, *([i] for i in lens))]
        groups.append(lens)
        evidence.append(max(gain - size * least for gain, size, _ in parts))
    best = int(np.argmax(evidence))
    if evidence[best] < ASKED:
        return (), False
    return tuple(held[i] for i in groups[best] if i < len(held)), groups[best][0] >= len(held)


def _products(fit: SetFit, keys: tuple[str, ...], terms: tuple[Terms, Terms]) -> ScoreProducts:
    """Products of what is fitted with shared keys and more light."""
    point, size = fit.point, len(fit.values)
    bases = fit.model.weighted(terms)

    def parts() -> Iterator[tuple[Array, Array, Array, Array]]:
        for i, left in enumerate(point.linear[2]):
            rows = np.zeros((size, left.size))
            rows[point.columns_of(i)] = point.rows(i)
            fitted = np.concatenate((rows, point.columns(i)))
            more = np.concatenate((point.shared_rows(i, keys), point.columns(i, bases[i])))
            yield fitted[:0], fitted, more, left

    return ScoreProducts(parts())


def _with_light(fit: SetFit) -> SetFit:
    """The fit with the light that is asked for, product by product, until none is."""
    before = fit.chi
    fit = _lit(fit, FEW_TERMS)
    if stays_poor(before, fit.chi, HALF):
        return fit  # a hundred products take up some of anything, and explain it no better
    for _ in range(_LIGHTS):
        richer = _lit(fit, MOST_TERMS)
        if richer is fit:
            break
        fit = richer
    return fit


def _lit(fit: SetFit, most: int) -> SetFit:
    """The fit with light richer by so many products at the most; itself where none is asked for."""
    more = missing_terms(fit.model.terms, RICHEST)
    chosen = _products(fit, (), more).one_by_one(most)
    if not chosen:
        return fit
    terms = with_chosen_terms(fit.model.terms, more, chosen)
    return replace(fit.model, terms=terms).fit(fit.values)


def _without_specks(fit: SetFit) -> SetFit:
    """The fit without pixels whose residual no noise explains, and those beside them."""
    from scipy.ndimage import binary_dilation

    for _ in range(_PASSES):
        masks, odd = [], 0
        for image, left in zip(fit.model.images, fit.point.linear[2], strict=True):
            away = np.zeros(image.mask.shape, dtype=bool)
            away[image.mask] = np.abs(left) > _ODD * max(1.0, fit.chi)
            away = binary_dilation(away, iterations=2) & image.mask
            odd += int(away.sum())
            masks.append(image.mask & ~away)
        if not odd or odd > _MOST_ODD * fit.point.pixels:
            break
        fit = replace(fit.model, masks=np.stack(masks)).fit(fit.values)
    return fit


def _pruned(fit: SetFit) -> SetFit:
    """Without the keys that came out at nothing beside the others."""
    needless = [
        key
        for key, (value, spread) in fit.shared.items()
        if abs(value - _nothing(fit.model, key)) < _CLEAR * spread
        or (key in (BAND, BLUR) and value < 0.0)
    ]
    if not needless:
        return fit
    left = tuple(key for key in fit.model.free if key not in needless)
    model, start = fit.model.freed(fit.values, left)
    return _pruned(model.fit(start))


def _nothing(model: SetModel, key: str) -> float:
    return model.held.get(key, 1.0 if key == GAMMA else 0.0)
