"""Scenes of a single state, which is what one frame shows."""

from __future__ import annotations

from typing import Any

from isochrome.contact import contact_grid
from isochrome.scene import Scene


def frame_scene(scene: Scene, state: int) -> Scene:
    """The scene of one frame alone: its own distance, its own friction as a number.

    Parameters: `scene`; `state`, counted from 0, the static state first where the scene has one.
    Returns a Scene with a single state.
    """
    if scene.model != "contact":
        return scene
    static_first = bool(scene.friction and scene.friction.static_state_first)
    if scene.load is not None and scene.load.tangential_n is not None:
        return scene.model_copy(update={"wear": None})
    if static_first and state == 0:
        return scene.model_copy(update={"wear": None, "friction": None})
    distances = scene.wear.distances_m if scene.wear else (0.0,)
    return scene_at(scene, distances[min(state - static_first, len(distances) - 1)])


def scene_at(scene: Scene, distance_m: float) -> Scene:
    """The scene at one sliding distance (m): one state, friction as a number."""
    update: dict[str, Any] = {}
    if scene.friction:
        update["friction"] = scene.friction.model_copy(
            update={"coefficient": scene.friction_at(distance_m), "static_state_first": False}
        )
    if scene.wear:
        worn = distance_m > 0.0
        update["wear"] = (
            scene.wear.model_copy(update={"distances_m": (distance_m,)}) if worn else None
        )
    return scene.model_copy(update=update)


def with_numerics(scene: Scene, *, nodes_per_pixel: int, tolerance: float, room: float) -> Scene:
    """A contact scene with a surface grid that stays the same while its values move.

    Parameters: `nodes_per_pixel`; `tolerance` of the wear; `room`, factor on the window that the
    scene's own values need. Returns a Scene; others than contacts as they are.
    """
    if scene.model != "contact" or scene.camera is None or scene.camera.pixel_mm is None:
        return scene
    wear = scene.wear
    dose = 1e3 * wear.coefficient_mm2_per_n * max(wear.distances_m) if wear else 0.0
    grid = contact_grid(scene, largest_dose_mm_per_mpa=dose)
    numerics = scene.numerics.model_copy(
        update={
            "spacing_mm": scene.camera.pixel_mm / nodes_per_pixel,
            "window_mm": room * grid.spacing_mm * (grid.nodes - 1),
            "tolerance": tolerance,
        }
    )
    return scene.model_copy(update={"numerics": numerics})
