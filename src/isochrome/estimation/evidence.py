"""Which of the things that may be there are there: sets of them, weighed by their evidence.

About a fit, with M = J J' and g = J r of the columns J of all nuisances and the residual r over its
noise, what is fitted anyway taken off both, a set S of nuisances with priors a ~ N(0, V) and their
values now gives, with b = g + M now,

    ln E_S = b' C b / 2 - ln det(1 + L' M L) / 2 + sum ln odds,   C = L (1 + L' M L)^-1 L',

and the values a = C b, where V = L L'. A nuisance whose amplitude cannot be negative has a half
normal prior: its evidence is twice the posterior's part above nought. Sources: Kass & Raftery
(1995), J. Am. Stat. Assoc. 90, 773, for the evidence of a linear model; Raftery, Madigan & Hoeting
(1997), ibid. 92, 179, for means over sets and the search among them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.sparse import csr_array
from scipy.special import log_ndtr

from isochrome.estimation.covariance import jackknife_variance, positive_part
from isochrome.estimation.light import TAKEN, ScoreProducts

Array = NDArray[np.float64]

MOST_MEMBERS = 4
"""Nuisances in a set: benches with five defects at once are one in ten thousand."""
_BEAM = 20
"""Sets of each size that larger ones are made of."""
_FEW = 4
"""Amplitudes up to which something is one of many small things in a set."""
_BEYOND = 0.125
"""Share of a picture's side by which waves go on beyond its ends: cosines are level at theirs, and
what is seen need not be."""
_NEGLIGIBLE = 10.0
"""Logarithm of a chance over the best's below which a set is not made larger."""


@dataclass(frozen=True)
class Hypothesis:
    """One way in which something is there. `name`, of the thing; ways of one name exclude one
    another. `columns` (k,), its own among all; `form` (k, r), the same array in ways of another
    `size`, and this, whose product is the `root` L of its prior's covariance L L'; `log_odds` that
    it is there; `positive`, whether its one amplitude is.
    """

    name: str
    columns: slice
    form: Array
    log_odds: float
    positive: bool = False
    size: float = 1.0

    @property
    def root(self) -> Array:
        """L (k, r) of its prior's covariance."""
        return self.size * self.form


@dataclass(frozen=True, kw_only=True)
class Nuisance:
    """Something that may be there: its `columns` (k, n) at an image, their values `now` (k,); the
    ways of its prior, all `roots` in all `sizes`; `positive`, whether the first's amplitude is.
    `unknowns`, those of the fit that hold it where it is fitted, and `of_each` (k, unknowns), their
    change with it, by default one each; `weights`, 1/u^2 (c,) of its first columns, which the fit's
    own covariance has already; `exact`, whether no covariance is to hold it.
    """

    name: str
    columns: Callable[[Any], Array]
    now: Array
    roots: tuple[NDArray[Any], ...]
    sizes: tuple[float, ...] = (1.0,)
    positive: bool = False
    unknowns: tuple[int, ...] = ()
    of_each: Array | None = None
    weights: Array = field(default_factory=lambda: np.zeros(0))
    exact: bool = False


def cosines(shape: tuple[int, ...], count: int) -> NDArray[np.float32]:
    """Products of `count` cosines along each side of a picture (count², rows, cols), float32."""
    down, across = (_cosines_along(n, count) for n in shape)
    return np.asarray(down[:, None, :, None] * across[None, :, None, :]).reshape(-1, *shape)


def cosine_sum(shape: tuple[int, int], amplitudes: Array) -> NDArray[np.float32]:
    """Sums (..., rows, cols) of such products with their amplitudes (..., count²), float32."""
    count = round(amplitudes.shape[-1] ** 0.5)
    down, across = (_cosines_along(n, count) for n in shape)
    square = amplitudes.reshape(*amplitudes.shape[:-1], count, count)
    return np.asarray(down.T @ square.astype(np.float32) @ across)


def _cosines_along(pixels: int, count: int) -> NDArray[np.float32]:
    place = ((np.arange(pixels) + 0.5) / pixels + _BEYOND) / (1.0 + 2.0 * _BEYOND)
    return np.cos(np.pi * np.outer(np.arange(count), place)).astype(np.float32)


