"""The whole number of each connected part of an unwrapped field, and what it was taken from.

In this order: orders that the user knows; equilibrium and compatibility (see `balance`); a model.
Where the first two disagree, or nothing tells, that is said.

The direction of sigma_1 from the maps of a phase-stepped set, pooled and made continuous.

sin δ exp 2iθ, squared, and (1 - cos δ) exp 4iθ both point along exp 4iθ. The first is nothing at
whole and half orders, the second at whole ones; weighted with their information they are summed
over a small window, which no wrap of θ disturbs, and which fringes do not interrupt. The root,
exp 2iθ, keeps a sign that continuity settles: about an isotropic point 2θ turns whole, so that
a continuous choice exists all round it.

From wrapped to absolute fringe order: unwrapping, and the whole number that phase leaves open.

Phase stepping gives δ and the direction of sigma_1 up to the joint change (δ, θ) ~ (-δ, θ + 90°),
which leaves n = (sigma_1 - sigma_2 as fringes) exp 2iθ = (φ/2π + m) exp 2iθ as it is once θ is
continuous. One whole number m for each connected part is then all that is not known.

In a plane elastic specimen without body forces n obeys equilibrium and compatibility:
σy - σx + 2iτxy = 2 (z* Φ' + Ψ) with Φ', Ψ analytic in z = x + iy, y upward, so that ∂²n/∂z² = 0.
Any other whole number adds (m' - m) exp 2iθ, which does not obey it where θ varies: the equation,
linear in m, is solved for m by least squares over the part, on derivatives of Gaussians. Residual
stress obeys equilibrium and no compatibility: its n leaves the imaginary part of 4 ∂²n/∂z² alone
nought, 2 (∂xx - ∂yy) τxy - 2 ∂x∂y (σx - σy); the real part is -∇²(σx + σy).
Source: Muskhelishvili (1953), Some Basic Problems of the Mathematical Theory of Elasticity, for
the stresses' form; the use made of it here was derived from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, label

from isochrome.fringes.step_equations import (
    CROSS,
    CROSS_SINE,
    SINE,
    SINE_SINE,
    StepDesign,
    StepTerms,
)
from isochrome.fringes.windows import Array, Mask, block_means, pooled, valid_means
from isochrome.messages import message

_BLOCK = 4
_FULL = 0.7
_WIDTHS = (12.0, 8.0, 5.0, 3.0, 2.0)
"""Of the Gaussians, in blocks of pixels, the widest first: noise falls as the sixth power of it."""

_SUPPORT = 3.5
_FEWEST = 5.0
"""Independent places, of one Gaussian's area each, that a part must have."""

_NEAR = 0.3
"""How far from a whole number m and twice its uncertainty may lie."""

_LEAST_SIGNAL = 0.5
"""Of what is seen of exp 2iθ's second derivative; the rest is the noise that is expected. In a beam
the direction does not vary, and all of it is noise."""


@dataclass(frozen=True)
class Balance:
    """The number m that equilibrium and compatibility ask for, and its standard uncertainty."""

    number: float
    standard_uncertainty: float

    @property
    def whole(self) -> int | None:
        """The whole number, None where the equations do not single it out."""
        near = abs(self.number - round(self.number)) + 2.0 * self.standard_uncertainty
        return round(self.number) if near < _NEAR else None


def unwrap(phase: Array, mask: Mask) -> Array:
    """Phase (rad) made continuous over the masked-in pixels, fringe quality first; NaN elsewhere.

    A NaN hangs scikit-image's unwrap_phase, so that only finite pixels are passed to it. Parts that
    do not touch have whole turns of their own. Source: Herraez, Burton, Lalor & Gdeisat (2002),
    Applied Optics 41, 7437.
    """
    from skimage.restoration import unwrap_phase

    good = mask & np.isfinite(phase)
    if np.count_nonzero(good) < 2 or min(phase.shape) < 2:
        return np.where(good, phase, np.nan)
    hidden = np.ma.array(np.where(good, phase, 0.0), mask=~good)
    return np.where(good, np.asarray(unwrap_phase(hidden).filled(0.0)), np.nan)


