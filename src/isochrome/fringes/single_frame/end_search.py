"""The search for the ends of the light: damped steps on all unknowns, from several starts.

A patch that touches a crest and one that crosses it fit nearly alike, and a search that starts with
the bright end too low leaves patches on the wrong side: that is why it starts more than once, looks
at every patch afresh now and then, and keeps the cheaper result. For that the frame is normalised
by the ends as they stand, cut into patches and fitted by quadratics as any frame is (`patches`);
those that can be followed are used, with their light as it is. Where two results cost about the
same the light does not tell which is right: the frame is read by both (`possible`), and where only
numbers are wanted, such as the exponent, their difference is an uncertainty.
The loop is not `isochrome.estimation.minimise`: the patches follow each step by steps of their own
and are made anew in between, and a cost is compared only as long as they are the same ones.
Sources: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413, for the elimination; Levenberg
(1944), Q. Appl. Math. 2, 164, for the damping.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import damped
from isochrome.fringes.single_frame.end_images import as_spotted, spots_beyond_prior
from isochrome.fringes.single_frame.end_problem import (
    TERMS,
    EndEquations,
    EndProblem,
    PatchData,
    eliminated,
    ends_at,
    look,
    refine_ends,
    total,
)
from isochrome.fringes.single_frame.patches import (
    HALF,
    STRIDE,
    WORST_CHI,
    fit_patches,
    gather_patches,
    offsets,
)
from isochrome.fringes.windows import Array, Indices, Mask

_ROUNDS, _EVERY = 24, 4
"""Steps at most, and between two fresh looks at the patches."""
_REST = 3e-4
"""Change of the order by a step, fringes, below which the search rests."""
_MORE = 2
"""Steps where a result is refined that rests but for what the problem leaves open besides."""
_FREELY = 0.1
"""Damping below which a step is small because the search rests."""
_STALE = 0.02
"""Share of patches that a fresh look may improve on at rest."""
_READABLE = 0.03
TONES = 0.2, 5.0
_HEAVIEST = 1e2
_LOST = 0.5, 0.1, 0.0
"""Difference of a patch's residual over noise, squared, that counts at most in a comparison where
both results describe it, one does, none."""
_PIXELS = float(offsets()[2].sum())
NOT_TOLD = "frame_fringes_cannot_separate"
_DOUBT = 40.0
"""Difference of cost, about -2 ln of the likelihood, within which two results are both possible,
where the light is as even as it is taken for; its costs say as much less as it is beyond that."""
_SAME = 2e-3
"""Difference of the patches' orders, fringes, below which two results are one."""
_BETTER = 0.97
"""Share of its former cost below which a patch counts as better."""
_MANY = 400
"""Patches from which every second is left out: they overlap, and tell the same twice."""
_LEAST_PATCHES = 12
_WORST_CHI, _LEAST_FILLED, _STEEPEST, _FAINT = 30.0, 0.5, 0.35, 0.1
_SPAN = 0.4 / (2 * HALF + 1)
"""Slope of a patch that tells the tone exponent, fringes a pixel: it spans 0.4 of a fringe. A
flatter one follows any exponent, and the noise of no-load frames, which stands in the slope and in
the residual, looks like one: errors in variables (Fuller (1987), Measurement error models)."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """The unknowns, their `covariance`, and the last `change` of the order.

    `index` of the patches in use, `patch_cost`, residual over noise squared (p,), and what the
    unknowns' prior adds; `price`, how much the frame narrows the prior down, ln det(1 + v M), which
    the evidence takes for it; `beyond_prior`, t² of `spots_beyond_prior`; the patches' `data` and
    `orders` at rest.
    """

    unknowns: Array
    covariance: Array
    change: float
    index: Indices = field(repr=False)
    patch_cost: Array = field(repr=False)
    prior_cost: float
    price: float
    beyond_prior: float
    data: PatchData = field(repr=False)
    orders: Array = field(repr=False)

    @property
    def rests(self) -> bool:
        """Whether the search came to rest."""
        return self.change < _REST


def search_all(problem: EndProblem, starts: list[Array]) -> list[Found]:
    """What each of several starts leads to.

    Parameters: `problem`; `starts`, vectors of its unknowns. Raises InputError where no fringe can
    be followed, or where the fringes leave the unknowns open.
    """
    outcome = [result for start in starts if (result := _tried(problem, start)) is not None]
    if not outcome:
        raise InputError(NOT_TOLD)
    return outcome


def possible(*models: list[Found]) -> list[Found]:
    """The results that the frame does not exclude, the best first.

    Models, such as light without and with spots, are compared by the evidence of their best, the
    results of one by their costs: what a result leaves open is no merit beside another's.
    Parameters: the results of each model. Returns those of other orders than the ones before.
    """
    one = models[0][0]
    cost = [min(_dearer(result, one) + result.price for result in results) for results in models]
    listed: list[Found] = []
    for k in np.argsort(cost, kind="stable"):
        if cost[k] >= min(cost) + _DOUBT:
            break
        best = cheapest(models[k])
        for result in (best, *models[k]):
            near = _dearer(result, best) < _DOUBT * best.beyond_prior
            if near and all(_differ(result, other) for other in listed):
                listed.append(result)
    return listed


def cheapest(results: list[Found]) -> Found:
    """The one of some results that costs least."""
    best = results[0]
    for other in results[1:]:
        best = other if _dearer(best, other) > 0.0 else best
    return best


def _tried(problem: EndProblem, start: Array) -> Found | None:
    """What a start leads to, None where it leads to unknowns that the fringes leave open."""
    try:
        result = _search(problem, start)
    except np.linalg.LinAlgError:
        return None
    whole = np.isfinite(result.unknowns).all() and np.isfinite(result.covariance).all()
    return result if whole else None


def _dearer(one: Found, other: Found) -> float:
    """How much more a result costs than another, by the patches that both use.

    A patch that a cubic does not describe, at a load or a tip, follows whatever light it is given;
    one that it describes in one result alone may rest on the wrong side of a crest, and counts
    little: no patch decides alone.
    """
    a, b = _of_both(one, other)
    first, second = one.patch_cost[a], other.patch_cost[b]
    poor = (first > WORST_CHI**2).astype(int) + (second > WORST_CHI**2)
    most = np.array(_LOST)[poor]
    away = np.clip(first - second, -most, most)
    return float(_PIXELS * away.sum() + one.prior_cost - other.prior_cost)


def _differ(one: Found, other: Found) -> bool:
    """Whether two results give other orders: fringes from the nearest whole number, RMS."""
    a, b = _of_both(one, other)
    first, second = (np.abs(n - np.rint(n)) for n in (one.orders[a, 0], other.orders[b, 0]))
    return bool(np.sqrt(np.mean((first - second) ** 2)) > _SAME) if len(a) else True


def _of_both(one: Found, other: Found) -> tuple[Indices, Indices]:
    """Numbers of the patches that two results use, in each of them."""
    _, a, b = np.intersect1d(one.index, other.index, return_indices=True)
    return a, b


def _search(problem: EndProblem, unknowns: Array) -> Found:
    data, orders, _ = fresh_patches(problem, unknowns)
    damping, since, change, resting = 1e-3, 0, np.inf, False
    own, cost = _start(data, unknowns, orders)
    for _ in range(_ROUNDS):
        if resting or since >= _EVERY:
            data, orders, stale = fresh_patches(problem, unknowns, (data, orders))
            if resting and stale < _STALE:
                break
            own, cost = _start(data, unknowns, orders)
            since, resting = 0, False
        normal = eliminated(data, ends_at(data, unknowns), orders)
        while True:
            step = _damped(normal, damping)
            tried = _followed(data, unknowns, orders, own, normal, step)
            if tried[0] < cost or damping > _HEAVIEST:
                break
            damping *= 8.0
        change = _change(normal, step)
        resting, since = change < _REST and damping < _FREELY, since + 1
        if tried[0] < cost:
            cost, unknowns, orders, own = tried
            damping = max(0.1 * damping, 1e-7)
        else:
            damping = 1e-3
        if resting and since == 1:
            break  # the fresh look has moved nothing
    return _found(data, unknowns, orders, change)


def search_on(found: Found, problem: EndProblem) -> Found:
    """A result as one of a problem that leaves more open, by full steps from where it rests.

    The patches are those in use. Parameters: `found`, its unknowns those of `problem`.
    """
    data = replace(found.data, problem=problem)
    unknowns, orders, change = found.unknowns, found.orders, found.change
    own, cost = _start(data, unknowns, orders)
    for _ in range(_MORE):
        normal = eliminated(data, ends_at(data, unknowns), orders)
        tried = _followed(data, unknowns, orders, own, normal, _damped(normal, 0.0))
        if not tried[0] < cost:
            break
        cost, unknowns, orders, own = tried
    return _found(data, unknowns, orders, change)


def _start(data: PatchData, unknowns: Array, orders: Array) -> tuple[Array, float]:
    """The patches' own damping, and the cost."""
    cost = look(data, ends_at(data, unknowns), orders).cost
    return np.full(len(orders), 1e-2), total(data, cost, unknowns)


