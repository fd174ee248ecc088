"""From what a stepped set's light says to the field n: unwrapped, settled, and smoothed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.ndimage import binary_dilation, binary_opening, distance_transform_edt, gaussian_filter

from isochrome.fringes.anchor import unwrap
from isochrome.fringes.on_branch import SURE
from isochrome.fringes.stepped.integer_order import FieldPart, KnownOrder, settle
from isochrome.fringes.stepped.isoclinic import Direction
from isochrome.fringes.stepped.step_equations import StepTerms
from isochrome.fringes.stepped.step_light import LARGEST_UNCERTAINTY, StepLight
from isochrome.fringes.windows import Array, Mask

STEEPEST = 0.4
"""Fringes a pixel: beyond half a fringe phase turns back on itself."""

WINDOW_PX = 1.2
LARGEST_TURN = np.radians(2.0)
"""Standard uncertainty of θ (rad) beyond which a direction is not known."""

_COHERENT = 0.7
_LOST = 0.15
"""Scatter of θ (rad) at which a break of 90 degrees in θ, 45 either way, is five of it."""

_SMOOTH = 0.18
"""Fringes over a window of one standard deviation, beyond which smoothing would bend n."""


@dataclass(frozen=True)
class SettledField:
    """n = N exp 2iθ (rows, cols), complex, fringes, of `known` pixels, NaN elsewhere.

    `parts`, the connected parts and what settled their whole numbers; `warnings` in plain words.
    """

    field: Array
    known: Mask
    parts: tuple[FieldPart, ...]
    warnings: tuple[str, ...]


def settle_field(
    light: StepLight,
    *,
    known_order: Sequence[KnownOrder] = (),
    model: Callable[[], Array] | None = None,
    residual: Array | None = None,
    compatible: bool = True,
) -> SettledField:
    """The field n of a set, with the whole numbers that phase leaves open.

    Parameters: `light`, see `stepped.step_light`; `known_order`, `model`, `residual` and
    `compatible` as in `isochrome.fringes.stepped.integer_order.settle`. Returns a SettledField.
    """
    direction = light.direction
    turns, known = _continuous(light.terms, direction, light.seen)
    if residual is not None:
        known &= np.isfinite(residual)
    # nearer to a whole order than to be told from zero, a sign that breaks may do no harm
    known = _solid(known & ~_broken(turns - np.rint(turns), turns, direction))

    settled = partial(
        settle,
        turns,
        direction,
        known_order=known_order,
        model=model,
        residual=residual,
        compatible=compatible,
    )
    numbers, parts, warnings = settled(known)
    harmful = known & _broken(np.nan_to_num(turns + numbers), turns, direction)
    if harmful.any():
        known = _solid(known & ~harmful)
        numbers, parts, warnings = settled(known)
    known &= np.isfinite(numbers)
    field = np.where(known, (turns + numbers) * direction.twice, np.nan)
    return SettledField(field, known, parts, warnings)


def _continuous(terms: StepTerms, direction: Direction, seen: Mask) -> tuple[Array, Mask]:
    """φ/2π unwrapped along the direction, and where both are seen."""
    phase = np.arctan2((terms.sine * np.conj(direction.twice)).real, terms.cosine)
    turns = unwrap(phase, seen) / (2.0 * np.pi)
    # where the direction turns within its window the sign of sin δ is open; no harm near N = 0
    open_sign = np.abs(terms.sine) > 2.0 * np.pi * LARGEST_UNCERTAINTY * np.abs(terms.cosine)
    return turns, seen & np.isfinite(turns) & ~(open_sign & (direction.coherence < _COHERENT))


def _broken(order: Array, turns: Array, direction: Direction) -> Mask:
    """Where fringes are too steep, or the sign of the direction breaks between neighbours.

    A broken sign does harm where the signed order is not zero, or a direction is seen; one that is
    lost over a wide window, in noise or in elements a little off, may have broken unseen.
    """
    loaded = np.abs(order) > SURE
    off = loaded | (direction.uncertainty < LARGEST_TURN)
    broken = np.zeros(turns.shape, dtype=bool)
    for axis in (0, 1):
        here, twice, may, found = (
            values.swapaxes(0, axis) for values in (turns, direction.twice, off, broken)
        )
        flipped = (twice[1:] * np.conj(twice[:-1])).real < 0.0
        steep = (np.abs(np.diff(here, axis=0)) > STEEPEST) | (flipped & may[1:])
        found[1:] |= steep
        found[:-1] |= steep
    return np.asarray(binary_dilation(broken) | (loaded & (direction.bridge > _LOST)))


def _solid(known: Mask) -> Mask:
    """Without slivers under three pixels: what is left between breaks hangs on by chance."""
    return np.asarray(binary_opening(np.pad(known, 2, mode="edge"), np.ones((3, 3))))[2:-2, 2:-2]


def smoothed(
    field: Array, uncertainty: Array, known: Mask, *, window_px: float = WINDOW_PX
) -> tuple[Array, Array]:
    """n under a kernel that leaves quadratics as they are, where its whole support is known.

    Equation: 2 G(w) - G(√2 w), G a Gaussian of standard deviation w, has no second moment; white
    noise is left with the factor √(0.458/π)/w of it. Where fringes are fine, or beside a mask, n
    stays that of the pixel. Parameters: `field`, complex (rows, cols), fringes; `uncertainty`
    (rows, cols), fringes; `known`, True where they are; `window_px` w. Returns both, smoothed.
    """
    filled = np.where(known, field, 0.0).astype(np.complex64)
    narrow, wide = (gaussian_filter(filled, w * window_px, truncate=3.0) for w in (1.0, 2**0.5))
    smooth = 2.0 * narrow - wide
    rows, cols = np.gradient(np.abs(smooth))
    depth = distance_transform_edt(np.pad(known, 1))[1:-1, 1:-1]
    use = known & (depth > 4.5 * window_px) & (np.hypot(rows, cols) * window_px < _SMOOTH)
    gain = np.sqrt(0.458 / np.pi) / window_px
    return np.where(use, smooth, field), np.where(use, gain * uncertainty, uncertainty)