def balance(
    turns: Array,
    direction: Array,
    inside: Mask,
    *,
    spread: Array,
    residual: Array | None = None,
    compatible: bool = True,
) -> Balance | None:
    """The whole number m of a part of the field by equilibrium and compatibility, if they tell.

    Least Σ |∂²_z (turns e - n₀) + m ∂²_z e|², weighted by the noise and robustly, less the noise's
    own share of the sums, which would draw m to -turns. `turns` φ/2π, signed; `direction` e = exp
    2iθ, continuous; `spread`, a pixel's own deviation of 2θ (rad); `residual` n₀, all over the
    part; not `compatible`: turns e is itself a residual stress's. Source: the module's.
    """
    share = block_means(inside.astype(float), _BLOCK)
    load_turns = turns * direction if residual is None else turns * direction - residual
    field, angle, signed, noise = (
        valid_means(values, inside, _BLOCK)
        for values in (load_turns, direction, turns, np.square(spread) / _BLOCK**2)
    )
    # a masked pixel here and there is no edge of the part
    depth = distance_transform_edt(np.pad(share > _FULL, 1))[1:-1, 1:-1]
    for width in _WIDTHS:
        use = depth > _SUPPORT * width
        places = np.count_nonzero(use) / (4.0 * np.pi * width**2)
        if places < _FEWEST:
            continue
        # white noise of variance v is left with v ∫ k⁴ exp(-k²w²) d²k/4π² = v/(2π w⁶)
        noise_slope = gaussian_filter(noise, width)[use] / (2.0 * np.pi * width**6)
        bent, turned = _bending(field, width)[use], _bending(angle, width)[use]
        if not compatible:  # one equation of the two, which has half the noise
            bent, turned, noise_slope = 1j * bent.imag, 1j * turned.imag, 0.5 * noise_slope
        solution = _solve(
            bent, turned, signed[use], noise_slope, places if compatible else 0.5 * places
        )
        if solution is not None:
            return solution
    return None


def _bending(values: Array, width: float) -> Array:
    """4 ∂²/∂z² = ∂xx - ∂yy - 2i ∂x∂y of complex values, with y upward, under a Gaussian."""
    xx, yy, xy = (gaussian_filter(values, width, order=o) for o in ((0, 2), (2, 0), (1, 1)))
    return np.asarray(xx - yy + 2j * xy)  # rows grow downward: ∂y = -∂row


def _solve(bent: Array, turned: Array, turns: Array, noise: Array, places: float) -> Balance | None:
    """m of bent + m turned = 0, each place by its noise, and by its misfit where that is larger."""
    number, square = 0.0, np.abs(turned) ** 2
    weight = 1.0 / (noise + 1e-30)
    for _ in range(20):
        information = float((weight * (square - noise)).sum())
        if information < _LEAST_SIGNAL * float((weight * square).sum()):
            return None
        cross = (bent * np.conj(turned)).real - turns * noise
        number = -float((weight * cross).sum()) / information
        misfit = np.abs(bent + number * turned)
        # the noise of the sum is that of (turns + m) e, and of turns
        scale = np.sqrt(noise * (1.0 + (turns + number) ** 2)) + 1e-15
        weight = 1.0 / (scale * np.maximum(scale, misfit / np.median(misfit / scale)) + 1e-30)
    spread = (weight**2 * misfit**2 * square).sum() * 0.5 * len(bent) / places
    return Balance(number, float(np.sqrt(spread)) / information)


_WINDOW_PX = 1.6
_WIDE_PX = 6.0
_WIDE_SPREAD = 0.2
"""What the wide window's 4θ is trusted to (rad), where the narrow one has nothing: whole orders."""

_SLOPE_PX = 2.0
_TURNED = 0.8
"""Error of θ (rad) for a coherence of nought: seen about isotropic points."""

_OFF = 0.007
"""Light, of the amplitude, that elements 0.2 degree off add: 0.0035 rad, twice in 2θ."""

_STRIDE = 2

_BENT_PX = 3.0
"""Window over which the misfit of a bent direction is pooled."""

