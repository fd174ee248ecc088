"""The model's fringes while a slider moves: a little less exact than a fit's, and much faster.

The mean over a pixel's area and the last digits of a worn contact are left out: some hundredths of
the full light, which no eye sees. What is fitted, checked and simulated is never this picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.fitting import SceneRenderer, with_numerics
from isochrome.scene import Scene
from isochrome.specimens import specimen_model
from isochrome.stress import PixelGrid, pixel_grid

_TOLERANCE = 3e-3
"""Of a worn contact: a thousandth of a fringe, at a third of the time."""

_ROOM = 1.8
"""Window on the surface over what the scene's own load needs: enough for three times the load."""

_NO_LENS = {
    "camera.roll_deg": 0.0,
    "camera.distortion": 0.0,
    "camera.keystone_x": 0.0,
    "camera.keystone_z": 0.0,
}

_BLACKEST, _WHITEST = 1.0, 99.0
"""Per cent of a picture's grey levels between which the model is shown."""


class LiveModel:
    """A scene's fringes on the pixels (rows, cols) of its region, as values move.

    The scene is one state, with its pixel size.
    """

    def __init__(self, scene: Scene, shape: tuple[int, int]) -> None:
        if scene.model is None:
            raise InputError(
                f"{scene.name}: {scene.no_model_reason}, so there are no fringes to show; fill in "
                "the indenter, or the shape of a disc, ring or beam"
            )
        if scene.polariscope.several_wavelengths:
            raise InputError(
                f"{scene.name}: the fringes over the picture are those of one wavelength; of white "
                "light `isochrome simulate` shows the colours"
            )
        self.scene, self.shape = scene, shape
        self._start(scene)

    def _start(self, scene: Scene) -> None:
        """Choose the nodes on the surface: they stay as values move."""
        self._base = with_numerics(scene, room=_ROOM, tolerance=_TOLERANCE)
        self._renderers: dict[tuple[int, int], SceneRenderer] = {}

    def signal(self, values: Mapping[str, float]) -> NDArray[np.floating]:
        """The polariscope's signal (rows, cols) for values by key, 1 for full light.

        No specimen, no light. Keys that a frame's own state does not have are left out. InputError
        where a value is not allowed, PhysicsError where the contact cannot be solved.
        """
        known = {key: value for key, value in values.items() if self._has(key)}
        try:
            return self._signal(self._base.with_values(known))
        except PhysicsError:  # the contact outgrew its window
            self._start(self.scene.with_values(known))
            return self._signal(self._base)

    def _has(self, key: str) -> bool:
        part = key.partition(".")[0]
        return getattr(self.scene, part, None) is not None

    def _signal(self, scene: Scene) -> NDArray[np.floating]:
        pixels = pixel_grid(scene, self.shape)
        if pixels.lens is None:
            return self._plain(scene, pixels)
        from scipy.ndimage import map_coordinates

        around = pixels.around()
        square = scene.with_values(
            _NO_LENS
            | {
                "camera.left_mm": around.left_mm,
                "camera.top_mm": around.top_mm,
                "camera.width_px": around.cols,
                "camera.height_px": around.rows,
            }
        )
        picture = self._plain(square, around)
        x, z = pixels.places
        at = np.stack(np.broadcast_arrays(z - around.top_mm, x - around.left_mm))
        signal: NDArray[np.floating] = map_coordinates(
            picture, at / around.pixel_mm - 0.5, order=1, mode="nearest"
        )
        return signal

    def _plain(self, scene: Scene, pixels: PixelGrid) -> NDArray[np.floating]:
        """The signal on pixels that look straight at the specimen."""
        shape = pixels.rows, pixels.cols
        if shape not in self._renderers:
            self._renderers = {shape: SceneRenderer(self._base, shape, rough=True)}
        signal = self._renderers[shape].signal(scene, visibility=np.ones((), np.float32))
        inside = specimen_model(scene).inside(replace(pixels, lens=None))
        return np.where(inside, np.nan_to_num(signal), 0.0)


def grey_span(picture: NDArray[np.uint8]) -> tuple[float, float]:
    """The dark and the bright grey level between which a picture's fringes go."""
    low, high = np.percentile(picture[::4, ::4], [_BLACKEST, _WHITEST])
    return float(low), float(max(high, low + 1.0))


def shown_grey(
    signal: NDArray[np.floating], span: tuple[float, float], gamma: float
) -> NDArray[np.uint8]:
    """Grey levels of a signal, 1 for full light, as bright as the picture that it lies over.

    `span`, see `grey_span`; the camera stores light^(1/gamma).
    """
    stored = np.clip(signal, 0.0, 1.0) ** np.float32(1.0 / gamma)
    grey: NDArray[np.uint8] = np.rint(span[0] + (span[1] - span[0]) * stored).astype(np.uint8)
    return grey
