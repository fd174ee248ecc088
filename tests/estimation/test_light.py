"""The light's images span what they are to: frames are written as sums of them exactly."""

import numpy as np
import pytest

from isochrome.estimation import frame_light, prepare, solve_linear

SHAPE = (40, 60)
Y, X = (np.linspace(-1.0, 1.0, n) for n in SHAPE)
Y = Y[:, None]
RNG = np.random.default_rng(4)
DARK = 0.1 + 0.01 * RNG.random(SHAPE)
BRIGHT = 0.8 + 0.1 * RNG.random(SHAPE)
SIGNAL = RNG.random(SHAPE)
PLANE = 1.0 + 0.1 * X - 0.2 * Y


@pytest.mark.parametrize(
    ("dark", "bright", "image"),
    [
        (DARK, BRIGHT, PLANE * (BRIGHT - DARK) * SIGNAL + 0.9 * DARK + 0.02),
        (None, BRIGHT, PLANE * BRIGHT * SIGNAL + 0.05 * PLANE),
        (DARK, None, (PLANE - 0.3 * X * X) * SIGNAL + DARK + 0.02),
        (None, None, (PLANE - 0.3 * X * Y) * SIGNAL + 0.02),
    ],
)
def test_a_frames_light_is_a_sum_of_the_models_images(dark, bright, image):
    model = frame_light(SHAPE, dark, bright)
    problem = prepare(image, mask=None, sigma=1.0, **model.bases)
    found = solve_linear(problem, SIGNAL.ravel())
    # single precision: images of order one are known to some 1e-7, over the square root of nothing
    assert np.sqrt(found.cost / problem.size) < 1e-6
    assert found.positive
    assert len(found.coefficients) == model.unknowns


def test_one_amplitude_is_the_even_part_alone():
    plain = frame_light(SHAPE).plain()
    assert plain.illumination.shape == (1, *SHAPE)
    assert np.ptp(plain.illumination) == 0.0
