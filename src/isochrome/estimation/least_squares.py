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
    """The damping of one problem.

    Parameters
    ----------
    value : float
        The damping λ.
    growth : float, optional
        By what it is multiplied next.
    least : float, optional
        What it rises from.
    """

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
    """The least and the largest value of each unknown.

    Parameters
    ----------
    low, high : (p,) array
        The bounds.
    """

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
    """The matrix N + λ diag N of Marquardt.

    Parameters
    ----------
    normal : (p, p) array
        Normal equations' matrix N.
    damping : float
        Damping λ.

    Returns
    -------
    (p, p) array
        The damped matrix.
    """
    return np.asarray(normal + damping * np.diag(np.diag(normal)))


def damped_step(
    normal: Array,
    gradient: Array,
    damping: float,
    free: NDArray[np.bool_],
    *,
    cutoff: float = CUTOFF,
) -> Array:
    """The step of the free unknowns; the others stay.

    Parameters
    ----------
    normal : (p, p) array
        Normal equations' matrix N.
    gradient : (p,) array
        Their right side g.
    damping : float
        Damping λ.
    free : (p,) array of bool
        Unknowns that move.
    cutoff : float, optional
        Eigenvalue over the largest below which no step is taken, see `scaled_inverse`.

    Returns
    -------
    (p,) array
        The step, 0 for those that are not free.
    """
    step = np.zeros(len(gradient))
    moved = np.flatnonzero(free)
    if moved.size:
        matrix = damped(normal[np.ix_(moved, moved)], damping)
        step[moved] = scaled_inverse(matrix, cutoff) @ gradient[moved]
    return step


def promised_gain(normal: Array, gradient: Array, step: Array) -> float:
    """How much a step s lowers r·r where the model is linear, s·(2 g - N s).

    Parameters
    ----------
    normal : (p, p) array
        Normal equations' matrix N.
    gradient : (p,) array
        Their right side g.
    step : (p,) array
        The step s.

    Returns
    -------
    float
        The promised gain.
    """
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

    Parameters
    ----------
    at : callable
        From values (p,) to the Point there, None where there is none.
    values : (p,) array
        Where to start.
    point : Point
        The one at `values`: its cost, normal equations and gradient.
    enough : callable
        From a point to the promised gain below which it is the end.
    damping : Damping
        The damping to begin with.
    iterations : int
        Steps at the most.
    better : callable, optional
        Of a new point and the old one, whether the new is taken; by default where its cost is less.
    bounds : Bounds, optional
        Bounds of the values.
    cut : callable, optional
        From values and a step to the step that is taken; by default up to the bounds.

    Returns
    -------
    Descent
        Where the steps ended: `values`, `point`, the next `step`, and whether they `converged`.
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
