"""A video's thinned pixels: what is the same for all its frames is prepared once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.frame_data import FrameData
from isochrome.fit.tone import CLEAR_SIGMAS, Pixels, Toned, stored
from isochrome.frames.noise import NoiseModel

Array = NDArray[Any]
Mask = NDArray[np.bool_]

_ENOUGH = 0.25
"""Share of pixels that must be clear of black and white for the others to be left out."""


@dataclass(frozen=True)
class Thinned:
    """Every `stride`-th pixel where a video can be trusted, `keep` (rows, cols), n of them.

    `light`, `dark` (k, n), bases of illumination and background; `full`, the largest grey level;
    `noise`, of the camera; `gamma` of the frames.
    """

    stride: int
    keep: Mask
    light: Array
    dark: Array
    full: float
    noise: NoiseModel
    gamma: float

    def levels(self, image: Array) -> Array:
        """A frame's levels at the pixels (n,), fractions of full scale; NaN where it has none."""
        thin = image[:: self.stride, :: self.stride][self.keep].astype(np.float32)
        thin /= np.float32(self.full)
        return thin

    def with_noise(self, noise: NoiseModel) -> Thinned:
        """The same pixels of a camera whose noise was told anew."""
        return replace(self, noise=noise)

    def look(self, model: Array) -> Look:
        """Which pixels to use, and with what weight, about a model (n,) of the light."""
        level = stored(model, self.gamma)
        sigma = (self.noise.sigma(level * self.full) / self.full).astype(np.float32)
        room = CLEAR_SIGMAS * sigma
        clear = (level > room) & (level < 1.0 - room)
        if np.count_nonzero(clear) <= _ENOUGH * clear.size:
            clear[:] = True
        keep = self.keep.copy()
        keep[keep] = clear
        return Look(
            clear,
            1.0 / sigma[clear],
            np.ascontiguousarray(self.light[:, clear]),
            np.ascontiguousarray(self.dark[:, clear]),
            keep,
            self.gamma,
        )

    def light_of(self, toned: Toned, signal: Array) -> Array:
        """The light (n,) of a linear solution at all the pixels, for their signal (n,)."""
        split = len(self.light)
        a, c = np.split(toned.part.coefficients.astype(np.float32), [split])
        return np.asarray((a @ self.light) * signal + c @ self.dark)


@dataclass(frozen=True)
class Look:
    """The pixels in use: `clear` (n,) of the thinned ones, their `weight` = 1/σ and bases."""

    clear: Mask
    weight: Array
    light: Array
    dark: Array
    keep: Mask
    gamma: float

    def pixels(self, levels: Array) -> Pixels:
        """The pixels of a frame from its thinned levels."""
        raw = levels[self.clear]
        return Pixels(raw, self.weight, self.light, self.dark, self.keep, self.gamma)


def thin_frame(
    data: FrameData, region: Mask, stride: int, *, full: float, noise: NoiseModel
) -> Thinned:
    """The pixels of a prepared frame, whose like all of a video's frames have.

    Parameters: `data`, whole; `region` (rows, cols), strided; `stride`; `full`, the largest grey
    level; `noise`. Returns a Thinned.
    """
    thin = data.every(stride)
    keep = thin.valid & region
    return Thinned(
        stride,
        keep,
        np.stack([np.asarray(b)[keep] for b in thin.illumination]).astype(np.float32),
        np.stack([np.asarray(b)[keep] for b in thin.background]).astype(np.float32),
        full,
        noise,
        data.gamma,
    )
