"""Separable least squares on a frame's intensities, from one start or from several.

A pixel's model is I = f(params) sum_k a_k B_k + sum_k c_k C_k. The linear coefficients are
eliminated (variable projection: Golub & Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432), with
Kaufman's Jacobian (BIT 15, 1975, 49-57), which is the Schur complement of the joint normal
equations. Fringe patterns have many minima, and only one is the truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation.covariance import is_determined, standard_uncertainty
from isochrome.estimation.least_squares import (
    Bounds,
    Damping,
    Descent,
    LinearPart,
    SeparableProblem,
    evaluate_prepared,
    minimise,
    prepare,
    scaled_inverse,
    solve_linear,
)

Array = NDArray[np.float64]
Response = Callable[[Array], ArrayLike]

STEP = 1e-4
"""Difference step in units of a parameter's scale; fits responses in single precision as well."""

_MOST_STEPS = 50
_LAST_STEP = 1e-3
"""Standard uncertainties below which a step is the last."""


@dataclass(frozen=True, kw_only=True)
class IntensityFit:
    """A fitted frame: values (p,), coefficients (k,) of the bases, maps (rows, cols) in the image's
    unit.
    """

    values: Array
    # (p,), from the Jacobian with the linear unknowns, times max(1, chi)
    standard_uncertainty: Array
    covariance: Array  # (p, p), the same, times max(1, chi)²
    chi: float  # root of the sum of (residual/sigma)² over the degrees of freedom
    illumination_coefficients: Array
    background_coefficients: Array
    illumination_map: Array
    background_map: Array
    signal: Array  # the polariscope's, 0..1
    residual: Array  # image less model, NaN where masked
    converged: bool  # the steps ended, with finite uncertainties
    positive: bool  # False: the illumination came out negative, a wrong solution

    @property
    def model(self) -> Array:
        """The fitted intensities (rows, cols)."""
        return self.illumination_map * self.signal + self.background_map


def fit_intensity(
    image: ArrayLike,
    response: Response,
    start: ArrayLike,
    *,
    illumination: Array,
    background: Array,
    mask: NDArray[np.bool_] | None = None,
    sigma: ArrayLike = 1.0,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    scale: ArrayLike | None = None,
) -> IntensityFit:
    """Fit a polariscope's signal to a frame, illumination and background eliminated linearly.

    `response`: from params (p,) to the ideal signal 0..1 (rows, cols), such as sin²(πN); bases (k,
    rows, cols), see `polynomial_basis`; `mask`: by default where finite; `scale`: a natural change
    of each parameter, by default |start| or 1, whose 1e-4 is the difference step. InputError on
    shapes, a start, or more unknowns than pixels.
    """
    problem = prepare(
        image, mask=mask, sigma=sigma, illumination=illumination, background=background
    )
    first = np.atleast_1d(np.asarray(start, dtype=float))
    low = np.full(first.size, -np.inf) if lower is None else np.asarray(lower, dtype=float)
    high = np.full(first.size, np.inf) if upper is None else np.asarray(upper, dtype=float)
    size = np.where(first == 0, 1.0, np.abs(first)) if scale is None else np.asarray(scale, float)
    if problem.size <= first.size + len(illumination) + len(background):
        raise InputError("valid_pixels_fewer_unknowns", size=problem.size)
    search = _Search(problem, response, Bounds(low, high), STEP * np.abs(size))
    params = np.clip(first, low, high)
    point = search.at(params)
    if point is None:
        raise InputError("response_not_finite_start", params=params)

    def better(trial: _Point, point: _Point) -> bool:
        """Less cost, and no light that turns negative: another basin's sign."""
        return (trial.part.positive or not point.part.positive) and trial.cost < point.cost

    descent = minimise(
        search.at, params, point, damping=Damping(1e-3), iterations=_MOST_STEPS,
        enough=lambda at: _LAST_STEP**2 * max(1.0, at.cost / problem.size),
        better=better, bounds=search.bounds,
    )  # fmt: skip
    rows = search.jacobian(descent.values, descent.point.part, central=True)
    return _result(image, search, descent, rows, illumination, background)


@dataclass(frozen=True)
class _Point:
    """Parameters with their linear `part`; derivatives are taken where they are asked for."""

    search: _Search
    params: Array
    part: LinearPart

    @property
    def cost(self) -> float:
        return self.part.cost

    @cached_property
    def rows(self) -> Array:
        return self.search.jacobian(self.params, self.part)

    @cached_property
    def normal(self) -> Array:
        return reduced_normal(self.search.problem, self.rows, self.part)

    @cached_property
    def gradient(self) -> Array:
        return np.asarray(self.rows @ self.part.residual)


class _Search:
    """The non-linear iteration over one prepared frame."""

    def __init__(
        self, problem: SeparableProblem, response: Response, bounds: Bounds, steps: Array
    ) -> None:
        self.problem, self.response, self.bounds = problem, response, bounds
        self.steps = steps

    def signal(self, params: Array) -> Array:
        return np.asarray(self.response(params), dtype=float)[self.problem.keep]

    def at(self, params: Array) -> _Point | None:
        signal = self.signal(params)
        if not np.all(np.isfinite(signal)):
            return None
        return _Point(self, params, solve_linear(self.problem, signal))

    def jacobian(self, params: Array, part: LinearPart, *, central: bool = False) -> Array:
        """Weighted dI/dparam (p, n) at fixed coefficients."""
        here = None if central else part.signal
        rows = np.empty((params.size, self.problem.size))
        for j, step in enumerate(self.steps):
            up, down = params.copy(), params.copy()
            up[j] += step if params[j] + step <= self.bounds.high[j] else 0.0
            if (central or up[j] == params[j]) and params[j] - step >= self.bounds.low[j]:
                down[j] -= step
            above = self.signal(up)
            below = here if here is not None and down[j] == params[j] else self.signal(down)
            rows[j] = (above - below) * (part.amplitude / max(up[j] - down[j], 1e-300))
        return rows


