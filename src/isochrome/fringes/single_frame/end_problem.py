r"""Ends of the light and patches of the order as one least-squares problem.

A patch's pixel has the light I = M^(1/g), M = D (1 - s) + B s, s = (1 - a cos 2 pi N)/2: D and B
are sums of given shapes, N is a cubic of the place, g the tone exponent, and a = sinc N_x sinc N_y
what a bin of some pixels leaves of a fringe. The cubic terms are nuisances: without them, what a
quadratic cannot follow would be taken for light, with a certainty that it does not have.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from isochrome.estimation import State, minimise_all, solve_all
from isochrome.fringes.single_frame.end_images import QUADRATICS, SmoothImages
from isochrome.fringes.single_frame.patches import HALF, TURN, patch_prior
from isochrome.fringes.windows import Array, Indices, Mask

TERMS = 10
"""Of a patch's order: a quadratic's six, and N_xxx, N_xxy, N_xyy, N_yyy."""
_CUBIC = 1e-3
"""Prior standard deviation of the cubic terms, fringes/px³."""
_TONE = 0.5
_FLOOR = 0.01
"""Of the contrast: light below it is as good as none to the power 1/g."""
_PIVOT = 1e-3


_SIDE = np.arange(-HALF, HALF + 1, dtype=float)
_POWERS: Array = _SIDE[:, None] ** np.arange(4) / np.array([1.0, 1.0, 2.0, 6.0])
"""d^n/n! along a patch's side (2 HALF + 1, 4)."""
_DY: Indices = np.array([0, 0, 1, 0, 1, 2, 0, 1, 2, 3])
_DX: Indices = np.array([0, 1, 0, 2, 1, 0, 3, 2, 1, 0])
"""Powers of the cubic's terms."""
BASIS: Array = (_POWERS[:, None, _DY] * _POWERS[None, :, _DX]).reshape(-1, TERMS)
"""The cubic's terms at a patch's pixels (k, 10)."""
_PAIRS = (BASIS[:, :, None] * BASIS[:, None, :]).reshape(len(BASIS), -1)
_PRIOR = np.concatenate([patch_prior().astype(float), np.full(4, _CUBIC**-2)])
_DIAGONAL = np.arange(TERMS)


@dataclass(frozen=True, kw_only=True)
class EndProblem:
    """A frame in bins of `by` pixels: `light`, `sigma`, `valid` (rows, cols), and its unknowns.

    `shapes`, what the dark and the bright end are sums of, with the terms' prior deviations over
    the contrast; of an end that is given, its image (rows, cols), of which one term is a multiple;
    `tone`, whether g is unknown; `scale`, about the contrast. The unknowns' vector holds the dark
    end's terms, the bright end's, and g.
    """

    light: Array = field(repr=False)
    sigma: Array = field(repr=False)
    valid: Mask = field(repr=False)
    shapes: tuple[SmoothImages | Array, SmoothImages | Array] = field(repr=False)
    tone: bool
    scale: float
    by: int

    @property
    def given(self) -> tuple[bool, bool]:
        """Whether the dark and the bright end are given."""
        dark, bright = (not isinstance(shape, SmoothImages) for shape in self.shapes)
        return dark, bright

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

    @property
    def spots(self) -> Mask:
        """Which of the unknowns' vector are spots and bars of the bright end (terms,)."""
        cut, count = (len(spread) for spread in self.spreads)
        smooth = min(QUADRATICS, count)
        return np.repeat([False, True, False], [cut + smooth, count - smooth, 1])

    @cached_property
    def found(self) -> list[SmoothImages]:
        """What those that are to be found are multiples of: an end's images, 1 for g."""
        rows, cols = (np.ones((n, 1)) for n in self.light.shape)
        one = SmoothImages(rows, cols, np.zeros((1, 2), dtype=int), np.array([_TONE]))
        ends = [shape for shape in self.shapes if isinstance(shape, SmoothImages)]
        return [*ends, one] if self.tone else ends

    def ends(self, unknowns: Array) -> tuple[Array, Array]:
        """D and B of all bins (rows, cols)."""
        cut, g = len(self.spreads[0]), unknowns[-1]
        dark, bright = (
            _end(shape, terms, g)
            for shape, terms in zip(self.shapes, (unknowns[:cut], unknowns[cut:-1]), strict=True)
        )
        return dark, bright

    def prior(self, unknowns: Array) -> tuple[Array, Array]:
        """Inverse variances of the unknowns, and their distance from what is expected."""
        weight = np.append((np.concatenate(self.spreads) * self.scale) ** -2.0, _TONE**-2)
        away = unknowns.copy()
        away[-1] -= 1.0
        return weight, away

    def prior_cost(self, unknowns: Array) -> float:
        """What the unknowns that are to be found cost by themselves."""
        weight, away = self.prior(unknowns)
        return float((weight * away**2)[self.free].sum())


def _end(shape: SmoothImages | Array, terms: Array, g: float) -> Array:
    """An end (rows, cols): a sum of smooth images, or what is given to the power g."""
    if isinstance(shape, SmoothImages):
        return shape.sum(terms)
    given = terms[0] * shape
    return np.asarray(given if g == 1.0 else np.maximum(given, 0.0) ** g)


