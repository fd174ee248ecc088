"""Fringe order from the intensity, on the branch that a fitted model names.

A pixel's light I = A f(N) + C, f = sin²(pi N) in the ideal dark field, says N only up to its sign
and a whole number. A model that describes the frame names the branch; the value then comes from
the light itself: N = N_model + d, with d from the pixel's own neighbourhood by weighted least
squares, d = Σ w J r / Σ w J², r = (I - A f - C)/sigma, J = (A/sigma) df/dN, repeated until d rests.
Pooling over a few pixels is what lifts the answer above a single pixel's noise, which has no
answer at all on the crests, where df/dN = 0.

Light that is added to a fringe's flank (a lamp's reflection, a smear, dust) moves the order that is
read there, e/(df/dN): only a crest, where no order answers to it, shows it. What a shift of the
order leaves of the light, r - J Σ w J r / Σ w J², is therefore compared with what it leaves of an
even light of unit size, q = o - J Σ w J o / Σ w J²: e = Σ w q r / Σ w q², over windows of several
widths, of which the one that says most counts. Where no crest is within reach nothing tells such
light from stress that the model lacks: there a bump of the order, narrower than its surroundings
make likely, is doubt.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.special import erf

from isochrome.fringes.windows import (
    MOVES,
    POOLED_PX,
    Array,
    Mask,
    Windows,
    expanded,
    gaussian_sum,
    halved,
    masked,
)
from isochrome.optics import FringeWave

_STEADY_PX = 4.0
"""Over which an added light is taken as even, and a bump is one."""
WIDE_PX = 5.0
_FOLLOWED_PX = (WIDE_PX, 12.0)
"""Wider ones over which the order follows, for which blocks of four pixels a side are enough; the
light is even over twice and four times the first."""
_AROUND_PX = 20.0
"""Window of a bump's surroundings."""
_SHOWN = 0.55
"""What such windows show of a round spot of 6 to 12 pixels: 0.57 to 0.52."""
_SURELY = 4.0
"""Variances up to which noise alone explains a light, or a bump."""
_TOLD, _OPEN = 0.01, 0.002
"""Standard uncertainties of the added light, over the contrast: beyond the first a window does not
tell it; beyond the second crests do not, and bumps begin to count."""


def stray_variance(
    residual: Array, slope: Array, even: Array, *, shift: Array | None = None
) -> Array:
    """Variance (rows, cols), fringes², of an order by light that was added to the fringes.
    `residual`, the light less the model's; `slope` J, its change with the order; `even`, with light
    of the size of the contrast; all over the noise, nought where masked. `shift` was taken out
    before, by a model of the specimen; without one a bump is the order's own."""
    parts = residual, slope, even
    residual, slope, even = (np.ascontiguousarray(part, dtype=np.float32) for part in parts)
    square, cross, answer = slope * slope, slope * even, slope * residual
    products = {
        "slope": square, "slope even": cross, "even": even * even,
        "slope light": answer, "even light": even * residual,
    }  # fmt: skip
    means = {name: halved(product) for name, product in products.items()}
    if shift is not None:  # a wide window is to see what a narrow one has followed
        moved = halved(shift)
        means["slope light"] += moved * means["slope"]
        means["even light"] += moved * means["slope even"]
    pairs = _Blocks(2, means)
    of_even, of_light = pairs.shifts(WINDOW_PX)
    size, open_ = pairs.told(of_even, of_light, _STEADY_PX)
    wider, shape = _Blocks(4, {name: halved(mean) for name, mean in means.items()}), size.shape
    for k, follow in enumerate(_FOLLOWED_PX, start=1):
        clear, variance = wider.told(*wider.bent(follow), 2.0**k * _STEADY_PX)
        np.maximum(size, expanded(clear, shape, 2), out=size)
        if k == 1:  # crests that are near
            np.minimum(open_, expanded(variance, shape, 2), out=open_)
    size *= of_even * of_even
    if shift is not None:
        bump = expanded(wider.bump(), shape, 2) * (open_ / (open_ + np.float32(_OPEN**2)))
        np.maximum(size, bump, out=size)
    return expanded(size, residual.shape, 2)


