"""Whether a frame shows no fringes: the light of a lamp alone explains it.

What is refused as no contact may simply not be loaded. A smooth polynomial is fitted to the light,
robustly; where next to no pixel lies farther from it than noise does, there is no fringe. A frame
with texture, dust or an edge in it is never taken for one: then nothing is said of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.estimation import FrameData

Array = NDArray[Any]

_DEGREE = 4
"""Of the polynomial: a lamp's, and no fringe's."""

_FAR, _FEW = 5.0, 0.002
"""Standard deviations, and the share of pixels that may lie beyond them. Unloaded frames of the
sample's bench leave 0.0006 at the most, a contact of a fifth of a fringe 0.0004, one of a third
0.008, and one of half a fringe 0.03."""

_RIM, _DIM = 0.06, 0.6
"""Share of the rows or columns at an edge that may be a holder's shadow, and how dim it is."""

_MOST_PIXELS, _ROUNDS = 60_000, 4


def has_no_fringes(data: FrameData) -> bool:
    """Tell whether smooth light alone explains a frame. Parameters: `data`, prepared."""
    light = np.asarray(data.light, dtype=float)
    rows, cols = (_within(np.median(light, axis=axis), np.median(light)) for axis in (1, 0))
    step = max(1, round((light.size / _MOST_PIXELS) ** 0.5))
    inner = tuple(slice(part.start, part.stop, step) for part in (rows, cols))
    light, sigma, valid = light[inner], np.asarray(data.sigma[inner], float), data.valid[inner]
    if valid.sum() < 10 * (_DEGREE + 1) ** 2:
        return False
    far = np.abs(_smooth_residual(light, sigma, valid)[valid]) / sigma[valid]
    return bool(np.mean(far > _FAR) < _FEW)


def _within(level: Array, usual: float) -> slice:
    """The lines of a frame without those of a dark rim, by each line's `level`."""
    count, most = len(level), max(1, int(_RIM * len(level)))
    bright = level >= _DIM * usual
    first = int(bright[:most].argmax()) if bright[:most].any() else most
    last = int(bright[::-1][:most].argmax()) if bright[::-1][:most].any() else most
    # the line beside a rim is blurred
    return slice(first + (first > 0), count - last - (last > 0))


def _smooth_residual(light: Array, sigma: Array, valid: NDArray[np.bool_]) -> Array:
    """What a polynomial leaves of the light (rows, cols), pixels that lie far off counting less."""
    y, x = (np.linspace(-1.0, 1.0, n) for n in light.shape)
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    basis = np.stack([np.outer(y**i, x**j)[valid] for i, j in powers], axis=1)
    weight = 1.0 / sigma[valid]
    trust, left = np.ones(len(weight)), light[valid]
    for _ in range(_ROUNDS):
        use = weight * trust
        found = np.linalg.lstsq(basis * use[:, None], light[valid] * use, rcond=None)[0]
        left = light[valid] - basis @ found
        size = np.abs(left) * weight
        usual = 3.0 * max(float(np.median(size)) / 0.6745, 1e-9)
        trust = np.sqrt(np.minimum(1.0, usual / np.maximum(size, 1e-9)))
    residual = np.zeros(light.shape)
    residual[valid] = left
    return residual