def _damped(normal: EndEquations, damping: float) -> Array:
    return np.asarray(np.linalg.solve(damped(normal.matrix, damping), normal.slope))


def _followed(
    data: PatchData, unknowns: Array, orders: Array, own: Array, normal: EndEquations, step: Array
) -> tuple[float, Array, Array, Array]:
    """Cost and place after a step, every patch going along where that is good for it."""
    new = unknowns.copy()
    new[data.problem.free] += step
    if not TONES[0] < new[-1] < TONES[1]:
        return np.inf, unknowns, orders, own
    along = orders + normal.pull - normal.drag @ step
    ends = ends_at(data, new)
    stay, go = (look(data, ends, tried).cost for tried in (orders, along))
    nearer = np.where((go < stay)[:, None], along, orders)
    gone, cost, own = refine_ends(data, ends, nearer, own, 2)
    return total(data, cost, new), new, gone, own


def _change(normal: EndEquations, step: Array) -> float:
    """What a step in the ends does to the order where it can be read, RMS, fringes."""
    readable = normal.spread < _READABLE
    if not readable.any():
        return float("inf")
    moved = np.minimum(np.abs(normal.drag[readable, 0] @ step), 0.2)
    return float(np.sqrt(np.mean(moved**2)))


def _found(data: PatchData, unknowns: Array, orders: Array, change: float) -> Found:
    ends = ends_at(data, unknowns)
    normal = eliminated(data, ends, orders)
    free, spots = data.problem.free, data.problem.spots[data.problem.free]
    covariance = np.zeros((len(unknowns), len(unknowns)))
    inverse = np.linalg.inv(normal.matrix) * overlap(data)
    if not change < _REST:
        last = _damped(normal, 0.0)
        inverse = inverse + np.outer(last, last)
    prior = data.problem.prior(unknowns)[0][free]
    own = prior / overlap(data)
    larger = spots_beyond_prior(inverse, unknowns[free], own, spots)
    covariance[np.ix_(free, free)] = as_spotted(inverse, own, spots, larger)
    price = -np.linalg.slogdet(inverse)[1] - np.log(prior[prior > 0.0]).sum()
    left = look(data, ends, orders).residual
    cost = np.einsum("pk,pk,pk->p", data.weight, left, left) * np.maximum(data.chi, 1.0) ** 2
    prior_cost = data.problem.prior_cost(unknowns)
    return Found(
        unknowns=unknowns,
        covariance=covariance,
        change=change,
        index=data.index,
        patch_cost=cost / data.window,
        prior_cost=prior_cost,
        price=float(price),
        beyond_prior=larger,
        data=data,
        orders=orders,
    )


