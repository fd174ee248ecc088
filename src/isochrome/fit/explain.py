"""A fitted scene held against its frame at every pixel: picture, illumination, background."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.frame_data import FrameData
from isochrome.fit.linear import evaluate
from isochrome.optics import make_chain, polariscope_signal
from isochrome.scene import Scene
from isochrome.simulate import Picture, make_picture, scene_states, state_difference
from isochrome.stress import PixelGrid, pixel_grid, principal_direction

Array = NDArray[Any]


@dataclass(frozen=True)
class Explained:
    """What a scene says of every pixel of a frame (maps (rows, cols)).

    `pixels`; `picture`, its fringe order; `response`, order to signal at this frame's directions
    and pixels; `signal`; `illumination` and `background`, in the light's unit; `mask`, True where
    the pixel is trusted, of the specimen, and its fringes are not washed out; `chi`.
    """

    pixels: PixelGrid
    picture: Picture
    response: Callable[[Array], Array]
    signal: Array
    illumination: Array
    background: Array
    mask: NDArray[np.bool_]
    chi: float


def explain_frame(data: FrameData, scene: Scene) -> Explained:
    """Render a one-state scene on the frame's own pixels, and fit the linear part to it.

    Parameters: `data`; `scene`, with fitted values. Returns Explained.
    """
    if scene.frames.stated_gamma != data.gamma:
        data = data.toned(scene.frames.stated_gamma)
    grid = pixel_grid(scene, (data.light.shape[0], data.light.shape[1]))
    picture = make_picture(scene, state_difference(scene, scene_states(scene)[-1], grid), grid)
    chain = make_chain(scene.polariscope)
    direction = None if chain.ideal else principal_direction(picture.difference)

    def response(order: Array) -> Array:
        return polariscope_signal(order, chain, direction=direction, visibility=picture.visibility)

    signal = response(np.where(picture.material, picture.order, 0.0))
    assert scene.camera is not None
    if scene.camera.blur_px > 0.0:
        from scipy.ndimage import gaussian_filter

        signal = gaussian_filter(np.where(picture.material, signal, 0.0), scene.camera.blur_px)
    mask = data.valid & picture.material & (picture.visibility > 0.5)
    linear = evaluate(
        data.light,
        signal,
        illumination=data.illumination,
        background=data.background,
        mask=mask,
        sigma=data.sigma,
    )
    return Explained(
        grid,
        picture,
        response,
        signal,
        np.tensordot(linear.illumination_coefficients, data.illumination, 1),
        np.tensordot(linear.background_coefficients, data.background, 1),
        mask,
        linear.chi,
    )
