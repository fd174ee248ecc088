"""Wear laws and tables over distance: doses against closed forms, balance, order, streaming."""

import itertools
import weakref

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad

import isochrome.contact.wear as worn_module
from hard.hard_cases import constant_course, table
from isochrome.contact import (
    contact_states,
    iter_contact_states,
    mean_wear_rate,
    wear_course,
    wear_rate,
)
from isochrome.contact import sliding_history as history_module
from isochrome.contact import state as contact_state
from isochrome.errors import PhysicsError
from isochrome.scene import load_scene

COARSE = {"numerics.spacing_mm": 0.0121, "numerics.tolerance": 1e-3}
THICKNESS = 4.0


def scene(**values):
    """The shipped scene with other values, on a coarse grid; keys with __ for the dot."""
    changed = {key.replace("__", "."): value for key, value in values.items()}
    return load_scene("line-contact-wear").with_values(COARSE | changed)


def worn_states(case):
    """Its states without the static one."""
    return contact_states(case)[1:]


def test_a_coefficient_that_falls_linearly_makes_a_quadratic_dose():
    case = scene(
        wear__coefficient_mm2_per_n=table((0.0, 5e-9), (100.0, 1e-9)),
        wear__distances_m=(0.0, 30.0, 100.0, 250.0),
    )
    _, stops = wear_course(case)
    exact = [0.0, 5 * 30 - 0.02 * 30**2, 300.0, 300.0 + 150.0]  # times 1e-9 mm²/N · 1e3 mm
    # quadrature of a polynomial: rounding only
    assert [s.dose_mm_per_mpa for s in stops] == pytest.approx([1e-6 * e for e in exact], rel=1e-13)
    assert [s.distance_m for s in stops] == [0.0, 30.0, 100.0, 250.0]


@pytest.mark.parametrize("end", [0.3, 5.0])
def test_sarkars_dose_under_a_friction_ramp_is_its_closed_form(end):
    case = scene(
        friction__coefficient=table((0.0, -end), (100.0, end)),
        wear__law="sarkar",
        wear__distances_m=(10.0, 50.0, 90.0),
    )

    def primitive(mu):
        return mu * np.sqrt(1 + 3 * mu**2) / 2 + np.arcsinh(np.sqrt(3) * mu) / (2 * np.sqrt(3))

    _, stops = wear_course(case)
    for stop in stops:
        mu = end * (stop.distance_m / 50.0 - 1.0)
        exact = 2e-6 * 50.0 / end * (primitive(mu) - primitive(-end))
        # eight Gauss points a quarter of mu apart: rounding only
        assert stop.dose_mm_per_mpa == pytest.approx(exact, rel=1e-13)


def test_dissipated_energy_counts_friction_of_either_sign():
    case = scene(
        friction__coefficient=table((0.0, 0.3), (100.0, -0.2), (150.0, -0.2)),
        wear__law="dissipated_energy",
        wear__coefficient_mm2_per_n=8e-9,
        wear__distances_m=(60.0, 100.0, 150.0),
    )
    course, stops = wear_course(case)
    triangle = 0.5 * 60.0 * 0.3
    exact = [triangle, triangle + 0.5 * 40 * 0.2, triangle + 4.0 + 10.0]
    # the zero of mu is a rounded number: its own rounding
    assert [s.dose_mm_per_mpa for s in stops] == pytest.approx([8e-6 * e for e in exact], rel=1e-13)
    zero, corner = course.breaks_mm_per_mpa
    assert (zero, corner) == pytest.approx((8e-6 * triangle, 8e-6 * (triangle + 4.0)), rel=1e-13)


