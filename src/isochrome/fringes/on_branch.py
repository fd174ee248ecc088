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
from dataclasses import dataclass, replace

import numpy as np

from isochrome.fringes.stray_light import stray_error
from isochrome.fringes.windows import Array, Mask, gaussian_sum, masked

BRANCH = 0.25
"""Half of a branch of sin², in fringes: a reading farther from the model has left its branch."""

SURE = 0.05
"""The error, in fringes, that `confidence` is the probability to stay within."""

LARGEST_UNCERTAINTY = 0.03
"""Of an order that counts as known, fringes."""

_WINDOW_PX = 1.7
"""Over which an order is pooled."""
_WINDOWS_PX = (5.0, 5.0, 5.0, _WINDOW_PX)
"""Over which it is moved in turn."""
_AT_REST = 0.002
"""Root mean square of a move, fringes, after which wide windows move it no more: a third of what
the noise leaves of an order."""

_LARGEST_MISFIT = 0.1
_STEEPEST = 0.25
_POOLED_PX = 3.0
_STEP = 0.05
"""Fringes over which the slope of a signal is taken."""


@dataclass(frozen=True)
class OrderReading:
    """Fringe order of a frame.

    Parameters
    ----------
    order : ndarray (rows, cols)
        Fringe order, fringes; NaN where it cannot be known.
    uncertainty : ndarray (rows, cols)
        Standard uncertainty of the order, fringes: from the noise, the local misfit and light that
        is not the fringes'.
    confidence : ndarray (rows, cols)
        Probability that the order is right to 0.05 fringe; 0 where it is not known.
    kept : float
        Share of the specimen's pixels that are known.
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

    A pixel is not known where it is masked, where the neighbourhood's noise and light that is not
    the fringes' leave more than 0.03 fringe, where light and model disagree by over a tenth of the
    contrast and twice the noise, where the reading leaves its branch, or where fringes are finer
    than four pixels.

    Parameters
    ----------
    light : ndarray (rows, cols)
        The frame's light.
    model_order : ndarray (rows, cols)
        Order N of the model, fringes; NaN outside the specimen.
    response : callable
        From order to ideal signal, such as sin²(pi N).
    illumination : ndarray (rows, cols)
        Illumination A, in the light's unit.
    background : ndarray (rows, cols)
        Background C, in the light's unit.
    sigma : ndarray (rows, cols)
        Noise of the light, in its unit.
    valid : bool ndarray (rows, cols)
        Whether a pixel is trusted.

    Returns
    -------
    OrderReading
        The order and how well it is known.
    """
    material = np.isfinite(model_order)
    base, noise, amplitude = (
        np.ascontiguousarray(part, dtype=np.float32)
        for part in (np.where(material, model_order, 0.0), sigma, illumination)
    )
    weight = (valid & material).astype(np.float32)
    gain = amplitude / noise * weight
    fringed = (light - background).astype(np.float32, copy=False) / noise * weight
    shift: Array = np.zeros(light.shape, dtype=np.float32)
    moved = np.inf
    for window in _WINDOWS_PX:
        if moved < _AT_REST and window > _WINDOW_PX:
            continue  # the model was as near
        smooth = shift
        order = base + smooth
        slope = gain * _slope(response, order)
        before = fringed - gain * response(order)
        square = slope * slope
        information = gaussian_sum(square, window)
        step = gaussian_sum(slope * before, window)
        step /= information + np.float32(BRANCH**-2)
        shift = smooth + np.clip(step, -BRANCH, BRANCH, out=step)
        moved = float(np.sqrt(np.mean(step * step)))
    order = base + shift
    residual = fringed - gain * response(order)
    count = np.maximum(gaussian_sum(weight, _WINDOW_PX), 1e-6)
    misfit = np.sqrt(gaussian_sum(residual * residual, _WINDOW_PX) / count)
    spread = np.sqrt(gaussian_sum(square, _WINDOW_PX / np.sqrt(2.0))) / np.maximum(
        information, 1e-12
    )
    stray = stray_error(before, slope, gain, shift=smooth)
    uncertainty = np.hypot(spread * np.maximum(misfit, 1.0), stray)
    known = (
        (weight > 0.0)
        & (count > 0.5 * (2.0 * np.pi * _WINDOW_PX**2))
        & (uncertainty < LARGEST_UNCERTAINTY)
        & (misfit * noise < np.maximum(_LARGEST_MISFIT * amplitude, 2.0 * noise))
        & (np.abs(shift) < BRANCH)
        & ~_too_steep(base, material)
    )
    return make_reading(np.abs(order), uncertainty, known, of=material)


