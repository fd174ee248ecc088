"""How far each pixel of a phase-stepped set can be trusted: contrast, misfit, phase noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fringes.isoclinic import Direction, pooled
from isochrome.fringes.steps import COSINE, SINE, SINE_SINE, StepDesign, StepTerms

Array = NDArray[Any]
Mask = NDArray[np.bool_]

_LEAST_CONTRAST = 0.7
"""Of the contrast around: a pixel's area takes that much of it at 0.45 fringe a pixel."""

_DIMMEST = 0.1
_BLOCK = 16
_WINDOW_PX = 2.0


def bright_enough(contrast: Array, trusted: Mask) -> Mask:
    """Where the fringes' contrast is near that of the surroundings: elsewhere they are too fine.

    A pixel's area leaves sinc(g_x) sinc(g_y) of it, g the gradient in fringes a pixel; beyond half
    a fringe a pixel phase turns back on itself, and only the contrast tells. Parameters: `contrast`
    A V (rows, cols); `trusted`, True = usable pixels. Returns a mask (rows, cols).
    """
    import cv2
    from scipy.ndimage import maximum_filter

    brightest = float(np.percentile(contrast[trusted], 90)) if trusted.any() else 0.0
    rows, cols = (n // _BLOCK for n in contrast.shape)
    floor = contrast > _DIMMEST * brightest
    if min(rows, cols) < 1:
        return np.asarray(floor)
    cut = np.where(trusted, contrast, 0.0)[: rows * _BLOCK, : cols * _BLOCK]
    blocks = cut.reshape(rows, _BLOCK, cols, _BLOCK).swapaxes(1, 2).reshape(rows, cols, -1)
    usual = maximum_filter(np.percentile(blocks, 80, axis=2), 3).astype(np.float32)
    around = cv2.resize(usual, contrast.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(floor & (contrast > _LEAST_CONTRAST * around))


def fringed(contrast: Array, design: StepDesign, sigma: Array | float) -> Mask:
    """Where light comes through at all, coarse fringes or fine: the specimen, not a dark surround.

    Parameters: `contrast` A V (rows, cols); `design`; `sigma`, noise of the light. Returns a mask.
    """
    noise = sum(design.variance(j) for j in (COSINE, SINE, SINE_SINE)) * np.square(sigma)
    power = pooled(contrast**2 - noise, _WINDOW_PX)
    return np.asarray(power > (2.0 * _DIMMEST) ** 2 * np.percentile(power, 90))


def step_misfit(
    light: Array, design: StepDesign, sigma: Array | float, seen: Mask
) -> tuple[Array, float]:
    """Residual of the light over its noise, pooled about each pixel, and over all of them.

    What no choice of the seven unknowns can explain: moved or dirty elements, a wrong gamma.
    Parameters: `light` (steps, rows, cols); `design`; `sigma`, noise of the light; `seen`, True =
    pixels that count. Returns the pooled residual (rows, cols), 1 where the steps leave nothing to
    compare, and chi, NaN then.
    """
    left, values, _ = np.linalg.svd(design.matrix)
    rank = int((values > 1e-6).sum())
    free = len(light) - rank
    if free == 0:
        return np.ones(light.shape[1:]), float("nan")
    over = np.tensordot(left[:, rank:].T.astype(light.dtype), light, axes=1)
    square = (over**2).sum(axis=0) / (free * np.square(sigma))
    weight = np.maximum(pooled(seen, _WINDOW_PX), 1e-6)
    misfit = np.sqrt(np.maximum(pooled(np.where(seen, square, 0.0), _WINDOW_PX), 0.0) / weight)
    return misfit, float(np.sqrt(np.mean(square[seen]))) if seen.any() else float("nan")


def phase_uncertainty(
    terms: StepTerms, design: StepDesign, direction: Direction, sigma: Array | float
) -> Array:
    """Standard uncertainty of φ/2π from the noise, φ = atan2(A sin δ, A cos δ) along the direction.

    Equation: var φ = σ² gᵀ Σ g with g = (-sin φ, cos φ cos 2θ, cos φ sin 2θ)/(A V).
    Parameters: `terms`, `design`, `direction`; `sigma`, noise of the light. Returns (rows, cols),
    fringes. Source: propagation of uncertainty, first order (JCGM 100:2008, 5.1.2).
    """
    along = (terms.sine * np.conj(direction.twice)).real
    contrast = np.hypot(terms.cosine, along) + 1e-30
    cosine = terms.cosine / contrast
    slopes = (-along / contrast, cosine * direction.twice.real, cosine * direction.twice.imag)
    total = np.zeros(cosine.shape, dtype=cosine.dtype)
    for i, first in enumerate((COSINE, SINE, SINE_SINE)):
        total += design.variance(first) * slopes[i] ** 2
        for j, second in enumerate((COSINE, SINE, SINE_SINE)[:i]):
            if abs(design.variance(first, second)) > 1e-12:
                total += 2.0 * design.variance(first, second) * slopes[i] * slopes[j]
    return np.asarray(sigma * np.sqrt(total) / contrast / (2.0 * np.pi))
