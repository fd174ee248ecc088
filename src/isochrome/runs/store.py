"""The zarr store of a run: pictures chunk by chunk, then the columns; and its dataset for other
programs: netCDF for MATLAB, TIFF for ImageJ, CSV for all."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome import output
from isochrome.errors import InputError, reason_of
from isochrome.messages import message
from isochrome.runs import integrity
from isochrome.runs.job import MANIFEST, RECORDS, STORE, Layer, RunFolder, RunLayout

# xarray is imported where it is used: it takes longer to start than all that is written here
if TYPE_CHECKING:
    import xarray

    from isochrome.runs.maps import RunDataset


def make_dataset(
    columns: Mapping[str, Column], coordinates: Mapping[str, Column], attributes: Mapping[str, Any]
) -> RunDataset:
    """Make a dataset of maps and columns that are in memory, as `open_run` opens one."""
    return as_run(_dataset(columns, coordinates, attributes))


def _dataset(
    columns: Mapping[str, Column],
    coordinates: Mapping[str, Column],
    attributes: Mapping[str, Any] | None = None,
) -> xarray.Dataset:
    import xarray

    return xarray.Dataset(_variables(columns), _variables(coordinates), attributes)


def _variables(columns: Mapping[str, Column]) -> dict[str, tuple[tuple[str, ...], Any, Any]]:
    """Axes, values and attributes of columns by identifiers, their own names in the attributes."""
    variables = {}
    for name, column in columns.items():
        about = {} if identifier(name) == name else {"long_name": name}
        axes = tuple(map(identifier, column.axes))
        variables[identifier(name)] = axes, column.values, about | dict(column.attributes)
    return variables


def as_run(dataset: xarray.Dataset) -> RunDataset:
    """Give a run's dataset, of any version, names that are identifiers, and pictures axes in mm."""
    from isochrome.runs.maps import PICTURE, RunDataset

    named = with_identifiers(dataset)
    axes = {
        pixel: place
        for place, pixel in zip(*PICTURE, strict=True)
        if place in named.coords and named[place].dims == (pixel,)
    }
    named = named.swap_dims(axes)
    made = RunDataset(dict(named.data_vars), dict(named.coords), named.attrs)
    made.set_close(dataset.close)
    return made


def open_growing(partial: Path) -> xarray.Dataset:
    """The dataset of a run at work, as far as it is, over row and col; `finished` says which
    frames."""
    stores = sorted(partial.glob(f"results-*/{STORE}/zarr.json"), key=lambda f: f.stat().st_mtime)
    manifest = integrity.read_checked(partial / MANIFEST)
    if not stores or manifest is None:
        raise InputError("no_run_work_there", partial=partial)
    layout = manifest["layout"]
    if len(layout["axes"]) != 1:
        raise InputError("can_opened_when_finished", partial=partial)
    ((axis, count),) = layout["axes"].items()
    rows: dict[int, dict[str, Any]] = {}
    for file in sorted((stores[-1].parent.parent / RECORDS).glob("*.json")):
        record = integrity.read_checked(file) or {"rows": ()}
        rows |= dict(enumerate(record["rows"], int(file.stem) * layout["chunk"]))
    names = dict.fromkeys(name for row in rows.values() for name in row)
    table = [rows.get(k, {}) for k in range(count)]
    columns = {name: column([row.get(name) for row in table], axis, name) for name in names}
    columns["finished"] = Column((axis,), np.array([k in rows for k in range(count)]), {})
    columns[axis] = Column((axis,), np.arange(count), {})
    stored = read_store(stores[-1].parent, stores[-1].parent)
    return stored.assign(_dataset(columns, {}).variables).set_coords(axis)


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
    """Lay out the store: an array for each layer with named axes, no picture in it yet. Chunks are
    plain little-endian float32 and a checksum: one is put in its place as a file."""
    import zarr
    from zarr.codecs import Crc32cCodec

    group = zarr.open_group(path, mode="w", zarr_format=3)
    shape = tuple(layout.shape.values())
    for layer in layout.layers:
        compact, axes, chunks = layer.compact, layout.picture_axes, layout.chunk_shape
        about: dict[str, Any] = {"units": layer.units, "long_name": layer.what}
        form: dict[str, Any] = {
            "dtype": "float32", "fill_value": np.nan, "compressors": [Crc32cCodec()],
        }  # fmt: skip
        if compact is not None:  # whole steps over all items, a file for each chunk of the run
            axes, chunks = layout.axes, (layout.chunk, *shape)
            about |= {"scale_factor": compact.step, "_FillValue": compact.unknown}
            form = {
                "dtype": compact.dtype.name, "fill_value": compact.unknown, "compressors": None,
                "serializer": compact.shards(shape),
            }  # fmt: skip
        form |= {"shape": (*axes.values(), *shape), "chunks": chunks, "attributes": about}
        names = tuple(map(identifier, (*axes, *layout.shape)))
        group.create_array(layer.name, dimension_names=names, **form)


