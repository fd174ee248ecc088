"""Regions mirrored about a crest: turned back where the light tells, given up where it does not."""

import numpy as np
import pytest
from plain_frames import COLS, ROWS, SHAPE, light, read_free

from isochrome.fringes.single_frame.patches import (
    Labels,
    Patches,
    fit_patches,
    gather_patches,
    mend_mirrored,
    open_seams,
    zero_lines,
)

VALUE, SLOPE = 0.01, 0.003
"""What noise leaves of a patch's order, fringes, and of its slope, fringes a pixel."""
START = ((0, 0), None)
"""The patch in which the order is taken as known."""


def true_labels(order: np.ndarray, noise: float) -> tuple[Patches, Labels, np.ndarray]:
    """Patches of an order's light with the signs and whole numbers of the truth, and the truth."""
    frame = light(order, noise)
    patches = fit_patches(gather_patches(*frame))
    at = np.ix_(patches.rows, patches.cols)
    down, right = np.gradient(order)
    misfits, shifts = [], []
    for sign in (1, -1):
        away = order[at] - sign * patches.terms[..., 0]
        shifts.append(np.round(away))
        slopes = right[at] - sign * patches.terms[..., 1], down[at] - sign * patches.terms[..., 2]
        misfits.append(np.hypot(*slopes) / SLOPE + np.abs(away - shifts[-1]) / VALUE)
    same = misfits[0] < misfits[1]
    sign = np.where(same, 1, -1).astype(np.int8)
    shift = np.where(same, *shifts)
    return patches, Labels(sign, shift, np.zeros(sign.shape, dtype=int)), order[at]


def terms_of(patches: Patches, labels: Labels) -> np.ndarray:
    terms = labels.sign[..., None] * patches.terms
    terms[..., 0] += labels.shift
    return terms


def valley(lowest: float, bend: float, tilt: float = 4e-4) -> np.ndarray:
    """An order that falls to a line along the middle row and rises again beyond it."""
    return lowest + bend * (ROWS - 80.0) ** 2 + tilt * (COLS - 110.0)


@pytest.mark.parametrize("lowest", [0.6, 0.75, 0.82])
@pytest.mark.parametrize("noise", [0.03, 0.06])
def test_a_region_turned_over_by_hand_is_turned_back(lowest, noise):
    """All of the lower part beyond the order's second crossing of 1."""
    patches, labels, truth = true_labels(valley(lowest, 1e-4), noise)
    beyond = (truth > 1.0) & (patches.rows > 80)[:, None]
    assert beyond.any()
    turned = Labels(
        np.where(beyond, -labels.sign, labels.sign),
        np.where(beyond, 2.0 - labels.shift, labels.shift),
        labels.part,
    )
    found = terms_of(patches, mend_mirrored(patches, turned))[..., 0]
    # on the crest itself a patch and its mirror image are one
    clear = np.abs(truth - 1.0) > 0.05
    right = [np.mean(np.abs(whole - truth)[clear] < 0.05) for whole in (found, 2.0 - found)]
    # far more was turned over; a lone patch is off by itself here and there, without a guide
    assert beyond.mean() > 0.06 and max(right) > 0.97


@pytest.mark.parametrize("lowest", [0.6, 0.82, 1.25])
def test_labels_that_are_right_are_left_and_sure(lowest):
    patches, labels, truth = true_labels(valley(lowest, 1e-4), 0.05)
    mended = mend_mirrored(patches, labels)
    clear = np.abs(truth - np.round(2.0 * truth) / 2.0) > 0.05
    np.testing.assert_array_equal(mended.sign[clear], labels.sign[clear])
    np.testing.assert_array_equal(mended.shift[clear], labels.shift[clear])
    assert not open_seams(patches, terms_of(patches, labels), [START], [])


def test_beyond_a_flat_valley_along_a_crest_nothing_is_sure():
    """N touches 1 and no more: mirroring what lies beyond changes the light nowhere.
    n = 1 + b y |y| has the light of 1 + b y², and its gradient is as continuous."""
    order = valley(1.0, 6e-5, tilt=0.0)
    patches, labels, _ = true_labels(order, 0.13)
    ((crest, unsure),) = open_seams(patches, terms_of(patches, labels), [START], [])
    assert crest == 2
    above, below = patches.rows < 40, patches.rows > 120
    assert unsure[below].all() and not unsure[above].any()


