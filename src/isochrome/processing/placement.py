"""Where frames stand: the axes of a set's maps, and each frame's shift from them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from isochrome.messages import message
from isochrome.output import numbers
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid

_AXES = (("x", "left"), ("z", "top"))


def set_grid(
    scene: Scene, fitted: Scene | None, table: Mapping[str, Sequence[Any]], shape: tuple[int, int]
) -> PixelGrid | None:
    """The grid of a set's maps: that of what was found, so that its simulation has the same.

    `fitted` has the frames' mean place. None where no scale is known.
    """
    pixels, place, camera = numbers(table["pixel_mm"]), fitted or scene, scene.camera
    if not np.isfinite(pixels).any():
        return None
    if place.has_model and place.camera is not None and place.camera.pixel_mm is not None:
        return pixel_grid(place, shape)
    left, top = ((camera.left_mm or 0.0), (camera.top_mm or 0.0)) if camera else (0.0, 0.0)
    return PixelGrid(*shape, left, top, float(pixels[np.isfinite(pixels)][0]))


def shift_of(edge: str, grid: PixelGrid, table: Mapping[str, Sequence[Any]]) -> np.ndarray:
    """How far (mm) each frame's own left or top edge was found from the grid's; NaN = not known."""
    if (result := table.get(f"camera.{edge}_mm")) is None:
        return np.zeros(len(table["frame"]))  # nobody looked for it: all are where the scene says
    return np.asarray(numbers(result) - getattr(grid, f"{edge}_mm"))


def shift_messages(grid: PixelGrid | None, table: Mapping[str, Sequence[Any]]) -> list[str]:
    """What to say where frames lie over half a pixel from the axes that all maps have."""
    far = {name: np.abs(shift_of(edge, grid, table)) for name, edge in _AXES} if grid else {}
    beyond = [
        f"{np.nanmax(shift):.3g} mm along {name}"
        for name, shift in far.items()
        if grid and (shift > 0.5 * grid.pixel_mm).any()
    ]
    if not beyond:
        return []
    reach = " and ".join(beyond)
    return [message("frames_own_places_lie", reach=reach)]
