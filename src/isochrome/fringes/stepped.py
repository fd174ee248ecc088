r"""Absolute fringe order and isoclinic angle from a phase-stepped set.

The steps' light gives cos δ, sin δ exp 2iθ and (1 - cos δ) exp 4iθ in every pixel (`steps`), these
the continuous direction up to 90° (`isoclinic`), along which δ is signed and unwraps without the
ambiguity (δ, θ) ~ (-δ, θ + 90°): n = (φ/2π + m) exp 2iθ does not change with it. The whole number m
of each connected part comes from the user's known orders, from equilibrium and compatibility, or
from a model (`absolute`, `whole_number`); a part that has none is left unknown. Then N = |n| and
θ = arg(n)/2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fringes.absolute import unwrap
from isochrome.fringes.branch import SURE, OrderReading, probability
from isochrome.fringes.isoclinic import Direction, find_direction
from isochrome.fringes.step_quality import (
    bright_enough,
    fringed,
    phase_uncertainty,
    step_misfit,
)
from isochrome.fringes.steps import StepTerms, make_design, solve_steps
from isochrome.fringes.whole_number import KnownOrder, Part, settle
from isochrome.optics import Chain

Array = NDArray[Any]
Mask = NDArray[np.bool_]

STEEPEST = 0.4
"""Fringes a pixel: beyond half a fringe phase turns back on itself."""

_PASSES = 2
_POOR_CHI = 1.3
_LARGEST_UNCERTAINTY = 0.03
_LARGEST_MISFIT = 0.1
_LARGEST_TURN = np.radians(2.0)
_COHERENT = 0.7
_LEAST_ORDER = 4.0
_LOST = 0.15
"""Scatter of θ (rad) at which a break of 90 degrees in θ, 45 either way, is five of it."""
_WINDOW_PX = 1.2
_SMOOTH = 0.15


@dataclass(frozen=True)
class SteppedReading:
    """What a phase-stepped set tells; maps (rows, cols) float32, NaN = not known.

    `reading`, the fringe order with its uncertainty and confidence; `isoclinic`, direction of
    sigma_1, degrees counter-clockwise from the image's +x, -90 to 90; `isoclinic_uncertainty`,
    degrees; `contrast` A V, in the light's unit; `chi`, residual of the light over its noise (NaN
    where the steps leave none); `parts`, the connected parts and what settled their whole numbers;
    `warnings` in plain words.
    """

    reading: OrderReading
    isoclinic: Array
    isoclinic_uncertainty: Array
    dark_field: Array
    contrast: Array
    chi: float
    parts: tuple[Part, ...]
    warnings: tuple[str, ...]

    @property
    def order(self) -> Array:
        """The fringe order (rows, cols)."""
        return self.reading.order


def read_steps(
    stack: Array,
    chains: Sequence[Chain],
    *,
    sigma: Array | float,
    valid: Mask | None = None,
    known_order: Sequence[KnownOrder] = (),
    model: Callable[[], Array] | None = None,
) -> SteppedReading:
    """Read fringe order and isoclinic angle of one state from the images of its steps.

    Equations: the module's. Parameters: `stack` (steps, rows, cols), light in any unit; `chains`,
    the elements of each step, see `isochrome.optics.make_chain`; `sigma`, standard deviation of
    the light's noise, in its unit, a number or (rows, cols); `valid`, True = trusted pixels;
    `known_order`, (row, col, N) where the user knows it; `model`, called for a model's order
    (rows, cols), NaN outside it, where neither these nor the field itself tells the whole number.
    Returns a SteppedReading. A pixel is not known where it is masked, its contrast low, its noise
    over 0.03 fringe, its fringes finer than 2.5 pixels, or its part's whole number open. Raises
    InputError where the steps cannot tell the order.
    """
    design = make_design(chains)
    light = np.asarray(stack, dtype=np.promote_types(stack.dtype, np.float32))
    trusted = np.isfinite(light).all(axis=0)
    light = np.where(trusted, light, 0.0)
    trusted = trusted if valid is None else trusted & valid
    terms = solve_steps(light, design)
    direction = find_direction(terms, design, sigma=sigma, valid=trusted)
    for _ in range(_PASSES if design.leaks else 0):
        terms = solve_steps(light, design, direction.twice)
        direction = find_direction(terms, design, sigma=sigma, valid=trusted)
    contrast = np.hypot(terms.cosine, np.abs(terms.sine))
    seen = trusted & bright_enough(contrast, trusted)
    misfit, chi = step_misfit(light, design, sigma, seen)
    uncertainty = phase_uncertainty(terms, design, direction, sigma) * np.maximum(misfit, 1.0)
    seen &= (uncertainty < _LARGEST_UNCERTAINTY) & (
        misfit * sigma < np.maximum(_LARGEST_MISFIT * contrast, 2.0 * sigma)
    )
    turns, known = _continuous(terms, direction, seen)
    # nearer to a whole order than to be told from zero, a sign that breaks may do no harm
    known &= ~_broken(turns - np.rint(turns), turns, direction)
    numbers, parts, warnings = settle(turns, direction, known, known_order=known_order, model=model)
    harmful = known & _broken(np.nan_to_num(turns + numbers), turns, direction)
    if harmful.any():
        known &= ~harmful
        numbers, parts, warnings = settle(
            turns, direction, known, known_order=known_order, model=model
        )
    known &= np.isfinite(numbers)
    field = np.where(known, (turns + numbers) * direction.twice, np.nan)
    field, uncertainty = _smoothed(field, uncertainty, known)
    specimen = known | (trusted & fringed(contrast, design, sigma))
    return _result(field, uncertainty, direction, known, terms, specimen, chi, parts, warnings)


def _continuous(terms: StepTerms, direction: Direction, seen: Mask) -> tuple[Array, Mask]:
    """φ/2π unwrapped along the direction, and where both are seen."""
    phase = np.arctan2((terms.sine * np.conj(direction.twice)).real, terms.cosine)
    turns = unwrap(phase, seen) / (2.0 * np.pi)
    # where the direction turns within its window the sign of sin δ is open; no harm near N = 0
    open_sign = np.abs(terms.sine) > 2.0 * np.pi * _LARGEST_UNCERTAINTY * np.abs(terms.cosine)
    return turns, seen & np.isfinite(turns) & ~(open_sign & (direction.coherence < _COHERENT))


def _broken(order: Array, turns: Array, direction: Direction) -> Mask:
    """Where fringes are too steep, or the sign of the direction breaks between neighbours.

    A broken sign does harm where the signed order is not zero, or a direction is seen; one that is
    lost over a wide window, in noise or in elements a little off, may have broken unseen.
    """
    from scipy.ndimage import binary_dilation

    loaded = np.abs(order) > SURE
    off = loaded | (direction.uncertainty < _LARGEST_TURN)
    broken = np.zeros(turns.shape, dtype=bool)
    for axis in (0, 1):
        steep = np.abs(np.diff(turns, axis=axis)) > STEEPEST
        twice = direction.twice if axis == 0 else direction.twice.T
        flipped = (twice[1:] * np.conj(twice[:-1])).real < 0.0
        steep |= (flipped if axis == 0 else flipped.T) & (off[1:] if axis == 0 else off[:, 1:])
        ends = [slice(None), slice(None)]
        for side in (slice(1, None), slice(None, -1)):
            ends[axis] = side
            broken[tuple(ends)] |= steep
    return np.asarray(binary_dilation(broken) | (loaded & (direction.bridge > _LOST)))


def _smoothed(field: Array, uncertainty: Array, known: Mask) -> tuple[Array, Array]:
    """n under a kernel that leaves quadratics as they are, where its whole support is known.

    2 G(w) - G(√2 w) has no second moment; white noise is left with the factor √(0.458/π)/w of it.
    Where fringes are fine, or beside a mask, n stays that of the pixel.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    filled = np.where(known, field, 0.0)

    def pooled(part: Array) -> Array:
        part = part.astype(np.float32)
        narrow, wide = (gaussian_filter(part, w * _WINDOW_PX, truncate=3.0) for w in (1.0, 2**0.5))
        return np.asarray(2.0 * narrow - wide)

    smooth = pooled(filled.real) + 1j * pooled(filled.imag)
    rows, cols = np.gradient(np.abs(smooth))
    depth = distance_transform_edt(np.pad(known, 1))[1:-1, 1:-1]
    use = known & (depth > 4.5 * _WINDOW_PX) & (np.hypot(rows, cols) < _SMOOTH)
    gain = np.sqrt(0.458 / np.pi) / _WINDOW_PX
    return np.where(use, smooth, field), np.where(use, gain * uncertainty, uncertainty)


