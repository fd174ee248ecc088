"""The parts of the inversion for tractions: bins, fields, signs, smoothness."""

from dataclasses import replace

import numpy as np
import pytest

from fitting.pressed import CONTACT, Pressed
from isochrome.fitting.tractions.surface_fit import Stage, what_to_say
from isochrome.fitting.tractions.traction_solver import (
    Bins,
    Solution,
    TractionProblem,
    bin_averaging,
    discrepancy_strength,
    lattice_px,
    make_basis,
    make_bins,
    smoothness,
    with_signs,
)
from isochrome.stress import PixelGrid
from isochrome.stress.half_plane import difference_and_trace

PIXELS = PixelGrid(rows=200, cols=300, left_mm=-1.5, top_mm=0.0, pixel_mm=0.01)


def bins_at(row, col, side):
    row, col = np.asarray(row, float), np.asarray(col, float)
    one = np.ones(len(row))
    sides = np.full(len(row), side)
    return Bins(
        side=sides, row=row, col=col, light=one, sigma=one,
        illumination=one[None], background=one[None],
    )  # fmt: skip


@pytest.mark.parametrize("side", [1, 2, 4])
@pytest.mark.parametrize("spacing", [1, 2, 4])
def test_fields_of_hats_add_up_to_the_closed_form(side, spacing):
    rng = np.random.default_rng(0)
    col = (rng.integers(0, 300 // side, 60) + 0.5) * side - 0.5
    row = (rng.integers(30 // side, 200 // side, 60) + 0.5) * side - 0.5
    nodes = lattice_px(PIXELS)[::spacing]
    basis = make_basis(bins_at(row, col, side), PIXELS, nodes, spacing, limit=0.7, degree=1)
    view = Pressed((CONTACT,), lambda x, z: 0.5 + 0.25 * z - 0.1 * x + 0.2j * z)
    pressure = view.pressure(PIXELS.left_mm + PIXELS.pixel_mm * nodes)
    half = 1.5  # mm: half the longer side, at which a mode is 1 MPa
    c = basis.unknowns(pressure, 0.25 * pressure, np.array([0.5, -0.1 * half, 0.25 * half]))
    x, z = (PIXELS.pixel_mm * (place + 0.5) for place in (col, row))
    true = view.difference(PIXELS.left_mm + x, z)
    # trapezia under a root miss zeta(-1/2) sqrt(2) (h/a)^1.5 p0 a of its load at each edge, 0.37 of
    # (h/a)^1.5 in all, and with it at most that share of a stress from below the edges
    allowed = 0.37 * (spacing * PIXELS.pixel_mm / CONTACT.half_width) ** 1.5
    found = basis.columns @ c
    assert np.abs(found - true).max() < allowed * np.abs(true).max()
    # the same lines, summed place by place in double precision: what is left is single's rounding
    places = PIXELS.left_mm + PIXELS.pixel_mm * nodes
    lines, _ = difference_and_trace(PIXELS.left_mm + x, z, places, pressure, 0.25 * pressure)
    besides = view.besides(PIXELS.left_mm + x, z)
    assert np.abs(found - lines - besides).max() < 1e-6 * CONTACT.peak * 3
    p, q = basis.tractions(c)
    assert p == pytest.approx(pressure) and q == pytest.approx(0.25 * pressure)


def test_bins_are_means_of_whole_valid_squares():
    data = Pressed((CONTACT,), cols=64, rows=48, pixel=0.06).data()
    data.valid[20, 30] = False
    bins = make_bins(data, np.arange(48) + 0.5, np.zeros((48, 64)), from_px=2.0)
    assert [side for side, _ in bins.sides()] == [1, 2, 4]
    assert bins.row[bins.side == 1].min() == 2.0
    for side, part in bins.sides():
        k = part.start + 3
        row, col = (round(v - 0.5 * (side - 1)) for v in (bins.row[k], bins.col[k]))
        square = (slice(row, row + side), slice(col, col + side))
        assert bins.light[k] == pytest.approx(data.light[square].mean(), rel=1e-6)
        expected = np.sqrt(np.mean(data.sigma[square] ** 2)) / side
        assert bins.sigma[k] == pytest.approx(expected, rel=1e-6)
        # no square holds the pixel that is not trusted
        inside = np.abs(bins.row[part] - 20) < side / 2
        assert not np.any(inside & (np.abs(bins.col[part] - 30) < side / 2))


def test_contrast_of_a_bin_is_that_of_the_mean_of_its_light():
    rows, cols = np.mgrid[:40, :40]
    order = 0.05 * cols + 0.03 * rows
    bins = bins_at([18.0, 18.5, 19.5], [18.0, 18.5, 19.5], 1)
    bins = replace(bins, side=np.array([1, 2, 4]))
    fine = (np.arange(400) + 0.5) / 400 - 0.5
    for k, side in enumerate((1, 2, 4)):
        x, z = np.meshgrid(side * fine, side * fine)
        mean = np.cos(2 * np.pi * (0.05 * x + 0.03 * z)).mean()
        assert bin_averaging(order, bins).contrast[k] == pytest.approx(mean, abs=1e-5)


@pytest.mark.parametrize("blur", [0.0, 1.5])
def test_a_bent_field_shifts_the_order_of_the_mean_light(blur):
    def field(row, col):
        return 0.2 + 0.01 * (col - 18.5) - 0.01 * (row - 18.5) + 8e-4 * (col - 18.5) ** 2

    order = field(*np.mgrid[:40, :40].astype(float))
    bins = bins_at([18.5], [18.5], 1)
    bins = replace(bins, side=np.array([4]))
    across = 18.5 + 4.0 * ((np.arange(400) + 0.5) / 400 - 0.5)
    reach = np.linspace(-8.0, 8.0, 161)
    weight = np.exp(-0.5 * (reach / max(blur, 1e-3)) ** 2)
    col, offset = np.meshgrid(across, reach)
    row = 18.5 + 4.0 * ((np.arange(40) + 0.5) / 40 - 0.5)
    light = [np.sum(weight[:, None] * np.exp(2j * np.pi * field(one, col + offset))) for one in row]
    mean = np.angle(np.sum(light)) / (2.0 * np.pi)
    shift = bin_averaging(order, bins, blur).shift[0]
    # the next order is (2 pi g s)² of the shift, one or two per cent
    assert shift == pytest.approx(mean - 0.2, rel=0.03)


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


def test_smoothness_is_the_integral_of_the_squared_second_derivatives():
    nodes = lattice_px(PIXELS)[::2]
    nodes = nodes[(nodes >= 100) & (nodes <= 200)]
    basis = make_basis(bins_at([50.0], [50.0], 1), PIXELS, nodes, 2, limit=0.5, degree=1)
    x = 0.01 * (nodes - 150.0)
    c = basis.unknowns(3.0 + 2.0 * x**2, 0.3 * x**2, np.zeros(3))
    # p'' = 4, q'' = 0.6 over the nodes that have two neighbours
    expected = (4.0**2 + 0.6**2) * 0.02 * (len(nodes) - 2)
    assert c @ smoothness(basis, 0.01) @ c == pytest.approx(expected, rel=1e-9)


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
