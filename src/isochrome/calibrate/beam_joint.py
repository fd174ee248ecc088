"""All images of a beam in one fit: under one light, low orders are told from dim ones.

Where less than a fringe is seen, an image's own amplitude and order are hard to tell apart; images
taken with one lamp and camera share the light, and an unloaded one shows the background. Whether
the light was the same, or changed in brightness, or differs altogether, the images decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.beam_fit import BeamFit
from isochrome.calibrate.beam_stack import Stack, fit_stack, make_stack
from isochrome.calibrate.shot import Shot
from isochrome.calibrate.smooth import degrees_of, light_unknowns
from isochrome.fit import IntensityFit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Together:
    """The images' fits under one light.

    `covariance` (n, n) is that of the slopes, relative to them; `rest` holds the squared order at
    the edge of each unloaded image, with its standard uncertainty; `scaled`, whether the
    brightness changed; `degrees` of illumination and background.
    """

    fits: tuple[BeamFit, ...]
    covariance: Array
    rest: tuple[tuple[float, float], ...]
    scaled: bool
    degrees: tuple[int, int]


def fit_together(
    fits: Sequence[BeamFit],
    idle: Sequence[Shot],
    height_px: float,
    *,
    bright: bool = False,
    light: ArrayLike | None = None,
) -> Together | None:
    """Fit all images of one set with shared light, as far as they allow it.

    Shared light is taken unless chi-square rises by more than ln(pixels) an unknown that it saves
    (Bayes' information criterion; Schwarz, Ann. Statist. 6, 1978, 461-464).
    Parameters: `fits`, each image's own; `idle`, the unloaded images; `height_px`; `bright`;
    `light` (rows, cols), the no-load bright minus dark frame. Returns a Together, or None where
    the images do not share their light: then each image's own fit stands.
    """
    if len({f.shot.image.shape for f in fits} | {s.image.shape for s in idle}) > 1:
        return None
    pixels = sum(int(np.count_nonzero(f.mask)) for f in fits)
    own = sum(f.best.chi**2 * np.count_nonzero(f.mask) for f in fits)
    unknowns = sum(light_unknowns(f.best) for f in fits)
    for scaled in (False, True) if len(fits) > 1 else (False,):
        stack = make_stack(fits, () if scaled else idle, height_px, bright=bright, scaled=scaled)
        found, degrees = _best(stack, light)
        saved = unknowns - light_unknowns(found) - (len(fits) - 1 if scaled else 0)
        loaded = (found.residual / stack.sigma)[: len(fits) * stack.rows]
        worse = pixels * (float(np.nansum(loaded**2)) / own - 1.0)
        if found.converged and found.positive and worse < max(saved, 1) * np.log(pixels):
            return _split(stack, found, degrees)
    return None


def _best(stack: Stack, light: ArrayLike | None) -> tuple[IntensityFit, tuple[int, int]]:
    """The fit with the fewest unknowns of light that describe the stack, and their degrees."""
    few, *rest = degrees_of(light)
    chosen = fit_stack(stack, few, light=light)
    pixels = int(np.count_nonzero(stack.mask))
    for many in rest:
        found = fit_stack(stack, many, light=light)
        gain = pixels * (chosen.chi**2 / max(found.chi, 1e-12) ** 2 - 1.0)
        more = light_unknowns(found) - light_unknowns(chosen)
        if not found.positive or gain < more * np.log(pixels):
            break
        chosen, few = found, many
    return chosen, few


def _split(stack: Stack, found: IntensityFit, degrees: tuple[int, int]) -> Together:
    count, table = len(stack.fits), stack.table(found.values)
    spread = stack.table(found.standard_uncertainty)
    unknowns = (found.values.size + light_unknowns(found)) / count
    fits = []
    for i, fit in enumerate(stack.fits):
        own = slice(i * stack.rows, (i + 1) * stack.rows)
        left = (found.residual / stack.sigma)[own][fit.mask]
        best = replace(
            found, values=table[i], standard_uncertainty=spread[i],
            chi=float(np.sqrt(np.sum(left**2) / (left.size - unknowns))),
            illumination_map=found.illumination_map[own], signal=found.signal[own],
            background_map=found.background_map[own], residual=found.residual[own],
        )  # fmt: skip
        fits.append(replace(fit, best=best))
    slopes, idle = 3 * np.arange(count), slice(3 * count, 3 * count + len(stack.idle))
    relative = found.covariance[np.ix_(slopes, slopes)] / np.outer(table[:, 0], table[:, 0])
    rest = tuple(
        (float(q), float(u))
        for q, u in zip(found.values[idle], found.standard_uncertainty[idle], strict=True)
    )
    return Together(tuple(fits), relative, rest, stack.scaled, degrees)