def stored_arrays(folder: Path) -> dict[str, StoredArray]:
    """The arrays of results that are being finished, by name; xarray takes a second to start."""
    import zarr

    group = zarr.open_group(folder / STORE, mode="r", zarr_format=3)
    return {name: StoredArray(array) for name, array in group.arrays()}


@dataclass(frozen=True)
class StoredArray:
    """An array of a store, read as it is asked for; what is not known is NaN."""

    array: Any

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of its axes."""
        return tuple(self.array.metadata.dimension_names)

    def __getitem__(self, item: int | slice) -> Any:
        values, about = self.array[item], self.array.attrs
        if "scale_factor" not in about:
            return values
        known = values != about["_FillValue"]
        return np.where(known, values * np.float32(about["scale_factor"]), np.float32(np.nan))

    def pictures(self, places: range) -> Iterator[NDArray[Any]]:
        """Maps (rows, cols) of places on its first axis; what lies together is read together."""
        together = self.array.chunks[0]
        for at in places[::together]:
            yield from self[at : min(at + together, places.stop)]


def write_stack(
    run: RunFolder, layer: Layer, view: Mapping[str, Any], *, pixel_mm: float | None
) -> None:
    """Write a layer's TIFF stack, of its pictures as the store has them; `view`, see
    `imagej_view`."""
    items = run.layout.paged_items(layer)
    places = items if layer.compact is not None else range(len(items))
    shape = (len(items), *list(run.layout.shape.values())[-2:])
    output.write_frames(
        run.results / f"{layer.name}.tif", stored_arrays(run.results)[layer.name].pictures(places),
        shape, np.dtype("<f4"), pixel_mm=pixel_mm, metadata=view,
    )  # fmt: skip


@dataclass(frozen=True)
class Column:
    """What is known along some named axes of a dataset, with attributes such as the units."""

    axes: tuple[str, ...]
    values: NDArray[Any]
    attributes: Mapping[str, Any]


def add_columns(
    path: Path,
    columns: Mapping[str, Column],
    coordinates: Mapping[str, Column],
    attributes: Mapping[str, Any],
) -> None:
    """Add columns, coordinates and attributes to a run's store under names that are identifiers, as
    xarray would in far more time."""
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec

    group = zarr.open_group(path, mode="r+", zarr_format=3)
    nothing = {"T": "", "f": np.nan}  # by the kind of value, else 0
    places = _variables(coordinates)
    for name, (axes, values, about) in (places | _variables(columns)).items():
        form: dict[str, Any] = {"fill_value": nothing.get(values.dtype.kind, 0)}
        form |= {"chunks": tuple(max(1, size) for size in values.shape), "attributes": about}
        form |= {"dimension_names": axes, "compressors": [ZstdCodec(), Crc32cCodec()]}
        group.create_array(name, data=values, **form)
    # an axis' own coordinate is known by its name, the others have to be named
    beside = " ".join(name for name, (axes, *_) in places.items() if axes != (name,))
    group.attrs.update({**attributes, **({"coordinates": beside} if beside else {})})


_PARTS = {
    " standard_uncertainty": "_u",
    " noise_uncertainty": "_u_noise",
    " cramer_rao_bound": "_bound",
}
"""What is known of a value besides itself, as it ends the name of a column."""


def identifier(name: str) -> str:
    """A column's name for Python and MATLAB: `load.normal_n standard_uncertainty` is
    `load_normal_n_u`."""
    for words, ending in _PARTS.items():
        if name.endswith(words):
            name = name.removesuffix(words) + ending
    return re.sub(r"\W", "_", name)


def with_identifiers(dataset: xarray.Dataset) -> xarray.Dataset:
    """A dataset whose variables and axes are named by identifiers, of whatever version it is."""
    names = {str(name): identifier(str(name)) for name in (*dataset.variables, *dataset.sizes)}
    return dataset.rename({old: new for old, new in names.items() if old != new})


def column(values: Sequence[Any], axis: str, name: str) -> Column:
    """A table's column: float64, int64 or text, with the unit in its name; None is NaN or empty."""
    attributes = named_units(name)
    if isinstance(values, output.Floats):
        return Column((axis,), np.asarray(values), attributes)
    known = [value for value in values if value is not None]
    if all(isinstance(value, bool | int) for value in known) and known:
        if len(known) == len(values):
            return Column((axis,), np.array(values, dtype=np.int64), attributes)
        attributes[WHOLE] = 1
    if all(isinstance(value, bool | int | float) for value in known):
        return Column((axis,), output.numbers(values), attributes)
    return Column((axis,), texts(values), attributes)


