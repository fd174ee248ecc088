"""The scenes that tracked values stand for: what a frame shows now, on what was worn before."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import (
    SurfaceState,
    contact_states,
    elastic_constants,
    state_on_scar,
    wear_rate,
)
from isochrome.errors import InputError
from isochrome.fit.history import local_values
from isochrome.fit.one_state import scene_at
from isochrome.fit.sequence import COURSE, FRICTION, WEAR
from isochrome.scene import Numerics, Scene
from isochrome.simulate import SceneState, scene_states

Array = NDArray[Any]
Point = tuple[float, float, float]
"""Dose (mm/MPa), load (N) and friction of a frame that has passed."""

LOAD, LEFT, TOP = COURSE[0], "camera.left_mm", "camera.top_mm"
WORN = "worn area (mm²)"
"""The axis that stands for all the wear until a frame."""

TRACKED = (LOAD, "load.tangential_n", "load.bulk_mpa", FRICTION, WEAR, LEFT, TOP)
"""Keys that can be tracked: what the mechanics follow smoothly, and the place."""

_PAST, _CLOSE = 24, 1e-3
"""Points of the history that are kept; share of the dose that two of them are apart at least."""
_NO_WEAR = 1e-9
"""Worn area, over what the elasticity takes up, that is none: below any rounding of a gap."""

_BOX = {FRICTION: 0.05, "load.bulk_mpa": 0.3}
_OF_LOAD, _OF_WEAR, _PLACE_PX, _BEHIND = 0.06, 0.1, 2.0, 0.3


class TrackCourse:
    """One-state scenes of a contact along a run, by the values of `axes`.

    Attributes: `axes`, what moves the field: the tracked keys (of the wear, the worn area), then
    what the scene knows to change; `count`, how many of them are tracked; `places`, those that only
    move the contact in the picture.
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
        self.places = tuple(j for j, axis in enumerate(axes) if axis in (LEFT, TOP))
        self._past: list[Point] = []
        self._worn, self._slid, self._dose, self._area = 0.0, 0.0, 0.0, 0.0
        self._last = (0.0, 0.0)

    def start(self, distance_m: float | None) -> Array:
        """The scene's own values (axes,) at a distance (m), and so its history's."""
        s = distance_m or 0.0
        self._slid, self._last = s, (self._own(LOAD, s), self._own(FRICTION, s))
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
        load, friction = (self._value(key, values, s) for key in (LOAD, FRICTION))
        dose, area = self._step(load, friction, s)
        self._dose, self._area = self._dose + dose, self._area + area
        self._worn, self._slid = self._value(WORN, values, s), s
        self._last = (load, friction)
        self._past.append((self._dose, load, friction))
        if len(self._past) > _PAST:
            # neighbours become their mean, the last one stays: it is where the next begins
            *rest, last = self._past
            pairs = zip(rest[::2], rest[1::2], strict=False)
            self._past = [_middle(one, other) for one, other in pairs] + [last]

    def reported(self) -> Array:
        """Factors (tracked,) from the last frame's axes to the keys: area to wear coefficient."""
        factors = np.ones(self.count)
        if WEAR in self.keys:
            k = float(self.scene.wear_coefficient_at(self._slid))
            factors[self.keys.index(WEAR)] = k / self._area if self._area > 0.0 else np.nan
        return factors

    def _step(self, load: float, friction: float, s: float) -> tuple[float, float]:
        """Dose (mm/MPa) and area (mm²) worn since the last frame, by the scene's law."""
        if not self._past:
            area = self._own(WORN, s)
            return area / self._line_load(load), area
        ends = ((*self._last, self._slid), (load, friction, s))
        rates = np.array([self._rate(mu, at) for _, mu, at in ends])
        lines = np.array([self._line_load(p) for p, _, _ in ends])
        slid = max(0.0, s - self._slid)
        return float(rates.mean() * slid), float((rates * lines).mean() * slid)

    def _history(self, worn: float) -> Scene:
        """The run that has worn an area (mm²): what was tracked, and the last drive beyond it.

        Its distance is the share of the dose, so that Archard's law stands for any.
        """
        past = [row for row in self._past if row[0] > 0.0] or [(1.0, *self._last)]
        dose, load, friction = (np.array([0.0, *column]) for column in zip(*past, strict=True))
        load[0], friction[0] = load[1], friction[1]
        area = np.cumsum(np.diff(dose, prepend=0.0) * self._line_load(1.0) * _between(load))
        if self._worn > 0.0:
            scale = self._worn / area[-1]
            dose, area = dose * scale, area * scale
        if worn > area[-1]:
            dose[-1] += (worn - area[-1]) / self._line_load(load[-1])
        else:
            last = int(np.searchsorted(area, worn))
            dose, load, friction = dose[: last + 1], load[: last + 1], friction[: last + 1]
            dose[-1] -= (area[last] - worn) / self._line_load(load[-1])
        apart = np.diff(dose, append=np.inf) > _CLOSE * dose[-1]
        share = (dose / dose[-1])[apart].tolist()
        given: dict[str, Any] = {LOAD: {"distance_m": share, "value": load[apart].tolist()}}
        if self.scene.friction:
            given[FRICTION] = {"distance_m": share, "value": friction[apart].tolist()}
        return self.scene.with_values(given | _archard(1e-3 * dose[-1], 1.0))

    def solver(self, numerics: Numerics) -> Callable[[Scene], SceneState]:
        """What solves a scene of `field_scene`: its own load and friction on the history's scar."""
        scars: dict[float, SurfaceState] = {}

        def solve(scene: Scene) -> SceneState:
            if scene.wear is None:
                return scene_states(scene)[-1]
            worn = 1e3 * scene.get(WEAR) * self._line_load(scene.load_at(1.0))
            key = float(f"{worn:.9g}")
            if key not in scars:
                history = self._history(worn).model_copy(update={"numerics": numerics})
                scars[key] = contact_states(history)[-1]
            scar = scars[key]
            surface = state_on_scar(scene, scar.grid, scar.wear_depth_mm)
            return SceneState("", surface.distance_m, surface)

        return solve

    def moved(self, values: Array, step: Array) -> Array:
        """Values (axes,) after a step (count,) of the tracked ones; no worn area below zero."""
        found = values.copy()
        found[: self.count] += step
        if WORN in self.axes:
            at = self.axes.index(WORN)
            found[at] = max(0.0, found[at])
        return found

    def field_scene(self, values: Array) -> Scene:
        """The one-state scene of some values (axes,), worn as if under its own load all the time.

        `solver` puts it on the scar of its history.
        """
        given = dict(zip(self.axes, values.tolist(), strict=True))
        worn = given.pop(WORN, None)
        if worn is None:
            return self._base.with_values(given)
        load, friction = (self._value(key, values, self._slid) for key in (LOAD, FRICTION))
        given[LOAD] = load
        if self.scene.friction:
            given[FRICTION] = friction
        if worn <= _NO_WEAR * self._elastic_area(load):
            return self.scene.model_copy(update={"wear": None}).with_values(given)
        return self.scene.with_values(given | _archard(worn / (1e3 * self._line_load(load)), 1.0))

    def from_scene(self, scene: Scene, values: Array) -> Array:
        """The values (axes,) of a fitted `field_scene`; what it does not hold is taken over."""
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
            degrees.append(2 if axis == "load.bulk_mpa" else 4)
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
        load, friction = (self._value(key, values, s) for key in (LOAD, FRICTION))
        return self._worn + self._step(load, friction, s)[1]


def _between(values: Array) -> Array:
    """Means of neighbours (m,), the first with itself."""
    return np.asarray(0.5 * (values + np.concatenate((values[:1], values[:-1]))))


def _middle(one: Point, other: Point) -> Point:
    dose, load, friction = (0.5 * (a + b) for a, b in zip(one, other, strict=True))
    return dose, load, friction


def _archard(coefficient: Any, distance_m: float) -> dict[str, Any]:
    """Wear by Archard's law with a coefficient over what stands for the distance."""
    return {WEAR: coefficient, "wear.law": "archard", "wear.distances_m": [distance_m]}


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
