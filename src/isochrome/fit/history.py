"""What a run's frames owe to its history: states solved together, and the few numbers they show."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.contact import wear_course
from isochrome.fit.one_state import frame_distance, frame_scene
from isochrome.scene import Scene
from isochrome.simulate import SceneState, scene_states

Array = NDArray[Any]

_RUNS = 12


class SharedRun:
    """Solves one-state scenes of a run: all states at once, of which each frame takes its own."""

    def __init__(self, distances_m: tuple[float | None, ...]) -> None:
        """`distances_m` of all frames; the last few runs are kept."""
        self._distances = tuple(sorted({d for d in distances_m if d is not None}))
        self._runs: OrderedDict[Any, list[SceneState]] = OrderedDict()

    def __call__(self, scene: Scene) -> SceneState:
        """The state of a one-state scene. Raises PhysicsError where its run cannot be solved."""
        wear = scene.wear
        if wear is None or wear.distances_m[0] not in self._distances:
            return scene_states(scene)[-1]
        all_of_it = wear.model_copy(update={"distances_m": self._distances})
        key = (
            scene.specimen, scene.indenter, scene.load, scene.friction, all_of_it, scene.numerics,
        )  # fmt: skip
        if key not in self._runs:
            self._runs[key] = scene_states(scene.model_copy(update={"wear": all_of_it}))
            while len(self._runs) > _RUNS:
                self._runs.popitem(last=False)
        self._runs.move_to_end(key)
        return self._runs[key][self._distances.index(wear.distances_m[0])]


def local_values(whole: Scene, distances_m: tuple[float | None, ...]) -> Array:
    """What a frame of a run shows of its course: load P (N), friction mu, worn area per frame.

    The worn area W = ∫ P' dK, with dh = p dK and ∫ p dx = P', is the area of the scar; a frame
    follows its history through it all but alone: the scar's shape at one area changes a frame's
    derivatives by some per cent (measured), and nothing else, since residuals are of the whole run.
    Parameters: `whole`, the scene of the run; `distances_m` (frames,), None for a static state.
    Returns (frames, 3), N, 1, mm².
    """
    assert whole.wear is not None
    there = sorted({d for d in distances_m if d is not None} | {0.0})
    asked = whole.wear.model_copy(update={"distances_m": tuple(there)})
    course, stops = wear_course(whole.model_copy(update={"wear": asked}))
    dose, load = course.dose_mm_per_mpa, course.line_load_n_per_mm
    area = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(dose) * (load[1:] + load[:-1]))])
    rows = {}
    for stop in stops:
        k = stop.dose_mm_per_mpa
        i = max(0, int(np.searchsorted(dose, k)) - 1)
        worn = area[i] + 0.5 * (k - dose[i]) * (load[i] + course.at(k)[0])
        rows[stop.distance_m] = (whole.load_at(stop.distance_m), stop.friction, worn)
    static = (whole.load_at(0.0), 0.0, 0.0)
    return np.array([static if d is None else rows[d] for d in distances_m])


def alone_scene(scene: Scene, state: int) -> Scene:
    """A frame of a run as if all its wear had been at its own load and friction.

    Parameters: `scene`; `state`, counted as in `frame_scene`. Returns a one-state Scene of numbers,
    worn by Archard's law as much as in the run: where a fit of one frame on its own starts.
    """
    distance = frame_distance(scene, state)
    if distance is None or scene.wear is None:
        return frame_scene(scene, state)
    load, friction, worn = local_values(scene, (distance,))[0].tolist()
    thickness = scene.specimen.thickness_mm
    assert scene.load is not None and thickness is not None
    update: dict[str, Any] = {"load": scene.load.model_copy(update={"normal_n": load})}
    if scene.friction:
        own = {"coefficient": friction, "static_state_first": False}
        update["friction"] = scene.friction.model_copy(update=own)
    coefficient = worn * thickness / (1e3 * load * distance) if distance else 0.0
    even = {"coefficient_mm2_per_n": coefficient, "law": "archard", "distances_m": (distance,)}
    update["wear"] = scene.wear.model_copy(update=even) if coefficient else None
    return scene.model_copy(update=update)
