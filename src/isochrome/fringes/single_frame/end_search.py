"""The search for the ends of the light: one least-squares problem of the ends and many patches.

A patch's pixel has the light I = M^(1/g), M = D (1 - s) + B s, s = (1 - a cos 2 pi N)/2: D and B
are sums of given shapes, N is a cubic of the place, g the tone exponent, and a = sinc N_x sinc N_y
what a bin of some pixels leaves of a fringe. The cubic terms are nuisances: without them, what a
quadratic cannot follow would be taken for light, with a certainty that it does not have.

A patch that touches a crest and one that crosses it fit nearly alike, and a search that starts with
the bright end too low leaves patches on the wrong side: that is why it starts more than once, looks
at every patch afresh now and then (normalised by the ends as they stand, as any frame's `patches`),
and keeps the cheaper result. Where two results cost about the same the light does not tell which is
right: the frame is read by both (`possible`), and where only numbers are wanted, such as the
exponent, their difference is an uncertainty. The loop is not `isochrome.estimation.minimise`: the
patches follow each step by steps of their own and are made anew in between, and a cost is compared
only as long as they are the same ones.
Sources: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413, for the elimination; Levenberg
(1944), Q. Appl. Math. 2, 164, for the damping.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce

import numpy as np
from scipy.special import factorial

from isochrome.errors import InputError
from isochrome.estimation import State, damped, minimise_all, solve_all, total_degree
from isochrome.fringes.on_branch import AT_REST, LARGEST_UNCERTAINTY
from isochrome.fringes.single_frame.patches import (
    DX,
    DY,
    SIDE,
    SMALLEST,
    STRIDE,
    WINDOW,
    WORST_CHI,
    fit_patches,
    gather_patches,
    patch_prior,
)
from isochrome.fringes.windows import (
    DIMMEST,
    FAINTEST_LIGHT,
    LARGEST_CHANGE,
    TURN,
    Array,
    Indices,
    Mask,
)

DEGREE = 2
"""Of the products: lamps fall off to the corners."""
QUADRATICS = len(total_degree(DEGREE))
"""How many products there are, which come first."""


@dataclass(frozen=True)
class SmoothImages:
    """Images f_k(row) g_k(col) over a frame, and how large each may be beforehand. Their factors
    `down` (rows, a) and `across` (cols, b); `pairs` (terms, 2) of these; `spread` (terms,): a
    coefficient's prior deviation, over the contrast, inf for the even light."""

    down: Array
    across: Array
    pairs: Indices
    spread: Array

    @property
    def images(self) -> Array:
        """All of them (rows, cols, terms)."""
        row, col = self.pairs.T
        return np.asarray(self.down[:, None, row] * self.across[None, :, col])

    def sum(self, coefficients: Array) -> Array:
        """Their sum with some coefficients (terms,): (rows, cols)."""
        table = np.zeros((self.down.shape[1], self.across.shape[1]))
        table[tuple(self.pairs.T)] = coefficients
        return np.asarray(self.down @ table @ self.across.T)

    def along(self, image: Array) -> Array:
        """Sum of each one times an image (rows, cols) over the frame: (terms,)."""
        return np.asarray((self.down.T @ image @ self.across)[tuple(self.pairs.T)])

    def products(self, other: SmoothImages, weight: Array) -> Array:
        """Sums of each one times each of the others, by `weight` (rows, cols): (terms, others)."""
        down, across = (
            (one[:, :, None] * two[:, None, :]).reshape(len(one), -1)
            for one, two in ((self.down, other.down), (self.across, other.across))
        )
        sizes = (self.down.shape[1], other.down.shape[1], self.across.shape[1], -1)
        (i, j), (k, l) = self.pairs.T[..., None], other.pairs.T[:, None, :]
        return np.asarray((down.T @ weight @ across).reshape(sizes)[i, k, j, l])


