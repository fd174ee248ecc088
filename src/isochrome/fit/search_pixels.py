"""A few hundred pixels of a frame, and how well many signals explain them at once.

For each signal f the light's linear part, I = f Σ a_k B_k + Σ c_k C_k, is eliminated as in
`isochrome.fit.linear`; here the normal equations of a whole batch of signals are two matrix
products, of f² and f with the bases' products.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.frame_data import FrameData
from isochrome.fit.search_field import Field
from isochrome.optics import make_chain, polariscope_signal
from isochrome.scene import Scene
from isochrome.stress import PixelGrid, pixel_grid, principal_direction

Array = NDArray[Any]

_RIDGE = 1e-9


@dataclass(frozen=True)
class Misfit:
    """Of m signals: `chi` (m,), residual over noise; coefficients `light` (m, ka), `dark` (m, kc).

    chi is inf where the light's mean over the pixels is negative: another contrast than the
    frame's.
    """

    chi: Array
    light: Array
    dark: Array


class SearchPixels:
    """Pixels of one frame: `data` (n,), `light` (ka, n), `dark` (kc, n), all over the noise."""

    def __init__(
        self,
        frame: FrameData,
        scene: Scene,
        make_field: Callable[[PixelGrid, NDArray[np.bool_]], Field],
        usable: NDArray[np.bool_],
        stride: int,
    ) -> None:
        """Every `stride`-th of the `usable` pixels (rows, cols); see `field_maker`."""
        shape, keep = (usable.shape[0], usable.shape[1]), usable[::stride, ::stride]
        thin = frame.every(stride)
        weight = 1.0 / thin.sigma[keep]
        self.data = thin.light[keep] * weight
        self.light = np.ascontiguousarray(thin.illumination[:, keep] * weight)
        self.dark = np.ascontiguousarray(thin.background[:, keep] * weight)
        self.field = make_field(pixel_grid(scene, shape).every(stride), keep)
        specimen = scene.specimen
        assert specimen.thickness_mm is not None and specimen.fringe_value_n_per_mm is not None
        self.fringes_per_mpa = specimen.thickness_mm / specimen.fringe_value_n_per_mm
        self._chain = make_chain(scene.polariscope, 0 if scene.polariscope.step else None)
        self._pairs = list(combinations_with_replacement(range(len(self.light)), 2))
        self._square = np.array([self.light[i] * self.light[j] for i, j in self._pairs]).T.copy()
        cross = self.light[:, None] * np.concatenate((self.dark, self.data[None]))
        self._cross = cross.reshape(-1, self.size).T.copy()
        self._dark_gram, self._dark_right = self.dark @ self.dark.T, self.dark @ self.data
        self._energy = float(self.data @ self.data)

    @property
    def size(self) -> int:
        """Number of pixels n."""
        return self.data.size

    def signal(self, difference: Array) -> Array:
        """Polariscope signals (m, n), 0..1, of stress differences (m, n), MPa."""
        direction = None if self._chain.ideal else principal_direction(difference)
        order = self.fringes_per_mpa * np.abs(difference)
        return polariscope_signal(order, self._chain, direction=direction)

    def signal_of(self, theta: Array) -> Array:
        """Polariscope signals (m, n), 0..1, of rows θ (m, 7)."""
        return self.signal(self.field.difference(theta))

    def misfit(self, signal: Array) -> Misfit:
        """How well signals (m, n) explain the pixels, with the best light for each."""
        ka, kc, m = len(self.light), len(self.dark), len(signal)
        square = (signal * signal) @ self._square
        cross = (signal @ self._cross).reshape(m, ka, kc + 1)
        gram = np.empty((m, ka + kc, ka + kc))
        for column, (i, j) in enumerate(self._pairs):
            gram[:, i, j] = gram[:, j, i] = square[:, column]
        gram[:, :ka, ka:] = cross[..., :kc]
        gram[:, ka:, :ka] = cross[..., :kc].swapaxes(1, 2)
        gram[:, ka:, ka:] = self._dark_gram
        diagonal = np.arange(ka + kc)
        gram[:, diagonal, diagonal] *= 1.0 + _RIDGE
        gram[:, diagonal, diagonal] += _RIDGE * self._dark_gram[0, 0]
        right = np.empty((m, ka + kc))
        right[:, :ka], right[:, ka:] = cross[..., kc], self._dark_right
        found = np.linalg.solve(gram, right[..., None])[..., 0]
        cost = np.maximum(self._energy - np.einsum("mk,mk->m", found, right), 0.0)
        bright = found[:, :ka] @ self.light.mean(axis=1) > 0.0
        chi = np.sqrt(cost / max(1, self.size - ka - kc))
        return Misfit(np.where(bright, chi, np.inf), found[:, :ka], found[:, ka:])
