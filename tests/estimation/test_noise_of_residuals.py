"""What a residual tells of its noise: level, reach and lines, against noise that is known."""

import numpy as np
import pytest
from scipy.fft import dctn, idctn

from isochrome.estimation import (
    gradient_covariance,
    line_correlation,
    line_noise,
    local_correlation,
    local_noise,
)

SHAPE = 400, 480
KEEP = np.ones(SHAPE, bool)
ROWS, COLS = np.indices(SHAPE)


def noise(seed):
    return np.random.default_rng(seed).normal(size=SHAPE)


def compressed(image, kept=4):
    """Blocks of 8 x 8 without their finest parts, as a JPEG's."""
    blocks = image.reshape(SHAPE[0] // 8, 8, SHAPE[1] // 8, 8).transpose(0, 2, 1, 3)
    found = dctn(blocks, axes=(2, 3), norm="ortho")
    found[:, :, kept:] = found[:, :, :, kept:] = 0.0
    back = idctn(found, axes=(2, 3), norm="ortho").transpose(0, 2, 1, 3)
    return back.reshape(SHAPE)


def told(residual, picture=None):
    """The noise by a residual that expects half of it: less is told as what is expected."""
    picture = residual if picture is None else picture
    return 0.5 * local_noise(KEEP, 2.0 * residual.ravel(), 2.0 * picture.ravel())


# the variance of 750 blocks of 253 freedoms, the least of two: .3 % too small, +- .3 %; what is
# missed on a third of the picture is a plane over 16 pixels but for 3 % of the noise
LOCAL = 0.03


@pytest.mark.parametrize("period", [40.0, 80.0, 300.0])
def test_what_a_model_misses_is_no_noise(period):
    missed = 2.0 * np.sin(2.0 * np.pi * (ROWS + 0.5 * COLS) / period)
    residual = noise(1) + missed * (ROWS < 150)  # a third of the picture, chi = 1.3
    assert told(residual) == pytest.approx(1.0, rel=LOCAL)


def test_the_noise_of_a_compressed_picture_is_told_whole():
    residual = compressed(noise(2))
    # a plane takes 3 of the 64 parts that 16 x 16 pixels have left: 1.8 % of the deviation
    residual *= 2.0  # half of it is more than is expected
    assert told(residual, 3.0 * residual) == pytest.approx(np.std(residual), rel=LOCAL + 0.018)


def variance_of_sums(image, side=4):
    """Over that of as many independent pixels."""
    sums = image.reshape(SHAPE[0] // side, side, SHAPE[1] // side, side).sum(axis=(1, 3))
    return np.var(sums) / (side**2 * np.var(image))


@pytest.mark.parametrize("compress", [compressed, lambda image: image], ids=["JPEG", "whole"])
def test_how_far_a_noise_is_alike_is_told_beside_what_a_model_misses(compress):
    grain = compress(noise(6))
    missed = np.sin(2.0 * np.pi * (ROWS + 0.5 * COLS) / 80.0) * np.std(grain)
    found = local_correlation(KEEP, (grain + missed).ravel())
    # 750 medians of chi² of 13 freedoms, which are 5 % below their mean; what is missed has .5 of
    # the noise's variance, and .004 of it is no plane over 16 pixels: 16 times as much in the sums
    assert found == pytest.approx(max(1.0, variance_of_sums(grain)), rel=0.1)


def test_fringes_of_a_wrong_model_are_not_taken_for_noise():
    """Such a model leaves fringes everywhere; the picture itself is smooth over its blocks."""
    grain = noise(3)
    wrong = 20.0 * np.sin(2.0 * np.pi * COLS / 13.0)
    picture = 50.0 * np.sin(2.0 * np.pi * ROWS / 120.0)
    assert told(grain + wrong, grain + picture) == pytest.approx(1.0, rel=LOCAL)


def test_what_a_model_misses_of_dense_fringes_is_no_noise():
    """A scale that is a little off leaves fringes of 30 pixels everywhere, less than the noise."""
    missed = 0.8 * np.sin(2.0 * np.pi * (ROWS + COLS) / 30.0)
    picture = 20.0 * np.cos(2.0 * np.pi * (ROWS + COLS) / 30.0)
    found = local_noise(KEEP, (noise(10) + missed).ravel(), (noise(10) + picture).ravel())
    assert found == 1.0


def test_noise_as_expected_is_left_and_no_full_block_tells_nothing():
    assert local_noise(KEEP, noise(8).ravel(), noise(9).ravel()) == 1.0
    keep = np.zeros(SHAPE, bool)
    keep[::2] = True
    assert local_noise(keep, np.full(keep.sum(), 9.0), np.full(keep.sum(), 9.0)) == 1.0


@pytest.mark.parametrize("axis", [0, 1])
def test_lines_with_a_noise_of_their_own_are_told_and_widen_what_is_fitted(axis):
    own = np.random.default_rng(4).normal(0.0, 0.2, SHAPE[1 - axis])
    residual = noise(5) + (own[:, None] if axis else own)
    length, lines = SHAPE[axis], SHAPE[1 - axis]
    # a sum has the variance n + (n s)², over that of n independent pixels, n (1 + s²)
    expected = (1.0 + length * 0.04) / 1.04
    scatter = 4.0 * np.sqrt(2.0 / lines)
    for told_by, spread in ((line_noise, 1.3 * scatter), (line_correlation, scatter)):
        assert told_by(KEEP, residual.ravel(), axis) == pytest.approx(expected, rel=spread)
        assert told_by(KEEP, residual.ravel(), 1 - axis) < 1.4
    # of Σ r j with one j a line: the same many times the squares' sum, which lines weigh unevenly
    slopes = np.sin((ROWS if axis else COLS) / 40.0).ravel()
    ((variance,),) = gradient_covariance(slopes[None], residual.ravel(), KEEP)
    whole = (1.0 + length * 0.04) * np.sum(slopes**2)
    assert variance == pytest.approx(whole, rel=1.3 * scatter)


def test_what_changes_slowly_from_line_to_line_is_no_noise_of_theirs():
    slow = 0.3 * np.sin(2.0 * np.pi * ROWS / 150.0)
    assert line_noise(KEEP, (noise(6) + slow).ravel(), 1) < 1.3  # chance: 1 +- .09
    assert line_correlation(KEEP, (noise(6) + slow).ravel(), 1) > 10.0


@pytest.mark.long
@pytest.mark.parametrize("kind", ["rows", "compressed", "pixels"])
def test_the_gradients_covariance_is_that_of_many_draws(kind):
    """Its promise: the variance of Σ r j over draws of the noise, whatever neighbours share."""
    slopes = np.stack([np.sin(ROWS / 40.0).ravel(), np.cos(COLS / 70.0).ravel()])
    found, stated = [], []
    for seed in range(100):
        residual = noise(100 + seed)
        if kind == "rows":
            own = np.random.default_rng(900 + seed).normal(0.0, 0.2, SHAPE[0])
            residual = residual + own[:, None]
        elif kind == "compressed":
            residual = compressed(residual)
        found.append(slopes @ residual.ravel())
        stated.append(np.diag(gradient_covariance(slopes, residual.ravel(), KEEP)))
    ratio = np.mean(stated, axis=0) / np.var(found, axis=0)
    # 100 draws: 14 %, thrice; blocks that do not lie as the compressed ones: up to 30 % more
    assert np.all(ratio > 0.6) and np.all(ratio < 1.8)