_CUBIC = 1e-3
"""Prior standard deviation of the cubic terms, fringes/px³."""
_TONE = 0.5
_PIVOT = 1e-3
_POWERS = total_degree(3)
"""Of the place along x and y in a cubic's terms: a quadratic's six, N_xxx, N_xxy, N_xyy, N_yyy."""
TERMS = len(_POWERS)
BASIS: Array = np.stack(
    [DX.astype(float) ** i * DY.astype(float) ** j / factorial([i, j]).prod() for i, j in _POWERS],
    axis=-1,
)
"""The cubic's terms at a patch's pixels (k, 10)."""
_PAIRS = (BASIS[:, :, None] * BASIS[:, None, :]).reshape(len(BASIS), -1)
_PRIOR = np.append(patch_prior(), np.full(TERMS - len(patch_prior()), _CUBIC**-2)).astype(float)
_DIAGONAL = np.arange(TERMS)


@dataclass(frozen=True, kw_only=True)
class EndProblem:
    """A frame in bins of `by` pixels: `light`, `sigma`, `valid` (rows, cols), and its unknowns.
    Their vector: terms of the `shapes` that the dark and the bright end are sums of (of an end that
    is given a multiple of its image), and g, to be found where `tone`; `scale`, about the
    contrast."""

    light: Array = field(repr=False)
    sigma: Array = field(repr=False)
    valid: Mask = field(repr=False)
    shapes: tuple[SmoothImages | Array, SmoothImages | Array] = field(repr=False)
    tone: bool
    scale: float
    by: int

    @property
    def given(self) -> tuple[bool, ...]:
        """Whether the dark and the bright end are given."""
        return tuple(not isinstance(shape, SmoothImages) for shape in self.shapes)

    @property
    def spreads(self) -> list[Array]:
        """Prior deviations of the dark end's and of the bright end's terms, inf for none."""
        return [
            shape.spread if isinstance(shape, SmoothImages) else np.array([np.inf])
            for shape in self.shapes
        ]

    @property
    def free(self) -> Mask:
        """Which of the unknowns' vector are to be found (terms,)."""
        counts = [len(spread) for spread in self.spreads]
        return np.repeat([*(not known for known in self.given), self.tone], [*counts, 1])

    @cached_property
    def found(self) -> list[SmoothImages]:
        """What those that are to be found are multiples of: an end's images, 1 for g."""
        rows, cols = (np.ones((n, 1)) for n in self.light.shape)
        one = SmoothImages(rows, cols, np.zeros((1, 2), dtype=int), np.array([_TONE]))
        ends = [shape for shape in self.shapes if isinstance(shape, SmoothImages)]
        return [*ends, one] if self.tone else ends

    def ends(self, unknowns: Array) -> tuple[Array, Array]:
        """D and B of all bins (rows, cols)."""
        cut, g, ends = len(self.spreads[0]), unknowns[-1], []
        for shape, terms in zip(self.shapes, (unknowns[:cut], unknowns[cut:-1]), strict=True):
            if isinstance(shape, SmoothImages):
                ends.append(shape.sum(terms))
            else:
                given = terms[0] * shape
                ends.append(given if g == 1.0 else np.maximum(given, 0.0) ** g)
        return ends[0], ends[1]

    def prior(self, unknowns: Array) -> tuple[Array, Array]:
        """Inverse variances of the unknowns, and their distance from what is expected."""
        away = unknowns.copy()
        away[-1] -= 1.0
        return np.append((np.concatenate(self.spreads) * self.scale) ** -2.0, _TONE**-2), away

    def prior_cost(self, unknowns: Array) -> float:
        """What the unknowns that are to be found cost by themselves."""
        weight, away = self.prior(unknowns)
        return float((weight * away**2)[self.free].sum())


@dataclass(frozen=True, kw_only=True)
class PatchData:
    """Patches in use of a problem: `index` on their lattice (p,), and their pixels (p, k).
    `pixels`, their numbers in the frame; `light`, `weight` of each; `window`, the sum of a patch's
    pixels' weights before the noise (p,); `chi` (p,); `overlap`, how often a pixel was counted."""

    problem: EndProblem = field(repr=False)
    index: Indices = field(repr=False)
    light: Array = field(repr=False)
    weight: Array = field(repr=False)
    pixels: Indices = field(repr=False)
    window: Array = field(repr=False)
    chi: Array = field(repr=False)
    overlap: float

    @cached_property
    def images(self) -> list[Array]:
        """Those of `EndProblem.found` at the patches' pixels (p, k, terms)."""
        size = self.problem.light.size
        return [image.images.reshape(size, -1)[self.pixels] for image in self.problem.found]