def test_the_laws_differ_by_their_factor_alone():
    wear = scene(wear__coefficient_mm2_per_n=3e-9).wear

    def rate(law, mu):
        return wear_rate(wear.model_copy(update={"law": law}), mu, 10.0)

    assert rate("archard", 0.5) == 3e-9
    assert rate("sarkar", 0.5) == pytest.approx(3e-9 * 1.75**0.5, rel=1e-15)
    assert rate("sarkar", 0.0) == 3e-9
    assert rate("dissipated_energy", -0.5) == 1.5e-9
    with pytest.raises(ValueError, match="no wear law 'rabinowicz'"):
        rate("rabinowicz", 1.0)


def running_in(settled_m):
    """A law that goes with the distance: k (1 + 4 e^(-s/s0))."""

    def rate(wear, friction, distance_m):
        return wear.coefficient_at(distance_m) * (1.0 + 4.0 * np.exp(-distance_m / settled_m))

    return rate


@pytest.mark.parametrize("settled_m", [300.0, 20.0, 0.1, 1e-4])
def test_the_dose_of_a_law_of_the_distance_is_its_closed_form(monkeypatch, settled_m):
    """However short the running-in: eight points over 233 m see nothing of 0.1 mm. The end of the
    stretch, which the second rule looks at, does."""
    monkeypatch.setattr(history_module, "wear_rate", running_in(settled_m))
    course, stops = wear_course(scene())
    s = np.array([stop.distance_m for stop in stops])
    exact = 2e-6 * (s - 4.0 * settled_m * np.expm1(-s / settled_m))
    # each stretch's dose is held to 1e-12 of the whole
    assert_allclose([stop.dose_mm_per_mpa for stop in stops], exact, rtol=0, atol=1e-11 * exact[-1])
    # a stretch a halving from 233 m to a tenth of a millimetre, a few more within the running-in
    assert len(course.distance_m) < 50


def test_a_search_starts_from_the_mean_rate_and_from_a_constant_one_to_its_last_bit(monkeypatch):
    wear, mu = scene(wear__law="sarkar").wear, np.array([0.0, 0.21, -0.4])
    assert_array_equal(mean_wear_rate(wear, mu, 233.0), wear_rate(wear, mu, np.full(3, 233.0)))
    tried = wear.model_copy(update={"coefficient_mm2_per_n": np.array([1e-9, 2e-9, 3e-9])})
    monkeypatch.setattr(history_module, "wear_rate", running_in(20.0))
    mean = 1.0 + 4.0 * 20.0 / 40.0 * -np.expm1(-2.0)
    # eight points on an exponential over two of its lengths: rounding
    assert_allclose(mean_wear_rate(tried, mu, 40.0), mean * tried.coefficient_mm2_per_n, rtol=1e-13)


def test_load_and_friction_follow_the_dose_where_it_bends_and_where_it_stops():
    """k falls to zero at 100 m, where s(K) = L (1 - √(1 - K/K1)) has a vertical tangent."""
    case = scene(
        wear__coefficient_mm2_per_n=table((0.0, 4e-9), (100.0, 0.0)),
        friction__coefficient=table((0.0, 0.1), (100.0, 0.4)),
        load__normal_n=table((0.0, 20.0), (100.0, 60.0)),
        wear__distances_m=(100.0,),
        numerics__tolerance=1e-6,
    )
    course, (stop,) = wear_course(case)
    full = stop.dose_mm_per_mpa
    assert full == pytest.approx(4e-6 * 50.0, rel=1e-13)
    for share in np.r_[np.random.default_rng(1).uniform(0, 1, 200), 1 - 1e-9, 0.0, 1.0]:
        done = 1.0 - np.sqrt(1.0 - share)
        load, mu, *_ = course.at(share * full)
        # what the samples are laid for, a thousandth of the tolerance, and the dose's own rounding
        rounding = 2e-16 / max(np.sqrt(1.0 - share), 1.5e-8)
        assert mu == pytest.approx(0.1 + 0.3 * done, abs=0.4 * (1e-9 + rounding))
        assert THICKNESS * load == pytest.approx(20.0 + 40.0 * done, abs=60.0 * (1e-9 + rounding))


