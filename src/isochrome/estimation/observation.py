"""A captured frame made ready for a fit: light, noise, mask, and the bases of its linear part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isochrome.estimation.covariance import Array, Mask
from isochrome.estimation.light import LightModel, frame_light
from isochrome.frames import Frame, Linear, NoiseModel, estimate_noise, full_scale, to_linear
from isochrome.scene import Scene

LEVEL_PX, _LEVEL_WINDOW = 1.5, (13, 13)
"""Standard deviation of the Gaussian mean that tells the grey level about a pixel where no model
does, and the window that it extends, pixels."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """One prepared frame (rows, cols), in fractions of full scale; `name` is that of messages."""

    name: str
    light: Array  # linear, raw^gamma
    sigma: Array
    valid: Mask  # may be used
    raw: Array  # the light as the sensor stored it
    raw_sigma: Array
    gamma: float  # from raw to light


_IMAGES = ("light", "sigma", "valid", "raw", "raw_sigma")
"""What an observation has pixel by pixel."""


@dataclass(frozen=True, kw_only=True)
class FrameData(Observation):
    """A prepared frame to hold a scene against."""

    lamp: LightModel  # what illumination and background are sums of
    noise_ratio: float = 1.0  # over what the finest part shows, which compression takes away
    waves: Array | None = None  # (3, k), of what no cause explains: see `with_waves`
    bent: Array | None = None  # (rows, cols), share of the light that is not sure: see `less_sure`

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the picture."""
        return self.light.shape[0], self.light.shape[1]

    def plain(self) -> FrameData:
        """The frame with one amplitude for all its light: for a search, or a model that is poor."""
        return replace(self, lamp=self.lamp.plain())

    def toned(self, gamma: float) -> FrameData:
        """The frame read with another exponent, and with smooth light whatever was before."""
        if self.bent is not None:
            return self.less_sure(None).toned(gamma)
        level = np.maximum(self.raw, self.raw_sigma)
        return replace(
            self,
            light=np.maximum(self.raw, 0.0) ** np.float32(gamma),
            sigma=(gamma * level ** (gamma - 1.0) * self.raw_sigma).astype(np.float32),
            lamp=frame_light(
                self.shape,
                terms=self.lamp.first if self.lamp.bright is None else None,
                uneven=self.lamp.uneven,
            ),
            gamma=gamma,
        )

    def as_fitted(self, scene: Scene) -> FrameData:
        """The frame read with a scene's exponent; as it is where that is its own."""
        gamma = scene.frames.stated_gamma
        return self if gamma == self.gamma else self.toned(gamma)

    def with_noise(self, ratio: float) -> FrameData:
        """The frame with so many times its noise."""
        share = np.float32(ratio)
        return replace(
            self,
            sigma=share * self.sigma,
            raw_sigma=share * self.raw_sigma,
            noise_ratio=ratio * self.noise_ratio,
            bent=None if self.bent is None else share * self.bent,
        )

    def less_sure(self, share: Array | None) -> FrameData:
        """The frame with a share (rows, cols) of its light as noise besides, where stresses bend
        light so much that its density changes, in place of what it has of it."""
        if share is None and self.bent is None:
            return self
        more = np.zeros(self.shape, np.float32)
        for sign, part in ((1.0, share), (-1.0, self.bent)):
            if part is not None:
                more += np.float32(sign) * np.square(part)
        sigma = np.sqrt(np.square(self.sigma) + more * np.square(self.light))
        stored = np.sqrt(np.square(self.raw_sigma) + more * np.square(self.raw / self.gamma))
        return replace(self, sigma=sigma, raw_sigma=stored, bent=share)

    def lying(self, move: Callable[[Array], Array]) -> FrameData:
        """The frame, its mask and its no-load light turned or mirrored by `move`, of images."""
        parts: dict[str, Any] = {name: move(getattr(self, name)) for name in _IMAGES}
        ends = (self.lamp.dark, self.lamp.bright)
        dark, bright = (None if end is None else move(end) for end in ends)
        rows, cols = parts["light"].shape
        return replace(self, lamp=frame_light((rows, cols), dark, bright), **parts)

    def in_blocks(self, side: int) -> FrameData:
        """Means over blocks of `side` x `side` pixels, odd; valid where all their pixels are."""
        import cv2

        def mean(image: Array) -> Array:
            return np.asarray(cv2.blur(image.astype(np.float32), (side, side))[::side, ::side])

        thin: dict[str, Any] = {name: mean(getattr(self, name)) for name in ("light", "raw")}
        for name in ("sigma", "raw_sigma"):
            thin[name] = np.sqrt(mean(getattr(self, name) ** 2)) / np.float32(side)
        # at the picture's ends blocks are not whole
        valid = self.valid.astype(np.float32)
        share = cv2.blur(valid, (side, side), borderType=cv2.BORDER_CONSTANT)[::side, ::side]
        thin["valid"] = share > 1.0 - 0.5 / side**2
        return replace(self, lamp=self.lamp.every(side), **thin)

    def every(self, stride: int) -> FrameData:
        """The frame at every `stride`-th pixel."""
        thin = {name: getattr(self, name)[::stride, ::stride] for name in _IMAGES}
        return replace(self, lamp=self.lamp.every(stride), **thin)