class PatchEnds:
    """Some `unknowns` (terms,), and the ends D, B that they are at the patches' pixels (p, k)."""

    def __init__(self, data: PatchData, unknowns: Array) -> None:
        self.data, self.unknowns = data, unknowns
        self.dark, self.bright = (end.ravel()[data.pixels] for end in data.problem.ends(unknowns))


class PatchModel:
    """The model at some ends and patches' terms `orders` (p, 10), in the precision of the light.
    `cost` of each patch, `residual` (p, k); slopes (p, k) when they are asked for."""

    def __init__(self, ends: PatchEnds, orders: Array) -> None:
        data, g, precision = ends.data, ends.unknowns[-1], ends.data.light.dtype
        problem = self.problem = data.problem
        self.ends, self.orders = ends, orders
        self._angle = (TURN * (orders @ BASIS.T)).astype(precision)
        self._fade = _fade(orders.astype(precision)) if problem.by > 1 else 1.0
        self._signal = 0.5 - 0.5 * self._fade * np.cos(self._angle)
        self._light = self._linear = ends.dark + (ends.bright - ends.dark) * self._signal
        self.gain: Array | float = 1.0  # dI/dM
        if problem.tone or g != 1.0:
            self._linear = np.maximum(self._linear, FAINTEST_LIGHT * problem.scale)
            self._light = self._linear ** (1.0 / g)
            self.gain = self._light / (g * self._linear)
        self.residual = data.light - self._light
        self.square = np.einsum("pk,pk,pk->p", data.weight, self.residual, self.residual)
        self.cost = self.square + (orders**2) @ _PRIOR

    @cached_property
    def slope(self) -> Array:
        """dI/dN."""
        contrast = self.gain * (self.ends.bright - self.ends.dark)
        return np.asarray(np.pi * contrast * self._fade * np.sin(self._angle))

    @cached_property
    def columns(self) -> list[Array]:
        """Slopes by what is to be found, in the order of `EndProblem.found`."""
        given, g = self.problem.given, self.ends.unknowns[-1]
        by_ends = self.gain * (1.0 - self._signal), self.gain * self._signal
        columns = [column for column, known in zip(by_ends, given, strict=True) if not known]
        if not self.problem.tone:
            return columns
        by_tone = -np.log(self._linear) * self._light / g**2
        ends = self.ends.dark, self.ends.bright
        for end, column, known in zip(ends, by_ends, given, strict=True):
            if known:
                by_tone = by_tone + column * end * np.log(np.maximum(end, 1e-6)) / g
        return [*columns, by_tone]


def _fade(orders: Array) -> Array:
    """What the mean over a bin leaves of the fringes' contrast (p, k)."""
    dx, dy = BASIS[:, 1].astype(orders.dtype), BASIS[:, 2].astype(orders.dtype)
    along_x = orders[:, 1:2] + orders[:, 3:4] * dx + orders[:, 4:5] * dy
    along_y = orders[:, 2:3] + orders[:, 4:5] * dx + orders[:, 5:6] * dy
    return _sinc(along_x) * _sinc(along_y)


def _sinc(turns: Array) -> Array:
    """sin(pi x)/(pi x) by its series, to 1e-5 below 0.4, beyond which no fringe is followed."""
    square = np.square(np.pi * turns)
    return np.asarray(
        1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0)))
    )


def _information(
    data: PatchData, residual: Array, slope: Array, orders: Array
) -> tuple[Array, Array, Array]:
    """The patches' own normal equations (p, 10, 10), (p, 10), and weighted slopes (p, k)."""
    weighted = data.weight * slope
    matrix = ((weighted * slope) @ _PAIRS).reshape(-1, TERMS, TERMS)
    matrix[:, _DIAGONAL, _DIAGONAL] += _PRIOR + _PIVOT
    return matrix, (weighted * residual) @ BASIS - orders * _PRIOR, weighted


def refine_ends(
    ends: PatchEnds, orders: Array, damping: Array, steps: int
) -> tuple[Array, Array, Array]:
    """Orders (p, 10), costs, damping (p,) after steps of the patches alone that lower costs."""

    def at(orders: Array) -> State:
        now = PatchModel(ends, orders)
        return now.cost, now.residual, now.slope

    def equations(orders: Array, now: State) -> tuple[Array, Array]:
        _, residual, slope = now
        return _information(ends.data, residual, slope, orders)[:2]

    limits = 1e-6, 1e4
    orders, now, damping = minimise_all(at, equations, orders, damping, steps=steps, limits=limits)
    return orders, now[0], damping


