"""A run's dataset for other programs: netCDF for MATLAB, TIFF for ImageJ, CSV for all."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome import output
from isochrome.errors import InputError, reason_of
from isochrome.runs.integrity import name_damage
from isochrome.runs.job import STORE
from isochrome.runs.store import open_store, with_identifiers

if TYPE_CHECKING:
    import xarray

FORMATS = ("netcdf", "tiff", "csv", "excel")
_LOOKED_AT = 50
"""Pictures of a map whose values are looked at for its range in ImageJ."""
_PICTURE = ("row", "col")


def export(run: str | Path, to: str, out: str | Path | None = None) -> list[Path]:
    """Write a run's dataset in another program's format, a picture in memory at a time.

    What `process`, `fit` or `sweep` left in run.zarr is written for MATLAB, ImageJ or a
    spreadsheet.

    Parameters
    ----------
    run : str or Path
        Folder that process or sweep left.
    to : {'netcdf', 'tiff', 'csv', 'excel'}
        'netcdf', one netCDF-4 file with all axes, units and attributes, which MATLAB's ncread
        opens; 'tiff', a stack of each map, with its scale, time step and labels where ImageJ looks
        for them; 'csv', the table of all that is known besides pictures, a row for each frame or
        state; 'excel', the same as a German or French Excel opens it.
    out : str or Path, optional
        Folder for the files; by default the run's own.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        Where the format is unknown, the run is not there, or a library is missing.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> found = isochrome.sweep(scene, {"load.normal_n": [60.0]}, "loads")
    >>> [file.name for file in isochrome.export("loads", "csv")]
    ['run.csv']
    """
    if to not in FORMATS:
        raise InputError("no_format_known_here", to=to, formats=", ".join(FORMATS))
    place = Path(run)
    target = Path(out) if out is not None else place
    with open_store(place) as stored, output.staged(target) as folder:
        dataset = with_identifiers(stored)
        try:
            files = _write(dataset, to, folder)
        except (ValueError, KeyError, TypeError, IndexError, RuntimeError) as error:
            if isinstance(error, InputError):
                raise
            name_damage(place)
            raise InputError(
                "cannot_read_run_command", store=place / STORE, reason=reason_of(error)
            ) from error
        return [target / file.relative_to(folder) for file in files]


def _write(dataset: xarray.Dataset, to: str, folder: Path) -> list[Path]:
    """The dataset's files of a format."""
    if to == "netcdf":
        return [_to_netcdf(dataset, folder / "run.nc")]
    if to == "tiff":
        names = (n for n in sorted(dataset.data_vars, key=str) if _is_picture(dataset[n]))
        return [_to_tiff(dataset, str(name), folder / "imagej") for name in names]
    table = _to_csv(dataset, folder / "run.csv")
    if to == "csv":
        return [table]
    copies = output.write_excel_copies(folder)
    table.unlink()
    return copies


def _is_picture(variable: xarray.DataArray) -> bool:
    return variable.dims[-2:] == _PICTURE


def _blocks(variable: xarray.DataArray) -> Iterator[tuple[tuple[int, ...], np.ndarray]]:
    """A variable's parts, each with its place: single pictures, or else all at once.

    What the store keeps together is read together, else it would be read for each picture.
    """
    if not _is_picture(variable):
        yield (), np.asarray(variable.values)
        return
    count, *others = variable.shape[:-2]
    together = _kept_together(variable)
    for start in range(0, count, together):
        values = np.asarray(variable[start : start + together].values)
        for k in range(len(values)):
            for place in product(*(range(size) for size in others)):
                yield (start + k, *place), values[(k, *place)]


def _to_netcdf(dataset: xarray.Dataset, path: Path) -> Path:
    try:
        import h5netcdf
        import h5py
    except ImportError as error:
        raise InputError("netcdf_needs_packages_netcdf") from error
    with output.replacing(path) as beside, h5netcdf.File(beside, "w") as file:
        file.dimensions = dict(dataset.sizes)
        for name, value in dataset.attrs.items():
            file.attrs[str(name)] = value
        for name in sorted(dataset.variables, key=str):
            array = dataset[name]
            text = array.dtype.kind not in "iuf"
            kind = h5py.string_dtype() if text else array.dtype
            chunks = (*(1 for _ in array.dims[:-2]), *array.shape[-2:])
            made = file.create_variable(
                str(name), array.dims, kind, chunks=chunks if _is_picture(array) else None
            )
            for key, value in array.attrs.items():
                made.attrs[str(key)] = value
            # a coordinate beside the axes has to be named by the variables that it belongs to
            if name not in dataset.coords:
                made.attrs["coordinates"] = " ".join(
                    str(c)
                    for c in sorted(dataset.coords, key=str)
                    if c not in dataset.sizes and set(dataset[c].dims) <= set(array.dims)
                )
            for place, values in _blocks(array):
                made[place or ...] = values.astype(object) if text else values
    return path


