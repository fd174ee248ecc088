"""The light's images span what they are to: frames are written as sums of them exactly."""

import numpy as np
import pytest

from isochrome.estimation import degrees_of, evaluate_prepared, frame_light, prepare, smooth_light

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
    found = evaluate_prepared(prepare(image, mask=None, sigma=1.0, **model.bases), SIGNAL)
    # single precision: images of order one are known to some 1e-7, over the square root of nothing
    assert found.chi < 1e-6
    assert found.positive
    given = len(found.illumination_coefficients) + len(found.background_coefficients)
    assert given == model.unknowns


@pytest.mark.parametrize("light", [None, BRIGHT - DARK])
def test_a_calibrations_light_has_more_unknowns_degree_by_degree(light):
    few, many = (smooth_light(SHAPE, degrees, light) for degrees in degrees_of(light))
    assert few.unknowns < many.unknowns
    image = PLANE * (1.0 if light is None else light) * SIGNAL + 0.05 * PLANE
    for model in (few, many):
        assert (
            evaluate_prepared(prepare(image, mask=None, sigma=1.0, **model.bases), SIGNAL).chi
            < 1e-12
        )


def test_one_amplitude_is_the_even_part_alone():
    plain = frame_light(SHAPE).plain()
    assert plain.illumination.shape == (1, *SHAPE)
    assert np.ptp(plain.illumination) == 0.0