@dataclass(frozen=True)
class EndEquations:
    """Normal equations `matrix`, `slope` of the free unknowns, every patch following. For a step x
    the patches' terms change by `pull` - `drag` x, (p, 10) and (p, 10, terms); `spread` (p,),
    standard uncertainty of a patch's order with the ends known."""

    matrix: Array
    slope: Array
    pull: Array
    drag: Array
    spread: Array


def eliminated(ends: PatchEnds, orders: Array) -> EndEquations:
    """Normal equations with the patches' own terms eliminated, but for singular patches."""
    data, now = ends.data, PatchModel(ends, orders)
    problem, light = data.problem, data.problem.light
    information, pull, weighted = _information(data, now.residual, now.slope, orders)
    inverse = solve_all(information, np.broadcast_to(np.eye(TERMS), information.shape))
    finite = np.isfinite(inverse).all(axis=(1, 2))
    regular = np.asarray((inverse[:, _DIAGONAL, _DIAGONAL] > 0.0).all(axis=1) & finite)
    parts = data.weight, weighted, pull
    weight, weighted, pull = (np.where(regular[:, None], part, 0.0) for part in parts)
    inverse = np.where(regular[:, None, None], inverse, 0.0)

    def summed(values: Array) -> Array:  # patches overlap: at a pixel of the frame, theirs together
        flat = np.bincount(data.pixels.ravel(), weights=values.ravel(), minlength=light.size)
        return flat.reshape(light.shape)

    shapes = list(zip(problem.found, now.columns, strict=True))
    matrix = np.block(
        [[one.products(other, summed(weight * u * v)) for other, v in shapes] for one, u in shapes]
    )
    misfit = weight * now.residual
    slope = np.concatenate([one.along(summed(misfit * u)) for one, u in shapes])
    images = zip(data.images, now.columns, strict=True)
    mixed = np.concatenate(
        [(BASIS.T * (weighted * u)[:, None]) @ one for one, u in images], axis=-1
    )
    solved = inverse @ np.concatenate([mixed, pull[..., None]], axis=-1)
    prior, away = problem.prior(ends.unknowns)
    free = problem.free
    inner = np.tensordot(mixed, solved, axes=((0, 1), (0, 1)))
    matrix = matrix - inner[:, :-1] + np.diag(prior[free])
    slope = slope - inner[:, -1] - (prior * away)[free]
    spread = np.where(regular, np.sqrt(inverse[:, 0, 0]), np.inf)
    return EndEquations(matrix, slope, solved[..., -1], solved[..., :-1], spread)


