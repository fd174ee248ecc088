"""The nearest point of a curve to what a fit found, in the fit's own metric."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_ITERATIONS, _SETTLED = 60, 1e-3
"""Most steps; and the last one's predicted gain, in variances and over the distance left."""


def marginal(information: Array, kept: list[int]) -> tuple[Array, Array]:
    """What is known of some unknowns whatever the others are: the Schur complement.

    Equation: N_kk - N_kr N_rr^-1 N_rk. Parameters: `information` (p, p); `kept`, indices (k,).
    Returns it for the kept unknowns times `size`, (k, k), and `size` (k,), with which the
    information's diagonal is one.
    """
    rest = [k for k in range(len(information)) if k not in kept]
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(size, size)
    cross = scaled[np.ix_(kept, rest)]
    left = scaled[np.ix_(kept, kept)]
    if rest:
        left = left - cross @ np.linalg.solve(scaled[np.ix_(rest, rest)], cross.T)
    return left, size[kept]


def nearest_point(
    curve: Callable[[Array], Array],
    unknown: Array,
    centre: Array,
    steps: Array,
    information: Array,
    precision: Array,
) -> tuple[float, float, Array, Array]:
    """The point of a curve that is nearest to zero, by damped Gauss-Newton steps.

    Equation: the least of c(u)^T N c(u) + (u - u0)^T Λ (u - u0).
    Parameters: `curve` c, unknowns (m,) to (k,); `unknown` (m,), where it starts; `centre` u0 and
    `precision`, the diagonal of Λ (m,), of the prior; `steps` (m,), of differences; `information`
    N (k, k). Returns the least value, its first part, the unknowns there, and the normal matrix
    J^T N J + Λ (m, m). Source: Levenberg (1944), Quart. Appl. Math. 2, 164.
    """
    here, damping = curve(unknown), 0.0
    total = float(here @ information @ here + precision @ (unknown - centre) ** 2)
    for _ in range(_ITERATIONS):
        slope = np.empty((len(here), len(unknown)))
        for k, step in enumerate(steps):
            ahead = unknown.copy()
            ahead[k] += step
            slope[:, k] = (curve(ahead) - here) / step
        matrix = slope.T @ information @ slope + np.diag(precision)
        pull = slope.T @ information @ here + precision * (unknown - centre)
        damped = matrix + damping * np.diag(np.diag(matrix))
        move = -np.linalg.solve(damped, pull)
        if -float(move @ pull) < _SETTLED * (1.0 + _SETTLED * total):
            break
        trial = curve(unknown + move)
        reached = float(trial @ information @ trial + precision @ (unknown + move - centre) ** 2)
        if reached <= total:
            unknown, here, total, damping = unknown + move, trial, reached, 0.1 * damping
        else:
            damping = max(1e-3, 10.0 * damping)
    return total, float(here @ information @ here), unknown, matrix
