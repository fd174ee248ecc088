"""The no-load frames that a scene names: background and illumination."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.linear import Linear, to_linear
from isochrome.frames.opening import open_scene_frames
from isochrome.frames.reading import FrameReader
from isochrome.scene import ArrayFrames, Scene


def load_no_load(
    scene: Scene, *, full_shape: tuple[int, int] | None = None
) -> tuple[Linear | None, Linear | None]:
    """The scene's dark and bright no-load frame as light, None where it names none.

    With the same roi, channel, depth and gamma, stacks averaged; `full_shape` is the captured
    frames' before the roi. InputError where a file cannot be read, is saturated all over, or is of
    another size.
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
    """Open the unloaded specimen's phase-stepped set; `full_shape` is the frames' before the roi.

    InputError where it cannot be read, or has another number of frames than there are steps, or of
    another size.
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
        _check_shape(path, "no_load_steps", reader, full_shape)
    except InputError:
        reader.close()
        raise
    return reader


def _check_shape(
    path: Path | ArrayFrames, key: str, reader: FrameReader, full_shape: tuple[int, int] | None
) -> None:
    if full_shape is not None and reader.full_shape != full_shape:
        raise InputError(
            f"{path}: frames.{key} is {reader.full_shape} pixels (rows, columns) and the "
            f"captured frames {full_shape}; capture both with the same camera settings"
        )


def _average(
    scene: Scene, name: str | ArrayFrames | None, key: str, full_shape: tuple[int, int] | None
) -> Linear | None:
    if name is None:
        return None
    path = scene.path(name)
    with open_scene_frames(path, scene, masked=False) as reader:
        _check_shape(path, key, reader, full_shape)
        total, valid, count = np.zeros(reader.shape), np.ones(reader.shape, bool), 0
        for frame in reader:
            gamma = scene.frames.first_gamma
            linear = to_linear(frame, bit_depth=reader.bit_depth, gamma=gamma, allow_blank=True)
            total += linear.image
            valid &= linear.valid
            count += 1
    if not valid.any():
        raise InputError(f"{path}: frames.{key} is saturated all over; lower the exposure")
    return Linear((total / count).astype(np.float32), valid)


def likely_no_load(names: Sequence[str]) -> dict[str, str]:
    """The no-load frames by the names of files: the scene's key to a name, where one alone is
    called so.
    """
    found = {}
    for field in ("dark", "bright"):
        own = [n for n in names if field in n.lower() and is_unloaded(n) and not n.endswith(".csv")]
        if len(own) == 1:
            found[f"frames.no_load_{field}"] = own[0]
    return found


def is_unloaded(name: str) -> bool:
    """Whether a file's name says that it is a frame without load."""
    plain = name.lower().replace("_", "-").replace(" ", "-")
    return any(word in plain for word in ("no-load", "noload", "unloaded"))
