"""The camera: exact where ideal, and each imperfection with the statistics that it names."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isochrome.optics import expose
from isochrome.scene import Camera

RAMP = np.linspace(0.0, 1.0, 256 * 200).reshape(256, 200)
FLAT = np.full((300, 400), 0.5)


def test_an_ideal_camera_returns_the_signal():
    seen = expose(RAMP, Camera())
    assert seen.dtype == np.float32
    # single precision
    np.testing.assert_allclose(seen, RAMP, rtol=6e-8, atol=0)


@given(bits=st.integers(1, 16))
def test_bit_depth_rounds_to_the_nearest_grey_level(bits):
    full = 2**bits - 1
    seen = expose(RAMP, Camera(bit_depth=bits))
    assert seen.dtype == (np.uint8 if bits <= 8 else np.uint16)
    assert seen.min() == 0 and seen.max() == full
    assert np.abs(seen - RAMP * full).max() <= 0.5


def test_saturation_clips_at_the_bit_depths_full_scale():
    seen = expose(RAMP, Camera(bit_depth=10, brightness=2.0))
    assert seen.max() == 1023
    bright = 2.0 * RAMP > 1.0
    np.testing.assert_array_equal(seen[bright], 1023)
    # and no lower: black stays black under noise, without wrapping around
    noisy = expose(np.zeros((50, 50)), Camera(bit_depth=8, noise_grey=3.0))
    assert noisy.min() == 0 and noisy.max() < 30


def test_background_and_brightness_are_the_two_ends_of_the_signal():
    seen = expose(RAMP, Camera(background=0.1, brightness=0.7))
    np.testing.assert_allclose(seen, 0.1 + 0.7 * RAMP, rtol=2e-7, atol=1e-8)


@pytest.mark.parametrize("gamma", [0.45, 1.0, 2.2])
def test_gamma_is_undone_by_its_power(gamma):
    seen = expose(RAMP, Camera(gamma=gamma)).astype(float)
    # single precision, times gamma
    np.testing.assert_allclose(seen**gamma, RAMP, rtol=1e-6, atol=1e-30)


def test_gamma_acts_on_light_before_the_bits():
    seen = expose(RAMP, Camera(gamma=2.2, bit_depth=12))
    assert np.abs(seen - RAMP ** (1 / 2.2) * 4095).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("shape", [(301, 401), (300, 400), (51, 51)])
def test_vignette_is_full_in_the_corners_and_nothing_in_the_middle(shape):
    seen = expose(np.ones(shape), Camera(vignette=0.3)).astype(float)
    for corner in (seen[0, 0], seen[0, -1], seen[-1, 0], seen[-1, -1]):
        assert corner == pytest.approx(0.7, rel=1e-6)
    middle = seen[shape[0] // 2, shape[1] // 2]
    # an even count has no middle pixel: half a pixel off, (1/n)² of the fall-off
    assert middle == pytest.approx(1.0, abs=0.3 * (1 / shape[0] ** 2 + 1 / shape[1] ** 2) + 1e-7)
    # along an edge's middle r² = 1/2
    assert seen[0, shape[1] // 2] == pytest.approx(0.85, abs=1e-4)


def test_a_picture_one_pixel_high_has_a_vignette_that_is_finite():
    seen = expose(np.ones((1, 5)), Camera(vignette=0.3))
    assert np.isfinite(seen).all()


def test_read_noise_has_no_bias_and_the_named_spread():
    camera = Camera(bit_depth=12, noise_grey=4.0)
    seen = expose(FLAT, camera).astype(float)
    n = seen.size
    # five standard errors of a mean and of a standard deviation; rounding adds 1/12 to the variance
    assert seen.mean() == pytest.approx(0.5 * 4095, abs=5 * 4.0 / np.sqrt(n))
    assert seen.var() == pytest.approx(16.0 + 1 / 12, rel=5 * np.sqrt(2 / n))


@pytest.mark.parametrize("level", [0.1, 0.5, 0.9])
def test_shot_noise_has_a_variance_proportional_to_the_light(level):
    wells = 10_000.0
    seen = expose(np.full((300, 400), level), Camera(full_well_electrons=wells)).astype(float)
    n = seen.size
    variance = level / wells  # of a Poisson count, over the well
    assert seen.mean() == pytest.approx(level, abs=5 * np.sqrt(variance / n))
    assert seen.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / n))


def test_blur_spreads_a_point_to_its_width_and_keeps_the_light():
    point = np.zeros((61, 61))
    point[30, 30] = 1.0
    seen = expose(point, Camera(blur_px=2.5)).astype(float)
    x = np.arange(61) - 30.0
    # float32 sums of thousands of pixels, and scipy's kernel cut at four widths
    assert seen.sum() == pytest.approx(1.0, abs=1e-5)
    assert (seen.sum(axis=0) * x**2).sum() == pytest.approx(2.5**2, rel=0.01)


def test_blur_comes_before_noise():
    # blurred noise would have lost most of its spread
    seen = expose(FLAT, Camera(blur_px=5.0, noise_grey=0.01)).astype(float)
    assert seen.std() == pytest.approx(0.01, rel=0.02)


def test_the_same_seed_gives_the_same_frame_and_another_seed_another():
    noisy = {"bit_depth": 8, "noise_grey": 2.0, "full_well_electrons": 5000.0}
    first = expose(FLAT, Camera(seed=7, **noisy))
    np.testing.assert_array_equal(first, expose(FLAT, Camera(seed=7, **noisy)))
    assert (first != expose(FLAT, Camera(seed=8, **noisy))).any()
    given_rng = expose(FLAT, Camera(seed=8, **noisy), rng=np.random.default_rng(7))
    np.testing.assert_array_equal(first, given_rng)


def test_a_camera_does_not_change_the_signal_it_is_given():
    signal = FLAT.copy()
    expose(signal, Camera(bit_depth=8, gamma=2.0, vignette=0.2, noise_grey=1.0, blur_px=1.0))
    np.testing.assert_array_equal(signal, FLAT)
