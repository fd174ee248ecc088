"""What a set of images shows besides its specimen, weighed by its evidence: see `estimation`.

About a fit the columns of all that may be there are taken once: lens, tone, blur and band, uneven
light, light of each image's own, what the kind of specimen has besides, and a smooth order that no
cause explains. The likeliest set of them is fitted, and asked again. Last, its misfit, its images'
maps, and what it found, in words.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.order_line import Input, uncertainty_budget, widened_to_held_out
from isochrome.calibration.result import CONTRADICTED, Calibration, ImageFit, View
from isochrome.calibration.settings import CalibrationSet
from isochrome.calibration.whole_set.set_model import (
    BAND,
    BLUR,
    EVEN,
    EXPOSURES,
    GAMMA,
    GREEN_NM,
    LENS,
    PLAIN,
    SHARED,
    USUAL_SIZES,
    SetFit,
    SetModel,
    SetPoint,
)
from isochrome.errors import InputError
from isochrome.estimation import (
    ALIKE_CHI,
    FIRST_DEGREES,
    LIGHT_FALLS,
    MOSTLY,
    RIVAL_CHI,
    Nuisance,
    ScoreProducts,
    Unevenness,
    Weighed,
    cosine_rms,
    cosine_spread,
    cosines,
    weighed,
)
from isochrome.fitting import CAUSES, LIGHT, NAMED, ORDER, RARE, SIZES, SUSPECTED, WIDTHS
from isochrome.messages import message
from isochrome.output import per_cent, with_uncertainty

Array = NDArray[np.float64]

_ROUNDS = 8
"""Times that a set is asked, and its outliers looked for: an end of loops that come to rest by
themselves."""

_RICHEST = 24, 12
"""Degrees of illumination and background of an uneven light: a glare adds light in a twelfth of the
picture."""

_OUTLIER = 6.0
"""Residual in noises beyond which a pixel is no accident, and is left out with its neighbours."""

_COSINES = 5
"""Cosines along each side of the picture that an unknown part of the orders is made of."""


def fit_set(model: SetModel, unknowns: Array, besides: Array | None = None) -> SetFit:
    """Fit a set with all that it shows: lens, light, tone, specks left out.

    Parameters: `model`, as stated; where the loaded images' `unknowns` (m, p) start, and the
    amplitudes (k,) of what a kind has besides, where these are free. What is weighed and not fitted
    is in the result's covariance.
    """
    start = np.zeros(model.size)
    start[: unknowns.size] = unknowns.ravel()
    if besides is not None:
        model, start = replace(model, free=(model.kind.besides,)), np.r_[start, besides]
    if len(model.shots) > 1:
        point = replace(model, apart=True).at(start)
        assert point is not None
        model = replace(model, free=(EXPOSURES, *model.free))
        start = point.model.carried(start, model)
        bright = np.abs(point.brightness[: model.loaded])
        start[model.places[EXPOSURES][: model.loaded - 1]] = np.log(bright[1:] / bright[0])
    fit = model.fit(start)
    if not fit.explained:
        return fit
    pixels = model.masks.sum()
    fit = _exposed(_without_outliers(fit))
    asked, nothing = ask_set(fit), frozenset({ORDER})
    for _ in range(_ROUNDS):
        fitted = fitted_names(fit.model)
        wanted = frozenset(h.name for h in asked.sets.best) - nothing
        if wanted == fitted:
            break
        light = _chosen_light(fit, asked) if LIGHT in wanted else None
        fit = _exposed(_without_outliers(_with(fit, wanted, light).levelled()))
        # what comes out at its bound, or as no better light, is not there, whatever slopes say
        nothing |= {key for key in EVEN if fit.shared.get(key, (1.0, 0.0))[0] == 0.0}
        nothing |= wanted - fitted_names(fit.model)
        asked = ask_set(fit)
    left_out = 1.0 - fit.model.masks.sum() / pixels
    return replace(fit, left_out=float(left_out), asked=asked)


def _exposed(fit: SetFit) -> SetFit:
    """The fit with one light of all images, an exposure and stray light of each besides, or each
    one's own light, as they ask.

    Only with one exposure does an unloaded image tell its order, or one of less than a fringe its.
    """
    one = replace(fit.model, apart=False, free=_without_exposures(fit.model))
    scaled = replace(one, free=(EXPOSURES, *one.free))
    for other in (one, scaled, replace(one, apart=True)) if len(one.shots) > 1 else ():
        if (other.apart, other.free) == (fit.model.apart, fit.model.free):
            continue
        start = fit.model.carried(fit.values, other)
        for index in range(one.loaded, len(one.shots)):
            start[other.places[index]] = 0.0  # which its exposure could not be told from
        # in most sets images of their own light are worth no fit
        if not other.apart or _is_better(other.at(start), fit.point):
            rival = other.fit(start)
            fit = rival if _is_better(rival.point, fit.point) else fit
    return fit


def _without_exposures(model: SetModel) -> tuple[str, ...]:
    """What is free but for the exposures."""
    return tuple(name for name in model.free if name != EXPOSURES)


def _is_better(point: SetPoint | None, best: SetPoint) -> bool:
    """Whether another light of the same pixels is worth its unknowns."""
    if point is None or not point.positive:
        return False
    fall = point.pixels * (best.cost - point.cost) / min(best.cost, point.cost)
    return fall > point.occam - best.occam


def fitted_names(model: SetModel) -> frozenset[str]:
    """What a model has free beside what a set states, by name."""
    light = {LIGHT} if model.uneven else set()
    return frozenset(_without_exposures(model)) | light


def _with(fit: SetFit, names: frozenset[str], light: Unevenness | None) -> SetFit:
    """The fit with other things free, under a light as uneven as given."""
    model = fit.model
    free = names | ({EXPOSURES} & {*model.free})
    things = EXPOSURES, *SHARED, model.kind.besides
    wider = replace(model, free=tuple(name for name in things if name in free), uneven=light)
    result = wider.fit(model.carried(fit.values, wider))
    if GAMMA in wider.free:  # a tone is linear about the light only
        again = result.levelled()
        result = again.model.fit(again.values)
    return result


def unevenly_lit(fit: SetFit) -> SetFit:
    """The fit under light as uneven as on usual benches; as it is where that turns negative."""
    uneven = replace(fit.model, uneven=_lights(fit)[1]).fit(fit.values)
    return uneven if uneven.point.positive else fit


def best_first(fits: Iterable[SetFit]) -> list[SetFit]:
    """Fits whose light is positive, by rising misfit, up to where a finer model may turn them."""
    good = sorted((fit for fit in fits if fit.point.positive), key=lambda fit: fit.chi)
    return [fit for fit in good if fit.chi < RIVAL_CHI * good[0].chi]


def alike_fits(fits: Sequence[SetFit]) -> tuple[list[SetFit], list[SetFit]]:
    """Fits of one image under uneven light, the best first, and those that explain it as well.

    In either light: what is far worse in one may be all but as good in the other.
    """
    uneven = best_first(map(unevenly_lit, fits))
    return uneven, [m for each in (fits, uneven) for m in each if m.chi < ALIKE_CHI * each[0].chi]


def _lights(fit: SetFit) -> tuple[Unevenness, ...]:
    """The ways in which a set's light may be uneven: as one of them it is fitted."""
    bright = fit.point.brightness.mean()
    now = fit.model.uneven or Unevenness(float(bright), 0.0, FIRST_DEGREES)
    return tuple(now._replace(fall=fall) for fall in LIGHT_FALLS)


