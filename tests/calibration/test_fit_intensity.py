"""The separable least squares: derivatives, coverage, goodness, wrong solutions."""

import numpy as np
import pytest

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import (
    evaluate_prepared,
    fit_intensity,
    polynomial_basis,
    prepare,
    several_starts,
)

ROWS, COLS = 120, 160
Y, X = np.mgrid[:ROWS, :COLS].astype(float)
TRUTH = np.array([0.045, 61.0, 0.03])
SCALE = np.array([1e-3, 2.0, 0.02])
NOISE = 3.0
LIGHT = polynomial_basis((ROWS, COLS), 2)
DARK = polynomial_basis((ROWS, COLS), 1)
MAPS = {"illumination": LIGHT, "background": DARK}


def response(params):
    slope, row, tilt = params
    return np.sin(np.pi * slope * (Y - row - tilt * (X - 80.0))) ** 2


def frame(rng=None):
    vignette = 1.0 - 0.15 * (((Y - 60) / 60) ** 2 + ((X - 80) / 80) ** 2)
    clean = 12.0 + 0.02 * X + 180.0 * vignette * response(TRUTH)
    return clean if rng is None else clean + rng.normal(0.0, NOISE, clean.shape)


def test_exact_data_give_the_truth():
    fit = fit_intensity(frame(), response, TRUTH * [1.03, 1.0, 1.3], scale=SCALE, **MAPS)
    np.testing.assert_allclose(fit.values, TRUTH, rtol=1e-7)
    assert fit.converged and fit.positive and fit.chi < 1e-4
    np.testing.assert_allclose(fit.background_map[:, 0], 12.0, rtol=1e-6)
    np.testing.assert_allclose(
        fit.illumination_map * fit.signal + fit.background_map, frame(), atol=1e-4
    )


@pytest.mark.long
def test_coverage_and_chi():
    rng = np.random.default_rng(7)
    pulls, chis = [], []
    for _ in range(80):
        fit = fit_intensity(
            frame(rng), response, TRUTH * [1.01, 1, 1], sigma=NOISE, scale=SCALE, **MAPS
        )
        pulls.append((fit.values - TRUTH) / fit.standard_uncertainty)
        chis.append(fit.chi)
    pulls = np.array(pulls)
    assert np.all((np.array(chis) > 0.95) & (np.array(chis) < 1.05))
    assert np.all(np.abs(pulls.mean(axis=0)) < 0.4)
    assert np.all((pulls.std(axis=0) > 0.8) & (pulls.std(axis=0) < 1.2))


def test_wrong_noise_is_carried_into_the_uncertainty():
    image = frame(np.random.default_rng(1))
    right = fit_intensity(image, response, TRUTH, sigma=NOISE, scale=SCALE, **MAPS)
    small = fit_intensity(image, response, TRUTH, sigma=NOISE / 4, scale=SCALE, **MAPS)
    assert small.chi == pytest.approx(4 * right.chi, rel=1e-6)
    np.testing.assert_allclose(small.standard_uncertainty, right.standard_uncertainty, rtol=0.05)


def test_a_wrong_solution_shows_in_chi():
    image = frame(np.random.default_rng(2))
    wrong = fit_intensity(image, response, TRUTH * [1.4, 1, 1], sigma=NOISE, scale=SCALE, **MAPS)
    assert wrong.chi > 1.5 or not wrong.positive
    problem = prepare(image, mask=None, sigma=NOISE, **MAPS)
    inverted = evaluate_prepared(problem, 1.0 - response(TRUTH))
    assert inverted.chi == np.inf and not inverted.positive
    assert evaluate_prepared(problem, response(TRUTH)).chi == pytest.approx(1, abs=0.03)


def test_several_starts_find_the_truth_and_name_the_others():
    image = frame(np.random.default_rng(3))
    starts = [[s, 60.0, 0.0] for s in np.geomspace(0.005, 0.2, 80)]
    found = several_starts(
        image, response, starts, sigma=NOISE, scale=[2e-3, 5.0, 0.05], refine=4,
        scan_pixels=5000, **MAPS
    )  # fmt: skip
    assert np.all(np.abs(found.best.values - TRUTH) < 4 * found.best.standard_uncertainty)
    assert all(m.chi > 1.5 for m in found.others)


def test_masked_and_non_finite_pixels_are_dropped():
    image = frame(np.random.default_rng(4))
    mask = np.ones(image.shape, bool)
    mask[:, :40] = False
    spoiled = image.copy()
    spoiled[:, :40], spoiled[50, 50] = 1e6, np.nan
    fit = fit_intensity(
        spoiled, response, TRUTH, mask=mask, sigma=np.full(image.shape, NOISE), scale=SCALE, **MAPS
    )
    assert np.all(np.abs(fit.values - TRUTH) < 5 * fit.standard_uncertainty)
    assert np.isnan(fit.residual[0, 0]) and np.isnan(fit.residual[50, 50])


def test_no_load_frame_as_illumination():
    bright = 50.0 + 30.0 * np.sin(X / 9.0)
    image = 5.0 + 3.0 * bright * response(TRUTH)
    stack = polynomial_basis(image.shape, 0, times=bright)
    fit = fit_intensity(image, response, TRUTH * [1.01, 1, 1], illumination=stack,
                        background=DARK, scale=SCALE)  # fmt: skip
    assert fit.illumination_coefficients[0] == pytest.approx(3.0, rel=1e-9)


def test_bad_arguments_are_refused():
    image = frame()
    with pytest.raises(InputError, match="own grid"):
        fit_intensity(image, response, TRUTH, illumination=LIGHT[:, 1:], background=DARK)
    with pytest.raises(InputError, match="sigma"):
        prepare(image, mask=None, sigma=0.0, **MAPS)
    with pytest.raises(InputError, match="not finite at the start"):
        fit_intensity(image, lambda p: np.full(image.shape, np.nan), TRUTH, **MAPS)
    mask = np.zeros(image.shape, bool)
    mask[0, :5] = True
    with pytest.raises(InputError, match="fewer than the unknowns"):
        fit_intensity(image, response, TRUTH, mask=mask, **MAPS)
    with pytest.raises(PhysicsError, match="positive illumination"):
        several_starts(200.0 - image, response, [TRUTH], sigma=NOISE, scale=SCALE, **MAPS)