def _to_csv(dataset: xarray.Dataset, path: Path) -> Path:
    names = [*sorted(dataset.coords, key=str), *sorted(dataset.data_vars, key=str)]
    flat = [name for name in names if not set(_PICTURE) & set(dataset[name].dims)]
    # of a tracked video the pictures have an axis of their own, which says nothing of its frames
    own_axes = set().union(*(dataset[name].dims for name in flat if name in dataset.data_vars))
    axes = [axis for axis in dataset.sizes if axis in own_axes]
    flat = [name for name in flat if set(dataset[name].dims) <= own_axes]
    shape = tuple(dataset.sizes[axis] for axis in axes)
    columns: dict[str, Any] = {}
    for name in dict.fromkeys([*axes, *flat]):
        coordinate = dataset[name]  # an axis without a coordinate counts from 0
        spread = [dataset.sizes[axis] if axis in coordinate.dims else 1 for axis in axes]
        values = np.broadcast_to(coordinate.values.reshape(spread), shape)
        columns[str(name)] = values.ravel().tolist()
    output.write_csv(path, columns)
    return path


def _to_tiff(dataset: xarray.Dataset, name: str, folder: Path) -> Path:
    array = dataset[name]
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.tif"
    shape = (int(np.prod(array.shape[:-2])), *array.shape[-2:])
    pixel = None  # its side (mm), by the coordinates of the columns
    if "x_mm" in dataset.coords and dataset.sizes["col"] > 1:
        x = dataset.x_mm.values
        pixel = float((x[-1] - x[0]) / (len(x) - 1))
    view = output.imagej_view(
        name, _span(array), labels=_labels(dataset, array), pixel_mm=pixel,
        left_mm=_edge(dataset, "x_mm", pixel),
        top_mm=_edge(dataset, "z_mm", pixel),
        times_s=_of_pictures(dataset, "time_s", array),
    )  # fmt: skip
    pictures = (values for _, values in _blocks(array))
    output.write_frames(path, pictures, shape, np.dtype("<f4"), pixel_mm=pixel, metadata=view)
    return path


def _span(array: xarray.DataArray) -> tuple[float, float]:
    """Smallest and largest value of a map, of many pictures in some that the store keeps together.

    Those are evenly spaced.
    """
    together = _kept_together(array)
    wanted = output.evenly_spaced(range(len(array)), _LOOKED_AT)
    ends = list[float]()
    for start in sorted({together * (k // together) for k in wanted}):
        values = np.asarray(array[start : start + together].values)
        known = values[np.isfinite(values)]
        ends += [float(known.min()), float(known.max())] if known.size else []
    return (min(ends), max(ends)) if ends else (0.0, 1.0)


def _kept_together(array: xarray.DataArray) -> int:
    """How many pictures of its first axis lie in a chunk of the store."""
    return int((array.encoding.get("chunks") or (1,))[0])


def _edge(dataset: xarray.Dataset, axis: str, pixel_mm: float | None) -> float | None:
    """Outer edge of the first column or row, mm; None where no place is known."""
    if pixel_mm is None or axis not in dataset.coords:
        return None
    return float(dataset[axis].values[0]) - 0.5 * pixel_mm


def _labels(dataset: xarray.Dataset, array: xarray.DataArray) -> list[str]:
    """What ImageJ shows above each slice."""
    if (labels := _of_pictures(dataset, "label", array)) is not None:
        return [str(text) for text in labels]
    axes = array.dims[:-2]
    values = [dataset[axis].values if axis in dataset.coords else None for axis in axes]
    names = [dataset[axis].attrs.get("long_name", axis) for axis in axes]
    return [
        ", ".join(
            f"{name} = {k if axis_values is None else f'{axis_values[k]:.6g}'}"
            for name, axis_values, k in zip(names, values, place, strict=True)
        )
        for place in product(*(range(size) for size in array.shape[:-2]))
    ]


def _of_pictures(dataset: xarray.Dataset, name: str, array: xarray.DataArray) -> Any:
    """A coordinate's values, one for each picture of an array; None where it has none of them."""
    if name not in dataset.coords or dataset[name].ndim != 1 or array.ndim != 3:
        return None
    (frame_axis,), axis = dataset[name].dims, array.dims[0]
    values = dataset[name].values
    if axis == f"key_{frame_axis}":  # pictures of some of the frames
        return values[dataset[axis].values]
    return values if axis == frame_axis else None
