"""From a calibration set's files to shots: linear light, valid pixels, noise, no-load light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from isochrome.calibrate.settings import CalibrationSet, LoadedImage
from isochrome.calibrate.shot import Shot, below_saturation
from isochrome.errors import InputError

Array = NDArray[np.float64]

MOST_SATURATED = 0.3
"""Share of invalid (saturated) pixels beyond which an image is refused."""

SMOOTHING_PX = 3.0
"""Blur of the no-load frames, whose own noise must not enter every pixel's model."""


def read_shots(given: CalibrationSet) -> tuple[tuple[Shot, ...], Array | None]:
    """Read a set's images, and its no-load frames where it names both.

    Parameters: `given`, the set. Returns the shots (the no-load dark frame subtracted where there
    is one) and the no-load light, bright minus dark (rows, cols), or None. Raises InputError that
    names the file where one cannot be read, is saturated or is of another size.
    """
    dark, light = _no_load(given)
    shots = tuple(_shot(given, item, dark) for item in given.image)
    shapes = {s.image.shape for s in shots} | ({light.shape} if light is not None else set())
    if len(shapes) > 1:
        raise InputError(
            f"{given.name}: the images are of different sizes (rows, columns): "
            f"{sorted(shapes)}; capture all of them alike"
        )
    return shots, light


def _shot(given: CalibrationSet, item: LoadedImage, dark: Array | None) -> Shot:
    from scipy.ndimage import uniform_filter

    from isochrome.frames import check_scale, estimate_noise, load_mask, open_frames, to_linear

    path = given.path(item.file)
    with open_frames(
        path,
        channel=given.frames.channel,
        wavelength_nm=given.polariscope.wavelength_nm,
        roi=given.frames.roi,
        bit_depth=given.camera.bit_depth,
    ) as reader:
        check_scale(reader, given.camera)
        frames = iter(reader)
        first = next(frames)
        if next(frames, None) is not None:
            raise InputError(f"{path}: holds more than one frame; give one [[image]] a file")
        raw, depth = first.image, reader.bit_depth
        inside = load_mask(given, reader.shape, reader.full_shape)
    linear = to_linear(raw, bit_depth=depth, gamma=given.gamma, name=str(path))
    if np.mean(~linear.valid) > MOST_SATURATED:
        raise InputError(
            f"{path}: {np.mean(~linear.valid):.0%} of its pixels are saturated or defective; "
            "lower the exposure, or set roi to the specimen"
        )
    noise = estimate_noise(raw, linear.valid & inside, bit_depth=depth)
    level = uniform_filter(raw.astype(float), 3)  # a weight must not follow its own pixel's noise
    sigma = noise.linear_sigma(level, bit_depth=depth, gamma=given.gamma)
    image = linear.image.astype(float)
    full = np.inf if depth is None else 2.0**depth - 1.0
    valid = linear.valid & inside & below_saturation(raw.astype(float), noise.sigma(level), full)
    if dark is not None:
        image = image - dark
    return Shot(item.file, item.load_n, image, valid, np.asarray(sigma, dtype=float))


def _no_load(given: CalibrationSet) -> tuple[Array | None, Array | None]:
    from scipy.ndimage import gaussian_filter

    from isochrome.frames import load_no_load
    from isochrome.scene import Scene, Specimen

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
