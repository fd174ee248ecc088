r"""Light that neither a model nor no-load frames hold: a lamp's reflection, a smear, dust.

Light that is added to a fringe's flank moves the order that is read there, e/(df/dN), and leaves no
trace: only a crest, where no order answers to it, shows it. What a shift of the order leaves of the
light, r - J Σ w J r / Σ w J², is therefore compared with what it leaves of an even light of unit
size, q = o - J Σ w J o / Σ w J²: e = Σ w q r / Σ w q², over windows of several widths, of which the
one that says most counts. Where no crest is within reach nothing tells such light from stress that
the model lacks: there a bump of the order, narrower than its surroundings make likely, is doubt.
"""

from __future__ import annotations

import numpy as np

from isochrome.fringes.windows import Array

_WINDOW_PX = 1.7
"""Of the reading itself."""
_WINDOWS_PX = ((_WINDOW_PX, 4.0), (5.0, 8.0), (12.0, 16.0))
"""Over which the order follows, and over which the light is taken as even, pixels."""
_FINE_PX, _AROUND_PX = 4.0, 20.0
"""Windows of a bump and of its surroundings."""
_SHOWN = 0.55
"""What such windows show of a round spot of 6 to 12 pixels: 0.57 to 0.52."""
_LEAST = 1.0 / 0.25**2
"""Inverse variance of a shift before anything is known: it stays on its branch."""
_SURELY = 4.0
"""Variances up to which noise alone explains a light, or a bump."""
_TOLD, _OPEN = 0.01, 0.002
"""Standard uncertainties of the added light, over the contrast: beyond the first a window does not
tell it; beyond the second crests do not, and bumps begin to count."""
_COARSE = 2.5
"""A window's width in the pixels that it is summed on."""


def stray_error(residual: Array, slope: Array, even: Array, *, shift: Array | None = None) -> Array:
    """What light that was added to the fringes may do to an order that is read from them.

    Equations: the module's. Parameters: `residual`, the light less the model's; `slope`, J, its
    change with the order; `even`, its change with light of the size of the contrast; all over the
    noise and nought where masked (rows, cols). `shift` of the order that was taken out before,
    from a model that describes the specimen; without one a bump is the order's own.
    Returns a standard uncertainty (rows, cols), fringes.
    """
    moved = np.zeros_like(residual) if shift is None else slope * shift
    size, open_ = np.zeros(residual.shape), np.full(residual.shape, np.inf)
    for follow, steady in _WINDOWS_PX:
        # a wide window is to see what a narrow one has followed
        light = residual if follow < _FINE_PX + 2.0 else residual + moved
        shown, left = (_left(slope, part, follow) for part in (even, light))
        total = np.maximum(window_sum(shown * shown, steady), 1e-12)
        found = window_sum(shown * left, steady) / total
        variance = window_sum(shown * shown, steady / np.sqrt(2.0)) / total**2
        clear = np.where(variance < _TOLD**2, found**2 - _SURELY * variance, 0.0)
        size = np.maximum(size, clear)
        if follow < _AROUND_PX / 2.0:  # crests that are near
            open_ = np.minimum(open_, variance)
    pull, _ = _shift(slope, even, _WINDOW_PX)
    square = size * pull**2
    if shift is not None:
        square = np.maximum(square, _bump(slope, residual + moved) * open_ / (open_ + _OPEN**2))
    return np.asarray(np.sqrt(square))


def _shift(slope: Array, light: Array, width_px: float) -> tuple[Array, Array]:
    """The shift of the order that answers to a light over a window, and its variance."""
    information = window_sum(slope * slope, width_px) + _LEAST
    noise = window_sum(slope * slope, width_px / np.sqrt(2.0))
    return window_sum(slope * light, width_px) / information, noise / information**2


def _left(slope: Array, light: Array, width_px: float) -> Array:
    """What is left of a light when the order follows it over a window.

    Of a wide one twice, less that of √2 its width: the order may bend within it.
    """
    shift, _ = _shift(slope, light, width_px)
    if width_px > _WINDOW_PX:
        shift = 2.0 * shift - _shift(slope, light, np.sqrt(2.0) * width_px)[0]
    return np.asarray(light - slope * shift)


def _bump(slope: Array, light: Array) -> Array:
    """Square of how far the order differs from its surroundings, beyond the noise."""
    fine, variance = _shift(slope, light, _FINE_PX)
    around, wider = (_shift(slope, light, f * _AROUND_PX)[0] for f in (1.0, np.sqrt(2.0)))
    away = fine - (2.0 * around - wider)
    return np.asarray(np.maximum(away**2 - _SURELY * variance, 0.0) / _SHOWN**2)


def window_sum(values: Array, width_px: float) -> Array:
    """Sum over a Gaussian window whose weight is 1 in the middle, a wide one on fewer pixels.

    Parameters: `values` (rows, cols), nought where masked; `width_px`, the window's standard
    deviation. Returns (rows, cols), single precision.
    """
    import cv2
    from scipy.ndimage import gaussian_filter

    small: Array = values.astype(np.float32)
    rows, cols = small.shape
    by = max(1, min(int(width_px / _COARSE), rows // 4, cols // 4))
    if by > 1:
        small = cv2.resize(small, (cols // by, rows // by), interpolation=cv2.INTER_AREA)
    small = gaussian_filter(small, width_px / by, mode="constant", truncate=3.0)
    if by > 1:
        small = cv2.resize(small, (cols, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(2.0 * np.pi * width_px**2 * small)
