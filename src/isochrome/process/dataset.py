"""A set's findings as columns and coordinates of its dataset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.process.processed import PICTURE
from isochrome.runs.store import attributes, column
from isochrome.scene import Scene

if TYPE_CHECKING:
    import xarray

_COORDINATES = ("frame", "name", "label", "distance_m", "time_s")
_MORE = ("status", "time_s", "left_mm", "top_mm")


def columns_dataset(
    scene: Scene,
    table: Mapping[str, list[Any]],
    more: Mapping[str, list[Any]],
    shape: tuple[int, int],
    identity: Mapping[str, Any],
) -> xarray.Dataset:
    """The columns of frames.csv over frame, with the axes' coordinates and the run's attributes.

    x = left + (col + 1/2) pixel,  z = top + (row + 1/2) pixel, of the scene's own place; left_mm
    and top_mm over frame say where each frame was found to stand.
    Parameters: `scene`; `table`, the columns of frames.csv; `more`, besides them status, time_s,
    left_mm and top_mm; `shape` (rows, cols); `identity`, what the run is a result of. Returns an
    xarray.Dataset.
    """
    import xarray

    found = dict(table) | {name: more[name] for name in _MORE}
    # all are there, whatever is known of them: a dataset's axes do not come and go
    columns = {name: column(values, "frame", name) for name, values in found.items()}
    axes = {name: columns.pop(name) for name in _COORDINATES} | _places(scene, table, shape)
    if PICTURE in table:
        whole = [k for k, at in enumerate(table[PICTURE]) if at is not None]
        axes["key_frame"] = xarray.Variable("key_frame", np.array(whole))
    return xarray.Dataset(columns, axes, attributes(identity))


def _places(
    scene: Scene, table: Mapping[str, list[Any]], shape: tuple[int, int]
) -> dict[str, xarray.Variable]:
    """Coordinates of rows and columns: numbers, and places in mm where the scale is known."""
    import xarray

    axes = {
        "row": xarray.Variable("row", np.arange(shape[0]), {"units": "pixel"}),
        "col": xarray.Variable("col", np.arange(shape[1]), {"units": "pixel"}),
    }
    pixel = next((p for p in table["pixel_mm"] if p is not None), None)
    if pixel is None:
        return axes
    camera = scene.camera
    for name, axis, count, edge, what in (
        ("z_mm", "row", shape[0], camera.top_mm if camera else None, "depth below the surface"),
        ("x_mm", "col", shape[1], camera.left_mm if camera else None, "along the surface"),
    ):
        place = (edge or 0.0) + (np.arange(count) + 0.5) * pixel
        origin = what if edge is not None else "from the picture's outer edge"
        axes[name] = xarray.Variable(axis, place, {"units": "mm", "long_name": origin})
    return axes