def cosine_spread(count: int, width: float) -> Array:
    """Standard deviations (count²,) of such products in a Gaussian process of variance 1 and a
    length of `width` pictures with Matérn's 3/2 spectrum: a smoother one takes its smoothness for
    knowledge. Source: Rasmussen & Williams (2006), Gaussian Processes for ML, 4.2.1.
    """
    number = np.arange(count)
    square = np.add.outer(number**2, number**2) * (np.pi * width / (1.0 + 2.0 * _BEYOND)) ** 2
    power = (1.0 + square / 3.0) ** -2.5
    over_mean = np.where(number, 2.0, 1.0)  # of a squared cosine
    return np.asarray(np.sqrt(np.outer(over_mean, over_mean) * power / power.sum()).ravel())


def cosine_rms(amplitudes: Array) -> float:
    """Root mean square over the picture of such products with their amplitudes (count²,)."""
    side = 4 * round(len(amplitudes) ** 0.5)
    return float(np.sqrt(np.mean(cosine_sum((side, side), amplitudes) ** 2)))


@dataclass(frozen=True)
class Sets:
    """Sets of hypotheses, the likeliest first: `members`, by number, and `weights`, their sum 1."""

    evidence: Evidence
    members: tuple[tuple[int, ...], ...]
    weights: Array

    @property
    def best(self) -> tuple[Hypothesis, ...]:
        """The likeliest set."""
        return self.named(0)

    def named(self, index: int) -> tuple[Hypothesis, ...]:
        """The hypotheses of one of the sets."""
        return tuple(self.evidence.hypotheses[k] for k in self.members[index])

    @cached_property
    def chances(self) -> dict[str, float]:
        """How likely each thing is there, by its name: the weight of all sets that have it."""
        result = dict.fromkeys((h.name for h in self.evidence.hypotheses), 0.0)
        for index, weight in enumerate(self.weights.tolist()):
            for hypothesis in self.named(index):
                result[hypothesis.name] += weight
        return result

    def values_of(self, name: str) -> Array:
        """The values of something in the likeliest set that has it; KeyError where none has."""
        for members in self.members:
            for k in members:
                hypothesis = self.evidence.hypotheses[k]
                if hypothesis.name == name:
                    return self.evidence.values(members)[hypothesis.columns]
        raise KeyError(name)

    def judged(self, logs: Mapping[tuple[int, ...], float]) -> Sets:
        """With ln E of some sets from elsewhere: between these it counts, not the slopes."""
        logs_now = np.log(np.maximum(self.weights, np.finfo(float).tiny)).tolist()
        known = dict(zip(self.members, logs_now, strict=True))
        first = max(logs, key=lambda members: known.get(members, -np.inf))
        if first in known:
            known |= {m: known[first] + log - logs[first] for m, log in logs.items()}
        order = sorted(known, key=lambda members: -known[members])
        weights = np.exp([known[members] - known[order[0]] for members in order])
        return Sets(self.evidence, tuple(order), weights / weights.sum())

    def moments(self, along: Array, about: Array) -> Array:
        """Mean over the sets of the second moments (p, p) of T (a - about), T = `along` (p, k)."""
        evidence, total = self.evidence, np.zeros((len(along), len(along)))
        seen = along @ evidence.forms.T
        here = along @ about
        for chosen, weight in zip(self.members, self.weights.tolist(), strict=True):
            (at, size), (mean, half) = evidence.places_of(chosen), evidence.posterior(chosen)
            of_set = seen[:, at] * size
            spread = solve_triangular(half, of_set.T, lower=True)
            off = of_set @ mean - here
            total += weight * (spread.T @ spread + np.outer(off, off))
        return total


@dataclass(frozen=True, kw_only=True)
class Weighed:
    """What may be there, weighed about a fit: the `evidence`, what is `given` of it by number, with
    the values `now` (k,) of all columns. `along` (p, k), what a change of these changes the
    unknowns by, and `counted` (p, p), what the fit's covariance has of them already; `noise`, its
    variance over what the data say; `judged`, the sets where something else tells them apart.
    """

    evidence: Evidence
    given: tuple[int, ...]
    now: Array
    along: Array
    counted: Array
    noise: float
    judged: Sets | None = None

    @cached_property
    def sets(self) -> Sets:
        """The likely sets: a fit that is not at rest moves on without them."""
        return self.judged or weigh(self.evidence, given=self.given)

    @cached_property
    def undecided(self) -> Array:
        """What the covariance (p, p) lacks for what is neither shown nor excluded: second moments
        over the sets about what is fitted, less what is counted.
        """
        total = self.sets.moments(self.along, self.now) - self.counted
        return positive_part(total, np.sqrt(np.maximum(np.diag(total), 0.0)))


