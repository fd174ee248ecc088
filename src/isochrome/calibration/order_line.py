"""The line of order against load: its slope gives the fringe value, its intercept the residual.

Images without load tell the square of the order that stays, and so its size but no sign: near N = 0
the intensity goes with N², so that q = r² at the edge is what such an image measures with a normal
uncertainty. A value that cannot tell one of its own loads from the others' within what is stated is
widened until all of them agree.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.result import CONTRADICTED, CUTS, BudgetItem, Calibration, ImageFit, View
from isochrome.calibration.settings import CalibrationSet
from isochrome.calibration.whole_set import (
    BAND,
    BLUR,
    EVEN,
    GAMMA,
    GREEN_NM,
    LENS,
    PLAIN,
    SHARED,
    USUAL_SIZES,
    SetFit,
)
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import HALF, POOR_CHI, cosine_rms, scaled_inverse, variance_shares
from isochrome.fitting import CAUSES, NAMED, ORDER, RARE, SUSPECTED
from isochrome.messages import message
from isochrome.output import per_cent, with_uncertainty

Array = NDArray[np.float64]

NOTICED = 0.05
"""Fringes at the least that stay at no load, or contradict it, that are worth a sentence."""

LINE_MISFIT = 0.12
"""Distance of an order from the other loads' line, in orders' range, that is refused."""
LARGEST_REST = 0.25
"""Order at zero load over the largest order that two loads alone are not believed."""

PLAUSIBLE_N_PER_MM = (0.03, 2000.0)
"""From gelatine to glass, with room on both sides."""

CREEP = 0.003
"""Relative change of a fringe value from one image to the next, of polymers under steady load."""

EDGE_PX = 0.5
"""What an edge, or a rim, itself is uncertain by: a bevel, the light that it scatters, and how a
point load's field fits to a disc's."""

NAMES = {key: cause.name for cause in CAUSES for key in cause.keys}
"""What a scene's keys are the causes of."""


@dataclass(frozen=True, kw_only=True)
class OrderLine:
    """order = slope * load + intercept, which is None for a line forced through the origin."""

    slope: float
    slope_uncertainty: float  # with the scatter about the line
    slope_noise: float  # by the images' fits alone
    intercept: float | None = None
    intercept_uncertainty: float | None = None
    scatter: float = 0.0  # between-load part of an order's uncertainty (0: the fits explain it all)
    left_out: Array | None = None  # each order by the other loads; None below three
    left_out_uncertainty: Array | None = None  # of the difference
    weights: Array  # d slope / d order, 1/N
    slope_creep: float = 0.0  # the slope's uncertainty by creep between images
    chance_of_creep: float = 0.0
    creep: float = 0.0  # relative change of the orders from one image to the next, if there is
    creep_uncertainty: float = 0.0


def fit_line(loads_n: ArrayLike, orders: ArrayLike, uncertainties: ArrayLike) -> OrderLine:
    """Line through orders (n,) at their loads, of uncertainties (n,) or covariance (n, n).
    Generalised least squares, V + t² the orders' covariance; t is 0 unless chi-square about the
    line exceeds its 95 % point, and then brings it to the degrees of freedom (Paule & Mandel, J.
    Res. Natl. Bur. Stand. 87, 1982, 377-385). An intercept from two loads on.
    """
    p, n, u = (np.asarray(v, dtype=float) for v in (loads_n, orders, uncertainties))
    v, several = np.diag(u**2) if u.ndim == 1 else u, np.unique(p).size > 1
    design = np.stack([p, np.ones_like(p)]) if several else p[None]
    scatter = _scatter(design, n, v) if several else 0.0
    wide = v + scatter**2 * np.eye(len(v))
    values, covariance, weights = _solve(design, n, wide)
    spreads = np.sqrt(np.diag(covariance)).tolist()
    noise = float(np.sqrt(_solve(design, n, v)[1][0, 0]))
    others, more = [np.arange(p.size) != i for i in range(p.size)], dict[str, Any]()
    if several:
        more = {"intercept": float(values[1]), "intercept_uncertainty": spreads[1]}
    if p.size > 2 and all(np.unique(p[keep]).size > 1 for keep in others):
        away = np.eye(p.size)  # each order less the line through the others, as sums of all orders
        for i, (row, keep) in enumerate(zip(away, others, strict=True)):
            of_others = _solve(design[:, keep], n[keep], wide[np.ix_(keep, keep)])[2]
            row[keep] = -design[:, i] @ of_others
        spread = np.sqrt(np.diag(away @ v @ away.T))
        more |= {"left_out": n - away @ n, "left_out_uncertainty": spread}
    return OrderLine(
        slope=float(values[0]), slope_uncertainty=max(spreads[0], noise), slope_noise=noise,
        scatter=scatter, weights=weights[0], **more,
    )  # fmt: skip


