"""A chessboard's corners, or a grid's dots, found by OpenCV in a picture.

Nothing else of the calibration knows OpenCV.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from isochrome.errors import PhysicsError

Array = NDArray[np.float64]

_WINDOW = 0.35
"""Half the window that a corner is refined in, in distances to the next corner: no other's edges
that end within it."""

_SMALLEST_WINDOW, _LARGEST_WINDOW = 3, 15
"""The same in pixels: below, there are no edges; beyond, the lens bends them."""

_SMOOTH_PX, _SMOOTH_SHARE = 1.5, 0.05
"""Gaussian that the picture is smoothed by before, px and in distances to the next corner at most:
the refinement takes gradients between neighbouring pixels, and is .035 px off where edges are
sharp, .015 px after it."""

_LOOKED_AT_PX = 600
"""Longest side that corners are first looked for in: in large pictures, whose edges are many
pixels wide, OpenCV takes long and may find none. They are refined in the whole picture."""

_LEAST_DOT = 12.0
"""Area of a dot, px: a smaller one is noise."""


def target_places(image: Array, target: str, columns: int, rows: int, *, name: str) -> Array:
    """Where a picture shows a target's corners or dots, row by row of the target.

    Parameters: `image` (rows, cols), any grey levels; `target`, 'chessboard' or 'dots'; `columns`
    and `rows` of inner corners, or dots; `name`, for messages. Returns (rows, columns, 2), the
    column and row in the picture (px, from the first pixel's middle). Raises PhysicsError where
    the target is not found.
    """
    finder = _corners if target == "chessboard" else _dots
    found = finder(_eight_bits(image), image, (columns, rows))
    if found is None:
        what = "inner corners" if target == "chessboard" else "dots"
        other = " (a board of 10 x 7 squares has 9 x 6)" if target == "chessboard" else ""
        raise PhysicsError(
            f"{name}: no {target} of {columns} x {rows} {what} is found; count its columns and "
            f"rows{other}, show all of it with a margin about it, sharp and evenly lit, or use "
            "--edges-mm"
        )
    return found.reshape(rows, columns, 2)


def _eight_bits(image: Array) -> NDArray[np.uint8]:
    """The picture from black to white, whatever its levels; dust and glare are cut."""
    low, high = np.percentile(image, [0.5, 99.5])
    share = (image - low) / max(high - low, 1e-12)
    return np.asarray(np.rint(255.0 * np.clip(share, 0.0, 1.0)), dtype=np.uint8)


def _corners(grey: NDArray[np.uint8], image: Array, size: tuple[int, int]) -> Array | None:
    """A chessboard's inner corners, each refined where all gradients about it point past it."""
    import cv2

    sure = cv2.CALIB_CB_ACCURACY
    hard = sure | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE  # finds less in noise
    small = -(-max(grey.shape) // _LOOKED_AT_PX)
    for block, flags in ((small, sure), (small, hard), (1, sure)):
        found, corners = cv2.findChessboardCornersSB(_binned(grey, block), size, flags=flags)
        if found:
            break
    else:
        return None
    corners = np.asarray((corners + 0.5) * block - 0.5, dtype=np.float32)
    places = corners.reshape(size[1], size[0], 2)
    near = _nearest(places)
    half = int(np.clip(_WINDOW * near, _SMALLEST_WINDOW, _LARGEST_WINDOW))
    level = np.asarray(image / max(float(np.abs(image).max()), 1e-12), dtype=np.float32)
    level = gaussian_filter(level, min(_SMOOTH_PX, _SMOOTH_SHARE * near), mode="nearest")
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    refined = cv2.cornerSubPix(level, corners.copy(), (half, half), (-1, -1), end)
    return np.asarray(refined, dtype=float)


def _binned(grey: NDArray[np.uint8], block: int) -> NDArray[np.uint8]:
    """The means of square blocks of pixels; what is over at the right and below is cut."""
    rows, cols = (n // block for n in grey.shape)
    cut = grey[: rows * block, : cols * block].reshape(rows, block, cols, block)
    return np.asarray(np.rint(cut.mean(axis=(1, 3))), dtype=np.uint8)


def _dots(grey: NDArray[np.uint8], image: Array, size: tuple[int, int]) -> Array | None:
    """A grid's dots, dark ones or else bright ones: the middles of their areas."""
    import cv2

    blobs: Any = cv2  # its stubs do not know them
    options = blobs.SimpleBlobDetector_Params()
    options.minArea, options.maxArea = _LEAST_DOT, image.size / (size[0] * size[1])
    options.minDistBetweenBlobs = np.sqrt(_LEAST_DOT)
    finder = blobs.SimpleBlobDetector_create(options)
    for seen in (grey, np.asarray(255 - grey, dtype=np.uint8)):
        flags = cv2.CALIB_CB_SYMMETRIC_GRID
        found, middles = cv2.findCirclesGrid(seen, size, flags=flags, blobDetector=finder)
        if found:
            return np.asarray(middles, dtype=float)
    return None


def _nearest(places: NDArray[Any]) -> float:
    """The least distance of two neighbours, px."""
    steps = [np.linalg.norm(np.diff(places, axis=axis), axis=2).min() for axis in (0, 1)]
    return float(min(steps))
