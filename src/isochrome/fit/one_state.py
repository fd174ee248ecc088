"""Scenes of a single state, which is what one frame shows."""

from __future__ import annotations

from typing import Any

import numpy as np

from isochrome.contact import contact_grid, wear_course
from isochrome.errors import InputError
from isochrome.frames import Frame
from isochrome.scene import DistanceTable, Scene, Wear


def frame_scene(scene: Scene, state: int) -> Scene:
    """The scene of one frame alone: its own distance, load and friction.

    Parameters: `scene`; `state`, counted from 0, the static state first where the scene has one.
    Returns a Scene with a single state.
    """
    if scene.model != "contact":
        return scene
    static_first = bool(scene.friction and scene.friction.static_state_first)
    if scene.load is not None and scene.load.tangential_n is not None:
        return scene.model_copy(update={"wear": None})
    if static_first and state == 0:
        return scene.model_copy(update={"wear": None, "friction": None} | _load_at(scene, 0.0))
    distances = scene.wear.distances_m if scene.wear else (0.0,)
    return scene_at(scene, distances[min(state - static_first, len(distances) - 1)])


def frame_distance(scene: Scene, state: int) -> float | None:
    """Sliding distance of a state (m), counted as in `frame_scene`; None where nothing slides."""
    if scene.model != "contact" or (scene.load and scene.load.tangential_n is not None):
        return None
    static_first = bool(scene.friction and scene.friction.static_state_first)
    if static_first and state == 0:
        return None
    distances = scene.wear.distances_m if scene.wear else (0.0,)
    return distances[min(state - static_first, len(distances) - 1)]


def timed_distance(frame: Frame, speed_mm_per_s: float) -> float:
    """Sliding distance of a video's frame (m): s = v t.

    Parameters: `frame`; `speed_mm_per_s`, v. Raises InputError where the frame has no time.
    """
    if frame.time_s is None:
        raise InputError(
            f"frame {frame.index} ({frame.name}) has no time, which "
            "frames.sliding_speed_mm_per_s needs; remove that key, or give a video"
        )
    return 1e-3 * speed_mm_per_s * frame.time_s


def state_scene(scene: Scene, state: int) -> Scene:
    """The scene of one state with its whole history: its distance alone, tables as they are.

    Parameters: `scene`; `state`, counted as in `frame_scene`. Returns a Scene of a single state,
    which is exactly the scene's own.
    """
    distance = frame_distance(scene, state)
    if distance is None:
        return frame_scene(scene, state)
    update: dict[str, Any] = {}
    if scene.friction:
        update["friction"] = scene.friction.model_copy(update={"static_state_first": False})
    if scene.wear:
        update["wear"] = scene.wear.model_copy(update={"distances_m": (distance,)})
    return scene.model_copy(update=update)


def scene_at(scene: Scene, distance_m: float) -> Scene:
    """The scene at one sliding distance: one state; load, friction and wear as numbers.

    The wear coefficient is the one that makes the same dose there under the state's constant
    friction; a coefficient or friction that varies on the way gives the equivalent of Archard's
    law, K/s.
    Parameters: `scene`; `distance_m`, s (m). Returns a Scene. Raises InputError where the load
    changes while the contact wears: no constant load has worn that scar.
    """
    update = _load_at(scene, distance_m)
    if scene.friction:
        update["friction"] = scene.friction.model_copy(
            update={"coefficient": scene.friction_at(distance_m), "static_state_first": False}
        )
    if scene.wear:
        update["wear"] = _wear_at(scene, scene.wear, distance_m) if distance_m > 0.0 else None
    return scene.model_copy(update=update)


def _load_at(scene: Scene, distance_m: float) -> dict[str, Any]:
    if scene.load is None:
        return {}
    return {"load": scene.load.model_copy(update={"normal_n": scene.load_at(distance_m)})}


def _wear_at(scene: Scene, wear: Wear, distance_m: float) -> Wear:
    there = wear.model_copy(update={"distances_m": (distance_m,)})
    course, (stop,) = wear_course(scene.model_copy(update={"wear": there}))
    loads = course.line_load_n_per_mm
    if stop.dose_mm_per_mpa > 0.0 and np.ptp(loads) > 1e-9 * loads.max():
        raise InputError(
            f"{scene.name}: load.normal_n is a table that changes before {distance_m:g} m, and "
            "the depth worn until a frame is modelled here at one load; frames are fitted only "
            "with a load.normal_n that is constant over distance"
        )
    friction = scene.friction.coefficient if scene.friction else 0.0
    if isinstance(wear.coefficient_mm2_per_n, DistanceTable) or (
        wear.law != "archard" and isinstance(friction, DistanceTable)
    ):
        equivalent = 1e-3 * stop.dose_mm_per_mpa / distance_m
        return there.model_copy(update={"coefficient_mm2_per_n": equivalent, "law": "archard"})
    return there


def with_numerics(scene: Scene, *, nodes_per_pixel: int, tolerance: float, room: float) -> Scene:
    """A contact scene with a surface grid that stays the same while its values move.

    Parameters: `nodes_per_pixel`; `tolerance` of the wear; `room`, factor on the window that the
    scene's own values need. Returns a Scene; others than contacts as they are.
    """
    if scene.model != "contact" or scene.camera is None or scene.camera.pixel_mm is None:
        return scene
    return _on_grid(scene, scene.camera.pixel_mm / nodes_per_pixel, room, tolerance)


def with_own_numerics(scene: Scene, *, room: float = 1.2) -> Scene:
    """A contact scene as fine as it is on its own, with a grid that its values do not move.

    A fit that ends on other numerics than a simulation's would take their difference for physics.
    Parameters: `scene`; `room`, factor on the window. Returns a Scene; others than contacts as
    they are.
    """
    if scene.model != "contact" or scene.camera is None or scene.camera.pixel_mm is None:
        return scene
    return _on_grid(scene, None, room, scene.numerics.tolerance)


def _on_grid(scene: Scene, spacing_mm: float | None, room: float, tolerance: float) -> Scene:
    course, _ = wear_course(scene)
    grid = contact_grid(scene, largest_dose_mm_per_mpa=float(course.dose_mm_per_mpa[-1]))
    numerics = scene.numerics.model_copy(
        update={
            "spacing_mm": spacing_mm or grid.spacing_mm,
            "window_mm": room * grid.spacing_mm * (grid.nodes - 1),
            "tolerance": tolerance,
        }
    )
    return scene.model_copy(update={"numerics": numerics})