def fresh_patches(
    problem: EndProblem, unknowns: Array, before: tuple[PatchData, Array] | None = None
) -> tuple[PatchData, Array, float]:
    """Patches fitted anew at some unknowns, but kept where they were better.

    Parameters: `problem`; `unknowns` (terms,); `before`, the patches in use and their orders, if
    any. Returns the patches, their orders, and the share that was better anew. Raises InputError
    where too few can be followed.
    """
    index, places, window, start, thinned = _fitted(problem, unknowns)
    _check_number(len(index))
    data = _data(problem, index, places, window, np.ones(len(index)), thinned)
    ends = ends_at(data, unknowns)
    orders, cost, _ = refine_ends(data, ends, start, np.full(len(index), 1e-2), 3)
    stale = 1.0
    if before is not None:
        old = np.zeros_like(orders)
        was = np.full(len(index), np.inf)
        _, here, there = np.intersect1d(index, before[0].index, return_indices=True)
        old[here] = before[1][there]
        was[here] = look(data, ends, old).cost[here]
        orders = np.asarray(np.where((was <= cost)[:, None], old, orders))
        stale = float(np.mean(cost < _BETTER * was - 0.02 * data.window))
    misfit = look(data, ends, orders).residual
    chi = np.sqrt(np.einsum("pk,pk,pk->p", data.weight, misfit, misfit) / data.window)
    good = (chi < _WORST_CHI) & (np.abs(orders[:, 1:3]).max(axis=1) < _STEEPEST)
    if problem.tone and any(problem.given):
        good &= np.hypot(orders[:, 1], orders[:, 2]) > _SPAN
    _check_number(int(np.count_nonzero(good)))
    data = _data(problem, index[good], places[good], window[good], chi[good], thinned)
    return data, orders[good], stale


