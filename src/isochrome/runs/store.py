"""The zarr store of a run: pictures chunk by chunk, then the columns and what they came from."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.output import Floats, numbers
from isochrome.runs.integrity import PROVENANCE, opened_record, read_record, warn_unverified
from isochrome.runs.job import Compact, Layer, RunLayout

if TYPE_CHECKING:
    import xarray

    from isochrome.runs.datasets import RunDataset

STORE = "run.zarr"
WORKING = ".partial"
"""What follows the name of a run's folder in that of its working folder, beside it."""

WHOLE = "whole_number"
"""Attribute of a column of whole numbers, which is stored as floats where some are not known."""

_UNITS = {
    "n": "N", "mm": "mm", "mm2": "mm2", "um": "um", "nm": "nm", "m": "m", "s": "s",
    "px": "pixel", "deg": "degree", "mpa": "MPa", "gpa": "GPa",
}  # fmt: skip
"""Units as netCDF spells them, by how they stand in names."""


def create_store(path: Path, layout: RunLayout) -> None:
    """Lay out the store: an array for each layer with named axes, no picture in it yet.

    Chunks are plain little-endian float32 and a checksum, so that one that was computed elsewhere
    is put in its place as a file. Parameters: `path`, a folder; `layout`. Raises OSError.
    """
    import zarr
    from zarr.codecs import Crc32cCodec

    group = zarr.open_group(path, mode="w", zarr_format=3)
    for layer in layout.layers:
        if layer.compact is not None:
            _create_compact(group, layer, layer.compact, layout)
            continue
        group.create_array(
            layer.name,
            shape=(*layout.picture_axes.values(), *layout.shape.values()),
            chunks=layout.chunk_shape,
            dtype="float32",
            fill_value=np.nan,
            compressors=[Crc32cCodec()],
            dimension_names=tuple(map(identifier, (*layout.picture_axes, *layout.shape))),
            attributes={"units": layer.units, "long_name": layer.what},
        )


def _create_compact(group: Any, layer: Layer, compact: Compact, layout: RunLayout) -> None:
    """Lay out an array of whole steps over all items, a file for each chunk of the run."""
    shape = tuple(layout.shape.values())
    group.create_array(
        layer.name,
        shape=(layout.count, *shape),
        chunks=(layout.chunk, *shape),
        dtype=compact.dtype.name,
        fill_value=compact.unknown,
        serializer=compact.shards(shape),
        compressors=None,
        dimension_names=tuple(map(identifier, (*layout.axes, *layout.shape))),
        attributes={
            "units": layer.units, "long_name": layer.what,
            "scale_factor": compact.step, "_FillValue": compact.unknown,
        },
    )  # fmt: skip


@dataclass(frozen=True)
class Column:
    """What is known along some axes of a dataset.

    Parameters
    ----------
    axes : tuple of str
        Names of the axes.
    values : ndarray
        The values, an axis each.
    attributes : mapping
        Attributes, such as the units.
    """

    axes: tuple[str, ...]
    values: NDArray[Any]
    attributes: Mapping[str, Any]


def add_columns(
    path: Path,
    columns: Mapping[str, Column],
    coordinates: Mapping[str, Column],
    attributes: Mapping[str, Any],
) -> None:
    """Add columns, coordinates and attributes to a run's store.

    As xarray would, which is not asked, for it takes longer to start than all columns to write.
    Names become identifiers: load.normal_n is load_normal_n.

    Parameters
    ----------
    path : Path
        The store.
    columns : mapping of str to Column
        The columns, by name.
    coordinates : mapping of str to Column
        The coordinates, by name.
    attributes : mapping
        Attributes of all.

    Raises
    ------
    OSError
        Where the disk cannot be written or read.
    """
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec

    group = zarr.open_group(path, mode="r+", zarr_format=3)
    nothing = {"T": "", "f": np.nan}  # by the kind of value, else 0
    for name, column in {**coordinates, **columns}.items():
        own = identifier(name)
        group.create_array(
            own,
            data=column.values,
            chunks=tuple(max(1, size) for size in column.values.shape),
            fill_value=nothing.get(column.values.dtype.kind, 0),
            compressors=[ZstdCodec(), Crc32cCodec()],
            dimension_names=tuple(map(identifier, column.axes)),
            attributes=described(name, column),
        )
    # an axis' own coordinate is known by its name, the others have to be named
    beside = " ".join(
        identifier(name) for name, column in coordinates.items() if column.axes != (name,)
    )
    group.attrs.update({**attributes, **({"coordinates": beside} if beside else {})})


