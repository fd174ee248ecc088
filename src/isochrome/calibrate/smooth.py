"""How uneven the light is: the lowest polynomials that describe an image within its noise."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.fit import (
    IntensityFit,
    Minimum,
    SeveralStarts,
    fit_intensity,
    polynomial_basis,
    several_starts,
)
from isochrome.fit.intensity import Response

Array = NDArray[np.float64]

NEAR = 1.3
"""Part of the best chi within which another minimum may be its rival under more unknowns."""

DEGREES = ((2, 1), (4, 2))
"""Degrees of illumination and background that are tried, fewest unknowns first."""


def smooth_starts(
    image: Array,
    response: Response,
    starts: ArrayLike,
    *,
    light: Array | None = None,
    mask: NDArray[np.bool_],
    sigma: ArrayLike,
    scale: ArrayLike,
    refine: int = 3,
    scan_pixels: int = 20_000,
    **options: Any,
) -> SeveralStarts:
    """`several_starts` with polynomial illumination and background of the degree that is needed.

    A low degree leaves a slow vignette in the residual, a high one costs accuracy where few
    fringes are seen; more unknowns are taken only where they lower Bayes' information criterion,
    chi-square + unknowns * ln(pixels) with chi-square in units of the better fit's.

    Parameters: `light`, the no-load bright minus dark frame (then degree 1 on it is enough); the
    rest as in `several_starts` and `fit_intensity`. Returns SeveralStarts.
    """
    maps = [light_maps(image.shape, i, light) for i in degrees_of(light)]
    common: dict[str, Any] = {"mask": mask, "sigma": sigma, "scale": scale, **options}
    found = several_starts(
        image, response, starts, refine=refine, scan_pixels=scan_pixels, **maps[0], **common
    )
    pixels = int(np.count_nonzero(mask))
    for few, many in pairwise(maps):
        fit = fit_intensity(image, response, found.best.values, **many, **common)
        more = sum(len(many[k]) - len(few[k]) for k in many)
        gain = pixels * (found.best.chi**2 / max(fit.chi, 1e-12) ** 2 - 1.0)
        if not fit.positive or gain < more * np.log(pixels):
            break
        found = _with_rivals(found, fit, image, response, many, common)
    return found


def _with_rivals(
    few: SeveralStarts,
    best: IntensityFit,
    image: Array,
    response: Response,
    maps: dict[str, Any],
    common: dict[str, Any],
) -> SeveralStarts:
    """The minima under more unknowns of light, so that their chi can be held against the best's.

    Those that were far from the best under fewer unknowns stay as they are: far.
    """
    near = [m for m in few.others if m.chi < NEAR * few.best.chi]
    far = [m for m in few.others if m.chi >= NEAR * few.best.chi]
    fits = [best, *(fit_intensity(image, response, m.values, **maps, **common) for m in near)]
    first, *rest = sorted(fits, key=lambda f: f.chi if f.positive else np.inf)
    again = [Minimum(f.values, f.chi if f.positive else np.inf) for f in rest]
    return replace(few, best=first, others=(*again, *far))


def degrees_of(light: ArrayLike | None) -> tuple[tuple[int, int], ...]:
    """Degrees of illumination and background to try; a no-load frame leaves less to be found."""
    return DEGREES if light is None else ((1, 1), (2, 1))


def light_maps(
    shape: tuple[int, ...], degrees: tuple[int, int], light: Array | None
) -> dict[str, Any]:
    """Bases (k, rows, cols) of illumination and background by name, as `fit_intensity` takes them.

    Parameters: `shape`, the frame's; `degrees` of both; `light` (rows, cols) as in `smooth_starts`.
    """
    size = (shape[0], shape[1])
    return {
        "illumination": polynomial_basis(size, degrees[0], times=light),
        "background": polynomial_basis(size, degrees[1]),
    }


def light_unknowns(fit: IntensityFit) -> int:
    """Number of coefficients of illumination and background in a fit."""
    return len(fit.illumination_coefficients) + len(fit.background_coefficients)
