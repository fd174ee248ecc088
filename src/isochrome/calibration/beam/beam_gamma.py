"""An unknown tone curve, found from the fringes: sin^2 is known, so that its distortion shows.

A camera that stored light^(1/g) is undone by raising its values to g. The g under which pure
bending describes the images best is taken where it describes them far better than none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from isochrome.calibration.beam.beam_fit import BeamFit
from isochrome.calibration.beam.beam_joint import Stack, fit_stack
from isochrome.calibration.beam.beam_misfit import degrees_of_fit, thinned
from isochrome.calibration.shot import Shot

Array = NDArray[np.float64]

REACH = 1.2
"""Exponents from exp(-1.2) to exp(1.2), 0.3 to 3.3, are tried."""

STEPS = 9
SURE = 5.0
"""Standard uncertainties by which ln g must differ from zero."""


@dataclass(frozen=True)
class Tone:
    """The exponent `gamma` that undoes the images' tone curve, its standard uncertainty, and what
    that does to the slopes, as a fraction of them.
    """

    gamma: float
    standard_uncertainty: float
    slope_change: float


def find_tone(fits: Sequence[BeamFit]) -> Tone | None:
    """Find the exponent under which the images are described best.

    Parameters: `fits`, of the images as they are. Returns the Tone, or None where the images are as
    well described as they are, or where no exponent within reach is best. No-load frames would need
    the same exponent, so that there is none with them either.
    """
    if fits[0].shot.no_load_light is not None:
        return None
    thin = [thinned(f) for f in fits]

    def cost(log: float) -> tuple[float, Array]:
        slopes, total = [], 0.0
        for fit in thin:
            gamma_fit = replace(fit, shot=undo_tone(fit.shot, float(np.exp(log))))
            result = fit_stack(Stack([gamma_fit]), degrees_of_fit(fit))
            slopes.append(result.values[0])
            total += result.chi**2 * float(np.count_nonzero(fit.mask))
        return total, np.array(slopes)

    pixels = float(sum(np.count_nonzero(f.mask) for f in thin))
    centre, half = 0.0, REACH
    for count in (STEPS, 5, 5):
        logs = centre + np.linspace(-half, half, count)
        costs, slopes = zip(*(cost(v) for v in logs), strict=True)
        best = int(np.argmin(costs))
        if best in (0, count - 1):
            return None
        step = float(logs[1] - logs[0])
        low, middle, high = costs[best - 1 : best + 2]
        bend = low - 2.0 * middle + high
        centre, half = float(logs[best] + 0.5 * step * (low - high) / bend), step
    spread = float(np.sqrt(2.0 * step**2 / bend * max(1.0, middle / pixels)))
    rate = np.log(slopes[best + 1] / slopes[best - 1]) / (2.0 * step)
    change = float(np.sqrt(np.mean(rate**2))) * spread
    if abs(centre) < SURE * spread:
        return None
    return Tone(float(np.exp(centre)), float(np.exp(centre)) * spread, change)


def undo_tone(shot: Shot, gamma: float) -> Shot:
    """The shot with its intensities raised to `gamma`, and its noise as that makes it.

    sigma' = gamma I^(gamma - 1) sigma at the local level I, of one sigma at least.
    """
    from scipy.ndimage import uniform_filter

    image = np.maximum(shot.light, 0.0)
    level = np.maximum(uniform_filter(np.where(shot.valid, image, 0.0), 3), shot.sigma)
    sigma = gamma * level ** (gamma - 1.0) * shot.sigma
    return replace(shot, light=image**gamma, sigma=np.asarray(sigma, dtype=float))