def _slope(response: Callable[[Array], Array], order: Array) -> Array:
    """How a signal changes with the order, df/dN.

    Light of one wavelength is a sinusoid of the order, f = a + b cos 2 pi N + c sin 2 pi N, of
    which f(N+h) - f(N-h) = (df/dN) sin(2 pi h)/pi holds for any h: a wide step keeps the digits of
    single precision, and a band of wavelengths changes the sinusoid little within it.
    """
    ahead, behind = response(order + np.float32(_STEP)), response(order - np.float32(_STEP))
    return np.asarray((ahead - behind) * np.float32(np.pi / np.sin(2.0 * np.pi * _STEP)))


def _too_steep(order: Array, material: Mask) -> Mask:
    """Where fringes are finer than four pixels, and beside what is no specimen."""
    down, across = np.gradient(order if material.all() else np.where(material, order, np.nan))
    return np.asarray(~(down * down + across * across < np.float32(_STEEPEST**2)))


def probability(uncertainty: Array) -> Array:
    """Probability that an order with a normal error is right to `SURE`: erf(SURE/(√2 u))."""
    from scipy.special import erf

    share = SURE / 2.0**0.5  # a plain number, which leaves single precision single
    return np.asarray(erf(share / np.maximum(uncertainty, 1e-9)))


def make_reading(order: Array, uncertainty: Array, known: Mask, *, of: Mask) -> OrderReading:
    """An OrderReading of known pixels, and which share they are of some.

    Parameters: `order`, `uncertainty`, fringes; `known`, True where they are; `of`, True on the
    pixels that could be known; all (rows, cols).
    """
    return OrderReading(
        masked(order, known),
        masked(uncertainty, known),
        np.where(known, probability(uncertainty), 0.0).astype(np.float32),
        float(np.count_nonzero(known) / max(1, int(np.count_nonzero(of)))),
    )


def less_sure(reading: OrderReading, error: Array, largest: float) -> OrderReading:
    """A reading whose orders may be off by more: u' = (u² + e²)^(1/2).

    Parameters: `reading`; `error`, a standard uncertainty to be added (rows, cols), fringes;
    `largest`, from which a pixel is not known. Returns an OrderReading.
    """
    read = np.isfinite(reading.order)
    uncertainty = np.hypot(np.where(read, reading.uncertainty, 0.0), error)
    known = read & (uncertainty < largest)
    found = make_reading(reading.order, uncertainty, known, of=read)
    return replace(found, kept=reading.kept * found.kept)


def moved_by_light(order: Array, error: Array) -> Array:
    """How far an error of the signal moves an order that is read from it, fringes.

    Equation: min(e/(pi |sin 2 pi N|), sqrt(e)/pi). Parameters: `order` N, fringes; `error` e of the
    signal, of one shape.
    """
    slope = np.pi * np.abs(np.sin(2.0 * np.pi * order))
    return np.asarray(np.minimum(error / np.maximum(slope, 1e-9), np.sqrt(error) / np.pi))


def widened(reading: OrderReading, error: Array) -> OrderReading:
    """Widen a reading by errors of the signal that pooling does not average out.

    An error e of the signal moves the order by e/(pi sin 2 pi N); pooled over a patch as the
    reading is, by sum(w |sin| e)/(pi sum(w sin²)). On a crest, where the sine is nought, the order
    moves by no more than sqrt(e)/pi. A pixel of more than 0.03 fringe is not known.

    Parameters
    ----------
    reading : OrderReading
        The reading.
    error : ndarray (rows, cols)
        Standard uncertainty e of the signal, such as `BackgroundModulation.signal_uncertainty`.

    Returns
    -------
    OrderReading
        The reading, as uncertain as the errors leave it.
    """
    known = np.isfinite(reading.order)
    order = np.where(known, reading.order, 0.0)
    sine = np.abs(np.sin(2.0 * np.pi * order)) * known
    pull = gaussian_sum(sine * error, _POOLED_PX)
    slope = np.pi * gaussian_sum(sine * sine, _POOLED_PX)
    moved = np.minimum(pull / np.maximum(slope, 1e-9), np.sqrt(error) / np.pi)
    return less_sure(reading, moved, LARGEST_UNCERTAINTY)
