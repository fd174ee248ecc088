"""Frame sets from folders: what `process` and `simulate` leave, or bare frames."""

from __future__ import annotations

import tomllib
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.comparison.frame_sets import ComparedFrames
from isochrome.errors import InputError
from isochrome.output import read_csv, read_pixel_mm

_SIGNALS = (("normalised.tif", "frames.csv"), ("frames.tif", "history.csv"))
_ORDER = "fringe_order.tif"


def load_frame_set(path: str | Path, *, bit_depth: int | None = None) -> ComparedFrames:
    """Load frames to compare from a result folder, a TIFF stack, an image folder or a video.

    A folder with `normalised.tif` (made by `isochrome process`) or `frames.tif` (by `simulate`)
    gives signals, fringe orders (`fringe_order.tif`), labels (`frames.csv`, `history.csv`) and
    the frame's place (`scene.toml`); anything else is read as bare frames without orders. Of colour
    frames the channel is taken that the scene names, else the one nearest to its wavelength.
    Whole-number images are divided by 2^bits - 1.

    Parameters
    ----------
    path : str or Path
        File or folder.
    bit_depth : int, optional
        Bits of the sensor, for whole-number images; by default what the scene or the file says,
        else the container's.

    Returns
    -------
    ComparedFrames
        The frames, (frame, row, col), as a signal of 0 to 1.

    Raises
    ------
    InputError
        Where the path does not exist, its parts do not fit together, or it holds a phase-stepped
        set.
    """
    place = Path(path)
    if not place.exists():
        raise InputError(f"{place}: no such file or folder; give a result folder or frames")
    for signal_name, table_name in _SIGNALS:
        if place.is_dir() and (place / signal_name).exists():
            return _load_result(place, signal_name, table_name, bit_depth)
    return _load_bare(place, bit_depth)


def _load_result(
    folder: Path, signal_name: str, table_name: str, bit_depth: int | None
) -> ComparedFrames:
    scene = _scene(folder / "scene.toml")
    camera = scene.get("camera", {})
    light = scaled(_read_stack(folder / signal_name), bit_depth or camera.get("bit_depth"))
    signal = _one_channel(light, scene)
    order = _read_stack(folder / _ORDER) if (folder / _ORDER).exists() else None
    steps = len(scene.get("polariscope", {}).get("step", ()))
    if order is not None and steps > 1 and len(signal) == steps * len(order):
        raise InputError(
            f"{folder}: {signal_name} is a phase-stepped set, {steps} frames for each of "
            f"{len(order)} states, and a comparison needs one dark-field frame a state; take "
            "[[polariscope.step]] out of the scene and simulate it again"
        )
    if order is not None and order.shape != signal.shape:
        raise InputError(
            f"{folder / _ORDER} has shape {order.shape}, {signal_name} beside it {signal.shape}: "
            "the folder mixes two runs; make it again"
        )
    table = _read_table(folder / table_name, len(signal))
    if order is not None and signal_name == "frames.tif":
        signal = np.where(np.isfinite(order), signal, np.float32(np.nan))  # no specimen there
    return ComparedFrames(
        signal=signal,
        order=None if order is None else order.astype(np.float32, copy=False),
        pixel_mm=read_pixel_mm(folder / signal_name) or camera.get("pixel_mm"),
        left_mm=float(camera.get("left_mm", 0.0)),
        top_mm=float(camera.get("top_mm", 0.0)),
        labels=_labels(table, len(signal)),
        noise=_noise(table),
    )


def _load_bare(place: Path, bit_depth: int | None) -> ComparedFrames:
    from isochrome.frames import open_frames

    with open_frames(place, bit_depth=bit_depth) as reader:
        images = [scaled(frame.image, reader.bit_depth) for frame in reader]
        scale = reader.pixel_mm
    if not images:
        raise InputError(f"{place}: no frame in it; give a TIFF stack, an image folder or a video")
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
    from isochrome.frames import open_tiff

    return np.stack([raw.image for raw in open_tiff(path).frames(0)])


def _one_channel(stack: NDArray[Any], scene: dict[str, Any]) -> NDArray[Any]:
    """Reduce colour to the channel that the scene names, else the nearest to its wavelength."""
    if stack.ndim == 3:
        return stack
    from isochrome.frames import CHANNELS, channel_for

    channel = scene.get("frames", {}).get("channel")
    channel = channel or channel_for(scene.get("polariscope", {}).get("wavelength_nm"))
    if channel == "mean":
        result: NDArray[Any] = stack.mean(axis=3, dtype=np.float32)
        return result
    return stack[..., CHANNELS.index(channel)]


def _read_table(path: Path, count: int) -> dict[str, list[Any]]:
    """Read a result table with one row a picture; no columns when it is not there.

    Of a tracked video, only the key frames have one.
    """
    table = read_csv(path) if path.exists() else {}
    if "picture" in table:
        shown = np.isfinite(table["picture"])
        table = {name: list(compress(values, shown)) for name, values in table.items()}
    length = len(next(iter(table.values()), []))
    if table and length != count:
        raise InputError(
            f"{path} has {length} rows for {count} frames: the folder mixes two runs; make it again"
        )
    return table


def _scene(path: Path) -> dict[str, Any]:
    """Read the resolved scene beside the results as plain tables; empty without one."""
    if not path.exists():
        return {}
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError, OSError) as error:
        raise InputError(f"{path} is not valid TOML ({error}): make the results again") from error


def _labels(table: dict[str, list[Any]], count: int) -> tuple[str, ...]:
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


def _noise(table: dict[str, list[Any]]) -> NDArray[np.floating] | None:
    """Take the signal's noise of each frame out of a table that has it as numbers."""
    values = table.get("noise", [])
    if not values or not all(isinstance(value, float) for value in values):
        return None
    return np.array(values)
