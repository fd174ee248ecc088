"""From the images' orders to the fringe value, its budget and its warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.order_line import (
    OrderLine,
    ResidualOrder,
    check_order,
    fit_line,
    largest_order,
    order_messages,
)
from isochrome.calibration.result import CUTS, BudgetItem, Calibration, ImageFit
from isochrome.errors import PhysicsError
from isochrome.estimation import POOR_CHI, variance_shares

Array = NDArray[np.float64]

LINE_MISFIT = 0.10
"""Distance of an order from the other loads' line, in orders' range, that is refused."""

OFF_LINE = 0.04
"""Distance of one of three orders from their own line, in orders' range, that is refused."""

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
    rest: Sequence[ResidualOrder] = (),
    messages: tuple[str, ...] = (),
) -> Calibration:
    """Regress the orders against the loads and carry the slope k to f_sigma = factor / k.

    `images` have loads above zero, `factor_n2_per_mm` is N/mm per (fringe/N), `inputs` what else is
    uncertain; `covariance` (n, n) of orders that were fitted together; `rest`, what unloaded images
    show; `messages`, known already. PhysicsError where the orders contradict the loads.
    """
    loads = [i.load_n for i in images]
    orders = np.array([i.order for i in images])
    check_order(loads, orders, tuple(i.file for i in images))
    spread = [max(i.standard_uncertainty, 1e-9) for i in images]
    line = fit_line(loads, orders, spread if covariance is None else covariance)
    line = _intercept_with_misfit(images, line)
    if line.intercept is None and rest:
        line = replace(line, intercept=0.0, intercept_uncertainty=largest_order(rest))
    value = factor_n2_per_mm / line.slope if line.slope > 0 else np.inf
    if not PLAUSIBLE_N_PER_MM[0] <= value <= PLAUSIBLE_N_PER_MM[1]:
        raise PhysicsError(
            f"the images give f_sigma = {value:.3g} N/mm, which no photoelastic material has; "
            "check that lengths are in mm, loads in N, and pixel_mm is this camera's"
        )
    if line.left_out is not None:
        images = [replace(i, predicted_order=p) for i, p in zip(images, line.left_out, strict=True)]
    _check_line(images, line)
    budget = _budget(value, line, inputs, _misfit(images, line))
    total = float(np.sqrt(sum(b.contribution_n_per_mm**2 for b in budget)))
    chis = np.array([i.chi for i in images])
    return Calibration(
        specimen=specimen,
        fringe_value_n_per_mm=float(value),
        standard_uncertainty=total,
        chi=float(np.sqrt(np.mean(chis**2))),
        order_at_zero_load=line.intercept,
        order_at_zero_load_uncertainty=line.intercept_uncertainty,
        slope_per_n=line.slope,
        images=tuple(images),
        budget=budget,
        warnings=(
            *messages,
            *order_messages(rest, line, max(loads)),
            *_warnings(images, line, inputs, specimen),
        ),
    )  # fmt: skip


def _check_line(images: Sequence[ImageFit], line: OrderLine) -> None:
    """Refuse orders that no line joins, or whose line is no calibration's: a wrong load or image.

    From four images on the others tell which is wrong, three show that one is, and two only where
    their line passes far from the origin.
    """
    if line.intercept is None:
        return
    orders = np.array([i.order for i in images])
    away = orders - line.slope * np.array([i.load_n for i in images]) - line.intercept
    table = ", ".join(f"{i.file} {i.load_n:g} N order {i.order:.3f}" for i in images)
    if len(images) == 2 and abs(line.intercept) > max(0.3, LARGEST_REST * float(orders.max())):
        raise PhysicsError(
            f"{table}: these leave an order of {line.intercept:.2f} at zero load, too much for "
            "residual stress; check the loads and that both show the same beam or disc, or add a "
            "third load, which can tell"
        )
    if len(images) == 3 and float(np.abs(away).max()) > OFF_LINE * float(np.ptp(orders)):
        raise PhysicsError(
            f"{table}: these orders do not rise along one line; one load is wrong, or one image "
            "shows another specimen; check them, or add a fourth load, which can tell which"
        )
    if len(images) < 4 or line.left_out is None:
        return
    off = np.abs(orders - np.array(line.left_out))
    worst = int(np.argmax(off))
    limit = LINE_MISFIT * max(float(np.ptp(orders)), 0.2 * float(orders.max()))
    if off[worst] > limit:
        found = images[worst]
        raise PhysicsError(
            f"{found.file} at {found.load_n:g} N shows order {found.order:.3f} where the other "
            f"loads predict {found.predicted_order:.3f}; check its load, and whether it shows the "
            "same specimen, or leave it out"
        )