_ROUNDS, _EVERY = 24, 4
"""Steps at most, and between two fresh looks at the patches."""
REST = 3e-4
"""Change of the order by a step, fringes, below which the search rests."""
_MORE = 2
"""Steps where a result is refined that rests but for what the problem leaves open besides."""
_FREELY = 0.1
"""Damping below which a step is small because the search rests."""
_STALE = 0.02
"""Share of patches that a fresh look may improve on at rest."""
TONES = 0.2, 5.0
_HEAVIEST = 1e2
_MOST = 0.5
"""Difference of a patch's residual over noise, squared, that counts at most in a comparison."""
_PIXELS = float(WINDOW.sum())
NOT_TOLD = "frame_fringes_cannot_separate"
_DOUBT = 40.0
"""Difference of cost, about -2 ln of the likelihood, within which two results are both possible,
where the light is as even as it is taken for; its costs say as much less as it is beyond that."""
_BETTER = 0.97
"""Share of its former cost below which a patch counts as better."""
_MANY = 400
"""Patches from which every second is left out: they overlap, and tell the same twice."""
_WORST_CHI, _LEAST_FILLED = 30.0, 0.5
_SPAN = 0.4 / SIDE
"""Slope of a patch that tells the tone exponent, fringes a pixel: it spans 0.4 of a fringe. A
flatter one follows any exponent, and the noise of no-load frames, which stands in the slope and in
the residual, looks like one: errors in variables (Fuller (1987), Measurement error models)."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """The unknowns, their `covariance`, the last `change` of the order, and the patches at rest.
    `patch_cost`, residual over noise squared (p,), and what the unknowns' prior adds; `price`, how
    much the frame narrows the prior down, ln det(1 + v M), which the evidence takes for it;
    `beyond_prior`, t² of `spots_beyond_prior`."""

    unknowns: Array
    covariance: Array
    change: float
    patch_cost: Array = field(repr=False)
    prior_cost: float
    price: float
    beyond_prior: float
    data: PatchData = field(repr=False)
    orders: Array = field(repr=False)


def search_all(problem: EndProblem, starts: list[Array]) -> list[Found]:
    """What each of several `starts`, vectors of the unknowns, leads to. InputError where no fringe
    can be followed, or where the fringes leave the unknowns open."""
    outcome = []
    for start in starts:
        with suppress(np.linalg.LinAlgError):  # it leads to what the fringes leave open
            result = _search(problem, start)
            if np.isfinite(result.unknowns).all() and np.isfinite(result.covariance).all():
                outcome.append(result)
    if not outcome:
        raise InputError(NOT_TOLD)
    return outcome


def possible(*models: list[Found]) -> list[Found]:
    """The results of other orders each that the frame does not exclude, the best first. Models,
    such as light without and with spots, are compared by the evidence of their best, the results of
    one by their costs: what a result leaves open is no merit beside another's."""
    one = models[0][0]
    cost = [min(_dearer(result, one) + result.price for result in results) for results in models]
    listed: list[Found] = []
    for k in np.argsort(cost, kind="stable"):
        if cost[k] >= min(cost) + _DOUBT:
            break
        best = reduce(lambda a, b: b if _dearer(a, b) > 0.0 else a, models[k])
        for result in (best, *models[k]):
            near = _dearer(result, best) < _DOUBT * best.beyond_prior
            if near and all(_differ(result, other) for other in listed):
                listed.append(result)
    return listed


def _dearer(one: Found, other: Found) -> float:
    """How much more a result costs than another, by the patches that both use. A patch that a cubic
    does not describe follows whatever light it is given, and one that it describes in one result
    alone may rest on the wrong side of a crest: no patch decides alone."""
    a, b = _of_both(one, other)
    costs = one.patch_cost[a], other.patch_cost[b]
    first, second = (np.minimum(cost, WORST_CHI**2) for cost in costs)
    away = np.clip(first - second, -_MOST, _MOST)
    return float(_PIXELS * away.sum() + one.prior_cost - other.prior_cost)


def _differ(one: Found, other: Found) -> bool:
    """Whether two results give other orders: fringes from the nearest whole number, RMS."""
    a, b = _of_both(one, other)
    first, second = (np.abs(n - np.rint(n)) for n in (one.orders[a, 0], other.orders[b, 0]))
    return bool(np.sqrt(np.mean((first - second) ** 2)) > AT_REST) if len(a) else True


def _of_both(one: Found, other: Found) -> tuple[Indices, Indices]:
    """Numbers of the patches that two results use, in each of them."""
    _, a, b = np.intersect1d(one.data.index, other.data.index, return_indices=True)
    return a, b


def _search(problem: EndProblem, unknowns: Array) -> Found:
    data, orders, _ = fresh_patches(problem, unknowns)
    damping, since, change, resting = 1e-3, 0, np.inf, False
    dampings, cost = _start(data, unknowns, orders)
    for _ in range(_ROUNDS):
        if resting or since >= _EVERY:
            data, orders, stale = fresh_patches(problem, unknowns, (data, orders))
            if resting and stale < _STALE:
                break
            dampings, cost = _start(data, unknowns, orders)
            since, resting = 0, False
        normal = eliminated(PatchEnds(data, unknowns), orders)
        while True:
            step = _damped(normal, damping)
            tried = _followed(data, (unknowns, orders, dampings), normal, step)
            if tried[0] < cost or damping > _HEAVIEST:
                break
            damping *= 8.0
        # what the step in the ends does to the order where it can be read, RMS, fringes
        readable, change = normal.spread < LARGEST_UNCERTAINTY, np.inf
        if readable.any():
            moved = np.minimum(np.abs(normal.drag[readable, 0] @ step), 0.2)
            change = float(np.sqrt(np.mean(moved**2)))
        resting, since = change < REST and damping < _FREELY, since + 1
        if tried[0] < cost:
            cost, unknowns, orders, dampings = tried
            damping = max(0.1 * damping, 1e-7)
        else:
            damping = 1e-3
        if resting and since == 1:
            break  # the fresh look has moved nothing
    return _found(data, unknowns, orders, change)