def creeping_line(
    loads_n: ArrayLike, orders: ArrayLike, uncertainties: ArrayLike, turns: ArrayLike | None = None
) -> OrderLine:
    """Of orders n_j of images number j, `turns`, that may creep by j c n_j, the slope is that of
    the first image. Lines with creep and without are averaged by their evidence, so that what
    the orders leave open of it is in the uncertainty; two loads judge it by what stays at no load,
    which in most specimens is nothing.
    """
    p, n, u = (np.asarray(v, dtype=float) for v in (loads_n, orders, uncertainties))
    v = np.diag(u**2) if u.ndim == 1 else u
    late: Array = n * np.asarray(range(n.size) if turns is None else turns, dtype=float)
    both = [v, v + CREEP**2 * np.outer(late, late)]
    still, crept = (fit_line(p, n, each) for each in both)
    if still.intercept is None:
        return still
    loads, same, least = p[None], np.eye(n.size), (1e-7 * n.max()) ** 2
    scatters = (still.scatter, crept.scatter)
    noise = [v + (t**2 + least) * same for v, t in zip(both, scatters, strict=True)]
    stays = (LARGEST_REST * n.max()) ** 2 * np.ones_like(same)
    logs = np.array([[_evidence(loads, n, v), _evidence(loads, n, v + stays)] for v in noise])
    prior = np.array([1.0 - RARE, RARE])
    chances = np.exp(logs - logs.max()) * np.outer(prior, prior)
    weights = chances.sum(axis=1) / chances.sum()
    # c as one more unknown of the line, with its prior
    rows, wide = np.stack([p, np.ones_like(p), late]), v + crept.scatter**2 * same
    unknown = np.diag([0.0, 0.0, CREEP**-2.0]) + rows @ np.linalg.solve(wide, rows.T)
    covariance = scaled_inverse(unknown)
    creep = covariance[2] @ rows @ np.linalg.solve(wide, n)
    known = np.sqrt(_solve(np.stack([p, np.ones_like(p)]), n, wide)[1][0, 0])
    known = max(known if weights[1] > HALF else still.slope_uncertainty, still.slope_noise)
    lines = np.array([(w.slope, w.intercept) for w in (still, crept)], dtype=float)
    spreads = [(w.slope_uncertainty, w.intercept_uncertainty) for w in (still, crept)]
    means = weights @ lines
    variances = weights @ (np.array(spreads, dtype=float) ** 2 + (lines - means) ** 2)
    return replace(
        crept if weights[1] > HALF else still, slope=float(means[0]), intercept=float(means[1]),
        slope_noise=still.slope_noise, slope_uncertainty=float(known),
        intercept_uncertainty=float(variances[1] ** 0.5),
        weights=weights[0] * still.weights + weights[1] * crept.weights,
        slope_creep=float(np.sqrt(max(variances[0] - known**2, 0.0))), creep=float(creep),
        chance_of_creep=float(weights[1]), creep_uncertainty=float(covariance[2, 2] ** 0.5),
    )  # fmt: skip