def _intercept_with_misfit(images: Sequence[ImageFit], line: OrderLine) -> OrderLine:
    """The line with the images' misfits in its intercept's uncertainty.

    A cause that works in proportion to the orders leaves the intercept where it is; what remains
    is each image's own part, through its weight.
    """
    if line.intercept_weights is None or line.intercept_uncertainty is None:
        return line
    own = np.array(line.intercept_weights) * np.array([i.misfit for i in images])
    spread = float(np.hypot(line.intercept_uncertainty, np.sqrt(np.sum(own**2))))
    return replace(line, intercept_uncertainty=spread)


def _misfit(images: Sequence[ImageFit], line: OrderLine) -> float:
    """What the images' misfits m may do to the slope k: fringes per N.

    One cause mostly works in all images, in proportion to their orders (then it is k m/N) or
    alone in each (then it is the line's weights times m); the larger of both is taken.
    """
    own = np.array([i.misfit for i in images])
    orders = np.array([i.order for i in images])
    alike = line.slope * float(np.sqrt(np.mean((own / orders) ** 2)))
    return max(alike, float(np.sqrt(np.sum((np.array(line.weights) * own) ** 2))))


def _budget(
    value: float, line: OrderLine, inputs: Sequence[Input], misfit: float
) -> tuple[BudgetItem, ...]:
    scatter = np.sqrt(max(line.slope_uncertainty**2 - line.slope_noise**2, 0.0))
    rows = [
        ("image noise and fit", line.slope_noise, "fringe/N", value * line.slope_noise / line.slope)
    ]
    alone = float(np.sum(line.weights))  # vanishes where the line has an intercept of its own
    if line.intercept is not None and abs(alone) > 1e-9 * line.slope:
        spread = line.intercept_uncertainty or 0.0
        rows.append(("order at zero load", spread, "fringe", value * alone * spread / line.slope))
    if misfit > 0:
        rows.append(("model misfit", misfit, "fringe/N", value * misfit / line.slope))
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
    images: Sequence[ImageFit], line: OrderLine, inputs: Sequence[Input], specimen: str
) -> tuple[str, ...]:
    messages = []
    worst = max(images, key=lambda i: i.chi)
    if worst.chi > POOR_CHI:
        messages.append(
            f"the model does not describe these images within their noise: chi = {worst.chi:.2f} "
            f"for {worst.file} where 1 is right; look at the residual (gamma, residual stress, "
            "blur, saturation), and take the uncertainty as a lower bound"
        )
    if line.intercept is None:
        messages.append(
            "one load only: an order that stays at zero load cannot be separated and is not in "
            "the uncertainty; add a second load"
        )
    elif abs(line.intercept) > max(0.1, 5.0 * (line.intercept_uncertainty or 0.0)):
        messages.append(
            f"an order of {line.intercept:.3f} stays at zero load at the {CUTS[specimen].place}: "
            "the specimen has residual stress, or the loads an offset (the slope is free of both)"
            + (", or one load is wrong: a third load can tell" if len(images) == 2 else "")
        )
    missing = [i.name for i in inputs if i.standard_uncertainty is None and i.sensitivity > 0]
    if missing:
        messages.append(
            f"no uncertainty is given for {', '.join(missing)}: what the images show is included, "
            "these are not; add them under [uncertainty]"
        )
    return tuple(messages)
