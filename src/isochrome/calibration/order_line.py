"""The straight line of order against load: slope to the fringe value, intercept to the residual.

Images without load tell the square of the order that stays, and so its size but no sign: near N = 0
the intensity goes with N^2, so that a squared order q = r^2 at the edge is what such an image
measures with a normal uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import PhysicsError

Array = NDArray[np.float64]

CERTAIN = 5.0
"""Standard uncertainties beyond which an unloaded image contradicts the loads' line."""

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
    weights: tuple[float, ...]  # d slope / d order, 1/N
    intercept_weights: tuple[float, ...] | None = None  # d intercept / d order


def fit_line(loads_n: ArrayLike, orders: ArrayLike, uncertainties: ArrayLike) -> OrderLine:
    """Straight line through orders at their loads, with an intercept from two loads on.

    Generalised least squares with the covariance V + t² of the orders, of their standard
    uncertainties (n,) or covariance (n, n). t is zero unless chi-square about the line exceeds its
    95 % point; then it brings chi-square to the degrees of freedom (Paule & Mandel, J. Res. Natl.
    Bur. Stand. 87, 1982, 377-385).
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
    wide = _with_scatter(v, scatter)
    values, covariance, weights = _solve(p, n, wide)
    noise = float(np.sqrt(_solve(p, n, v)[1][0, 0]))
    slope_u, intercept_u = np.sqrt(np.diag(covariance))
    return OrderLine(
        slope=float(values[0]), slope_uncertainty=max(float(slope_u), noise), slope_noise=noise,
        intercept=float(values[1]), intercept_uncertainty=float(intercept_u), scatter=scatter,
        left_out=_left_out(p, n, wide), weights=tuple(weights[0]),
        intercept_weights=tuple(weights[1]),
    )  # fmt: skip


def check_order(loads_n: ArrayLike, orders: ArrayLike, names: tuple[str, ...]) -> None:
    """Refuse orders that fall while the load rises: the loads are swapped between the files.

    Parameters: as in `fit_line`, and the images' `names`. Raises PhysicsError naming the pair.
    """
    p, n = np.asarray(loads_n, dtype=float), np.asarray(orders, dtype=float)
    rank = np.lexsort((n, p))
    for low, high in pairwise(rank):
        if p[high] > p[low] and n[high] < n[low] * (1.0 - 1e-3) - 1e-3:
            raise PhysicsError(
                f"{names[high]} at {p[high]:g} N shows order {n[high]:.3f}, less than the "
                f"{n[low]:.3f} of {names[low]} at {p[low]:g} N: orders must rise with the load; "
                "check whether loads are swapped between files"
            )


def _with_scatter(v: Array, scatter: float) -> Array:
    return v + scatter**2 * np.eye(len(v))


def _solve(p: Array, n: Array, v: Array) -> tuple[Array, Array, Array]:
    """(slope, intercept) for orders of covariance `v`, their covariance, and what each order adds.

    beta = (X^T V^-1 X)^-1 X^T V^-1 n (Aitken, Proc. R. Soc. Edinburgh 55, 1936, 42-48).
    """
    design = np.stack([p, np.ones_like(p)])
    weighted = np.linalg.solve(v, design.T).T
    covariance = np.asarray(np.linalg.inv(weighted @ design.T), dtype=np.float64)
    weights = covariance @ weighted
    return weights @ n, covariance, weights


def _chi_square(p: Array, n: Array, v: Array) -> float:
    slope, intercept = _solve(p, n, v)[0]
    away = n - slope * p - intercept
    return float(away @ np.linalg.solve(v, away))


def _scatter(p: Array, n: Array, v: Array) -> float:
    from scipy.special import chdtri

    dof = p.size - 2
    if dof < 1 or _chi_square(p, n, v) <= chdtri(dof, 0.05):
        return 0.0
    low, high = 0.0, 10.0 * float(np.ptp(n)) + 1.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        above = _chi_square(p, n, _with_scatter(v, middle)) > dof
        low, high = (middle, high) if above else (low, middle)
    return 0.5 * (low + high)


def _left_out(p: Array, n: Array, v: Array) -> tuple[float, ...] | None:
    rest = [np.arange(p.size) != i for i in range(p.size)]
    if p.size < 3 or any(np.unique(p[keep]).size < 2 for keep in rest):
        return None
    lines = [_solve(p[keep], n[keep], v[np.ix_(keep, keep)])[0] for keep in rest]
    return tuple(float(s * load + i) for (s, i), load in zip(lines, p, strict=True))


@dataclass(frozen=True)
class ResidualOrder:
    """An unloaded image: squared order at the edge (fringe^2) and its standard uncertainty."""

    file: str
    square: float
    uncertainty: float


def largest_order(rest: Sequence[ResidualOrder]) -> float:
    """Root mean square of the order r that may be there at no load, in fringes.

    <r^2> under the density exp(-sum (r^2 - q_i)^2 / (2 u_i^2)) with r itself equally likely
    everywhere before, as its sign is not seen. Parameters: `rest`, the unloaded images, at least
    one.
    """
    reach = np.sqrt(max(max(i.square, 0.0) + 8.0 * i.uncertainty for i in rest))
    r = np.linspace(0.0, reach, 4001)
    log = -0.5 * np.sum([((r**2 - i.square) / i.uncertainty) ** 2 for i in rest], axis=0)
    weight = np.exp(log - log.max())
    return float(np.sqrt(np.sum(weight * r**2) / np.sum(weight)))


def order_messages(
    rest: Sequence[ResidualOrder], line: OrderLine, load_n: float
) -> tuple[str, ...]:
    """Where an unloaded image contradicts the order that the loads' line leaves at zero load.

    Parameters: `rest`; `line`, through the loaded images; `load_n`, the largest load.
    Returns the sentences, none where all agree.
    """
    if line.intercept is None or line.intercept_uncertainty is None:
        return ()
    messages = []
    r, u = line.intercept, line.intercept_uncertainty
    for item in rest:
        seen = float(np.sqrt(max(item.square, 0.0)))
        spread = np.sqrt(item.uncertainty**2 + (2.0 * r * u) ** 2 + 2.0 * u**4)
        if abs(r**2 - item.square) > CERTAIN * spread and abs(abs(r) - seen) > NOTICED:
            messages.append(
                f"{item.file} shows an order of {seen:.3f} at no load and the loads' line leaves "
                f"{r:.3f}: the loads are off by {r / line.slope:.3g} N of {load_n:g} N (an offset "
                "of the load cell), or one load is wrong; check them"
            )
    return tuple(messages)
