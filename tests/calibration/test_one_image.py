"""One image's own fit: truth, coverage, goodness, wrong solutions, starts, light."""

from dataclasses import replace

import numpy as np
import pytest

from isochrome.calibration.four_point_bending import BeamView, beam_kind, beam_order
from isochrome.calibration.whole_set import SetModel, best_first

from .conftest import as_shots

SHAPE = (120, 160)
TRUTH = np.array([0.045, 61.0, 0.03])
NOISE = 3.0


def places(shape):
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    return y, x - 0.5 * (shape[1] - 1)


def signal(shape=SHAPE, truth=TRUTH):
    """The mean over each pixel's area: Bracewell (2000), The Fourier transform, chapter 4."""
    contrast = np.sinc(truth[0]) * np.sinc(truth[0] * truth[2])
    return 0.5 - 0.5 * contrast * np.cos(2.0 * np.pi * beam_order(truth, *places(shape)))


def frame(rng=None):
    y, x = places(SHAPE)
    vignette = 1.0 - 0.15 * ((y / 60 - 1.0) ** 2 + (x / 80) ** 2)
    clean = 12.0 + 0.02 * x + 180.0 * vignette * signal()
    return clean if rng is None else clean + rng.normal(0.0, NOISE, SHAPE)


def model(image, sigma=NOISE, **changes):
    (shot,) = as_shots([image], [1.0], sigma=sigma)
    shape, view = image.shape, BeamView(float(len(image)), 0.0, 0.0, np.zeros((0, 3)))
    rows, cols = (np.arange(n) for n in shape)
    return SetModel(
        kind=beam_kind(view, shape[1]), shots=[replace(shot, **changes)], rows=rows, cols=cols,
        masks=shot.valid[None],
    )  # fmt: skip


def spread(fit):
    return np.sqrt(np.diag(fit.covariance))


def test_exact_data_give_the_truth():
    fit = model(frame()).fit(TRUTH * [1.03, 1.0, 1.3])
    np.testing.assert_allclose(fit.values, TRUTH, rtol=1e-4)
    assert fit.converged and fit.point.positive and fit.chi < 0.03


@pytest.mark.long
def test_coverage_and_chi():
    rng = np.random.default_rng(7)
    fits = [model(frame(rng)).fit(TRUTH * [1.01, 1, 1]) for _ in range(80)]
    pulls = np.array([(fit.values - TRUTH) / spread(fit) for fit in fits])
    chis = np.array([fit.chi for fit in fits])
    assert np.all((chis > 0.95) & (chis < 1.05))
    assert np.all(np.abs(pulls.mean(axis=0)) < 0.4)
    assert np.all((pulls.std(axis=0) > 0.8) & (pulls.std(axis=0) < 1.2))


def test_wrong_noise_is_carried_into_the_uncertainty():
    image = frame(np.random.default_rng(1))
    right, small = (model(image, sigma).fit(TRUTH) for sigma in (NOISE, NOISE / 4))
    assert small.chi == pytest.approx(4 * right.chi, rel=1e-3)
    np.testing.assert_allclose(spread(small), spread(right), rtol=0.05)


def test_a_wrong_solution_shows_in_chi():
    image = frame(np.random.default_rng(2))
    wrong = model(image).fit(TRUTH * [1.4, 1, 1])
    assert wrong.chi > 1.5 or not wrong.point.positive
    inverted = model(image, bright=True).at(TRUTH)
    assert not inverted.positive
    assert model(image).fit(TRUTH).chi == pytest.approx(1, abs=0.03)


def test_several_starts_find_the_truth_and_name_the_others():
    image = frame(np.random.default_rng(3))
    starts = [np.array([s, 60.0, 0.0]) for s in (0.02, 0.044, 0.06)]
    best, *others = best_first(model(image).fit(start) for start in starts)
    assert np.all(np.abs(best.values - TRUTH) < 4 * spread(best))
    assert not others  # by over a third no finer light makes up for a wrong slope
    assert not best_first([model(200.0 - image).fit(TRUTH)])


def test_masked_and_non_finite_pixels_are_dropped():
    spoiled = frame(np.random.default_rng(4))
    spoiled[:, :40], spoiled[50, 50] = 1e6, np.nan
    whole = model(spoiled)
    whole.masks[:, :, :40] = False
    fit = whole.fit(TRUTH)
    assert np.all(np.abs(fit.values - TRUTH) < 5 * spread(fit))
    assert fit.point.pixels == 120 * 120 - 1


def test_no_load_frames_take_the_lights_form():
    lamp = 50.0 + 30.0 * np.sin(places(SHAPE)[1] / 9.0)
    fit = model(5.0 + 3.0 * lamp * signal(), no_load_light=lamp).fit(TRUTH * [1.01, 1, 1])
    assert fit.point.solved[0][0, 0] == pytest.approx(3.0, rel=1e-4)
    assert fit.chi < 0.1


@pytest.mark.long
def test_few_pixels_are_less_than_their_number_by_what_was_fitted_to_them():
    shape, truth = (5, 6), np.array([0.08, 1.7, 0.02])
    rng, chis = np.random.default_rng(4), []
    for _ in range(100):
        image = 12.0 + 180.0 * signal(shape, truth) + rng.normal(0.0, NOISE, shape)
        chis.append(model(image).fit(truth).chi)
    # 30 pixels, three parameters, nine of the light: 18 are left. chi² of 100 scatters by 3 %
    assert np.mean(np.square(chis)) == pytest.approx(1.0, abs=0.1)
