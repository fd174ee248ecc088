"""From a calibration set's files to shots: linear light, valid pixels, noise, no-load light."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.settings import CalibrationSet, LoadedImage
from isochrome.calibration.shot import Shot, below_saturation
from isochrome.errors import InputError
from isochrome.estimation import observe
from isochrome.frames import (
    FrameReader,
    check_scale,
    full_scale,
    load_mask,
    load_no_load,
    open_frames,
    saturation_level,
)
from isochrome.scene import ArrayFrames, Camera, Frames, Scene, Specimen, check_width

Array = NDArray[np.float64]

MOST_SATURATED = 0.3
"""Share of invalid (saturated) pixels beyond which an image is refused."""

SMOOTHING_PX = 3.0
"""Blur of the no-load frames, whose own noise must not enter every pixel's model."""


def read_shots(given: CalibrationSet) -> tuple[Shot, ...]:
    """Read a set's images, and its no-load frames where it names both.

    Parameters: `given`, the set. Returns the shots, the no-load dark frame subtracted where there
    are both. Raises InputError that names the file where one cannot be read, is saturated or is of
    another size, or camera.pixel_mm is none in which the specimen can be seen.
    """
    dark, light = _no_load(given)
    shots = tuple(_shot(given, item, dark, light) for item in given.image)
    shapes = {s.light.shape for s in shots} | ({light.shape} if light is not None else set())
    if len(shapes) > 1:
        raise InputError(
            f"{given.name}: the images are of different sizes (rows, columns): "
            f"{sorted(shapes)}; capture all of them alike"
        )
    body = given.beam.height_mm if given.beam else given.disc.diameter_mm if given.disc else None
    if given.camera.pixel_mm is not None and body is not None:
        what = "the beam" if given.beam else "the disc"
        check_width(given.name, given.camera.pixel_mm, shots[0].light.shape, body, what)
    return shots


def _shot(
    given: CalibrationSet, item: LoadedImage, dark: Array | None, no_load_light: Array | None
) -> Shot:
    path = given.path(item.file)
    light: dict[str, Any] = {
        "channel": given.frames.channel,
        "wavelength_nm": given.polariscope.wavelength_nm,
    }
    raw, reader = read_one_frame(path, given.frames, given.camera, **light)
    depth, inside = reader.bit_depth, load_mask(given, reader.shape, reader.full_shape)
    seen = observe(raw, name=str(path), bit_depth=depth, gamma=given.gamma, mask=inside)
    unusable = np.mean(~seen.valid[inside])
    if unusable > MOST_SATURATED:
        raise InputError(
            f"{path}: {unusable:.0%} of its pixels are saturated or defective; "
            "lower the exposure, or set roi to the specimen"
        )
    # no model of the light cuts a calibration's pixels near white, as it does a frame's
    full = full_scale(depth)
    level = np.inf if depth is None else saturation_level(raw, full=full) / full
    valid = seen.valid & below_saturation(seen.raw, seen.raw_sigma, level)
    linear = seen.light.astype(float)
    return Shot(
        **(vars(seen) | {"name": str(item.file), "valid": valid}
           | {"light": linear if dark is None else linear - dark}),
        load_n=item.load_n, bright=given.polariscope.field == "bright",
        no_load_light=no_load_light,
    )  # fmt: skip


def read_one_frame(
    path: Path | ArrayFrames, frames: Frames, camera: Camera, *, colour: bool = False, **light: Any
) -> tuple[Array, FrameReader]:
    """The one image of a file as stored, and its reader, closed.

    Parameters: `path`; `frames` and `camera`, how it is to be read; `colour`, whether a grey one is
    refused; `light`, channel and wavelength_nm as `open_frames` takes them. Raises InputError.
    """
    light |= {"rotate_deg": frames.rotate_deg, "flip": frames.flip, "roi": frames.roi}
    with open_frames(path, bit_depth=camera.bit_depth, **light) as reader:
        if colour and reader.channel is None:
            raise InputError(f"{path}: is grey; give colour images")
        check_scale(reader, camera)
        images = [frame.image for _, frame in zip(range(2), reader, strict=False)]
        if len(images) != 1:
            raise InputError(f"{path}: holds more than one frame; give one [[image]] a file")
        return images[0], reader


def _no_load(given: CalibrationSet) -> tuple[Array | None, Array | None]:
    from scipy.ndimage import gaussian_filter

    scene = Scene(
        specimen=Specimen(),
        camera=given.camera,
        polariscope=given.polariscope,
        frames=given.frames.model_copy(update={"gamma": given.gamma}),
        folder=given.folder,
    )
    dark, bright = load_no_load(scene)
    if dark is None or bright is None:
        return None, None
    smooth = [gaussian_filter(np.nan_to_num(f.image).astype(float), SMOOTHING_PX) for f in
              (dark, bright)]  # fmt: skip
    return smooth[0], smooth[1] - smooth[0]