def search_on(result: Found, problem: EndProblem) -> Found:
    """A result as one of a `problem` that leaves more open, by full steps from its rest."""
    data = replace(result.data, problem=problem)
    unknowns, orders = result.unknowns, result.orders
    dampings, cost = _start(data, unknowns, orders)
    for _ in range(_MORE):
        normal = eliminated(PatchEnds(data, unknowns), orders)
        step = _damped(normal, 0.0)
        tried = _followed(data, (unknowns, orders, dampings), normal, step)
        if not tried[0] < cost:
            break
        cost, unknowns, orders, dampings = tried
    return _found(data, unknowns, orders, result.change)


def _start(data: PatchData, unknowns: Array, orders: Array) -> tuple[Array, float]:
    """The patches' own damping, and the cost."""
    cost = PatchModel(PatchEnds(data, unknowns), orders).cost
    return np.full(len(orders), 1e-2), float(cost.sum() + data.problem.prior_cost(unknowns))


def _damped(normal: EndEquations, damping: float) -> Array:
    return np.asarray(np.linalg.solve(damped(normal.matrix, damping), normal.slope))


def _followed(
    data: PatchData, place: tuple[Array, Array, Array], normal: EndEquations, step: Array
) -> tuple[float, Array, Array, Array]:
    """Cost and place (unknowns, orders, damping) after a step, patches following if it is good."""
    unknowns, orders, dampings = place
    new = unknowns.copy()
    new[data.problem.free] += step
    if not TONES[0] < new[-1] < TONES[1]:
        return np.inf, *place
    along = orders + normal.pull - normal.drag @ step
    ends = PatchEnds(data, new)
    stay, go = (PatchModel(ends, tried).cost for tried in (orders, along))
    nearer = np.where((go < stay)[:, None], along, orders)
    gone, cost, dampings = refine_ends(ends, nearer, dampings, 2)
    return float(cost.sum() + data.problem.prior_cost(new)), new, gone, dampings


def _found(data: PatchData, unknowns: Array, orders: Array, change: float) -> Found:
    ends, problem = PatchEnds(data, unknowns), data.problem
    normal = eliminated(ends, orders)
    free = problem.free
    # which of the unknowns that are found are spots and bars of the bright end
    cut, count = (len(spread) for spread in problem.spreads)
    smooth = min(QUADRATICS, count)
    spots = np.repeat([False, True, False], [cut + smooth, count - smooth, 1])[free]
    covariance = np.zeros((len(unknowns), len(unknowns)))
    inverse = np.linalg.inv(normal.matrix) * data.overlap
    if not change < REST:
        last = _damped(normal, 0.0)
        inverse = inverse + np.outer(last, last)
    prior = problem.prior(unknowns)[0][free]
    precision = prior / data.overlap
    larger = spots_beyond_prior(inverse, unknowns[free], precision, spots)
    covariance[np.ix_(free, free)] = as_spotted(inverse, precision, spots, larger)
    price = -np.linalg.slogdet(inverse)[1] - np.log(prior[prior > 0.0]).sum()
    cost = PatchModel(ends, orders).square * np.maximum(data.chi, 1.0) ** 2
    return Found(
        unknowns=unknowns, covariance=covariance, change=change, patch_cost=cost / data.window,
        prior_cost=problem.prior_cost(unknowns), price=float(price), beyond_prior=larger,
        data=data, orders=orders,
    )  # fmt: skip


def spots_beyond_prior(covariance: Array, terms: Array, precision: Array, spots: Mask) -> float:
    """How much stronger squared the spots are that were found than they were taken for, 1 at least.
    Of the light's `terms` found (n,), with the priors' `precision` 1/σ² (n,), the `spots`: t² = Σ
    (c/σ)² / γ, γ = Σ (1 - var c/σ²) the number of them that the frame tells. Source: MacKay (1992),
    Neural Computation 4, 415."""
    informed = np.sum(1.0 - np.diag(covariance)[spots] * precision[spots])
    return float(max(1.0, np.sum(precision[spots] * terms[spots] ** 2) / max(informed, 1.0)))


