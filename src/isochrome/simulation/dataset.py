"""What a simulation holds in memory, with axes in mm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.runs import Column, RunArray, RunDataset, attributes, column, make_dataset
from isochrome.scene import Scene, dump_scene
from isochrome.stress import PixelGrid

_UNITS = {"frames": "grey level", "fringe_order": "1", "sigma_1_direction": "degree"}
"""Units of maps; of all others MPa."""

_WHAT = {
    "frames": "the camera's frames",
    "fringe_order": "fringe order N",
    "sigma_1_direction": "direction of sigma_1, counter-clockwise from x",
}


def picture_array(
    values: NDArray[Any], pixels: PixelGrid, name: str, said: Mapping[str, str]
) -> RunArray:
    """A picture (rows, cols) or (rows, cols, 3) with its axes in mm.

    Parameters: `values`; `pixels`; `name`; `said`, its attributes.
    """
    names = ("row", "col", "channel")[: values.ndim]
    places = picture_axes(pixels, coloured=values.ndim == 3)
    array: RunArray = make_dataset({name: Column(names, values, said)}, places, {})[name]
    return array


def picture_axes(pixels: PixelGrid, *, coloured: bool = False) -> dict[str, Column]:
    """Coordinates of a picture: row, col, z_mm, x_mm, and with red, green and blue channel."""
    units = {"units": "mm"}
    names = Column(("channel",), np.array(["red", "green", "blue"]), {})
    return {
        "row": Column(("row",), np.arange(pixels.rows), {"units": "pixel"}),
        "col": Column(("col",), np.arange(pixels.cols), {"units": "pixel"}),
        "z_mm": Column(("row",), pixels.z_mm, units | {"long_name": "z"}),
        "x_mm": Column(("col",), pixels.x_mm, units | {"long_name": "x"}),
    } | ({"channel": names} if coloured else {})


def simulation_dataset(
    scene: Scene,
    pixels: PixelGrid,
    history: Mapping[str, Sequence[Any]],
    maps: Mapping[str, NDArray[Any]],
) -> RunDataset:
    """Maps (state, row, col), frames and the history of all states.

    Parameters: `scene`; `pixels`; `history`, the columns of history.csv; `maps` by name, `frames`
    among them, a frame for each step of each state. Returns a RunDataset.
    """
    count = len(history["state"])
    columns = {name: column(list(own), "state", name) for name, own in history.items()}
    places = {name: columns.pop(name) for name in ("state", "label", "distance_m")}
    places |= picture_axes(pixels, coloured=maps["frames"].ndim == 4)
    for name, values in maps.items():
        stack = values.reshape(count, len(values) // count, *values.shape[1:])
        names: tuple[str, ...] = ("state", "step", "row", "col", "channel")[: stack.ndim]
        if stack.shape[1] == 1:
            stack, names = stack[:, 0], ("state", *names[2:])
        said = {"units": _UNITS.get(name, "MPa"), "long_name": _WHAT.get(name, name)}
        columns[name] = Column(names, stack, said)
    return make_dataset(columns, places, attributes({"scene": dump_scene(scene)}))
