r"""The fringe order of each pixel followed through time, from an order that is known.

The light of a pixel on a crest does not say whether its order goes on or back. Its neighbours do,
whose change is its own but for little: the change of the whole picture (`order_change`) predicts
each pixel's order, and the wave w = cos 2 pi N corrects it by least squares over windows that
narrow down, d = Σ J r / (Σ J² + (sigma² + e² Σ 1)/u²), r = w - C cos 2 pi N, J = dw/dN, from a
widest one in which d is in proportion to N, to a narrowest one; u is what the prediction leaves
open, and e what the light does. What lies below the narrowest window is smoothed a little in each
frame, for no light would ever correct it. C is what the size of a pixel leaves of fringes of the
gradient g, 1 - pi² g²/6.

On a crest that is all that a pixel's surroundings show, light does not tell a slow change: loads in
proportion do by the rest of the picture, but what drifts besides (r - N Σ r N/Σ N², of the rate r)
may pass the crest unseen or turn back, and after a stated drift the order is not known.

A pixel is known as long as its neighbourhood's light is explained, its fringes are wide enough and
its order changes by no more than a stated part of a fringe; once it is not, it stays so, and says
nothing to its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from isochrome.fringes.film.beside_known import continued
from isochrome.fringes.film.order_change import (
    LARGEST_CHANGE,
    STEEPEST,
    faded_fringes,
    fit_order_change,
    is_wide,
    on_flank,
)
from isochrome.fringes.windows import Array, Mask

_TURN = np.float32(2.0 * np.pi)
_WINDOWS = ((10.0, True), (5.0, False), (2.5, False))
"""Standard deviation of a window, pixels; whether the correction in it is in proportion to N."""
_SPREAD, _SYSTEMATIC = 0.01, 0.03
"""Of the prediction, fringes, and of the wave by light that is not known exactly, which no window
averages out: a region of even order that passes a crest is not to be held up on its near side."""
_LARGEST_STEP = 0.2
_SMOOTHED, _SMOOTH_PX, _SHARP = 0.2, 1.0, 0.15
"""Share of what is taken off below the narrowest window, and the order below which nothing is: the
order has a crease there, where it is nought."""
_RATE_PX, _MISFIT_PX, _START_PX = 3.0, 3.0, 3.0
_NEWEST = 0.3
"""Weight of the newest frame in the drift."""
_TOLD_PX, _TOLD, _LEFT_OPEN = 5.0, 0.08, 0.05
"""Standard deviation (pixels) of the window whose mean flank says whether a pixel's surroundings
tell its order; that mean where all lie within 0.045 of crests; and the fringes that a drift may go
there: beyond, the light on leaving would be as well that of the crest's other side."""
_LARGEST_MISFIT, _NOISY = 0.12, 3.0
"""Of the wave: RMS of the residual that a followed order leaves, and in its noise's."""
_AT_FIRST = 0.1
"""Highest order, from zero load, up to which the light alone tells orders: no crest is passed."""
_NEAR_CREST = 0.42
_LOST_AT_ONCE, _NOISE_LOST = 0.004, 4.0
"""Mean square that the change of the whole picture may leave of the wave, and in its noise's."""
_ALL_BUT = 0.02
"""Share of the followed pixels that is left when a picture is lost."""


@dataclass(frozen=True, kw_only=True)
class FilmState:
    """Where a film stands: (rows, cols) of the pixels on which it is followed."""

    order: Array = field(repr=False)  # N, fringes
    # its change from the frame before, fringes a second; without times a frame
    rate: Array = field(repr=False)
    # what of it, over the latest frames, is not in proportion to the order
    drift: Array = field(repr=False)
    # how far the order has drifted since only a crest is seen of it, fringes
    untold: Array = field(repr=False)
    known: Mask = field(repr=False)
    time: float  # of the frame, s, or its number
    broken: bool = False  # the whole picture could not be followed into this frame


def unloaded_state(material: Mask, time: float) -> FilmState:
    """Start a film at zero load, order 0 all over the specimen, at a time, s, or frame number."""
    nothing = np.zeros(material.shape, dtype=np.float32)
    return FilmState(
        order=nothing, rate=nothing, drift=nothing, untold=nothing, known=material.copy(), time=time
    )


