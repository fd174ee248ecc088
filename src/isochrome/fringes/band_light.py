"""A colour camera's signals against fringe order in a few numbers, for light that nobody measured.

Each channel's light is taken as a band that is Gaussian over the wavelength, and the channels as
mixed by the camera (crosstalk, and the camera's own colour correction, which is negative):

    s_k(N) = ∫ g(e) (1 - cos(2 pi N r_k/(1 + b_k e))) de / 2,   t_c(N) = Σ_k M_ck s_k(N) >= 0

with g the normal distribution, r_k = l0/l_k the ratio of the reference to the band's centre, b_k
its relative width, and the rows of M of sum 1. N counts at the green band's centre: r_green = 1.
Source of the integral over the band: Ajovalasit, Barone & Petrucci (1995), J. Strain Analysis
30, 29.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from isochrome.estimation import STEP as DIFFERENCE
from isochrome.fringes.colour_table import STEP, ColourTable, end_of_contrast
from isochrome.fringes.windows import Array

_PLACES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(48)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_OFF_DIAGONAL = np.nonzero(~np.eye(3, dtype=bool))


def _numbers(ratio: Any, width: Any, mixing: Any) -> Array:
    """The 2 ratios, 3 widths and 6 terms of the mixing that describe a light."""
    parts = zip((ratio, width, mixing), (2, 3, 6), strict=True)
    return np.concatenate([np.broadcast_to(part, count) for part, count in parts])


_RATIO, _WIDTH = np.log(540.0 / np.array([600.0, 460.0])), np.log(0.06)
_CORRECTED_MIXING = (-1.5, 0.1, -0.5, -0.15, -0.05, -0.1)
"""That of the sRGB signals of equal-energy light (IEC 61966-2-1)."""

SENSOR = _numbers(_RATIO, _WIDTH, 0.0)
"""Numbers of a bare sensor in equal-energy white light, whose channels do not mix."""

CORRECTED = _numbers(_RATIO, _WIDTH, _CORRECTED_MIXING)
"""Numbers of a camera that corrects its colours for a display (sRGB)."""

LIKELY = _numbers(0.05, 0.4, 0.2)
"""Expected deviations of a light's numbers from one of these."""

NUMBERS = len(LIKELY)

FOUND_ERROR = 0.03
"""How far a found light's signals are taken to be off, of full light."""


@dataclass(frozen=True)
class BandLight:
    """The bands of red, green and blue and their mixing.

    `ratio` (3,), reference wavelength over the band's centre; `width` (3,), standard deviation over
    the centre; `mixing` (3, 3), rows of sum 1: what each channel takes from each band.
    """

    ratio: Array
    width: Array
    mixing: Array

    def bands(self, order: Array, *, bright: bool = False) -> Array:
        """Light s (n, 3) of the bands at orders N (n,); `bright`, in the bright field."""
        centres = zip(self.ratio, self.width, strict=True)
        turns = (ratio / np.maximum(1.0 + width * _PLACES, 0.3) for ratio, width in centres)
        waves = [np.cos(2.0 * np.pi * np.outer(order, each)) @ _WEIGHTS for each in turns]
        return np.asarray(0.5 + (0.5 if bright else -0.5) * np.stack(waves, axis=1))


def band_light(numbers: Array) -> BandLight:
    """The light of its numbers (11,): log r of red and blue, log b of red, green and blue, and M.

    M, the mixing, is its six terms off the diagonal, row by row.
    """
    red, blue = np.exp(numbers[:2])
    mixing = np.zeros((3, 3))
    mixing[_OFF_DIAGONAL] = numbers[5:11]
    mixing += np.diag(1.0 - mixing.sum(axis=1))
    return BandLight(np.array([red, 1.0, blue]), np.exp(numbers[2:5]), mixing)


def band_table(numbers: Array, *, bright: bool, highest_order: float) -> tuple[ColourTable, Array]:
    """The table of a light, up to where its last contrast fades, and how it changes.

    Its derivative is by the numbers of `band_light` (orders, 3, 11). What a camera cannot show,
    less than no light, is 0.
    """
    order = STEP * np.arange(int(np.ceil(highest_order / STEP)) + 1)
    light = band_light(numbers)
    bands = light.bands(order, bright=bright)
    plain = bands @ light.mixing.T
    last = end_of_contrast(plain)
    table = np.maximum(plain, 0.0)[:last]
    change = np.zeros((last, 3, NUMBERS))
    for i in range(5):
        step = np.zeros(NUMBERS)
        step[i] = DIFFERENCE
        ahead, behind = (
            band_light(numbers + s).bands(order[:last], bright=bright) for s in (step, -step)
        )
        change[..., i] = (ahead - behind) @ light.mixing.T / (2.0 * DIFFERENCE)
    rows, cols = _OFF_DIAGONAL
    change[:, rows, 5 + np.arange(6)] = bands[:last, cols] - bands[:last, rows]
    change *= (plain[:last] > 0.0)[..., None]
    return ColourTable(table, np.zeros(3)), change


def band_scale(order: Array, signal: Array, *, bright: bool = False) -> float:
    """How much light signals (n, 3) at known orders have over those of a light of three bands.

    Of signals that are known up to one factor: light of any bands is half full on the mean over
    many orders, so that bands and factor are found together.
    """
    from scipy.optimize import least_squares

    def misfit(unknowns: Array, start: Array) -> Array:
        light = band_light(unknowns[:NUMBERS])
        model = light.bands(order, bright=bright) @ light.mixing.T
        away = (signal - np.exp(unknowns[NUMBERS]) * model) / FOUND_ERROR
        return np.concatenate([away.ravel(), (unknowns[:NUMBERS] - start) / LIKELY])

    top = float(np.log(np.percentile(signal, 98.0)))
    ends = [
        least_squares(misfit, np.append(start, top), args=(start,), max_nfev=40)
        for start in (SENSOR, CORRECTED)
    ]
    return float(np.exp(min(ends, key=lambda end: float(end.cost)).x[NUMBERS]))
