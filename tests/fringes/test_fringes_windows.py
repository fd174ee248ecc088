"""Gaussian windows beside scipy's filters, and beside what they make of a wave."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from isochrome.fringes.windows import gaussian, gaussian_mean


@pytest.mark.parametrize("shape", [(40, 57), (5, 7)])
@pytest.mark.parametrize("width", [0.7, 3.0])
@pytest.mark.parametrize("order", [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
def test_smoothing_and_its_derivatives_are_scipys(shape, width, order):
    """To rounding, also in a picture that is smaller than the window."""
    image = np.random.default_rng(3).normal(size=shape)
    for reach in (4.0, 6.0):
        wanted = gaussian_filter(image, width, order=order, truncate=reach)
        np.testing.assert_allclose(gaussian(image, width, order, reach=reach), wanted, atol=1e-13)


@pytest.mark.parametrize("width", [1.5, 8.0, 31.0])
def test_a_wide_mean_damps_a_wave_and_goes_on_beyond_the_rim(width):
    """A wave of w a pixel by exp(-w² s²/2); four deviations away e^-8 of the window is left."""
    row, col = np.indices((260, 301))
    wave = np.cos(0.5 / width * col + 0.2 / width * row)
    mean = gaussian_mean(wave, width)
    inner = (slice(125, -125), slice(125, -125))
    assert np.abs(mean - np.exp(-0.5 * (0.5**2 + 0.2**2)) * wave)[inner].max() < np.exp(-8.0)
    rim = gaussian_filter(wave, width, mode="nearest", truncate=8.0)
    assert np.abs(mean - rim).max() < 2.0 * np.exp(-8.0)
    np.testing.assert_allclose(gaussian_mean(np.full((40, 57), 0.3), width), 0.3, rtol=1e-12)
