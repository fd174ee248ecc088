"""The whole number of each connected part of an unwrapped field, and what it was taken from.

In this order: orders that the user knows; equilibrium and compatibility (see `balance`); a model.
Where the first two disagree, or nothing tells, that is said.

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
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, label

from isochrome.fringes.step_equations import Direction
from isochrome.fringes.windows import Array, Mask, block_means, valid_means
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
        equilibrium = balance(turns, direction.twice, inside, spread=direction.spread, **options)
        balanced = equilibrium.whole if equilibrium else None
        if index in seeds:
            number, notes = _from_seeds(turns, seeds[index], balanced)
            source = "none" if number is None else "known order"
        elif balanced is not None:
            number, source, notes = balanced, "equilibrium", []
        else:
            number = _from_model(turns, inside, model()) if model else None
            source, notes = "model", [message("whole_number_order_taken")]
            if number is None:
                count_in = np.count_nonzero(inside)
                source, notes = "none", [message("part_pixels_has_no", count_nonzero=count_in)]
        warnings += notes
        parts.append(FieldPart(number, source))
        if number is not None:
            numbers[inside] = number
    return numbers, tuple(parts), tuple(warnings)


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
