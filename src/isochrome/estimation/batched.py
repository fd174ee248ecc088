"""Damped least squares for many small problems side by side, all in the same few operations.

Each has its own damping, which a step that lowers the cost eases, and one that does not stiffens; a
problem whose step is not taken, or whose matrix is singular, waits where it is. See
`isochrome.estimation.least_squares` for one.
Sources: Levenberg (1944), Q. Appl. Math. 2, 164; Marquardt (1963), J. SIAM 11, 431.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Mask = NDArray[np.bool_]
State = tuple[Array, ...]

EASED, STIFFENED = 0.2, 8.0
"""What a damping is multiplied by after a step that was taken, and after one that was not."""


def next_damping(damping: Array | float, better: Mask | bool) -> Array:
    """The damping λ (m,) after steps of which those are taken that were better, lowered the cost.

    Less after a step that was taken, more after one that was not.
    """
    return np.where(better, EASED * damping, STIFFENED * damping)


def solve_all(matrices: Array, right: Array) -> Array:
    """Solve m systems A x = b, (m, p, p) and (m, p, q); a singular one is NaN and leaves the others
    alone.
    """
    try:
        return np.asarray(np.linalg.solve(matrices, right))
    except np.linalg.LinAlgError:  # of one of them, and nothing is said of which
        regular = np.linalg.slogdet(matrices)[0] != 0.0
        found = np.full(right.shape, np.nan)
        found[regular] = np.linalg.solve(matrices[regular], right[regular])
        return found


def damped_steps(normal: Array, gradient: Array, damping: Array) -> Array:
    """Damped steps s (m, p) of m problems, (N + λ diag N) s = g, NaN where N is singular.

    `normal` N (m, p, p) is damped in place.
    """
    diagonal = np.arange(normal.shape[-1])
    normal[:, diagonal, diagonal] *= 1.0 + damping[:, None]
    return np.asarray(solve_all(normal, gradient[..., None])[..., 0])


def minimise_all(
    at: Callable[[Array], State],
    equations: Callable[[Array, State], tuple[Array, Array]],
    values: Array,
    damping: Array,
    *,
    steps: int,
    limits: tuple[float, float] = (0.0, np.inf),
) -> tuple[Array, State, Array]:
    """Take steps of m problems at once, each where it lowers the problem's cost.

    `at`: from values (m, p) to arrays (m, ...), the costs (m,) first; `equations`: from values and
    these to N (m, p, p) and g (m, p); `limits`: least and largest damping λ. Returns where the
    steps ended: values, what `at` says there, λ (m,).
    """
    now = at(values)
    for _ in range(steps):
        normal, gradient = equations(values, now)
        trial = values + damped_steps(normal, gradient, damping).astype(values.dtype)
        new = at(trial)
        better = new[0] < now[0]
        values = where_better(better, trial, values)
        now = tuple(where_better(better, n, o) for n, o in zip(new, now, strict=True))
        damping = np.clip(next_damping(damping, better), *limits)
    return values, now, damping


def where_better(better: Mask, new: Array, old: Array) -> Array:
    """Rows of `new` (m, ...) where a step was taken, of `old` where it was not."""
    return np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
