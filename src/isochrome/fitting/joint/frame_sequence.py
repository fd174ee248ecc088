"""Several frames as functions of common unknowns: the scenes that a set of values stands for.

The frames of a worn contact are states of one run: load, friction and wear at their distances are
tables over distance in one scene, and each frame is that scene at its own distance, with its past.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from isochrome.contact import mean_wear_rate, wear_course
from isochrome.errors import InputError
from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.single_state import frame_distance, frame_scene, state_scene, with_part
from isochrome.fitting.frame.unknowns import FRICTION, LOAD, WEAR, scene_value
from isochrome.scene import DistanceTable, Scene
from isochrome.simulation import SceneState, scene_states, state_count

COURSE = (LOAD, FRICTION, WEAR)
"""Keys that may vary over distance: later frames of a run inherit what they were before."""

_SUDDEN = 1e-9
"""Share of a distance within which a stepwise value changes."""

_RUNS = 12


@dataclass(frozen=True)
class Unknown:
    """One unknown: its `key`, the `frames` that it acts in, and whether all frames share it."""

    key: str
    frames: tuple[int, ...]
    shared: bool


@dataclass(frozen=True)
class MeasuredArea:
    """The worn area of the trace `name`, and what roughness and levelling leave of it open."""

    name: str
    distance_m: float
    area_mm2: float
    standard_uncertainty_mm2: float
    messages: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sequence:
    """The unknowns of `count` frames of a `scene`: of a key of a run's course, frames at one
    distance have one value. `areas`, those of measured scars of the run.
    """

    scene: Scene
    count: int
    unknowns: tuple[Unknown, ...]
    areas: tuple[MeasuredArea, ...] = ()

    @cached_property
    def run(self) -> bool:
        """Whether the frames are states of one wearing run, and not each a contact of its own."""
        scene = self.scene
        return scene.is_contact and scene.wear is not None and state_count(scene) == self.count

    @cached_property
    def distances_m(self) -> tuple[float | None, ...]:
        """Distance of each frame (m), None for a static one."""
        return tuple(frame_distance(self.scene, i) for i in range(self.count))

    def in_course(self, key: str) -> bool:
        """Whether a key's values over distance make the course of a run."""
        return self.run and key in COURSE

    def whole(self, values: Array) -> Scene:
        """The scene of all frames: shared values, and tables over distance of a run's course."""
        values_of_keys: dict[str, Any] = {}
        tables: dict[str, dict[float, float]] = {}
        for unknown, value in zip(self.unknowns, values.tolist(), strict=True):
            if unknown.shared:
                values_of_keys[unknown.key] = value
            elif self.in_course(unknown.key):
                distance = max(self.distances_m[i] or 0.0 for i in unknown.frames)
                tables.setdefault(unknown.key, {})[distance] = value
        for key, points in tables.items():
            values_of_keys[key] = stepwise(points) if key == WEAR else over_distance(points)
        return self.scene.with_values(values_of_keys)

    def frame(self, common: Scene, values: Array, index: int) -> Scene:
        """The one-state scene of a frame, with its own values, in a scene of all frames."""
        per_frame = {
            unknown.key: value
            for unknown, value in zip(self.unknowns, values.tolist(), strict=True)
            if index in unknown.frames and not unknown.shared and not self.in_course(unknown.key)
        }
        scene = state_scene(common, index)
        return scene.with_values(per_frame) if per_frame else scene

    def acting(self, index: int) -> tuple[str, ...]:
        """The keys of the unknowns that act in a frame."""
        return tuple(dict.fromkeys(u.key for u in self.unknowns if index in u.frames))


def over_distance(points: dict[float, float]) -> Any:
    """Values at some distances (m) as a scene takes them: a table, or a single one's number."""
    rising = sorted(points)
    if len(rising) == 1:
        return points[rising[0]]
    return {"distance_m": rising, "value": [points[d] for d in rising]}


def stepwise(points: dict[float, float]) -> Any:
    """Values that hold until some distances (m): linear ones would swing to follow the noise."""
    ends = sorted(points)
    if len(ends) == 1:
        return points[ends[0]]
    distance, value = [0.0], [points[ends[0]]]
    for end, following in pairwise(ends):
        distance += [end, end * (1.0 + _SUDDEN)]
        value += [points[end], points[following]]
    return {"distance_m": [*distance, ends[-1]], "value": [*value, points[ends[-1]]]}


