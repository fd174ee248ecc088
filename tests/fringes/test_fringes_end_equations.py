"""The equations of the light's ends, and patches of which they are singular."""

from dataclasses import replace

import numpy as np
import pytest

from isochrome.fringes.single_frame import end_search
from isochrome.fringes.single_frame.background_modulation import _problem
from isochrome.fringes.single_frame.end_search import TERMS, PatchEnds, PatchModel, eliminated
from isochrome.fringes.single_frame.patches import fit_patches, gather_patches

ROW, COL = np.mgrid[:110, :130].astype(float)
ORDER = 0.2 + 0.03 * COL + 2e-4 * (ROW - 60.0) ** 2
SIGMA = 0.01
STEP = 1e-6


def shown():
    """Fringes under a spot of light, their noise, and where they are trusted."""
    spot = 1.0 + 0.5 * np.exp(-(((COL - 90.0) / 20.0) ** 2) - ((ROW - 40.0) / 15.0) ** 2)
    light = 0.1 + 0.4 * spot * np.sin(np.pi * ORDER) ** 2
    noise = SIGMA * np.random.default_rng(2).standard_normal(ROW.shape)
    return light + noise, np.full(ROW.shape, SIGMA), np.ones(ROW.shape, bool)


def differences(change, size):
    """Derivatives (p, k, size) of the light by central differences of the residual."""
    steps = STEP * np.eye(size)
    return np.stack([(change(-s) - change(s)) / (2.0 * STEP) for s in steps], axis=-1)


@pytest.mark.parametrize("tone", [False, True])
def test_with_every_patch_following_they_are_those_of_differences(tone):
    """Shapes that vary within a patch too: Schur's complement of all patches' own equations."""
    problem, starts = _problem(*shown(), (None, None), tone)
    unknowns = starts[0] + np.where(np.arange(starts[0].size) > 1, 0.01, 0.0)
    unknowns[-1] = 1.1 if tone else 1.0
    data, orders, _ = end_search.fresh_patches(problem, unknowns)
    some = np.arange(len(orders)) % 9 == 0
    per_patch = ("index", "light", "weight", "pixels", "window", "chi")
    data = replace(data, **{name: getattr(data, name)[some] for name in per_patch})
    orders = orders[some]
    free, here = np.flatnonzero(problem.free), PatchEnds(data, unknowns)

    def by_ends(step):
        new = unknowns.copy()
        new[free] += step
        return PatchModel(PatchEnds(data, new), orders).residual

    def by_orders(step):
        return PatchModel(here, orders + step).residual

    ends, own = differences(by_ends, len(free)), differences(by_orders, TERMS)
    root = np.sqrt(data.weight)[..., None]
    ends, own, left = (root * ends, root * own, root[..., 0] * PatchModel(here, orders).residual)
    inner = np.einsum("pka,pkb->pab", own, own)
    inner += np.diag(end_search._PRIOR + end_search._PIVOT)
    mixed = np.einsum("pka,pkb->pab", own, ends)
    pull = np.einsum("pka,pk->pa", own, left) - orders * end_search._PRIOR
    follow = np.linalg.solve(inner, np.concatenate([mixed, pull[..., None]], axis=-1))
    prior, away = problem.prior(unknowns)
    wanted = np.einsum("pka,pkb->ab", ends, ends) + np.diag(prior[free])
    wanted -= np.einsum("pab,pac->bc", mixed, follow[..., :-1])
    slope = np.einsum("pka,pk->a", ends, left) - (prior * away)[free]
    slope -= np.einsum("pab,pa->b", mixed, follow[..., -1])
    found = eliminated(here, orders)
    # differences of the light are good to 1e-9 of it, and the complement takes most of it away
    np.testing.assert_allclose(found.matrix, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())
    np.testing.assert_allclose(found.slope, slope, rtol=0, atol=1e-5 * np.abs(slope).max())


DARK, BRIGHT, TONE = 0.1, 0.8, 1.5


def test_a_singular_patch_says_nothing_of_the_light():
    # light of a camera that stored I^(1/1.5)
    linear = DARK + (BRIGHT - DARK) * np.sin(np.pi * ORDER) ** 2
    noise = 0.004 * np.random.default_rng(2).standard_normal(ROW.shape)
    frame = linear ** (1.0 / TONE) + noise, np.full_like(noise, 0.004), np.ones(noise.shape, bool)
    problem, starts = _problem(*frame, (None, None), True)
    data, orders, _ = end_search.fresh_patches(problem, starts[0])
    lost = len(orders) // 2
    weight = data.weight.copy()
    weight[lost] = 0.0
    wanted = eliminated(PatchEnds(replace(data, weight=weight), starts[0]), orders)
    weight = weight.copy()
    weight[lost, 0] = 1e25  # one pixel says everything: ten unknowns, one equation
    found = eliminated(PatchEnds(replace(data, weight=weight), starts[0]), orders)
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
    assert np.isinf(found.chi.ravel()[lost]) and np.isinf(found.spread.reshape(-1, 6)[lost]).all()
    others = np.arange(len(noise)) != lost
    for name in ("terms", "spread"):
        mine, whole = (getattr(each, name).reshape(-1, 6)[others] for each in (found, wanted))
        np.testing.assert_array_equal(mine, whole)
