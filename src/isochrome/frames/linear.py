"""From raw grey levels to light, and from light to the fringe signal.

Light: full scale, gamma, and which pixels can be trusted. Signal: a frame of a polariscope is
I = D + (B - D) s, where D is the background (the unloaded specimen in the dark field), B the full
illumination (the same in the bright field), and s the fringe signal: s = sin^2(pi N) in the dark
field and cos^2(pi N) in the bright one, N the fringe order.

The no-load frames that a scene names: background and illumination.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.noise import full_scale
from isochrome.frames.opening import open_scene_frames
from isochrome.frames.reading import Frame, FrameReader, Mask
from isochrome.frames.saturation import saturation_level
from isochrome.messages import message
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
            message(
                "frames_no_load_dark_pixels_rows",
                shape=dark.image.shape,
                shape_2=bright.image.shape,
            )
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
                message("frames_no_load_steps_holds_frames", path=path, count=count, steps=steps)
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
            message(
                "frames_pixels_rows_columns",
                path=path,
                key=key,
                full_shape=reader.full_shape,
                full_shape_2=full_shape,
            )
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
        raise InputError(message("frames_saturated_all_over", path=path, key=key))
    return Linear((total / count).astype(np.float32), valid)


def likely_no_load(names: Sequence[str]) -> dict[str, str]:
    """The no-load frames by the names of files: the scene's key to a name, where one alone is
    called so.
    """
    keys = {}
    for field in ("dark", "bright"):
        candidates = [
            n for n in names if field in n.lower() and is_unloaded(n) and not n.endswith(".csv")
        ]
        if len(candidates) == 1:
            keys[f"frames.no_load_{field}"] = candidates[0]
    return keys


def is_unloaded(name: str) -> bool:
    """Whether a file's name says that it is a frame without load."""
    plain = name.lower().replace("_", "-").replace(" ", "-")
    return any(word in plain for word in ("no-load", "noload", "unloaded"))


OUTLIER_SIGMAS = 8.0
MIN_CONTRAST = 0.05
"""Pixels whose contrast B - D is below this part of the frame's median are masked."""


@dataclass(frozen=True)
class Linear:
    """Light (row, col) as a fraction of full scale."""

    image: np.ndarray  # float32, also where it is not valid
    valid: Mask  # not saturated, dead, hot or non-finite, and on the specimen


def to_linear(
    image: Frame | np.ndarray,
    *,
    bit_depth: int | None,
    gamma: float = 1.0,
    name: str | None = None,
    allow_blank: bool = False,
    mask: Mask | None = None,
) -> Linear:
    """Raw grey levels as light, a fraction of full scale: (raw / (2^bit_depth - 1))^gamma.

    That is of a camera that stored raw = linear^(1 / gamma): 1 for a linear one, about 2.2 for the
    usual (sRGB-like) tone curve. `bit_depth` None: fractions already; `allow_blank`: a constant
    frame is right, as an ideal no-load one is; a Frame's own mask and name go first. InputError
    where it is constant, without a finite pixel, out of range, or not of the mask's size.
    """
    if isinstance(image, Frame):
        name, mask, image = name or image.name, image.mask, image.image
    raw, name = np.asarray(image), name or "the frame"
    if raw.ndim != 2 or raw.size == 0:
        raise InputError(message("frame_row_col_not", name=name, shape=raw.shape))
    if mask is not None and mask.shape != raw.shape:
        raise InputError(
            message("pixels_rows_columns_specimen", name=name, shape=raw.shape, shape_2=mask.shape)
        )
    full = full_scale(bit_depth)
    finite = np.isfinite(raw)
    _check_levels(raw if finite.all() else raw[finite], bit_depth, allow_blank, name)
    light = raw.astype(np.float32)
    light[~finite] = 0.0
    light /= np.float32(full)
    valid = finite & ~find_outliers(raw, finite) & (raw < saturation_level(raw, full=full))
    if gamma != 1:
        valid &= light >= 0  # a background was subtracted: what gamma made of it is not known
        light = np.maximum(light, 0) ** np.float32(gamma)
    light[~finite] = np.nan
    if mask is not None:
        valid &= mask
    return Linear(image=light, valid=valid)


def _check_levels(numbers: np.ndarray, bit_depth: int | None, allow_blank: bool, name: str) -> None:
    """Refuse a frame without a number, beyond its bit depth, or of one value."""
    if not numbers.size:
        raise InputError(message("holds_no_number_nan", name=name))
    full, low, high = full_scale(bit_depth), float(numbers.min()), float(numbers.max())
    if high > full:
        given = f"{bit_depth} bits end" if bit_depth else message("float_frames_without_bit")
        raise InputError(
            message("holds_set_camera_bit_depth", name=name, high=high, given=given, full=full)
        )
    if low == high and not allow_blank:
        what = "all black" if high <= 0 else "all white" if high >= full else "constant"
        raise InputError(message("every_pixel_check_light", name=name, what=what, high=high))


