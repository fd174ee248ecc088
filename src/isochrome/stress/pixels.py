"""The pixel grid on which a field is wanted: the camera's, or every few pixels of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.scene import Scene

Floats = NDArray[np.floating]

MAX_PIXELS = 100_000_000

MAX_REACH_MM = 1e6
"""A kilometre: no picture of a specimen, and its pixels' places are still told to a nanometre."""


@dataclass(frozen=True)
class PixelGrid:
    """Square pixels of `pixel_mm`; pixel centres at left_mm + (col+1/2) pixel_mm, and so in z.

    `left_mm` and `top_mm` are outer edges: x from the centre of the contact (or of the disc or
    beam), z below the surface (or below the top of the disc or beam).
    """

    rows: int
    cols: int
    left_mm: float
    top_mm: float
    pixel_mm: float

    @property
    def x_mm(self) -> Floats:
        """Centres of the columns (cols,), mm."""
        return self.left_mm + self.pixel_mm * (np.arange(self.cols) + 0.5)

    @property
    def z_mm(self) -> Floats:
        """Centres of the rows (rows,), mm, below the surface."""
        return self.top_mm + self.pixel_mm * (np.arange(self.rows) + 0.5)

    def every(self, stride: int) -> PixelGrid:
        """The grid of the pixels image[::stride, ::stride]: the same centres, fewer of them."""
        shift = 0.5 * (stride - 1) * self.pixel_mm
        return replace(
            self,
            rows=-(-self.rows // stride),
            cols=-(-self.cols // stride),
            left_mm=self.left_mm - shift,
            top_mm=self.top_mm - shift,
            pixel_mm=self.pixel_mm * stride,
        )


def pixel_grid(scene: Scene, shape: tuple[int, int] | None = None) -> PixelGrid:
    """The pixel grid of a scene's camera.

    Parameters: `scene`, with [camera]; `shape` (rows, cols) where the camera does not give it.
    The place defaults to the contact (or disc, beam) in the middle of the width, the surface at
    the top (a disc or beam in the middle of the height). Returns a PixelGrid. Raises InputError on
    a missing key or a picture too large.
    """
    camera = scene.camera
    if camera is None:
        raise InputError(f"{scene.name}: [camera] is missing, and a picture needs it; add it")
    rows = camera.height_px or (shape[0] if shape else None)
    cols = camera.width_px or (shape[1] if shape else None)
    for key, value in (("height_px", rows), ("width_px", cols), ("pixel_mm", camera.pixel_mm)):
        if value is None:
            raise InputError(f"{scene.name}: camera.{key} is missing; add it")
    assert rows is not None and cols is not None and camera.pixel_mm is not None
    if rows * cols > MAX_PIXELS:
        raise InputError(
            f"{scene.name}: camera.width_px x height_px = {cols} x {rows} is over {MAX_PIXELS} "
            "pixels; lower them"
        )
    left, top = camera.left_mm, camera.top_mm
    if left is None:
        left = -0.5 * cols * camera.pixel_mm
    if top is None:
        height = scene.specimen.diameter_mm if scene.model == "disc" else None
        height = scene.specimen.height_mm if scene.model == "beam" else height
        top = 0.0 if height is None else 0.5 * (height - rows * camera.pixel_mm)
    reach = max(abs(left), abs(top)) + max(rows, cols) * camera.pixel_mm
    if reach > MAX_REACH_MM:
        raise InputError(
            f"{scene.name}: the picture reaches {reach:.3g} mm from the contact (camera.pixel_mm = "
            f"{camera.pixel_mm:g}, camera.left_mm = {left:g}, camera.top_mm = {top:g}), and "
            f"{MAX_REACH_MM:g} mm are allowed; give them in mm"
        )
    return PixelGrid(rows, cols, left, top, camera.pixel_mm)