def reduced_normal(problem: SeparableProblem, rows: Array, part: LinearPart) -> Array:
    """J^T J with the linear unknowns eliminated, (p, p): of the rows less what those explain."""
    split = len(problem.light)
    cross = np.concatenate((problem.light @ (rows * part.signal).T, problem.dark @ rows.T))
    known = part.inverse @ cross
    projected = (
        rows - (known[:split].T @ problem.light) * part.signal - known[split:].T @ problem.dark
    )
    return projected @ projected.T


def _result(
    image: ArrayLike,
    search: _Search,
    descent: Descent[_Point],
    rows: Array,
    illumination: Array,
    background: Array,
) -> IntensityFit:
    split, problem = len(illumination), search.problem
    params, part = descent.values, descent.point.part
    a, c = part.coefficients[:split], part.coefficients[split:]
    dof = problem.size - params.size - len(part.coefficients)
    chi = float(np.sqrt(part.cost / dof))
    normal = reduced_normal(problem, rows, part)
    covariance = max(1.0, chi) ** 2 * scaled_inverse(normal, 1e-14)
    determined = is_determined(normal, np.sum(rows**2, axis=1))
    spread = standard_uncertainty(covariance, determined)
    light, dark = np.tensordot(a, illumination, 1), np.tensordot(c, background, 1)
    signal = np.asarray(search.response(params), dtype=float)
    model = light * signal + dark
    residual = np.where(problem.keep, np.asarray(image, dtype=float) - model, np.nan)
    return IntensityFit(
        values=params, standard_uncertainty=spread, covariance=covariance, chi=chi,
        illumination_coefficients=a, background_coefficients=c,
        illumination_map=light, background_map=dark, signal=signal, residual=residual,
        converged=descent.converged and bool(np.all(np.isfinite(spread))), positive=part.positive,
    )  # fmt: skip


APART = 0.1
"""Natural changes of a parameter below which two starts, or two minima, count as one."""


@dataclass(frozen=True)
class Minimum:
    """One minimum that a refined start led to; chi is inf where the light is negative."""

    values: Array
    chi: float

    @classmethod
    def of(cls, fit: IntensityFit) -> Minimum:
        """The minimum that a fit came to."""
        return cls(fit.values, fit.chi if fit.positive else np.inf)


@dataclass(frozen=True)
class SeveralStarts:
    """The best fit, and the other minima by rising chi."""

    best: IntensityFit
    others: tuple[Minimum, ...]


def several_starts(
    image: ArrayLike,
    response: Response,
    starts: ArrayLike,
    *,
    illumination: Array,
    background: Array,
    mask: NDArray[np.bool_] | None = None,
    sigma: ArrayLike = 1.0,
    scale: ArrayLike,
    refine: int = 3,
    scan_pixels: int = 30_000,
    **options: Any,
) -> SeveralStarts:
    """Scan many starts (m, p) on a thinned frame, refine the best few, fit the best one in full.

    Parameters as in `fit_intensity`; `scan_pixels`, those of the thinned frame. PhysicsError where
    no start gives a positive illumination.
    """
    table = np.atleast_2d(np.asarray(starts, dtype=float))
    size = np.abs(np.asarray(scale, dtype=float))
    frame = np.asarray(image, dtype=float)
    valid = np.isfinite(frame) if mask is None else np.asarray(mask, dtype=bool)
    thin = stride_mask(valid, scan_pixels)
    light: dict[str, Any] = {
        "illumination": illumination, "background": background, "sigma": sigma,
    }  # fmt: skip
    problem = prepare(frame, mask=thin, **light)
    chi = np.array([evaluate_prepared(problem, np.asarray(response(s), float)).chi for s in table])
    fits = [
        fit_intensity(frame, response, table[i], mask=thin, scale=size, **light, **options)
        for i in _chosen(table, chi, size, refine)
    ]
    minima = sorted(map(Minimum.of, fits), key=lambda m: m.chi)
    if not minima or not np.isfinite(minima[0].chi):
        raise PhysicsError("no_start_gives_positive")
    best = fit_intensity(
        frame, response, minima[0].values, mask=valid, scale=size, **light, **options
    )
    others: list[Minimum] = []
    for minimum in minima:
        known = [best.values, minima[0].values, *(m.values for m in others)]
        if np.isfinite(minimum.chi) and not _near(minimum.values, known, size):
            others.append(minimum)
    return SeveralStarts(best, tuple(others))


def _near(values: Array, others: list[Array], size: Array) -> bool:
    return any(float(np.max(np.abs(values - s) / size)) < APART for s in others)


def _chosen(table: Array, chi: Array, size: Array, count: int) -> list[int]:
    """Indices of the best `count` finite starts that are not next to each other."""
    chosen: list[int] = []
    for i in np.argsort(chi, kind="stable"):
        if len(chosen) == count or not np.isfinite(chi[i]):
            break
        if not _near(table[i], [table[j] for j in chosen], size):
            chosen.append(int(i))
    return chosen


def stride_mask(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """Thin a mask (rows, cols) to about `pixels` valid pixels by one stride along both axes."""
    step = max(1, int(np.sqrt(np.count_nonzero(mask) / max(1, pixels))))
    if step == 1:
        return mask
    thin = np.zeros_like(mask)
    thin[step // 2 :: step, step // 2 :: step] = mask[step // 2 :: step, step // 2 :: step]
    return thin
