"""A captured frame made ready for a fit: light, noise, mask, and the bases of its linear part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.basis import polynomial_basis
from isochrome.frames import Frame, Linear, estimate_noise, to_linear
from isochrome.frames.noise import full_scale
from isochrome.scene import Scene

Array = NDArray[Any]
Mask = NDArray[np.bool_]

_SMOOTH_PX = 1.5


@dataclass(frozen=True)
class FrameData:
    """One frame: `light` and its noise `sigma` (fractions of full scale), `valid`, the bases.

    `light`, `sigma`, `valid` (rows, cols); `illumination`, `background` (k, rows, cols); `raw` and
    `raw_sigma`, the same as the sensor stored it, light = raw^gamma.
    """

    name: str
    light: Array
    sigma: Array
    valid: Mask
    illumination: Array
    background: Array
    raw: Array
    raw_sigma: Array
    gamma: float

    def plain(self) -> FrameData:
        """The frame with one amplitude for all its light: for a search, or a model that is poor."""
        return replace(self, illumination=self.illumination[:1])

    def toned(self, gamma: float) -> FrameData:
        """The frame read with another exponent, and with smooth light whatever was before."""
        shape = (self.light.shape[0], self.light.shape[1])
        level = np.maximum(self.raw, self.raw_sigma)
        return replace(
            self,
            light=np.maximum(self.raw, 0.0) ** np.float32(gamma),
            sigma=(gamma * level ** (gamma - 1.0) * self.raw_sigma).astype(np.float32),
            illumination=light_basis(shape, 2),
            background=light_basis(shape, 0),
            gamma=gamma,
        )

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
            self.raw[cut],
            self.raw_sigma[cut],
            self.gamma,
        )


def prepare_frame(
    frame: Frame,
    scene: Scene,
    *,
    bit_depth: int | None,
    no_load: tuple[Linear | None, Linear | None] = (None, None),
    gamma_found: bool = False,
) -> FrameData:
    """Turn raw grey levels into light with its noise, and choose the linear part's bases.

    With both no-load frames the illumination is their difference times a plane, and the background
    the dark one plus a constant; without, smooth polynomials stand for what is missing. The noise
    is told from the frame itself, at a smoothed grey level, so that a pixel's weight does not
    follow its own noise.
    Parameters: `frame`; `scene`, for frames.gamma; `bit_depth` of the sensor; `no_load`, the dark
    and the bright frame; `gamma_found`, whether an unknown gamma is going to be found, and is 1
    until then. Returns FrameData. Raises InputError on a blank frame, and an unknown gamma.
    """
    from scipy.ndimage import gaussian_filter

    gamma = scene.frames.first_gamma if gamma_found else scene.frames.stated_gamma
    linear = to_linear(
        frame.image, bit_depth=bit_depth, gamma=gamma, name=frame.name, mask=frame.mask
    )
    finite = np.isfinite(frame.image)
    grey = np.where(finite, frame.image, 0.0).astype(np.float32)
    noise = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
    level = gaussian_filter(grey, _SMOOTH_PX)
    dark, bright = no_load
    valid = linear.valid.copy()
    for part in no_load:
        if part is not None:
            valid &= part.valid
    full = np.float32(full_scale(bit_depth))
    raw_sigma = noise.sigma(level).astype(np.float32) / full
    sigma = raw_sigma
    if gamma != 1.0:
        sigma = noise.linear_sigma(level, bit_depth=bit_depth, gamma=gamma).astype(np.float32)
    illumination, background = _bases((grey.shape[0], grey.shape[1]), dark, bright)
    return FrameData(
        frame.name,
        # a mask is no edge of the light: a rim is looked for in all that the camera saw
        np.where(finite, linear.image, np.float32(0.0)),
        sigma,
        valid,
        illumination,
        background,
        grey / full,
        raw_sigma,
        gamma,
    )


def _bases(
    shape: tuple[int, int], dark: Linear | None, bright: Linear | None
) -> tuple[Array, Array]:
    """Bases of illumination and background from what no-load frames there are."""
    if dark is not None and bright is not None:
        light = light_basis(shape, 1) * (bright.image - dark.image)
        return light, np.concatenate((dark.image[None], light_basis(shape, 0)))
    if bright is not None:
        return light_basis(shape, 1) * bright.image, light_basis(shape, 1)
    one = light_basis(shape, 0)
    return light_basis(shape, 2), one if dark is None else np.concatenate((dark.image[None], one))


@lru_cache(maxsize=8)
def light_basis(shape: tuple[int, int], degree: int) -> Array:
    """Polynomials of a frame's light in single precision, the same for all frames of a size.

    The last ones are kept. See `polynomial_basis`.
    """
    basis = polynomial_basis(shape, degree, dtype=np.float32)
    basis.flags.writeable = False
    return basis