_ONE_SIDED = 1.0 / (np.sqrt(2.0) - 1.0)
_MOST = 0.95
"""Share of a window that must be seen; beside an edge the error grows as its width instead."""

_OF_NOISE = 1.0 / 6.0
"""Variance, in the narrow window's, that noise gives the difference to a window √2 as wide."""


@dataclass(frozen=True)
class Direction:
    """The direction of sigma_1, up to 90°, as maps (rows, cols)."""

    twice: Array  # exp 2iθ, continuous
    scatter: Array  # standard, of θ (rad), from the noise
    uncertainty: Array  # with what is added where the direction bends or turns within the window
    coherence: Array  # 0..1, low at an isotropic point
    # scatter (rad) in a wide window, which spans a thin line of no information, from noise and
    # from elements a little off: where it is large, exp 2iθ may change sign across the line
    bridge: Array

    @property
    def spread(self) -> Array:
        """The same noise of 2θ if it were independent from pixel to pixel (rad)."""
        return np.asarray(2.0 * np.minimum(self.scatter, 0.5) * np.sqrt(4.0 * np.pi) * _WINDOW_PX)

    def noisier(self, times: Array) -> Direction:
        """The same where the light's noise is some times what was stated (rows, cols)."""
        more = np.square(self.scatter) * (np.square(times) - 1.0)
        uncertainty = np.sqrt(np.square(self.uncertainty) + more)
        return replace(self, scatter=self.scatter * times, uncertainty=uncertainty)


def four_theta(terms: StepTerms, design: StepDesign, sigma: Array | float) -> tuple[Array, Array]:
    """Each pixel's information on 4θ, as a complex number along exp 4iθ, and its size, both times
    sigma².

    E = S²/(4 vS) + Q (A - c)/vQ, with S = A sin δ exp 2iθ, Q = A (1 - cos δ) exp 4iθ, c = A cos δ,
    and vS, vQ their variances for unit noise; the squares' means of noise are taken off.
    """
    first, second = design.variance(SINE), design.variance(SINE_SINE)
    spread = 0.5 * (first + second)
    asymmetry = first - second + 2j * design.variance(SINE, SINE_SINE)
    noise = np.square(sigma)
    along = (terms.sine**2 - asymmetry * noise) / (4.0 * spread)
    size = np.maximum(np.abs(terms.sine) ** 2 - 2.0 * spread * noise, 0.0) / (4.0 * spread)
    if terms.cross is not None:
        spread = 0.5 * (design.variance(CROSS) + design.variance(CROSS_SINE))
        lift = np.maximum(pooled(terms.amplitude, 2.0 * _WINDOW_PX) - terms.cosine, 0.0)
        along = along + terms.cross * lift / spread
        size = size + lift**2 / spread
    return along, size


def find_direction(
    terms: StepTerms, design: StepDesign, *, sigma: Array | float, valid: Mask
) -> Direction:
    """The continuous direction of a set of steps, up to 90° over each connected part."""
    along, size = (np.where(valid, part, 0.0) for part in four_theta(terms, design, sigma))
    narrow, information = _centred(along, size, _WINDOW_PX)
    wide = pooled(along, _WIDE_PX)
    area = 4.0 * np.pi * _WINDOW_PX**2
    noise = np.square(sigma)
    wide = wide / np.maximum(np.abs(wide), 1e-30) * noise / (area * _WIDE_SPREAD**2)
    angle = np.angle(narrow + wide)
    steps = slice(None, None, _STRIDE)
    rough = np.exp(0.5j * np.nan_to_num(unwrap(angle[steps, steps], valid[steps, steps])))
    coarse = rough.repeat(_STRIDE, axis=0).repeat(_STRIDE, axis=1)
    coarse = coarse[: angle.shape[0], : angle.shape[1]]
    twice = np.exp(0.5j * angle)
    twice = np.where((twice * np.conj(coarse)).real < 0.0, -twice, twice)
    scatter = 0.25 * np.sqrt(noise / np.maximum(information * area, 1e-30))
    # elements a little off do not average out, nor does what was taken out along the direction
    off = max(_OFF, design.leak) * terms.amplitude
    doubt = noise / (4.0 * np.pi * _WIDE_PX**2) + np.square(off)
    bridge = 0.25 * np.sqrt(doubt / np.maximum(pooled(size, _WIDE_PX), 1e-30))
    coherence = np.minimum(np.abs(narrow) / np.maximum(information, 1e-30), 1.0)
    turned = np.hypot(_TURNED * (1.0 - coherence) ** 2, _bent(along, size, narrow, scatter, valid))
    return Direction(twice, scatter, np.hypot(scatter, turned), coherence, bridge)


