"""A share of a frame's light that is not sure: noise besides, which comes and goes as a whole."""

import numpy as np

from isochrome.estimation import prepare_frame
from isochrome.frames import Frame
from isochrome.scene import load_scene


def data():
    rng = np.random.default_rng(5)
    image = np.clip(rng.normal(120.0, 3.0, (40, 60)), 0, 255).astype(np.uint8)
    scene = load_scene("line-contact-wear").with_values({"frames.gamma": 1.0})
    return prepare_frame(Frame(0, image, None, "even"), scene, bit_depth=8)


def test_what_is_not_sure_is_noise_besides_and_leaves_no_trace():
    plain, share = data(), np.linspace(0.0, 1.0, 2400, dtype=np.float32).reshape(40, 60)
    less = plain.less_sure(share)
    truth = np.hypot(plain.sigma, share * plain.light)
    np.testing.assert_allclose(less.sigma, truth, rtol=1e-6)
    # single precision holds a hundredth of full light to 1e-3 beside all of it
    for again in (less.less_sure(None), less.less_sure(0.5 * share).less_sure(None)):
        assert again.bent is None
        np.testing.assert_allclose(again.sigma, plain.sigma, rtol=2e-3)
    louder = less.with_noise(2.0)
    np.testing.assert_allclose(louder.sigma, 2.0 * truth, rtol=1e-6)
    np.testing.assert_allclose(louder.less_sure(None).sigma, 2.0 * plain.sigma, rtol=2e-3)
    assert less.toned(2.0).bent is None and np.isfinite(less.toned(2.0).sigma).all()