_PARTS = {
    " standard_uncertainty": "_u",
    " noise_uncertainty": "_u_noise",
    " cramer_rao_bound": "_bound",
}
"""What is known of a value besides itself, as it ends the name of a column."""


def identifier(name: str) -> str:
    """Give the name of a column in a dataset, which may stand in Python and MATLAB code.

    Parameters
    ----------
    name : str
        Name of a key or column of a table, such as `load.normal_n standard_uncertainty`.

    Returns
    -------
    str
        The same as an identifier, such as `load_normal_n_u`.
    """
    for words, ending in _PARTS.items():
        if name.endswith(words):
            name = name.removesuffix(words) + ending
    return re.sub(r"\W", "_", name)


def with_identifiers(dataset: xarray.Dataset) -> xarray.Dataset:
    """A dataset whose variables and axes are named by identifiers, of whatever version it is."""
    names = {str(name): identifier(str(name)) for name in (*dataset.variables, *dataset.sizes)}
    return dataset.rename({old: new for old, new in names.items() if old != new})


def described(name: str, column: Column) -> dict[str, Any]:
    """The attributes of a column in a dataset, where its name is another than in a table."""
    said = {} if identifier(name) == name else {"long_name": name}
    return said | dict(column.attributes)


def column(values: Sequence[Any], axis: str, name: str) -> Column:
    """Make a table's column: numbers as float64 or int64, all else as text.

    What is not known is NaN, or empty text.

    Parameters
    ----------
    values : sequence
        The values; None = not known.
    axis : str
        Name of the axis that they lie on.
    name : str
        Name of the column, in which the unit stands.

    Returns
    -------
    Column
        The column, with its units.
    """
    attributes = named_units(name)
    if isinstance(values, Floats):
        return Column((axis,), np.asarray(values), attributes)
    known = [value for value in values if value is not None]
    if all(isinstance(value, bool | int) for value in known) and known:
        if len(known) == len(values):
            return Column((axis,), np.array(values, dtype=np.int64), attributes)
        attributes[WHOLE] = 1
    if all(isinstance(value, bool | int | float) for value in known):
        return Column((axis,), numbers(values), attributes)
    return Column((axis,), texts(values), attributes)


def texts(values: Iterable[Any]) -> NDArray[Any]:
    """Make a column of texts.

    Parameters
    ----------
    values : iterable
        The values; None = not known.

    Returns
    -------
    ndarray of str, shape (n,)
        The texts, empty where one is not known.
    """
    return np.array(["" if v is None else str(v) for v in values], dtype=np.dtypes.StringDType())


def named_units(name: str) -> dict[str, Any]:
    """Give the unit that stands in a name as attributes of its column.

    Parameters
    ----------
    name : str
        Name of a key or column, such as `load.normal_n`.

    Returns
    -------
    dict
        The attribute 'units'; empty where no unit stands in the name.
    """
    units = units_of(name)
    return {} if units is None else {"units": units}


def units_of(name: str) -> str | None:
    """The unit that stands at the end of a key or column name, as netCDF spells it; or None."""
    stem = name.removesuffix(" standard_uncertainty").rsplit(".", 1)[-1]
    above, per, below = stem.partition("_per_")
    unit = _UNITS.get(above.rpartition("_")[2]) if "_" in above else None
    if not per:
        return unit
    return f"{unit} {_UNITS[below]}-1" if unit and below in _UNITS else None


def column_values(variable: xarray.DataArray) -> list[Any]:
    """Give the values that `column` was given.

    Parameters
    ----------
    variable : xarray.DataArray
        A column of a dataset.

    Returns
    -------
    list
        The values; None for what is not known of whole numbers.
    """
    values: list[Any] = variable.values.tolist()
    if variable.attrs.get(WHOLE):
        return [None if np.isnan(v) else int(v) for v in values]
    return values