def test_a_course_of_constants_needs_two_samples():
    course, stops = wear_course(scene())
    assert len(course.distance_m) == 2 and course.breaks_mm_per_mpa == ()
    assert course.at(1e-4) == (11.0, 0.25, 0.0, 0.0)
    steady, same = constant_course(11.0, [0, 31, 77, 155, 233], dose_per_m=2e-6, friction=0.25)
    assert [s.dose_mm_per_mpa for s in stops] == pytest.approx(
        [s.dose_mm_per_mpa for s in same], rel=1e-14
    )
    assert steady.at(2e-4) == (11.0, 0.25, 0.0, 0.0)


def test_a_jump_while_nothing_wears_is_told_from_both_sides():
    case = scene(
        wear__coefficient_mm2_per_n=table((0, 2e-9), (50, 2e-9), (51, 0), (99, 0), (100, 2e-9)),
        load__normal_n=table((60.0, 20.0), (80.0, 44.0)),
        wear__distances_m=(55.0, 70.0, 90.0, 150.0),
    )
    course, stops = wear_course(case)
    assert len({s.dose_mm_per_mpa for s in stops[:3]}) == 1
    assert [THICKNESS * s.line_load_n_per_mm for s in stops] == pytest.approx([20, 32, 44, 44])
    still = stops[0].dose_mm_per_mpa
    assert THICKNESS * course.at(still)[0] == pytest.approx(20.0)
    assert THICKNESS * course.leaving(still)[0] == pytest.approx(44.0)
    assert course.next_break(0.0) < still and course.next_break(still) > still
    first, second, third, last = worn_states(case)
    carried = [THICKNESS * s.line_load_n_per_mm for s in (first, second, third, last)]
    assert carried == pytest.approx([20.0, 32.0, 44.0, 44.0], rel=1e-12)
    assert_array_equal(first.wear_depth_mm, third.wear_depth_mm)
    # area = ∫P' dK over the two stretches that wear: 50.5 m at 20 N and 50.5 m at 44 N; the first
    # part, on the mesh, holds it to the tolerance asked for, 1e-3
    area = 2e-6 * (50.5 * 20.0 + 50.5 * 44.0) / THICKNESS
    assert last.worn_area_mm2 == pytest.approx(area, rel=1e-3)


def test_a_dose_beside_a_jump_by_its_rounding_is_on_the_jump():
    """Goes wrong: a step that ends an ulp beyond a jump arrives with part of it, and an edge goes
    30 nm ahead in no time (course 159)."""
    wear = table((0, 2e-9), (50, 2e-9), (51, 0), (99, 0), (100, 2e-9), (149, 2e-9), (150, 0))
    case = scene(
        wear__coefficient_mm2_per_n=wear,
        load__normal_n=table((60.0, 20.0), (80.0, 44.0), (160.0, 44.0), (170.0, 60.0)),
        wear__distances_m=(55.0, 155.0, 180.0),
    )
    course, (still, end, _) = wear_course(case)
    for stop, before, after in ((still, 20.0, 44.0), (end, 44.0, 60.0)):
        for ulps in range(-4, 5):
            dose = stop.dose_mm_per_mpa + ulps * np.spacing(stop.dose_mm_per_mpa)
            assert THICKNESS * course.at(dose)[0] == pytest.approx(before, rel=1e-12)
            assert THICKNESS * course.leaving(dose)[0] == pytest.approx(after, rel=1e-12)


def tables_of(values, max_size=4):
    """A number, or a table at distances within and beyond the run."""
    places = st.lists(st.integers(0, 30), min_size=2, max_size=max_size, unique=True).map(sorted)
    drawn = places.flatmap(
        lambda s: st.tuples(st.just(s), st.lists(values, min_size=len(s), max_size=len(s)))
    )
    return values | drawn.map(lambda sv: {"distance_m": [5.0 * s for s in sv[0]], "value": sv[1]})