def follow_frame(
    state: FilmState, wave: Array, valid: Mask, time: float, *, noise: float
) -> FilmState:
    """Follow the orders into the next frame, or, with times that fall, into the one before.

    `wave` is its cos 2 pi N, float32, `noise` the wave's standard deviation.
    """
    import cv2

    before = state.order
    weight = valid.astype(np.float32)
    apart = time - state.time
    contrast, steep, gradient = faded_fringes(before)
    top = _highest(state)
    if top < _AT_FIRST:
        order, plain = _at_first(wave, weight)
        known, broken, told = state.known & plain, False, np.ones_like(order)
    else:
        expected = [v * np.float32(apart) for v in (state.rate, state.drift)]
        seen = fit_order_change(before, expected, wave, contrast, gradient, state.known & valid)
        limit = _LOST_AT_ONCE + _NOISE_LOST * noise**2
        if seen is None or seen.misfit > limit or seen.largest > 1.1 * LARGEST_CHANGE:
            return _lost(state, time)
        order, known, broken = np.abs(before + seen.change), state.known, False
        telling = weight * known * (steep < 1.2 * STEEPEST**2)
        order, told = _corrected(order, wave, contrast, telling, noise)
    own = weight * known
    left = (wave - contrast * np.cos(_TURN * order)) * own
    misfit = _window_mean(left * left, own, _MISFIT_PX)
    known = (
        known
        & (misfit < _LARGEST_MISFIT**2 + (_NOISY * noise) ** 2)
        & is_wide(steep)
        & (np.abs(order - before) < LARGEST_CHANGE)
    )
    if np.count_nonzero(known) < _ALL_BUT * np.count_nonzero(state.known):
        return _lost(state, time)
    order = continued(order, known)
    change = cv2.GaussianBlur((order - before) * weight, (0, 0), _RATE_PX)
    rate = change / np.float32(apart) if apart else np.zeros_like(change)
    drift = state.drift + np.float32(_NEWEST) * (_beside_load(rate, before, known) - state.drift)
    untold = state.untold + np.abs(drift * np.float32(apart))
    untold = np.where(told < _TOLD, untold, np.float32(0.0))
    known &= untold < _LEFT_OPEN
    return FilmState(
        order=order, rate=rate, drift=drift, untold=untold, known=known, time=time, broken=broken
    )


def _beside_load(rate: Array, order: Array, known: Mask) -> Array:
    """What of a rate is not in proportion to the order (rows, cols)."""
    own, moved = order[known], rate[known]
    share = float(own @ moved) / max(float(own @ own), 1e-6)
    return np.asarray(rate - np.float32(share) * order)


def _lost(state: FilmState, time: float) -> FilmState:
    """Nothing is known from here on."""
    return replace(state, known=np.zeros_like(state.known), time=time, broken=True)


def _highest(state: FilmState) -> float:
    """The highest order that is known, but for a few pixels."""
    known = state.order[state.known][::7]
    return float(np.percentile(known, 99.8)) if known.size else 0.0


def _at_first(wave: Array, weight: Array) -> tuple[Array, Mask]:
    """Orders below the first crest, and where they are: in each body what no crest cuts off."""
    import cv2

    signal = _window_mean(0.5 - 0.5 * wave, weight, _START_PX)
    order = np.arcsin(np.sqrt(np.clip(signal, 0.0, 1.0))) / np.float32(np.pi)
    inside = weight > 0.0
    body = _labels(inside)
    plain = np.zeros(inside.shape, dtype=bool)
    parts = _labels(inside & (order < _NEAR_CREST))
    for own in range(1, int(body.max()) + 1):
        sizes = np.bincount(parts[body == own], minlength=2)
        sizes[0] = 0
        if sizes.any():
            plain |= parts == int(sizes.argmax())
    beyond = (inside & ~plain).astype(np.uint8)
    return order, plain & (cv2.dilate(beyond, np.ones((3, 3), np.uint8)) == 0)


def _labels(where: Mask) -> Array:
    import cv2

    return np.asarray(cv2.connectedComponents(where.astype(np.uint8))[1])


def _corrected(
    order: Array, wave: Array, contrast: Array, weight: Array, noise: float
) -> tuple[Array, Array]:
    """The predicted orders as their neighbourhoods' light corrects them, and how far it does."""
    import cv2

    telling = np.ones_like(order)
    for width, proportional in _WINDOWS:
        angle = _TURN * order
        left = (wave - contrast * np.cos(angle)) * weight
        slope = -_TURN * contrast * np.sin(angle) * weight
        flank = on_flank(slope)
        area = 2.0 * np.pi * width**2
        spread = (noise**2 + area * _SYSTEMATIC**2) / _SPREAD**2
        least: Array = np.full((1, 1), spread, dtype=np.float32)
        if proportional:
            slope = slope * order
            least = least * np.maximum(order * order, np.float32(1e-4))
        told = slope * flank
        if width == _TOLD_PX:
            telling = _window_mean(flank * weight, weight, width)
        step = _window_sum(told * left, width) / (_window_sum(told * slope, width) + least)
        step = np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
        order = np.abs(order + (step * order if proportional else step))
    smooth = cv2.GaussianBlur(order, (0, 0), _SMOOTH_PX)
    fine = np.float32(_SMOOTHED) * (smooth - order)
    return np.asarray(order + np.where(order > _SHARP, fine, np.float32(0.0))), telling


def _window_sum(values: Array, width_px: float) -> Array:
    """Sum over a Gaussian window whose weight is 1 in the middle."""
    import cv2

    kernel = cv2.getGaussianKernel(2 * int(np.ceil(2.5 * width_px)) + 1, width_px, cv2.CV_32F)
    area = np.float32(2.0 * np.pi * width_px**2)
    summed = cv2.sepFilter2D(values, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(area * summed)


def _window_mean(values: Array, weight: Array, width_px: float) -> Array:
    """Mean over a Gaussian window of the pixels that count."""
    total = np.maximum(_window_sum(weight, width_px), np.float32(1e-3))
    return np.asarray(_window_sum(values * weight, width_px) / total)
