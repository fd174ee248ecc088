"""A captured frame made ready for a fit: light, noise, mask, and the bases of its linear part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.basis import polynomial_basis
from isochrome.frames import Frame, Linear, estimate_noise, to_linear
from isochrome.scene import Scene

Array = NDArray[Any]
Mask = NDArray[np.bool_]

_SMOOTH_PX = 1.5


@dataclass(frozen=True)
class FrameData:
    """One frame: `light` and its noise `sigma` (fractions of full scale), `valid`, the bases.

    `light`, `sigma`, `valid` (rows, cols); `illumination`, `background` (k, rows, cols).
    """

    name: str
    light: Array
    sigma: Array
    valid: Mask
    illumination: Array
    background: Array

    def plain(self) -> FrameData:
        """The frame with one amplitude for all its light: for a search, or a model that is poor."""
        return replace(self, illumination=self.illumination[:1])

    def every(self, stride: int) -> FrameData:
        """The frame at every `stride`-th pixel."""
        cut = (slice(None, None, stride),) * 2
        return FrameData(
            self.name,
            self.light[cut],
            self.sigma[cut],
            self.valid[cut],
            self.illumination[:, ::stride, ::stride],
            self.background[:, ::stride, ::stride],
        )


def prepare_frame(
    frame: Frame,
    scene: Scene,
    *,
    bit_depth: int | None,
    no_load: tuple[Linear | None, Linear | None] = (None, None),
) -> FrameData:
    """Turn raw grey levels into light with its noise, and choose the linear part's bases.

    With both no-load frames the illumination is their difference times a plane, and the background
    the dark one plus a constant; without, smooth polynomials stand for what is missing. The noise
    is told from the frame itself, at a smoothed grey level, so that a pixel's weight does not
    follow its own noise.
    Parameters: `frame`; `scene`, for frames.gamma; `bit_depth` of the sensor; `no_load`, the dark
    and the bright frame. Returns FrameData. Raises InputError on a blank frame.
    """
    from scipy.ndimage import gaussian_filter

    gamma = scene.frames.stated_gamma
    linear = to_linear(
        frame.image, bit_depth=bit_depth, gamma=gamma, name=frame.name, mask=frame.mask
    )
    raw = np.where(np.isfinite(frame.image), frame.image, 0.0).astype(np.float32)
    noise = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
    level = gaussian_filter(raw, _SMOOTH_PX)
    sigma = noise.linear_sigma(level, bit_depth=bit_depth, gamma=gamma)
    dark, bright = no_load
    valid = linear.valid.copy()
    for part in no_load:
        if part is not None:
            valid &= part.valid
    shape = linear.image.shape
    one = np.ones((1, *shape))
    if dark is not None and bright is not None:
        illumination = polynomial_basis(shape, 1, times=bright.image - dark.image)
        background = np.concatenate((dark.image[None], one))
    elif bright is not None:
        illumination = polynomial_basis(shape, 1, times=bright.image)
        background = polynomial_basis(shape, 1)
    else:
        illumination = polynomial_basis(shape, 2)
        background = one if dark is None else np.concatenate((dark.image[None], one))
    # a mask is no edge of the light: a rim is looked for in all that the camera saw
    light = np.where(np.isfinite(linear.image), linear.image, 0.0)
    return FrameData(frame.name, light, sigma, valid, illumination, background)
