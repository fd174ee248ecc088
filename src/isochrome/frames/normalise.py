"""From light to fringe signal: background and illumination taken out.

A frame of a polariscope is I = D + (B - D) s, where D is the background (the unloaded specimen in
the dark field), B the full illumination (the same in the bright field), and s the fringe signal:
s = sin^2(pi N) in the dark field and cos^2(pi N) in the bright one, N the fringe order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isochrome.errors import InputError
from isochrome.frames.linear import Linear, Mask

MIN_CONTRAST = 0.05
"""Pixels whose contrast B - D is below this part of the frame's median are masked."""


@dataclass(frozen=True)
class Normalised:
    """A fringe signal and what it was made with, all (row, col) float32.

    `signal`: s, nominally 0 to 1, noise may pass the ends, NaN where `valid` is False; `valid`,
    True = trusted; `background` D and `contrast` B - D as fractions of full scale, so that the
    signal's sigma is that of the light over `contrast`.
    """

    signal: np.ndarray
    valid: Mask
    background: np.ndarray
    contrast: np.ndarray


def normalise(
    image: Linear | np.ndarray, dark: Linear | np.ndarray, bright: Linear | np.ndarray
) -> Normalised:
    """Take background and illumination out of a frame: s = (I - D) / (B - D).

    Parameters: `image`, the light (row, col), from `to_linear`; `dark`, `bright`, the unloaded
    specimen in the dark and the bright field, also linear, or what stands for them (see
    `isochrome.fringes.ends`). Returns a Normalised. Raises InputError where the sizes differ or
    nothing has contrast.
    """
    light, valid = _parts(image)
    low, low_valid = _parts(dark)
    high, high_valid = _parts(bright)
    for name, part in (("no-load dark", low), ("no-load bright", high)):
        if part.shape != light.shape:
            raise InputError(
                f"the {name} frame is {part.shape} pixels (rows, columns) and the frame "
                f"{light.shape}; capture both with the same camera settings and roi"
            )
    valid = valid & low_valid & high_valid
    contrast = high - low
    usual = float(np.median(contrast[valid])) if valid.any() else 0.0
    if not usual > 0:
        raise InputError(
            "the frame has no contrast between its no-load dark and bright ends (median "
            f"{usual:.3g} of full scale); are the two no-load files swapped, or the light off?"
        )
    valid = valid & (contrast > MIN_CONTRAST * usual)
    signal = np.full(light.shape, np.nan, np.float32)
    np.divide(light - low, contrast, out=signal, where=valid)
    return Normalised(signal, valid, low.astype(np.float32), contrast.astype(np.float32))


def _parts(image: Linear | np.ndarray) -> tuple[np.ndarray, Mask]:
    if isinstance(image, Linear):
        return image.image, image.valid
    plain = np.asarray(image)
    return plain, np.isfinite(plain)
