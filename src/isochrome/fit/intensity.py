"""Separable least squares on intensities: the engine of every fit.

A pixel's model is I = f(params) sum_k a_k B_k + sum_k c_k C_k. The linear coefficients are
eliminated (variable projection: Golub & Pereyra, SIAM J. Numer. Anal. 10, 1973, 413-432), with
Kaufman's Jacobian (BIT 15, 1975, 49-57), which is the Schur complement of the joint normal
equations; a Levenberg-Marquardt iteration inside bounds moves the few non-linear parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError
from isochrome.fit.linear import LinearPart, Problem, prepare, scaled_inverse, solve_linear

Array = NDArray[np.float64]
Response = Callable[[Array], ArrayLike]

STEP = 1e-4
"""Difference step in units of a parameter's scale; fits responses in single precision as well."""

UNDETERMINED = 1e-10
"""Part of a parameter's effect that illumination and background must leave to determine it."""


@dataclass(frozen=True)
class IntensityFit:
    """A fitted frame. Maps are (rows, cols); `residual` = image - model, NaN where masked.

    `standard_uncertainty` and `covariance` come from the Jacobian with the linear unknowns, times
    max(1, chi) and its square; chi = sqrt(sum (residual/sigma)^2 / degrees of freedom).
    `positive` is False where the illumination came out negative: a wrong basin.
    """

    values: Array
    standard_uncertainty: Array
    covariance: Array
    chi: float
    illumination_coefficients: Array
    background_coefficients: Array
    illumination_map: Array
    background_map: Array
    signal: Array
    residual: Array
    evaluations: int
    converged: bool
    positive: bool


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
    max_iterations: int = 50,
    tolerance: float = 1e-3,
    central: bool = True,
) -> IntensityFit:
    """Fit a polariscope's signal to a frame, illumination and background eliminated linearly.

    Parameters: `image` (rows, cols), any linear intensity unit; `response`, params (p,) to the
    ideal signal 0..1 (rows, cols), such as sin^2(pi N); `start` (p,); `illumination`,
    `background`, basis stacks (k, rows, cols), see `polynomial_basis`; `mask`, True = valid;
    `sigma`, the noise in the image's unit, a number or (rows, cols); `lower`, `upper` (p,)
    bounds; `scale` (p,), a natural change of each parameter (default |start|, or 1 at 0), whose
    1e-4 is the difference step; `tolerance`, the last step in standard uncertainties;
    `central`, whether the uncertainties' derivatives are taken both ways (False: as in the search,
    for a response that costs much).
    Returns an IntensityFit. Raises InputError for shapes that do not agree, a start where the
    response is not finite, or more unknowns than pixels.
    """
    problem = prepare(
        image, mask=mask, sigma=sigma, illumination=illumination, background=background
    )
    first = np.atleast_1d(np.asarray(start, dtype=float))
    low = np.full(first.size, -np.inf) if lower is None else np.asarray(lower, dtype=float)
    high = np.full(first.size, np.inf) if upper is None else np.asarray(upper, dtype=float)
    size = np.where(first == 0, 1.0, np.abs(first)) if scale is None else np.asarray(scale, float)
    if problem.size <= first.size + len(illumination) + len(background):
        raise InputError(f"{problem.size} valid pixels are fewer than the unknowns; widen the mask")
    search = _Search(problem, response, low, high, STEP * np.abs(size))
    params, part, converged = search.run(np.clip(first, low, high), max_iterations, tolerance)
    rows = search.jacobian(params, part, central=central)
    return _result(image, search, params, part, rows, converged, illumination, background)


