r"""How a whole picture's fringe order changes from one frame of a film to the next.

The wave w = cos 2 pi N of a frame says N up to its sign and a whole number. All pixels together say
more: the change is smooth over the picture, and loads change mostly in proportion, by c N. The
factor c is searched over all that a stated largest change allows, alone, after the change that went
before, or after what drifts besides; from the best of them the change is fitted as a sum of few
fields: N, its gradient in the picture (the fringes move), the change before, a constant, the drift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isochrome.fringes.windows import Array, Mask

LARGEST_CHANGE = 0.35
"""Fringes from one frame to the next that are followed, wherever in the picture: below half of the
distance of 1 after which the light is the same, with a margin for what noise and fields add."""

CREST_SLOPE = 6.0
"""Of the wave, a fringe: e/u, twice the 0.03 that light which was found leaves open, over 0.01."""

STEEPEST = 0.3
"""Of fringes that are followed, fringes a pixel."""
_LEAST_CONTRAST = 0.3

_STRIDE = 3
_FACTORS = 31
"""Steps of the search; the finest fringes move by a fortieth from one to the next."""
_STARTS = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
"""Shares of the change before and of the drift that are searched with."""
_ROUNDS = 5
_OUTLIER = 0.3
_CLIPPED = 0.5
"""Of the wave: a residual that counts half in the fit, and the square beyond which none counts."""
_MOVED = 10.0
"""Pixels that the fringes move with a coefficient of 1."""
_RIDGE = (1e-3, 0.1, 0.1, 0.1, 1.0, 1.0, 10.0, 10.0)
"""How little each coefficient is let go from the search, a thousandth of the pixels' information:
those that stand for other courses than a proportional one are held the more, and a drift, which
may look like N, the most."""
_TOP, _MOSTLY = 99.5, 97.0
"""Per cent of the pixels: of the search, and of those whose change is judged together; about a
force the order changes faster than it can be followed, and there it is lost alone."""
_FEWEST = 50


@dataclass(frozen=True)
class OrderChange:
    """A change of the order."""

    change: Array  # fringes
    misfit: float  # mean square of what it leaves of the wave
    largest: float  # of any field in it, and of all together, fringes


def fit_order_change(
    order: Array, expected: Sequence[Array], wave: Array, contrast: Array,
    gradient: tuple[Array, Array], known: Mask,
) -> OrderChange | None:  # fmt: skip
    """Fit the change of a picture's order to the wave of the next frame.

    Parameters: `order` N before, fringes; `expected`, the change that went before, and the drift,
    each over the time to the new frame; `wave` cos 2 pi N of it; `contrast`, what the pixels' size
    leaves of it; `gradient` of the order along rows and columns; `known`, where the order is known;
    all (rows, cols). None where too few are.
    """
    thin = slice(_STRIDE // 2, None, _STRIDE)
    use = known[thin, thin]
    if np.count_nonzero(use) < _FEWEST:
        return None
    fields = _fields(order, expected, gradient)
    basis = np.stack([np.broadcast_to(f, order.shape)[thin, thin][use] for f in fields])
    seen, faded = wave[thin, thin][use], contrast[thin, thin][use]
    top = max(float(np.percentile(basis[0], _TOP)), 1e-3)
    start = _searched(basis, seen, faded, top)
    found = start.copy()
    ridge = 1e-3 * seen.size * np.array(_RIDGE)
    for _ in range(_ROUNDS):
        left, slope = _residual(basis[0], found.astype(np.float32) @ basis, seen, faded)
        turned = basis * slope
        weighted = turned * on_flank(slope) / (1.0 + (left / np.float32(_OUTLIER)) ** 2)
        matrix = (weighted @ turned.T).astype(float) + np.diag(ridge)
        found = found + np.linalg.solve(matrix, weighted @ left - ridge * (found - start))
    single = found.astype(np.float32)
    change = single @ basis
    left, _ = _residual(basis[0], change, seen, faded)
    parts = np.percentile(np.abs(basis), _MOSTLY, axis=1) * np.abs(found)
    own = np.percentile(np.abs(change), _MOSTLY)
    # tilts of the factor and what the fringes move are judged by their sum alone
    largest = float(max(own, parts[0], parts[6]))
    whole = np.zeros_like(order)
    for share, field in zip(single, fields, strict=True):
        whole += share * field
    return OrderChange(whole, _mean_misfit(left), largest)


def on_flank(slope: Array) -> Array:
    """How far pixels tell a change of the order, by the slope of their wave dw/dN: 0 on a crest.

    Light that is not known exactly, by an e of the wave, stands off from a crest as the light of
    another order does, e/J away: such pixels are to follow the others, not to hold them up. Where
    the prediction is good to u, that is 1/(1 + (e/(J u))²).
    """
    square = slope * slope
    return np.asarray(square / (square + np.float32(CREST_SLOPE**2)))


def faded_fringes(order: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    """What a pixel's size leaves of the fringes, and their gradient: squared, and its parts."""
    import cv2

    along, across = (
        cv2.Sobel(order, cv2.CV_32F, dx, 1 - dx, ksize=3, scale=0.125) for dx in (0, 1)
    )
    square = along * along + across * across
    contrast = np.maximum(1.0 - np.float32(np.pi**2 / 6.0) * square, np.float32(_LEAST_CONTRAST))
    return contrast, square, (along, across)


def is_wide(steep: Array) -> Mask:
    """Where fringes are wide enough to be followed, by their gradient squared (rows, cols)."""
    return np.asarray(steep < STEEPEST**2)


def faded_contrast(order: Array) -> Array:
    """What a pixel's size leaves of the contrast of fringes (rows, cols).

    Parameters: `order` (rows, cols), fringes.
    """
    return faded_fringes(order)[0]


def _fields(order: Array, expected: Sequence[Array], gradient: tuple[Array, Array]) -> list[Array]:
    """The fields whose sum the change is: N first, the fourth the change before, the drift last."""
    rows, cols = order.shape
    y = np.linspace(-1.0, 1.0, rows, dtype=np.float32)[:, None]
    x = np.linspace(-1.0, 1.0, cols, dtype=np.float32)[None]
    moved = np.float32(_MOVED)
    along, across = gradient
    one = np.ones((1, 1), dtype=np.float32)
    rate, drift = expected
    return [order, order * x, order * y, rate, moved * across, moved * along, one, drift]


def _searched(basis: Array, seen: Array, faded: Array, top: float) -> Array:
    """Coefficients to start from: the best factor alone, after the change before, or the drift."""
    best, found, order = np.inf, np.zeros(len(_RIDGE)), basis[0]
    reach = LARGEST_CHANGE / top
    for starts in _STARTS:
        ahead = np.float32(starts[0]) * basis[3] + np.float32(starts[1]) * basis[-1]
        for factor in np.linspace(-reach, reach, _FACTORS):
            left, _ = _residual(order, np.float32(factor) * order + ahead, seen, faded)
            misfit = _mean_misfit(left)
            if misfit < best:
                best = misfit
                found[0], found[3], found[-1] = factor, *starts
    return found


def _residual(order: Array, change: Array, seen: Array, faded: Array) -> tuple[Array, Array]:
    """What a change leaves of the wave, and how the wave answers to it."""
    turn = np.float32(2.0 * np.pi)
    angle = turn * (order + change)
    return seen - faded * np.cos(angle), -turn * faded * np.sin(angle)


def _mean_misfit(left: Array) -> float:
    return float(np.mean(np.minimum(left * left, np.float32(_CLIPPED))))