laws = st.sampled_from(["archard", "sarkar", "dissipated_energy"])
coefficients = tables_of(st.floats(0.0, 8e-9))
frictions = tables_of(st.floats(-0.6, 0.6))


def balance(case, end):
    """∫ kappa P' ds (mm²) by adaptive quadrature between the tables' points."""
    factor = {
        "archard": lambda mu: 1.0,
        "sarkar": lambda mu: np.sqrt(1.0 + 3.0 * mu * mu),
        "dissipated_energy": abs,
    }[case.wear.law]

    def rate(s):
        k, mu, load = case.wear_coefficient_at(s), case.friction_at(s), case.load_at(s)
        return 1e3 * k * factor(mu) * load / THICKNESS

    points = [5.0 * i for i in range(1, 31) if 5.0 * i < end]
    ends = [0.0, *points, end]
    pairs = itertools.pairwise(ends)
    return sum(quad(rate, a, b, epsabs=1e-15, limit=200)[0] for a, b in pairs)


@pytest.mark.long
@settings(max_examples=15)
@given(
    law=laws, k=coefficients, mu=frictions, load=st.just(44.0) | tables_of(st.floats(20.0, 80.0))
)
def test_worn_area_is_the_integral_of_rate_and_load_under_every_law(law, k, mu, load):
    """Each state carries its load, and its worn area is that of the course so far."""
    values = {"wear__law": law, "wear__coefficient_mm2_per_n": k, "friction__coefficient": mu}
    case = scene(**values, load__normal_n=load, wear__distances_m=(40.0, 101.0))
    # the tolerance, 1e-3, holds the pressure, and a constant load's area as well; the formula is of
    # second order in a load's change. A scar of a millionth of the overlap, 4 a^3/(3 R) = 2.8e-3
    # mm², is below the solver's
    rel = 5e-3 if isinstance(load, dict) else 1e-3
    for state in worn_states(case):
        carried = pytest.approx(case.load_at(state.distance_m), rel=1e-12)
        assert THICKNESS * state.line_load_n_per_mm == carried
        exact = balance(case, state.distance_m)
        assert state.worn_area_mm2 == pytest.approx(exact, rel=rel, abs=2.8e-9)


VARIED = {
    "wear__coefficient_mm2_per_n": table((0.0, 6e-9), (40.0, 2e-9), (90.0, 0.0)),
    "friction__coefficient": table((0.0, 0.1), (50.0, 0.3)),
    "load__normal_n": table((0.0, 30.0), (60.0, 44.0)),
    "wear__law": "sarkar",
}


def test_the_order_of_the_distances_does_not_matter_with_tables_either():
    asked = (100.0, 0.0, 31.0, 95.0, 31.0, 0.0)
    mixed = worn_states(scene(**VARIED, wear__distances_m=asked))
    rising = worn_states(scene(**VARIED, wear__distances_m=tuple(sorted(asked))))
    assert tuple(s.distance_m for s in mixed) == asked
    places = sorted(range(len(asked)), key=lambda i: asked[i])
    for place, state in zip(places, rising, strict=True):
        assert_array_equal(mixed[place].wear_depth_mm, state.wear_depth_mm)
        assert mixed[place].friction == state.friction
    # 95 m and 100 m lie beyond the end of the running-in to zero
    assert_array_equal(mixed[0].wear_depth_mm, mixed[3].wear_depth_mm)
    assert not mixed[1].wear_depth_mm.any()


