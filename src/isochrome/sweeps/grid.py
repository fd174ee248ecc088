"""The points of a sweep: which keys are varied, over which values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from isochrome.errors import InputError
from isochrome.scene import Scene

MAX_POINTS = 100_000
"""More points than this are a slip of the pen."""

Values = Sequence[float]


@dataclass(frozen=True)
class SweepGrid:
    """A scene, and the values of each key that is varied; the last key varies fastest."""

    scene: Scene
    values: Mapping[str, tuple[float, ...]]

    @property
    def counts(self) -> dict[str, int]:
        """Number of values of each key."""
        return {key: len(values) for key, values in self.values.items()}

    def point(self, index: int) -> dict[str, float]:
        """The values at a point, counted from 0."""
        place = np.unravel_index(index, tuple(self.counts.values()))
        return {key: own[int(k)] for (key, own), k in zip(self.values.items(), place, strict=True)}

    def scene_at(self, index: int) -> Scene:
        """The scene at a point. Raises InputError where it is none."""
        found = self.scene.with_values(self.point(index))
        return found.model_copy(update={"folder": self.scene.folder, "name": self.scene.name})


def make_grid(scene: Scene, vary: Sequence[str] | Mapping[str, Values]) -> SweepGrid:
    """The grid of a sweep, each point's scene checked.

    Parameters: `scene`; `vary`, for each key 'KEY=first:last:number' (evenly from first to last,
    both included) or 'KEY=value,value,...', or a mapping of keys to values. Returns a SweepGrid.
    Raises InputError where a key or a value is wrong, before anything is computed.
    """
    values: dict[str, tuple[float, ...]] = {}
    for text in vary:
        key, own = _parsed(text) if not isinstance(vary, Mapping) else (text, vary[text])
        if key in values:
            raise InputError(f"--vary {key}: is given twice; give all its values at once")
        values[key] = tuple(float(v) for v in own)
        if len(set(values[key])) < len(values[key]) or not values[key]:
            raise InputError(
                f"--vary {key}: needs values, each once, not {list(values[key])}; a comma parts "
                "values, and a number has a point"
            )
    if not values:
        raise InputError("a sweep varies something: give --vary, such as load.normal_n=20:60:5")
    count = math.prod(len(own) for own in values.values())
    if count > MAX_POINTS:
        raise InputError(f"--vary: makes {count} points, and {MAX_POINTS} are allowed; take fewer")
    grid = SweepGrid(scene, {key: _whole(scene, key, own) for key, own in values.items()})
    for index in range(count):
        grid.scene_at(index)
    return grid


def _parsed(text: str) -> tuple[str, list[float]]:
    key, equals, rest = text.partition("=")
    try:
        if ":" in rest:
            first, last, number = rest.split(":")
            if int(number) < 2:
                raise ValueError
            found: list[Any] = np.linspace(float(first), float(last), int(number)).tolist()
        else:
            found = [float(v) for v in rest.split(",")]
        if not equals or not key or not np.isfinite(found).all():
            raise ValueError
    except ValueError:
        comma = "with points in its numbers, not commas, " if "," in rest and ":" in rest else ""
        raise InputError(
            f"--vary {text}: give KEY=first:last:number, {comma}two or more of them, or "
            "KEY=value,value,..., such as load.normal_n=20:60:5"
        ) from None
    return key.strip(), found


def _whole(scene: Scene, key: str, values: tuple[float, ...]) -> tuple[float, ...]:
    """Whole numbers for a key that the scene has as one: a seed, a number of pixels."""
    now = scene.get(key)
    if isinstance(now, int) and not isinstance(now, bool) and all(v.is_integer() for v in values):
        return tuple(int(v) for v in values)
    return values
