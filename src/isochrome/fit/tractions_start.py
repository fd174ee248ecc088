"""Where an inversion begins: loads and bulk stress that the deep half of a frame agrees with.

A contact model that does not describe a frame may end far from it. Deep below the surface the
field is that of the resultants and of the bulk stress, a handful of numbers, in which many starts
cost little.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.tractions_basis import Basis
from isochrome.fit.tractions_solve import Problem, solve_tractions

Array = NDArray[Any]

LOADS = (0.8, 1.0, 1.25)
BULK_MPA = (-4.0, -2.0, 0.0, 2.0, 4.0)
SLOPES_MPA = (-2.0, 0.0, 2.0)
_BINS = 1500
_STEPS = 12


@dataclass(frozen=True)
class Resultants:
    """Factors of the model's pressure and shear, mode amplitudes, and the chi they leave."""

    pressure: float
    shear: float
    modes: Array
    chi: float


@dataclass(frozen=True)
class _Few(Basis):
    """A basis of one pressure, one shear, and the regular modes."""

    @property
    def signed(self) -> int:
        """The pressure's factor alone has a sign."""
        return 1


def search_resultants(
    problem: Problem, basis: Basis, pressure: Array, shear: Array, modes: Array
) -> list[Resultants]:
    """Minima of a few unknowns: the model's pressure and shear by a factor each, and bulk stress.

    Parameters: `problem`, deep bins; `basis` of them; `pressure`, `shear` (n,), the model's at the
    basis' nodes (MPa); `modes`, where they start. Returns distinct Resultants by rising chi.
    """
    thin = np.zeros(len(problem.bins.light), bool)
    thin[:: max(1, len(thin) // _BINS)] = True
    small = replace(problem, bins=problem.bins.where(thin))
    columns, n = basis.columns[thin], basis.nodes
    press = 0.5 * (columns[:, :n] + columns[:, n : 2 * n])
    tangent = 0.5 / basis.limit * (columns[:, :n] - columns[:, n : 2 * n])
    fields = [press @ pressure, tangent @ (shear if shear.any() else pressure)]
    few = _Few(
        np.concatenate([np.stack(fields, 1), columns[:, 2 * n :]], 1).astype(np.complex64),
        basis.nodes_px[:0], basis.spacing_px, basis.limit, basis.modes,
    )  # fmt: skip
    first = 1.0 if shear.any() else 0.0
    found: list[Resultants] = []
    for start in _starts(modes, first):
        solution = solve_tractions(
            small, few, 1e-9 * np.eye(len(start)), start, steps=_STEPS, fine=False
        )
        c = solution.unknowns
        found.append(Resultants(float(c[0]), float(c[1]), c[2:], solution.chi))
    found.sort(key=lambda r: r.chi)
    return _distinct(found)


def _starts(modes: Array, first: float) -> list[Array]:
    starts = []
    for load, bulk, *slopes in product(LOADS, BULK_MPA, *([SLOPES_MPA] * 2)):
        more = np.zeros(len(modes))
        more[0] = bulk
        more[1:3] = slopes[: len(modes) - 1]
        starts.append(np.r_[load, first * load, modes + more])
    return starts


def _distinct(found: list[Resultants]) -> list[Resultants]:
    kept: list[Resultants] = []
    for one in found:
        far = (
            abs(one.pressure - other.pressure) > 0.02 or np.abs(one.modes - other.modes).max() > 0.3
            for other in kept
        )
        if all(far):
            kept.append(one)
    return kept
