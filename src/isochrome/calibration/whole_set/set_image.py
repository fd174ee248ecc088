"""The pixels of one image of a whole set, and its tone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.shot import Shot
from isochrome.stress import Lens

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEVEL_PX = 1.5
"""Gaussian mean by which the light about a pixel is told where no model tells it."""


@dataclass(frozen=True, kw_only=True)
class SetImage:
    """An image's fitted pixels (n,): places, light, noise, and the `level` of light without noise.

    The curve of a tone is taken along its tangent at the level: noise on a curve is no light.
    """

    mask: Mask
    rows: Array
    cols: Array
    light: Array
    sigma: Array
    level: Array

    @classmethod
    def of(
        cls, shot: Shot, pick: tuple[NDArray[np.intp], ...], mask: Mask, level: Array | None
    ) -> SetImage:
        """The pixels of a shot at an index, where a mask says.

        `level` (R, C) is the light without noise; by default a mean of the pixels near.
        """
        from scipy.ndimage import gaussian_filter

        rows, cols = (np.broadcast_to(p, mask.shape)[mask].astype(float) for p in pick)
        light, sigma = (m[pick][mask].astype(float) for m in (shot.light, shot.sigma))
        if level is None:
            level = gaussian_filter(shot.light, _LEVEL_PX)[pick]
        near = np.maximum(level[mask].astype(float), sigma)
        return cls(mask=mask, rows=rows, cols=cols, light=light, sigma=sigma, level=near)

    def toned(self, gamma: float) -> Array:
        """Light over noise with another exponent g, (L^g + g L^(g-1) (I - L))/(g L^(g-1) σ)."""
        if gamma == 1.0:
            return self.light / self.sigma
        return np.asarray((self.light + (1.0 / gamma - 1.0) * self.level) / self.sigma)

    def scale(self, gamma: float) -> Array | float:
        """What light over noise of one exponent is multiplied by for another's (n,)."""
        if gamma == 1.0:
            return 1.0
        scale: Array = (self.level / self.level.max()) ** (1.0 - gamma) / gamma
        return scale


def looked_at(
    rows: Array, cols: Array, shape: tuple[int, int], lens: dict[str, float]
) -> tuple[Array, Array]:
    """Rows and columns (n,), px, of the places that pixels look at through a lens.

    Parameters: `shape` of the picture; `lens`, by the camera's keys.
    """
    height, width = shape
    down, right = 0.5 * (height - 1), 0.5 * (width - 1)
    given = {key.partition(".")[2]: value for key, value in lens.items()}
    through = Lens(
        right_mm=right, down_mm=down, half_width_mm=0.5 * width, half_height_mm=0.5 * height,
        **given,
    )  # fmt: skip
    x, z = through.looked_at(cols - right, rows - down)
    return np.asarray(z + down, dtype=np.float64), np.asarray(x + right, dtype=np.float64)