def observe(
    image: Array,
    *,
    name: str,
    bit_depth: int | None,
    gamma: float,
    mask: Mask | None = None,
    noise: NoiseModel | None = None,
) -> Observation:
    """Turn a frame's raw grey levels into light with its noise; InputError on a blank frame. The
    noise is told from the frame itself where it is not known. A pixel's own is that of the grey
    level about it, a Gaussian mean in which the pixel counts for a fourteenth, not a ninth as in
    one over 3 x 3: a weight that follows the pixel's own noise pulls every fit to the dark side.
    """
    import cv2

    linear = to_linear(image, bit_depth=bit_depth, gamma=gamma, name=name, mask=mask)
    blank = ~np.isfinite(image)
    grey = image.astype(np.float32)
    grey[blank] = 0.0
    if noise is None:
        noise = estimate_noise(image, linear.valid, bit_depth=bit_depth)
    level = cv2.GaussianBlur(grey, _LEVEL_WINDOW, LEVEL_PX, borderType=cv2.BORDER_REFLECT)
    full = np.float32(full_scale(bit_depth))
    raw_sigma = noise.sigma(level) / full
    sigma = raw_sigma
    if gamma != 1.0:
        sigma = noise.linear_sigma(level, bit_depth=bit_depth, gamma=gamma).astype(np.float32)
    # a mask is no edge of the light: a rim is looked for in all that the camera saw
    light = linear.image
    light[blank] = 0.0
    return Observation(
        name=name, light=light, sigma=sigma, valid=linear.valid, raw=grey / full,
        raw_sigma=raw_sigma, gamma=gamma,
    )  # fmt: skip


def prepare_frame(
    frame: Frame,
    scene: Scene,
    *,
    bit_depth: int | None,
    no_load: tuple[Linear | None, Linear | None] = (None, None),
    gamma_found: bool = False,
    noise: NoiseModel | None = None,
) -> FrameData:
    """Observe a frame, with the light of `frame_light`; its noise by default as the frame tells it.
    An unknown gamma is 1 where it is going to be found (`gamma_found`), else InputError.
    """
    gamma = scene.frames.first_gamma if gamma_found else scene.frames.stated_gamma
    observed = observe(
        frame.image, name=frame.name, bit_depth=bit_depth, gamma=gamma, mask=frame.mask, noise=noise
    )
    ends = [part for part in no_load if part is not None]
    valid = np.logical_and.reduce([observed.valid, *(part.valid for part in ends)])
    rows, cols = observed.light.shape
    lamp = frame_light((rows, cols), *(None if part is None else part.image for part in no_load))
    return FrameData(**(vars(observed) | {"valid": valid}), lamp=lamp)