@dataclass(frozen=True, kw_only=True)
class PatchData:
    """Patches in use of a problem: `index` on their lattice (p,), and their pixels (p, k).

    `places`, rows and columns of their middles (p, 2); `pixels`, their numbers in the frame;
    `light`, `weight` of each; `window`, the sum of a patch's pixels' weights before the noise (p,);
    `chi` (p,); `thinned`, whether every second patch was left out.
    """

    problem: EndProblem = field(repr=False)
    index: Indices = field(repr=False)
    light: Array = field(repr=False)
    weight: Array = field(repr=False)
    places: Indices = field(repr=False)
    pixels: Indices = field(repr=False)
    window: Array = field(repr=False)
    chi: Array = field(repr=False)
    thinned: bool

    @cached_property
    def factors(self) -> list[tuple[Array, Array]]:
        """The factors of `EndProblem.found` times `_POWERS`, down and across the patches.

        Those of an image (p, 2 HALF + 1, 4 a), (p, 2 HALF + 1, 4 b), the powers first.
        """
        rows, cols = (place[:, None] + np.arange(-HALF, HALF + 1) for place in self.places.T)
        return [
            (_by_powers(image.down[rows]), _by_powers(image.across[cols]))
            for image in self.problem.found
        ]


def _by_powers(factors: Array) -> Array:
    """Factors (p, k, a) times the powers of the place in a patch (p, k, 4 a)."""
    patches, side, count = factors.shape
    return (_POWERS[:, :, None] * factors[:, :, None, :]).reshape(patches, side, 4 * count)


@dataclass(frozen=True)
class PatchEnds:
    """Some `unknowns` (terms,), and the ends D, B that they are at the patches' pixels (p, k)."""

    unknowns: Array
    dark: Array = field(repr=False)
    bright: Array = field(repr=False)


def ends_at(data: PatchData, unknowns: Array) -> PatchEnds:
    """The ends at the patches' pixels.

    Parameters: `data`; `unknowns` (terms,). Returns the PatchEnds.
    """
    dark, bright = (end.ravel()[data.pixels] for end in data.problem.ends(unknowns))
    return PatchEnds(unknowns, dark, bright)


@dataclass(frozen=True, kw_only=True)
class Looked:
    """The model at some ends and orders: `cost` of each patch, `residual` (p, k).

    Slopes (p, k) are worked out when they are asked for: `slope` by the order; `columns`, by the
    dark end, the bright end, and g if that is unknown.
    """

    cost: Array
    residual: Array
    problem: EndProblem = field(repr=False)
    ends: PatchEnds = field(repr=False)
    angle: Array = field(repr=False)
    fade: Array | float = field(repr=False)
    signal: Array = field(repr=False)
    linear: Array = field(repr=False)
    light: Array = field(repr=False)

    @cached_property
    def gain(self) -> Array | float:
        """dI/dM (p, k)."""
        if not _is_curved(self.problem, self.ends.unknowns):
            return 1.0
        return np.asarray(self.light / (self.ends.unknowns[-1] * self.linear))

    @cached_property
    def slope(self) -> Array:
        """dI/dN."""
        contrast = self.gain * (self.ends.bright - self.ends.dark)
        return np.asarray(np.pi * contrast * self.fade * np.sin(self.angle))

    @cached_property
    def columns(self) -> tuple[Array, ...]:
        """dI/dD, dI/dB, and dI/dg if g is unknown."""
        problem, g = self.problem, self.ends.unknowns[-1]
        by_ends = self.gain * (1.0 - self.signal), self.gain * self.signal
        if not problem.tone:
            return by_ends
        by_tone = -np.log(self.linear) * self.light / g**2
        each = zip((self.ends.dark, self.ends.bright), by_ends, problem.given, strict=True)
        for end, column, known in each:
            if known:
                by_tone = by_tone + column * end * np.log(np.maximum(end, 1e-6)) / g
        return *by_ends, by_tone


def _is_curved(problem: EndProblem, unknowns: Array) -> bool:
    return problem.tone or unknowns[-1] != 1.0


