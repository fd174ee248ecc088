"""Where frames stand: a disc's place, found from its rim, and the axes of a set's maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from isochrome.calibration import Circle, find_rim, fit_circle
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import FrameData
from isochrome.output import numbers
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid

_AXES = (("x", "left"), ("z", "top"))


def placed_disc(scene: Scene, data: FrameData) -> tuple[Scene, list[str]]:
    """Give the scene the disc's place in a frame, and the pixel where it has none.

    The rim found in the frame gives the centre; diameter over twice the radius gives the pixel.
    Where no rim is found, the scene's own camera.left_mm, top_mm and pixel_mm are taken, and that
    is said.

    Parameters
    ----------
    scene : Scene
        A scene with a disc.
    data : FrameData
        The frame.

    Returns
    -------
    tuple of Scene and list of str
        The scene, and notes in plain words.

    Raises
    ------
    InputError
        Where the scene has no [camera].
    PhysicsError
        Where there is neither a rim nor a place.
    """
    camera, diameter = scene.camera, scene.rim_diameter_mm
    if camera is None:
        raise InputError(f"{scene.name}: [camera] is missing, and a picture needs it; add it")
    assert diameter is not None
    try:
        rim = find_rim(data)
    except PhysicsError:
        if camera.pixel_mm is None or camera.left_mm is None or camera.top_mm is None:
            raise
        return scene, ["the disc's rim was not found; the scene's own place is the start"]
    rim = sharp_rim(data, rim)
    pixel = camera.pixel_mm or diameter / (2.0 * rim.radius)
    notes = []
    if abs(2.0 * rim.radius * pixel / diameter - 1.0) > 0.05:
        notes.append(
            f"the rim is {2 * rim.radius * pixel:.4g} mm wide by camera.pixel_mm, but "
            f"specimen.diameter_mm = {diameter:g}; check both"
        )
    values = {
        "camera.pixel_mm": pixel,
        "camera.left_mm": -(rim.col + 0.5) * pixel,
        "camera.top_mm": 0.5 * diameter - (rim.row + 0.5) * pixel,
    }
    return scene.with_values(values), notes


def sharp_rim(data: FrameData, rim: Circle) -> Circle:
    """A rim drawn more sharply, where the light itself drops there.

    Along each of 360 rays the steepest fall of the light within a tenth of the radius is taken; if
    these places lie on one circle, to 1 % of its radius, it is the rim. A free rim without residual
    stress is as dark as the air and shows no such fall: then the circle stays as it was.
    Parameters: `data`; `rim`, the first circle. Returns a Circle.
    """
    from scipy.ndimage import gaussian_filter, map_coordinates

    blurred = gaussian_filter(data.light, max(1.0, 0.004 * rim.radius))
    radii = rim.radius * np.linspace(0.9, 1.06, 161)
    angles = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    rows = rim.row + np.outer(np.sin(angles), radii)
    cols = rim.col + np.outer(np.cos(angles), radii)
    fall = -np.diff(map_coordinates(blurred, [rows, cols], order=1, mode="nearest"), axis=1)
    steepest = fall.argmax(axis=1)
    selected = fall.max(axis=1) > 0.5 * np.median(fall.max(axis=1))
    radius = 0.5 * (radii[steepest] + radii[steepest + 1])
    points = np.stack(
        [rim.row + radius * np.sin(angles), rim.col + radius * np.cos(angles)], axis=1
    )
    result = fit_circle(points[selected])
    return result if result.scatter < 0.01 * result.radius else rim


def set_grid(
    scene: Scene, fitted: Scene | None, table: Mapping[str, Sequence[Any]], shape: tuple[int, int]
) -> PixelGrid | None:
    """The grid of a set's maps: that of what was found, so that its simulation has the same.

    Parameters: `scene` as given; `fitted`, with the frames' mean place; `table`, the columns of
    frames.csv; `shape` (rows, cols). Returns None where no scale is known.
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
    beyond = {
        name: np.nanmax(own)
        for name, own in far.items()
        if grid and (own > 0.5 * grid.pixel_mm).any()
    }
    if not beyond:
        return []
    reach = " and ".join(f"{own:.3g} mm along {name}" for name, own in beyond.items())
    return [
        f"the frames' own places lie up to {reach} from the maps' axes, which are of the mean "
        "place: a frame's places are x_mm + shift_x_mm and z_mm + shift_z_mm"
    ]
