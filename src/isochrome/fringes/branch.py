r"""Fringe order from the intensity, on the branch that a fitted model names.

A pixel's light I = A f(N) + C, f = sin²(pi N) in the ideal dark field, says N only up to its sign
and a whole number. A model that describes the frame names the branch; the value then comes from
the light itself: N = N_model + d, with d from the pixel's own neighbourhood by weighted least
squares, d = Σ w J r / Σ w J², r = (I - A f - C)/sigma, J = (A/sigma) df/dN, repeated until d rests.
Pooling over a few pixels is what lifts the answer above a single pixel's noise, which has no
answer at all on the crests, where df/dN = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fringes.stray import stray_error

Array = NDArray[Any]
Mask = NDArray[np.bool_]

BRANCH = 0.25
"""Half of a branch of sin², in fringes: a reading farther from the model has left its branch."""

SURE = 0.05
"""The error, in fringes, that `confidence` is the probability to stay within."""

_WINDOW_PX = 1.7
_WIDE_PX = 5.0
_LARGEST_UNCERTAINTY = 0.03
_LARGEST_MISFIT = 0.1
_STEEPEST = 0.25
_STEP = 1e-4
_ROUNDS = 4


@dataclass(frozen=True)
class OrderReading:
    """Fringe order of a frame (rows, cols); NaN where it cannot be known.

    `order`, fringes; `uncertainty`, its standard uncertainty from the noise, the local misfit and
    light that is not the fringes';
    `confidence`, the probability that the order is right to 0.05 fringe (0 where not known);
    `kept`, share of the specimen's pixels that are known.
    """

    order: Array
    uncertainty: Array
    confidence: Array
    kept: float


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
    """Read the fringe order of each pixel on the branch of a fitted model.

    Parameters: `light` (rows, cols); `model_order`, N of the model, NaN outside the specimen;
    `response`, order to ideal signal, such as sin²(pi N); `illumination` A and `background` C, in
    the light's unit; `sigma`, noise of the light; `valid`, True = trusted pixels; all
    (rows, cols).
    Returns an OrderReading. A pixel is not known where it is masked, where the neighbourhood's
    noise and light that is not the fringes' leave more than 0.03 fringe, where light and model
    disagree by over a tenth of the contrast and twice the noise, where the reading leaves its
    branch, or where fringes are finer than four pixels.
    """
    material = np.isfinite(model_order)
    base = np.where(material, model_order, 0.0)
    weight = (valid & material).astype(np.float32)
    gain = illumination / sigma
    smooth: Array = np.zeros(light.shape, dtype=np.float32)
    for round_ in range(_ROUNDS):
        signal = response(base + smooth)
        slope = gain * (response(base + smooth + _STEP) - signal) / _STEP * weight
        residual = (light - background - illumination * signal) / sigma * weight
        window = _WINDOW_PX if round_ == _ROUNDS - 1 else _WIDE_PX
        information = gaussian_sum(slope * slope, window)
        step = gaussian_sum(slope * residual, window) / (information + 1.0 / BRANCH**2)
        step = np.clip(step, -BRANCH, BRANCH)
        if round_ < _ROUNDS - 1:
            smooth = smooth + step
    shift, before = smooth + step, residual
    signal = response(base + shift)
    residual = (light - background - illumination * signal) / sigma * weight
    count = np.maximum(gaussian_sum(weight, _WINDOW_PX), 1e-6)
    misfit = np.sqrt(gaussian_sum(residual * residual, _WINDOW_PX) / count)
    spread = np.sqrt(gaussian_sum(slope * slope, _WINDOW_PX / np.sqrt(2.0))) / np.maximum(
        information, 1e-12
    )
    stray = stray_error(before, slope, gain * weight, shift=smooth)
    uncertainty = np.hypot(spread * np.maximum(misfit, 1.0), stray)
    known = (
        (weight > 0.0)
        & (count > 0.5 * (2.0 * np.pi * _WINDOW_PX**2))
        & (uncertainty < _LARGEST_UNCERTAINTY)
        & (misfit * sigma < np.maximum(_LARGEST_MISFIT * illumination, 2.0 * sigma))
        & (np.abs(shift) < BRANCH)
        & (_gradient(base, material) < _STEEPEST)
    )
    order = np.abs(base + shift)
    return OrderReading(
        np.where(known, order, np.nan).astype(np.float32),
        np.where(known, uncertainty, np.nan).astype(np.float32),
        np.where(known, probability(uncertainty), 0.0).astype(np.float32),
        float(known.sum() / max(1, material.sum())),
    )


def gaussian_sum(values: Array, width_px: float) -> Array:
    """Sum over a Gaussian window whose weight is 1 in the middle.

    Parameters: `values` (rows, cols), nought where masked; `width_px`, the window's standard
    deviation. Returns (rows, cols), single precision.
    The square of such a window is one of width/√2: it gives the variance of a pooled sum.
    """
    from scipy.ndimage import gaussian_filter

    area = 2.0 * np.pi * width_px**2
    return area * gaussian_filter(values.astype(np.float32), width_px, mode="constant")


def _gradient(order: Array, material: Mask) -> Array:
    """Fringes a pixel of the model, infinite beside the specimen's edge."""
    rows, cols = np.gradient(np.where(material, order, np.nan))
    steep = np.hypot(rows, cols)
    return np.where(np.isfinite(steep), steep, np.inf)


def probability(uncertainty: Array) -> Array:
    """Probability that an order with a normal error is right to `SURE`: erf(SURE/(√2 u))."""
    from scipy.special import erf

    return erf(SURE / (np.sqrt(2.0) * np.maximum(uncertainty, 1e-9)))


def less_sure(reading: OrderReading, error: Array, largest: float) -> OrderReading:
    """A reading whose orders may be off by more: u' = (u² + e²)^(1/2).

    Parameters: `reading`; `error`, a standard uncertainty to be added (rows, cols), fringes;
    `largest`, from which a pixel is not known. Returns an OrderReading.
    """
    read = np.isfinite(reading.order)
    uncertainty = np.hypot(np.where(read, reading.uncertainty, 0.0), error)
    known = read & (uncertainty < largest)
    return OrderReading(
        np.where(known, reading.order, np.nan).astype(np.float32),
        np.where(known, uncertainty, np.nan).astype(np.float32),
        np.where(known, probability(uncertainty), 0.0).astype(np.float32),
        reading.kept * float(known.sum() / max(1, read.sum())),
    )
