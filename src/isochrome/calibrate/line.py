"""The straight line of order against load: slope to the fringe value, intercept to the residual."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import PhysicsError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """order = slope * load + intercept. `intercept` is None for a line forced through the origin.

    `slope_noise` is the slope's uncertainty from the images' fits alone, `slope_uncertainty`
    with the scatter about the line; `scatter` is that between-load part of an order's
    uncertainty (0 where the fits explain it all); `left_out` predicts each order from the other
    loads (None below three loads); `weights` are d slope / d order, 1/N, and `intercept_weights`
    d intercept / d order (None without an intercept).
    """

    slope: float
    slope_uncertainty: float
    slope_noise: float
    intercept: float | None
    intercept_uncertainty: float | None
    scatter: float
    left_out: tuple[float, ...] | None
    weights: tuple[float, ...]
    intercept_weights: tuple[float, ...] | None = None


def fit_line(loads_n: ArrayLike, orders: ArrayLike, uncertainties: ArrayLike) -> Line:
    """Straight line through orders at their loads, with an intercept from two loads on.

    Generalised least squares with the covariance V + t^2 of the orders. The scatter t is zero
    unless chi-square about the line exceeds its 95 % point; then it is what brings chi-square to
    the degrees of freedom (Paule & Mandel, J. Res. Natl. Bur. Stand. 87, 1982, 377-385).

    Parameters: `loads_n` (n,), N; `orders` (n,), fringes; `uncertainties` (n,), their standard
    uncertainties, or (n, n), their covariance. Returns a Line.
    """
    p, n, u = (np.asarray(v, dtype=float) for v in (loads_n, orders, uncertainties))
    v = np.diag(u**2) if u.ndim == 1 else u
    if np.unique(p).size < 2:
        weight = np.linalg.solve(v, p)
        spread = float(1.0 / np.sqrt(weight @ p))
        slope = float(weight @ n) * spread**2
        each = tuple(weight * spread**2)
        return Line(slope, spread, spread, None, None, 0.0, None, each)
    scatter = _scatter(p, n, v)
    wide = _with_scatter(v, scatter)
    values, covariance, weights = _solve(p, n, wide)
    noise = float(np.sqrt(_solve(p, n, v)[1][0, 0]))
    slope_u, intercept_u = np.sqrt(np.diag(covariance))
    return Line(
        float(values[0]), max(float(slope_u), noise), noise, float(values[1]), float(intercept_u),
        scatter, _left_out(p, n, wide), tuple(weights[0]), tuple(weights[1]),
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
