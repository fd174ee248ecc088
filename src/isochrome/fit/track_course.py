"""The scenes that tracked values stand for: what a frame shows now, on what was worn before."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import elastic_constants, wear_rate
from isochrome.errors import InputError
from isochrome.fit.history import local_values
from isochrome.fit.one_state import scene_at
from isochrome.fit.sequence import COURSE, FRICTION, WEAR
from isochrome.scene import Scene

Array = NDArray[Any]

LOAD, LEFT, TOP = COURSE[0], "camera.left_mm", "camera.top_mm"
WORN = "worn area (mm²)"
"""The axis that stands for all the wear until a frame."""

TRACKED = (LOAD, "load.tangential_n", "load.bulk_mpa", FRICTION, WEAR, LEFT, TOP)
"""Keys that can be tracked: what the mechanics follow smoothly, and the place."""

_SUDDEN = 1e-6
_BESIDE = 1e-5
"""A history's load and friction differ from a frame's by this at least: they are then always
solved as two, and the field has no jump where they would meet."""

_NO_WEAR = 1e-9
"""Worn area, over what the elasticity takes up, that is none: below any rounding of a gap."""

_BOX = {FRICTION: 0.05, "load.bulk_mpa": 0.3}
_OF_LOAD, _OF_WEAR, _PLACE_PX, _BEHIND = 0.06, 0.1, 2.0, 0.3


class TrackCourse:
    """One-state scenes of a contact along a run, by the values of `axes`.

    Attributes: `axes`, what moves the field: the tracked keys (of the wear, the worn area), then
    what the scene knows to change; `count`, how many of them are tracked.
    """

    def __init__(self, scene: Scene, keys: tuple[str, ...]) -> None:
        """`scene`, placed in its picture. Raises InputError for what cannot be tracked."""
        _refuse(scene, keys)
        self.scene, self.keys, self.count = scene, keys, len(keys)
        axes = [WORN if key == WEAR else key for key in keys]
        self._base = scene if scene.wear else scene_at(scene, 0.0)
        if scene.wear is not None:
            axes += [key for key in (LOAD, FRICTION) if key not in keys and _table(scene, key)]
            axes += [] if WEAR in keys else [WORN]
        self.axes = tuple(axes)
        self._worn, self._slid, self._last = 0.0, 0.0, (0.0, 0.0)
        self._mean = np.zeros(2)
        self._begun = False

    def start(self, distance_m: float | None) -> Array:
        """The scene's own values (axes,) at a distance (m), and so its history's."""
        self._slid = distance_m or 0.0
        self._mean = np.array([self._own(key, distance_m) for key in (LOAD, FRICTION)])
        return np.array([self._own(axis, distance_m) for axis in self.axes])

    def carried(self, values: Array, distance_m: float | None) -> Array:
        """The last frame's tracked values with what is known of the next frame's distance (m)."""
        found = values.copy()
        for j in range(self.count, len(self.axes)):
            if self.axes[j] != WORN:
                found[j] = self._own(self.axes[j], distance_m)
        if WORN in self.axes[self.count :]:
            found[-1] = self._worn_at(found, distance_m or 0.0)
        return found

    def passed(self, values: Array, distance_m: float | None) -> None:
        """Take a frame's values into the history of those that follow."""
        if self.scene.wear is None:
            return
        s = distance_m or 0.0
        drive = np.array([self._value(LOAD, values, s), self._value(FRICTION, values, s)])
        if not self._begun or s <= 0.0:
            self._mean = drive
        else:
            share = max(0.0, s - self._slid) / s
            self._mean = (1.0 - share) * self._mean + share * drive
        self._worn, self._slid, self._begun = self._value(WORN, values, s), s, True
        self._last = (float(drive[0]), self._rate(drive[1], s))

    def reported(self, distance_m: float | None) -> Array:
        """Factors (tracked,) from the axes to the keys: a worn area to the wear coefficient."""
        factors = np.ones(self.count)
        if WEAR in self.keys:
            dose = self._line_load(float(self._mean[0])) * 1e3 * (distance_m or 0.0)
            factors[self.keys.index(WEAR)] = 1.0 / dose if dose > 0.0 else np.nan
        return factors

    def moved(self, values: Array, step: Array) -> Array:
        """Values (axes,) after a step (count,) of the tracked ones; no worn area below zero."""
        found = values.copy()
        found[: self.count] += step
        if WORN in self.axes:
            at = self.axes.index(WORN)
            found[at] = max(0.0, found[at])
        return found

    def field_scene(self, values: Array) -> Scene:
        """The scene of some values (axes,): its load and friction on a scar of the history's."""
        given = dict(zip(self.axes, values.tolist(), strict=True))
        worn = given.pop(WORN, None)
        if worn is None:
            return self._base.with_values(given)
        now = [self._value(key, values, self._slid) for key in (LOAD, FRICTION)]
        if worn <= _NO_WEAR * self._elastic_area(now[0]):
            return self._without_wear(given, now)
        before = [float(v) * (1.0 + _BESIDE) for v in self._mean]
        for key, old, new in zip((LOAD, FRICTION), before, now, strict=True):
            if key == LOAD or self.scene.friction:
                given[key] = {"distance_m": [0.0, 1.5, 2.0], "value": [old, old, new]}
        scene = self._worn_scene(given, worn, before[0], 2.0)
        even = scene.get(WEAR)  # nothing wears while load and friction change to the frame's own
        stops = {"distance_m": [0.0, 1.0, 1.0 + _SUDDEN, 2.0], "value": [even, even, 0.0, 0.0]}
        return scene.with_values({WEAR: stops})

    def even_scene(self, values: Array) -> Scene:
        """As `field_scene`, as if all had been worn under the frame's own load: all numbers."""
        given = dict(zip(self.axes, values.tolist(), strict=True))
        worn = given.pop(WORN, None)
        if worn is None:
            return self._base.with_values(given)
        now = [self._value(key, values, self._slid) for key in (LOAD, FRICTION)]
        if worn <= _NO_WEAR * self._elastic_area(now[0]):
            return self._without_wear(given, now)
        given[LOAD] = now[0]
        if self.scene.friction:
            given[FRICTION] = now[1]
        return self._worn_scene(given, worn, now[0], 1.0)

    def from_even(self, scene: Scene, values: Array) -> Array:
        """The values (axes,) of a fitted `even_scene`; what it does not hold is taken over."""
        found = values.copy()
        for j, axis in enumerate(self.axes):
            if axis != WORN:
                found[j] = scene.get(axis)
            elif scene.wear is not None:
                found[j] = 1e3 * scene.get(WEAR) * self._line_load(scene.load_at(1.0))
        return found

    def box(self, values: Array, size: float) -> tuple[Array, Array, tuple[int, ...]]:
        """Low and high ends (axes,) of a box of values, and the degrees of its polynomial.

        `size`, of the box, over the usual one.
        """
        assert self.scene.camera is not None and self.scene.camera.pixel_mm is not None
        load = self._value(LOAD, values, self._slid)
        low, high, degrees = values.copy(), values.copy(), []
        for j, axis in enumerate(self.axes):
            place = axis in (LEFT, TOP)
            degrees.append(2 if place or axis == "load.bulk_mpa" else 4)
            if axis == WORN:
                half = size * _OF_WEAR * (values[j] + self._elastic_area(load))
                low[j] = max(0.0, values[j] - _BEHIND * half)
                high[j] = low[j] + 2.0 * half  # a scar only grows
                continue
            pixels = _PLACE_PX * self.scene.camera.pixel_mm
            half = size * (pixels if place else _BOX.get(axis, _OF_LOAD * load))
            low[j], high[j] = values[j] - half, values[j] + half
        return low, high, tuple(degrees)

    def _elastic_area(self, load: float) -> float:
        """Area that the indenter would cut off were it not for the elasticity, P' a / E* (mm²)."""
        modulus, _ = elastic_constants(self.scene)
        indenter = self.scene.indenter
        assert indenter is not None
        line = self._line_load(load)
        width = indenter.half_width_mm
        if width is None:
            width = 2.0 * np.sqrt(line * (indenter.radius_mm or 1.0) / (np.pi * modulus))
        return float(line * width / modulus)

    def _line_load(self, load: float) -> float:
        assert self.scene.specimen.thickness_mm is not None
        return load / self.scene.specimen.thickness_mm

    def _value(self, axis: str, values: Array, distance_m: float) -> float:
        if axis in self.axes:
            return float(values[self.axes.index(axis)])
        return self._own(axis, distance_m)

    def _own(self, axis: str, distance_m: float | None) -> float:
        """The scene's own value of an axis at a distance."""
        s = distance_m or 0.0
        if axis == WORN:
            return float(local_values(self.scene, (s,))[0, 2])
        if axis == LOAD:
            return self.scene.load_at(s)
        if axis == FRICTION:
            return float(self.scene.friction_at(s)) if self.scene.friction else 0.0
        return float(self.scene.get(axis))

    def _rate(self, friction: float, s: float) -> float:
        assert self.scene.wear is not None
        k = float(self.scene.wear_coefficient_at(s))
        return 1e3 * float(wear_rate(self.scene.wear.law, k, friction))

    def _worn_at(self, values: Array, s: float) -> float:
        """Worn area at a distance, by the loads and frictions that were tracked."""
        if not self._begun:
            return self._own(WORN, s)
        load, friction = (self._value(key, values, s) for key in (LOAD, FRICTION))
        old = self._line_load(self._last[0]) * self._last[1]
        new = self._line_load(load) * self._rate(friction, s)
        return self._worn + 0.5 * (old + new) * max(0.0, s - self._slid)

    def _without_wear(self, given: dict[str, Any], now: list[float]) -> Scene:
        scene = self.scene.model_copy(update={"wear": None})
        given[LOAD] = now[0]
        if scene.friction:
            given[FRICTION] = now[1]
        return scene.with_values(given)

    def _worn_scene(self, given: dict[str, Any], worn: float, load: float, s: float) -> Scene:
        given[WEAR] = worn / (1e3 * self._line_load(load))
        given["wear.law"], given["wear.distances_m"] = "archard", [s]
        return self.scene.with_values(given)


def _table(scene: Scene, key: str) -> bool:
    return not isinstance(scene.get(key), int | float) if _has(scene, key) else False


def _has(scene: Scene, key: str) -> bool:
    return key == LOAD or scene.friction is not None


def _refuse(scene: Scene, keys: tuple[str, ...]) -> None:
    if scene.model != "contact":
        raise InputError(f"a {scene.model} cannot be tracked, only contacts can; leave --track out")
    for key in keys:
        if key not in TRACKED:
            raise InputError(
                f"{key} cannot be tracked; of a video's frames {', '.join(TRACKED)} can: fit {key} "
                "on a few frames first, put it into the scene, and leave it out"
            )
    if scene.friction and scene.friction.static_state_first:
        raise InputError(
            "friction.static_state_first = true: tracked frames are all of one kind; set it to "
            "false for a video that slides"
        )
