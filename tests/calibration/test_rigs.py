"""Beams on rigs that are not ours: the renderer beside closed forms, and a sample of its study."""

import re

import numpy as np
import pytest

from benchmarks import case_rigs
from benchmarks.outside_rigs import Rig
from isochrome.calibration import uncertainty_budget
from isochrome.calibration.four_point_bending import end_stresses, machined
from isochrome.calibration.order_line import creeping_line
from isochrome.calibration.result import ImageFit

ACROSS, DOWN = np.linspace(-1.6, 1.6, 17), np.linspace(-1.0, 1.0, 21)[:, None]


@pytest.mark.parametrize("facts", [{}, {"uneven": 0.03}, {"offset": 0.2}])
def test_far_from_the_rollers_the_series_is_bending_with_shear(facts):
    far = {"inner": 8.0, "outer": 16.0, **facts}
    off = Rig(rollers=True, **far).stress(ACROSS, DOWN) - Rig(**far).stress(ACROSS, DOWN)
    assert np.abs(off).max() < 5e-3


def test_the_edges_stress_holds_no_force_and_no_moment():
    fine = np.linspace(-1.0, 1.0, 200_001)
    ours = machined(fine, np.array([0.03, 0.06])).real
    for stress in (Rig(edge=(0.1, -0.07)).machined(fine), *ours):
        assert np.abs([np.trapezoid(stress, fine), np.trapezoid(stress * fine, fine)]).max() < 1e-6


def test_what_rollers_add_is_what_decays_from_the_ends_of_a_strip():
    """Fourier's series of the whole beam by Fadle's and Papkovich's functions, 30 times less."""
    near = {"inner": 4.8, "outer": 10.0}
    local = Rig(rollers=True, **near).stress(ACROSS, DOWN) - Rig(**near).stress(ACROSS, DOWN)
    x, below = (each.ravel() for each in np.broadcast_arrays(ACROSS, DOWN))
    forms = end_stresses(below, x + 1.6, 1.6 - x)
    both = np.concatenate([forms.real, forms.imag], axis=1).T
    wanted = np.concatenate([local.real.ravel(), local.imag.ravel()])
    left = wanted - both @ np.linalg.lstsq(both, wanted, rcond=None)[0]
    assert np.std(left) < np.std(wanted) / 30.0


def line(creep, count, *, stays=0.0):
    loads = np.linspace(0.5, 1.5, count)
    orders = (2.0 * loads + stays) * (1.0 + creep) ** np.arange(count)
    return creeping_line(loads, orders, np.full(count, 2e-4))


@pytest.mark.parametrize("count", [2, 3, 4, 8])
def test_creep_is_named_and_its_slope_is_the_first_images(count):
    found = line(0.003, count)
    total = np.hypot(found.slope_uncertainty, found.slope_creep)
    assert found.chance_of_creep > 0.5
    assert abs(found.slope - 2.0) < 2.0 * total
    assert abs(found.creep - 0.003) < 2.0 * found.creep_uncertainty


@pytest.mark.parametrize("count", [2, 3, 4, 8])
def test_orders_on_a_line_through_the_origin_have_none(count):
    found = line(0.0, count)
    assert found.chance_of_creep < 0.05 and found.slope_creep < 1e-3 * found.slope


def test_two_loads_that_leave_an_order_leave_creep_open():
    found = line(0.0, 2, stays=0.01)
    assert abs(found.slope - 2.0) < 2.0 * np.hypot(found.slope_uncertainty, found.slope_creep)
    assert found.slope_creep > 1e-3 * found.slope
    four = line(0.0, 4, stays=0.01)
    assert four.slope_creep < found.slope_creep


def test_creep_has_a_row_in_the_budget_and_a_sentence():
    orders = 0.5 * np.arange(1.0, 6.0) * 1.003 ** np.arange(5)
    images = [
        ImageFit(file=f"{i}", load_n=i + 1.0, order=n, standard_uncertainty=1e-4, chi=1.0)
        for i, n in enumerate(orders.tolist())
    ]
    found = uncertainty_budget("beam", images, 1.0, ())
    assert any(re.search(r"creep by 0\.(29|30)", text) for text in found.warnings)
    assert "creep between images" in {item.name for item in found.budget}
    assert abs(found.fringe_value_n_per_mm - 2.0) < 2.0 * found.standard_uncertainty


@pytest.mark.parametrize("seed", [1, pytest.param(5, marks=pytest.mark.long)])
def test_a_rigs_fact_is_named_and_its_value_holds(seed):
    row = case_rigs.judged("rigs", seed)
    assert row.named and not row.false_lens and not row.refused
    assert abs(row.pull) < 2.0 and row.chi < 1.03


@pytest.mark.study
def test_rigs_are_within_what_is_stated():
    rows = case_rigs.cases()["rigs"](False)
    fitted = [row for row in rows if not row.refused]
    assert np.mean([abs(row.pull) <= 2.0 for row in fitted]) >= 0.9
    assert np.mean([row.named for row in fitted]) >= 0.9