def _evidence(design: Array, n: Array, v: Array) -> float:
    """ln of orders' evidence, the values of `design` anything. Source: Patterson & Thompson (1971),
    Biometrika 58, 545.
    """
    values, covariance, _ = _solve(design, n, v)
    away = n - values @ design
    logs = np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(v)[1]
    return 0.5 * float(logs - away @ np.linalg.solve(v, away))


def _solve(design: Array, n: Array, v: Array) -> tuple[Array, Array, Array]:
    """Values (k,) for orders of covariance `v`, their covariance, and what each order adds. beta =
    (X^T V^-1 X)^-1 X^T V^-1 n (Aitken, Proc. R. Soc. Edinburgh 55, 1936, 42-48).
    """
    weighted = np.linalg.solve(v, design.T).T
    covariance = np.asarray(np.linalg.inv(weighted @ design.T), dtype=np.float64)
    weights = covariance @ weighted
    return weights @ n, covariance, weights


def _scatter(design: Array, n: Array, v: Array) -> float:
    from scipy.optimize import brentq
    from scipy.special import chdtri

    dof = n.size - 2

    def excess(scatter: float) -> float:
        wide = v + scatter**2 * np.eye(len(v))
        away = n - _solve(design, n, wide)[0] @ design
        return float(away @ np.linalg.solve(wide, away)) - dof

    if dof < 1 or excess(0.0) <= chdtri(dof, 0.05) - dof:
        return 0.0
    return float(brentq(excess, 0.0, 10.0 * np.ptp(n) + 1.0))


def check_order(loads_n: ArrayLike, orders: ArrayLike, names: Sequence[str]) -> None:
    """Refuse (PhysicsError) orders that fall while the load rises: swapped files."""
    p, n = np.asarray(loads_n, dtype=float), np.asarray(orders, dtype=float)
    for low, high in pairwise(np.lexsort((n, p))):
        if p[high] > p[low] and n[high] < n[low] * (1.0 - 1e-3) - 1e-3:
            raise PhysicsError(
                "shows_order_less_orders", names=names[high], p=p[high], n=n[high], n_2=n[low],
                names_2=names[low], p_2=p[low],
            )  # fmt: skip


@dataclass(frozen=True)
class ResidualOrder:
    """An unloaded image: squared order at the edge (fringe^2) and its standard uncertainty."""

    file: str
    square: float
    uncertainty: float


@dataclass(frozen=True)
class Input:
    """An input's standard uncertainty (None: not given); `sensitivity`, |d ln f / d input|."""

    name: str
    standard_uncertainty: float | None
    unit: str
    sensitivity: float