@dataclass(frozen=True, kw_only=True)
class Regions:
    """One part of the data by `region` (n,) of its picture: derivatives (q, n) by what is `fitted`,
    the last ones by `unknowns` (p,), by number; `columns` (k, n) of nuisances, the `residual` (n,).
    """

    region: NDArray[np.intp]
    fitted: Array
    unknowns: NDArray[np.intp]
    columns: Array
    residual: Array

    def variance(self, weighed: Weighed) -> Array:
        """Variance (p,) of the unknowns beside the likeliest set by the jackknife over regions:
        where a prior's form is wrong, parts of a picture disagree. Source: Efron & Stein (1981),
        Ann. Stat. 9, 586.
        """
        evidence = weighed.evidence
        at, size = evidence.places_of(weighed.sets.members[0])
        now = (self.residual + weighed.now @ self.columns)[None]
        stacked = np.concatenate((self.fitted, (evidence.forms[at].T * size).T @ self.columns, now))
        stacked /= weighed.noise**0.5
        parts = [stacked[:, self.region == k] for k in np.unique(self.region)]
        grams = np.array([part @ part.T for part in parts])
        prior = np.zeros(len(stacked) - 1)
        prior[len(self.fitted) :] = 1.0
        total = grams.sum(axis=0)
        size = 1.0 / np.sqrt(np.diag(total)[:-1] + prior)
        without = (total - grams)[:, :-1]
        normal = (without[..., :-1] + np.diag(prior)) * np.outer(size, size)
        values = np.linalg.solve(normal, (without[..., -1] * size)[..., None])[..., 0] * size
        last = len(self.fitted)
        return jackknife_variance(values[:, last - len(self.unknowns) : last])


