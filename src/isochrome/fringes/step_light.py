"""What the light of a phase-stepped set says in each pixel, before any whole number is settled.

Least squares over the steps gives the maps of `steps`, these the direction of sigma_1 (`isoclinic`)
and how far each pixel is to be trusted (`step_quality`). A frame that cannot be trusted in a pixel,
saturated there or faulty, is left out of that pixel alone, where the other frames still tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fringes.isoclinic import Direction, find_direction
from isochrome.fringes.step_quality import (
    bright_enough,
    fringed,
    phase_uncertainty,
    step_misfit,
)
from isochrome.fringes.steps import (
    BACKGROUND,
    CROSS,
    CROSS_SINE,
    SINE,
    SINE_SINE,
    StepDesign,
    StepTerms,
    make_design,
    solve_steps,
)
from isochrome.optics import Chain

Array = NDArray[Any]
Mask = NDArray[np.bool_]

LARGEST_UNCERTAINTY = 0.03
"""Fringes: a pixel whose noise is more is not known."""

_PASSES = 2
_LARGEST_MISFIT = 0.1
_MOST_NOISE = 3.0
"""Times the noise of the whole set that a pixel may have for want of some of its frames."""


@dataclass(frozen=True)
class StepLight:
    """What a set's light says; maps (rows, cols).

    `terms` and `direction`, see `steps` and `isoclinic`; `seen`, True where the fringes can be
    read; `specimen`, True where light comes through at all; `contrast` A V, in the light's unit;
    `uncertainty` of φ/2π, fringes; `chi`, residual of the light over its noise; `bridges`,
    whether the steps tell no direction about half orders, or leave out what changes it there.
    """

    terms: StepTerms
    direction: Direction
    seen: Mask
    specimen: Mask
    contrast: Array
    uncertainty: Array
    chi: float
    bridges: bool


def measure_steps(
    stack: Array, chains: Sequence[Chain], *, sigma: Array | float, valid: Mask | None = None
) -> StepLight:
    """Read δ, the direction of sigma_1 and their noise from the images of a set's steps.

    Parameters: `stack` (steps, rows, cols), light in any unit; `chains`, the elements of each step;
    `sigma`, standard deviation of the light's noise, in its unit, a number or (rows, cols);
    `valid`, True = trusted, (rows, cols) or frame by frame, (steps, rows, cols). Returns a
    StepLight. Raises InputError where the steps cannot tell the order.
    """
    design = make_design(chains)
    light = np.asarray(stack, dtype=np.promote_types(stack.dtype, np.float32))
    good = np.isfinite(light)
    good = good if valid is None else good & valid
    light, gain, turn_gain = fill_gaps(np.where(good, light, 0.0), good, design)
    trusted, whole, swing = np.isfinite(gain), good.all(axis=0), sigma
    if (gain > 1.0).any():
        swing, sigma = sigma * np.fmax(turn_gain, 1.0), sigma * np.fmax(gain, 1.0)
    terms = solve_steps(light, design)
    direction = find_direction(terms, design, sigma=swing, valid=trusted)
    for _ in range(_PASSES if design.leaks else 0):
        terms = solve_steps(light, design, direction.twice)
        direction = find_direction(terms, design, sigma=swing, valid=trusted)
    contrast = np.hypot(terms.cosine, np.abs(terms.sine))
    seen = trusted & bright_enough(contrast, trusted)
    misfit, chi = step_misfit(light, design, sigma, seen & whole)
    direction = direction.noisier(np.maximum(misfit, 1.0))
    uncertainty = phase_uncertainty(terms, design, direction, sigma) * np.maximum(misfit, 1.0)
    seen &= (uncertainty < LARGEST_UNCERTAINTY) & (
        misfit * sigma < np.maximum(_LARGEST_MISFIT * contrast, 2.0 * sigma)
    )
    specimen = trusted & fringed(contrast, design, sigma)
    return StepLight(terms, direction, seen, specimen, contrast, uncertainty, chi, design.leaks)


def fill_gaps(light: Array, good: Mask, design: StepDesign) -> tuple[Array, Array, Array]:
    """Give the frames that cannot be trusted in a pixel the light that its other frames ask for.

    Equation: I_missing = M_missing x, x the least squares of the frames that are there; all frames
    together then have the very solution x. Parameters: `light` (steps, rows, cols), nought where
    not `good`; `good` of that shape, True = trusted; `design`. Returns the light, and how many
    times the noise is that of a whole pixel, at most of any unknown, and on the whole of those that
    tell the direction (rows, cols): 1 where every frame is there, NaN where the rest cannot tell
    the order. Source: Yates (1933), Empire Journal of Experimental Agriculture 1, 129 (missing
    observations in least squares).
    """
    gains = np.where(good.all(axis=0), 1.0, np.nan)[None].repeat(2, axis=0).astype(np.float32)
    wanting = np.isnan(gains[0]) & good.any(axis=0)
    if design.leaks or not wanting.any():
        return light, gains[0], gains[1]
    code = np.int64(1) << np.arange(len(light), dtype=np.int64)
    kinds = np.tensordot(code, good[:, wanting].astype(np.int64), axes=1)
    values, noise = light[:, wanting], np.full((2, kinds.size), np.nan, dtype=np.float32)
    for kind in np.unique(kinds):
        there, here = (kind & code) > 0, kinds == kind
        inverse, *more = _part_inverse(design, there)
        if more[0] <= _MOST_NOISE:
            missing = design.matrix[~there][:, design.solved] @ inverse
            chosen = values[np.ix_(there, here)]
            values[np.ix_(~there, here)] = missing.astype(light.dtype) @ chosen
            noise[:, here] = np.reshape(more, (2, 1))
    filled = light.copy()
    filled[:, wanting] = values
    gains[:, wanting] = noise
    return filled, gains[0], gains[1]


def _part_inverse(design: StepDesign, there: Mask) -> tuple[Array, float, float]:
    """Least squares over some of the frames, and the growth of the unknowns' noise by it.

    The largest, and the mean of those that tell the direction; the background is not used, and
    counts for nothing.
    """
    part = design.matrix[there][:, design.solved]
    inverse = np.linalg.pinv(part)
    if np.linalg.matrix_rank(part, tol=1e-6) < len(design.solved):
        return inverse, float("inf"), float("inf")
    growth = np.square(inverse).sum(axis=1) / np.diag(design.covariance)
    unknowns = np.array(design.solved)
    largest = growth[unknowns != BACKGROUND].max()
    turning = growth[np.isin(unknowns, (CROSS, CROSS_SINE, SINE, SINE_SINE))].mean()
    return inverse, float(np.sqrt(largest)), float(np.sqrt(turning))
