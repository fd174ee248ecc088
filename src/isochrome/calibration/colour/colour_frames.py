"""From a colour calibration's files to its frames: grey levels, noise and trusted pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from isochrome.calibration.colour.settings import ColourSet
from isochrome.calibration.loading import read_one_frame
from isochrome.errors import InputError
from isochrome.frames import CHANNELS, estimate_noise, load_mask, to_linear
from isochrome.fringes import ColourShots
from isochrome.scene import ArrayFrames

Array = NDArray[Any]

_SMOOTH_PX = 1.5
_SMOOTH_ENDS_PX = 3.0


def read_colour_shots(given: ColourSet) -> tuple[ColourShots, int | None]:
    """Read a set's images, and its no-load frames where it names them.

    Parameters: `given`, the set. Returns the shots and the images' bit depth. Raises InputError
    that names the file where one cannot be read, is grey, or is of another size.
    """
    images, depth = [], None
    for item in given.image:
        image, depth = _read(given, given.path(item.file), masked=True)
        images.append(image)
    shapes = {image[0].shape for image in images}
    if len(shapes) > 1:
        raise InputError(
            f"{given.name}: the images are of different sizes {sorted(shapes)} (rows, columns, "
            "channels); capture all of them alike"
        )
    ends: list[Array | None] = []
    for name in (given.frames.no_load_dark, given.frames.no_load_bright):
        if name is None:
            ends.append(None)
            continue
        (end, *_), _ = _read(given, given.path(name), masked=False)
        if end.shape != images[0][0].shape:
            raise InputError(
                f"{given.path(name)}: is {end.shape} (rows, columns, channels) and the "
                f"images {images[0][0].shape}; capture all of them alike"
            )
        # its noise must not enter every pixel's model
        ends.append(gaussian_filter(end, (_SMOOTH_ENDS_PX, _SMOOTH_ENDS_PX, 0.0)))
    raw, noise, valid = (np.stack(part) for part in zip(*images, strict=True))
    return ColourShots(raw, noise, valid, *ends), depth


def _read(
    given: ColourSet, path: Path | ArrayFrames, *, masked: bool
) -> tuple[tuple[Array, Array, Array], int | None]:
    """Grey levels of one image, 1 = full scale, with noise and trusted pixels."""
    channels, depth = [], None
    for name in CHANNELS:
        levels, noise, valid, depth = _channel(given, path, name, masked=masked)
        channels.append((levels, noise, valid))
    found = [np.stack(part, axis=-1) for part in zip(*channels, strict=True)]
    return (found[0], found[1], found[2]), depth


def _channel(
    given: ColourSet, path: Path | ArrayFrames, name: Any, *, masked: bool
) -> tuple[Array, Array, Array, int | None]:
    frame, reader = read_one_frame(path, given.frames, given.camera, colour=True, channel=name)
    depth = reader.bit_depth
    mask = load_mask(given, reader.shape, reader.full_shape) if masked else None
    linear = to_linear(
        frame, bit_depth=depth, name=f"{path}, {name}", allow_blank=not masked, mask=mask
    )
    noise = estimate_noise(frame, linear.valid, bit_depth=depth)
    level = gaussian_filter(np.nan_to_num(frame.astype(np.float32)), _SMOOTH_PX)
    return linear.image, noise.linear_sigma(level, bit_depth=depth), linear.valid, depth
