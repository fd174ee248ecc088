"""From which grey level a frame is clipped, told by its plateau and not by the level's number.

A sensor that clips gives one level to all the light beyond it: many pixels share the top level, in
connected patches, and more of them than the histogram just below goes on to; or patches without a
hole, which no camera's noise leaves. The brightest pixels of a frame that ends at its top level by
chance are few, apart, and no more than those one level below; a crest that just reaches it has some
more, for light I = I_max - a x² falls into equal levels as the differences of a square root: 1,
0.41, 0.32, 0.27 of it.
"""

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from isochrome.errors import InputError
from isochrome.frames.noise import estimate_noise

_FEWEST_FULL, _FEWEST = 3, 25
"""Pixels that make a plateau, at full scale and below it, where a label may be as even."""
_LEAST_SHARE = 1e-3
"""Of all pixels, below full scale."""
_FEWEST_LEVELS = 8
"""Levels that occur, for a plateau below full scale: the noise of half a level of an unloaded frame
in the dark field piles up on its upper two or three as on a plateau."""
_ABOVE = 0.05
"""Over the plateau's own pixels: so many may be brighter, as hot ones and glare are."""
_TOUCHING = 0.5
"""Share of a plateau's pixels that have a neighbour of their level."""
_SOLID = 0.2
"""Share of a plateau's pixels that have none but their level about them: an even light of half a
grey level's noise leaves a tenth."""
_GROWTH = 2.04
"""Power of the last two levels' growth over two more that the square root's first level has."""
_CREST = 2.5
"""What a crest's first level has over its second at most; at full scale no more is excused."""
_SIGMAS = 3.0
_GAP = 2.2
"""Typical distances of levels: what is farther below is not just below."""
_LOOKED_AT = 1000
"""Pixels at least, of fractions, whose sorting takes a while."""
_NOISE, _FINE = 0.5, 1e-4
"""Grey levels, and of full scale: a computed frame has less noise, and even light of its own."""


def saturation_level(raw: np.ndarray, *, full: float) -> float:
    """From which level a frame is clipped: its plateau's, at full scale or below, or infinite."""
    image = np.asarray(raw)
    usable = np.isfinite(image)
    values = image[usable]
    if not values.size:
        return np.inf
    lowest, highest = float(values.min()), float(values.max())
    if lowest == highest:
        return highest if highest >= full else np.inf
    levels, counts = _histogram(values)
    # levels above the middle of the range with hardly any pixel above them, lowest first
    above = counts.sum() - np.cumsum(counts)
    last = (levels > 0.5 * (lowest + highest)) & (above <= _ABOVE * counts)
    for i in np.flatnonzero(last).tolist():
        level, at_full = float(levels[i]), bool(levels[i] >= full)
        if not at_full and len(levels) < _FEWEST_LEVELS:
            continue
        plateau = usable & (image == level)
        fewest = _FEWEST_FULL if at_full else max(_FEWEST, _LEAST_SHARE * values.size)
        touching = np.pad(plateau, 1)  # a pixel of the plateau on one of the four sides
        touching = (
            touching[:-2, 1:-1] | touching[2:, 1:-1] | touching[1:-1, :-2] | touching[1:-1, 2:]
        )
        if counts[i] < fewest or _share(plateau, touching) < _TOUCHING:
            continue
        piled = _is_piled(levels[: i + 1], counts[: i + 1], at_full=at_full)
        if piled and at_full:
            return level
        solid = ndimage.minimum_filter(plateau, 3)  # all nine pixels about a place
        if (piled or _share(plateau, solid) > _SOLID) and _is_noisy(
            image, usable & (image < level), full
        ):
            return level
    return np.inf


def _histogram(values: np.ndarray) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The levels that occur and their pixels, (n,) each; none where no bright fractions agree."""
    if values.dtype == np.uint8:
        import cv2

        counts = cv2.calcHist([values], [0], None, [256], [0, 256]).ravel()
        at = np.flatnonzero(counts)
        return at.astype(float), counts[at].astype(float)
    if values.dtype.kind in "ui":
        least = int(values.min())
        counts = np.bincount((values.astype(np.int64) - least).ravel())
        at = np.flatnonzero(counts)
        return (at + least).astype(float), counts[at].astype(float)
    count = min(values.size, max(_LOOKED_AT, values.size // 100))
    brightest = np.partition(values, -count)[-count:]
    if np.unique(brightest, return_counts=True)[1].max() < _FEWEST_FULL:
        return np.empty(0), np.empty(0)
    levels, number = np.unique(values, return_counts=True)
    return levels.astype(float), number.astype(float)


def _is_piled(levels: np.ndarray, counts: np.ndarray, *, at_full: bool) -> bool:
    """Whether the last level has more pixels than those just below go on to."""
    below = counts[-5:-1][::-1]
    if not below.size or levels[-1] - levels[-2] > _GAP * np.median(np.diff(levels)):
        return True  # nothing lies just below
    near, far = below[:2].max(), below[2:].max(initial=0.0)
    growth = max(near / far if far else near, 1.0) ** _GROWTH
    expected = near * (min(growth, _CREST) if at_full else growth)
    return bool(counts[-1] >= expected + _SIGMAS * np.sqrt(expected))


def _share(plateau: npt.NDArray[np.bool_], which: npt.NDArray[np.bool_]) -> float:
    return float(np.count_nonzero(plateau & which) / np.count_nonzero(plateau))


def _is_noisy(image: np.ndarray, below: npt.NDArray[np.bool_], full: float) -> bool:
    """Whether the pixels below a plateau have a camera's noise, so that the plateau is none."""
    if min(image.shape) < 8:
        return False
    try:
        noise = estimate_noise(image, below)
    except InputError:  # next to nothing lies below
        return True
    sigma = float(noise.sigma(np.median(image[below])))
    return sigma > (_NOISE if image.dtype.kind in "ui" else _FINE * full)