def find_outliers(image: np.ndarray, finite: Mask | None = None) -> Mask:
    """Find dead and hot pixels: those far outside the range of the eight around them.

    An outlier exceeds the second largest of its neighbours (or falls below the second smallest) by
    8 noise sigmas and by their whole spread. A fringe, however fine, has neighbours as bright as
    itself along its length, and is left alone; one odd pixel and a pair are found; larger flaws,
    and those in the outermost rows and columns, are not.
    """
    import cv2

    if min(image.shape) < 3:
        return np.zeros(image.shape, bool)
    # whole levels of one or two bytes are compared as they are: that takes a tenth of the time
    values: np.ndarray = image if image.dtype in (np.uint8, np.uint16) else image.astype(np.float32)
    if finite is not None and not finite.all():
        values = np.where(finite, values, np.median(values[finite]).astype(values.dtype))
    integral = values.dtype.kind == "u"
    least = 0.0 if integral else -np.inf
    most = float(2 ** (8 * values.dtype.itemsize) - 1) if integral else np.inf
    rows, cols = values.shape[0] - 2, values.shape[1] - 2
    centre = values[1:-1, 1:-1]
    first_max, high = (np.full(centre.shape, least, values.dtype) for _ in range(2))
    first_min, low = (np.full(centre.shape, most, values.dtype) for _ in range(2))
    between = np.empty_like(high)
    for dr in range(3):
        for dc in range(3):
            if (dr, dc) != (1, 1):
                near = values[dr : dr + rows, dc : dc + cols]
                cv2.max(high, cv2.min(first_max, near, between), high)
                cv2.min(low, cv2.max(first_min, near, between), low)
                cv2.max(first_max, near, first_max)
                cv2.min(first_min, near, first_min)
    # of whole levels a difference below nought is nought, which is no excess either
    spread = cv2.subtract(high, low)
    excess = cv2.max(cv2.subtract(centre, high), cv2.subtract(low, centre))
    quantum = 1.0 if image.dtype.kind in "ui" else 0.0
    step = max(OUTLIER_SIGMAS * _rough_sigma(values, spread), 2 * quantum)
    limit = values.dtype.type(min(math.floor(step), most) if integral else step)
    outliers = np.zeros(image.shape, bool)
    outliers[1:-1, 1:-1] = (excess > spread) & (excess > limit)
    return outliers


def _rough_sigma(values: np.ndarray, spread: np.ndarray) -> float:
    """Noise sigma from the median fourth difference along the columns' axis; fringe-blind.

    Of a narrow picture, from the spread of the eight around each pixel.
    """
    if values.shape[1] < 8:
        # around noise alone the second extremes lie about 1.7 sigmas apart
        return float(np.median(spread)) / 1.7
    if values.dtype == np.uint8:
        return _middle_of_bytes(values[::2]) * 1.4826 / float(np.sqrt(70.0))
    v = values[::2].astype(np.float32)
    mixed = v[:, :-4] - 4 * v[:, 1:-3] + 6 * v[:, 2:-2] - 4 * v[:, 3:-1] + v[:, 4:]
    return float(np.median(np.abs(mixed))) * 1.4826 / float(np.sqrt(70.0))


def _middle_of_bytes(levels: np.ndarray) -> float:
    """Median size of the fourth differences along whole levels of one byte: by counting them."""
    import cv2

    fourth = np.array([[1.0, -4.0, 6.0, -4.0, 1.0]], np.float32)
    sizes = np.abs(cv2.filter2D(levels, cv2.CV_16S, fourth)[:, 2:-2]).view(np.uint16)
    largest = 16 * 255
    counts = cv2.calcHist([sizes], [0], None, [largest + 1], [0, largest + 1]).ravel()
    below, last = np.cumsum(counts), sizes.size - 1
    ends = np.searchsorted(below, [last // 2, (last + 1) // 2], side="right")
    return float(ends.mean())


@dataclass(frozen=True)
class Normalised:
    """A fringe signal and what it was made with, all (row, col) float32."""

    signal: np.ndarray  # nominally 0 to 1, noise may pass the ends; NaN where not valid
    valid: Mask
    background: np.ndarray  # D, a fraction of full scale
    # B - D, a fraction of full scale: the signal's sigma is the light's over it
    contrast: np.ndarray


def normalise(
    image: Linear | np.ndarray, dark: Linear | np.ndarray, bright: Linear | np.ndarray
) -> Normalised:
    """Take background and illumination out of a frame: s = (I - D) / (B - D), all linear light.

    D is the unloaded specimen in the dark field, or what stands for it, B the same in the bright
    field. InputError where the sizes differ or nothing has contrast.
    """
    light, valid = _parts(image)
    low, low_valid = _parts(dark)
    high, high_valid = _parts(bright)
    for name, part in (("no-load dark", low), ("no-load bright", high)):
        if part.shape != light.shape:
            raise InputError(
                message(
                    "frame_pixels_rows_columns", name=name, shape=part.shape, shape_2=light.shape
                )
            )
    valid = valid & low_valid & high_valid
    contrast = high - low
    usual = float(np.median(contrast[valid])) if valid.any() else 0.0
    if not usual > 0:
        raise InputError(message("frame_has_no_contrast", usual=usual))
    valid = valid & (contrast > MIN_CONTRAST * usual)
    signal = np.full(light.shape, np.nan, np.float32)
    np.divide(light - low, contrast, out=signal, where=valid)
    return Normalised(signal, valid, low.astype(np.float32), contrast.astype(np.float32))


def _parts(image: Linear | np.ndarray) -> tuple[np.ndarray, Mask]:
    if isinstance(image, Linear):
        return image.image, image.valid
    plain = np.asarray(image)
    return plain, np.isfinite(plain)