def uncertainty_budget(
    specimen: str,
    images: Sequence[ImageFit],
    factor_n2_per_mm: float,
    inputs: Sequence[Input],
    *,
    covariance: Array | None = None,
    unloaded: Sequence[ResidualOrder] = (),
    messages: Sequence[str] = (),
    turns: Sequence[int] | None = None,
) -> Calibration:
    """Regress the orders against the loads and carry the slope k to f_sigma = factor / k.
    PhysicsError where the orders contradict the loads.
    """
    loads, orders = np.array([(i.load_n, i.order) for i in images]).T
    check_order(loads, orders, [i.file for i in images])
    spread = [max(i.standard_uncertainty, 1e-9) for i in images]
    line = creeping_line(loads, orders, spread if covariance is None else covariance, turns)
    if line.intercept is None and unloaded:
        # <r²> of the order r that may be there at no load under the density
        # exp(-sum (r² - q_i)²/(2 u_i²)), r itself equally likely everywhere before, as its sign is
        # not seen
        squares, u = np.array([(i.square, i.uncertainty) for i in unloaded]).T[..., None]
        r = np.linspace(0.0, np.sqrt((np.maximum(squares, 0.0) + 8.0 * u).max()), 4001)
        log = -0.5 * np.sum(((r**2 - squares) / u) ** 2, axis=0)
        weight = np.exp(log - log.max())
        largest = float(np.sqrt(np.sum(weight * r**2) / np.sum(weight)))
        line = replace(line, intercept=0.0, intercept_uncertainty=largest)
    value = factor_n2_per_mm / line.slope if line.slope > 0 else np.inf
    if not PLAUSIBLE_N_PER_MM[0] <= value <= PLAUSIBLE_N_PER_MM[1]:
        raise PhysicsError("images_give_f_sigma_mm", value=value)
    if line.left_out is not None and line.left_out_uncertainty is not None:
        images = [
            replace(i, predicted_order=float(n), predicted_uncertainty=float(u))
            for i, n, u in zip(images, line.left_out, line.left_out_uncertainty, strict=True)
        ]
    _check_line(images, line)
    budget = _budget(float(value), line, inputs)
    return Calibration(
        specimen=specimen,
        fringe_value_n_per_mm=float(value),
        standard_uncertainty=float(np.linalg.norm([b.contribution_n_per_mm for b in budget])),
        chi=float(np.sqrt(np.mean(np.square([i.chi for i in images])))),
        order_at_zero_load=line.intercept,
        order_at_zero_load_uncertainty=line.intercept_uncertainty,
        slope_per_n=line.slope,
        images=tuple(images),
        budget=budget,
        warnings=(*messages, *_warnings(images, line, inputs, specimen, unloaded)),
    )


def _budget(value: float, line: OrderLine, inputs: Sequence[Input]) -> tuple[BudgetItem, ...]:
    rows = [Input("image noise and fit", line.slope_noise, "fringe/N", 1.0 / line.slope)]
    # vanishes where the line has an intercept of its own
    joint, spread = float(np.sum(line.weights)) / line.slope, line.intercept_uncertainty
    if spread is not None and abs(joint) > 1e-9:
        rows.append(Input("order at zero load", spread, "fringe", joint))
    if line.left_out is not None:
        scatter = np.sqrt(max(line.slope_uncertainty**2 - line.slope_noise**2, 0.0))
        rows.append(Input("scatter across loads", float(scatter), "fringe/N", 1.0 / line.slope))
    if line.slope_creep:
        rows.append(Input("creep between images", line.slope_creep, "fringe/N", 1.0 / line.slope))
    rows += inputs
    known = [(i, i.standard_uncertainty) for i in rows if i.standard_uncertainty is not None]
    parts = value * np.array([i.sensitivity * u for i, u in known])
    shares = variance_shares(parts).tolist()
    return tuple(
        BudgetItem(i.name, float(u), i.unit, part, share)
        for (i, u), part, share in zip(known, parts.tolist(), shares, strict=True)
    )


def _check_line(images: Sequence[ImageFit], line: OrderLine) -> None:
    """Refuse orders that no line joins; two, only where theirs passes far from the origin."""
    orders = np.array([i.order for i in images])
    largest = float(orders.max())
    table = ", ".join(f"{i.file} {i.load_n:g} N order {i.order:.3f}" for i in images)
    if len(images) == 2 and abs(line.intercept or 0.0) > max(0.3, LARGEST_REST * largest):
        raise PhysicsError("these_leave_order_zero", table=table, intercept=line.intercept)
    if line.left_out is None:
        return
    off = np.abs(orders - line.left_out)
    suspect = images[int(np.argmax(off))]
    if off.max() > LINE_MISFIT * max(float(np.ptp(orders)), 0.2 * largest):
        if len(images) == 3:
            raise PhysicsError("these_orders_do_not", table=table)
        raise PhysicsError(
            "shows_order_where_other_loads", file=suspect.file, load_n=suspect.load_n,
            order=suspect.order, predicted_order=suspect.predicted_order,
        )  # fmt: skip


def _creep(line: OrderLine) -> Iterator[str]:
    """What is said of a fringe value that changes between the images."""
    if line.chance_of_creep > SUSPECTED:
        yield message(
            "orders_creep", chance=per_cent(line.chance_of_creep),
            creep=with_uncertainty(100.0 * line.creep, 100.0 * line.creep_uncertainty),
            part=per_cent(line.slope_creep / line.slope),
        )  # fmt: skip


