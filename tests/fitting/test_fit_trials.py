"""Fits to few pixels, by which sets are told apart: their evidence in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from benchmarks.outside_camera import Defects, _band, _sampled
from fitting.engine_frames import prepared
from fitting.sliding_bench import bench
from isochrome.fitting.causes.trial import Trial
from isochrome.fitting.frame.renderer import SceneRenderer
from isochrome.stress import pixel_grid


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


def test_a_block_that_the_surface_cuts_has_the_specimens_share_of_the_light():
    """In a rolled picture, against the means of another camera's samples, aside of the contact."""
    rolled, side, shape = Defects(roll_deg=8.0), 9, (81, 162)
    scene = bench(*shape)
    signal = _band(*_sampled(scene, rolled, -1), rolled)
    pixel = len(signal) // shape[0]
    # blocks are about pixels 0, 9, ..: the first are not whole
    first = pixel * (side - side // 2)
    whole = signal[first : first + 8 * side * pixel, first : first + 17 * side * pixel]
    want = whole.reshape(8, side * pixel, 17, -1).mean(axis=(1, 3))
    seen = scene.with_values({"camera.roll_deg": 8.0})
    got = SceneRenderer(seen, shape, stride=side, side=side).signal(seen)[1:, 1:]
    aside = np.abs(pixel_grid(scene).x_mm[side::side]) > 1.2  # a block is a whole fringe nearer
    error = np.abs(got - want)[:, aside]
    # the order of a block that is cut is that of its middle, which may lie above the surface
    assert error.max() < 0.2
