"""Gaussian windows beside scipy's filters, and beside what they make of a wave."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from isochrome.fringes.windows import gaussian


@pytest.mark.parametrize("shape", [(40, 57), (5, 7)])
@pytest.mark.parametrize("width", [0.7, 3.0])
@pytest.mark.parametrize("order", [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
def test_smoothing_and_its_derivatives_are_scipys(shape, width, order):
    """To rounding, also in a picture that is smaller than the window."""
    image = np.random.default_rng(3).normal(size=shape)
    for reach in (4.0, 6.0):
        wanted = gaussian_filter(image, width, order=order, truncate=reach)
        np.testing.assert_allclose(gaussian(image, width, order, reach=reach), wanted, atol=1e-13)
