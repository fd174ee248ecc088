"""The search for the ends of the light: damped steps on all unknowns, from several starts.

A patch that touches a crest and one that crosses it fit nearly alike, and a search that starts with
the bright end too low leaves patches on the wrong side: that is why it starts more than once, looks
at every patch afresh now and then, and keeps the cheaper result. Where two results cost about the
same the light does not tell which is right, and their difference is an uncertainty.
Sources: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413, for the elimination; Levenberg
(1944), Q. Appl. Math. 2, 164, for the damping.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from isochrome.errors import InputError
from isochrome.fringes.ends_patches import Indices, fresh_patches, overlap
from isochrome.fringes.ends_problem import (
    Normal,
    PatchData,
    Problem,
    eliminated,
    look,
    refine,
    total,
)
from isochrome.fringes.patches import Array, offsets

_ROUNDS, _EVERY = 24, 4
"""Steps at most, and between two fresh looks at the patches."""
_REST = 3e-4
"""Change of the order by a step, fringes, below which the search rests."""
_STALE = 0.02
"""Share of patches that a fresh look may improve on at rest."""
_READABLE = 0.03
TONES = 0.2, 5.0
_HEAVIEST = 1e2
_LOST = 0.5
"""Difference of a patch's residual over noise, squared, that counts at most in a comparison."""
_PIXELS = float(offsets()[2].sum())
NOT_TOLD = (
    "this frame's fringes do not tell its background, illumination and gamma apart: give both "
    "no-load frames, or state frames.gamma"
)
_DOUBT = 40.0
"""Difference of cost, about -2 ln of the likelihood, within which two results are both possible."""


@dataclass(frozen=True)
class Found:
    """The unknowns, their `covariance`, the last `change` of the order, and the median `chi`.

    `index` of the patches in use, `patch_cost`, residual over noise squared (p,), and what the
    unknowns' prior adds.
    """

    unknowns: Array
    covariance: Array
    change: float
    chi: float
    index: Indices = field(repr=False)
    patch_cost: Array = field(repr=False)
    prior_cost: float

    @property
    def rests(self) -> bool:
        """Whether the search came to rest."""
        return self.change < _REST


def search_all(problem: Problem, starts: list[Array]) -> Found:
    """The best result of several starts.

    Parameters: `problem`; `starts`, vectors of its unknowns. Returns the Found; another that costs
    about the same widens its covariance. Raises InputError where no fringe can be followed, or
    where the fringes leave the unknowns open.
    """
    found = [result for start in starts if (result := _tried(problem, start)) is not None]
    if not found:
        raise InputError(NOT_TOLD)
    best = found[0]
    for other in found[1:]:
        best = other if _dearer(best, other) > 0.0 else best
    covariance = best.covariance
    for other in found:
        if _dearer(other, best) < _DOUBT:
            away = other.unknowns - best.unknowns
            covariance = covariance + np.outer(away, away)
    return replace(best, covariance=covariance)


def _tried(problem: Problem, start: Array) -> Found | None:
    """What a start leads to, None where it leads to unknowns that the fringes leave open."""
    try:
        found = _search(problem, start)
    except np.linalg.LinAlgError:
        return None
    whole = np.isfinite(found.unknowns).all() and np.isfinite(found.covariance).all()
    return found if whole else None


def _dearer(one: Found, other: Found) -> float:
    """How much more a result costs than another, by the patches that both use.

    No patch decides alone: one on a defect may come to rest anywhere.
    """
    _, a, b = np.intersect1d(one.index, other.index, return_indices=True)
    away = np.clip(one.patch_cost[a] - other.patch_cost[b], -_LOST, _LOST)
    return float(_PIXELS * away.sum() + one.prior_cost - other.prior_cost)


