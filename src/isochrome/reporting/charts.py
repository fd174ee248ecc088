"""Values over distance or frames as drawings in the page, with their bands, however many."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.figures import BAND, KEY_LABELS, frame_axis
from isochrome.output import FrameValues

Array = NDArray[Any]

MOST_POINTS = 240
"""Points of a curve: more than a drawing has pixels to tell them apart."""

WIDTH, HEIGHT = 400.0, 230.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 68.0, 10.0, 10.0, 40.0
"""Of a drawing and around its axes, in its own units: pixels where a telephone shows it."""

_TICKS = 5


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A quantity over distance or frames; each point (n,) is some neighbours together where there
    are many.
    """

    label: str  # name and unit of the quantity
    across: str  # name and unit of the horizontal axis
    place: Array
    value: Array  # their mean
    least: Array  # envelope of the values
    most: Array
    low: Array  # envelope of the bands
    high: Array
    together: int  # how many values are one point, at most
    has_band: bool  # the values have uncertainties

    def drawing(self) -> dict[str, Any]:
        """What the page draws: outlines, ticks and points in the drawing's own units."""
        x = _Scale(self.place, _LEFT, WIDTH - _RIGHT)
        y = _Scale(np.concatenate([self.low, self.high]), HEIGHT - _BOTTOM, _TOP)
        return {
            "label": self.label,
            "across": self.across,
            "together": self.together,
            "has_band": self.has_band,
            "band": _outline(x, y, self.place, self.low, self.high),
            "envelope": _outline(x, y, self.place, self.least, self.most),
            "line": _points(x, y, self.place, self.value),
            "dots": list(zip(x(self.place), y(self.value), strict=True))
            if len(self.place) <= MOST_POINTS // 6
            else [],
            "x_ticks": list(x.ticks()),
            "y_ticks": list(y.ticks()),
            "rows": list(zip(*map(_texts, self._columns()), strict=True)),
        }

    def _columns(self) -> tuple[Array, ...]:
        return self.place, self.value, self.least, self.most, self.low, self.high


def curves_of(found: FrameValues) -> list[Curve]:
    """The curves of fitted values, each with its band, and one of chi.

    One for each key that is known in two frames at least; a tracked video's places too.
    """
    place, across = frame_axis(found)
    place = np.where(np.isfinite(place), place, 0.0)  # what stands still has slid by nothing
    columns: list[tuple[str, Array, Array | None]] = [
        (KEY_LABELS.get(key, key), found.values[:, j], found.standard_uncertainty[:, j])
        for j, key in enumerate(found.keys)
    ]
    columns.append(("chi (residual over noise)", found.chi, None))
    return [
        make_curve(label, across, place, values, own)
        for label, values, own in columns
        if np.isfinite(values).sum() > 1
    ]


def make_curve(
    label: str, across: str, place: Array, values: Array, spread: Array | None = None
) -> Curve:
    """A quantity's curve: what is not known is left out, and many are put together.

    At least one value is known; `spread` is their standard uncertainties, None: they have none.
    """
    own = np.zeros(len(values)) if spread is None else spread
    known = np.flatnonzero(np.isfinite(values))
    known = known[np.argsort(place[known], kind="stable")]
    half = BAND * np.where(np.isfinite(own), own, 0.0)
    together = -(-len(known) // MOST_POINTS)
    starts = np.arange(0, len(known), together)
    counts = np.diff([*starts, len(known)])
    return Curve(
        label=label,
        across=across,
        place=np.add.reduceat(place[known], starts) / counts,
        value=np.add.reduceat(values[known], starts) / counts,
        least=np.minimum.reduceat(values[known], starts),
        most=np.maximum.reduceat(values[known], starts),
        low=np.minimum.reduceat((values - half)[known], starts),
        high=np.maximum.reduceat((values + half)[known], starts),
        together=together,
        has_band=spread is not None,
    )


class _Scale:
    """From values to places in a drawing."""

    def __init__(self, values: Array, start: float, end: float) -> None:
        self.low, self.high = float(values.min()), float(values.max())
        least = 1e-9 * max(abs(self.low), abs(self.high), 1e-30)
        if self.high - self.low < least:  # a constant
            middle, half = 0.5 * (self.low + self.high), 0.5 * (abs(self.high) or 1.0)
            self.low, self.high = middle - half, middle + half
        self.start, self.end = start, end

    def __call__(self, values: Array) -> list[float]:
        share = (values - self.low) / (self.high - self.low)
        return [round(float(v), 2) for v in self.start + share * (self.end - self.start)]

    def ticks(self) -> Iterator[tuple[float, str]]:
        """Places and texts of round values: steps of 1, 2 or 5 times a power of ten."""
        span = self.high - self.low
        rough = span / _TICKS
        power = 10.0 ** math.floor(math.log10(rough))
        step = power * next(m for m in (1, 2, 5, 10) if m * power >= rough * (1 - 1e-9))
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        decimals = max(0, -_exponent(step))
        small = max(abs(self.low), abs(self.high)) < 1e-3 or decimals > 6
        for k in range(first, last + 1):
            value = k * step + 0.0
            digits = max(0, _exponent(value) - _exponent(step)) if value else 0
            form = f".{digits}e" if small and value else f".{0 if small else decimals}f"
            text = f"{value:{form}}"
            yield self(np.array([value]))[0], text


def _exponent(value: float) -> int:
    """Power of ten of a value's first digit."""
    return math.floor(math.log10(abs(value)) + 1e-9)


def _points(x: _Scale, y: _Scale, place: Array, values: Array) -> str:
    return " ".join(f"{a:g},{b:g}" for a, b in zip(x(place), y(values), strict=True))


def _outline(x: _Scale, y: _Scale, place: Array, low: Array, high: Array) -> str:
    """The polygon between two curves."""
    return f"{_points(x, y, place, high)} {_points(x, y, place[::-1], low[::-1])}"


def _texts(values: Array) -> list[str]:
    return [f"{value:.6g}" for value in values]
