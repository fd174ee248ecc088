"""A beam's images one below the other, with one model of intensity for all of them.

I_i = b_i A sin^2(pi N_i) + B: the illumination A and background B are shared; the brightness b_i
is 1, or free with a constant of its own where the light changed. An unloaded image has the order
that stays, sqrt(q) at the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.beam_fit import BeamFit, beam_order, beam_scale, beam_signal
from isochrome.calibrate.shot import Shot
from isochrome.calibrate.smooth import light_maps
from isochrome.fit import IntensityFit, fit_intensity

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Stack:
    """The loaded images, then the unloaded ones, one below the other, on the same columns.

    `image`, `mask`, `sigma` (images * rows, cols); `scaled`, whether each has its brightness.
    """

    fits: tuple[BeamFit, ...]
    idle: tuple[Shot, ...]
    height_px: float
    bright: bool
    scaled: bool
    image: Array
    mask: Mask
    sigma: Array

    @property
    def rows(self) -> int:
        """Rows of one image."""
        return self.image.shape[0] // (len(self.fits) + len(self.idle))

    def table(self, params: Array) -> Array:
        """Slope, row and tilt (n, 3) of the loaded images, out of all parameters."""
        return params[: 3 * len(self.fits)].reshape(-1, 3)

    def signal(self, params: Array) -> Array:
        """Ideal intensities of the stack: (slope, row, tilt) an image, squared orders, levels."""
        y, x = self.fits[0].places
        table, count = self.table(params), len(self.fits)
        parts = [beam_signal(beam_order(row, y, x), bright=self.bright) for row in table]
        for square in params[3 * count : 3 * count + len(self.idle)]:
            _, row, tilt = table.mean(axis=0)
            depth = (y - row - tilt * x) / (0.5 * self.height_px)
            parts.append(_rest_signal(square, depth, self.bright))
        for part, level in zip(parts[1:], params[3 * count + len(self.idle) :], strict=False):
            part *= level
        return np.concatenate(parts)

    def start(self) -> Array:
        """The parameters as the images' own fits have them."""
        levels = np.ones(len(self.fits) - 1 if self.scaled else 0)
        return np.concatenate(
            [*(f.best.values for f in self.fits), np.zeros(len(self.idle)), levels]
        )

    def scale(self) -> Array:
        """Natural changes of the parameters."""
        levels = np.full(len(self.fits) - 1 if self.scaled else 0, 0.1)
        own = np.tile(beam_scale(self.height_px), len(self.fits))
        return np.concatenate([own, np.full(len(self.idle), 0.01), levels])


def make_stack(
    fits: Sequence[BeamFit],
    idle: Sequence[Shot],
    height_px: float,
    *,
    bright: bool = False,
    scaled: bool = False,
) -> Stack:
    """Lay images of one size below each other.

    Parameters: `fits`, of the loaded images; `idle`, the unloaded ones; `height_px`, the beam's;
    `bright`, for a bright field; `scaled`, whether the brightness is free. Returns the Stack.
    """
    pick = fits[0].pick
    shots = [*(f.shot for f in fits), *idle]
    shared = np.logical_and.reduce([f.mask for f in fits])
    masks = [*(f.mask for f in fits), *(shared & s.mask[:, pick] for s in idle)]
    return Stack(
        tuple(fits), tuple(idle), height_px, bright, scaled,
        np.concatenate([s.image[:, pick] for s in shots]),
        np.concatenate(masks), np.concatenate([s.sigma[:, pick] for s in shots]),
    )  # fmt: skip


def fit_stack(
    stack: Stack,
    degrees: tuple[int, int],
    *,
    light: ArrayLike | None = None,
    mask: Mask | None = None,
    start: Array | None = None,
) -> IntensityFit:
    """Least squares on a stack.

    Parameters: `degrees` of illumination and background; `light` (rows, all cols), the no-load
    bright minus dark frame; `mask`, where not the stack's own; `start`, where not its own.
    Returns the IntensityFit over the whole stack.
    """
    total, (height, width) = len(stack.fits) + len(stack.idle), stack.image.shape
    known = None if light is None else np.asarray(light, dtype=float)[:, stack.fits[0].pick]
    maps = light_maps((stack.rows, width), degrees, known)
    tiled: dict[str, Any] = {k: np.tile(v, (1, total, 1)) for k, v in maps.items()}
    if stack.scaled:
        levels = np.zeros((total - 1, height, width))
        for i in range(1, total):
            levels[i - 1, i * stack.rows : (i + 1) * stack.rows] = 1.0
        tiled["background"] = np.concatenate([tiled["background"], levels])
    return fit_intensity(
        stack.image, stack.signal, stack.start() if start is None else start,
        mask=stack.mask if mask is None else mask, sigma=stack.sigma,
        scale=stack.scale(), central=False, **tiled,
    )  # fmt: skip


def _rest_signal(square: float, depth: Array, bright: bool) -> Array:
    """Signal of an order sqrt(square) * depth; it goes on smoothly below square = 0, where noise
    may drive it.
    """
    angle = 2.0 * np.pi * np.sqrt(abs(square)) * depth
    wave = np.cos(angle) if square >= 0 else np.cosh(np.minimum(np.abs(angle), 5.0))
    return np.asarray(0.5 + 0.5 * wave if bright else 0.5 - 0.5 * wave)