def _check_number(patches: int) -> None:
    """Refuse a frame of too few patches: raises InputError."""
    if patches < _LEAST_PATCHES:
        raise InputError("too_few_fringes_can")


def _fitted(problem: EndProblem, unknowns: Array) -> tuple[Indices, Indices, Array, Array, bool]:
    """Patches as `patches` fits them: index, middles, weights, terms; whether thinned."""
    light = gather_patches(*_normalised(problem, unknowns))
    use = light.filled > _LEAST_FILLED
    thinned = bool(np.count_nonzero(use) > _MANY)
    if thinned:
        row, col = np.indices((len(light.rows), len(light.cols)))
        use &= ((row + col) % 2 == 0).ravel()
    index = np.flatnonzero(use)
    _check_number(len(index))
    fitted = fit_patches(light.only(index))
    told = fitted.chi[0] < _WORST_CHI
    index = index[told]
    terms = np.zeros((len(index), TERMS))
    terms[:, :6] = fitted.terms[0, told]
    places = np.stack(np.meshgrid(light.rows, light.cols, indexing="ij"), axis=-1).reshape(-1, 2)
    return index, places[index], light.weight[index].astype(float), terms, thinned


def _normalised(problem: EndProblem, unknowns: Array) -> tuple[Array, Array, Mask]:
    """The frame's c = cos 2 pi N, its noise, and where it is trusted."""
    dark, bright = problem.ends(unknowns)
    g = unknowns[-1]
    contrast = bright - dark
    seen = problem.valid & (contrast > _FAINT * problem.scale**g)
    safe = np.where(seen, contrast, 1.0)
    level = np.maximum(problem.light, problem.sigma)
    linear = problem.light if g == 1.0 else level**g
    sigma = 2.0 * g * level ** (g - 1.0) * problem.sigma / safe
    return 1.0 - 2.0 * (linear - dark) / safe, sigma, seen


def _data(
    problem: EndProblem, index: Indices, places: Indices, window: Array, chi: Array, thinned: bool
) -> PatchData:
    """The patches' pixels; one that no cubic describes counts for less."""
    dy, dx, _ = offsets()
    rows, cols = places[:, :1] + dy, places[:, 1:] + dx
    noise = problem.sigma[rows, cols] * np.maximum(chi, 1.0)[:, None]
    return PatchData(
        problem=problem,
        index=index,
        light=problem.light[rows, cols],
        weight=window / noise**2,
        places=places,
        pixels=rows * problem.light.shape[1] + cols,
        window=np.maximum(window.sum(axis=1), 1e-9),
        chi=chi,
        thinned=thinned,
    )


def overlap(data: PatchData) -> float:
    """How often a pixel was counted, being in several patches; `data`, those in use."""
    stride = STRIDE * (np.sqrt(2.0) if data.thinned else 1.0)
    return float(max(1.0, offsets()[2].sum() / stride**2))
