"""How uneven the light is: the lowest polynomials that describe an image within its noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.estimation.evidence import RIVAL_CHI, evidence_gain
from isochrome.estimation.intensity import IntensityFit, Response, fit_intensity
from isochrome.estimation.light import degrees_of, smooth_light
from isochrome.estimation.multistart import Minimum, SeveralStarts, several_starts

Array = NDArray[np.float64]


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

    A low degree leaves a slow vignette in the residual, a high one costs accuracy where few fringes
    are seen; more unknowns are taken only where the evidence asks for them. With `light`, the
    no-load bright less the dark frame, degree 1 on it is enough. PhysicsError where no start gives
    a positive illumination.
    """
    maps = [smooth_light(image.shape, i, light).bases for i in degrees_of(light)]
    common: dict[str, Any] = {"mask": mask, "sigma": sigma, "scale": scale, **options}
    found = several_starts(
        image, response, starts, refine=refine, scan_pixels=scan_pixels, **maps[0], **common
    )
    pixels = int(np.count_nonzero(mask))
    for many in maps[1:]:
        fit = fit_intensity(image, response, found.best.values, **many, **common)
        old, new = ((f.chi**2, light_unknowns(f)) for f in (found.best, fit))
        if not fit.positive or evidence_gain(old, new, pixels=pixels) < 0.0:
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
    near = [m for m in few.others if m.chi < RIVAL_CHI * few.best.chi]
    far = [m for m in few.others if m.chi >= RIVAL_CHI * few.best.chi]
    fits = [best, *(fit_intensity(image, response, m.values, **maps, **common) for m in near)]
    first, *rest = sorted(fits, key=lambda f: Minimum.of(f).chi)
    return SeveralStarts(first, (*map(Minimum.of, rest), *far))


def light_unknowns(fit: IntensityFit) -> int:
    """Number of coefficients of illumination and background in a fit."""
    return len(fit.illumination_coefficients) + len(fit.background_coefficients)