def weighed(
    nuisances: Sequence[Nuisance],
    products: ScoreProducts,
    *,
    noise: float,
    fitted: Collection[str],
    chance: float,
    unknowns: NDArray[np.intp],
    size: int,
) -> Weighed:
    """Nuisances by the products of their columns, each there with a `chance`; `noise`, its variance
    over the products'; `fitted`, what is by name; `unknowns` of `size` in all, those that the first
    fitted columns are of.
    """
    matrix = positive_part(products.matrix, np.sqrt(products.size), TAKEN) / noise
    now = np.concatenate([n.now for n in nuisances])
    along = np.zeros((size, len(now)))
    along[unknowns] = -products.taken_up[: len(unknowns)]
    hypotheses: list[Hypothesis] = []
    given: list[int] = []
    places: list[int] = []
    first = 0
    for nuisance in nuisances:
        own = slice(first, first + len(nuisance.now))
        first, columns = own.stop, range(own.start, own.stop)
        if nuisance.exact:
            along[:, columns] = 0.0
        elif nuisance.unknowns:
            each = np.eye(len(columns)) if nuisance.of_each is None else nuisance.of_each
            along[np.ix_(nuisance.unknowns, columns)] = each.T
        places += columns[: len(nuisance.weights)]
        ways = list(product(nuisance.sizes, nuisance.roots))
        if nuisance.name in fitted:  # in the middle one of its ways
            given.append(len(hypotheses) + len(ways) // 2)
        odds = float(np.log(chance / (1.0 - chance) / len(ways)))
        for way, (size, form) in enumerate(ways):
            positive = nuisance.positive and way == 0
            hypotheses.append(Hypothesis(nuisance.name, own, form, odds, positive, size))
    counted = np.array(places, int)
    normal = matrix[np.ix_(counted, counted)]
    normal = normal + np.diag(np.concatenate([n.weights for n in nuisances])) / noise
    inverse = np.linalg.pinv(normal, 1e-12, hermitian=True)
    return Weighed(
        evidence=Evidence(matrix, products.right / noise + matrix @ now, hypotheses),
        given=tuple(given),
        now=now,
        along=along,
        counted=along[:, counted] @ inverse @ along[:, counted].T,
        noise=noise,
    )


class Evidence:
    """Of sets of `hypotheses`, from `matrix` M (k, k) and `right` b (k,), over the noise."""

    def __init__(self, matrix: Array, right: Array, hypotheses: Sequence[Hypothesis]) -> None:
        self.hypotheses = tuple(hypotheses)
        forms = {id(h.form): h for h in self.hypotheses}
        ends = np.cumsum([0, *(h.form.shape[1] for h in forms.values())]).tolist()
        of_form = {key: range(*pair) for key, pair in zip(forms, pairwise(ends), strict=True)}
        self.places = [np.array(of_form[id(h.form)]) for h in self.hypotheses]
        self.forms = np.zeros((ends[-1], len(right)))
        for key, hypothesis in forms.items():
            self.forms[of_form[key], hypothesis.columns] = hypothesis.form.T
        # with the right side below the matrix one factorisation solves, too; the corner is enough
        # for any set: the prior's part is the unit matrix
        half = csr_array(self.forms)
        below = half @ right
        each = [h.size * below[at] for h, at in zip(self.hypotheses, self.places, strict=True)]
        corner = np.array([[2.0 * sum(float(part @ part) for part in each)]])
        self._matrix = np.block([[half @ (half @ matrix).T, below[:, None]], [below, corner]])
        few = [k for k, place in enumerate(self.places) if len(place) <= _FEW]
        ends = np.cumsum([0, *(len(self.places[k]) for k in few)]).tolist()
        self._few = {k: range(*pair) for k, pair in zip(few, pairwise(ends), strict=True)}
        self._eliminated: dict[tuple[int, ...], tuple[Array, float]] = {}

    def places_of(self, chosen: Sequence[int]) -> tuple[NDArray[np.intp], Array]:
        """Places (r,) of a set's amplitudes among all `forms`, and the sizes (r,) of these."""
        at = np.concatenate([np.zeros(0, int), *(self.places[k] for k in chosen)])
        sizes = [np.full(len(self.places[k]), self.hypotheses[k].size) for k in chosen]
        return at, np.concatenate([np.zeros(0), *sizes])

    def _sized(self, chosen: Sequence[int]) -> Array:
        """1 + L' M L of a set (r + 1, r + 1), with the right side below it."""
        at, size = self.places_of(chosen)
        every, size = np.r_[at, len(self._matrix) - 1], np.r_[size, 1.0]
        matrix = self._matrix.take(every, 0).take(every, 1) * size * size[:, None]
        matrix.flat[:: len(every) + 1] += 1.0
        return np.asarray(matrix)

    def of(self, chosen: Sequence[int]) -> float:
        """ln E of a set over that of the empty one; -inf where it cannot be."""
        large = tuple(k for k in chosen if k not in self._few)
        chosen_few = [k for k in chosen if k in self._few]
        matrix, log = self._beside_large(large)
        at = [column for k in chosen_few for column in self._few[k]]
        every = [*at, len(matrix) - 1]
        half = np.linalg.cholesky(matrix.take(every, 0).take(every, 1))
        half, white = half[:-1, :-1], half[-1, :-1]
        log += 0.5 * float(white @ white) - float(np.log(np.diag(half)).sum())
        positive = self._positive(chosen_few)
        if positive.any():
            inverse = np.linalg.solve(half, np.eye(len(at))[:, positive])
            size = np.sqrt(np.square(inverse).sum(axis=0))
            log += float((log_ndtr(inverse.T @ white / size) + np.log(2.0)).sum())
        return log + sum(self.hypotheses[k].log_odds for k in chosen)

    def posterior(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Means (r,) of a set's amplitudes, and Cholesky's factor of their precision."""
        factor = np.linalg.cholesky(self._sized(chosen))
        half, white = factor[:-1, :-1], factor[-1, :-1]
        mean = solve_triangular(half.T, white, lower=False)
        for j in np.flatnonzero(self._positive(chosen)):
            unit = np.zeros(len(mean))
            unit[j] = 1.0
            column = solve_triangular(half.T, solve_triangular(half, unit, lower=True), lower=False)
            size = float(np.sqrt(column[j]))
            far = mean[j] / size
            tail = np.exp(-0.5 * far**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(far))
            mean = mean + column * (tail / size)
        return np.asarray(mean), np.asarray(half)

    def fall(self, chosen: Sequence[int], now: Array) -> float:
        """By how much a set's values `now` (k,) leave -2 ln of its posterior above its least."""
        (at, size), (mean, half) = self.places_of(chosen), self.posterior(chosen)
        here = np.linalg.lstsq(self.forms[at].T * size, now, rcond=None)[0]
        return float(np.sum(np.square(half.T @ (mean - here))))

    def explained(self, chosen: Sequence[int]) -> float:
        """By how much a set's values reduce the residual's squares over the noise's variance, of a
        fit that has nothing yet.
        """
        (at, size), (mean, _) = self.places_of(chosen), self.posterior(chosen)
        amplitudes, right = size * mean, self._matrix[at, -1]
        fall = self._matrix[np.ix_(at, at)] @ amplitudes
        return float(amplitudes @ (2.0 * right - fall))

    def values(self, chosen: Sequence[int]) -> Array:
        """The values a (k,) of all columns in a set."""
        (at, size), (mean, _) = self.places_of(chosen), self.posterior(chosen)
        return np.asarray(self.forms[at].T @ (size * mean))

    def _positive(self, chosen: Sequence[int]) -> NDArray[np.bool_]:
        """Which amplitudes (r,) of a set cannot be negative."""
        flags = [[self.hypotheses[k].positive] * len(self.places[k]) for k in chosen]
        return np.array([flag for flags_of in flags for flag in flags_of], dtype=bool).reshape(-1)

    def _beside_large(self, large: tuple[int, ...]) -> tuple[Array, float]:
        """What hypotheses of many amplitudes leave of the matrix of few; their own ln E."""
        if large not in self._eliminated:
            matrix = self._sized((*large, *self._few))
            count = sum(len(self.places[k]) for k in large)
            half = np.linalg.cholesky(matrix[:count, :count])
            white = solve_triangular(half, matrix[:count, count:], lower=True)
            log = 0.5 * float(white[:, -1] @ white[:, -1]) - float(np.log(np.diag(half)).sum())
            self._eliminated[large] = matrix[count:, count:] - white.T @ white, log
        return self._eliminated[large]


def weigh(evidence: Evidence, *, given: Sequence[int] = (), without: Collection[str] = ()) -> Sets:
    """All likely sets, by changing one thing of the likeliest, from none and from a `given` one."""
    found: dict[frozenset[int], float] = {frozenset(): 0.0}
    found[frozenset(given)] = evidence.of(tuple(given))
    layer = [*found]
    while layer:
        near: dict[frozenset[int], float] = {}
        for members in layer:
            for beside in _beside(evidence.hypotheses, members, without):
                if beside not in found:
                    found[beside] = near[beside] = evidence.of(sorted(beside))
        best = max(found.values())
        likely = [s for s, log in near.items() if log > best - _NEGLIGIBLE]
        layer = sorted(likely, key=lambda s: -near[s])[:_BEAM]
    order = sorted(found, key=lambda s: -found[s])
    logs = np.array([found[s] for s in order])
    keep = logs > logs[0] - 2.0 * _NEGLIGIBLE
    keep |= np.array([s == frozenset(given) for s in order])
    weights = np.exp(logs - logs[0])[keep]
    likely_sets = tuple(tuple(sorted(s)) for s, kept in zip(order, keep, strict=True) if kept)
    return Sets(evidence, likely_sets, weights / weights.sum())


def _beside(
    hypotheses: Sequence[Hypothesis], members: frozenset[int], without: Collection[str]
) -> Iterator[frozenset[int]]:
    """Sets with one thing more, or one in another way."""
    names = {hypotheses[k].name: k for k in members}
    for k, hypothesis in enumerate(hypotheses):
        if hypothesis.name in without:
            continue
        if hypothesis.name in names:
            yield members - {names[hypothesis.name]} | {k}
        elif len(members) < MOST_MEMBERS:
            yield members | {k}
