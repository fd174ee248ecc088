"""Frame sets to compare: results of `process` and `simulate`, on disk or in memory, or frames."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.comparison.frame_sets import ComparedFrames
from isochrome.errors import InputError
from isochrome.frames import CHANNELS, channel_for, open_frames, open_tiff
from isochrome.output import read_csv, read_pixel_mm
from isochrome.processing import PICTURE, Processed
from isochrome.runs import opened_record
from isochrome.scene import FramesLike, Scene, dump_scene, load_scene
from isochrome.simulation import Simulation
from isochrome.stress import pixel_grid

_SIGNALS = (("normalised.tif", "frames.csv"), ("frames.tif", "history.csv"))
_ORDER = "fringe_order.tif"


SetToCompare = FramesLike | Processed | Simulation | ComparedFrames
"""A frame set as a caller may give it: a result's folder, a result in memory, or frames."""


def load_frame_set(given: SetToCompare, *, bit_depth: int | None = None) -> ComparedFrames:
    """Load frames (frame, row, col) to compare, as a signal of 0 to 1.

    Of a result, in memory or a folder: `normalised.tif` or `frames.tif`, `fringe_order.tif`, labels
    of `frames.csv` or `history.csv`, place of `scene.toml`. Else bare frames without orders, as by
    `open_frames`: of colours the scene's channel or that nearest its wavelength, whole numbers over
    2^bits - 1. InputError where parts do not fit, or it is a phase-stepped set.
    """
    if isinstance(given, ComparedFrames):
        return given
    if isinstance(given, Processed | Simulation):
        return _of_result(given, bit_depth)
    if isinstance(given, str | Path):
        place = Path(given)
        if not place.exists():
            raise InputError(f"{place}: no such file or folder; give a result folder or frames")
        for signal_name, table_name in _SIGNALS:
            if place.is_dir() and (place / signal_name).exists():
                return _load_result(place, signal_name, table_name, bit_depth)
    return _load_bare(given, bit_depth)


def _of_result(found: Processed | Simulation, bit_depth: int | None) -> ComparedFrames:
    """The frames of a result whose maps are in memory."""
    if isinstance(found, Simulation):
        stack, order = found.frames, found.orders
    else:
        stack, order = _maps_of(found)
    if stack is None:
        raise InputError(
            f"{found.title}: its maps are in the folder that it was written to; name that folder"
        )
    table = found.columns
    if PICTURE in table:
        table = _of_pictures(table, [at is not None for at in table[PICTURE]])
    parts = _Parts(
        name=found.title, stack=stack, order=order, scene=tomllib.loads(dump_scene(_placed(found))),
        table=table, simulated=isinstance(found, Simulation),
    )  # fmt: skip
    return _compared(parts, bit_depth)


def _placed(found: Processed | Simulation) -> Scene:
    """The scene of a result with the place that was found."""
    return found.scene if isinstance(found, Simulation) else found.fitted or found.scene


def _maps_of(found: Processed) -> tuple[NDArray[Any] | None, NDArray[Any] | None]:
    """Signals and orders (frame, row, col); None for what is not in memory, or was not read."""
    if found.frames is None:
        return None, None
    stack = np.stack([frame.normalised for frame in found.frames])
    readings = [frame.reading for frame in found.frames]
    if not any(readings):
        return stack, None
    blank = np.full(stack.shape[1:], np.nan, np.float32)
    return stack, np.stack([reading.order if reading else blank for reading in readings])


def _load_result(
    folder: Path, signal_name: str, table_name: str, bit_depth: int | None
) -> ComparedFrames:
    opened_record(folder, (signal_name, _ORDER, table_name, "scene.toml"))
    stack = _read_stack(folder / signal_name)
    order = _read_stack(folder / _ORDER) if (folder / _ORDER).exists() else None
    table = read_csv(folder / table_name) if (folder / table_name).exists() else {}
    if PICTURE in table:
        shown = np.isfinite(table[PICTURE])
        table = _of_pictures(table, shown)
        if order is not None and len(order) == len(shown):  # a page for every frame
            order = order[shown]
    fitted = folder / "fitted_scene.toml"  # with the place that was found
    parts = _Parts(
        name=str(folder / signal_name), stack=stack, order=order,
        scene=_scene(fitted if fitted.is_file() else folder / "scene.toml"), table=table,
        simulated=signal_name == "frames.tif", pixel_mm=read_pixel_mm(folder / signal_name),
    )  # fmt: skip
    return _compared(parts, bit_depth)


@dataclass(frozen=True, kw_only=True)
class _Parts:
    """What a result's folder holds: `name`, for messages; `stack` (frame, row, col[, channel]).

    `order` (frame, row, col), None where none was read; `scene`, its tables; `table`, a column each
    of frames.csv or history.csv; `simulated`, whether a simulation left it; `pixel_mm` of the file.
    """

    name: str
    stack: NDArray[Any]
    order: NDArray[Any] | None
    scene: dict[str, Any]
    table: Mapping[str, Sequence[Any]]
    simulated: bool
    pixel_mm: float | None = None