def _chosen_light(fit: SetFit, asked: Weighed) -> Unevenness:
    """How uneven the light of the likeliest set is."""
    ways = [h for h in asked.evidence.hypotheses if h.name == LIGHT]
    (way,) = (k for k, h in enumerate(ways) if any(h is best for best in asked.sets.best))
    return _lights(fit)[way]._replace(degrees=_RICHEST)


def _without_outliers(fit: SetFit) -> SetFit:
    """The fit without pixels whose residual no noise explains, and those beside them."""
    from scipy.ndimage import binary_dilation

    for _ in range(_ROUNDS):
        masks, odd = [], 0
        for image, left in zip(fit.model.images, fit.point.residuals, strict=True):
            away = np.zeros(image.mask.shape, dtype=bool)
            away[image.mask] = np.abs(left) > _OUTLIER * max(1.0, fit.chi)
            away = binary_dilation(away, iterations=2) & image.mask
            odd += int(away.sum())
            masks.append(image.mask & ~away)
        if not odd or odd > MOSTLY * fit.point.pixels:
            break
        fit = replace(fit.model, masks=np.stack(masks)).fit(fit.values)
    return fit


def ask_set(fit: SetFit) -> Weighed:
    """Weigh all that a set of images may show about a fit."""
    model, point = fit.model, fit.point
    nuisances = list(_nuisances(fit))
    freed = [u for n in nuisances for u in n.unknowns]
    unknowns = np.setdiff1d(np.arange(model.size), freed)
    plain = replace(model, uneven=None)

    def parts() -> Iterator[tuple[Array, Array, NDArray[Any], Array]]:
        for i, residual in enumerate(point.residuals):
            rows, place = point.rows(i)
            every = np.zeros((model.size, residual.size))
            every[place] = rows
            fitted = np.concatenate((every[unknowns], point.columns(i, plain)))
            others = np.concatenate(
                [n.columns(i) for n in nuisances], dtype=np.float32, casting="same_kind"
            )
            yield every[:0], fitted, others, residual

    return weighed(
        nuisances,
        ScoreProducts(parts()),
        noise=fit.local_noise,
        fitted=fitted_names(model),
        chance=RARE,
        unknowns=unknowns,
        size=model.size,
    )