def _warnings(
    images: Sequence[ImageFit],
    line: OrderLine,
    inputs: Sequence[Input],
    specimen: str,
    unloaded: Sequence[ResidualOrder],
) -> Iterator[str]:
    r, u = line.intercept or 0.0, line.intercept_uncertainty or 0.0
    for item in unloaded:  # that contradicts the order that the loads' line leaves at no load
        order = float(np.sqrt(max(item.square, 0.0)))
        spread = np.sqrt(item.uncertainty**2 + (2.0 * r * u) ** 2 + 2.0 * u**4)
        if abs(r**2 - item.square) > CONTRADICTED * spread and abs(abs(r) - order) > NOTICED:
            yield message(
                "shows_order_no_load", file=item.file, order=order, r=r, slope=r / line.slope,
                load_n=max(image.load_n for image in images),
            )  # fmt: skip
    worst = max(images, key=lambda i: i.chi)
    if worst.chi > POOR_CHI:
        yield message("model_does_not_describe", chi=worst.chi, file=worst.file)
    yield from _creep(line)
    if line.intercept is None:
        yield message("one_load_only_order")
    elif abs(r) > max(NOTICED, 5.0 * u):
        yield (
            message("order_stays_zero_load", intercept=line.intercept, place=CUTS[specimen].place)
            + (message("one_load_wrong_third") if len(images) == 2 else "")
        )
    missing = [i.name for i in inputs if i.standard_uncertainty is None and i.sensitivity > 0]
    if missing:
        yield message("no_uncertainty_given_what", missing=", ".join(missing))


def widened_to_held_out(calibration: Calibration) -> Calibration:
    """A value that no held-out load contradicts: each order n_i against the other loads' line, with
    u_i² = v_i + v(line) + (n_i U)², U the value's relative uncertainty, which grows to 3 u_i.
    """
    images, value = calibration.images, calibration.fringe_value_n_per_mm
    if any(image.predicted_order is None for image in images):
        return calibration
    orders, predicted, noise = np.array(
        [(i.order, i.predicted_order, i.predicted_uncertainty) for i in images]
    ).T
    away, before = orders - predicted, calibration.standard_uncertainty
    pulls = np.abs(away) / np.hypot(noise, orders * before / value)
    needed = np.sqrt(np.maximum((away / CONTRADICTED) ** 2 - noise**2, 0.0)) / orders
    total = max(value * float(needed.max()), before)
    spreads = np.hypot(noise, orders * total / value).tolist()
    wider = tuple(replace(i, predicted_uncertainty=u) for i, u in zip(images, spreads, strict=True))
    widened = replace(calibration, images=wider)
    worst = int(np.argmax(pulls))
    if pulls[worst] <= CONTRADICTED:
        return widened
    part, image = float(np.sqrt(max(total**2 - before**2, 0.0))), images[worst]
    items = (*calibration.budget, BudgetItem("held-out loads", part / value, "", part, 0.0))
    text = message(
        "shows_order_where_other", file=image.file, load_n=image.load_n, order=image.order,
        predicted_order=image.predicted_order, pulls=pulls[worst], standard_uncertainty=before,
        total=total,
    )  # fmt: skip
    return replace(
        widened,
        standard_uncertainty=total,
        budget=tuple(replace(i, share=(i.contribution_n_per_mm / total) ** 2) for i in items),
        warnings=(text, *calibration.warnings),
    )


