"""From what a stepped set's light says to the field n: unwrapped, settled, and smoothed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fringes.absolute import unwrap
from isochrome.fringes.branch import SURE
from isochrome.fringes.isoclinic import Direction
from isochrome.fringes.step_light import LARGEST_UNCERTAINTY, StepLight
from isochrome.fringes.steps import StepTerms
from isochrome.fringes.whole_number import KnownOrder, Part, settle

Array = NDArray[Any]
Mask = NDArray[np.bool_]

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
    parts: tuple[Part, ...]
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

    Parameters: `light`, see `isochrome.fringes.step_light`; `known_order`, `model`, `residual` and
    `compatible` as in `isochrome.fringes.whole_number.settle`. Returns a SettledField.
    """
    direction = light.direction
    turns, known = _continuous(light.terms, direction, light.seen)
    if residual is not None:
        known &= np.isfinite(residual)
    # nearer to a whole order than to be told from zero, a sign that breaks may do no harm
    known = _solid(known & ~_broken(turns - np.rint(turns), turns, direction))

    def settled() -> tuple[Array, tuple[Part, ...], tuple[str, ...]]:
        return settle(
            turns,
            direction,
            known,
            known_order=known_order,
            model=model,
            residual=residual,
            compatible=compatible,
        )

    numbers, parts, warnings = settled()
    harmful = known & _broken(np.nan_to_num(turns + numbers), turns, direction)
    if harmful.any():
        known = _solid(known & ~harmful)
        numbers, parts, warnings = settled()
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
    from scipy.ndimage import binary_dilation

    loaded = np.abs(order) > SURE
    off = loaded | (direction.uncertainty < LARGEST_TURN)
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


def _solid(known: Mask) -> Mask:
    """Without slivers under three pixels: what is left between breaks hangs on by chance."""
    from scipy.ndimage import binary_opening

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
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    filled = np.where(known, field, 0.0)

    def pooled(part: Array) -> Array:
        part = part.astype(np.float32)
        narrow, wide = (gaussian_filter(part, w * window_px, truncate=3.0) for w in (1.0, 2**0.5))
        return np.asarray(2.0 * narrow - wide)

    smooth = pooled(filled.real) + 1j * pooled(filled.imag)
    rows, cols = np.gradient(np.abs(smooth))
    depth = distance_transform_edt(np.pad(known, 1))[1:-1, 1:-1]
    use = known & (depth > 4.5 * window_px) & (np.hypot(rows, cols) * window_px < _SMOOTH)
    gain = np.sqrt(0.458 / np.pi) / window_px
    return np.where(use, smooth, field), np.where(use, gain * uncertainty, uncertainty)