def _nuisances(fit: SetFit) -> Iterator[Nuisance]:
    """All that may be there in a set of images."""
    model, point = fit.model, fit.point
    for name in (*SHARED, model.kind.besides):
        sizes, places = model.sizes(name), model.places.get(name, np.arange(0))
        if not len(sizes) or (name == GAMMA and model.shots[0].no_load_light is not None):
            continue  # of a tone the no-load frames would need it too
        yield Nuisance(
            name=name,
            columns=partial(point.rows_of, name=name),
            now=model.value(fit.values, name) - model.middle(name),
            roots=(np.diag(sizes),),
            positive=name in EVEN and name not in model.held,
            unknowns=tuple(places.tolist()),
            weights=model.prior[places],
        )
    yield _light(fit)

    def by_waves(index: int) -> Array:
        """By a share of each place's own order, as products of cosines."""
        order, slope = point.by_order(index)
        mask = model.images[index].mask
        return np.asarray(cosines(mask.shape, _COSINES)[1:, mask] * (slope * order))

    yield Nuisance(
        name=ORDER,
        columns=by_waves,
        now=np.zeros(_COSINES**2 - 1),
        # Gaussian processes on their cosines; the even one left out is the fringe value itself
        roots=tuple(np.diag(cosine_spread(_COSINES, width)[1:]) for width in WIDTHS),
        sizes=SIZES[:-1],
    )


def _light(fit: SetFit) -> Nuisance:
    """The light's products besides those of a set as stated."""
    model, ways = fit.model, _lights(fit)
    lit = [replace(model, uneven=way) for way in ways]
    more = lit[0].light_weights > 0.0
    known = model.light_weights > 0.0
    return Nuisance(
        name=LIGHT,
        columns=lambda index: fit.point.columns(index, lit[0])[more],
        now=fit.point.solved[0][known] if model.uneven else np.zeros(np.count_nonzero(more)),
        roots=tuple(np.diag(way.light_weights[more] ** -0.5) for way in lit),
        weights=model.light_weights[known],
    )


NAMES = {key: cause.name for cause in CAUSES for key in cause.keys}
"""What a scene's keys are the causes of."""


def set_images(
    fit: SetFit,
    orders: Array,
    by_values: Array,
    geometries: Iterable[dict[str, float]],
    cuts: Iterable[dict[str, Any]],
) -> tuple[list[ImageFit], Array]:
    """The loaded images' results, with maps on the fit's pixels, and their orders' covariance.

    `orders` (m,) with their derivatives (m, p) by the unknowns; what `View` has of each one's cut.
    """
    model, point, images = fit.model, fit.point, []
    covariance = by_values @ fit.covariance @ by_values.T
    for i, (order, geometry, cut) in enumerate(zip(orders, geometries, cuts, strict=True)):
        shot, pixels, weighted = model.shots[i], model.images[i], point.residuals[i]
        light = shot.light[np.ix_(model.rows, model.cols)]
        residual, shown = np.full((2, *pixels.mask.shape), np.nan)
        residual[pixels.mask] = weighted * pixels.sigma
        shown[pixels.mask] = np.abs(point.orders[i][0])
        freedom = max(1.0, weighted.size - point.unknowns / len(model.shots))
        view = View(
            image=light, model=light - residual, residual=residual, order=shown,
            sigma=float(np.median(shot.sigma)), **cut,
        )  # fmt: skip
        images.append(
            ImageFit(
                file=shot.name, load_n=shot.load_n, order=float(order),
                standard_uncertainty=float(np.sqrt(covariance[i, i])),
                chi=float(np.sqrt(weighted @ weighted / freedom)), geometry=geometry, view=view,
            )
        )  # fmt: skip
    return images, covariance


def cause_sentence(cause: Mapping[str, Any]) -> str:
    """What one of `Calibration.causes` is, and where a set states it, as its warnings say."""
    value = with_uncertainty(cause["value"], cause["standard_uncertainty"])
    if cause["key"] == GAMMA:
        return message("grey_levels_not_linear", with_uncertainty=value)
    if cause["key"]:
        return message(
            "describes_fringes_used_set", cause=cause["cause"], key=cause["key"], value=value
        )
    return message("wavelength_full_width_half", cause=cause["cause"], value=value)


