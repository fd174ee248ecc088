"""Closed rings to order 30, and fringes that lose contrast: parabolas and slopes, written out."""

import numpy as np
import pytest
from plain_frames import read_free
from scipy.ndimage import gaussian_filter

from isochrome.fringes.single_frame import free_order

NOISE = 0.03
SMALL = (200, 260)


def rings(centre, radius, shape, *, sign=-1.0, samples=4):
    """N = centre + sign centre (r/R)² at the pixels, its middle, inside, and the light's means."""
    row, col = shape[0] // 2, shape[1] // 2

    def order(y, x):
        return centre + sign * centre * ((y - row) ** 2 + (x - col) ** 2) / radius**2

    y, x = ((np.arange(n * samples) + 0.5) / samples - 0.5 for n in shape)
    fine = np.cos(2.0 * np.pi * order(y[:, None], x[None, :]))
    wave = fine.reshape(shape[0], samples, shape[1], samples).mean(axis=(1, 3))
    rows, cols = np.indices(shape)
    inside = np.hypot(rows - row, cols - col) < radius - 2.0
    return order(rows, cols), (row, col), inside, wave


def read(wave, known, valid=None):
    noisy = wave + NOISE * np.random.default_rng(4).normal(size=wave.shape)
    valid = np.ones(wave.shape, dtype=bool) if valid is None else valid
    return read_free(noisy, np.full(wave.shape, NOISE), valid, known)


def judged(got, order, valid=None):
    """Share that is known, share of that on a wrong branch, and the root mean square error."""
    valid = np.ones(order.shape, dtype=bool) if valid is None else valid
    known = np.isfinite(got.reading.order) & valid
    error = np.abs(got.reading.order - order)[known]
    assert known.any(), got.said
    wrong = float(np.mean(error > 0.25))
    return known.sum() / valid.sum(), wrong, float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize(
    ("centre", "radius", "shape"),
    [
        (12.5, 135.0, SMALL),
        pytest.param(20.5, 330.0, (494, 659), marks=pytest.mark.long),
        pytest.param(30.0, 330.0, (494, 659), marks=pytest.mark.study),
    ],
)
def test_closed_rings_are_kept_whole_from_the_order_of_their_centre(centre, radius, shape):
    """Down to 5.4 pixels a fringe at the rim."""
    order, (row, col), inside, wave = rings(centre, radius, shape)
    got = read(wave, [(row, col, centre, "maximum")], inside)
    share, wrong, rms = judged(got, order, inside)
    assert share > 0.97 and wrong == 0.0 and rms < 0.003 and not got.said


@pytest.mark.long
def test_rings_are_a_bowl_or_open_by_what_their_centre_is_said_to_be():
    """cos 2 pi N is the same for N and 25 - N."""
    order, (row, col), inside, wave = rings(12.5, 135.0, SMALL, sign=1.0)
    share, wrong, _ = judged(read(wave, [(row, col, 12.5, "minimum")], inside), order, inside)
    assert share > 0.97 and wrong == 0.0
    order, (row, col), inside, wave = rings(12.5, 135.0, SMALL)
    got = read(wave, [(row, col, 12.5)], inside)
    assert not np.isfinite(got.reading.order).any()
    assert 'extremum = "maximum" or "minimum"' in got.said[0]
    wrong = read(wave, [(row, col + 60, float(order[row, col + 60]), "maximum")], inside)
    assert not np.isfinite(wrong.reading.order).any() and "no maximum there" in wrong.said[0]


@pytest.mark.long
def test_fringes_of_four_pixels_are_followed():
    """A pixel's own width takes a tenth of their contrast: it is reckoned with."""
    order, (row, col), inside, wave = rings(16.0, 128.0, (262, 262))
    got = read(wave, [(row, col, 16.0, "maximum")], inside)
    share, wrong, _ = judged(got, order, inside)
    assert share > 0.9 and wrong == 0.0
    order = WIDE["valley"]
    wave = gaussian_filter(np.cos(2.0 * np.pi * order), 2.0, mode="nearest")
    share, wrong, rms = judged(read(wave, [(60, 100, float(order[60, 100]))]), order)
    assert share > 0.85 and wrong == 0.0 and rms < 0.01


ROWS, COLS = np.indices((160, 220))
WIDE = {
    "slope": 0.3 + COLS / 45.0 + ROWS / 200.0,
    "valley": 1.0 + 0.8 * ((COLS - 110.0) / 40.0) ** 2 + 0.5 * ((ROWS - 80.0) / 50.0) ** 2,
}


def in_band(order, width):
    """cos 2 pi N over a Gaussian band of relative deviation `width`, wave by wave."""
    points, weights = np.polynomial.hermite_e.hermegauss(25)
    waves = (np.cos(2.0 * np.pi * order * (1.0 + width * p)) for p in points)
    return sum(w * wave for w, wave in zip(weights / weights.sum(), waves, strict=True))


@pytest.mark.long
@pytest.mark.parametrize("name", WIDE)
def test_in_wide_band_light_no_order_is_lost_or_wrong(name):
    """A band 55 nm wide at half height: 84 % of the slope was once wrong, and called known."""
    order = WIDE[name]
    row, col = np.unravel_index(np.abs(order - 1.3).argmin(), order.shape)
    row, col = min(max(row, 8), 151), min(max(col, 8), 211)
    got = read(in_band(order, 0.04), [(row, col, float(order[row, col]))])
    share, wrong, rms = judged(got, order)
    assert share > 0.85 and wrong == 0.0 and rms < 0.01


def test_fringes_of_whole_contrast_are_read_once(monkeypatch):
    def never(*_):
        raise AssertionError("a contrast was sought where none is lost")

    monkeypatch.setattr(free_order, "fit_contrast", never)
    order = WIDE["slope"]
    share, wrong, _ = judged(
        read(np.cos(2.0 * np.pi * order), [(60, 30, float(order[60, 30]))]), order
    )
    assert share > 0.95 and wrong == 0.0