def test_mirroring_about_nought_or_unknown_patches_are_no_doubt():
    """The same flat valley at N = 0, which may be passed through or not: |n| is the order."""
    order = valley(0.0, 6e-5, tilt=0.0)
    patches, labels, _ = true_labels(order, 0.13)
    assert not open_seams(patches, terms_of(patches, labels), [START], [])
    patches, labels, _ = true_labels(valley(0.6, 1e-4), 0.1)
    nothing = np.full_like(terms_of(patches, labels), np.nan)
    assert not open_seams(patches, nothing, [], [])


def test_a_corner_that_lies_just_beyond_a_crest_is_right_or_not_known():
    """N passes 0.5 and falls to 0.44 in the corner, as deep below a contact."""
    order = 0.8 - 1.15e-3 * ROWS - 8e-4 * COLS
    assert order[-1, -1] < 0.45
    for noise in (0.03, 0.06):
        got = read_free(*light(order, noise), [(5, 5, float(order[5, 5]))]).reading.order
        assert np.isfinite(got).mean() > 0.8 and not (np.abs(got - order) > 0.05).any()


def waves(*nodes: int) -> np.ndarray:
    """A signed order of patches that is 0 along some columns, of 40."""
    cols = np.arange(40.0)
    signs = np.prod([np.sign(cols - node + 0.5) for node in nodes], axis=0)
    away = np.min([np.abs(cols - node + 0.5) for node in nodes], axis=0)
    return np.tile(signs * 0.05 * away, (20, 1))


def test_each_line_of_nought_must_be_known_by_itself():
    order = waves(10, 25)
    assert zero_lines(order) == 2
    on_first, across_second, across_both = ((5, 10),), ((5, 18), (5, 33)), ((5, 3), (5, 33))
    assert zero_lines(order, [on_first]) == zero_lines(order, [across_second]) == 1
    assert zero_lines(order, [on_first, across_second]) == 0
    assert zero_lines(order, [across_both]) == 2 and zero_lines(np.abs(order)) == 0
    assert zero_lines(waves(20), [((5, 10),)]) == 1
    # noise puts some beyond it, as about an isotropic point
    order = np.full((20, 40), 0.3)
    order[8, 8:12] = -0.2
    assert zero_lines(order) == 0


def test_a_stated_noise_that_is_far_too_large_leaves_the_uncertainty_honest():
    """The noise of a frame has a floor for dust and compression; what patches leave tells less.
    With the floor alone the errors were a third of their uncertainty. Below it is 0.001 fringe that
    is kept for what a quadratic cannot follow."""
    order = 0.8 + 6e-5 * (ROWS - 80.0) ** 2 + 4e-3 * COLS
    wave, _, valid = light(order, 0.06)
    for stated in (0.06, 0.18):
        sigma = np.full(SHAPE, stated)
        got = read_free(wave, sigma, valid, [(80, 110, float(order[80, 110]))]).reading
        pulls = (got.order - order) / got.uncertainty
        assert 0.6 < np.sqrt(np.nanmean(pulls**2)) < 1.2


@pytest.mark.parametrize(("stated", "side"), [(1.1, 1.0), (0.9, -1.0)])
def test_a_point_beyond_a_flat_valley_says_the_side_though_it_roughly_fits_the_other(stated, side):
    """At row 120 N is 1.10 or 0.90: less apart than a rough estimate may be off."""
    order = valley(1.0, 6e-5, tilt=0.0)
    above = [(row, 110, float(order[row, 110])) for row in (5, 15)]
    got = read_free(*light(order, 0.13), [*above, (120, 110, stated)])
    beyond = 1.0 + side * (order - 1.0)
    assert np.isfinite(got.reading.order[130:]).mean() > 0.8
    assert np.nanmax(np.abs(got.reading.order - beyond)[130:]) < 0.05
