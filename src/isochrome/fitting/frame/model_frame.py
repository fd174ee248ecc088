"""A fitted scene held against its frame at every pixel: picture, illumination, background."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from isochrome.errors import InputError
from isochrome.estimation import FrameData, PixelLight, Pixels, cosine_sum, solve_linear
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.renderer import SceneRenderer, scene_optics, with_waves
from isochrome.fitting.frame.unknowns import thinning
from isochrome.optics import FringeWave, blurred
from isochrome.scene import Scene
from isochrome.simulation import Picture, make_picture
from isochrome.stress import PixelGrid, pixel_grid


@dataclass(frozen=True, kw_only=True)
class ModelFrame:
    """What a scene says of every pixel (rows, cols) of a frame: I = B + A S in the light's unit.

    `wave`, the ideal signal about the orders; `signal`, S at every so many of the pixels; `mask`,
    trusted pixels of the specimen whose fringes are not washed out; `chi`, residual over noise.
    """

    pixels: PixelGrid
    picture: Picture
    wave: FringeWave
    signal: Callable[[int], Array]
    illumination: Array
    background: Array
    mask: Mask
    chi: float

    def contrast_noise(self, sigma: Array) -> float:
        """Noise `sigma` over the fringes' amplitude, by the median pixel; NaN: nothing is lit."""
        # both are smooth: of every few rows and columns the median is the same
        every = thinning(self.mask.size)
        sigma, light, lit = (
            part[::every, ::every] for part in (sigma, self.illumination, self.mask)
        )
        lit = lit & (light > 0.0)
        return float(np.median(sigma[lit] / light[lit])) if lit.any() else float("nan")


def evaluate_model(data: FrameData, scene: Scene, *, difference: Array | None = None) -> ModelFrame:
    """Render a one-state scene on a frame's own pixels, its stress `difference` (MPa) perhaps
    known, and fit the linear light to it. Chi is inf for a negative illumination; InputError where
    no pixel is trusted.
    """
    if scene.frames.stated_gamma != data.gamma:
        data = data.toned(scene.frames.stated_gamma)
    grid = pixel_grid(scene, data.shape)
    if difference is None:
        renderer = SceneRenderer(scene, data.shape)
        difference = renderer.difference(scene, renderer.state(scene))
    if data.waves is not None:
        difference = with_waves(scene, difference, cosine_sum(data.shape, data.waves))
    picture = make_picture(scene, difference, grid)
    wave = scene_optics(scene).wave(
        picture.difference, order=picture.mean_order, visibility=picture.visibility
    )

    def signal(stride: int) -> Array:
        assert scene.camera is not None
        if scene.camera.blur_px > 0.0:
            light = np.where(picture.material, wave.light, 0.0)
            return np.asarray(blurred(light, scene.camera.blur_px)[::stride, ::stride])
        return wave.every(stride).light

    mask = data.valid & picture.material & (picture.visibility > 0.5)
    # every few of a large frame's pixels know a handful of coefficients well enough
    stride = thinning(int(np.count_nonzero(mask)))
    thin, keep = data.every(stride), mask[::stride, ::stride]
    if not keep.any():
        raise InputError("no_pixel_can_trusted", name=data.name)
    weight = (1.0 / thin.sigma[keep]).astype(np.float32)
    pixels = Pixels(thin.light[keep], weight, PixelLight(thin.lamp, keep))
    part = solve_linear(pixels, signal(stride)[keep].astype(np.float32))
    a, c = np.split(part.coefficients, [pixels.light.split])
    chi = float(np.sqrt(part.cost / max(1, pixels.size - part.count)))
    return ModelFrame(
        pixels=grid, picture=picture, wave=wave, signal=signal, mask=mask,
        illumination=data.lamp.illumination(a), background=data.lamp.background(c),
        chi=chi if part.positive else float("inf"),
    )  # fmt: skip
