"""The zarr store of a run: pictures chunk by chunk, then the columns and what they came from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import InputError
from isochrome.runs.job import Layout

if TYPE_CHECKING:
    import xarray

STORE = "run.zarr"
WHOLE = "whole_number"
"""Attribute of a column of whole numbers, which is stored as floats where some are not known."""

_UNITS = ("_per_n", "_n", "_mm", "_px", "_mpa", "_gpa", "_deg", "_um", "_m", "_s", "_nm")


def create_store(path: Path, layout: Layout) -> None:
    """Lay out the store: an array for each layer with named axes, no picture in it yet.

    Chunks are plain little-endian float32, so that one that was computed elsewhere is put in its
    place as a file. Parameters: `path`, a folder; `layout`. Raises OSError.
    """
    import zarr

    group = zarr.open_group(path, mode="w", zarr_format=3)
    for layer in layout.layers:
        group.create_array(
            layer.name,
            shape=(*layout.picture_axes.values(), *layout.shape.values()),
            chunks=layout.chunk_shape,
            dtype="float32",
            fill_value=np.nan,
            compressors=None,
            dimension_names=(*layout.picture_axes, *layout.shape),
            attributes={"units": layer.units, "long_name": layer.what},
        )


def add_columns(path: Path, columns: xarray.Dataset) -> None:
    """Add coordinates, columns and attributes to a run's store.

    Parameters: `path` of the store; `columns`, small enough for memory. Raises OSError.
    """
    columns.to_zarr(path, mode="a", zarr_format=3, consolidated=False)


def column(values: list[Any], axis: str, name: str) -> Any:
    """A table's column as an xarray variable: numbers as float64 or int64, all else as text.

    What is not known is NaN, or empty text. Parameters: `values`; `axis` that they lie on; `name`,
    in which the unit stands.
    """
    import xarray

    known = [value for value in values if value is not None]
    attributes: dict[str, Any] = {}
    units = units_of(name)
    if units is not None:
        attributes["units"] = units
    if all(isinstance(value, bool | int) for value in known) and known:
        if len(known) == len(values):
            return xarray.Variable(axis, np.array(values, dtype=np.int64), attributes)
        attributes[WHOLE] = 1
    if all(isinstance(value, bool | int | float) for value in known):
        data = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
        return xarray.Variable(axis, data, attributes)
    texts = np.array(["" if v is None else str(v) for v in values], dtype=object)
    return xarray.Variable(axis, texts, attributes)


def units_of(name: str) -> str | None:
    """The unit that stands at the end of a key or column name, as netCDF spells it; or None."""
    stem = name.removesuffix(" standard_uncertainty").rsplit(".", 1)[-1]
    if stem.endswith("_mm2_per_n"):
        return "mm2 N-1"
    if stem.endswith("_n_per_mm"):
        return "N mm-1"
    names = {"n": "N", "mpa": "MPa", "gpa": "GPa", "px": "pixel", "deg": "degree"}
    for ending in sorted(_UNITS, key=len, reverse=True):
        if stem.endswith(ending):
            return names.get(ending[1:], ending[1:])
    return None


def values_of(variable: xarray.DataArray) -> list[Any]:
    """The values that `column` was given; None for what is not known of texts and whole numbers."""
    values: list[Any] = variable.values.tolist()
    if variable.attrs.get(WHOLE):
        return [None if np.isnan(v) else int(v) for v in values]
    return values


def attributes(identity: Mapping[str, Any]) -> dict[str, Any]:
    """A run's identity as attributes of its dataset: numbers and texts, tables as JSON."""
    found: dict[str, Any] = {"Conventions": "CF-1.11", "source": "Isochrome"}
    for key, value in identity.items():
        if value is None:
            continue
        plain = isinstance(value, str | int | float)
        found[key] = value if plain else json.dumps(value, ensure_ascii=False)
    return found


def open_run(path: str | Path) -> xarray.Dataset:
    """The dataset that a run left, read from the disk as it is used.

    Parameters: `path`, the run's folder, or the run.zarr in it. Returns an xarray.Dataset: the
    pictures over (frame, row, col), those of a tracked video over (key_frame, row, col), the frame
    numbers of its key frames; the columns of the table over frame, coordinates z_mm, x_mm,
    distance_m and time_s; as attributes the resolved scene, hashes of the inputs, version and seed.
    Raises InputError where no finished run is there.
    """
    place = Path(path)
    store = place if place.suffix == ".zarr" else place / STORE
    if not (store / "zarr.json").is_file():
        unfinished = place.with_name(f"{place.name}.partial").is_dir()
        hint = (
            "the run is not finished: the command that began it goes on with it"
            if unfinished
            else "name a folder that process or sweep left"
        )
        raise InputError(f"{place}: holds no {STORE}; {hint}")
    import xarray

    try:
        return xarray.open_dataset(store, engine="zarr", consolidated=False, chunks=None)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{store}: cannot be read ({error}); run the command again") from error
