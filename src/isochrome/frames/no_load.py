"""The no-load frames that a scene names: background and illumination."""

from __future__ import annotations

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.linear import Linear, to_linear
from isochrome.frames.opening import open_scene_frames
from isochrome.frames.reader import FrameReader
from isochrome.scene import Scene


def load_no_load(
    scene: Scene, *, full_shape: tuple[int, int] | None = None
) -> tuple[Linear | None, Linear | None]:
    """Read the scene's no-load frames as light, with the same roi, channel, depth and gamma.

    Parameters: `scene`; `full_shape` (rows, cols) of the captured frames before the roi, to be
    compared with. A stack is averaged. Returns (dark, bright), None where the scene names none.
    Raises InputError where a file cannot be read, is saturated all over, or is of another size.
    """
    dark = _average(scene, scene.frames.no_load_dark, "no_load_dark", full_shape)
    bright = _average(scene, scene.frames.no_load_bright, "no_load_bright", full_shape)
    if dark is not None and bright is not None and dark.image.shape != bright.image.shape:
        raise InputError(
            f"frames.no_load_dark is {dark.image.shape} pixels (rows, columns) and "
            f"frames.no_load_bright {bright.image.shape}; capture both alike"
        )
    return dark, bright


def open_no_load_steps(scene: Scene, full_shape: tuple[int, int]) -> FrameReader:
    """Open the unloaded specimen's phase-stepped set.

    Parameters: `scene`, with frames.no_load_steps; `full_shape` (rows, cols) of the captured frames
    before the roi. Returns a FrameReader. Raises InputError where the set cannot be read, holds
    another number of frames than there are steps, or frames of another size.
    """
    name, steps = scene.frames.no_load_steps, len(scene.polariscope.step)
    assert name is not None
    path = scene.path(name)
    reader = open_scene_frames(path, scene)
    try:
        count = reader.count()
        if count != steps:
            raise InputError(
                f"{path}: frames.no_load_steps holds {count} frames and the polariscope has "
                f"{steps} steps; give one frame of the unloaded specimen for each"
            )
        if reader.full_shape != full_shape:
            raise InputError(
                f"{path}: frames.no_load_steps is {reader.full_shape} pixels (rows, columns) and "
                f"the captured frames {full_shape}; capture both with the same camera settings"
            )
    except InputError:
        reader.close()
        raise
    return reader


def _average(
    scene: Scene, name: str | None, key: str, full_shape: tuple[int, int] | None
) -> Linear | None:
    if name is None:
        return None
    path = scene.path(name)
    with open_scene_frames(path, scene, masked=False) as reader:
        if full_shape is not None and reader.full_shape != full_shape:
            raise InputError(
                f"{path}: frames.{key} is {reader.full_shape} pixels (rows, columns) and the "
                f"captured frames {full_shape}; capture both with the same camera settings"
            )
        total, valid, count = np.zeros(reader.shape), np.ones(reader.shape, bool), 0
        for frame in reader:
            linear = to_linear(
                frame.image,
                bit_depth=reader.bit_depth,
                gamma=scene.frames.first_gamma,
                name=frame.name,
                allow_blank=True,
            )
            total += linear.image
            valid &= linear.valid
            count += 1
    if not valid.any():
        raise InputError(f"{path}: frames.{key} is saturated all over; lower the exposure")
    return Linear((total / count).astype(np.float32), valid)
