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

from isochrome.fringes.windows import Array, Windows, expanded, gaussian_sum, halved

_WINDOW_PX = 1.7
"""Of the reading itself."""
_STEADY_PX = 4.0
"""Over which an added light is taken as even."""
_WINDOWS_PX = ((5.0, 8.0, 2), (12.0, 16.0, 4))
"""Wider ones: over which the order follows, and the light is even, and the side of the blocks of
pixels that are enough for them."""
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


def stray_error(
    residual: Array,
    slope: Array,
    even: Array,
    *,
    shift: Array | None = None,
    sums: tuple[Array, Array] | None = None,
) -> Array:
    """Standard uncertainty (rows, cols), fringes, by light that was added to the fringes.

    Equations: the module's. `residual`, the light less the model's; `slope` J, its change with the
    order; `even`, with light of the size of the contrast; all over the noise, nought where masked.
    `shift` was taken out before, by a model of the specimen; without one a bump is the order's own.
    `sums`: Σ w J² and Σ w J r over the reading's window, where known.
    """
    residual, slope, even = (
        np.ascontiguousarray(part, dtype=np.float32) for part in (residual, slope, even)
    )
    square, cross, answer = slope * slope, slope * even, slope * residual
    if sums is None:
        sums = gaussian_sum(square, _WINDOW_PX), gaussian_sum(answer, _WINDOW_PX)
    informed = sums[0] + np.float32(_LEAST)
    of_even = gaussian_sum(cross, _WINDOW_PX) / informed
    rest = even - slope * of_even
    both = halved(rest * (residual - slope * (sums[1] / informed)))
    size, open_ = _told(halved(rest * rest), both, 2, _STEADY_PX)
    light = even * residual
    if shift is not None:  # a wide window is to see what a narrow one has followed
        answer += shift * square
        light += shift * cross
    products = {
        "slope": square, "slope even": cross, "even": even * even,
        "slope light": answer, "even light": light,
    }  # fmt: skip
    pairs = _Blocks(2, {name: halved(product) for name, product in products.items()})
    blocks = {2: pairs, 4: pairs.halved()}
    for follow, steady, side in _WINDOWS_PX:
        clear, variance = blocks[side].told(follow, steady)
        np.maximum(size, expanded(clear, size.shape, side // 2), out=size)
        if follow < _AROUND_PX / 2.0:  # crests that are near
            np.minimum(open_, variance, out=open_)
    moved = expanded(size, residual.shape, 2) * (of_even * of_even)
    if shift is not None:
        bump = pairs.bump(blocks[4]) * (open_ / (open_ + np.float32(_OPEN**2)))
        np.maximum(moved, expanded(bump, residual.shape, 2), out=moved)
    return np.asarray(np.sqrt(moved, out=moved))


def _told(shown: Array, both: Array, side: int, steady: float) -> tuple[Array, Array]:
    """Square of an even light that is surely there (rows, cols), and the variance of it.

    `shown` and `both`, means of q² and q r over blocks of `side` pixels a side; the window over
    which the light is even, `steady`, pixels.
    """
    square = Windows(shown, side)
    total = np.maximum(square.sum(steady), 1e-12)
    variance_shown = Windows(both, side).sum(steady) / total
    variance = square.sum(steady / np.sqrt(2.0)) / (total * total)
    variance_shown *= variance_shown
    variance_shown -= _SURELY * variance
    np.maximum(variance_shown, 0.0, out=variance_shown)
    return variance_shown * (variance < _TOLD**2), variance


class _Blocks:
    """Means over blocks of pixels of the products of slope J, even light o, and light r.

    What shifts s and t leave of o and r is multiplied out, (o - J s)(r - J t) = o r - J o t - J r s
    + J J s t: shifts of wide windows change little within a block.
    """

    def __init__(self, side: int, means: dict[str, Array]) -> None:
        """`side` of a block, pixels; `means` (rows, cols) of each product, by its name."""
        self._side, self._means = side, means
        self._windows = {name: Windows(mean, side) for name, mean in means.items()}
        self._shifts: dict[tuple[str, float], Array] = {}
        self._information: dict[float, Array] = {}

    def halved(self) -> _Blocks:
        """Blocks of twice the side."""
        return _Blocks(2 * self._side, {name: halved(mean) for name, mean in self._means.items()})

    def told(self, follow: float, steady: float) -> tuple[Array, Array]:
        """See `_told`: over which the order follows, and over which the light is even, pixels."""
        mean = self._means
        of_even, of_light = self._answer("even", follow), self._answer("light", follow)
        shown = mean["even"] - of_even * (2.0 * mean["slope even"] - of_even * mean["slope"])
        np.maximum(shown, 0.0, out=shown)  # a mean of squares, but for rounding
        both = mean["even light"] - of_even * mean["slope light"]
        both -= of_light * (mean["slope even"] - of_even * mean["slope"])
        return _told(shown, both, self._side, steady)

    def bump(self, wider: _Blocks) -> Array:
        """Square of how far the order differs from its surroundings, beyond the noise.

        `wider`, the same on blocks of twice the side, where the surroundings are looked at.
        """
        fine = self._shift("light", _FINE_PX)
        noise = self._windows["slope"].sum(_FINE_PX / np.sqrt(2.0))
        informed = self._informed(_FINE_PX)
        around, more = (wider._shift("light", f * _AROUND_PX) for f in (1.0, np.sqrt(2.0)))
        away = fine - expanded(2.0 * around - more, fine.shape, 2)
        away *= away
        away -= _SURELY * noise / (informed * informed)
        return np.asarray(np.maximum(away, 0.0) / np.float32(_SHOWN**2))

    def _answer(self, light: str, width_px: float) -> Array:
        """The shift, over a wide window twice, less that of √2 its width: the order may bend."""
        return np.asarray(
            2.0 * self._shift(light, width_px) - self._shift(light, np.sqrt(2.0) * width_px)
        )

    def _shift(self, light: str, width_px: float) -> Array:
        """The shift of the order (rows, cols) that answers to a light over a window, fringes."""
        if (light, width_px) not in self._shifts:
            total = self._windows[f"slope {light}"].sum(width_px)
            self._shifts[light, width_px] = total / self._informed(width_px)
        return self._shifts[light, width_px]

    def _informed(self, width_px: float) -> Array:
        """Inverse variance of such a shift."""
        if width_px not in self._information:
            self._information[width_px] = self._windows["slope"].sum(width_px) + np.float32(_LEAST)
        return self._information[width_px]