def attributes(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Make attributes of a dataset of a run's identity: numbers and texts, tables as JSON.

    Parameters
    ----------
    identity : mapping
        What the run is a result of, as in a Job.

    Returns
    -------
    dict
        The attributes.
    """
    found: dict[str, Any] = {"Conventions": "CF-1.11", "source": "Isochrome"}
    for key, value in identity.items():
        if value is None:
            continue
        plain = isinstance(value, str | int | float)
        found[key] = value if plain else json.dumps(value, ensure_ascii=False)
    return found


def open_run(path: str | Path) -> RunDataset:
    """Open the dataset that a run left, read from the disk as it is used.

    Pictures are over (frame, z_mm, x_mm), row and col where no scale is known, those of a tracked
    video over key_frame, its key frames' numbers; the table's columns over frame, as identifiers:
    load_normal_n, its standard uncertainty load_normal_n_u. z_mm and x_mm are of the place that was
    found, of several frames the mean; a frame's own are x_mm + shift_x_mm, z_mm + shift_z_mm
    (key_shift_x_mm over key_frame). `.plot()` of a picture has z down, in mm.

    Parameters
    ----------
    path : str or Path
        The run's folder, or the run.zarr in it; of one at work OUT.partial: its maps are over
        (frame, row, col) yet, and `finished` says of which frames.

    Returns
    -------
    RunDataset
        The pictures and columns as an xarray.Dataset, with units; as attributes the resolved scene,
        hashes of the inputs, version and seed.

    Raises
    ------
    InputError
        Where no such run is there, or it cannot be read.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> found = isochrome.sweep(scene, {"load.normal_n": [60.0]}, "loads")
    >>> with isochrome.open_run("loads") as run:
    ...     order = run.fringe_order.sel(load_normal_n=60.0, state=0).load()
    >>> order.dims
    ('z_mm', 'x_mm')
    >>> print(f"{order.sel(x_mm=0.0, z_mm=9.0, method='nearest').item():.2f} fringes")
    0.78 fringes
    """
    from isochrome.runs.datasets import as_run, open_growing

    growing = Path(path).name.endswith(WORKING)
    return as_run(open_growing(Path(path)) if growing else open_store(path))


def open_store(path: str | Path) -> xarray.Dataset:
    """The dataset that a run left, its pictures over row and col. Raises InputError.

    All its files are there with their sizes, and the checksum of what is read is looked at.
    """
    place = Path(path)
    store = place if place.suffix == ".zarr" else place / STORE
    if not (store / "zarr.json").is_file() and read_record(store.parent) is None:
        unfinished = place.with_name(place.name + WORKING).is_dir()
        hint = (
            "the run is not finished: run the same command again to resume, or open "
            f"{place.name}{WORKING} to see what is there"
            if unfinished
            else "name a folder that process or sweep left"
        )
        raise InputError(f"{place}: holds no {STORE}; {hint}")
    if store != place and read_record(place) is None:
        raise InputError(
            f"{place}: holds no {PROVENANCE}, by which its files could be told; run the command "
            f"that left it again, or name {store} itself"
        )
    return read_store(store, checked_store(store))


def checked_store(store: Path) -> Any:
    """What zarr reads a store from: of results, the files that were left, as they were left.

    A store away from its results is read as it is, which is said as a warning; so is an older one.
    Raises InputError where a file is missing or of another size.
    """
    record = opened_record(store.parent)
    if record is None:
        warn_unverified(store)
    if record is None or record.older:
        return store
    if f"{store.name}/zarr.json" not in record.sizes:
        raise InputError(f"{store.parent}: holds no {store.name}; name a folder that process left")
    from isochrome.runs.verified_store import VerifiedStore

    return VerifiedStore(store, record)


def read_store(store: Path, source: Any) -> xarray.Dataset:
    """A store as a dataset, read as it is used. Raises InputError where it cannot be read.

    Parameters: `store`, for messages; `source`, from which zarr reads it.
    """
    import xarray

    try:
        stored = xarray.open_dataset(
            source, engine="zarr", consolidated=False, chunks=None, decode_cf=False
        )
        for array in stored.variables.values():
            if "scale_factor" in array.attrs:  # maps in whole steps are single precision
                array.attrs["scale_factor"] = np.float32(array.attrs["scale_factor"])
        found = xarray.decode_cf(stored)
        found.set_close(stored.close)
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{store}: cannot be read ({error}); run the command again with --restart"
        ) from error
    lost = [array for array in _arrays(store) if array not in found.variables]
    if lost and isinstance(source, Path):  # else what is not in the record is no part of it
        found.close()
        raise InputError(f"{store}: {lost[0]} cannot be read; run the command again with --restart")
    return found


def _arrays(store: Path) -> list[str]:
    """What stands in a store, whether or not zarr can read it: what it cannot, it leaves out."""
    return [file.parent.name for file in sorted(store.glob("*/zarr.json")) if not _is_group(file)]


def _is_group(file: Path) -> bool:
    """Whether a description is that of a group, which somebody else has put there."""
    try:
        return bool(json.loads(file.read_bytes())["node_type"] == "group")
    except (OSError, ValueError, KeyError, TypeError):
        return False