def tone_step(problem: Problem, unknowns: Array) -> tuple[float, float]:
    """Change of g from where the ends rest, and its standard uncertainty, by one linear step.

    Parameters: `problem`, of unknown tone; `unknowns`, found with g held. Returns both numbers.
    """
    data, orders, _ = fresh_patches(problem, unknowns)
    try:
        normal = eliminated(problem, data, unknowns, orders)
        covariance = np.linalg.inv(normal.matrix)
    except np.linalg.LinAlgError as error:
        raise InputError(NOT_TOLD) from error
    return float((covariance @ normal.slope)[-1]), float(
        np.sqrt(overlap(data) * covariance[-1, -1])
    )


def _search(problem: Problem, unknowns: Array) -> Found:
    data, orders, _ = fresh_patches(problem, unknowns)
    damping, since, change, resting = 1e-3, 0, np.inf, False
    own, cost = _start(problem, data, unknowns, orders)
    for _ in range(_ROUNDS):
        if resting or since >= _EVERY:
            data, orders, stale = fresh_patches(problem, unknowns, (data, orders))
            if resting and stale < _STALE:
                break
            own, cost = _start(problem, data, unknowns, orders)
            since, resting = 0, False
        normal = eliminated(problem, data, unknowns, orders)
        while True:
            step = _damped(normal, damping)
            tried = _followed(problem, data, unknowns, orders, own, normal, step)
            if tried[0] < cost or damping > _HEAVIEST:
                break
            damping *= 8.0
        change = _change(normal, step)
        resting, since = change < _REST, since + 1
        if tried[0] < cost:
            cost, unknowns, orders, own = tried
            damping = max(0.1 * damping, 1e-7)
        else:
            damping = 1e-3
    return _found(problem, data, unknowns, orders, change)


def _start(
    problem: Problem, data: PatchData, unknowns: Array, orders: Array
) -> tuple[Array, float]:
    """The patches' own damping, and the cost."""
    cost = look(problem, data, unknowns, orders).cost
    return np.full(len(orders), 1e-2), total(problem, cost, unknowns)


def _damped(normal: Normal, damping: float) -> Array:
    matrix = normal.matrix + damping * np.diag(np.diag(normal.matrix))
    return np.asarray(np.linalg.solve(matrix, normal.slope))


def _followed(
    problem: Problem,
    data: PatchData,
    unknowns: Array,
    orders: Array,
    own: Array,
    normal: Normal,
    step: Array,
) -> tuple[float, Array, Array, Array]:
    """Cost and place after a step, every patch going along where that is good for it."""
    new = unknowns.copy()
    new[problem.free] += step
    if not TONES[0] < new[-1] < TONES[1]:
        return np.inf, unknowns, orders, own
    along = orders + normal.pull - normal.drag @ step
    stay, go = (look(problem, data, new, tried).cost for tried in (orders, along))
    nearer = np.where((go < stay)[:, None], along, orders)
    gone, cost, own = refine(problem, data, new, nearer, own, 2)
    return total(problem, cost, new), new, gone, own


def _change(normal: Normal, step: Array) -> float:
    """What a step in the ends does to the order where it can be read, RMS, fringes."""
    readable = normal.spread < _READABLE
    if not readable.any():
        return float("inf")
    moved = np.minimum(np.abs(normal.drag[readable, 0] @ step), 0.2)
    return float(np.sqrt(np.mean(moved**2)))


def _found(
    problem: Problem, data: PatchData, unknowns: Array, orders: Array, change: float
) -> Found:
    normal = eliminated(problem, data, unknowns, orders)
    free = problem.free
    covariance = np.zeros((len(unknowns), len(unknowns)))
    inverse = np.linalg.inv(normal.matrix) * overlap(data)
    if not change < _REST:
        last = _damped(normal, 0.0)
        inverse = inverse + np.outer(last, last)
    covariance[np.ix_(free, free)] = inverse
    cost = look(problem, data, unknowns, orders).cost * np.maximum(data.chi, 1.0) ** 2
    weight, away = problem.prior(unknowns)
    return Found(
        unknowns,
        covariance,
        change,
        float(np.median(data.chi)),
        data.index,
        cost / data.window,
        float((weight * away**2)[free].sum()),
    )