def _bent(along: Array, size: Array, narrow: Array, scatter: Array, valid: Mask) -> Array:
    """Error of θ (rad) where the direction bends within the window.

    It grows as the window's area, so that the difference to one of twice the area is the error
    itself, and noise, whose share is taken off.
    """
    double = np.sqrt(2.0) * _WINDOW_PX
    other, _ = _centred(along, size, double)
    away = 0.25 * np.angle(other * np.conj(narrow))
    share = gaussian_filter(valid.astype(np.float32), double, mode="constant")
    away *= np.where(share > _MOST, 1.0, _ONE_SIDED)
    trust = 1.0 / np.square(scatter)
    square = pooled(trust * np.square(away) - _OF_NOISE, _BENT_PX)
    return np.asarray(np.sqrt(np.maximum(square, 0.0) / pooled(trust, _BENT_PX)))


def _centred(along: Array, size: Array, window_px: float) -> tuple[Array, Array]:
    """Pooled exp 4iθ, turned from where its information lies to the window's middle, and that.

    Fringes put the information's centre of mass beside the middle, by w² ∇J/J for a Gaussian
    window of width w, where 4θ is another by its gradient: ψ(0) = ψ - ∇ψ w² ∇J/J.
    """
    narrow, information = pooled(along, window_px), pooled(size, window_px)
    rough = pooled(narrow, _SLOPE_PX)
    square = np.maximum(np.square(np.abs(rough)), 1e-30)
    turn = np.zeros(information.shape)
    for axis in (0, 1):
        slope = (np.conj(rough) * np.gradient(rough, axis=axis)).imag / square
        turn += slope * np.gradient(information, axis=axis)
    turn *= window_px**2 / np.maximum(information, 1e-30)
    return narrow * np.exp(-1j * np.clip(turn, -1.0, 1.0)), information


KnownOrder = tuple[int, int, float]
"""Row, column (pixels), and the fringe order there."""

_Seed = tuple[KnownOrder, tuple[int, int]]
"""A known order, and the pixel of the part at which it is looked up."""

_SMALLEST_SHARE = 0.02
"""Of the known pixels: a smaller part has only the user's known orders."""

_NEAR_PX = 3
_TIE = 0.1
_FAR = 0.25
"""Misfit, in fringes, of a known order beyond which it is another whole number, or wrong."""

_MODEL_MISFIT = 0.3


@dataclass(frozen=True)
class FieldPart:
    """A connected part's whole `number` m (None: open) and where that is from.

    `source` is 'known order', 'equilibrium', 'model' or 'none'.
    """

    number: int | None
    source: str


def settle(
    turns: Array,
    direction: Direction,
    known: Mask,
    *,
    known_order: Sequence[KnownOrder] = (),
    model: Callable[[], Array] | None = None,
    residual: Array | None = None,
    compatible: bool = True,
) -> tuple[Array, tuple[FieldPart, ...], tuple[str, ...]]:
    """The whole number m of each part, so that N = |turns + m|; NaN where it is open.

    `turns` φ/2π, unwrapped; `known`, where it and the continuous direction are; `known_order`,
    (row, col, N) each; `model` gives a model's order where nothing else tells; for `residual` n and
    `compatible` see `balance`. Then the parts that are not too small, largest first, and warnings.
    """
    labels, count = label(known)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    seeds = _seeds_of_parts(labels, known_order)
    warnings = [
        message("frames_known_order_row_column_order", row=row, col=col, order=order)
        for (row, col, order), _ in seeds.pop(0, [])
    ]
    numbers = np.full(turns.shape, np.nan)
    options: dict[str, Any] = {"residual": residual, "compatible": compatible}
    parts = []
    for index in (np.argsort(-sizes[1:]) + 1).tolist():
        if sizes[index] < _SMALLEST_SHARE * sizes[1:].sum() and index not in seeds:
            continue
        inside = labels == index
        balanced = balance(turns, direction.twice, inside, spread=direction.spread, **options)
        balanced_number = balanced.whole if balanced else None
        number, source, notes = _part_number(
            turns, inside, balanced_number, seeds.get(index, []), model
        )
        warnings += notes
        parts.append(FieldPart(number, source))
        if number is not None:
            numbers[inside] = number
    return numbers, tuple(parts), tuple(warnings)