def _result(
    field: Array,
    uncertainty: Array,
    direction: Direction,
    known: Mask,
    terms: StepTerms,
    specimen: Mask,
    chi: float,
    parts: tuple[Part, ...],
    warnings: tuple[str, ...],
) -> SteppedReading:
    """The maps, NaN where they are not known."""
    turned = known & (direction.uncertainty < _LARGEST_TURN) & (direction.coherence > _COHERENT)
    turned &= np.abs(field) > _LEAST_ORDER * uncertainty  # nearer to zero its sign is noise
    contrast = np.hypot(terms.cosine, np.abs(terms.sine))

    def masked(values: Array, where: Mask) -> Array:
        return np.where(where, values, np.nan).astype(np.float32)

    reading = OrderReading(
        masked(np.abs(field), known),
        masked(uncertainty, known),
        np.where(known, probability(uncertainty), 0.0).astype(np.float32),
        float(known.sum() / max(1, np.count_nonzero(specimen))),
    )
    return SteppedReading(
        reading,
        masked(0.5 * np.degrees(np.angle(field)), turned),
        masked(np.degrees(direction.uncertainty), turned),
        masked(0.5 - 0.5 * terms.cosine / np.maximum(contrast, 1e-30), specimen),
        contrast.astype(np.float32),
        chi,
        parts,
        (*warnings, *_remarks(chi, reading.kept, parts)),
    )


def _remarks(chi: float, kept: float, parts: tuple[Part, ...]) -> list[str]:
    """What the user should know of the set as a whole."""
    found = []
    if chi > _POOR_CHI:
        found.append(
            f"chi = {chi:.2f}: the steps' angles or plates do not describe these frames within "
            "their noise (an element off, light that drifts, a wrong gamma); use them with care"
        )
    if kept < 0.5 and all(part.number is not None for part in parts):
        found.append(
            f"only {100 * kept:.0f} % of the specimen's pixels could be read; more steps, less "
            "noise or finer pixels help"
        )
    return found