def sentences(fit: SetFit, found: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What was found and used, a sentence each."""
    yield from map(cause_sentence, found)
    if fit.model.uneven:
        count = fit.point.unknowns - fit.values.size - fit.model.exposures
        yield message("light_more_uneven_quadratic", plain=count - sum(map(len, PLAIN)))
    if fit.left_out > 0:
        yield message("pixels_fit_nothing_dust", per_cent=per_cent(fit.left_out))
    if fit.asked is None:
        return
    fitted = fitted_names(fit.model)
    chances = {n: c for n, c in fit.asked.sets.chances.items() if n not in fitted}
    if chances.pop(ORDER, 0.0) > NAMED:
        share = cosine_rms(np.r_[0.0, fit.asked.sets.values_of(ORDER)])  # of the orders
        yield message("orders_differ_unexplained", size=100.0 * share)
    likely = [f"{NAMES.get(n, n)} ({per_cent(c)})" for n, c in chances.items() if c > SUSPECTED]
    if likely:
        yield message("frames_may_show", who="the images", parts=" or ".join(likely))


def calibration_of(
    specimen: str,
    images: Sequence[ImageFit],
    factor_n2_per_mm: float,
    inputs: Sequence[Input],
    given: CalibrationSet,
    *,
    fit: SetFit | None,
    residual: dict[str, Any] | None = None,
    messages: Sequence[str] = (),
    **orders: Any,
) -> Calibration:
    """The calibration by a set's `images`, as `uncertainty_budget`, with what their `fit` found.

    `inputs` besides the load and the thickness, which takes no part.
    """
    known = given.uncertainty
    load = Input("load", known.load_percent, "%", 0.01)
    thickness = Input("thickness", known.thickness_mm, "mm", 0.0)
    freed, wavelength_nm = list[dict[str, Any]](), given.polariscope.wavelength_nm
    for key, (value, spread) in (fit.shared if fit else {}).items():
        name: str | None = key
        if key in EVEN:
            value, spread = float(np.sqrt(value)), 0.5 * spread / float(np.sqrt(value))
        if key == BAND:  # without a wavelength it is a share of it, and has no key
            share = (wavelength_nm or 1.0) / GREEN_NM
            value, spread = share * value, share * spread
            name = key if wavelength_nm else None
        freed.append(
            {"key": name, "cause": NAMES[key], "value": value, "standard_uncertainty": spread}
        )
    result = uncertainty_budget(
        specimen, images, factor_n2_per_mm, (load, *inputs, thickness),
        messages=(*(sentences(fit, freed) if fit else ()), *messages), **orders,
    )  # fmt: skip
    return widened_to_held_out(replace(result, residual=residual, causes=tuple(freed)))


def stated_values(given: CalibrationSet) -> dict[str, float]:
    """What a set states of its camera and its light, as the model holds it."""
    held = {key: float(getattr(given.camera, key.partition(".")[2])) for key in LENS}
    wavelength, band = given.polariscope.wavelength_nm, given.polariscope.bandwidth_nm
    if wavelength and band:
        held[BAND] = (band * GREEN_NM / wavelength) ** 2
    held[BLUR] = given.camera.blur_px**2
    return {key: value for key, value in held.items() if value}


PIXEL = "camera.pixel_mm"

EDGE_PX = 0.5
"""What an edge, or a rim, itself is uncertain by: a bevel, the light that it scatters, and how a
point load's field fits to a disc's."""


def check_stated_size(
    sizes_px: ArrayLike, name: str, size_mm: float, given: CalibrationSet, code: str
) -> None:
    """Refuse a size and a pixel's that the images contradict beyond all their uncertainties.

    Parameters: the size as each image shows it; the `name` of its key and its value in the set
    `given`; the `code` of what is said. Raises InputError.
    """
    known, pixel_mm = given.uncertainty, given.camera.pixel_mm
    assert pixel_mm is not None
    sizes = np.asarray(sizes_px, dtype=float)
    size_px, spread_px = float(np.median(sizes)), float(np.hypot(2.0 * EDGE_PX, np.std(sizes)))
    stated, fitting = size_mm / pixel_mm, size_mm / size_px
    size, pixel = getattr(known, name) or 0.0, known.pixel_mm or USUAL_SIZES[PIXEL] * pixel_mm
    off, parts = abs(size_px / stated - 1.0), (spread_px / stated, size / size_mm, pixel / pixel_mm)
    if off > CONTRADICTED * float(np.linalg.norm(parts)):
        raise InputError(
            code, **{name: size_mm}, pixel_mm=pixel_mm, stated=stated, off=off,
            with_uncertainty=with_uncertainty(size_px, spread_px),
            with_uncertainty_2=with_uncertainty(fitting, fitting * spread_px / size_px),
        )  # fmt: skip
