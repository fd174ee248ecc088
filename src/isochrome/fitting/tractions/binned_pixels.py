"""A frame's pixels averaged in squares: few numbers, and nearly all that the frame tells.

Below a surface a stress field is smooth over a fraction of the depth, so that deep pixels may be
averaged by four or sixteen, where no fringe is lost by it, and only those near the surface stand
for themselves. What averaging makes of the fringes is known: see `bin_averaging`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation import FrameData
from isochrome.fitting.arrays import Array, Mask

_LARGEST = 4
_DEEP = 8.0
"""Depth over a bin's side from which a bin may be that large."""
_FLAT = 0.2
"""Largest slope of the order, fringes a bin."""
_LARGEST_SHIFT = 0.02
"""Largest shift of the order that is believed, fringes: at N = 0 its Laplacian has a pole."""
_NOISE = 0.012
"""Noise over the brightest light for which these are made; less of it shows less of a bin's own
curvature, which grows with the square of its side."""


@dataclass(frozen=True, kw_only=True)
class Bins:
    """Squares of `side` pixels with their centres at `row`, `col` (pixels), sorted by side.

    `light`, its noise `sigma`, and the bases `illumination` (ki, n) and `background` (kb, n), the
    means over each square.
    """

    side: NDArray[np.int64]
    row: Array
    col: Array
    light: Array
    sigma: Array
    illumination: Array
    background: Array

    def where(self, keep: Mask) -> Bins:
        """Some of the bins, in the same order."""
        return Bins(**{name: part[..., keep] for name, part in vars(self).items()})

    def illuminated(self, light: Array) -> Array:
        """The illumination (n,) of the light's coefficients, the background's among them."""
        return light[: len(self.illumination)] @ self.illumination

    def sides(self) -> list[tuple[int, slice]]:
        """The sides that occur, each with the bins that have it."""
        result, first = np.unique(self.side, return_index=True)
        ends = [*first[1:], len(self.side)]
        return [(int(b), slice(i, j)) for b, i, j in zip(result, first, ends, strict=True)]


def make_bins(data: FrameData, depth_px: Array, slope: Array, *, from_px: float) -> Bins:
    """Average a frame's valid pixels in squares of 1, 2 or 4 pixels.

    Parameters: `data`; `depth_px` (rows,), of the pixels' centres below the surface; `slope`
    (rows, cols), fringes a pixel; `from_px`, depth of the first row that is used. Returns Bins;
    pixels at the right and lower rim that fill no square of the largest side are left out.
    """
    valid = data.valid & (depth_px >= from_px)[:, None]
    rows, cols = (n // _LARGEST * _LARGEST for n in valid.shape)
    noise = np.median(data.sigma[valid]) / np.percentile(data.light[valid], 99.0)
    finer = min(1.0, float(np.sqrt(noise / _NOISE)))
    side = np.ones((rows, cols), int)
    for b in (2, 4):
        steep = _squares(slope[:rows, :cols], b).max((-3, -1))
        deep = depth_px[:rows:b] >= _DEEP / finer * b
        whole = np.asarray((steep * b < _FLAT * finer) & deep[:, None])
        if b < _LARGEST:  # squares of one side fill whole squares of the largest
            whole = np.asarray(_squares(whole, _LARGEST // b).all((-3, -1)))
            whole = _repeat(whole, _LARGEST // b)
        side[_repeat(whole, b)] = b
    parts = [_averaged(data, valid, side, b) for b in (1, 2, 4)]
    names = vars(parts[0])
    return Bins(**{n: np.concatenate([vars(part)[n] for part in parts], axis=-1) for n in names})


def _averaged(data: FrameData, valid: Array, side: Array, b: int) -> Bins:
    rows, cols = side.shape

    def mean(image: Array) -> Array:
        result: Array = _squares(image[..., :rows, :cols], b).mean((-3, -1))
        return result

    keep = (side[::b, ::b] == b) & _squares(valid[:rows, :cols], b).all((-3, -1))
    row, col = np.nonzero(keep)
    return Bins(
        side=np.full(len(row), b),
        row=(row + 0.5) * b - 0.5,
        col=(col + 0.5) * b - 0.5,
        light=mean(data.light)[keep],
        sigma=np.sqrt(mean(np.square(data.sigma))[keep]) / b,
        illumination=mean(data.illumination)[:, keep],
        background=mean(data.background)[:, keep],
    )


def _squares(image: Array, b: int) -> Array:
    """A view (..., rows/b, b, cols/b, b)."""
    *rest, rows, cols = image.shape
    return image.reshape(*rest, rows // b, b, cols // b, b)


def _repeat(image: Array, b: int) -> Array:
    return np.repeat(np.repeat(image, b, 0), b, 1)


@dataclass(frozen=True)
class Averaging:
    """What is left of the fringes in a bin's mean light: `contrast`, and `shift` of the order."""

    contrast: Array
    shift: Array


def bin_averaging(order: Array, bins: Bins, blur_px: float = 0.0) -> Averaging:
    """What a bin's area, and the camera's blur, make of the fringes.

    Equation: the mean of cos 2 pi N over a square of side b and a Gaussian of width s, in which N
    has slopes g and the Laplacian L, is that of N + (b²/24 + s²/2) L, times
    sinc(b g_x) sinc(b g_z) exp(-2 (pi s)² (g_x² + g_z²)).
    Parameters: `order` N (rows, cols) at every pixel; `bins`; `blur_px` s. Returns an Averaging.
    """
    row, col = bins.row.astype(int), bins.col.astype(int)
    slopes = np.gradient(order)
    down, across = (slope[row, col] for slope in slopes)
    area = np.sinc(bins.side * down) * np.sinc(bins.side * across)
    blur = np.exp(-2.0 * (np.pi * blur_px) ** 2 * (down**2 + across**2))
    bent = sum(np.gradient(slope, axis=k)[row, col] for k, slope in enumerate(slopes))
    shift = (np.square(bins.side) / 24.0 + 0.5 * blur_px**2) * bent
    return Averaging(area * blur, np.clip(shift, -_LARGEST_SHIFT, _LARGEST_SHIFT))
