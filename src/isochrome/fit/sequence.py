"""Several frames as functions of common unknowns: the scenes that a set of values stands for.

The frames of a worn contact are states of one run. What the surface went through before a frame
is part of that frame, so that the values of load, friction and wear at the frames' distances are
tables over distance in one scene, and each frame is that scene at its own distance.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.fit.one_state import frame_distance, state_scene
from isochrome.scene import DistanceTable, Scene
from isochrome.simulate import state_count

Array = NDArray[Any]

WEAR = "wear.coefficient_mm2_per_n"
FRICTION = "friction.coefficient"
COURSE = ("load.normal_n", FRICTION, WEAR)
"""Keys that may vary over distance: later frames of a run inherit what they were before."""


_SUDDEN = 1e-9
"""Share of a distance within which a stepwise value changes."""


@dataclass(frozen=True)
class Unknown:
    """One unknown: its `key`, the `frames` that it acts in, and whether all frames share it."""

    key: str
    frames: tuple[int, ...]
    shared: bool


@dataclass(frozen=True)
class Sequence:
    """The unknowns of `count` frames of a `scene`.

    Of a key that a run's course is made of, frames at one distance have one value: the course has
    one there.
    """

    scene: Scene
    count: int
    unknowns: tuple[Unknown, ...]

    @cached_property
    def run(self) -> bool:
        """Whether the frames are states of one wearing run."""
        return is_run(self.scene, self.count)

    @cached_property
    def distances_m(self) -> tuple[float | None, ...]:
        """Distance of each frame (m), None for a static one."""
        return tuple(frame_distance(self.scene, i) for i in range(self.count))

    def in_course(self, key: str) -> bool:
        """Whether a key's values over distance make the course of a run."""
        return self.run and key in COURSE

    def whole(self, values: Array) -> Scene:
        """The scene of all frames: shared values, and tables over distance of a run's course."""
        found: dict[str, Any] = {}
        tables: dict[str, dict[float, float]] = {}
        for unknown, value in zip(self.unknowns, values.tolist(), strict=True):
            if unknown.shared:
                found[unknown.key] = value
            elif self.in_course(unknown.key):
                distance = max(self.distances_m[i] or 0.0 for i in unknown.frames)
                tables.setdefault(unknown.key, {})[distance] = value
        for key, points in tables.items():
            found[key] = stepwise(points) if key == WEAR else over_distance(points)
        return self.scene.with_values(found)

    def frame(self, whole: Scene, values: Array, index: int) -> Scene:
        """The one-state scene of a frame, with its own values, in a scene of all frames."""
        own = {
            unknown.key: value
            for unknown, value in zip(self.unknowns, values.tolist(), strict=True)
            if index in unknown.frames and not unknown.shared and not self.in_course(unknown.key)
        }
        scene = state_scene(whole, index)
        return scene.with_values(own) if own else scene

    def acting(self, index: int) -> tuple[str, ...]:
        """The keys of the unknowns that act in a frame."""
        return tuple(dict.fromkeys(u.key for u in self.unknowns if index in u.frames))

    def of_law(self, law: str) -> Sequence:
        """The same frames and unknowns under another wear law."""
        return replace(self, scene=self.scene.with_values({"wear.law": law}))


def is_run(scene: Scene, count: int) -> bool:
    """Whether a scene's frames are states of one wearing run, and not each a contact of its own."""
    return scene.model == "contact" and scene.wear is not None and state_count(scene) == count


def over_distance(points: dict[float, float]) -> Any:
    """Values at some distances (m) as a scene takes them: a table, or one number."""
    rising = sorted(points)
    if len(rising) == 1:
        return points[rising[0]]
    return {"distance_m": rising, "value": [points[d] for d in rising]}


def stepwise(points: dict[float, float]) -> Any:
    """Values that hold until some distances (m), each since the one before, as a scene takes them.

    A wear coefficient between two frames is what was worn between them; one that is linear there
    would have to swing from frame to frame to follow the noise.
    """
    ends = sorted(points)
    if len(ends) == 1:
        return points[ends[0]]
    distance, value = [0.0], [points[ends[0]]]
    for end, following in pairwise(ends):
        distance += [end, end * (1.0 + _SUDDEN)]
        value += [points[end], points[following]]
    return {"distance_m": [*distance, ends[-1]], "value": [*value, points[ends[-1]]]}


def make_sequence(
    scene: Scene, count: int, shared: tuple[str, ...], own: tuple[str, ...]
) -> Sequence:
    """The unknowns of `count` frames: `shared` keys of all, `own` keys with a value a frame.

    A frame without a key (the friction of a static one, the wear of one that has not slid) has no
    such unknown. Raises InputError for a key that no frame has.
    """
    unknowns = []
    run = is_run(scene, count)
    for key in (*shared, *own):
        having = tuple(i for i in range(count) if _has(scene, i, key))
        if not having:
            raise InputError(f"{key}: no frame's scene has this key; leave it out")
        if key in shared:
            unknowns.append(Unknown(key, having, True))
        elif run and key in COURSE:
            there: OrderedDict[float, list[int]] = OrderedDict()
            for i in having:
                there.setdefault(frame_distance(scene, i) or 0.0, []).append(i)
            unknowns += [Unknown(key, tuple(frames), False) for frames in there.values()]
        else:
            unknowns += [Unknown(key, (i,), False) for i in having]
    return Sequence(scene, count, tuple(unknowns))


def _has(scene: Scene, index: int, key: str) -> bool:
    one = state_scene(scene, index)
    if key == WEAR and (one.wear is None or not one.wear.distances_m[0]):
        return False
    try:
        value = one.get(key)
    except InputError:
        return False
    return isinstance(value, int | float | DistanceTable)