def _compared(parts: _Parts, bit_depth: int | None) -> ComparedFrames:
    """A result's frames as a signal of 0 to 1, with their orders, place and labels."""
    scene, order, table = parts.scene, parts.order, parts.table
    camera = scene.get("camera", {})
    light = scaled(parts.stack, bit_depth or camera.get("bit_depth"))
    signal = _one_channel(light, scene)
    steps = len(scene.get("polariscope", {}).get("step", ()))
    if order is not None and steps > 1 and len(signal) == steps * len(order):
        raise InputError(
            f"{parts.name}: is a phase-stepped set, {steps} frames for each of "
            f"{len(order)} states, and a comparison needs one dark-field frame a state; take "
            "[[polariscope.step]] out of the scene and simulate it again"
        )
    if order is not None and order.shape != signal.shape:
        raise InputError(
            f"{parts.name} has shape {signal.shape} and {_ORDER} beside it {order.shape}: "
            "the folder mixes two runs; make it again"
        )
    length = len(next(iter(table.values()), ()))
    if table and length != len(signal):
        raise InputError(
            f"{parts.name}: its table has {length} rows for {len(signal)} frames: the folder mixes "
            "two runs; make it again"
        )
    if order is not None and parts.simulated:
        signal = np.where(np.isfinite(order), signal, np.float32(np.nan))  # no specimen there
    left, top = _corner(scene, (signal.shape[1], signal.shape[2]))
    return ComparedFrames(
        signal=signal,
        order=None if order is None else order.astype(np.float32, copy=False),
        pixel_mm=parts.pixel_mm or camera.get("pixel_mm"),
        left_mm=left,
        top_mm=top,
        labels=_labels(table, len(signal)),
        noise=_noise(table),
    )


def _corner(scene: dict[str, Any], shape: tuple[int, int]) -> tuple[float, float]:
    """Outer edges (mm) of the first column and row; a model's are known without being stated."""
    camera = scene.get("camera", {})
    if camera.get("pixel_mm") and (whole := load_scene(scene)).model is not None:
        grid = pixel_grid(whole, shape)
        return grid.left_mm, grid.top_mm
    return float(camera.get("left_mm", 0.0)), float(camera.get("top_mm", 0.0))


def _load_bare(given: FramesLike, bit_depth: int | None) -> ComparedFrames:
    with open_frames(given, bit_depth=bit_depth) as reader:
        images = [scaled(frame.image, reader.bit_depth) for frame in reader]
        scale = reader.pixel_mm
    if not images:
        raise InputError(
            f"{reader.path}: no frame in it; give a TIFF stack, an image folder or a video"
        )
    return ComparedFrames(signal=np.stack(images), pixel_mm=scale)


def scaled(image: NDArray[Any], bit_depth: int | None = None) -> NDArray[np.floating]:
    """Scale whole-number pixels to 0..1 by the sensor's bit depth; leave floats as they are.

    signal = counts / (2^bits - 1)

    `image`: any shape; `bit_depth`: default that of the array's type. Returns float32. Raises
    InputError when a count is beyond the bit depth.
    """
    if not np.issubdtype(image.dtype, np.integer):
        return image.astype(np.float32, copy=False)
    full = 2 ** (bit_depth or 8 * image.dtype.itemsize) - 1
    if image.size and int(image.max()) > full:
        raise InputError(
            f"a pixel of {int(image.max())} counts in frames of {bit_depth} bits (at most {full}): "
            "give the sensor's bit depth, [camera] bit_depth"
        )
    return image.astype(np.float32) / np.float32(full)


def _read_stack(path: Path) -> NDArray[Any]:
    """Read a TIFF as (frame, row, col) or, in colour, (frame, row, col, 3), in its own type."""
    return np.stack([raw.image for raw in open_tiff(path).frames(0)])


def _one_channel(stack: NDArray[Any], scene: dict[str, Any]) -> NDArray[Any]:
    """Reduce colour to the channel that the scene names, else the nearest to its wavelength."""
    if stack.ndim == 3:
        return stack
    channel = scene.get("frames", {}).get("channel")
    channel = channel or channel_for(scene.get("polariscope", {}).get("wavelength_nm"))
    if channel == "mean":
        result: NDArray[Any] = stack.mean(axis=3, dtype=np.float32)
        return result
    return stack[..., CHANNELS.index(channel)]


def _of_pictures(table: Mapping[str, Sequence[Any]], shown: Iterable[bool]) -> dict[str, list[Any]]:
    """The rows of a tracked video's key frames, which alone have pictures."""
    flags = list(shown)
    return {name: list(compress(values, flags)) for name, values in table.items()}


def _scene(path: Path) -> dict[str, Any]:
    """Read the resolved scene beside the results as plain tables; empty without one."""
    if not path.exists():
        return {}
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError, OSError) as error:
        raise InputError(f"{path} is not valid TOML ({error}): make the results again") from error


def _labels(table: Mapping[str, Sequence[Any]], count: int) -> tuple[str, ...]:
    """Name the frames: by their label, else by sliding distance and named state."""
    if "label" in table:
        return tuple(str(name) for name in table["label"])
    names = table.get("state", [])
    distances = table.get("distance_m", [])
    labels = []
    for index in range(count):
        name = names[index].strip() if names and isinstance(names[index], str) else ""
        distance = distances[index] if distances else None
        if isinstance(distance, float) and distance > 0:
            name = f"sliding, {distance:g} m"
        elif isinstance(distance, float) and distance == 0 and not name:
            name = "static" if index == 0 else "initial sliding"
        labels.append(name or f"frame {index}")
    return tuple(labels)


def _noise(table: Mapping[str, Sequence[Any]]) -> NDArray[np.floating] | None:
    """Take the signal's noise of each frame out of a table that has it as numbers."""
    values = table.get("noise", [])
    if not len(values) or not all(isinstance(value, float) for value in values):
        return None
    return np.array(values)