class _Search:
    """The non-linear iteration over one prepared frame."""

    def __init__(
        self, problem: Problem, response: Response, low: Array, high: Array, steps: Array
    ) -> None:
        self.problem, self.response, self.low, self.high = problem, response, low, high
        self.steps, self.evaluations = steps, 0

    def signal(self, params: Array) -> Array:
        self.evaluations += 1
        return np.asarray(self.response(params), dtype=float)[self.problem.keep]

    def linear(self, params: Array) -> LinearPart | None:
        signal = self.signal(params)
        return solve_linear(self.problem, signal) if np.all(np.isfinite(signal)) else None

    def jacobian(self, params: Array, part: LinearPart, *, central: bool = False) -> Array:
        """Weighted dI/dparam (p, n) at fixed coefficients."""
        here = None if central else part.signal
        rows = np.empty((params.size, self.problem.size))
        for j, step in enumerate(self.steps):
            up, down = params.copy(), params.copy()
            up[j] += step if params[j] + step <= self.high[j] else 0.0
            if (central or up[j] == params[j]) and params[j] - step >= self.low[j]:
                down[j] -= step
            above = self.signal(up)
            below = here if here is not None and down[j] == params[j] else self.signal(down)
            rows[j] = (above - below) * (part.amplitude / max(up[j] - down[j], 1e-300))
        return rows

    def run(
        self, params: Array, max_iterations: int, tolerance: float
    ) -> tuple[Array, LinearPart, bool]:
        """Levenberg-Marquardt with Nielsen's damping; steps are cut at the bounds."""
        part = self.linear(params)
        if part is None:
            raise InputError(f"the response is not finite at the start {params}; start elsewhere")
        damping, growth = 1e-3, 2.0
        rows = None
        for _ in range(max_iterations):
            if rows is None:
                rows = self.jacobian(params, part)
                normal, gradient = reduced_normal(self.problem, rows, part), rows @ part.residual
            step = self._step(params, normal, gradient, damping)
            gain = float(step @ (2.0 * gradient - normal @ step))
            noise = max(1.0, part.cost / self.problem.size)
            if gain < tolerance**2 * noise:
                return params, part, True
            trial = self.linear(params + step)
            if _better(trial, part):
                ratio = (part.cost - trial.cost) / gain
                params, part, rows = params + step, trial, None
                damping, growth = damping * max(1e-2, 1.0 - (2.0 * ratio - 1.0) ** 3), 2.0
            else:
                damping, growth = damping * growth, growth * 2.0
        return params, part, False

    def _step(self, params: Array, normal: Array, gradient: Array, damping: float) -> Array:
        """The damped step over the parameters that are free to move, cut at the bounds."""
        held = ((params <= self.low) & (gradient < 0)) | ((params >= self.high) & (gradient > 0))
        free = np.flatnonzero(~held)
        step = np.zeros_like(params)
        if free.size:
            matrix = normal[np.ix_(free, free)]
            matrix = matrix + damping * np.diag(np.diag(matrix))
            step[free] = scaled_inverse(matrix, 1e-14) @ gradient[free]
        return np.clip(params + step, self.low, self.high) - params


def reduced_normal(problem: Problem, rows: Array, part: LinearPart) -> Array:
    """J^T J with the linear unknowns eliminated, (p, p): of the rows less what those explain."""
    split = len(problem.light)
    cross = np.concatenate((problem.light @ (rows * part.signal).T, problem.dark @ rows.T))
    known = part.inverse @ cross
    rest = rows - (known[:split].T @ problem.light) * part.signal - known[split:].T @ problem.dark
    return rest @ rest.T


def _better(trial: LinearPart | None, part: LinearPart) -> TypeGuard[LinearPart]:
    """Whether a step lowers the cost without turning the light negative: another basin's sign."""
    if trial is None or (part.positive and not trial.positive):
        return False
    return trial.cost < part.cost


def _result(
    image: ArrayLike,
    search: _Search,
    params: Array,
    part: LinearPart,
    rows: Array,
    converged: bool,
    illumination: Array,
    background: Array,
) -> IntensityFit:
    split, problem = len(illumination), search.problem
    a, c = part.coefficients[:split], part.coefficients[split:]
    dof = problem.size - params.size - len(part.coefficients)
    chi = float(np.sqrt(part.cost / dof))
    normal = reduced_normal(problem, rows, part)
    covariance = max(1.0, chi) ** 2 * scaled_inverse(normal, 1e-14)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    spread[np.diag(normal) <= UNDETERMINED * np.sum(rows**2, axis=1)] = np.inf
    light, dark = np.tensordot(a, illumination, 1), np.tensordot(c, background, 1)
    signal = np.asarray(search.response(params), dtype=float)
    model = light * signal + dark
    residual = np.where(problem.keep, np.asarray(image, dtype=float) - model, np.nan)
    return IntensityFit(
        params, spread, covariance, chi, a, c, light, dark, signal, residual,
        search.evaluations, converged and bool(np.all(np.isfinite(spread))), part.positive,
    )  # fmt: skip
