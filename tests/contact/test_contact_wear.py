"""Wear stepping: balance, tolerance, stability, and a brute-force explicit reference."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hard.hard_cases import COUPLING, LOAD, MODULUS, constant_course, parabola
from isochrome.contact import make_surface, wear_history

PER_METRE = 2e-9 * 1e3  # dose per metre of sliding, mm/MPa: k of the paper times 1000 mm
DOSES = PER_METRE * np.array([31.0, 77.0, 155.0, 233.0])


def history(n, doses, *, half=0.8, friction=0.25, coupling=COUPLING, tolerance=1e-4, gap=None):
    x = np.linspace(-half, half, n)
    surface = make_surface(n, x[1] - x[0], contact_modulus_mpa=MODULUS, coupling_per_mpa=coupling)
    gap = (gap or parabola)(x)
    course, stops = constant_course(LOAD, doses, dose_per_m=1.0, friction=friction)
    return x, surface, list(wear_history(surface, gap, course, stops, tolerance=tolerance))


@pytest.mark.parametrize(
    ("shape", "tolerance"),
    [
        pytest.param(parabola, 1e-5, id="cylinder", marks=pytest.mark.long),
        pytest.param(lambda x: parabola(x) + np.where(x > 0.05, 2e-4, 0.0), 1e-3, id="ledge"),
        pytest.param(lambda x: 0.05 * np.clip(np.abs(x) - 0.4, 0, None), 1e-3, id="shoulders"),
    ],
)
def test_the_tolerance_holds_under_a_cylinder_and_beside_a_fixed_corner(shape, tolerance):
    """Hard case: a corner's pressure is hidden from the displacement, most of all early."""
    doses = [DOSES[0] / 31.0, DOSES[0] / 3.1, DOSES[-1]]
    asked, finer = (
        history(133, doses, gap=shape, tolerance=t)[2] for t in (tolerance, tolerance / 30)
    )
    for state, true in zip(asked, finer, strict=True):
        # the finer run is itself good to a thirtieth of the tolerance
        assert state.contact.pressure.max() == pytest.approx(
            true.contact.pressure.max(), rel=1.1 * tolerance
        )
        assert state.depth_mm.max() == pytest.approx(true.depth_mm.max(), rel=1.1 * tolerance)


@pytest.mark.long
def test_no_pressure_spike_is_left_on_the_nodes_that_the_edge_has_just_passed():
    """Hard case: a long last step over-wears freshly touched nodes, and the stress at the edge,
    where the paper finds the largest shear, is then wrong by percents of p0."""
    states, finer = (history(133, DOSES, tolerance=t)[2] for t in (1e-4, 2e-5))
    for state, true in zip(states, finer, strict=True):
        p, q = state.contact.pressure, true.contact.pressure
        # measured 0.008 of the peak, on a single node; where the steps are not shortened 0.015
        assert np.abs(p - q).max() < 0.012 * q.max()


def test_doses_are_hit_exactly_and_repeated_ones_give_the_same_state():
    doses = [0.0, 1e-5, 1e-5, 3e-4]
    _, _, states = history(101, doses)
    assert [s.dose_mm_per_mpa for s in states] == doses
    assert_array_equal(states[0].depth_mm, 0.0)
    assert_array_equal(states[1].depth_mm, states[2].depth_mm)
    assert_allclose(
        states[1].contact.pressure, states[2].contact.pressure, rtol=0, atol=1e-7 * 20.0
    )


def test_every_worn_state_holds_the_contact_conditions_and_the_balance():
    x, _, states = history(161, DOSES)
    for dose, state in zip(DOSES, states, strict=True):
        p, gap = state.contact.pressure, state.contact.gap
        assert state.contact.residual <= 1e-8  # asked for at each output
        assert p.min() >= 0.0 and state.depth_mm.min() >= 0.0
        assert gap.min() >= -1e-8 * LOAD / MODULUS
        assert p.sum() * (x[1] - x[0]) == pytest.approx(LOAD, rel=1e-12)
        # holds identically for any scheme that carries the load: to the rounding of ~100 steps
        assert state.depth_mm.sum() * (x[1] - x[0]) == pytest.approx(dose * LOAD, rel=1e-12)