def make_sequence(
    scene: Scene, count: int, shared: tuple[str, ...], per_frame: tuple[str, ...]
) -> Sequence:
    """The unknowns of `count` frames: `shared` keys of all, `per_frame` keys with a value in each
    that has it (a static one has no friction). InputError for a key that no frame has.
    """
    unknowns: list[Unknown] = []
    given = Sequence(scene, count, ())
    for key in (*shared, *per_frame):
        having = tuple(i for i in range(count) if _has(scene, i, key))
        if not having:
            raise InputError("no_frame_scene_has", key=key)
        if key in shared:
            unknowns.append(Unknown(key, having, True))
            continue
        frames_at: dict[float, list[int]] = {}
        for i in having:
            place = (given.distances_m[i] or 0.0) if given.in_course(key) else i
            frames_at.setdefault(place, []).append(i)
        unknowns += [Unknown(key, tuple(frames), False) for frames in frames_at.values()]
    return Sequence(scene, count, tuple(unknowns))


def _has(scene: Scene, index: int, key: str) -> bool:
    one = state_scene(scene, index)
    if key == WEAR and (one.wear is None or not one.wear.distances_m[0]):
        return False
    return isinstance(scene_value(one, key), int | float | DistanceTable)


class SharedRun:
    """Solves one-state scenes of a run: all states at once, of which each frame takes its own."""

    def __init__(self, distances_m: tuple[float | None, ...]) -> None:
        """`distances_m` of all frames; the last few runs are kept."""
        self._distances = tuple(sorted({d for d in distances_m if d is not None}))
        self._states = lru_cache(_RUNS)(scene_states)

    def __call__(self, scene: Scene) -> SceneState:
        """The state of a one-state scene. Raises PhysicsError where its run cannot be solved."""
        wear = scene.wear
        if wear is None or wear.distances_m[0] not in self._distances:
            return scene_states(scene)[-1]
        states = self._states(with_part(scene, "wear", distances_m=self._distances))
        return states[self._distances.index(wear.distances_m[0])]


def local_values(common: Scene, distances_m: tuple[float | None, ...]) -> Array:
    """What frames of a run show of its course (frames, 3): load P (N), friction mu, worn area (mm²)
    W = ∫ P' dK, with dh = p dK and ∫ p dx = P'. A frame follows its history through W all but
    alone: the shape at one area changes derivatives, not residuals, by some per cent.
    """
    distances = sorted({d for d in distances_m if d is not None} | {0.0})
    history, stops = wear_course(with_part(common, "wear", distances_m=tuple(distances)))
    dose, load = history.dose_mm_per_mpa, history.line_load_n_per_mm
    area = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(dose) * (load[1:] + load[:-1]))])
    rows = {}
    for stop in stops:
        k = stop.dose_mm_per_mpa
        i = max(0, int(np.searchsorted(dose, k)) - 1)
        worn = area[i] + 0.5 * (k - dose[i]) * (load[i] + history.at(k)[0])
        rows[stop.distance_m] = (common.load_at(stop.distance_m), stop.friction, worn)
    static = (common.load_at(0.0), 0.0, 0.0)
    return np.array([static if d is None else rows[d] for d in distances_m])


def alone_scene(scene: Scene, state: int) -> Scene:
    """One state of a run as if all its wear had been at its own load and friction: worn as much as
    in the run, by the scene's law, or Archard's where that wears nothing there.
    """
    distance = frame_distance(scene, state)
    if distance is None or scene.wear is None:
        return frame_scene(scene, state)
    load, friction, worn = local_values(scene, (distance,))[0].tolist()
    thickness = scene.specimen.thickness_mm
    assert thickness is not None
    loaded = with_part(scene, "load", normal_n=load)
    if scene.friction:
        loaded = with_part(loaded, "friction", coefficient=friction, static_state_first=False)
    rate = worn * thickness / (1e3 * load * distance) if distance else 0.0
    if not rate:
        return loaded.model_copy(update={"wear": None})
    even = with_part(loaded, "wear", coefficient_mm2_per_n=1.0, distances_m=(distance,))
    assert even.wear is not None
    by_law = float(mean_wear_rate(even.wear, friction, distance))
    if not by_law:
        return with_part(even, "wear", coefficient_mm2_per_n=rate, law="archard")
    return with_part(even, "wear", coefficient_mm2_per_n=rate / by_law)