def test_friction_that_reverses_moves_the_contact_to_the_other_side():
    """Hard case: the sign of mu changes on the way."""
    reversing = table((0.0, 0.25), (20.0, 0.25), (30.0, -0.25))
    there = scene(friction__coefficient=reversing, wear__distances_m=(20.0, 25.0, 60.0))
    back = scene(
        friction__coefficient=reversing | {"value": [-0.25, -0.25, 0.25]},
        wear__distances_m=(20.0, 25.0, 60.0),
    )
    forward, mirrored = worn_states(there), worn_states(back)
    assert [s.friction for s in forward] == pytest.approx([0.25, 0.0, -0.25], abs=1e-15)
    for one, other in zip(forward, mirrored, strict=True):
        # the same steps, mirrored, up to rounding in their choice
        scale = one.wear_depth_mm.max()
        assert_allclose(other.wear_depth_mm, one.wear_depth_mm[::-1], rtol=0, atol=1e-6 * scale)
        assert_allclose(other.shear_mpa, -one.shear_mpa[::-1], rtol=0, atol=1e-5 * 20.0)
    lean = [float((s.pressure_mpa * s.grid.x_mm).sum()) for s in forward]
    assert lean[0] < 0.0 < lean[2]


def test_no_friction_and_no_coefficient_wear_nothing_under_the_energy_law():
    case = scene(friction__coefficient=0.0, wear__law="dissipated_energy")
    assert not any(s.wear_depth_mm.any() for s in worn_states(case))


@pytest.fixture
def solved(monkeypatch):
    """Weak references to the worn states that were solved so far."""
    seen = []
    history = worn_module.scar_history

    def watched(*args, **kwargs):
        for state in history(*args, **kwargs):
            seen.append(weakref.ref(state))
            yield state

    monkeypatch.setattr(worn_module, "scar_history", watched)
    return seen


def test_a_state_is_handed_out_before_the_next_is_solved(solved):
    states = iter_contact_states(scene(wear__distances_m=(0.0, 20.0, 60.0)))
    assert not next(states).sliding and len(solved) == 0
    for count, distance in enumerate((0.0, 20.0, 60.0)):  # the first is unworn: no run yet
        assert next(states).distance_m == distance and len(solved) == count
    assert list(states) == []


def test_a_long_history_in_order_holds_no_states(solved):
    case = scene(wear__distances_m=tuple(np.linspace(0.1, 20.0, 60)))
    for _ in iter_contact_states(case):
        # the one at hand, and the one before it in the generator's hands
        assert sum(ref() is not None for ref in solved) <= 2
    assert len(solved) == 60


def test_a_contact_that_outgrows_its_grid_goes_on_where_it_was(monkeypatch):
    case = scene(wear__distances_m=(0.0, 10.0, 100.0, 233.0))
    whole = contact_states(case)
    monkeypatch.setattr(contact_state, "_MARGIN", 0.8)
    states = list(iter_contact_states(case))
    assert [s.distance_m for s in states] == [0.0, 0.0, 10.0, 100.0, 233.0]
    nodes = [s.grid.nodes for s in states]
    assert nodes == sorted(nodes) and nodes[0] < nodes[-1]
    for state, true in zip(states, whole, strict=True):
        # both within the tolerance, 1e-3
        assert state.wear_depth_mm.max() == pytest.approx(true.wear_depth_mm.max(), rel=2e-3)
        assert not state.pressure_mpa[[0, -1]].any()


@pytest.mark.long
def test_a_contact_that_was_at_the_edge_only_between_two_states_is_seen():
    """Hard case: the load's peak lies between the distances asked for."""
    peak = table((0.0, 44.0), (9.0, 44.0), (10.0, 4000.0), (11.0, 44.0))
    case = scene(load__normal_n=peak, wear__distances_m=(0.0, 20.0), numerics__window_mm=2.0)
    with pytest.raises(PhysicsError, match="reaches the edge of its grid"):
        contact_states(case)


@pytest.mark.parametrize("k", [5e-324, 1e-300])
def test_wear_too_small_for_a_number_is_none(k):
    """Hard case: the smallest coefficient that a float holds; a step's weights would overflow."""
    for state in worn_states(scene(wear__coefficient_mm2_per_n=k, wear__distances_m=(40.0, 101.0))):
        assert not state.wear_depth_mm.any() and np.isfinite(state.pressure_mpa).all()
