"""The camera: exact where ideal, and each imperfection with the statistics that it names."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isochrome.optics import blurred, expose
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
    # float32 sums of thousands of pixels, and a kernel that is cut
    assert seen.sum() == pytest.approx(1.0, abs=1e-5)
    assert (seen.sum(axis=0) * x**2).sum() == pytest.approx(2.5**2, rel=0.01)


@pytest.mark.parametrize("sigma_px", [0.05, 0.2, 0.4, 0.7, 1.5, 6.0])
def test_a_wave_through_a_blur_keeps_what_a_gaussian_leaves_of_it(sigma_px):
    """exp(-s² w²/2), of a blur that is narrower than a pixel too; a kernel of the Gaussian's own
    values at whole pixels errs by 2 to 7 % at 0.4 px.
    """
    down = np.arange(400)[:, None] + np.zeros(21)
    for period_px in (40.0, 10.0, 5.0):
        wave = np.cos(2.0 * np.pi * down / period_px)
        left = np.exp(-2.0 * (np.pi * sigma_px / period_px) ** 2)
        seen = blurred(wave, sigma_px)[100:300]
        np.testing.assert_allclose(seen, left * wave[100:300], atol=2e-4)  # its series and reach


def test_a_rim_goes_on_through_a_blur_and_no_blur_changes_nothing():
    image = np.full((30, 40, 3), [0.2, 0.5, 0.9])
    np.testing.assert_allclose(blurred(image, 3.0), image, rtol=1e-6)
    assert blurred(image, 0.0) is image


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


@given(bits=st.integers(1, 16), shape=st.sampled_from([(7, 9), (7, 9, 3)]))
def test_every_depth_saturates_and_blackens_at_its_ends(bits, shape):
    """Light from -1 to 2: what is over full scale is full, what is under nothing is nothing."""
    light = np.linspace(-1.0, 2.0, int(np.prod(shape))).reshape(shape)
    seen = expose(light, Camera(bit_depth=bits, noise_grey=0.1))
    full = 2**bits - 1
    assert seen.shape == shape and seen.dtype == (np.uint8 if bits <= 8 else np.uint16)
    # noise of a tenth of a level: five of them are half a level at most
    np.testing.assert_array_equal(seen[light > 1.0 + 1.0 / full], full)
    np.testing.assert_array_equal(seen[light < -1.0 / full], 0)


@pytest.mark.parametrize("bits", [1, 4, 8, 10])
def test_single_precision_gives_the_grey_levels_of_double(bits):
    """A level may differ only where the light stands on the edge between two, to 1e-7."""
    light = np.random.default_rng(0).uniform(0.0, 1.0, (300, 400)).astype(np.float32)
    full = 2**bits - 1
    single = expose(light, Camera(bit_depth=bits)).astype(float)
    exact = light.astype(float) * full
    # half a level, and a rounding of single precision at full scale
    assert np.abs(single - exact).max() <= 0.5 + 1.2e-7 * full


def test_shot_and_read_noise_add_in_variance_and_gamma_stretches_the_shot_noise():
    wells, read, bits, gamma, level = 20_000.0, 3.0, 12, 2.0, 0.36
    camera = Camera(
        bit_depth=bits, full_well_electrons=wells, noise_grey=read, gamma=gamma, seed=11
    )
    seen = expose(np.full((400, 500), level), camera).astype(float)
    full = 2**bits - 1
    # sigma of L^(1/gamma) is L^(1/gamma - 1)/gamma sigma of L; read noise after it; rounding 1/12
    slope = level ** (1 / gamma - 1) / gamma
    variance = (slope * full) ** 2 * level / wells + read**2 + 1 / 12
    # five standard errors of a variance, and the curve's second order, level/wells/level² = 1e-4
    assert seen.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / seen.size) + 5e-4)


def test_noise_is_independent_in_every_pixel_and_channel():
    camera = Camera(noise_grey=0.02, full_well_electrons=4000.0, seed=5)
    seen = expose(np.full((200, 300, 3), 0.5), camera).astype(float) - 0.5
    variance = 0.02**2 + 0.5 / 4000.0
    n = seen[..., 0].size
    cross = np.cov(seen.reshape(-1, 3).T)
    # five standard errors of variances and covariances
    np.testing.assert_allclose(np.diag(cross), variance, rtol=5 * np.sqrt(2 / n))
    np.testing.assert_allclose(cross - np.diag(np.diag(cross)), 0, atol=5 * variance / np.sqrt(n))
    beside = (seen[:, 1:] * seen[:, :-1]).mean()
    assert abs(beside) < 5 * variance / np.sqrt(seen.size)


def test_the_channels_of_a_frame_do_not_mix():
    """Each channel of a colour frame is what a grey camera makes of it: blur, vignette and all."""
    light = np.random.default_rng(2).uniform(0.0, 1.0, (31, 42, 3))
    camera = Camera(
        bit_depth=12, blur_px=1.5, vignette=0.3, gamma=1.8, background=0.03, brightness=0.9
    )
    seen = expose(light, camera)
    assert seen.shape == light.shape and seen.dtype == np.uint16
    for channel in range(3):
        np.testing.assert_array_equal(seen[..., channel], expose(light[..., channel], camera))
