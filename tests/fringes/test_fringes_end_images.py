"""Smooth images of the light's ends: what they span, and spots where a frame asks for them."""

import numpy as np
import pytest

from isochrome.benchmarks import load_benchmarks
from isochrome.fringes import fit_background_modulation, gamma_misfit
from isochrome.fringes.single_frame import background_modulation, end_search

SHAPE = (40, 60)
OUTSIDE = load_benchmarks("outside_camera")
LIT = (240, 300)
NOISE = 0.012


@pytest.mark.parametrize("by", [1, 3])
def test_a_lamps_spot_and_bar_are_followed(by):
    """The study's own lamps, 1 : 2 : what is left of them is a hundredth of the light."""
    lamp = OUTSIDE._lamp(SHAPE, OUTSIDE.Defects(spot=0.5, bar=0.3))
    lamp = lamp[(by - 1) // 2 :: by, (by - 1) // 2 :: by][: SHAPE[0] // by, : SHAPE[1] // by]
    images = background_modulation.binned_light(SHAPE, by, spots=0.1).images.reshape(lamp.size, -1)
    found = images @ np.linalg.lstsq(images, lamp.ravel(), rcond=None)[0]
    assert np.abs(found - lamp.ravel()).max() < 0.01


def frame(*, spot=0.0, bar=0.0, noise=NOISE, slope=0.03, seed=3):
    """Slanted fringes of some slope under a lamp, the noise, and the lamp: closed form."""
    rows, cols = np.indices(LIT, dtype=float)
    order = slope * cols + 0.4 * slope * rows
    lamp = OUTSIDE._lamp(LIT, OUTSIDE.Defects(spot=spot, bar=bar))
    light = 0.05 + lamp * np.sin(np.pi * order) ** 2
    light = light + noise * np.random.default_rng(seed).normal(size=LIT)
    return light, np.full(LIT, noise), np.ones(LIT, dtype=bool), lamp + 0.05


def test_a_spot_is_found_where_the_frame_shows_it_and_an_end_is_as_uncertain_as_it_is_off():
    """By quadratics alone the bright end would be off by 5 % of the contrast."""
    *given, bright = frame(spot=0.5, bar=0.3)
    found = fit_background_modulation(*given)
    away = np.abs(found.bright - bright)[20:-20, 20:-20]
    assert np.sqrt(np.mean(away**2)) < 0.01
    quadratic = background_modulation.binned_light(LIT, 1).images.reshape(bright.size, -1)
    left = bright.ravel() - quadratic @ np.linalg.lstsq(quadratic, bright.ravel(), rcond=None)[0]
    assert np.sqrt(np.mean(left**2)) > 0.03
    # over the frame, spots and all: the bright end's pulls
    *given, bright = frame(spot=0.4)
    found = fit_background_modulation(*given)
    pulls = (found.bright - bright) / np.sqrt(found.variance[1, 1])
    # a smooth field has some ten independent places; a prior that is too wide gives less
    assert 0.2 < np.sqrt(np.mean(pulls**2)) < 2.0


def test_an_even_lamp_asks_for_no_spots():
    """Slight ones alone are left open, which no lamp is quite without: a hundredth of the light."""
    *given, bright = frame()
    found = fit_background_modulation(*given)
    quadratic = background_modulation.binned_light(LIT, 1).images.reshape(bright.size, -1)
    flat = found.bright.ravel()
    left = flat - quadratic @ np.linalg.lstsq(quadratic, flat, rcond=None)[0]
    assert np.abs(left).max() < 0.005
    uncertainty = np.sqrt(found.variance[1, 1])
    assert uncertainty.max() < 0.01
    assert np.abs(found.bright - bright).max() < 3.0 * uncertainty.max()


def crested(turns_at):
    """Fringes under an uneven lamp whose order turns back at some order: light, the lamp's end."""
    _, cols = np.indices(LIT, dtype=float)
    order = turns_at - np.abs(0.02 * (cols - 180.0)) + 0.3 * np.exp(-(((cols - 180.0) / 30.0) ** 2))
    order -= order[0, 180] - turns_at
    lamp = OUTSIDE._lamp(LIT, OUTSIDE.Defects(spot=0.3, bar=0.2))
    return 0.05 + lamp * np.sin(np.pi * order) ** 2, lamp + 0.05


@pytest.mark.parametrize("turns_at", [2.5, 2.4, 2.3])
def test_a_surface_through_the_crests_is_the_lamp_and_leaves_out_what_is_none(turns_at):
    """A bright line at which the order turns back below a crest lies under the lamp."""
    light, bright = crested(turns_at)
    whole = np.ones(LIT, dtype=bool)
    lines = background_modulation.bright_lines(light, np.full(LIT, 0.002), whole)
    on_line = np.isfinite(lines)
    assert 0.01 < on_line.mean() < 0.5
    smooth = background_modulation.binned_light(LIT, 1, spots=0.1)
    terms = background_modulation.surface_through(lines, smooth.images, smooth.spread, 1.0)
    away = smooth.sum(terms) - bright
    crest = on_line & (np.abs(np.indices(LIT)[1] - 180) > 20)
    # lines' light is smoothed over 3 px: (2 pi/50 x 3)²/4 = .036 of a crest,
    # a tenth of that once sharpened
    assert np.sqrt(np.mean(away[crest] ** 2)) < 0.01


@pytest.mark.parametrize("noise", [0.02, 0.03])
def test_the_no_load_frames_own_noise_is_no_tone_curve(noise):
    """In flat patches it looks like one: 0.16 ± .03 and 0.27 ± .03 were found of a linear camera.
    Broad rings, in light that is linear; the no-load frames are means of sixteen."""
    rows, cols = np.indices(LIT, dtype=float)
    rng = np.random.default_rng(1)
    order = 0.6 + 6e-5 * ((cols - 150.0) ** 2 + (rows - 120.0) ** 2)
    light = 0.05 + 0.8 * np.sin(np.pi * order) ** 2 + noise * rng.normal(size=LIT)
    dark, bright = (end + 0.25 * noise * rng.normal(size=LIT) for end in (0.05, 0.85))
    away, spread = gamma_misfit(light, np.full(LIT, noise), np.ones(LIT, bool), (dark, bright))
    assert abs(away) < 4.0 * spread and abs(away) < 0.1


@pytest.mark.parametrize(("times", "within"), [(3.0, (2.0, 4.5)), (0.3, (1.0, 1.0))])
def test_spots_out_of_view_are_as_large_as_those_in_view(times, within):
    """Sixty terms of a prior that is `times` too small, half of them measured to a hundredth.
    What is left open of the others is their true variance, to what thirty normal values tell of it
    (1 in 1000: a half to twice); spots that are smaller than expected make nothing surer."""
    rng = np.random.default_rng(4)
    precision = rng.uniform(1.0, 4.0, 60)
    terms = times * rng.standard_normal(60) / np.sqrt(precision)
    spots = np.arange(60) >= 6
    seen = np.arange(60) % 2 == 0
    measured = np.where(seen, 1e4, 0.0)
    found = np.where(seen, terms, 0.0)
    narrow = np.diag(1.0 / (precision + measured))
    larger = end_search.spots_beyond_prior(narrow, found, precision, spots)
    covariance = end_search.as_spotted(narrow, precision, spots, larger)
    ratio = np.sqrt(np.diag(covariance) * precision)
    low, high = within
    rounding = 1e-12
    assert low - rounding < ratio[~seen & spots].min()
    assert ratio[~seen & spots].max() < high + rounding and (ratio[seen] < 0.03).all()
    np.testing.assert_allclose(ratio[~seen & ~spots], 1.0)
