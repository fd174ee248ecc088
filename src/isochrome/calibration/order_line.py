"""The line of order against load: its slope gives the fringe value, its intercept the residual.

Images without load tell the square of the order that stays, and so its size but no sign: near N = 0
the intensity goes with N², so that q = r² at the edge is what such an image measures with a normal
uncertainty. A value that cannot tell one of its own loads from the others' within what is stated is
widened until all of them agree.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibration.result import CONTRADICTED, CUTS, BudgetItem, Calibration, ImageFit
from isochrome.errors import PhysicsError
from isochrome.estimation import POOR_CHI, variance_shares
from isochrome.messages import message

Array = NDArray[np.float64]

NOTICED = 0.05
"""Fringes at the least that such a contradiction is worth a sentence."""


@dataclass(frozen=True, kw_only=True)
class OrderLine:
    """order = slope * load + intercept, which is None for a line forced through the origin."""

    slope: float
    slope_uncertainty: float  # with the scatter about the line
    slope_noise: float  # by the images' fits alone
    intercept: float | None = None
    intercept_uncertainty: float | None = None
    scatter: float = 0.0  # between-load part of an order's uncertainty (0: the fits explain it all)
    left_out: tuple[float, ...] | None = None  # each order by the other loads; None below three
    left_out_uncertainty: tuple[float, ...] | None = None  # of the difference
    weights: tuple[float, ...]  # d slope / d order, 1/N


def fit_line(loads_n: ArrayLike, orders: ArrayLike, uncertainties: ArrayLike) -> OrderLine:
    """Line through orders (n,) at their loads, of uncertainties (n,) or covariance (n, n).

    Generalised least squares, V + t² the orders' covariance; t is 0 unless chi-square about the
    line exceeds its 95 % point, and then brings it to the degrees of freedom (Paule & Mandel, J.
    Res. Natl. Bur. Stand. 87, 1982, 377-385). An intercept from two loads on.
    """
    p, n, u = (np.asarray(v, dtype=float) for v in (loads_n, orders, uncertainties))
    v = np.diag(u**2) if u.ndim == 1 else u
    if np.unique(p).size < 2:
        weight = np.linalg.solve(v, p)
        spread = float(1.0 / np.sqrt(weight @ p))
        slope = float(weight @ n) * spread**2
        each = tuple(weight * spread**2)
        return OrderLine(slope=slope, slope_uncertainty=spread, slope_noise=spread, weights=each)
    scatter = _scatter(p, n, v)
    wide = v + scatter**2 * np.eye(len(v))
    values, covariance, weights = _solve(p, n, wide)
    noise = float(np.sqrt(_solve(p, n, v)[1][0, 0]))
    slope_u, intercept_u = np.sqrt(np.diag(covariance))
    return OrderLine(
        slope=float(values[0]), slope_uncertainty=max(float(slope_u), noise), slope_noise=noise,
        intercept=float(values[1]), intercept_uncertainty=float(intercept_u), scatter=scatter,
        **_left_out(p, n, v, wide), weights=tuple(weights[0]),
    )  # fmt: skip


def check_order(loads_n: ArrayLike, orders: ArrayLike, names: tuple[str, ...]) -> None:
    """Refuse (PhysicsError) orders that fall while the load rises: swapped files."""
    p, n = np.asarray(loads_n, dtype=float), np.asarray(orders, dtype=float)
    for low, high in pairwise(np.lexsort((n, p))):
        if p[high] > p[low] and n[high] < n[low] * (1.0 - 1e-3) - 1e-3:
            raise PhysicsError(
                "shows_order_less_orders", names=names[high], p=p[high], n=n[high], n_2=n[low],
                names_2=names[low], p_2=p[low],
            )  # fmt: skip


def _solve(p: Array, n: Array, v: Array) -> tuple[Array, Array, Array]:
    """(slope, intercept) for orders of covariance `v`, their covariance, and what each order adds.

    beta = (X^T V^-1 X)^-1 X^T V^-1 n (Aitken, Proc. R. Soc. Edinburgh 55, 1936, 42-48).
    """
    design = np.stack([p, np.ones_like(p)])
    weighted = np.linalg.solve(v, design.T).T
    covariance = np.asarray(np.linalg.inv(weighted @ design.T), dtype=np.float64)
    weights = covariance @ weighted
    return weights @ n, covariance, weights


def _scatter(p: Array, n: Array, v: Array) -> float:
    from scipy.optimize import brentq
    from scipy.special import chdtri

    dof = p.size - 2

    def excess(scatter: float) -> float:
        wide = v + scatter**2 * np.eye(len(v))
        slope, intercept = _solve(p, n, wide)[0]
        away = n - slope * p - intercept
        return float(away @ np.linalg.solve(wide, away)) - dof

    if dof < 1 or excess(0.0) <= chdtri(dof, 0.05) - dof:
        return 0.0
    return float(brentq(excess, 0.0, 10.0 * np.ptp(n) + 1.0))


def _left_out(p: Array, n: Array, v: Array, wide: Array) -> dict[str, tuple[float, ...]]:
    """Each order by the line through the others, and how unsure the fits make their difference."""
    others = [np.arange(p.size) != i for i in range(p.size)]
    if p.size < 3 or any(np.unique(p[keep]).size < 2 for keep in others):
        return {}
    away = np.eye(p.size)  # each order less that line, as sums of all orders
    for row, keep, load in zip(away, others, p, strict=True):
        weights = _solve(p[keep], n[keep], wide[np.ix_(keep, keep)])[2]
        row[keep] = -np.array([load, 1.0]) @ weights
    spread = np.sqrt(np.diag(away @ v @ away.T))
    return {"left_out": tuple(n - away @ n), "left_out_uncertainty": tuple(spread)}


@dataclass(frozen=True)
class ResidualOrder:
    """An unloaded image: squared order at the edge (fringe^2) and its standard uncertainty."""

    file: str
    square: float
    uncertainty: float


def largest_order(unloaded: Sequence[ResidualOrder]) -> float:
    """Root mean square of the order r that may be there at no load, in fringes.

    <r²> under the density exp(-sum (r² - q_i)²/(2 u_i²)), r itself equally likely everywhere
    before, as its sign is not seen.
    """
    reach = np.sqrt(max(max(i.square, 0.0) + 8.0 * i.uncertainty for i in unloaded))
    r = np.linspace(0.0, reach, 4001)
    log = -0.5 * np.sum([((r**2 - i.square) / i.uncertainty) ** 2 for i in unloaded], axis=0)
    weight = np.exp(log - log.max())
    return float(np.sqrt(np.sum(weight * r**2) / np.sum(weight)))


LINE_MISFIT = 0.12
"""Distance of an order from the other loads' line, in orders' range, that is refused."""

LARGEST_REST = 0.25
"""Order at zero load over the largest order that two loads alone are not believed."""

PLAUSIBLE_N_PER_MM = (0.03, 2000.0)
"""From gelatine to glass, with room on both sides."""


@dataclass(frozen=True)
class Input:
    """An input's standard uncertainty (None: not given) and its share in ln f_sigma.

    `sensitivity` is |d ln f / d input| in 1/unit.
    """

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
) -> Calibration:
    """Regress the orders against the loads and carry the slope k to f_sigma = factor / k.

    `images` have loads above zero; `covariance` (n, n), of orders that were fitted together;
    `messages`, known already. PhysicsError where the orders contradict the loads.
    """
    loads = [i.load_n for i in images]
    orders = np.array([i.order for i in images])
    check_order(loads, orders, tuple(i.file for i in images))
    spread = [max(i.standard_uncertainty, 1e-9) for i in images]
    line = fit_line(loads, orders, spread if covariance is None else covariance)
    if line.intercept is None and unloaded:
        line = replace(line, intercept=0.0, intercept_uncertainty=largest_order(unloaded))
    value = factor_n2_per_mm / line.slope if line.slope > 0 else np.inf
    if not PLAUSIBLE_N_PER_MM[0] <= value <= PLAUSIBLE_N_PER_MM[1]:
        raise PhysicsError("images_give_f_sigma_mm", value=value)
    if line.left_out is not None and line.left_out_uncertainty is not None:
        predicted = zip(images, line.left_out, line.left_out_uncertainty, strict=True)
        images = [
            replace(i, predicted_order=float(n), predicted_uncertainty=float(u))
            for i, n, u in predicted
        ]
    _check_line(images, line)
    budget = _budget(value, line, inputs)
    return Calibration(
        specimen=specimen,
        fringe_value_n_per_mm=float(value),
        standard_uncertainty=float(np.sqrt(sum(b.contribution_n_per_mm**2 for b in budget))),
        chi=float(np.sqrt(np.mean(np.square([i.chi for i in images])))),
        order_at_zero_load=line.intercept,
        order_at_zero_load_uncertainty=line.intercept_uncertainty,
        slope_per_n=line.slope,
        images=tuple(images),
        budget=budget,
        warnings=(*messages, *_warnings(images, line, inputs, specimen, unloaded)),
    )  # fmt: skip


def _check_line(images: Sequence[ImageFit], line: OrderLine) -> None:
    """Refuse orders that no line joins, or whose line is no calibration's: a wrong load or image.

    From four images on the others tell which is wrong, three show that one is, and two only where
    their line passes far from the origin.
    """
    if line.intercept is None:
        return
    orders = np.array([i.order for i in images])
    table = ", ".join(f"{i.file} {i.load_n:g} N order {i.order:.3f}" for i in images)
    if len(images) == 2 and abs(line.intercept) > max(0.3, LARGEST_REST * float(orders.max())):
        raise PhysicsError("these_leave_order_zero", table=table, intercept=line.intercept)
    if line.left_out is None:
        return
    off = np.abs(orders - np.array(line.left_out))
    worst = int(np.argmax(off))
    if off[worst] > LINE_MISFIT * max(float(np.ptp(orders)), 0.2 * float(orders.max())):
        if len(images) == 3:
            raise PhysicsError("these_orders_do_not", table=table)
        suspect = images[worst]
        raise PhysicsError(
            "shows_order_where_other_loads",
            file=suspect.file,
            load_n=suspect.load_n,
            order=suspect.order,
            predicted_order=suspect.predicted_order,
        )


def _budget(value: float, line: OrderLine, inputs: Sequence[Input]) -> tuple[BudgetItem, ...]:
    scatter = np.sqrt(max(line.slope_uncertainty**2 - line.slope_noise**2, 0.0))
    rows = [
        ("image noise and fit", line.slope_noise, "fringe/N", value * line.slope_noise / line.slope)
    ]
    joint = float(np.sum(line.weights))  # vanishes where the line has an intercept of its own
    if line.intercept is not None and abs(joint) > 1e-9 * line.slope:
        spread = line.intercept_uncertainty or 0.0
        rows.append(("order at zero load", spread, "fringe", value * joint * spread / line.slope))
    if line.left_out is not None:
        rows.append(("scatter across loads", scatter, "fringe/N", value * scatter / line.slope))
    rows += [
        (i.name, i.standard_uncertainty, i.unit, value * i.sensitivity * i.standard_uncertainty)
        for i in inputs
        if i.standard_uncertainty is not None
    ]
    shares = variance_shares(np.array([row[3] for row in rows]))
    return tuple(
        BudgetItem(name, float(u), unit, float(part), float(share))
        for (name, u, unit, part), share in zip(rows, shares, strict=True)
    )


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
            load_n = max(image.load_n for image in images)
            yield message(
                "shows_order_no_load", file=item.file, order=order, r=r, slope=r / line.slope,
                load_n=load_n,
            )  # fmt: skip
    worst = max(images, key=lambda i: i.chi)
    if worst.chi > POOR_CHI:
        yield message("model_does_not_describe", chi=worst.chi, file=worst.file)
    if line.intercept is None:
        yield message("one_load_only_order")
    elif abs(r) > max(0.1, 5.0 * u):
        yield (
            message("order_stays_zero_load", intercept=line.intercept, place=CUTS[specimen].place)
            + (message("one_load_wrong_third") if len(images) == 2 else "")
        )
    missing = [i.name for i in inputs if i.standard_uncertainty is None and i.sensitivity > 0]
    if missing:
        yield message("no_uncertainty_given_what", missing=", ".join(missing))


def widened_to_held_out(calibration: Calibration) -> Calibration:
    """A calibration whose uncertainty no held-out load contradicts, and a sentence where it grew.

    Each order n_i is held against the other loads' line, with u_i² = v_i + v(line) + (n_i U)²: its
    own, the line's, and the value's relative uncertainty U, which grows to 3 u_i.
    """
    if any(image.predicted_order is None for image in calibration.images):
        return calibration
    orders, predicted, noise = np.array(
        [(i.order, i.predicted_order, i.predicted_uncertainty) for i in calibration.images]
    ).T
    away = orders - predicted
    value = calibration.fringe_value_n_per_mm
    stated = calibration.standard_uncertainty / value
    expected = np.hypot(noise, orders * stated)
    pulls = np.abs(away) / expected
    worst = int(np.argmax(pulls))
    needed = np.sqrt(np.maximum((away / CONTRADICTED) ** 2 - noise**2, 0.0)) / orders
    total = value * float(max(needed.max(), stated))
    images = tuple(
        replace(i, predicted_uncertainty=float(u))
        for i, u in zip(calibration.images, np.hypot(noise, orders * total / value), strict=True)
    )
    if pulls[worst] <= CONTRADICTED:
        return replace(calibration, images=images)
    part = float(np.sqrt(max(total**2 - calibration.standard_uncertainty**2, 0.0)))
    image = calibration.images[worst]
    items = (*calibration.budget, BudgetItem("held-out loads", part / value, "", part, 0.0))
    text = message(
        "shows_order_where_other", file=image.file, load_n=image.load_n, order=image.order,
        predicted_order=image.predicted_order, pulls=pulls[worst],
        standard_uncertainty=calibration.standard_uncertainty, total=total,
    )  # fmt: skip
    return replace(
        calibration,
        images=images,
        standard_uncertainty=total,
        budget=tuple(replace(i, share=(i.contribution_n_per_mm / total) ** 2) for i in items),
        warnings=(text, *calibration.warnings),
    )
