"""Means and sums over blocks and windows of pixels, and the types of maps and masks."""

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

Array = NDArray[Any]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
TURN = 2.0 * np.pi
REACH = 3.0
"""Standard deviations that a window of `Windows` extends."""
_COARSE = 1.75
"""Its least width in the pixels that it is summed on."""


def block_means(values: Array, by: int) -> Array:
    """Means over blocks of by x by pixels; a rim narrower than a block is left out."""
    rows, cols = (n // by for n in values.shape[:2])
    cut = values[: rows * by, : cols * by]
    return np.asarray(cut.reshape(rows, by, cols, by, *values.shape[2:]).mean(axis=(1, 3)))


def valid_means(values: Array, valid: Mask, by: int) -> Array:
    """Means over the valid pixels of each block; about nought where there are none."""
    share = block_means(valid.astype(float), by)
    return block_means(np.where(valid, values, 0.0), by) / np.maximum(share, 1e-9)


def gaussian(
    image: Array, width_px: float, order: tuple[int, int] = (0, 0), *, reach: float = 4.0
) -> Array:
    """What scipy's `gaussian_filter` gives of an image (rows, cols), in a third of the time.
    `order`, of the derivative along rows and columns, 2 at most; `reach`, in standard
    deviations."""
    down, across = (_gaussian_kernel(float(width_px), k, reach) for k in order)
    return np.asarray(cv2.sepFilter2D(image, -1, across, down, borderType=cv2.BORDER_REFLECT))


@lru_cache(maxsize=64)
def _gaussian_kernel(width_px: float, order: int, reach: float) -> Array:
    """A Gaussian's weights along an axis, or those of its derivative there."""
    half = int(reach * width_px + 0.5)
    u = np.arange(-half, half + 1) / width_px
    bell = np.exp(-0.5 * u**2)
    bell /= bell.sum()
    return np.asarray((bell, u / width_px * bell, (u**2 - 1.0) / width_px**2 * bell)[order])


def gaussian_sum(
    values: Array, width_px: float, *, reach: float = 4.0, factor: float = 1.0
) -> Array:
    """Sum over a Gaussian window of height 1, of values nought where masked, times `factor`. It
    extends `reach` of its deviation `width_px`. The square of such a window is one of width/√2: it
    gives the variance of a pooled sum."""
    height = np.sqrt(2.0 * np.pi) * width_px
    weights = np.asarray(height * _gaussian_kernel(width_px, 0, reach), np.float32)
    single = np.ascontiguousarray(values, dtype=np.float32)
    # nothing lies beyond the picture
    down = weights * np.float32(factor)
    return np.asarray(cv2.sepFilter2D(single, -1, weights, down, borderType=cv2.BORDER_CONSTANT))


class Windows:
    """Sums of an image over Gaussian windows of several widths, wide ones on fewer pixels."""

    def __init__(self, values: Array, side: int = 1) -> None:
        """`values` (rows, cols), nought where masked: means over blocks of `side` pixels a side."""
        self._side = side
        self._halved: list[Array] = [np.ascontiguousarray(values, dtype=np.float32)]

    def sum(self, width_px: float) -> Array:
        """Sum over a window of height 1 and deviation `width_px`, (rows, cols), float32. Of that is
        taken off what blocks, and the way back from them, widen it by."""
        shape = self._halved[0].shape
        share = width_px / (self._side * _COARSE)
        times = int(np.log2(max(1.0, min(share, *(n / 4 for n in shape)))))
        block = self._side * 2**times
        square = width_px**2 - (block**2 - 1) / 12.0 - (block**2 - self._side**2) / 6.0
        while len(self._halved) <= times:
            self._halved.append(halved(self._halved[-1]))
        each = float(width_px**2 / square * block**2)  # of so many pixels each is the mean
        width = float(np.sqrt(square)) / block
        small = gaussian_sum(self._halved[times], width, reach=REACH, factor=each)
        return expanded(small, shape, 2**times)


def halved(values: Array) -> Array:
    """Means of an image (rows, cols), float32, over blocks of 2 x 2, with nought beyond its rim."""
    rows, cols = values.shape
    if rows % 2 or cols % 2:
        values = cv2.copyMakeBorder(values, 0, rows % 2, 0, cols % 2, cv2.BORDER_CONSTANT, value=0)
    half = (values.shape[1] // 2, values.shape[0] // 2)
    return np.asarray(cv2.resize(values, half, interpolation=cv2.INTER_AREA))


def expanded(values: Array, shape: tuple[int, int], by: int) -> Array:
    """An image of `shape` (rows, cols), linear between the middles of blocks of `by` pixels."""
    if by == 1:
        return values
    size = (by * values.shape[1], by * values.shape[0])
    larger = cv2.resize(values, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(larger[: shape[0], : shape[1]])


def pooled(values: Array, width_px: float) -> Array:
    """Mean over a Gaussian window, in single precision, of values that are nought where masked."""
    single = np.complex64 if np.iscomplexobj(values) else np.float32
    return np.asarray(gaussian_filter(values.astype(single), width_px))


def nearest_known(values: Array, known: Mask) -> Array:
    """Values (rows, cols), those of unknown pixels from the nearest known one."""
    near = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(near)])


def innermost(where: Mask) -> tuple[int, int]:
    """Row and column of the pixel of a mask (rows, cols) that lies farthest from its edge."""
    depth = distance_transform_edt(np.pad(where, 1))[1:-1, 1:-1]
    row, col = np.unravel_index(depth.argmax(), depth.shape)
    return int(row), int(col)


def masked(values: Array, known: Mask, nothing: float = np.nan) -> Array:
    """Values (rows, cols) float32, and `nothing` where they are not known."""
    result = np.array(values, dtype=np.float32)
    np.copyto(result, np.float32(nothing), where=~known)  # a third of the time of np.where
    return result


LARGEST_CHANGE = 0.35
"""Fringes from one pixel, or one frame, to the next that are followed: below half of the distance
of 1 after which the light is the same, with a margin for what noise and fields add."""
POOLED_PX = 3.0
"""Window over which what changes slowly is pooled, standard deviation."""
LIGHT_ERROR = 0.003
"""Of light, or of a table of it, at best, of full light, that neighbours share: what a frame
without noise is still weighed by."""
DIMMEST = 0.1
"""Contrast, over that of the brightest places, below which a pixel is without light."""
ALIKE, EXPOSED, DIFFER = 0.02, 0.5, 3.0
"""Share by which frames may differ in brightness and still be of one exposure; the deviation of log
brightness where nothing tells it; by how many standard uncertainties another exposure differs."""
ROUNDS, MOVES = 8, 3
"""Steps at most of a fit that reweights or bends, and moves of an order over a window."""
FAINTEST_LIGHT = 0.01
"""Light, of full scale or of the contrast, that is as good as none."""
COMPLETE = 0.95
"""Share of a window that must be seen for it to be beside no edge."""
STRIDE, FEWEST = 3, 50
"""Every so many pixels tell as much as all, and as few tell nothing."""
MOSTLY = 97.0
"""Per cent of the pixels that are judged together: about a force the order changes faster than it
can be followed, and there it is lost alone."""


def beside_jumps(order: Array) -> Mask:
    """Pixels (rows, cols) on either side of a step that no smooth order takes."""
    steep = np.zeros(order.shape, dtype=bool)
    for axis in (0, 1):
        jump = np.abs(np.diff(order.swapaxes(0, axis), axis=0)) > LARGEST_CHANGE
        here = steep.swapaxes(0, axis)
        here[1:] |= jump
        here[:-1] |= jump
    return steep