def look(data: PatchData, ends: PatchEnds, orders: Array) -> Looked:
    """The residuals, and what their slopes are made of.

    The phase is taken in the precision of the light.
    Parameters: `data`; `ends`; `orders`, the patches' terms (p, 10). Returns a Looked.
    """
    problem, g = data.problem, ends.unknowns[-1]
    angle = (TURN * (orders @ BASIS.T)).astype(data.light.dtype)
    fade = _fade(orders.astype(data.light.dtype)) if problem.by > 1 else 1.0
    signal = 0.5 - 0.5 * fade * np.cos(angle)
    light = linear = ends.dark + (ends.bright - ends.dark) * signal
    if _is_curved(problem, ends.unknowns):
        linear = np.maximum(linear, _FLOOR * problem.scale)
        light = linear ** (1.0 / g)
    residual = data.light - light
    cost = np.einsum("pk,pk,pk->p", data.weight, residual, residual) + (orders**2) @ _PRIOR
    return Looked(
        cost=cost,
        residual=residual,
        problem=problem,
        ends=ends,
        angle=angle,
        fade=fade,
        signal=signal,
        linear=linear,
        light=light,
    )


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
    data: PatchData, ends: PatchEnds, orders: Array, damping: Array, steps: int
) -> tuple[Array, Array, Array]:
    """Damped steps of the patches alone, each taken where it lowers the patch's cost.

    Parameters as in `look`; `damping` (p,). Returns the orders, the patches' costs, the damping.
    """

    def at(orders: Array) -> State:
        now = look(data, ends, orders)
        return now.cost, now.residual, now.slope

    def equations(orders: Array, now: State) -> tuple[Array, Array]:
        _, residual, slope = now
        matrix, pull, _ = _information(data, residual, slope, orders)
        return matrix, pull

    orders, now, damping = minimise_all(
        at, equations, orders, damping, steps=steps, limits=(1e-6, 1e4)
    )
    return orders, now[0], damping


@dataclass(frozen=True)
class EndEquations:
    """Normal equations of the free unknowns, every patch following.

    `matrix`, `slope`; for a step x the patches' terms change by `pull` - `drag` x, (p, 10) and
    (p, 10, terms); `spread` (p,), standard uncertainty of a patch's order with the ends known.
    """

    matrix: Array
    slope: Array
    pull: Array
    drag: Array
    spread: Array


def eliminated(data: PatchData, ends: PatchEnds, orders: Array) -> EndEquations:
    """Normal equations with the patches' own terms eliminated.

    A patch whose own equations are singular is left out.
    Parameters as in `look`. Returns the EndEquations.
    """
    problem, now = data.problem, look(data, ends, orders)
    own, pull, weighted = _information(data, now.residual, now.slope, orders)
    inverse = solve_all(own, np.broadcast_to(np.eye(TERMS), own.shape))
    whole = np.isfinite(inverse).all(axis=(1, 2))
    told = np.asarray((inverse[:, _DIAGONAL, _DIAGONAL] > 0.0).all(axis=1) & whole)
    parts = data.weight, weighted, pull
    weight, weighted, pull = (np.where(told[:, None], part, 0.0) for part in parts)
    inverse = np.where(told[:, None, None], inverse, 0.0)
    matrix, slope = _of_ends(data, now, weight)
    mixed = _with_orders(data, now, weighted)
    solved = inverse @ np.concatenate([mixed, pull[..., None]], axis=-1)
    prior, away = problem.prior(ends.unknowns)
    free = problem.free
    inner = np.tensordot(mixed, solved, axes=((0, 1), (0, 1)))
    return EndEquations(
        matrix - inner[:, :-1] + np.diag(prior[free]),
        slope - inner[:, -1] - (prior * away)[free],
        solved[..., -1],
        solved[..., :-1],
        np.where(told, np.sqrt(inverse[:, 0, 0]), np.inf),
    )


def _of_ends(data: PatchData, now: Looked, weight: Array) -> tuple[Array, Array]:
    """Normal equations (terms, terms), (terms,) of the free unknowns, the orders held.

    Patches overlap: what they have at a pixel of the frame is summed up first.
    """

    def summed(values: Array) -> Array:
        light = data.problem.light
        flat = np.bincount(data.pixels.ravel(), weights=values.ravel(), minlength=light.size)
        return flat.reshape(light.shape)

    parts = list(zip(data.problem.found, _columns(data.problem, now), strict=True))
    matrix = [
        [one.products(other, summed(weight * u * v)) for other, v in parts] for one, u in parts
    ]
    light = weight * now.residual
    slope = [one.along(summed(light * u)) for one, u in parts]
    return np.block(matrix), np.concatenate(slope)


def _with_orders(data: PatchData, now: Looked, weighted: Array) -> Array:
    """Mixed terms of the patches' orders and the free unknowns (p, 10, terms).

    A term's power and an image's factor are taken down and across the patch together.
    """
    mixed = []
    parts = zip(data.problem.found, data.factors, _columns(data.problem, now), strict=True)
    for image, (down, across), column in parts:
        light = (weighted * column).reshape(-1, len(_POWERS), len(_POWERS))
        table = np.swapaxes(down, 1, 2) @ (light @ across)
        a, b = (factors.shape[-1] // 4 for factors in (down, across))
        row, col = image.pairs.T
        which = (_DY[:, None] * a + row) * 4 * b + _DX[:, None] * b + col
        mixed.append(np.take(table.reshape(len(table), -1), which, axis=1))
    return np.concatenate(mixed, axis=-1)


def _columns(problem: EndProblem, now: Looked) -> list[Array]:
    """Slopes (p, k) by what is to be found, in the order of `EndProblem.found`."""
    by_ends = [c for c, known in zip(now.columns, problem.given, strict=False) if not known]
    return [*by_ends, *now.columns[2:]]


def total(data: PatchData, cost: Array, unknowns: Array) -> float:
    """The patches' costs and the unknowns' own."""
    return float(cost.sum() + data.problem.prior_cost(unknowns))
