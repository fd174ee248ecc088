"""The linear half of an intensity fit: illumination and background for a given signal.

I = f A + C with A = sum_k a_k B_k and C = sum_k c_k C_k. For a given signal f the coefficients
(a, c) follow from the weighted normal equations; the bases are few and near orthogonal, so
that these are well conditioned, and a scaled eigen-decomposition drops what is not determined.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError

Array = NDArray[Any]

MOSTLY = 0.05
"""Share of pixels whose illumination may be negative before the contrast counts as wrong."""


_CUTOFF = {4: 1e-6, 8: 1e-12}
"""Eigenvalues below which directions are dropped, over the largest, by the precision in bytes."""


@dataclass(frozen=True)
class SeparableProblem:
    """A frame's n valid pixels, weighted by 1/sigma."""

    data: Array
    light: Array  # (ka, n), the illumination's basis
    dark: Array  # (kc, n), the background's basis
    keep: NDArray[np.bool_]  # (rows, cols): where the pixels are
    dark_gram: Array  # (kc, kc), dark darkᵀ
    # (ka, n), overwritten by every solution: fresh memory costs more than the arithmetic
    scratch: Array

    @property
    def size(self) -> int:
        """Number of valid pixels."""
        return self.data.size


@dataclass(frozen=True, kw_only=True)
class LinearPart:
    """Coefficients (a, c) for one signal, and the weighted residual they leave."""

    coefficients: Array  # (k,), the illumination's, then the background's
    signal: Array  # (n,), solved for
    inverse: Array  # (k, k), of the weighted columns' Gram matrix
    amplitude: Array  # (n,), the weighted illumination
    residual: Array  # (n,), weighted
    cost: float  # the residual's sum of squares
    negative_share: float  # share of pixels whose illumination is not positive

    @property
    def positive(self) -> bool:
        """Whether the illumination is positive over (nearly) the whole frame."""
        return self.negative_share <= MOSTLY


@dataclass(frozen=True)
class Evaluation:
    """What a fixed signal explains: `chi` (inf for a negative illumination) and coefficients."""

    chi: float
    illumination_coefficients: Array
    background_coefficients: Array
    positive: bool


def prepare(
    image: ArrayLike,
    *,
    mask: NDArray[np.bool_] | None,
    sigma: ArrayLike,
    illumination: Array,
    background: Array,
) -> SeparableProblem:
    """Drop the masked pixels (None: those not finite), weight the rest by 1/sigma.

    Bases (k, rows, cols), see `polynomial_basis`. InputError where shapes do not agree, no pixel is
    valid, or a sigma is not positive.
    """
    frame = np.asarray(image, dtype=float)
    if frame.ndim != 2:
        raise InputError(f"the image has {frame.ndim} dimensions; give one frame (rows, cols)")
    for name, stack in (("illumination", illumination), ("background", background)):
        if np.ndim(stack) != 3 or np.shape(stack)[1:] != frame.shape:
            raise InputError(
                f"{name} has the shape {np.shape(stack)}; give a stack (k, rows, cols) on the "
                f"image's own grid {frame.shape}"
            )
    keep = np.isfinite(frame) if mask is None else np.asarray(mask, dtype=bool) & np.isfinite(frame)
    noise = np.broadcast_to(np.asarray(sigma, dtype=float), frame.shape)[keep]
    if not keep.any() or not np.all(noise > 0):
        raise InputError("no valid pixel, or a sigma that is not positive; check mask and sigma")
    weight = 1.0 / noise
    # an indexed stack comes back with its axes swapped in memory, and matrix products then crawl
    light, dark = (np.ascontiguousarray(s[:, keep] * weight) for s in (illumination, background))
    return SeparableProblem(
        frame[keep] * weight, light, dark, keep, dark @ dark.T, np.empty_like(light)
    )


def solve_linear(problem: SeparableProblem, signal: Array) -> LinearPart:
    """Illumination and background that fit best for a signal (n,), the ideal polariscope's 0..1."""
    light = np.multiply(problem.light, signal, out=problem.scratch)
    cross = light @ problem.dark.T
    gram = np.block([[light @ light.T, cross], [cross.T, problem.dark_gram]]).astype(float)
    inverse = scaled_inverse(gram, _CUTOFF[problem.light.dtype.itemsize])
    right = np.concatenate((light @ problem.data, problem.dark @ problem.data))
    coefficients = inverse @ right
    a, c = np.split(coefficients.astype(problem.light.dtype), [len(light)])
    amplitude = a @ problem.light
    residual = problem.data - amplitude * signal
    residual -= c @ problem.dark
    return LinearPart(
        coefficients=coefficients,
        signal=signal,
        inverse=inverse,
        amplitude=amplitude,
        residual=residual,
        cost=float(np.sum(np.square(residual), dtype=float)),
        negative_share=np.count_nonzero(amplitude <= 0.0) / amplitude.size,
    )


def evaluate(
    image: ArrayLike,
    signal: ArrayLike,
    *,
    illumination: Array,
    background: Array,
    mask: NDArray[np.bool_] | None = None,
    sigma: ArrayLike = 1.0,
) -> Evaluation:
    """How well a fixed signal, 0..1, explains a frame, with the best illumination and background.

    `chi` is inf where the illumination comes out negative: such a signal has the wrong contrast.
    InputError where shapes do not agree.
    """
    problem = prepare(
        image, mask=mask, sigma=sigma, illumination=illumination, background=background
    )
    return evaluate_prepared(problem, np.asarray(signal, dtype=float))


def evaluate_prepared(problem: SeparableProblem, signal: Array) -> Evaluation:
    """`evaluate` of a frame that is prepared already: a scan's inner step."""
    split = len(problem.light)
    values = signal[problem.keep]
    if not np.all(np.isfinite(values)):
        nothing = np.zeros(split), np.zeros(len(problem.dark))
        return Evaluation(np.inf, *nothing, positive=False)
    part = solve_linear(problem, values)
    dof = max(1, problem.size - len(part.coefficients))
    chi = float(np.sqrt(part.cost / dof)) if part.positive else np.inf
    a, c = part.coefficients[:split], part.coefficients[split:]
    return Evaluation(chi, a, c, part.positive)


def scaled_inverse(matrix: Array, cutoff: float = 1e-12) -> Array:
    """Pseudo-inverse of normal equations (k, k), scaled to a unit diagonal first.

    The unknowns' units may differ by many powers of ten. Directions whose eigenvalue over the
    largest is below the cutoff are dropped.
    """
    diagonal = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = 1.0 / np.where(diagonal > 0, diagonal, 1.0)
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    good = values > cutoff * values[-1:]
    half = (scale[:, None] * vectors[:, good]) / np.sqrt(values[good])
    result: Array = half @ half.T
    return result
