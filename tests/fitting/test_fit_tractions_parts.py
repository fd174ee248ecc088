"""The parts of the inversion for tractions: bins, fields, signs, smoothness."""

import numpy as np
import pytest

from isochrome.fitting.tractions.surface_fit import Stage, what_to_say
from isochrome.fitting.tractions.traction_solver import (
    Bins,
    Solution,
    TractionProblem,
    discrepancy_strength,
    lattice_px,
    make_basis,
    smoothness,
    with_signs,
)
from isochrome.stress import PixelGrid

PIXELS = PixelGrid(rows=200, cols=300, left_mm=-1.5, top_mm=0.0, pixel_mm=0.01)


def bins_at(row, col, side):
    row, col = np.asarray(row, float), np.asarray(col, float)
    one = np.ones(len(row))
    sides = np.full(len(row), side)
    return Bins(
        side=sides, row=row, col=col, light=one, sigma=one,
        illumination=one[None], background=one[None],
    )  # fmt: skip


def test_least_squares_with_signs_meets_its_conditions():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(40, 12))
    matrix, right = root.T @ root, rng.normal(size=12)
    c = with_signs(matrix, right, 9)
    slope = matrix @ c - right
    assert c[:9].min() >= 0.0 and (c[:9] == 0.0).any() and (c[:9] > 0.0).any()
    # Karush, Kuhn and Tucker: no slope where free, none that lowers where at the bound
    free = np.r_[c[:9] > 0.0, np.ones(3, bool)]
    assert np.abs(slope[free]).max() < 1e-7
    assert slope[~free].min() > 0.0


def test_the_discrepancy_principle_raises_the_misfit_by_one_for_each_unknown():
    n = 60
    nodes = lattice_px(PIXELS)[:n]
    basis = make_basis(bins_at([50.0], [50.0], 1), PIXELS, nodes, 1, limit=1.0, degree=0)
    rng = np.random.default_rng(2)
    c = np.r_[20.0 + 2.0 * rng.normal(size=2 * n), 0.0]
    smooth = smoothness(basis, 0.01)
    weak = Solution(
        unknowns=c, misfit=1000.0, smooth=1e-12 * smooth, gram=np.eye(2 * n + 1),
        slope=np.zeros(2 * n + 1), residual=np.ones(1000), light=c[:1], converged=True,
    )  # fmt: skip
    strength = discrepancy_strength(weak, smooth, 2 * n)
    # all is positive, so that ridge regression's closed form holds
    moved = np.linalg.solve(np.eye(2 * n + 1) + strength * smooth, c) - c
    assert moved @ moved == pytest.approx(2 * n + 1, rel=1e-3)


def stage_of(unknowns, gram, smooth, residual):
    """A stage of three nodes, one regular mode, and as many bins as there are residuals."""
    count = len(residual)
    bins = bins_at(np.arange(count) // 10, np.arange(count) % 10, 1)
    nodes = np.array([100, 102, 104])
    basis = make_basis(bins, PIXELS, nodes, 2, limit=1.0, degree=0)
    misfit = float(residual @ residual)
    slope, light = np.zeros(len(unknowns)), np.ones(2)
    solution = Solution(
        unknowns=unknowns, misfit=misfit, smooth=smooth, gram=gram, slope=slope,
        residual=residual, light=light, converged=True,
    )  # fmt: skip
    return Stage(TractionProblem(bins, PIXELS, None), basis, solution)


def test_the_covariance_is_widened_by_chi_and_knows_bounds_and_smoothness():
    unknowns = np.array([2.0, 0.0, 1.0, 1.0, 1.0, 1.0, -3.0])
    gram, smooth = np.array([4.0, 1.0, 2.0, 5.0, 10.0, 20.0, 8.0]), np.full(7, 4.0)
    smooth[-1] = 0.0
    stage = stage_of(unknowns, np.diag(gram), np.diag(smooth), np.full(50, 1.5))
    # independent unknowns: each has chi² over what data, and smoothness, say of it
    free = np.array([1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0])  # the second is held at none
    assert np.diag(stage.covariance()) == pytest.approx(free * 2.25 / (gram + smooth))
    assert np.diag(stage.covariance(bound=False)) == pytest.approx(2.25 / (gram + smooth))
    # least squares alone; a thousandth of the smoothness holds what the data leave open
    alone = np.diag(stage.covariance(smooth=False))
    assert alone == pytest.approx(free * 2.25 / gram, rel=0.01)


@pytest.mark.parametrize(("share", "said"), [(0.0098, False), (0.0102, True)])
def test_a_load_is_told_to_be_uncertain_from_one_per_cent(share, said):
    one = np.ones(7)
    stage = stage_of(one, np.eye(7), np.eye(7), np.ones(50))
    found = what_to_say(stage, [stage], (44.0, 44.0 * share))
    assert len(found) == said
    assert all("the load is determined to 1.0 % only" in text for text in found)


@pytest.mark.parametrize(("chi", "said"), [(1.02, False), (1.04, True)])
def test_tractions_that_do_not_describe_the_frame_are_told_from_a_chi_of_1_03(chi, said):
    stage = stage_of(np.ones(7), np.eye(7), np.eye(7), np.full(50, chi))
    found = what_to_say(stage, [stage], (44.0, 0.01))
    assert any(f"chi = {chi:.2f}: no tractions" in text for text in found) is said
