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

from isochrome.fringes.windows import Array, Windows

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


def stray_error(residual: Array, slope: Array, even: Array, *, shift: Array | None = None) -> Array:
    """What light that was added to the fringes may do to an order that is read from them.

    Equations: the module's. Parameters: `residual`, the light less the model's; `slope`, J, its
    change with the order; `even`, its change with light of the size of the contrast; all over the
    noise and nought where masked (rows, cols). `shift` of the order that was taken out before,
    from a model that describes the specimen; without one a bump is the order's own.
    Returns a standard uncertainty (rows, cols), fringes, single precision.
    """
    residual, slope, even = (
        np.ascontiguousarray(part, dtype=np.float32) for part in (residual, slope, even)
    )
    whole = residual if shift is None else residual + slope * shift
    answers = _Answers(slope)
    size, open_ = np.zeros_like(residual), np.full_like(residual, np.inf)
    for follow, steady in _WINDOWS_PX:
        # a wide window is to see what a narrow one has followed
        light = residual if follow < _FINE_PX + 2.0 else whole
        shown, left = (answers.left(part, follow) for part in (even, light))
        square = Windows(shown * shown)
        total = np.maximum(square.sum(steady), 1e-12)
        found = Windows(shown * left).sum(steady) / total
        variance = square.sum(steady / np.sqrt(2.0)) / total**2
        clear = np.where(variance < _TOLD**2, found**2 - _SURELY * variance, 0.0)
        np.maximum(size, clear, out=size)
        if follow < _AROUND_PX / 2.0:  # crests that are near
            np.minimum(open_, variance, out=open_)
    square = size * answers.shift(even, _WINDOW_PX) ** 2
    if shift is not None:
        square = np.maximum(square, _bump(answers, whole) * open_ / (open_ + _OPEN**2))
    return np.asarray(np.sqrt(square))


class _Answers:
    """The shifts of the order that answer to lights, over windows; each is made once."""

    def __init__(self, slope: Array) -> None:
        """`slope`, J (rows, cols), see `stray_error`."""
        self.slope, self._square = slope, Windows(slope * slope)
        self._products: list[tuple[Array, Windows]] = []
        self._shifts: dict[tuple[int, float], Array] = {}
        self._information: dict[float, Array] = {}

    def shift(self, light: Array, width_px: float) -> Array:
        """The shift (rows, cols) that answers to a light over a window, fringes."""
        number = self._number(light)
        found = self._shifts.get((number, width_px))
        if found is None:
            found = self._products[number][1].sum(width_px) / self.information(width_px)
            self._shifts[number, width_px] = found
        return found

    def variance(self, width_px: float) -> Array:
        """The variance of such a shift."""
        noise = self._square.sum(width_px / np.sqrt(2.0))
        return np.asarray(noise / self.information(width_px) ** 2)

    def left(self, light: Array, width_px: float) -> Array:
        """What is left of a light when the order follows it over a window.

        Of a wide one twice, less that of √2 its width: the order may bend within it.
        """
        shift = self.shift(light, width_px)
        if width_px > _WINDOW_PX:
            shift = 2.0 * shift - self.shift(light, np.sqrt(2.0) * width_px)
        return np.asarray(light - self.slope * shift)

    def information(self, width_px: float) -> Array:
        """Inverse variance of a shift where the noise is 1."""
        if width_px not in self._information:
            self._information[width_px] = self._square.sum(width_px) + np.float32(_LEAST)
        return self._information[width_px]

    def _number(self, light: Array) -> int:
        """Which of the lights this is; its product with the slope is made once."""
        for number, (known, _) in enumerate(self._products):
            if known is light:
                return number
        self._products.append((light, Windows(self.slope * light)))
        return len(self._products) - 1


def _bump(answers: _Answers, light: Array) -> Array:
    """Square of how far the order differs from its surroundings, beyond the noise."""
    fine, variance = answers.shift(light, _FINE_PX), answers.variance(_FINE_PX)
    around, wider = (answers.shift(light, f * _AROUND_PX) for f in (1.0, np.sqrt(2.0)))
    away = fine - (2.0 * around - wider)
    return np.asarray(np.maximum(away**2 - _SURELY * variance, 0.0) / np.float32(_SHOWN**2))
