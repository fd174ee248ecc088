"""The scenes that tracked values stand for: what a frame shows now, on what was worn before."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from isochrome.contact import elastic_constants, wear_rate
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.single_state import scene_at
from isochrome.fitting.frame.unknowns import FRICTION, LEFT, LOAD, TOP, WEAR
from isochrome.fitting.frame_set import refuse_untracked
from isochrome.fitting.joint.frame_sequence import local_values
from isochrome.fitting.tracking.field_polynomial import CHECKED
from isochrome.fitting.tracking.scar_growth import TrackPast
from isochrome.fitting.tracking.scar_steps import Drive
from isochrome.scene import DistanceTable, Numerics, Scene
from isochrome.simulation import SceneState, scene_states

WORN = "worn area (mm²)"
"""The axis that stands for all the wear until a frame."""

TRACKED = (LOAD, "load.tangential_n", "load.bulk_mpa", FRICTION, WEAR, LEFT, TOP)
"""Keys that can be tracked: what the mechanics follow smoothly, and the place."""

_PLACES = (-1.0, -CHECKED, 0.0, CHECKED, 1.0)
"""Where along the worn area a polynomial is made and checked, in half-widths."""
_NO_WEAR = 1e-9
"""Worn area, over what the elasticity takes up, that is none: below any rounding of a gap."""

_BOX = {FRICTION: 0.05, "load.bulk_mpa": 0.3}
_OF_LOAD, _OF_WEAR, _PLACE_PX, _BEHIND, _ROUNDING = 0.12, 0.1, 1.5, 0.2, 0.02
"""Half-widths of a box, over its size: loads swing and scars grow more than a camera moves, and a
polynomial errs most by the place."""


class TrackCourse:
    """One-state scenes of a contact along a run, by the values of `axes`.

    Attributes: `axes`, what moves the field: the tracked keys (of the wear, the worn area), then
    what the scene knows to change; `count`, how many of them are tracked; `places`, those that only
    move the contact in the picture; `numerics`, of the grid in use, None before there is one;
    `past_load_n`, the load before the first frame, None for that frame's own.
    """

    def __init__(self, scene: Scene, keys: tuple[str, ...]) -> None:
        """`scene`, placed in its picture. Raises InputError for what cannot be tracked."""
        refuse_untracked(scene, keys, TRACKED)
        self.scene, self.keys, self.count = scene, keys, len(keys)
        axes = [WORN if key == WEAR else key for key in keys]
        self._base = scene if scene.wear else scene_at(scene, 0.0)
        if scene.wear is not None:
            axes += [key for key in (LOAD, FRICTION) if key not in keys and _table(scene, key)]
            axes += [] if WEAR in keys else [WORN]
        self.axes = tuple(axes)
        self._at = axes.index(WORN) if WORN in axes else -1
        self.places = tuple(j for j, axis in enumerate(axes) if axis in (LEFT, TOP))
        self._past = TrackPast()
        self._worn, self._area, self._slid, self._now = 0.0, 0.0, 0.0, 0.0
        self._moment = 0.0
        self._last: tuple[float, float] | None = None
        self.numerics: Numerics | None = None
        self.past_load_n: float | None = None

    @property
    def unsure(self) -> bool:
        """Whether another load may have worn the contact before the first frame than that one's."""
        worn = self.scene.wear is not None and self._now > 0.0 and self._last is None
        return worn and LOAD in self.keys and not _table(self.scene, LOAD)

    def _begin(self, values: Array) -> None:
        """Tell the history what wore the contact before its first frame, of some values (axes,)."""
        if self._last is None:
            friction = self._value(FRICTION, values, self._now)
            drive = _drive_before(self.scene, self._now, self.load_before(values), friction)
            # worn by the load that it was, up to what it is in this frame: no ramp to its own
            area, law = self._area_at(values), drive.worn_mm2[-1]
            worn = np.minimum(drive.worn_mm2 * (area / law if law > 0.0 else 1.0), area)
            self._past.begin(replace(drive, worn_mm2=worn))

    def state(self) -> dict[str, Any]:
        """The history up to the last frame, as plain numbers for `resume`."""
        grid = None if self.numerics is None else self.numerics.model_dump()
        course = [self._worn, self._area, self._slid, self._now, self._moment]
        return {"course": course, "last": self._last, "grid": grid, "past": self._past.state()}

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from a `state`."""
        self._worn, self._area, self._slid, self._now, self._moment = state["course"]
        last, grid = state["last"], state["grid"]
        self._last = None if last is None else (last[0], last[1])
        self.numerics = None if grid is None else Numerics(**grid)
        self._past.resume(state["past"])

    def start(self, distance_m: float | None) -> Array:
        """The scene's own values (axes,) at a distance (m), and so its history's."""
        self._now = distance_m or 0.0
        return np.array([self._own(axis, distance_m) for axis in self.axes])

    def with_past(self, values: Array, past_n: float) -> Array:
        """The values (axes,) of a first frame if another load (N) wore it than the one so far."""
        result = self.moved(values, np.zeros(self.count))
        if WORN in self.axes:
            result[self._at] *= past_n / self.load_before(values)
        return result

    def carried(self, values: Array, distance_m: float | None) -> Array:
        """The last frame's tracked values with what is known of the next frame's distance (m)."""
        self._now = distance_m or 0.0
        result = values.copy()
        for j in range(self.count, len(self.axes)):
            if self.axes[j] != WORN:
                result[j] = self._own(self.axes[j], distance_m)
        if WORN in self.axes:
            area = self._area_at(result)
            # before anything has worn, the scene's own coefficient is where to start
            result[self._at] = area * (self._worn / self._area if self._area > 0.0 else 1.0)
        return self.moved(result, np.zeros(self.count))

    def passed(self, values: Array, distance_m: float | None) -> None:
        """Take a frame's values into the history of those that follow."""
        if self.scene.wear is None:
            return
        s = distance_m or 0.0
        load, friction = (self._value(key, values, s) for key in (LOAD, FRICTION))
        self._begin(values)
        self._area, self._moment = self.mark(values)
        self._past.passed(self._area, self._line_load(load), friction)
        self._worn, self._slid = self._value(WORN, values, s), s
        self._last = (load, friction)

    def load_before(self, values: Array) -> float:
        """The load (N) that wore the contact before its first frame, of some values (axes,)."""
        own = self._value(LOAD, values, self._now)
        return own if self.past_load_n is None else self.past_load_n

    def reported(self) -> Array:
        """Factors (tracked,) from the last frame's axes to the keys: area to wear coefficient."""
        factors = np.ones(self.count)
        if WEAR in self.keys:
            k = float(self.scene.wear_coefficient_at(self._slid))
            factors[self.keys.index(WEAR)] = k / self._area if self._area > 0.0 else np.nan
        return factors

    def _area_at(self, values: Array) -> float:
        """Area (mm²) worn by the scene's law until now, by the loads and frictions so far."""
        load, friction = (self._value(key, values, self._now) for key in (LOAD, FRICTION))
        if self._last is None:
            area, own = self._own(WORN, self._now), self._own(LOAD, self._now)
            return area if _table(self.scene, LOAD) else area * self.load_before(values) / own
        ends = ((*self._last, self._slid), (load, friction, self._now))
        rates = [self._rate(mu, at) * self._line_load(p) for p, mu, at in ends]
        return self._area + max(0.0, self._now - self._slid) * 0.5 * sum(rates)

    def grown(self, values: Array, others: Array) -> tuple[float, float]:
        """Growth of the scar since other values (axes,) and since the last frame.

        Over what is worn and elastic; 0 where nothing wears.
        """
        if WORN not in self.axes:
            return 0.0, 0.0
        worn = values[self._at]
        whole = worn + self._elastic_area(self._value(LOAD, values, self._now))
        return abs(worn - others[self._at]) / whole, abs(worn - self._worn) / whole

    def use(self, scene: Scene) -> None:
        """Solve on the grid of the widest scene so far, with its own numerics, from now on."""
        self.numerics = scene.numerics
        if self.scene.wear is not None:
            self._past.use(scene)

    def wear(self, values: Array, low: Array, high: Array) -> None:
        """Wear the scars of a box for `solve`, or, where its ends are the values, theirs alone.

        Parameters: `values` (axes,) of the frame in hand; `low`, `high` (axes,), the box's ends.
        """
        if self.scene.wear is None:
            return
        area = self._area_at(values)
        load, friction = (self._value(key, values, self._now) for key in (LOAD, FRICTION))
        self._begin(values)
        at = self._at
        middle, half = 0.5 * (low[at] + high[at]), 0.5 * (high[at] - low[at])
        self._past.wear(
            sorted({float(middle + t * half) for t in _PLACES}),
            (area, self._line_load(load), friction),
            scale=float(values[at] / area) if area > 0.0 else 1.0,
            elastic_mm2=self._elastic_area(load),
        )

    def mark(self, values: Array) -> tuple[float, float]:
        """Area A (mm²) worn by the scene's law until now, and ∫P' dA since the first frame."""
        if self.scene.wear is None:
            return 0.0, 0.0
        area = self._area_at(values)
        if self._last is None:
            return area, 0.0
        line = self._line_load(self._last[0] + self._value(LOAD, values, self._now))
        return area, self._moment + 0.5 * line * (area - self._area)

    def lean(self, share: float, values: Array) -> tuple[float, float]:
        """See `TrackPast.lean`."""
        return self._past.lean(share, self._elastic_area(self._value(LOAD, values, self._now)))

    def solve(self, scene: Scene) -> SceneState:
        """The contact of a `field_scene` on the scar that its history has worn."""
        return scene_states(scene)[-1] if self.scene.wear is None else self._past.solve(scene)

    def whole_state(self, values: Array) -> tuple[Scene, SceneState]:
        """The scene of the values (axes,) of the last frame that `passed`, and its contact.

        The history stays as it is. Raises PhysicsError where the contact cannot be solved.
        """
        scene = self.field_scene(values).model_copy(update={"numerics": self.numerics})
        with self._past.as_it_is():
            self.wear(values, values, values)
            # on nodes that divide the pixels where the track began
            return scene, self.solve(scene.model_copy(update={"camera": self.scene.camera}))

    def moved(self, values: Array, step: Array) -> Array:
        """Values (axes,) after a step (count,) of the tracked ones; no worn area below zero.

        A worn area that is not tracked is what the frame's load and friction wear until it.
        """
        result = values.copy()
        result[: self.count] += step
        if WORN in self.axes:
            worn = result[self._at]
            result[self._at] = max(0.0, worn) if self._at < self.count else self._area_at(result)
        return result

    def field_scene(self, values: Array) -> Scene:
        """The one-state scene of some values (axes,), worn as if under its own load all the time.

        `solve` puts it on the scar of its history.
        """
        given = dict(zip(self.axes, values.tolist(), strict=True))
        worn = given.pop(WORN, None)
        if worn is None:
            return self._base.with_values(given)
        load, friction = (self._value(key, values, self._now) for key in (LOAD, FRICTION))
        given[LOAD] = load
        if self.scene.friction:
            given[FRICTION] = friction
        if worn <= _NO_WEAR * self._elastic_area(load):
            return self.scene.model_copy(update={"wear": None}).with_values(given)
        coefficient = worn / (1e3 * self._line_load(load))
        even = {WEAR: coefficient, "wear.law": "archard", "wear.distances_m": [1.0]}
        return self.scene.with_values(given | even)

    def from_scene(self, scene: Scene, values: Array, distance_m: float | None) -> Array:
        """The values (axes,) of a fitted scene at a distance; what it does not hold is kept."""
        result = values.copy()
        for j, axis in enumerate(self.axes):
            if axis != WORN:
                result[j] = scene.get(axis)
            elif scene.wear is not None:
                result[j] = local_values(scene, (distance_m or 0.0,))[0, 2]
        return result

    def box(self, values: Array, size: float) -> tuple[Array, Array, tuple[int, ...]]:
        """Low and high ends (axes,) of a box of values, and the degrees of its polynomial.

        `size`, of the box, over the usual one.
        """
        assert self.scene.camera is not None and self.scene.camera.pixel_mm is not None
        pixels = _PLACE_PX * self.scene.camera.pixel_mm
        load = self._value(LOAD, values, self._now)
        low, high, degrees = values.copy(), values.copy(), []
        for j, axis in enumerate(self.axes):
            # a worn contact's is held to the exact field again and again, and only its slopes count
            degrees.append(2 if axis == "load.bulk_mpa" or WORN in self.axes else 4)
            if axis == WORN:
                half = size * _OF_WEAR * (values[j] + self._elastic_area(load))
                behind = _BEHIND if j < self.count else _ROUNDING
                low[j] = max(0.0, values[j] - behind * half)
                high[j] = low[j] + 2.0 * half  # a scar only grows
                continue
            half = size * (pixels if j in self.places else _BOX.get(axis, _OF_LOAD * load))
            low[j], high[j] = values[j] - half, values[j] + half
        return low, high, tuple(degrees)

    def _elastic_area(self, load: float) -> float:
        return elastic_area(self.scene, self._line_load(load))

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
        return 1e3 * float(wear_rate(self.scene.wear, friction, s))