def texts(values: Iterable[Any]) -> NDArray[Any]:
    """Make a column of texts (n,), empty where one is not known (None)."""
    return np.array(["" if v is None else str(v) for v in values], dtype=np.dtypes.StringDType())


def named_units(name: str) -> dict[str, Any]:
    """The unit at the end of a name, as netCDF spells it, as its column's attributes."""
    stem = name.removesuffix(" standard_uncertainty").rsplit(".", 1)[-1]
    above, per, below = stem.partition("_per_")
    unit = _UNITS.get(above.rpartition("_")[2]) if "_" in above else None
    if per:
        unit = f"{unit} {_UNITS[below]}-1" if unit and below in _UNITS else None
    return {"units": unit} if unit else {}


def column_values(variable: xarray.DataArray) -> list[Any]:
    """Give the values that `column` was given; None for what is not known of whole numbers."""
    values: list[Any] = variable.values.tolist()
    if variable.attrs.get(WHOLE):
        return [None if np.isnan(v) else int(v) for v in values]
    return values


def attributes(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Make attributes of a dataset of a run's identity: numbers and texts, tables as JSON."""
    result: dict[str, Any] = {"Conventions": "CF-1.11", "source": "Isochrome"}
    for key, value in identity.items():
        plain = isinstance(value, str | int | float)
        if value is not None:
            result[key] = value if plain else json.dumps(value, ensure_ascii=False)
    return result


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
    >>> found = isochrome.sweep("ring", {"load.normal_n": [60.0]}, "loads")
    >>> with isochrome.open_run("loads") as run:
    ...     order = run.fringe_order.sel(load_normal_n=60.0, state=0).load()
    >>> order.dims
    ('z_mm', 'x_mm')
    >>> print(f"{order.sel(x_mm=0.0, z_mm=9.0, method='nearest').item():.2f} fringes")
    0.77 fringes
    """
    growing = Path(path).name.endswith(WORKING)
    return as_run(open_growing(Path(path)) if growing else open_store(path))


def open_store(path: str | Path) -> xarray.Dataset:
    """The dataset that a run left, over row and col; its files' sizes and what is read are
    checked."""
    place = Path(path)
    store = place if place.suffix == ".zarr" else place / STORE
    if not (store / "zarr.json").is_file() and integrity.read_record(store.parent) is None:
        hint = message("name_folder_process_sweep")
        if place.with_name(place.name + WORKING).is_dir():
            hint = message("run_not_finished_run_same", name=place.name, working=WORKING)
        raise InputError("holds_no", place=place, missing=STORE, hint=hint)
    if store != place and integrity.read_record(place) is None:
        name = integrity.PROVENANCE
        raise InputError("holds_no_which_files_could", place=place, provenance=name, store=store)
    return read_store(store, checked_store(store))


def checked_store(store: Path) -> Any:
    """What zarr reads a store from: of results, the files that were left, as they were left. A
    warning says so where that cannot be known."""
    record = integrity.opened_record(store.parent)
    if record is None:
        integrity.warn_unverified(store)
    if record is None or record.older:
        return store
    if f"{store.name}/zarr.json" not in record.sizes:
        raise InputError("holds_no_name_folder", parent=store.parent, name=store.name)

    from isochrome.runs.maps import VerifiedStore

    return VerifiedStore(store, record)


def read_store(store: Path, source: Any) -> xarray.Dataset:
    """A store as a dataset, read from a `source` as it is used; InputError where it cannot be."""
    import xarray

    try:
        stored = xarray.open_dataset(
            source, engine="zarr", consolidated=False, chunks=None, decode_cf=False
        )
        for array in stored.variables.values():
            if "scale_factor" in array.attrs:  # maps in whole steps are single precision
                array.attrs["scale_factor"] = np.float32(array.attrs["scale_factor"])
        dataset = xarray.decode_cf(stored)
        dataset.set_close(stored.close)
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("cannot_read_run_command", store=store, reason=error) from error
    # what zarr cannot read, it leaves out; a group is what somebody else has put there
    files = (f for f in sorted(store.glob("*/zarr.json")) if b'"group"' not in f.read_bytes())
    lost = [file.parent.name for file in files if file.parent.name not in dataset.variables]
    if lost and isinstance(source, Path):  # else what is not in the record is no part of it
        dataset.close()
        raise InputError("cannot_read_run_command_again", store=store, lost=lost[0])
    return dataset


FORMATS = ("netcdf", "tiff", "csv", "excel")
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
    >>> found = isochrome.sweep("ring", {"load.normal_n": [60.0]}, "loads")
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
            if to == "netcdf":
                files = [_to_netcdf(dataset, folder / "run.nc")]
            elif to == "tiff":
                names = sorted(str(name) for name in dataset.data_vars if _is_map(dataset[name]))
                files = [_to_tiff(dataset, name, folder / "imagej") for name in names]
            else:
                files = [_to_csv(dataset, folder / "run.csv")]
                if to == "excel":
                    files = output.write_excel_copies(folder)
                    (folder / "run.csv").unlink()
        except InputError:
            raise
        except (ValueError, KeyError, TypeError, IndexError, RuntimeError) as error:
            integrity.name_damage(place)
            store, reason = place / STORE, reason_of(error)
            raise InputError("cannot_read_run_command", store=store, reason=reason) from error
        return [target / file.relative_to(folder) for file in files]


def _is_map(variable: xarray.DataArray) -> bool:
    return variable.dims[-2:] == _PICTURE


def _blocks(variable: xarray.DataArray) -> Iterator[tuple[tuple[int, ...], np.ndarray]]:
    """A variable's pictures, each with its place, or all at once; read as the store keeps them."""
    if not _is_map(variable):
        yield (), np.asarray(variable.values)
        return
    count, *others = variable.shape[:-2]
    # of maps in whole steps many lie in a file
    file = variable.encoding.get("shards") or variable.encoding.get("chunks") or (1,)
    for start in range(0, count, int(file[0])):
        values = np.asarray(variable[start : start + int(file[0])].values)
        for place in np.ndindex(len(values), *others):
            yield (start + place[0], *place[1:]), values[place]


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
            chunks = (*(1 for _ in array.dims[:-2]), *array.shape[-2:]) if _is_map(array) else None
            made = file.create_variable(str(name), array.dims, kind, chunks=chunks)
            for key, value in array.attrs.items():
                made.attrs[str(key)] = value
            # a coordinate beside the axes has to be named by the variables that it belongs to
            if name not in dataset.coords:
                others = sorted(set(dataset.coords) - set(dataset.sizes), key=str)
                named = (str(c) for c in others if set(dataset[c].dims) <= set(array.dims))
                made.attrs["coordinates"] = " ".join(named)
            for place, values in _blocks(array):
                made[place or ...] = values.astype(object) if text else values
    return path


def _to_csv(dataset: xarray.Dataset, path: Path) -> Path:
    names = [*sorted(dataset.coords, key=str), *sorted(dataset.data_vars, key=str)]
    flat = [name for name in names if not set(_PICTURE) & set(dataset[name].dims)]
    # of a tracked video the pictures have an axis of their own, which says nothing of its frames
    own_axes = set().union(*(dataset[name].dims for name in flat if name in dataset.data_vars))
    axes = [str(axis) for axis in dataset.sizes if axis in own_axes]
    flat = [name for name in flat if set(dataset[name].dims) <= own_axes]
    rows = dataset[flat].to_dataframe(dim_order=axes).reset_index()
    columns = {str(name): rows[name].tolist() for name in dict.fromkeys([*axes, *flat])}
    output.write_csv(path, columns)
    return path


def _to_tiff(dataset: xarray.Dataset, name: str, folder: Path) -> Path:
    array = dataset[name]
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.tif"
    pixel, edges = None, dict[str, float]()  # its side, and outer edges of the first ones (mm)
    if "x_mm" in dataset.coords and dataset.sizes["col"] > 1:
        x = dataset.x_mm.values
        pixel = float((x[-1] - x[0]) / (len(x) - 1))
        places = {axis: dataset[axis].values for axis in ("x_mm", "z_mm") if axis in dataset.coords}
        edges = {axis: float(values[0]) - 0.5 * pixel for axis, values in places.items()}
    known = (values[np.isfinite(values)] for _, values in _blocks(array))
    ends = [end for part in known if part.size for end in (float(part.min()), float(part.max()))]
    labels, times = (_of_pictures(dataset, each, array) for each in ("label", "time_s"))
    view = output.imagej_view(
        name, (min(ends), max(ends)) if ends else (0.0, 1.0),
        labels=_labels(dataset, array) if labels is None else [str(text) for text in labels],
        pixel_mm=pixel, left_mm=edges.get("x_mm"), top_mm=edges.get("z_mm"), times_s=times,
    )  # fmt: skip
    pictures = (values for _, values in _blocks(array))
    shape = (int(np.prod(array.shape[:-2])), *array.shape[-2:])
    output.write_frames(path, pictures, shape, np.dtype("<f4"), pixel_mm=pixel, metadata=view)
    return path


def _labels(dataset: xarray.Dataset, array: xarray.DataArray) -> list[str]:
    """What ImageJ shows above each slice: where on the axes it is."""
    axes = array.dims[:-2]
    names = [dataset[axis].attrs.get("long_name", axis) for axis in axes]
    texts = [
        [f"{value:.6g}" for value in dataset[axis].values.tolist()]
        if axis in dataset.coords
        else list(map(str, range(dataset.sizes[axis])))
        for axis in axes
    ]
    return [
        ", ".join(f"{name} = {text}" for name, text in zip(names, place, strict=True))
        for place in product(*texts)
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
