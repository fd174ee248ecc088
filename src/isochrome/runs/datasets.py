"""A run's maps and columns as xarray has them, with axes in mm, drawn the right way up."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray
from xarray.plot.accessor import DataArrayPlotAccessor

from isochrome.errors import InputError
from isochrome.runs.chunks import MANIFEST, RECORDS, read_checked
from isochrome.runs.store import (
    STORE,
    Column,
    column,
    described,
    read_store,
    with_identifiers,
)

_PICTURE = (("z_mm", "x_mm"), ("row", "col"))
"""The two axes of a picture: in mm, or where no scale is known in pixels."""


class MapPlot(DataArrayPlotAccessor):
    """xarray's `.plot`, with z down and true proportions where it draws a picture."""

    __slots__ = ()

    def __call__(self, **kwargs: Any) -> Any:  # type: ignore[override]
        """Draw as xarray does, a picture the right way up."""
        shape = [name for name, size in self._da.sizes.items() if size > 1]
        pictured = any(set(pair) <= set(shape) for pair in _PICTURE)
        drawn_as_one = len(shape) == 2 or {"row", "col"} & set(kwargs)
        if not (pictured and drawn_as_one):
            return super().__call__(**kwargs)  # a line, or a histogram
        drawn = super().__call__(**({"yincrease": False} | kwargs))
        facets = getattr(drawn, "axs", None)
        for axes in [drawn.axes] if facets is None else facets.flat:
            if "aspect" not in kwargs:
                axes.set_aspect("equal")
        return drawn


class RunArray(xarray.DataArray):
    """A map or column of a run: an xarray.DataArray whose `.plot()` has z down, in mm.

    Parameters
    ----------
    data, coords, dims, name, attrs, indexes, fastpath : Any
        As xarray.DataArray takes them.
    """

    __slots__ = ()

    @property
    def plot(self) -> MapPlot:  # type: ignore[override]
        """See `xarray.DataArray.plot`."""
        return MapPlot(self)


class RunDataset(xarray.Dataset):
    """What a run found: an xarray.Dataset of RunArrays.

    Parameters
    ----------
    data_vars, coords, attrs : Any
        As xarray.Dataset takes them.
    """

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:
        """A variable, or a part of the dataset."""
        found = super().__getitem__(key)
        return RunArray(found) if type(found) is xarray.DataArray else found


def make_dataset(
    columns: Mapping[str, Column], coordinates: Mapping[str, Column], attributes: Mapping[str, Any]
) -> RunDataset:
    """Make a dataset of maps and columns that are in memory, as `open_run` opens one.

    Parameters
    ----------
    columns : mapping of str to Column
        The maps and columns, by name.
    coordinates : mapping of str to Column
        The coordinates, by name.
    attributes : mapping
        Attributes of all.

    Returns
    -------
    RunDataset
        The dataset, with the axes z_mm and x_mm where these are known.
    """
    data, places = (
        {name: (own.axes, own.values, described(name, own)) for name, own in part.items()}
        for part in (columns, coordinates)
    )
    return as_run(xarray.Dataset(data, places, dict(attributes)))


def as_run(dataset: xarray.Dataset) -> RunDataset:
    """Give a run's dataset names that are identifiers, and its pictures axes in mm.

    Parameters
    ----------
    dataset : xarray.Dataset
        As it is stored, by this version or an earlier one.

    Returns
    -------
    RunDataset
        The same data, not read yet where they were not.
    """
    found = with_identifiers(dataset)
    axes = {
        pixel: place
        for place, pixel in zip(*_PICTURE, strict=True)
        if place in found.coords and found[place].dims == (pixel,)
    }
    found = found.swap_dims(axes)
    made = RunDataset(dict(found.data_vars), dict(found.coords), found.attrs)
    made.set_close(dataset.close)
    return made


def stored_map(array: Any, *, item: int, picture: int) -> NDArray[Any]:
    """Read one map of a store's array as numbers, however it is kept.

    Parameters
    ----------
    array : zarr.Array
        A layer's array.
    item : int
        Number of the item.
    picture : int
        Number of its picture, where only some items have one.

    Returns
    -------
    ndarray of float32, shape (rows, cols)
        The map, NaN = not known.
    """
    step = array.attrs.get("scale_factor")
    if step is None:
        return np.asarray(array[picture])
    steps = np.asarray(array[item])
    known = steps != array.fill_value
    return np.where(known, steps * np.float32(step), np.nan).astype(np.float32)


def open_growing(partial: Path) -> xarray.Dataset:
    """The dataset of a run that is at work, as far as it is: maps over row and col.

    Parameters: `partial`, its working folder. Maps and columns of frames that are not finished are
    not known; `finished` says which are. Raises InputError where no run is at work there.
    """
    stores = sorted(partial.glob(f"results-*/{STORE}/zarr.json"), key=lambda f: f.stat().st_mtime)
    manifest = read_checked(partial / MANIFEST)
    if not stores or manifest is None:
        raise InputError(f"{partial}: no run is at work there; name a folder that process left")
    layout = manifest["layout"]
    if len(layout["axes"]) != 1:
        raise InputError(f"{partial}: can be opened when it is finished; it is a grid of runs")
    ((axis, count),) = layout["axes"].items()
    rows: dict[int, dict[str, Any]] = {}
    for file in sorted((stores[-1].parent.parent / RECORDS).glob("*.json")):
        record = read_checked(file)
        if record is not None:
            rows |= dict(enumerate(record["rows"], int(file.stem) * layout["chunk"]))
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    columns = {
        name: column([rows.get(k, {}).get(name) for k in range(count)], axis, name)
        for name in names
    }
    columns["finished"] = Column((axis,), np.array([k in rows for k in range(count)]), {})
    columns[axis] = Column((axis,), np.arange(count), {})
    found = read_store(stores[-1].parent, stores[-1].parent)
    own = {n: (c.axes, c.values, described(n, c)) for n, c in columns.items()}
    return found.assign(own).set_coords(axis)
