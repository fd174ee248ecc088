"""The camera: what the sensor makes of the light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from isochrome.scene import Camera

Array = NDArray[np.floating]


def expose(
    signal: Array, camera: Camera, *, rng: np.random.Generator | None = None
) -> NDArray[np.generic]:
    """Grey levels that the camera stores for a polariscope signal.

    Equation: L = background + brightness (1 - vignette r²) signal, with r the distance from the
    middle over half the diagonal; blurred; with shot noise of L full_well electrons; stored as
    L^(1/gamma) full scale plus read noise, rounded and clipped to the bit depth.
    Parameters: `signal` (rows, cols), 1 = full light; `camera`; `rng`, by default seeded with
    camera.seed. Returns (rows, cols): uint8 or uint16 by the bit depth, float32 without one.
    """
    rng = np.random.default_rng(camera.seed) if rng is None else rng
    light = camera.background + camera.brightness * illumination(signal.shape, camera) * signal
    if camera.blur_px > 0.0:
        from scipy.ndimage import gaussian_filter

        light = gaussian_filter(light, camera.blur_px, mode="nearest")
    if camera.full_well_electrons is not None:
        electrons = np.maximum(light, 0.0) * camera.full_well_electrons
        light = rng.poisson(electrons) / camera.full_well_electrons
    stored = np.maximum(light, 0.0) ** (1.0 / camera.gamma) if camera.gamma != 1.0 else light
    full = 1.0 if camera.bit_depth is None else 2.0**camera.bit_depth - 1.0
    grey = stored * full
    if camera.noise_grey > 0.0:
        grey = grey + rng.normal(0.0, camera.noise_grey, grey.shape)
    if camera.bit_depth is None:
        return grey.astype(np.float32)
    kind = np.uint8 if camera.bit_depth <= 8 else np.uint16
    return np.clip(np.rint(grey), 0.0, full).astype(kind)


def illumination(shape: tuple[int, ...], camera: Camera) -> Array | float:
    """Fall-off of the light, 1 - vignette r², r = 1 in the corners (rows, cols)."""
    if camera.vignette == 0.0:
        return 1.0
    rows, cols = (np.linspace(-1.0, 1.0, n) for n in shape)
    return 1.0 - camera.vignette * 0.5 * (rows[:, None] ** 2 + cols[None, :] ** 2)
