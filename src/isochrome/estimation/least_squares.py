"""Damped least squares for one problem: Levenberg's and Marquardt's steps inside bounds.

With the residual r and its derivatives J, N = Jᵀ J and g = Jᵀ r, a step s solves
(N + λ diag N) s = g, which promises to lower r·r by s·(2 g - N s). The damping λ follows what came
of that promise. Many small problems side by side are `isochrome.estimation.batched`.
Sources: Levenberg (1944), Q. Appl. Math. 2, 164; Marquardt (1963), J. SIAM 11, 431; Nielsen (1999),
Damping Parameter in Marquardt's Method, IMM-REP-1999-05, DTU, for the damping.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation.separable import scaled_inverse

Array = NDArray[Any]

CUTOFF = 1e-14
"""Eigenvalue over the largest below which a direction of the normal equations is not moved in."""

_EASIEST = 1e-2
"""Part of the damping that is left after a step which does all that it promised."""


class Point(Protocol):
    """Where an iteration stands."""

    @property
    def cost(self) -> float:
        """The sum of squares r·r."""

    @property
    def normal(self) -> Array:
        """The normal equations' matrix N (p, p)."""

    @property
    def gradient(self) -> Array:
        """Their right side g (p,)."""


P = TypeVar("P", bound=Point)
Restriction = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Damping:
    """The damping λ of one problem, what it is multiplied by next, and what it rises from."""

    value: float
    growth: float = 2.0
    least: float = 0.0

    def lighter(self, gained: float, promised: float) -> Damping:
        """The damping after a step that was taken, from what it gained and had promised to.

        Equation: λ max(1/100, 1 - (2 gained/promised - 1)³).
        """
        # a step that was cut at a bound may promise nothing at all
        ratio = gained / promised if promised > 0.0 else 0.0
        easier = max(_EASIEST, 1.0 - (2.0 * ratio - 1.0) ** 3)
        return replace(self, value=self.value * easier, growth=2.0)

    def heavier(self) -> Damping:
        """The damping after a step that was not taken: times 2, 4, 8, ..."""
        heavy = max(self.value, self.least) * self.growth
        return replace(self, value=heavy, growth=self.growth * 2.0)


@dataclass(frozen=True)
class Bounds:
    """The least and the largest value of each unknown, (p,)."""

    low: Array
    high: Array

    def free(self, values: Array, gradient: Array) -> NDArray[np.bool_]:
        """Unknowns (p,) that are not at a bound which the gradient pushes them against."""
        held = ((values <= self.low) & (gradient < 0)) | ((values >= self.high) & (gradient > 0))
        return np.asarray(~held)

    def cut(self, values: Array, step: Array) -> Array:
        """A step (p,) that ends at the bounds."""
        return np.asarray(np.clip(values + step, self.low, self.high) - values)


@dataclass(frozen=True)
class Descent(Generic[P]):
    """Where the steps ended: `values` (p,), the `point` there, the next `step`, `converged`."""

    values: Array
    point: P
    step: Array
    converged: bool


def damped(normal: Array, damping: float) -> Array:
    """The matrix N + λ diag N of Marquardt."""
    return np.asarray(normal + damping * np.diag(np.diag(normal)))


def damped_step(
    normal: Array,
    gradient: Array,
    damping: float,
    free: NDArray[np.bool_],
    *,
    cutoff: float = CUTOFF,
) -> Array:
    """The step of the free unknowns, of normal equations N and g; 0 for the others.

    `cutoff`: eigenvalue over the largest below which no step is taken, see `scaled_inverse`.
    """
    step = np.zeros(len(gradient))
    moved = np.flatnonzero(free)
    if moved.size:
        matrix = damped(normal[np.ix_(moved, moved)], damping)
        step[moved] = scaled_inverse(matrix, cutoff) @ gradient[moved]
    return step


def promised_gain(normal: Array, gradient: Array, step: Array) -> float:
    """How much a step s lowers r·r where the model is linear, s·(2 g - N s)."""
    return float(step @ (2.0 * gradient - normal @ step))


def minimise(
    at: Callable[[Array], P | None],
    values: Array,
    point: P,
    *,
    enough: Callable[[P], float],
    damping: Damping,
    iterations: int,
    better: Callable[[P, P], bool] | None = None,
    bounds: Bounds | None = None,
    cut: Restriction | None = None,
) -> Descent[P]:
    """Take steps from a point to the least sum of squares near it.

    `at`: from values (p,) to the point there, None where there is none; `enough`: from a point to
    the promised gain below which it is the end; `better`: of a new and the old point, by default
    less cost; `cut`: from values and a step to the step that is taken, by default up to the bounds.
    """
    anywhere = np.full(values.size, np.inf)
    bounds = bounds or Bounds(-anywhere, anywhere)
    cut, better = cut or bounds.cut, better or _cheaper
    step = np.zeros(values.size)
    for _ in range(iterations):
        normal, gradient = point.normal, point.gradient
        free = bounds.free(values, gradient)
        step = cut(values, damped_step(normal, gradient, damping.value, free))
        gain = promised_gain(normal, gradient, step)
        if gain < enough(point):
            return Descent(values, point, step, True)
        trial = at(values + step)
        if trial is not None and better(trial, point):
            damping = damping.lighter(point.cost - trial.cost, gain)
            values, point = values + step, trial
        else:
            damping = damping.heavier()
    return Descent(values, point, step, False)


def _cheaper(trial: Point, point: Point) -> bool:
    return trial.cost < point.cost
