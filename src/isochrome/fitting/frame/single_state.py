"""Scenes of a single state, which is what one frame shows."""

from typing import Any

import numpy as np

from isochrome.contact import contact_grid, wear_course
from isochrome.errors import InputError
from isochrome.frames import Frame
from isochrome.scene import DistanceTable, Scene, Wear


def is_held(scene: Scene) -> bool:
    """Whether a given tangential force holds the contact, which then does not slide."""
    return scene.load is not None and scene.load.tangential_n is not None


def with_part(scene: Scene, part: str, **values: Any) -> Scene:
    """A scene with some values of a part, such as its load, changed unchecked."""
    return scene.model_copy(update={part: getattr(scene, part).model_copy(update=values)})


def frame_scene(scene: Scene, state: int) -> Scene:
    """The scene of one frame alone; states count from 0, a static one first."""
    if not scene.is_contact:
        return scene
    if is_held(scene):
        return scene.model_copy(update={"wear": None})
    distance = frame_distance(scene, state)
    if distance is None:
        return _loaded_at(scene.model_copy(update={"wear": None, "friction": None}), 0.0)
    return scene_at(scene, distance)


def frame_distance(scene: Scene, state: int) -> float | None:
    """Sliding distance of a state (m), counted as in `frame_scene`; None where nothing slides."""
    if not scene.is_contact or is_held(scene):
        return None
    static_first = bool(scene.friction and scene.friction.static_state_first)
    if static_first and state == 0:
        return None
    distances = scene.wear.distances_m if scene.wear else (0.0,)
    return distances[min(state - static_first, len(distances) - 1)]


def sliding_scene(scene: Scene) -> Scene:
    """A video's scene: where frames.sliding_speed_mm_per_s is given, no state is static first."""
    if scene.frames.sliding_speed_mm_per_s is None or scene.friction is None:
        return scene
    return scene.with_values({"friction.static_state_first": False})


def slid_until(scene: Scene, frame: Frame) -> float | None:
    """Distance (m) slid until a frame, None where nothing wears; InputError without its time."""
    if scene.wear is None:
        return None
    speed = scene.frames.sliding_speed_mm_per_s
    if speed is None:
        return frame_distance(scene, frame.index)
    return timed_distance(frame, speed)


def timed_distance(frame: Frame, speed_mm_per_s: float) -> float:
    """Sliding distance of a video's frame, s = v t (m); InputError where it has no time."""
    if frame.time_s is None:
        raise InputError("frame_has_no_time", index=frame.index, name=frame.name)
    return 1e-3 * speed_mm_per_s * frame.time_s


def state_scene(scene: Scene, state: int) -> Scene:
    """The scene of one state with its whole history: its distance alone, tables as they are."""
    distance = frame_distance(scene, state)
    if distance is None:
        return frame_scene(scene, state)
    if scene.friction:
        scene = with_part(scene, "friction", static_state_first=False)
    return with_part(scene, "wear", distances_m=(distance,)) if scene.wear else scene


def scene_at(scene: Scene, distance_m: float) -> Scene:
    """The scene at one sliding distance: one state; load, friction and wear as numbers, and what
    lies between the bodies unless they wore while it wore in. The wear coefficient makes the same
    dose under the state's constant friction; what varies on the way gives the equivalent of
    Archard's law, K/s. InputError where the load changes while the contact wears: no constant load
    has worn that scar.
    """
    loaded = _loaded_at(scene, distance_m)
    if scene.friction:
        mu = scene.friction_at(distance_m)
        loaded = with_part(loaded, "friction", coefficient=mu, static_state_first=False)
    if scene.wear:
        wear = _wear_at(scene, scene.wear, distance_m) if distance_m > 0.0 else None
        between = loaded.contact if wear is None else scene.contact
        loaded = loaded.model_copy(update={"wear": wear, "contact": between})
    return loaded


def _loaded_at(scene: Scene, distance_m: float) -> Scene:
    scene = with_between(scene, distance_m)
    return with_part(scene, "load", normal_n=scene.load_at(distance_m)) if scene.load else scene


def with_between(scene: Scene, distance_m: float) -> Scene:
    """The scene with numbers, at a distance, of what lies between the bodies of its contact."""
    if scene.is_bare:
        return scene
    layer, roughness = 1e3 * scene.layer_at(distance_m), 1e3 * scene.roughness_at(distance_m)
    return with_part(scene, "contact", layer_um_per_mpa=layer, roughness_um=roughness)


def _wear_at(scene: Scene, wear: Wear, distance_m: float) -> Wear:
    wear_there = wear.model_copy(update={"distances_m": (distance_m,)})
    history, (stop,) = wear_course(scene.model_copy(update={"wear": wear_there}))
    loads = history.line_load_n_per_mm
    if stop.dose_mm_per_mpa > 0.0 and np.ptp(loads) > 1e-9 * loads.max():
        raise InputError("load_normal_n_table_changes", name=scene.name, distance_m=distance_m)
    friction = scene.friction.coefficient if scene.friction else 0.0
    if isinstance(wear.coefficient_mm2_per_n, DistanceTable) or (
        wear.law != "archard" and isinstance(friction, DistanceTable)
    ):
        equivalent = 1e-3 * stop.dose_mm_per_mpa / distance_m
        return wear_there.model_copy(update={"coefficient_mm2_per_n": equivalent, "law": "archard"})
    return wear_there


_COARSEST = 32
"""A coarse contact's spacing over the scene's own, at most: a dozen nodes in its half-width."""


def with_numerics(
    scene: Scene,
    *,
    room: float = 1.2,
    nodes_per_pixel: int | None = None,
    tolerance: float | None = None,
) -> Scene:
    """A contact scene with a surface grid that stays while its values move, with `room` in its
    window; by default as fine as a simulation: else the difference would pass for physics.
    """
    if not scene.is_contact or scene.camera is None or scene.camera.pixel_mm is None:
        return scene
    history, _ = wear_course(scene)
    grid = contact_grid(scene, largest_dose_mm_per_mpa=float(history.dose_mm_per_mpa[-1]))
    spacing = grid.spacing_mm
    if nodes_per_pixel and scene.profile_file is None:  # a measured profile keeps its rows
        spacing = min(scene.camera.pixel_mm / nodes_per_pixel, _COARSEST * spacing)
    return with_part(
        scene,
        "numerics",
        spacing_mm=spacing,
        # rough surfaces fade out over what their roughness says: each finds its window
        window_mm=None if scene.roughness_at(0.0) else room * grid.spacing_mm * (grid.nodes - 1),
        tolerance=tolerance or scene.numerics.tolerance,
    )
