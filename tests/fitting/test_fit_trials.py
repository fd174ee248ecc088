"""Fits to few pixels, by which sets are told apart: their evidence in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fitting.engine_frames import prepared
from fitting.sliding_bench import bench
from isochrome.fitting.causes.trial import Trial


def trial_of(columns, residual, weight, extra):
    """The trial that a linear model's most probable values make."""
    normal = columns @ columns.T
    values = np.linalg.solve(normal + np.diag(weight), columns @ residual)
    left = residual - values @ columns
    return Trial(
        cost=float(left @ left), normal=normal, prior=float(values**2 @ weight), weight=weight,
        extra=extra, light=np.zeros((0, 0)), light_weight=np.zeros(0), excess=1.0, values={},
    )  # fmt: skip


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_the_difference_of_two_trials_is_that_of_their_marginal_likelihoods(noise):
    """Of linear models Laplace's method is exact: with and without two unknowns more."""
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(3, 60))
    residual = rng.normal(size=60) + 0.4 * columns[1]
    weight = np.array([1.0, 4.0, 0.25])  # the first, which both have, falls out of the difference
    want = 0.0
    for chosen, sign in (([0, 1, 2], 1.0), ([0], -1.0)):
        spread = noise * np.eye(60)
        for k in chosen:
            spread = spread + np.outer(columns[k], columns[k]) / weight[k]
        want += sign * multivariate_normal(np.zeros(60), spread).logpdf(residual)
    # the values come to rest at the noise that the evidence is taken at
    columns, residual = columns / noise**0.5, residual / noise**0.5
    both = trial_of(columns, residual, weight, np.array([False, True, True]))
    one = trial_of(columns[:1], residual, weight[:1], np.array([False]))
    assert both.evidence(1.0) - one.evidence(1.0) == pytest.approx(want, abs=1e-5)


def test_means_over_blocks_are_those_of_whole_blocks():
    rng = np.random.default_rng(3)
    data = prepared(rng.integers(20, 230, (20, 26), dtype=np.uint8), bench(20, 26), bit_depth=8)
    valid = np.ones(data.shape, dtype=bool)
    valid[10, 13] = False
    blocks = replace(data, valid=valid).in_blocks(3)
    want = data.raw[5:8, 8:11]
    assert blocks.raw[2, 3] == pytest.approx(want.mean(), rel=1e-6)
    noise = np.sqrt(np.square(data.raw_sigma[5:8, 8:11]).mean() / 9.0)
    assert blocks.raw_sigma[2, 3] == pytest.approx(noise, rel=1e-6)
    # about pixels 0, 3, ..: the first reach beyond the picture, one has a pixel that is not valid
    whole = np.ones((7, 9), dtype=bool)
    whole[0], whole[:, 0], whole[3, 4] = False, False, False
    assert (blocks.valid == whole).all()
