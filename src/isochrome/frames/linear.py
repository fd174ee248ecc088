"""From raw grey levels to light: full scale, gamma, and which pixels can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from isochrome.errors import InputError
from isochrome.frames.noise import full_scale

Mask = npt.NDArray[np.bool_]
OUTLIER_SIGMAS = 8.0


@dataclass(frozen=True)
class Linear:
    """Light as a fraction of full scale: `image` (row, col) float32, `valid` True = trusted.

    `valid` is False at saturated, dead, hot and non-finite pixels and off the specimen; `image`
    keeps their values.
    """

    image: np.ndarray
    valid: Mask


def to_linear(
    image: np.ndarray,
    *,
    bit_depth: int | None,
    gamma: float = 1.0,
    name: str = "the frame",
    allow_blank: bool = False,
    mask: Mask | None = None,
) -> Linear:
    """Convert raw grey levels to light as a fraction of full scale.

    linear = (raw / (2^bit_depth - 1))^gamma, for a camera that stored raw = linear^(1 / gamma):
    gamma = 1 for a linear one, about 2.2 for one with the usual (sRGB-like) tone curve.

    Parameters: `image` (row, col), raw; `bit_depth` of the sensor, None for float frames that are
    fractions already; `gamma`; `name` for messages; `allow_blank`, True where a constant frame is
    right, as an ideal no-load one is; `mask` (row, col), True on the specimen, as a scene's frames
    carry it. Returns a Linear. Raises InputError where the frame is constant (all black, all
    white), has no finite pixel, is out of range, or is not of the mask's size.
    """
    raw = np.asarray(image)
    if raw.ndim != 2 or raw.size == 0:
        raise InputError(f"{name}: a frame is (row, col), not {raw.shape}; choose a channel")
    if mask is not None and mask.shape != raw.shape:
        raise InputError(
            f"{name}: is {raw.shape} pixels (rows, columns) and the specimen's mask {mask.shape}; "
            "give both one size"
        )
    full = full_scale(bit_depth)
    finite = np.isfinite(raw)
    if not finite.any():
        raise InputError(f"{name}: holds no number (NaN only); check how it was written")
    low, high = float(raw[finite].min()), float(raw[finite].max())
    if high > full:
        given = f"{bit_depth} bits end" if bit_depth else "float frames without a bit depth end"
        raise InputError(f"{name}: holds {high:g}, and {given} at {full:g}; set camera.bit_depth")
    if low == high and not allow_blank:
        what = "all black" if high <= 0 else "all white" if high >= full else "constant"
        raise InputError(f"{name}: is {what} (every pixel {high:g}); check light and exposure")
    light = np.where(finite, raw, 0).astype(np.float32) / np.float32(full)
    valid = finite & (raw < full) & ~find_outliers(raw, finite)
    if gamma != 1:
        valid &= light >= 0  # a background was subtracted: what gamma made of it is not known
        light = np.maximum(light, 0) ** np.float32(gamma)
    light[~finite] = np.nan
    if mask is not None:
        valid &= mask
    return Linear(image=light, valid=valid)


def find_outliers(image: np.ndarray, finite: Mask | None = None) -> Mask:
    """Dead and hot pixels: those far outside the range of the eight around them.

    A pixel is an outlier when it exceeds the second largest of its neighbours (or falls below the
    second smallest) by 8 noise sigmas and by their whole spread. A fringe, however fine, has
    neighbours as bright as itself along its length, and is left alone; one odd pixel and a pair
    are found; larger flaws, and those in the outermost rows and columns, are not.

    Parameters: `image` (row, col), raw; `finite`, where it holds numbers. Returns a mask, True
    where a pixel is dead or hot.
    """
    if min(image.shape) < 3:
        return np.zeros(image.shape, bool)
    values = image.astype(np.float32)
    if finite is not None and not finite.all():
        values[~finite] = np.median(values[finite])
    rows, cols = values.shape[0] - 2, values.shape[1] - 2
    inner = values[1:-1, 1:-1]
    first_max = np.full(inner.shape, -np.inf, np.float32)
    first_min, second_max, second_min = -first_max, first_max.copy(), -first_max
    for dr in range(3):
        for dc in range(3):
            if (dr, dc) != (1, 1):
                near = values[dr : dr + rows, dc : dc + cols]
                np.maximum(second_max, np.minimum(first_max, near), out=second_max)
                np.minimum(second_min, np.maximum(first_min, near), out=second_min)
                np.maximum(first_max, near, out=first_max)
                np.minimum(first_min, near, out=first_min)
    spread = second_max - second_min
    excess = np.maximum(inner - second_max, second_min - inner)
    # Around noise alone the second extremes lie about 1.7 sigmas apart.
    sigma = float(np.median(spread)) / 1.7
    quantum = 1.0 if image.dtype.kind in "ui" else 0.0
    step = max(OUTLIER_SIGMAS * _rough_sigma(values, sigma), 2 * quantum)
    found = np.zeros(image.shape, bool)
    found[1:-1, 1:-1] = excess > np.maximum(spread, step)
    return found


def _rough_sigma(values: np.ndarray, otherwise: float) -> float:
    """Noise sigma from the median fourth difference along the columns' axis; fringe-blind."""
    if values.shape[1] < 8:
        return otherwise
    v = values[::2]
    mixed = v[:, :-4] - 4 * v[:, 1:-3] + 6 * v[:, 2:-2] - 4 * v[:, 3:-1] + v[:, 4:]
    return float(np.median(np.abs(mixed))) * 1.4826 / np.sqrt(70.0)