def _part_number(
    turns: Array,
    inside: Mask,
    balanced: int | None,
    seeds: list[_Seed],
    model: Callable[[], Array] | None,
) -> tuple[int | None, str, list[str]]:
    """The number of a part, what it is from, and what to say of it; `balanced`, by equilibrium."""
    if seeds:
        number, notes = _from_seeds(turns, seeds, balanced)
        return number, "none" if number is None else "known order", notes
    if balanced is not None:
        return balanced, "equilibrium", []
    number = _from_model(turns, inside, model()) if model else None
    if number is not None:
        note = message("whole_number_order_taken")
        return number, "model", [note]
    note = message("part_pixels_has_no", count_nonzero=np.count_nonzero(inside))
    return None, "none", [note]


def _seeds_of_parts(labels: Array, known_order: Sequence[KnownOrder]) -> dict[int, list[_Seed]]:
    """Known orders by the part they lie in or beside, with the pixel to look at; 0: none."""
    seeds_of: dict[int, list[_Seed]] = {}
    rows, cols = labels.shape
    for seed in known_order:
        row, col = seed[0], seed[1]
        near = [
            (abs(r - row) + abs(c - col), r, c)
            for r in range(max(0, row - _NEAR_PX), min(rows, row + _NEAR_PX + 1))
            for c in range(max(0, col - _NEAR_PX), min(cols, col + _NEAR_PX + 1))
            if labels[r, c]
        ]
        place = min(near)[1:] if near else (0, 0)
        seeds_of.setdefault(int(labels[place]) if near else 0, []).append((seed, place))
    return seeds_of


def _from_seeds(
    turns: Array, seeds: list[_Seed], balanced: int | None
) -> tuple[int | None, list[str]]:
    """The number under which |turns + m| is the known orders, and what to say of it."""
    here = np.array([turns[place] for _, place in seeds])
    orders = np.array([seed[2] for seed, _ in seeds])
    tried = np.unique(np.rint([orders - here, -orders - here])).astype(int)
    misfit = np.array([np.mean(np.abs(np.abs(here + m) - orders)) for m in tried])
    best = tried[misfit < misfit.min() + _TIE]
    if misfit.min() > _FAR:
        return None, [message("frames_known_order_disagrees_light", min=misfit.min())]
    if len(best) > 1 and balanced not in best:
        return None, [message("frames_known_order_leaves_two")]
    number = balanced if len(best) > 1 else int(best[0])
    if balanced is not None and balanced != number:
        return number, [
            message("frames_known_order_equilibrium_field", number=abs(balanced - (number or 0)))
        ]
    return number, []


def _from_model(turns: Array, inside: Mask, model: Array) -> int | None:
    """The number under which the order is nearest to a model's, low orders before high ones.

    None where the model does not single one out: a wrong load shifts high orders by whole ones.
    """
    both = inside & np.isfinite(model)
    if np.count_nonzero(both) < 0.5 * np.count_nonzero(inside):
        return None
    here, order = turns[both], model[both]
    weight = 1.0 / (0.1 + order) ** 2
    middle = [np.rint(np.median(sign * order - here)) for sign in (1, -1)]
    tried = np.unique(np.add.outer(middle, np.arange(-2, 3))).astype(int)
    misfit = np.array([np.average(np.abs(np.abs(here + m) - order), weights=weight) for m in tried])
    first, second = np.sort(misfit)[:2]
    return int(tried[misfit.argmin()]) if first < _MODEL_MISFIT and second > 2.0 * first else None