class _Blocks:
    """Means over blocks of the products of slope J, even light o, and light r. What shifts s and t
    leave of o and r is multiplied out, (o - J s)(r - J t) = o r - J o t - J r s + J J s t: shifts
    of wide windows change little within a block."""

    def __init__(self, side: int, means: dict[str, Array]) -> None:
        self._side, self._means = side, means
        self._windows = {name: Windows(mean, side) for name, mean in means.items()}

    def told(self, of_even: Array, of_light: Array, steady: float) -> tuple[Array, Array]:
        """Square of an even light that is surely there over `steady` pixels, and its variance."""
        mean = self._means
        shown = mean["even"] - of_even * (2.0 * mean["slope even"] - of_even * mean["slope"])
        np.maximum(shown, 0.0, out=shown)  # a mean of squares, but for rounding
        both = mean["even light"] - of_even * mean["slope light"]
        both -= of_light * (mean["slope even"] - of_even * mean["slope"])
        square = Windows(shown, self._side)
        total = np.maximum(square.sum(steady), 1e-12)
        surely = Windows(both, self._side).sum(steady) / total
        variance = square.sum(steady / np.sqrt(2.0)) / (total * total)
        surely *= surely
        surely -= _SURELY * variance
        np.maximum(surely, 0.0, out=surely)
        return surely * (variance < _TOLD**2), variance

    def bump(self) -> Array:
        """Square of how far the order differs from its surroundings, beyond the noise."""
        informed = self._windows["slope"].sum(_STEADY_PX) + np.float32(BRANCH**-2)
        noise = self._windows["slope"].sum(_STEADY_PX / np.sqrt(2.0))
        away = self._windows["slope light"].sum(_STEADY_PX) / informed - self.bent(_AROUND_PX)[1]
        away *= away
        away -= _SURELY * noise / (informed * informed)
        return np.asarray(np.maximum(away, 0.0) / np.float32(_SHOWN**2))

    def bent(self, width_px: float) -> tuple[Array, Array]:
        """The shifts, over a wide window twice, less those of √2 its width: the order may bend."""
        narrow, wide = self.shifts(width_px), self.shifts(np.sqrt(2.0) * width_px)
        return 2.0 * narrow[0] - wide[0], 2.0 * narrow[1] - wide[1]

    def shifts(self, width_px: float) -> tuple[Array, Array]:
        """Shifts of the order (rows, cols), fringes, that answer to the even light and to light."""
        informed = self._windows["slope"].sum(width_px) + np.float32(BRANCH**-2)
        even, light = (self._windows[f"slope {one}"].sum(width_px) for one in ("even", "light"))
        return even / informed, light / informed


BRANCH = 0.25
"""Half of a branch of sin², in fringes: a reading farther from the model has left its branch, and
so much is expected of a shift before anything is known."""
NOTABLE = 0.02
"""Share of what could be read that is too small to speak of."""
SURE = 0.05
"""The error, in fringes, that `confidence` is the probability to stay within."""
_ONE = 4.0
"""From which on an error function is 1 to 2e-8."""
_ERRORS = erf(np.arange(0.0, _ONE, 2.0**-14)).astype(np.float32)
LARGEST_UNCERTAINTY = 0.03
"""Of an order that counts as known, fringes."""
WINDOW_PX = 1.7
"""Over which an order is pooled."""
AT_REST = 0.002
"""Root mean square of a difference of orders, fringes, that is none: a third of what the noise
leaves of an order."""
LARGEST_MISFIT = 0.1
"""Of the light, over the contrast, where it tells an order."""
STEEPEST = 0.25
"""Fringes a pixel: finer than four pixels a fringe is not read, nor in colour, where beyond it
a pixel's mixture is no longer of the second order."""


@dataclass(frozen=True)
class OrderReading:
    """Fringe order (rows, cols) of a frame, fringes; NaN where it cannot be known."""

    order: Array
    # standard: from the noise, the local misfit and light that is not the fringes'
    uncertainty: Array
    confidence: Array  # probability that the order is right to 0.05 fringe; 0: not known
    kept: float  # share of the specimen's pixels that are known


