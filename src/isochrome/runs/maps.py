"""A run's maps and columns as xarray has them: as they were left, drawn the right way up, and of
one place. A module of its own, for xarray takes longer to start than most commands that only write.
"""

from __future__ import annotations

import asyncio
import operator
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from xarray.plot.accessor import DataArrayPlotAccessor
from zarr.abc.store import ByteRequest, OffsetByteRequest, RangeByteRequest
from zarr.core.buffer import Buffer, BufferPrototype, cpu
from zarr.storage import LocalStore

from isochrome.errors import InputError
from isochrome.runs.integrity import ResultsRecord

PICTURE = (("z_mm", "x_mm"), ("row", "col"))
"""The two axes of a picture: in mm, or where no scale is known in pixels."""


class MapPlot(DataArrayPlotAccessor):
    """xarray's `.plot`, with z down and true proportions where it draws a picture."""

    __slots__ = ()

    def __call__(self, **kwargs: Any) -> Any:  # type: ignore[override]
        """Draw as xarray does, a picture the right way up."""
        shape = [name for name, size in self._da.sizes.items() if size > 1]
        pictured = any(set(pair) <= set(shape) for pair in PICTURE)
        drawn_as_one = len(shape) == 2 or {"row", "col"} & set(kwargs)
        if not (pictured and drawn_as_one):
            return super().__call__(**kwargs)  # a line, or a histogram
        drawn = super().__call__(**({"yincrease": False} | kwargs))
        facets = getattr(drawn, "axs", None)
        for axes in [drawn.axes] if facets is None else facets.flat:
            if "aspect" not in kwargs:
                axes.set_aspect("equal")
        return drawn


def _reflected(operation: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """An operation of xarray's as the array on the right of it has it."""
    return lambda self, other: self._binary_op(other, operation, reflexive=True)


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
        result = super().__array_ufunc__(ufunc, method, *inputs, **named)  # type: ignore[misc]
        return _of_run(result)

    # on the right of an array that is no run's, Python asks these first, for they are not xarray's
    __radd__ = _reflected(operator.add)
    __rsub__ = _reflected(operator.sub)
    __rmul__ = _reflected(operator.mul)
    __rtruediv__ = _reflected(operator.truediv)


class RunArray(_OnePlace, xarray.DataArray):
    """A map or column of a run: an xarray.DataArray whose `.plot()` has z down, in mm.

    Of two maps pixels of one place are added, subtracted, compared; maps of other places are
    refused (InputError).
    """

    __slots__ = ()

    @property
    def plot(self) -> MapPlot:  # type: ignore[override]
        """See `xarray.DataArray.plot`."""
        return MapPlot(self)


class RunDataset(_OnePlace, xarray.Dataset):
    """What a run found: an xarray.Dataset of RunArrays, and as these of one place."""

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:
        """A variable, or a part of the dataset."""
        return _of_run(super().__getitem__(key))


def _of_run(data: Any) -> Any:
    if type(data) is xarray.Dataset:
        return RunDataset(dict(data.data_vars), dict(data.coords), data.attrs)
    return RunArray(data) if type(data) is xarray.DataArray else data


def _refuse_other_places(one: Any, other: Any) -> None:
    """Refuse two maps whose pixels show other places; a part may be held against the whole."""
    if one is other or not isinstance(other, xarray.DataArray | xarray.Dataset):
        return
    wide = [set(each.sizes) for each in (one, other)]
    if any(a & set(PICTURE[0]) and b & set(PICTURE[1]) for a, b in (wide, wide[::-1])):
        raise InputError(
            "over_over_one_has", called=_called(one), dims=", ".join(map(str, one.dims)),
            called_2=_called(other), dims_2=", ".join(map(str, other.dims)),
        )  # fmt: skip
    for axis in set(one.indexes) & set(other.indexes) & set(PICTURE[0]):
        here, theirs = one.indexes[axis], other.indexes[axis]
        few, many = sorted((here, theirs), key=len)
        if not few.isin(many).all():
            raise InputError(
                "has_from_from_their", called=_called(one), axis=axis, span=_span(one, axis),
                called_2=_called(other), span_2=_span(other, axis),
            )  # fmt: skip
        apart = np.abs(_shift(one, axis) - _shift(other, axis))
        if len(many) > 1 and bool((apart > 0.5 * (many[-1] - many[0]) / (len(many) - 1)).any()):
            raise InputError(
                "frames_whose_places_lie", called=_called(one), called_2=_called(other),
                max=float(apart.max()), axis=axis,
            )  # fmt: skip


def _called(one: Any) -> str:
    return str(getattr(one, "name", None) or "a map")


def _span(one: Any, axis: str) -> str:
    """The places along an axis, and how many pixels the map has."""
    places, size = one.indexes[axis], (one.sizes.get(name, 1) for name in PICTURE[0])
    return f"{places[0]:.6g} to {places[-1]:.6g} mm ({' x '.join(map(str, size))} pixels)"


def _shift(one: Any, axis: str) -> Any:
    """How far (mm) the frames of a map lie from its axis; 0 where there is one place."""
    names = (f"shift_{axis}", f"key_shift_{axis}")
    shift = next((one.coords[name] for name in names if name in one.coords), None)
    return xarray.DataArray(0.0) if shift is None else shift.drop_vars(names, errors="ignore")


class VerifiedStore(LocalStore):
    """A store that is read alone, and holds what is read against the record of its results. A file
    of which a part is asked for is read whole: its checksum in the record is that of all."""

    def __init__(self, root: Path, record: ResultsRecord) -> None:
        super().__init__(root, read_only=True)
        self._record = record

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """What a key holds, or a part of it; None where it is no file of the results."""
        return await asyncio.to_thread(self.get_sync, key, byte_range=byte_range)

    def get_sync(
        self,
        key: str,
        *,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """The same without an event loop, as later versions of zarr read."""
        name = f"{self.root.name}/{key}"
        if name not in self._record.sizes:
            return None
        part = slice(None)
        if isinstance(byte_range, RangeByteRequest):
            part = slice(byte_range.start, byte_range.end)
        elif isinstance(byte_range, OffsetByteRequest):
            part = slice(byte_range.offset, None)
        elif byte_range is not None:
            part = slice(-byte_range.suffix, None)
        return cpu.Buffer(self._record.read(name, part))

    async def list_dir(self, prefix: str) -> AsyncIterator[str]:
        """The names below a prefix that are of the results."""
        start = f"{self.root.name}/{prefix.strip('/')}".rstrip("/") + "/"
        below = [n.removeprefix(start) for n in self._record.sizes if n.startswith(start)]
        for name in sorted({name.partition("/")[0] for name in below}):
            yield name
