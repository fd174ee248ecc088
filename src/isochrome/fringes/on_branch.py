"""Fringe order from the intensity, on the branch that a fitted model names.

A pixel's light I = A f(N) + C, f = sin²(pi N) in the ideal dark field, says N only up to its sign
and a whole number. A model that describes the frame names the branch; the value then comes from
the light itself: N = N_model + d, with d from the pixel's own neighbourhood by weighted least
squares, d = Σ w J r / Σ w J², r = (I - A f - C)/sigma, J = (A/sigma) df/dN, repeated until d rests.
Pooling over a few pixels is what lifts the answer above a single pixel's noise, which has no
answer at all on the crests, where df/dN = 0.

Light that neither a model nor no-load frames hold: a lamp's reflection, a smear, dust.

Light that is added to a fringe's flank moves the order that is read there, e/(df/dN), and leaves no
trace: only a crest, where no order answers to it, shows it. What a shift of the order leaves of the
light, r - J Σ w J r / Σ w J², is therefore compared with what it leaves of an even light of unit
size, q = o - J Σ w J o / Σ w J²: e = Σ w q r / Σ w q², over windows of several widths, of which the
one that says most counts. Where no crest is within reach nothing tells such light from stress that
the model lacks: there a bump of the order, narrower than its surroundings make likely, is doubt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from isochrome.fringes.windows import (
    Array,
    Mask,
    Windows,
    expanded,
    gaussian_sum,
    halved,
    masked,
    without,
)

BRANCH = 0.25
"""Half of a branch of sin², in fringes: a reading farther from the model has left its branch."""

_LEAST = BRANCH**-2
"""Inverse variance of a shift before anything is known: it stays on its branch."""
_STEADY_PX = 4.0
"""Over which an added light is taken as even."""
_WINDOWS_PX = ((5.0, 8.0, 2), (12.0, 16.0, 4))
"""Wider ones: over which the order follows, and the light is even, and the side of the blocks of
pixels that are enough for them."""
_FINE_PX, _AROUND_PX = 4.0, 20.0
"""Windows of a bump and of its surroundings."""
_SHOWN = 0.55
"""What such windows show of a round spot of 6 to 12 pixels: 0.57 to 0.52."""
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
    remaining = even - slope * of_even
    both = halved(remaining * (residual - slope * (sums[1] / informed)))
    size, open_ = _told(halved(remaining * remaining), both, 2, _STEADY_PX)
    light = even * residual
    if shift is not None:  # a wide window is to see what a narrow one has followed
        answer += shift * square
        light += shift * cross
    products = {
        "slope": square, "slope even": cross, "even": even * even,
        "slope light": answer, "even light": light,
    }  # fmt: skip
    means = {name: halved(product) for name, product in products.items()}
    pairs = _Blocks(2, means)
    blocks = {2: pairs, 4: _Blocks(4, {name: halved(mean) for name, mean in means.items()})}
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
        self._information: dict[float, Array] = {}

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
        wider = self._shift(light, np.sqrt(2.0) * width_px)
        return np.asarray(2.0 * self._shift(light, width_px) - wider)

    def _shift(self, light: str, width_px: float) -> Array:
        """The shift of the order (rows, cols) that answers to a light over a window, fringes."""
        return self._windows[f"slope {light}"].sum(width_px) / self._informed(width_px)

    def _informed(self, width_px: float) -> Array:
        """Inverse variance of such a shift."""
        if width_px not in self._information:
            self._information[width_px] = self._windows["slope"].sum(width_px) + np.float32(_LEAST)
        return self._information[width_px]


SURE = 0.05
"""The error, in fringes, that `confidence` is the probability to stay within."""

LARGEST_UNCERTAINTY = 0.03
"""Of an order that counts as known, fringes."""

_WINDOW_PX = 1.7
"""Over which an order is pooled."""
_WIDE_PX, _WIDE_MOVES = 5.0, 3
"""Over which it is moved before, and how often at most."""
_AT_REST = 0.002
"""Root mean square of a move, fringes, after which wide windows move it no more: a third of what
the noise leaves of an order."""

LARGEST_MISFIT = 0.1
"""Of the contrast, by which light and model may be apart."""
STEEPEST = 0.25
"""Fringes a pixel, beyond which none is read: four pixels a fringe."""
_POOLED_PX = 3.0
_STEP = 0.05
"""Fringes from a branch to where its sinusoid is looked at."""


@dataclass(frozen=True)
class OrderReading:
    """Fringe order (rows, cols) of a frame, fringes; NaN where it cannot be known."""

    order: Array
    # standard: from the noise, the local misfit and light that is not the fringes'
    uncertainty: Array
    confidence: Array  # probability that the order is right to 0.05 fringe; 0: not known
    kept: float  # share of the specimen's pixels that are known


def read_order(
    light: Array,
    model_order: Array,
    response: Callable[[Array], Array],
    *,
    illumination: Array,
    background: Array,
    sigma: Array,
    valid: Mask,
) -> OrderReading:
    """Read the fringe order of each pixel on the branch of a fitted model (NaN off the specimen).

    Not known: masked; over 0.03 fringe from the neighbourhood's noise and light that is not the
    fringes'; light and model apart by over a tenth of the contrast and twice the noise; a reading
    that leaves its branch; fringes finer than four pixels. `response`: from order to ideal signal,
    such as sin²(pi N); illumination A, background C and sigma are in the light's unit.
    """
    material = np.isfinite(model_order)
    model, noise, amplitude = (
        np.ascontiguousarray(part, dtype=np.float32) for part in (model_order, sigma, illumination)
    )
    weight = (valid & material).astype(np.float32)
    per_noise = weight / noise
    gain = amplitude * per_noise
    fringed = (light - background).astype(np.float32, copy=False) * per_noise
    wave = _Wave(fringed, gain, without(model, material), response)
    smooth = _moved_by_wide_windows(wave)
    before, slope = wave.light_and_slope(smooth)
    square = slope * slope
    information = gaussian_sum(square, _WINDOW_PX)
    answer = gaussian_sum(slope * before, _WINDOW_PX)
    stray = stray_error(before, slope, gain, shift=smooth, sums=(information, answer))
    shift = smooth + _move(information, answer)
    residual, _ = wave.light_and_slope(shift)
    count = np.maximum(gaussian_sum(weight, _WINDOW_PX), 1e-6)
    misfit = gaussian_sum(residual * residual, _WINDOW_PX) / count  # squared, as its noise
    spread = gaussian_sum(square, _WINDOW_PX / np.sqrt(2.0))
    spread /= np.maximum(information * information, 1e-24)
    uncertainty = np.sqrt(spread * np.maximum(misfit, 1.0) + stray * stray)
    largest = np.maximum(LARGEST_MISFIT * amplitude, 2.0 * noise)
    steep = sum(np.square(slope) for slope in np.gradient(model))
    known = (
        (weight > 0.0)
        & (count > 0.5 * (2.0 * np.pi * _WINDOW_PX**2))
        & (uncertainty < LARGEST_UNCERTAINTY)
        & (misfit * (noise * noise) < largest * largest)
        & (np.abs(shift) < BRANCH)
        & (steep < np.float32(STEEPEST**2))  # not finer than four pixels, nor beside no specimen
    )
    shift += without(model, material)
    return make_reading(np.abs(shift, out=shift), uncertainty, known, of=material)


class _Wave:
    """Light less a signal's near the branches of a model, over its noise, and the signal's slope.

    Light of one wavelength is a sinusoid of the order: about a branch N, at a distance d, it is
    f(N+d) = a + b cos 2 pi d + c sin 2 pi d, and f(N), f(N+h), f(N-h) give a, b and c. A band of
    wavelengths changes the sinusoid little within a branch.
    """

    def __init__(
        self, light: Array, gain: Array, order: Array, response: Callable[[Array], Array]
    ) -> None:
        """`light` and `gain` over the noise, nought where masked; `order` N; all (rows, cols)."""
        ahead, behind = response(order + np.float32(_STEP)), response(order - np.float32(_STEP))
        middle, angle = response(order), 2.0 * np.pi * _STEP
        even = middle - 0.5 * (ahead + behind)
        self._cosine = even * (gain * np.float32(1.0 / (1.0 - np.cos(angle))))
        self._sine = (ahead - behind) * (gain * np.float32(0.5 / np.sin(angle)))
        self._rest = light - gain * middle + self._cosine
        self.shape = order.shape

    def light_and_slope(self, shift: Array) -> tuple[Array, Array]:
        """What is left of the light at a shift d (rows, cols) from the branches, and its slope."""
        turn = np.float32(2.0 * np.pi) * shift
        cosine, sine = np.cos(turn), np.sin(turn, out=turn)
        residual = self._rest - self._cosine * cosine
        residual -= self._sine * sine
        cosine *= self._sine
        sine *= self._cosine
        cosine -= sine
        cosine *= np.float32(2.0 * np.pi)
        return residual, cosine


def _move(information: Array, answer: Array) -> Array:
    """How far an order moves by Σ w J² and Σ w J r, fringes: it stays on its branch."""
    step = answer / (information + np.float32(_LEAST))
    return np.asarray(np.clip(step, -BRANCH, BRANCH, out=step))


def _moved_by_wide_windows(wave: _Wave) -> Array:
    """How far the orders lie from a model's over wide windows (rows, cols), fringes.

    Such a move is smooth: it is found on blocks of two pixels a side.
    """
    shift = np.zeros(wave.shape, dtype=np.float32)
    for _ in range(_WIDE_MOVES):
        residual, slope = wave.light_and_slope(shift)
        residual *= slope
        slope *= slope
        information = Windows(halved(slope), 2).sum(_WIDE_PX)
        step = _move(information, Windows(halved(residual), 2).sum(_WIDE_PX))
        shift += expanded(step, wave.shape, 2)
        if float(np.vdot(step, step)) < _AT_REST**2 * step.size:
            break  # the model was as near
    return shift


def probability(uncertainty: Array) -> Array:
    """Probability that an order with a normal error is right to `SURE`: erf(SURE/(√2 u))."""
    return np.asarray(erf((SURE / 2.0**0.5) / np.maximum(uncertainty, 1e-9)))


def make_reading(order: Array, uncertainty: Array, known: Mask, *, of: Mask) -> OrderReading:
    """An OrderReading of known pixels, and which share they are of some."""
    kept = float(np.count_nonzero(known) / max(1, int(np.count_nonzero(of))))
    sure = without(probability(uncertainty), known)
    return OrderReading(masked(order, known), masked(uncertainty, known), sure, kept)


def less_sure(reading: OrderReading, error: Array, largest: float) -> OrderReading:
    """A reading whose orders may be off by more: u' = (u² + e²)^(1/2), not known from
    `largest` on.
    """
    read = np.isfinite(reading.order)
    uncertainty = np.hypot(np.where(read, reading.uncertainty, 0.0), error)
    known = read & (uncertainty < largest)
    widened_reading = make_reading(reading.order, uncertainty, known, of=read)
    return replace(widened_reading, kept=reading.kept * widened_reading.kept)


def moved_by_light(order: Array, error: Array) -> Array:
    """How far an error e of the signal moves an order N that is read from it, fringes.

    min(e/(pi |sin 2 pi N|), sqrt(e)/pi).
    """
    slope = np.pi * np.abs(np.sin(2.0 * np.pi * order))
    return np.asarray(np.minimum(error / np.maximum(slope, 1e-9), np.sqrt(error) / np.pi))


def widened(reading: OrderReading, error: Array) -> OrderReading:
    """Widen a reading by errors of the signal that pooling does not average out.

    A standard error e of it moves the order by e/(pi sin 2 pi N); pooled over a patch as the
    reading is, by sum(w |sin| e)/(pi sum(w sin²)). On a crest, where the sine is nought, it is no
    more than sqrt(e)/pi. A pixel of more than 0.03 fringe is not known.
    """
    known = np.isfinite(reading.order)
    sine = np.abs(np.sin(2.0 * np.pi * np.where(known, reading.order, 0.0))) * known
    pull = gaussian_sum(sine * error, _POOLED_PX)
    slope = np.pi * gaussian_sum(sine * sine, _POOLED_PX)
    moved = np.minimum(pull / np.maximum(slope, 1e-9), np.sqrt(error) / np.pi)
    return less_sure(reading, moved, LARGEST_UNCERTAINTY)