def read_order(
    light: Array, model_order: Array, wave: FringeWave,
    *, illumination: Array, background: Array, sigma: Array, valid: Mask,
) -> OrderReading:  # fmt: skip
    """Read the fringe order of each pixel on the branch of a fitted model (NaN off the specimen).
    Not known: masked; over 0.03 fringe from the neighbourhood's noise and light that is not the
    fringes'; light and model apart by over a tenth of the contrast and twice the noise; a reading
    that leaves its branch; fringes finer than four pixels. `wave`: the signal about the model's
    order."""
    material = np.isfinite(model_order)
    model, noise, amplitude = (
        np.ascontiguousarray(part, dtype=np.float32) for part in (model_order, sigma, illumination)
    )
    weight = (valid & material).astype(np.float32)
    per_noise = weight / noise
    gain = amplitude * per_noise
    fringed = (light - background).astype(np.float32, copy=False) * per_noise
    height, turns = np.asarray(wave.cosine), wave.turns
    if wave.sine is not None:  # a cos s and a sin s of the wave a cos(t - s)
        size, lag = cv2.cartToPolar(height, wave.sine)
        height, turns = np.asarray(size), turns - np.asarray(lag)
    height, turns, varying = (
        np.ascontiguousarray(part if material.all() else masked(part, material, 0.0), np.float32)
        for part in (gain * height, turns, fringed - gain * wave.mean)
    )

    def light_and_slope(shift: Array) -> tuple[Array, Array]:
        """Light less the signal's at a shift d from the branches, over its noise, and its slope."""
        angle = shift * np.float32(2.0 * np.pi)
        angle += turns
        # both in a quarter of the time of np.sin and np.cos, to 2e-7
        light, slope = cv2.polarToCart(height, angle)
        slope *= np.float32(-2.0 * np.pi)
        return np.subtract(varying, light, out=light), slope

    smooth = np.zeros(model.shape, dtype=np.float32)
    for _ in range(MOVES):  # over wide windows, whose moves are smooth: on blocks of two pixels
        residual, slope = light_and_slope(smooth)
        residual *= slope
        slope *= slope
        information = Windows(halved(slope), 2).sum(WIDE_PX)
        step = _move(information, Windows(halved(residual), 2).sum(WIDE_PX))
        smooth += expanded(step, model.shape, 2)
        if float(np.vdot(step, step)) < AT_REST**2 * step.size:
            break  # the model was as near
    before, slope = light_and_slope(smooth)
    square = slope * slope
    information = gaussian_sum(square, WINDOW_PX)
    shift = smooth + _move(information, gaussian_sum(slope * before, WINDOW_PX))
    # what an order errs by changes little from pixel to pixel, but for how steep its own fringe is
    residual, _ = light_and_slope(shift)
    residual *= residual
    count = np.maximum(Windows(halved(weight), 2).sum(WINDOW_PX), 1e-6)
    misfit = Windows(halved(residual), 2).sum(WINDOW_PX) / count  # squared, as its noise
    misfit, count = (expanded(part, model.shape, 2) for part in (misfit, count))
    stray = stray_variance(before, slope, gain, shift=smooth)
    spread = gaussian_sum(square, WINDOW_PX / np.sqrt(2.0))
    spread /= np.maximum(information * information, 1e-24)
    uncertainty = np.sqrt(spread * np.maximum(misfit, 1.0) + stray)
    largest = np.maximum(LARGEST_MISFIT * gain, 2.0)
    known = (
        (weight > 0.0)
        & (count > 0.5 * (2.0 * np.pi * WINDOW_PX**2))
        & (uncertainty < LARGEST_UNCERTAINTY)
        & (misfit < largest * largest)
        & (np.abs(shift) < BRANCH)
        & (cv2.magnitude(*np.gradient(model)) < STEEPEST)  # of four pixels, nor beside no specimen
    )
    shift += model
    return make_reading(np.abs(shift, out=shift), uncertainty, known, of=material)


def _move(information: Array, answer: Array) -> Array:
    """How far an order moves by Σ w J² and Σ w J r, fringes: it stays on its branch."""
    step = answer / (information + np.float32(BRANCH**-2))
    return np.asarray(np.clip(step, -BRANCH, BRANCH, out=step))


def probability(uncertainty: Array) -> Array:
    """Probability that an order with a normal error is right to `SURE`: erf(SURE/(√2 u)). To 4e-5,
    from a table: a picture's error functions take a fifth of its reading's time."""
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.minimum((SURE / 2.0**0.5) / uncertainty, _ONE)
        at = np.rint(far * np.float32(_ERRORS.size / _ONE)).astype(np.int32)
    return np.asarray(_ERRORS.take(at, mode="clip"))  # single precision, as maps are


def make_reading(order: Array, uncertainty: Array, known: Mask, *, of: Mask) -> OrderReading:
    """An OrderReading of known pixels, and which share they are of some."""
    kept = float(np.count_nonzero(known) / max(1, int(np.count_nonzero(of))))
    sure = masked(probability(uncertainty), known, 0.0)
    return OrderReading(masked(order, known), masked(uncertainty, known), sure, kept)


def less_sure(reading: OrderReading, error: Array, largest: float) -> OrderReading:
    """A reading whose orders may be off by e more, (u² + e²)^(1/2), not known from `largest` on."""
    read = np.isfinite(reading.order)
    uncertainty = np.hypot(np.where(read, reading.uncertainty, 0.0), error)
    known = read & (uncertainty < largest)
    widened_reading = make_reading(reading.order, uncertainty, known, of=read)
    return replace(widened_reading, kept=reading.kept * widened_reading.kept)


def widened(reading: OrderReading, error: Array) -> OrderReading:
    """Widen a reading by errors of the signal that pooling does not average out. An error e moves
    the order by e/(pi sin 2 pi N), pooled as the reading is by sum(w |sin| e)/(pi sum(w sin²)); on
    a crest, where the sine is nought, by sqrt(e)/pi at most."""
    known = np.isfinite(reading.order)
    sine = np.abs(np.sin(2.0 * np.pi * np.where(known, reading.order, 0.0))) * known
    pull = gaussian_sum(sine * error, POOLED_PX)
    slope = np.pi * gaussian_sum(sine * sine, POOLED_PX)
    moved = np.minimum(pull / np.maximum(slope, 1e-9), np.sqrt(error) / np.pi)
    return less_sure(reading, moved, LARGEST_UNCERTAINTY)