def _table(scene: Scene, key: str) -> bool:
    there = key == LOAD or scene.friction is not None
    return there and isinstance(scene.get(key), DistanceTable)


def _drive_before(scene: Scene, distance_m: float, load_n: float, friction: float) -> Drive:
    """What wore a contact until a distance: the scene's tables, or what the first frame shows.

    Parameters: `scene`; `distance_m` of the first frame, and its own `load_n` and `friction`, held
    for all the time before where the scene has a number. Returns a Drive.
    """
    tables = [scene.get(LOAD), scene.get(FRICTION) if scene.friction else friction]
    s = np.array([0.0, distance_m])
    for value in tables:
        if isinstance(value, DistanceTable):
            s = np.concatenate((s, value.distance_m))
    s = np.unique(s[s <= distance_m])
    loads, mus = (isinstance(value, DistanceTable) for value in tables)
    assert scene.specimen.thickness_mm is not None
    load = np.array(scene.load_at(s)) if loads else np.full(len(s), load_n)
    return Drive(
        local_values(scene, tuple(s.tolist()))[:, 2],
        load / scene.specimen.thickness_mm,
        np.array(scene.friction_at(s)) if mus else np.full(len(s), friction),
    )


def elastic_area(scene: Scene, line_load_n_per_mm: float) -> float:
    """Area (mm²) that the indenter would cut off were it not for the elasticity, P' a / E*.

    Parameters: `scene`; `line_load_n_per_mm` P'. Source: Johnson (1985), Contact Mechanics,
    section 4.2, for the half-width a under a cylinder; that of a flat is its own.
    """
    modulus, _ = elastic_constants(scene)
    indenter = scene.indenter
    assert indenter is not None
    width = indenter.half_width_mm
    if width is None:
        radius = indenter.radius_mm or 1.0
        width = 2.0 * math.sqrt(line_load_n_per_mm * radius / (math.pi * modulus))
    return line_load_n_per_mm * width / modulus
