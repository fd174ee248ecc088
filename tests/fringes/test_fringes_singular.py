"""A patch whose equations are singular is left out; the frame, and the others, are read."""

from dataclasses import replace

import numpy as np

from isochrome.fringes.single_frame import end_search
from isochrome.fringes.single_frame.background_modulation import _problem
from isochrome.fringes.single_frame.end_problem import PatchData, eliminated, ends_at
from isochrome.fringes.single_frame.patches import fit_patches, gather_patches

ROW, COL = np.mgrid[:130, :160].astype(float)
ORDER = 0.2 + 0.03 * COL + 2e-4 * (ROW - 60.0) ** 2
SIGMA = 0.004
DARK, BRIGHT, TONE = 0.1, 0.8, 1.5


def shown(seed=2):
    """Light of a camera that stored I^(1/1.5), its noise, and where it is trusted."""
    linear = DARK + (BRIGHT - DARK) * np.sin(np.pi * ORDER) ** 2
    noise = SIGMA * np.random.default_rng(seed).standard_normal(ROW.shape)
    return linear ** (1.0 / TONE) + noise, np.full(ROW.shape, SIGMA), np.ones(ROW.shape, bool)


def singular(data: PatchData, patch: int) -> PatchData:
    """A patch of which one pixel says everything: ten unknowns, one equation."""
    weight = data.weight.copy()
    weight[patch] = 0.0
    weight[patch, 0] = 1e25
    return replace(data, weight=weight)


def test_a_singular_patch_says_nothing_of_the_light():
    problem, starts = _problem(*shown(), (None, None), True)
    data, orders, _ = end_search.fresh_patches(problem, starts[0])
    lost = len(orders) // 2
    weight = data.weight.copy()
    weight[lost] = 0.0
    wanted = eliminated(replace(data, weight=weight), ends_at(data, starts[0]), orders)
    found = eliminated(singular(data, lost), ends_at(data, starts[0]), orders)
    np.testing.assert_allclose(found.matrix, wanted.matrix, rtol=1e-9)
    scale = np.abs(wanted.slope).max()
    np.testing.assert_allclose(found.slope, wanted.slope, rtol=1e-9, atol=1e-9 * scale)
    assert found.spread[lost] == np.inf  # its order is not known
    assert not found.pull[lost].any() and not found.drag[lost].any()
    others = np.arange(len(orders)) != lost
    np.testing.assert_allclose(found.pull[others], wanted.pull[others], rtol=1e-9)


def test_a_patch_without_a_number_is_no_good_and_the_others_are_as_before():
    wave, sigma = np.cos(2.0 * np.pi * ORDER), np.full(ROW.shape, 0.02)
    light = gather_patches(wave, sigma, np.ones(ROW.shape, bool))
    wanted, lost = fit_patches(light), 7
    noise = light.noise.copy()
    noise[lost] = np.nan
    found = fit_patches(replace(light, noise=noise))
    assert np.isinf(found.chi.ravel()[lost])
    assert np.isinf(found.spread.reshape(-1, 6)[lost]).all()
    others = np.arange(len(noise)) != lost
    for name in ("terms", "spread"):
        mine, whole = (getattr(each, name).reshape(-1, 6)[others] for each in (found, wanted))
        np.testing.assert_array_equal(mine, whole)
