"""One preparation: what a frame's light, noise and valid pixels are, against what made it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from isochrome.estimation import observe

SHAPE = (120, 160)
X = np.arange(SHAPE[1]) * np.ones((SHAPE[0], 1))
FRINGES = 40.0 + 150.0 * np.sin(np.pi * X / 40.0) ** 2


def noisy(seed, spread=3.0):
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(FRINGES + rng.normal(0.0, spread, SHAPE)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_light_and_noise_are_those_that_made_the_frame(gamma):
    seen = observe(noisy(1), name="a", bit_depth=8, gamma=gamma)
    np.testing.assert_allclose(seen.light, (noisy(1) / 255.0) ** gamma, rtol=1e-5, atol=1e-7)
    assert seen.valid.all()
    # rounding adds 1/12; the estimate is known to some 3 % (see tests/frames/test_frames_noise.py)
    wanted = np.sqrt(9.0 + 1.0 / 12.0) / 255.0
    assert np.median(seen.raw_sigma) == pytest.approx(wanted, rel=0.06)
    slope = gamma * (FRINGES / 255.0) ** (gamma - 1.0)
    assert np.median(seen.sigma / slope) == pytest.approx(wanted, rel=0.06)


def test_a_pixels_weight_hardly_follows_its_own_noise():
    """With gamma 2.2 noise grows with the level; a Gaussian mean holds a fourteenth of its own."""
    own = np.random.default_rng(2).normal(0.0, 3.0, SHAPE)
    seen = observe(np.rint(FRINGES + own).astype(np.uint8), name="a", bit_depth=8, gamma=2.2)
    level = gaussian_filter(FRINGES, 1.5)
    away = np.log(seen.sigma / level**1.2)
    slope = float(((away - away.mean()) * level * own).sum() / (own * own).sum())
    # d ln sigma = (gamma - 1) d ln level, of which 1/(2 pi 1.5²) is the pixel's own; what the
    # others add, 0.7 as a standard deviation, leaves 0.7/3/sqrt(19200) = 0.0017, 2 % of it
    assert slope == pytest.approx(1.2 / (2.0 * np.pi * 1.5**2), rel=0.15)


def test_what_is_masked_or_not_finite_is_not_valid():
    image = noisy(3).astype(float)
    image[5, 7] = np.nan
    mask = np.ones(SHAPE, bool)
    mask[:10] = False
    mask[5] = True
    seen = observe(image, name="a", bit_depth=8, gamma=1.0, mask=mask)
    assert not seen.valid[0].any() and seen.valid[20:].all()
    assert not seen.valid[5, 7] and np.isfinite(seen.light).all()
