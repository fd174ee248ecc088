"""The light of a frame that has both no-load frames, whether or not it is exposed as they are.

A frame's brightest line tells its exposure where it is a fringe of N = 1/2, 3/2, .... Under more
light it would be a ridge of an order below 1/2, and the frame alone cannot tell one from the other:
a dark fringe in it can, or known orders on both sides of a half, or one beside the line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from isochrome.fringes import (
    CLEAR,
    MOST_COST,
    STATED_SPREAD,
    BackgroundModulation,
    NoLoadExposure,
    exact_ends,
    find_no_load_exposure,
)
from isochrome.scene import Frames

Array = NDArray[Any]
Mask = NDArray[np.bool_]

SAME_EXPOSURE = (
    "its fringes do not tell whether it is exposed as its no-load frames are, which is assumed: "
    "keep exposure, gain and lamp fixed"
)
EXPOSED = (
    "exposed {:.3g} times as long as frames.no_load_bright, or lit so much more: its fringes tell "
    "that, and it is used"
)
CREST_OR_RIDGE = (
    "its brightest line has {:.3g} of the light of frames.no_load_bright: a fringe of order 0.5 "
    "under other light, or an order that stays below it; no order is reported: give a known order "
    'beside that line, or frames.no_load_exposure = "same" if all are exposed alike'
)
NOT_ALIKE = (
    "its fringes do not tell whether it is exposed as its no-load frames are, and the known orders "
    "say that it is not: by the light the one at row {:g}, column {:g} would be {:.2f} from a dark "
    "fringe, not {:.2f}; no order is reported: expose all alike, or correct the known order"
)
DARK_UNTOLD = (
    "no dark fringe tells how frames.no_load_dark is exposed: {:.0f} % of the specimen, where a "
    "brighter background would make a dark fringe, is left out; expose it as the frame is"
)
_REACH, _WORTH_SAYING = 4.0, 0.01
"""How far the unknown background may reach, in its standard uncertainties: to three times as long
an exposure as the bright frame's; and the share of the specimen that is said."""
_POOLED_PX = 3.0
_AT_HALF, _BEYOND_HALF = 0.05, 0.1
"""Fringes from a half within which a known order says it, and from which two say one between."""


@dataclass(frozen=True)
class NoLoadLight:
    """The ends of a frame's light by its no-load frames.

    `notes`, what to say of them; `refusal`, why no order can be told from it, if any; `dark_told`,
    whether the dark end is known as well as it says.
    """

    ends: BackgroundModulation
    notes: tuple[str, ...] = ()
    refusal: str = ""
    dark_told: bool = True


def no_load_light(
    light: Array, sigma: Array, valid: Mask, no_load: tuple[Array, Array], frames: Frames
) -> NoLoadLight:
    """Find the ends of a frame's light.

    Parameters: `light` (rows, cols), linear, and its noise `sigma`; `valid`, True where trusted;
    `no_load`, the dark and the bright one (rows, cols); `frames`, what the scene says of them.
    """
    dark, bright = no_load
    alike = NoLoadLight(exact_ends(dark, bright))
    if frames.no_load_exposure == "same":
        return alike
    found = find_no_load_exposure(light, sigma, valid, dark=dark, bright=bright)
    if found.ends is None:
        if found.told:
            return alike
        off = _not_alike(_places(light, valid, no_load, frames))
        return NoLoadLight(alike.ends, () if off else (SAME_EXPOSURE,), off)
    if found.crest_sure or says_a_half(frames.stated_orders):
        said = (EXPOSED.format(found.bright),)
        return NoLoadLight(found.ends, said, dark_told=found.dark_told)
    if found.bright < 1.0 and _says_alike(light, valid, no_load, found, frames):
        return alike
    return NoLoadLight(found.ends, refusal=CREST_OR_RIDGE.format(found.bright))


def says_a_half(orders: Sequence[float]) -> bool:
    """Whether known orders say that N = 1/2, 3/2, ... is in the frame: by one, or between two.

    Parameters: `orders`, those that are known, fringes.
    """
    if any(abs(order % 1.0 - 0.5) < _AT_HALF for order in orders):
        return True
    least, most = min(orders, default=0.0), max(orders, default=0.0)
    next_half = np.ceil(least + _BEYOND_HALF - 0.5) + 0.5
    return bool(most > next_half + _BEYOND_HALF)


@dataclass(frozen=True)
class _Place:
    """A place of known order: its distance from a dark fringe, `stated`, and by the `light`."""

    row: float
    col: float
    stated: float
    light: float

    @property
    def cost(self) -> float:
        """How badly both agree, chi²."""
        return min(((self.light - self.stated) / STATED_SPREAD) ** 2, MOST_COST)


def _says_alike(
    light: Array, valid: Mask, no_load: tuple[Array, Array], found: NoLoadExposure, frames: Frames
) -> bool:
    """Whether known orders are clearly those of the no-load frames' own light."""
    dark, bright = no_load
    told = found.dark * dark, found.bright * bright
    own, other = (
        sum(place.cost for place in _places(light, valid, ends, frames)) for ends in (no_load, told)
    )
    return bool(own + CLEAR < other)


def _not_alike(places: Sequence[_Place]) -> str:
    """What to say where known orders are not those of the light; nothing where they may be."""
    if not places or np.median([place.cost for place in places]) < CLEAR:
        return ""
    worst = max(places, key=lambda place: abs(place.light - place.stated))
    return NOT_ALIKE.format(worst.row, worst.col, worst.light, worst.stated)


def _places(light: Array, valid: Mask, ends: tuple[Array, Array], frames: Frames) -> list[_Place]:
    """The known places that are seen: in a light s the order is k ± asin(sqrt s)/pi."""
    dark, bright = ends
    signal = np.where(valid, (light - dark) / np.maximum(bright - dark, 1e-6), 0.0)
    weight = np.maximum(gaussian_filter(valid.astype(float), _POOLED_PX), 1e-6)
    pooled = np.clip(gaussian_filter(signal, _POOLED_PX) / weight, 0.0, 1.0)
    own = np.arcsin(np.sqrt(pooled)) / np.pi
    known = [(float(k.row_px), float(k.col_px), k.order) for k in frames.known_order]
    known += [(*place, line.order) for line in frames.known_line for place in line.places]
    found = []
    for row, col, order in known:
        at = round(row), round(col)
        if all(0 <= i < n for i, n in zip(at, valid.shape, strict=True)) and valid[at]:
            found.append(_Place(row, col, abs(order - round(order)), float(own[at])))
    return found


def above_background(signal: Array, error: Array, valid: Mask) -> tuple[Mask, tuple[str, ...]]:
    """Where a brighter background would make no dark fringe, and what to say of the rest.

    The order may go on through a fringe there or turn back, and what lies beyond is a part apart.
    Parameters: `signal` and its standard uncertainty `error` by the ends (rows, cols); `valid`.
    """
    above = np.where(valid, signal - _REACH * error, 0.0)
    seen = valid & (gaussian_filter(above, _POOLED_PX) > 0.0)
    share = 1.0 - float(np.mean(seen[valid])) if valid.any() else 0.0
    said = (DARK_UNTOLD.format(100.0 * share),) if share > _WORTH_SAYING else ()
    return seen, said
