"""Covariances against what repeated noise does, and against closed forms."""

import numpy as np
import pytest

from isochrome.estimation import (
    block_correlation,
    is_determined,
    jackknife_variance,
    standard_uncertainty,
    white_covariance,
)

X = np.linspace(-1.0, 1.0, 1600)
ROWS = np.stack([np.ones_like(X), X])
INVERSE = np.linalg.inv(ROWS @ ROWS.T)
KEEP = np.ones((1, X.size), bool)
"""One row of pixels has no blocks, and nothing to widen."""
SETS = 2000


def estimates(sigma, rng):
    """Values of a straight line (sets, 2) from noise with the standard deviations `sigma`."""
    noise = rng.normal(0.0, 1.0, (SETS, X.size)) * sigma
    return noise, noise @ ROWS.T @ INVERSE


def test_white_is_right_where_the_variances_are_unequal():
    """Weights of one, noise that grows to the ends: the usual covariance is off by half."""
    sigma = 0.2 + 2.0 * X**2
    noise, values = estimates(sigma, np.random.default_rng(5))
    truth = values.var(axis=0)
    found = [
        np.diag(white_covariance(INVERSE, ROWS, r - v @ ROWS, KEEP, linear=0))
        for r, v in zip(noise[:200], values[:200], strict=True)
    ]
    # 2000 sets tell a variance to sqrt(2/2000) = 3 %: three times that
    np.testing.assert_allclose(np.mean(found, axis=0), truth, rtol=0.1)
    usual = np.diag(INVERSE) * np.mean(sigma**2)
    assert truth[1] > 1.5 * usual[1]


def test_white_is_the_usual_covariance_where_the_variances_are_equal():
    rng = np.random.default_rng(6)
    noise, values = estimates(np.full(X.size, 0.7), rng)
    residual = noise[0] - values[0] @ ROWS
    found = white_covariance(INVERSE, ROWS, residual, KEEP, linear=0)
    # a variance from 1600 residuals is known to sqrt(2/1600) = 3.5 %, a slope's a little less well
    np.testing.assert_allclose(np.diag(found), 0.49 * np.diag(INVERSE), rtol=0.15)


def test_few_pixels_are_less_than_their_number_by_what_was_fitted():
    few, residual = ROWS[:, ::400], np.array([1.0, -1.0, 1.0, -1.0])
    keep = np.ones((1, 4), bool)
    both = [white_covariance(INVERSE, few, residual, keep, linear=k) for k in (0, 1)]
    np.testing.assert_allclose(both[1], 2.0 * both[0])  # 4/(4 - 2) and 4/(4 - 3)


@pytest.mark.parametrize("side", [1, 2, 4, 8])
def test_blocks_show_noise_that_neighbours_share(side):
    """Squares of one value within blocks: their sums have side² times the variance."""
    rng = np.random.default_rng(7)
    noise = np.kron(rng.normal(0.0, 1.0, (400 // side, 400 // side)), np.ones((side, side)))
    found = block_correlation(np.ones((400, 400), bool), noise.ravel())
    # of 2500 squares at least, sqrt(2/2500) = 2.8 %
    assert found == pytest.approx(side**2, rel=0.08)


def test_noise_that_cancels_between_neighbours_makes_nothing_more_certain():
    board = np.where(np.add.outer(np.arange(8), np.arange(8)) % 2, 1.0, -1.0)
    assert block_correlation(np.ones((8, 8), bool), board.ravel()) == 1.0


def test_the_jackknife_of_a_mean_is_its_variance_over_the_number():
    """Leaving one value out of B in a mean gives s²/B exactly (Quenouille)."""
    values = np.random.default_rng(8).normal(0.0, 3.0, 20)
    without = (values.sum() - values) / 19
    assert jackknife_variance(without) == pytest.approx(values.var(ddof=1) / 20, rel=1e-12)


def test_an_unknown_that_changes_nothing_is_not_determined():
    information = np.array([[4.0, 0.0], [0.0, 1e-12]])
    told = is_determined(information, np.array([5.0, 1.0]))
    assert told.tolist() == [True, False]
    bound = standard_uncertainty(np.diag([0.25, 1e12]), told)
    assert bound.tolist() == [0.5, np.inf]
    spread = standard_uncertainty(np.diag([0.49, 1e12]), told)
    assert spread.tolist() == [0.7, np.inf]
