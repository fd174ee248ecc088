"""A run's maps and columns as xarray has them, with axes in mm, drawn the right way up."""

from __future__ import annotations

import operator
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


class _OnePlace:
    """Arithmetic of maps that show one place: others are refused, where xarray gives no pixel."""

    __slots__ = ()

    def _binary_op(self, other: Any, f: Any, *more: Any, **named: Any) -> Any:
        _refuse_other_places(self, other)
        return _of_run(super()._binary_op(other, f, *more, **named))  # type: ignore[misc]

    def _inplace_binary_op(self, other: Any, f: Any) -> Any:
        _refuse_other_places(self, other)
        return super()._inplace_binary_op(other, f)  # type: ignore[misc]

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **named: Any) -> Any:
        """As xarray has it."""
        for other in inputs:
            _refuse_other_places(self, other)
        found = super().__array_ufunc__(ufunc, method, *inputs, **named)  # type: ignore[misc]
        return _of_run(found)

    # on the right of an array that is no run's, Python asks these first, for they are not xarray's
    def __radd__(self, other: Any) -> Any:
        """As xarray has it."""
        return self._binary_op(other, operator.add, reflexive=True)

    def __rsub__(self, other: Any) -> Any:
        """As xarray has it."""
        return self._binary_op(other, operator.sub, reflexive=True)

    def __rmul__(self, other: Any) -> Any:
        """As xarray has it."""
        return self._binary_op(other, operator.mul, reflexive=True)

    def __rtruediv__(self, other: Any) -> Any:
        """As xarray has it."""
        return self._binary_op(other, operator.truediv, reflexive=True)


class RunArray(_OnePlace, xarray.DataArray):
    """A map or column of a run: an xarray.DataArray whose `.plot()` has z down, in mm.

    Of two maps pixels of one place are added, subtracted, compared; maps of other places are
    refused (InputError).

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


class RunDataset(_OnePlace, xarray.Dataset):
    """What a run found: an xarray.Dataset of RunArrays, and as these of one place.

    Parameters
    ----------
    data_vars, coords, attrs : Any
        As xarray.Dataset takes them.
    """

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:
        """A variable, or a part of the dataset."""
        return _of_run(super().__getitem__(key))


def _of_run(found: Any) -> Any:
    """What xarray made of a run's arrays, as a run's."""
    if type(found) is xarray.Dataset:
        return RunDataset(dict(found.data_vars), dict(found.coords), found.attrs)
    return RunArray(found) if type(found) is xarray.DataArray else found


def _refuse_other_places(one: Any, other: Any) -> None:
    """Refuse two maps whose pixels show other places. Raises InputError.

    A part of a map may be held against the whole: its pixels are found there, by their places.
    """
    if one is other or not isinstance(other, xarray.DataArray | xarray.Dataset):
        return
    wide = [set(each.sizes) for each in (one, other)]
    if any(a & set(_PICTURE[0]) and b & set(_PICTURE[1]) for a, b in (wide, wide[::-1])):
        raise InputError(
            f"{_called(one)} is over {', '.join(map(str, one.dims))} and {_called(other)} over "
            f"{', '.join(map(str, other.dims))}: one has no scale; state its camera.pixel_mm"
        )
    for axis in set(one.indexes) & set(other.indexes) & set(_PICTURE[0]):
        here, there = one.indexes[axis], other.indexes[axis]
        few, many = sorted((here, there), key=len)
        if not few.isin(many).all():
            raise InputError(
                f"{_called(one)} has {axis} from {_span(one, axis)} and {_called(other)} from "
                f"{_span(other, axis)}: their pixels show other places; simulate the place that "
                "was found, isochrome.simulate(found.fitted), or hold frames against each other "
                "pixel by pixel with isochrome.compare"
            )
        apart = np.abs(_shift(one, axis) - _shift(other, axis))
        if len(many) > 1 and bool((apart > 0.5 * (many[-1] - many[0]) / (len(many) - 1)).any()):
            raise InputError(
                f"{_called(one)} and {_called(other)} are of frames whose places lie up to "
                f"{float(apart.max()):.4g} mm apart (shift_{axis}), over half a pixel: process "
                "such a frame by itself, or drop the coordinate shift_"
                f"{axis} to hold them against each other pixel by pixel"
            )


def _called(one: Any) -> str:
    return str(getattr(one, "name", None) or "a map")


def _span(one: Any, axis: str) -> str:
    """The places along an axis, and how many pixels the map has."""
    places, size = one.indexes[axis], (one.sizes.get(name, 1) for name in _PICTURE[0])
    return f"{places[0]:.6g} to {places[-1]:.6g} mm ({' x '.join(map(str, size))} pixels)"


def _shift(one: Any, axis: str) -> Any:
    """How far (mm) the frames of a map lie from its axis; 0 where there is one place."""
    names = (f"shift_{axis}", f"key_shift_{axis}")
    found = next((one.coords[name] for name in names if name in one.coords), None)
    return xarray.DataArray(0.0) if found is None else found.drop_vars(names, errors="ignore")


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
