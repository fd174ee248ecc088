"""A set's findings as columns and coordinates of its dataset."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.process.processed import PICTURE
from isochrome.runs.store import Column, add_columns, attributes, column
from isochrome.scene import Scene

_COORDINATES = ("frame", "name", "label", "distance_m", "time_s")
_MORE = ("status", "time_s", "left_mm", "top_mm")


def write_columns(
    store: Path,
    scene: Scene,
    table: Mapping[str, list[Any]],
    more: Mapping[str, list[Any]],
    shape: tuple[int, int],
    identity: Mapping[str, Any],
) -> None:
    """Add the columns of frames.csv over frame, the axes' coordinates and the run's attributes.

    x = left + (col + 1/2) pixel,  z = top + (row + 1/2) pixel, of the scene's own place; left_mm
    and top_mm over frame say where each frame was found to stand.
    Parameters: `store`, the run's; `scene`; `table`, the columns of frames.csv; `more`, besides
    them status, time_s, left_mm and top_mm; `shape` (rows, cols); `identity`, what the run is a
    result of. Raises OSError.
    """
    found = dict(table) | {name: more[name] for name in _MORE}
    # all are there, whatever is known of them: a dataset's axes do not come and go
    columns = {name: column(values, "frame", name) for name, values in found.items()}
    axes = {name: columns.pop(name) for name in _COORDINATES} | _places(scene, table, shape)
    if PICTURE in table:
        whole = [k for k, at in enumerate(table[PICTURE]) if at is not None]
        axes["key_frame"] = Column(("key_frame",), np.array(whole), {})
    add_columns(store, columns, axes, attributes(identity))


def _places(
    scene: Scene, table: Mapping[str, list[Any]], shape: tuple[int, int]
) -> dict[str, Column]:
    """Coordinates of rows and columns: numbers, and places in mm where the scale is known."""
    axes = {
        "row": Column(("row",), np.arange(shape[0]), {"units": "pixel"}),
        "col": Column(("col",), np.arange(shape[1]), {"units": "pixel"}),
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
        axes[name] = Column((axis,), place, {"units": "mm", "long_name": origin})
    return axes
