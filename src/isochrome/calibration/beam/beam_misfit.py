"""What a beam's model does not describe: the misfit's part in the uncertainty, and a bent span.

The covariance of least squares takes the residuals for independent; those of a wrong tone curve or
of a chamfer are not. Leaving out one band of the height after the other shows how much the slope
hangs on where it was read (the delete-a-group jackknife, `jackknife_variance`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.beam.beam_fit import BeamFit, beam_signal
from isochrome.calibration.beam.beam_joint import Stack, fit_stack
from isochrome.errors import PhysicsError
from isochrome.estimation import degrees_of, fit_intensity, jackknife_variance, smooth_light

Array = NDArray[np.float64]

BANDS = 10
"""Bands of the height that are left out one at a time."""

THIN_PIXELS = 20_000
"""Pixels of an image that are enough to see a misfit."""

BENT = 0.02
"""Change of the slope along the span, to either side, that is no pure bending."""

CERTAIN = 6.0
"""Standard uncertainties by which it must be there."""


def band_misfit(fits: Sequence[BeamFit], *, scaled: bool = False) -> Array:
    """Standard uncertainties (n,) of the slopes from misfit, as fractions of them.

    u^2 = (B - 1) var(s_b) over the B bands left out, less the noise's own part.
    Parameters: `fits`, under one light; `scaled`, as in `Stack`.
    """
    thin = [thinned(f) for f in fits]
    stack = Stack(thin, scaled=scaled)
    degrees = degrees_of_fit(fits[0])
    whole = fit_stack(stack, degrees)
    noise = stack.table(whole.standard_uncertainty)[:, 0] / max(1.0, whole.chi)
    y, x = thin[0].places
    depth = np.concatenate([(y - f.view.tilt * x - f.view.top) / f.view.height_px for f in thin])
    low, high = depth[stack.mask].min(), depth[stack.mask].max()
    band = np.floor(BANDS * (depth - low) / (high - low) * (1.0 - 1e-9))
    slopes = []
    for i in range(BANDS):
        result = fit_stack(stack, degrees, mask=stack.mask & (band != i), start=whole.values)
        slopes.append(stack.table(result.values)[:, 0])
    left = np.sqrt(np.maximum(jackknife_variance(np.array(slopes)) - noise**2, 0.0))
    return np.asarray(left / stack.table(whole.values)[:, 0])


def check_span(fit: BeamFit) -> None:
    """Refuse a slope that changes along the span: there is shear, and no pure bending.

    The slope's factor 1 + c1 t + c2 (t^2 - 1/3) over the frame's width, t = -1..1, is fitted with
    everything else free. Raises PhysicsError with the likely cause.
    """
    thin, shot = thinned(fit), fit.shot
    y, x = thin.places
    t = x / (0.5 * shot.light.shape[1])

    def response(params: Array) -> Array:
        slope, row, tilt, c1, c2 = params
        change = 1.0 + c1 * t + c2 * (t * t - 1.0 / 3.0)
        return beam_signal(slope * change * (y - row - tilt * x), shot.bright)

    every = np.s_[:, thin.pick]
    maps = smooth_light(thin.mask.shape, degrees_of_fit(fit), shot.lamp(*every)).bases
    result = fit_intensity(
        shot.light[every], response, np.concatenate([fit.best.values, [0.0, 0.0]]),
        mask=thin.mask, sigma=shot.sigma[every], central=False,
        scale=np.concatenate([fit.view.scale, [0.05, 0.05]]), **maps,
    )  # fmt: skip
    size, spread = np.abs(result.values[3:]), result.standard_uncertainty[3:]
    if np.any((size > BENT) & (size > CERTAIN * spread)):
        (c1, c2), ends = result.values[3:], np.linspace(-1.0, 1.0, 101)
        part = np.ptp(c1 * ends + c2 * ends * ends)
        raise PhysicsError("fringes_slope_changes_along", name=shot.name, part=part)


def thinned(fit: BeamFit) -> BeamFit:
    """A fit on fewer of its columns: for what needs no more than THIN_PIXELS."""
    step = max(1, int(np.count_nonzero(fit.mask) / THIN_PIXELS))
    best = replace(fit.best, residual=fit.best.residual[:, ::step])
    return replace(fit, cols=fit.cols[::step], best=best)


def degrees_of_fit(fit: BeamFit) -> tuple[int, int]:
    """The degrees of illumination and background with which an image was fitted."""
    count = len(fit.best.illumination_coefficients)
    known = degrees_of(fit.shot.no_load_light)
    return next(d for d in known if (d[0] + 1) * (d[0] + 2) // 2 == count)