def set_images(
    fit: SetFit, linear: Array, places: Iterable[tuple[dict[str, float], dict[str, Any]]]
) -> tuple[list[ImageFit], Array]:
    """The loaded images' results, with maps on the fit's pixels, and their orders' covariance, by
    the orders' derivatives `linear` (m, p).
    """
    model, point, images = fit.model, fit.point, []
    covariance = linear @ fit.covariance @ linear.T
    for i, (order, (geometry, cut)) in enumerate(zip(linear @ fit.values, places, strict=True)):
        shot, weighted = model.shots[i], point.residuals[i]
        light = shot.light[np.ix_(model.rows, model.cols)]
        residual, shown = np.full((2, *light.shape), np.nan)
        residual[model.masks[i]] = weighted * model.images[i].sigma
        shown[model.masks[i]] = np.abs(point.orders[i][0])
        freedom = max(1.0, weighted.size - (point.values.size + point.told) / len(model.shots))
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
        yield message("light_more_uneven_quadratic", plain=fit.point.told - sum(map(len, PLAIN)))
    if fit.left_out > 0:
        yield message("pixels_fit_nothing_dust", per_cent=per_cent(fit.left_out))
    if fit.asked is None:
        return
    named = {cause["cause"] for cause in found}
    chances = {
        n: c for n, c in fit.asked.sets.chances.items()
        if NAMES.get(n, n) not in named and (n in SHARED or n not in fit.model.fitted)
    }  # fmt: skip
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
    """The calibration by a set's `images`, with what their `fit` found besides."""
    known = given.uncertainty
    load = Input("load", known.load_percent, "%", 0.01)
    thickness = Input("thickness", known.thickness_mm, "mm", 0.0)
    freed, wavelength_nm = list[dict[str, Any]](), given.polariscope.wavelength_nm
    sure = fit.asked.sets.chances if fit and fit.asked else {}
    for key, (value, spread) in (fit.shared if fit else {}).items():
        if key in LENS and sure.get(key, 1.0) < NAMED:
            continue  # a moment, or rollers, may bend the fringes as it does
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
    every = [*(sentences(fit, freed) if fit else ()), *messages]
    if residual is not None:
        size, form = residual["largest_order"], residual["form"]
        every.append(message("residual_stress_up_fringe", size=size, form=form))
    result = uncertainty_budget(
        specimen, images, factor_n2_per_mm, (load, *inputs, thickness), messages=every, **orders
    )
    return widened_to_held_out(replace(result, residual=residual, causes=tuple(freed)))


def stated_values(given: CalibrationSet) -> dict[str, float]:
    """What a set states of its camera and its light, as the model holds it."""
    held = {key: float(getattr(given.camera, key.partition(".")[2])) for key in LENS}
    wavelength, band = given.polariscope.wavelength_nm, given.polariscope.bandwidth_nm
    if wavelength and band:
        held[BAND] = (band * GREEN_NM / wavelength) ** 2
    held[BLUR] = given.camera.blur_px**2
    return {key: value for key, value in held.items() if value}


def check_stated_size(
    sizes_px: ArrayLike, name: str, size_mm: float, given: CalibrationSet, code: str
) -> None:
    """Refuse (InputError) a size and a pixel's that the images contradict beyond uncertainty."""
    known, pixel_mm = given.uncertainty, given.camera.pixel_mm
    assert pixel_mm is not None
    sizes = np.asarray(sizes_px, dtype=float)
    size_px, spread_px = float(np.median(sizes)), float(np.hypot(2.0 * EDGE_PX, np.std(sizes)))
    stated, fitting = size_mm / pixel_mm, size_mm / size_px
    size = getattr(known, name) or 0.0
    pixel = known.pixel_mm or USUAL_SIZES["camera.pixel_mm"] * pixel_mm
    off, parts = abs(size_px / stated - 1.0), (spread_px / stated, size / size_mm, pixel / pixel_mm)
    if off > CONTRADICTED * float(np.linalg.norm(parts)):
        raise InputError(
            code, **{name: size_mm}, pixel_mm=pixel_mm, stated=stated, off=off,
            with_uncertainty=with_uncertainty(size_px, spread_px),
            with_uncertainty_2=with_uncertainty(fitting, fitting * spread_px / size_px),
        )  # fmt: skip
