"""What a beam's model does not describe: the misfit's part in the uncertainty, and a bent span.

The covariance of least squares takes the residuals for independent; those of a wrong tone curve or
of a chamfer are not. Leaving out one band of the height after the other shows how much the slope
hangs on where it was read (the delete-a-group jackknife; Wu, Ann. Statist. 14, 1986, 1261-1295).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.calibrate.beam_fit import BeamFit, beam_scale, beam_signal
from isochrome.calibrate.beam_stack import fit_stack, make_stack
from isochrome.calibrate.smooth import degrees_of, light_maps
from isochrome.errors import PhysicsError
from isochrome.fit import fit_intensity

Array = NDArray[np.float64]

BANDS = 10
"""Bands of the height that are left out one at a time."""

THIN_PIXELS = 20_000
"""Pixels of an image that are enough to see a misfit."""

BENT = 0.02
"""Change of the slope along the span, to either side, that is no pure bending."""

CERTAIN = 6.0
"""Standard uncertainties by which it must be there."""


def band_misfit(
    fits: Sequence[BeamFit],
    height_px: float,
    *,
    bright: bool = False,
    light: ArrayLike | None = None,
    scaled: bool = False,
) -> Array:
    """Standard uncertainties (n,) of the slopes from misfit, as fractions of them.

    u^2 = (B - 1)/B sum_b (s_b - s)^2 over the B bands left out, less the noise's own part.
    Parameters: `fits`, under one light; `height_px`; `bright`, `light`, `scaled` as there.
    """
    thin = [thinned(f) for f in fits]
    stack = make_stack(thin, (), height_px, bright=bright, scaled=scaled)
    degrees = degrees_of_fit(fits[0], light)
    whole = fit_stack(stack, degrees, light=light)
    noise = stack.table(whole.standard_uncertainty)[:, 0] / max(1.0, whole.chi)
    y, x = thin[0].places
    depth = np.concatenate([(y - f.view.tilt * x - f.view.top) / height_px for f in thin])
    low, high = depth[stack.mask].min(), depth[stack.mask].max()
    band = np.floor(BANDS * (depth - low) / (high - low) * (1.0 - 1e-9))
    slopes = []
    for i in range(BANDS):
        found = fit_stack(
            stack, degrees, light=light, mask=stack.mask & (band != i), start=whole.values
        )
        slopes.append(stack.table(found.values)[:, 0])
    spread = (BANDS - 1.0) / BANDS * np.sum((slopes - np.mean(slopes, axis=0)) ** 2, axis=0)
    left = np.sqrt(np.maximum(spread - noise**2, 0.0))
    return np.asarray(left / stack.table(whole.values)[:, 0])


def check_span(
    fit: BeamFit, height_px: float, *, bright: bool = False, light: ArrayLike | None = None
) -> None:
    """Refuse a slope that changes along the span: there is shear, and no pure bending.

    The slope's factor 1 + c1 t + c2 (t^2 - 1/3) over the frame's width, t = -1..1, is fitted with
    everything else free. Raises PhysicsError with the likely cause.
    """
    thin = thinned(fit)
    y, x = thin.places
    t = x / (0.5 * fit.shot.image.shape[1])

    def response(params: Array) -> Array:
        slope, row, tilt, c1, c2 = params
        change = 1.0 + c1 * t + c2 * (t * t - 1.0 / 3.0)
        return beam_signal(slope * change * (y - row - tilt * x), bright=bright)

    known = None if light is None else np.asarray(light, dtype=float)[:, thin.pick]
    maps: dict[str, Any] = light_maps(thin.mask.shape, degrees_of_fit(fit, light), known)
    found = fit_intensity(
        fit.shot.image[:, thin.pick], response, np.concatenate([fit.best.values, [0.0, 0.0]]),
        mask=thin.mask, sigma=fit.shot.sigma[:, thin.pick], central=False,
        scale=np.concatenate([beam_scale(height_px), [0.05, 0.05]]), **maps,
    )  # fmt: skip
    size, spread = np.abs(found.values[3:]), found.standard_uncertainty[3:]
    if np.any((size > BENT) & (size > CERTAIN * spread)):
        part = response_range(found.values[3:])
        raise PhysicsError(
            f"{fit.shot.file}: the fringes' slope changes by {part:.0%} along the span, so that "
            "it is not in pure bending: shear, unequal roller loads, or the frame reaches beyond "
            "the inner rollers; set frames.roi to the middle of the span"
        )


def response_range(change: ArrayLike) -> float:
    """Range of c1 t + c2 (t^2 - 1/3) over t = -1..1, for `change` (c1, c2)."""
    t = np.linspace(-1.0, 1.0, 101)
    c1, c2 = np.asarray(change, dtype=float)
    return float(np.ptp(c1 * t + c2 * t * t))


def thinned(fit: BeamFit) -> BeamFit:
    """A fit on fewer of its columns: for what needs no more than THIN_PIXELS."""
    step = max(1, int(np.count_nonzero(fit.mask) / THIN_PIXELS))
    best = replace(fit.best, residual=fit.best.residual[:, ::step])
    return replace(fit, cols=fit.cols[::step], best=best)


def degrees_of_fit(fit: BeamFit, light: ArrayLike | None) -> tuple[int, int]:
    """The degrees of illumination and background with which an image was fitted."""
    count = len(fit.best.illumination_coefficients)
    known = degrees_of(light)
    sizes = [(d + 1) * (d + 2) // 2 for d, _ in known]
    return known[sizes.index(count)]