def as_spotted(covariance: Array, precision: Array, spots: Mask, larger: float) -> Array:
    """A covariance of the light's terms, the spots' prior variance being `larger`, as was found.
    Where no crest lies the light is as uncertain as its prior, and a lamp whose spots are three
    times as strong in view is not smoother out of view."""
    if not larger > 1.0:
        return covariance
    less = np.where(spots, precision * (1.0 - 1.0 / larger), 0.0)
    return np.asarray(np.linalg.inv(np.linalg.inv(covariance) - np.diag(less)))


def fresh_patches(
    problem: EndProblem, unknowns: Array, before: tuple[PatchData, Array] | None = None
) -> tuple[PatchData, Array, float]:
    """Patches fitted anew at some unknowns, but where those of `before`, if any, were better.
    Returns the patches, their orders, and the share that was better anew. InputError where too few
    can be followed."""
    dark, bright = problem.ends(unknowns)
    g, contrast = unknowns[-1], bright - dark
    lit = problem.valid & (contrast > DIMMEST * problem.scale**g)
    safe = np.where(lit, contrast, 1.0)
    level = np.maximum(problem.light, problem.sigma)
    linear = problem.light if g == 1.0 else level**g
    sigma = 2.0 * g * level ** (g - 1.0) * problem.sigma / safe
    light = gather_patches(1.0 - 2.0 * (linear - dark) / safe, sigma, lit)  # cos 2 pi N
    use, stride = light.filled > _LEAST_FILLED, float(STRIDE)
    if np.count_nonzero(use) > _MANY:
        stride *= np.sqrt(2.0)
        row, col = np.indices((len(light.rows), len(light.cols)))
        use &= ((row + col) % 2 == 0).ravel()
    index = np.flatnonzero(use)
    _check_number(len(index))
    fitted = fit_patches(light.only(index))
    good = fitted.chi[0] < _WORST_CHI
    index = index[good]
    _check_number(len(index))
    orders = np.zeros((len(index), TERMS))
    orders[:, :6] = fitted.terms[0, good]
    row, col = np.unravel_index(index, (len(light.rows), len(light.cols)))
    down, across = light.rows[row][:, None] + DY, light.cols[col][:, None]
    pixels = down * problem.light.shape[1] + across + DX
    window = light.weight[index].astype(float)
    data = PatchData(
        problem=problem, index=index, light=problem.light.ravel()[pixels],
        weight=window / problem.sigma.ravel()[pixels] ** 2, pixels=pixels,
        window=np.maximum(window.sum(axis=1), 1e-9), chi=np.ones(len(index)),
        overlap=float(max(1.0, _PIXELS / stride**2)),
    )  # fmt: skip
    ends, stale = PatchEnds(data, unknowns), 1.0
    orders, cost, _ = refine_ends(ends, orders, np.full(len(index), 1e-2), 3)
    if before is not None:
        old = np.zeros_like(orders)
        was = np.full(len(index), np.inf)
        _, latter, former = np.intersect1d(index, before[0].index, return_indices=True)
        old[latter] = before[1][former]
        was[latter] = PatchModel(ends, old).cost[latter]
        orders = np.asarray(np.where((was <= cost)[:, None], old, orders))
        stale = float(np.mean(cost < _BETTER * was - 0.02 * data.window))
    chi = np.sqrt(PatchModel(ends, orders).square / data.window)
    good = (chi < _WORST_CHI) & (np.abs(orders[:, 1:3]).max(axis=1) < LARGEST_CHANGE)
    if problem.tone and any(problem.given):
        good &= np.hypot(orders[:, 1], orders[:, 2]) > _SPAN
    _check_number(int(np.count_nonzero(good)))
    # a patch that no cubic describes counts for less
    noise = problem.sigma.ravel()[pixels] * np.maximum(chi, 1.0)[:, None]
    parts = {
        "index": index, "light": data.light, "weight": window / noise**2, "pixels": pixels,
        "window": data.window, "chi": chi,
    }  # fmt: skip
    data = replace(data, **{name: part[good] for name, part in parts.items()})
    return data, orders[good], stale


def _check_number(patches: int) -> None:
    """Refuse a frame of too few patches: raises InputError."""
    if patches < SMALLEST:
        raise InputError("too_few_fringes_can")
