"""Hard cases of wear: corners, roughness, friction that turns round, and no distance at all."""

import itertools

import numpy as np
import pytest

from hard.hard_cases import (
    COUPLING,
    FLAT,
    LOAD,
    MODULUS,
    RADIUS,
    WEAR,
    constants,
    contact_scene,
    eliminated,
    influence,
    patches,
    rough,
    violation,
    worn,
    write_profile,
)
from isochrome.contact import contact_states


def flat_history(distances, **options):
    text = worn(distances, spacing=0.01, **options)
    return contact_states(contact_scene(text, indenter=FLAT))


def exact_flat_wear(x, dose, *, friction=0.0):
    """Pressure and depth of a flat that touches everywhere: A p + h = d(K), dh/dK = p make A dp/dK
    = d' - p with h Σp = P', linear with constant coefficients; by eigenvalues."""
    a = influence(x, coupling=COUPLING, friction=friction)
    inverse = np.linalg.inv(a)
    ones = np.ones(len(x))
    along = inverse @ ones / (ones @ inverse @ ones)
    start = LOAD / (x[1] - x[0]) * along
    matrix = -(inverse - np.outer(along, ones @ inverse))  # dp/dK = matrix p: no load in it
    values, vectors = np.linalg.eig(matrix)
    weights = np.linalg.solve(vectors, start.astype(complex))
    pressure = (vectors @ (np.exp(values * dose) * weights)).real
    grown = np.where(
        np.abs(values * dose) < 1e-9, dose, np.expm1(values * dose) / np.where(values, values, 1.0)
    )
    return pressure, (vectors @ (grown * weights)).real


@pytest.mark.parametrize(
    ("friction", "tolerance"),
    [(None, 1e-4), (0.25, 1e-4), pytest.param(None, 1e-6, marks=pytest.mark.long)],
)
def test_worn_corners_follow_the_matrix_exponential(friction, tolerance):
    """Goes wrong: a stiff corner node is overstepped, and its pressure rings about the truth."""
    distances = [0.0, 0.1, 1.0, 10.0, 100.0]
    for state in flat_history(distances, friction=friction, tolerance=tolerance):
        on = state.pressure_mpa > 0.0
        assert np.abs(state.grid.x_mm[on]).max() == pytest.approx(0.5, abs=1e-9) and on.sum() == 101
        p, depth = exact_flat_wear(
            state.grid.x_mm[on], 1e3 * WEAR * state.distance_m, friction=friction or 0.0
        )
        # ten times the tolerance of 1e-4 inside, and more on the corner's own node
        assert np.abs(state.pressure_mpa[on] - p)[5:-5].max() < 1e-3 * p.max()
        assert np.abs(state.pressure_mpa[on] - p).max() < 5e-3 * p.max()
        assert np.abs(state.wear_depth_mm[on] - depth).max() <= 1e-3 * depth.max()
        if friction is None:  # the tolerance asked for, at a corner too, and a tenth for the truth
            assert state.p_max_mpa == pytest.approx(p.max(), rel=1.1 * tolerance)
            assert state.wear_depth_mm.max() == pytest.approx(depth.max(), rel=1.1 * tolerance)


def test_flat_wears_to_uniform_pressure_and_its_corners_only_ever_ease():
    """Goes wrong: corners oscillate, the balance of volume fails, or the middle never loads up."""
    distances = [0.0, 0.01, 0.1, 1.0, 10.0, 31.0, 77.0, 233.0, 1000.0, 3000.0]
    states = flat_history(distances)
    for state in states:
        p, h = state.pressure_mpa, state.wear_depth_mm
        assert_worn_area(state)
        # symmetric to the residual of each step, 1e-7 of the pressure
        np.testing.assert_allclose(p, p[::-1], rtol=0, atol=1e-6 * p.max())
        np.testing.assert_allclose(h, h[::-1], rtol=0, atol=1e-6 * max(h.max(), 1e-300))
    corner = [s.pressure_mpa[s.pressure_mpa > 0.0][0] for s in states]
    middle = [s.pressure_mpa[s.grid.nodes // 2] for s in states]
    # (late states are uniform to the tolerance, 1e-4)
    assert all(b < a * (1 + 1e-4) for a, b in itertools.pairwise(corner))
    assert all(b > a * (1 - 1e-4) for a, b in itertools.pairwise(middle))
    last = states[-1].pressure_mpa
    on = last > 0.0
    # P'/2a, with the corners' two half hats (h/a = 0.02) in a
    assert np.ptp(last[on]) < 1e-3 * last.max()
    assert last.max() == pytest.approx(LOAD / 1.0, rel=0.011)


def write_rough(folder, *, rows, shortest=0.015):
    """Roughness on the cylinder: its table, and the line that names it."""
    table = np.linspace(-0.9, 0.9, rows)
    heights = rough(table, 4, height=1.5e-4, shortest=shortest)
    return table, heights, f"radius_mm = {RADIUS}\n" + write_profile(folder, table, heights)


@pytest.mark.long
def test_rough_profile_wears_its_tens_of_patches_together(tmp_path):
    """Goes wrong: contact leaves a patch half worn, a new patch is overstepped, volume is lost."""
    table, heights, line = write_rough(tmp_path, rows=451)  # twice the spacing apart
    text = worn([0.0, 1.0, 5.0, 20.0, 77.0, 233.0], spacing=0.002, window=1.7, friction=0.25)
    states = contact_states(contact_scene(text, indenter=line, folder=tmp_path))
    count = [patches(s.pressure_mpa) for s in states]
    # the scar's middle is one patch in the end; an outer hill may yet touch by itself
    assert count[0] >= 20 and count[-1] <= 3
    size = [int(np.count_nonzero(s.pressure_mpa)) for s in states]
    assert all(b > a for a, b in itertools.pairwise(size)) and size[-1] > 2.0 * size[0]
    for state in states:
        x, p, h = state.grid.x_mm, state.pressure_mpa, state.wear_depth_mm
        gap = np.interp(x, table, heights) + x**2 / (2.0 * RADIUS) + h
        # solved to a residual of 1e-9 at every output
        assert violation(x, p, gap, LOAD, coupling=COUPLING, friction=0.25) < 1e-7
        assert_worn_area(state)
        assert h.min() >= 0.0
    for one, other in itertools.pairwise(states):
        assert (other.wear_depth_mm >= one.wear_depth_mm - 1e-12).all()
        # what bears is worn, once it has slid
        assert (other.wear_depth_mm[other.pressure_mpa > 0.01 * other.p_max_mpa] > 0.0).all()
    # ten times the wear that levels the roughness: the smooth cylinder's scar is left, but for
    # 2e-4 mm of roughness over the gap's slope of 0.026 at each edge
    smooth = contact_states(contact_scene(worn([233.0], spacing=0.002, window=1.7, friction=0.25)))
    assert states[-1].contact_width_mm == pytest.approx(smooth[0].contact_width_mm, rel=0.015)


def assert_worn_area(state, tolerance=1e-9):
    """Worn area k P' s: the sum of what each step wore, or right to the scene's tolerance."""
    area = WEAR * LOAD * 1e3 * state.distance_m
    assert state.worn_area_mm2 == pytest.approx(area, rel=tolerance, abs=1e-300)


def test_rough_wear_is_that_of_brute_force(tmp_path):
    """Goes wrong: steps fit for a smooth contact jump over hills that meet in between."""
    table, heights, line = write_rough(tmp_path, rows=181, shortest=0.03)  # as above
    text = worn([2.0], spacing=0.005, window=1.5, tolerance=1e-5)
    (state,) = contact_states(contact_scene(text, indenter=line, folder=tmp_path))
    x = state.grid.x_mm
    truth = brute_force(
        x, [2.0], (MODULUS, 0.0), table=([0.0], [0.0]), rough=np.interp(x, table, heights),
        steps_per_m=100,
    )  # fmt: skip
    ((p, depth),) = truth
    assert patches(p) >= 6
    # Euler at a hundredth of its limit errs by some 1e-3 of what is worn there
    assert np.abs(state.wear_depth_mm - depth).max() < 3e-3 * depth.max()
    assert state.p_max_mpa == pytest.approx(p.max(), rel=3e-3)


FORTH = "{ distance_m = [0.0, 120.0, 233.0], value = [0.25, 0.25, -0.25] }"
CORK = (2.1, 0.0, 210.0, 0.5)


def turning(table, distances=(0.0, 60.0, 120.0, 176.5, 200.0, 233.0), **options):
    options = {"spacing": 0.005, "window": 1.8} | options
    return contact_states(contact_scene(worn(distances, friction=table, **options), pair=CORK))


def test_friction_is_the_tables_at_every_distance_where_nothing_wears():
    """Goes wrong: without wear all distances are the same dose, and share one state's friction."""
    states = turning(FORTH, k=0.0)
    modulus, coupling, _ = constants(*CORK)
    for state in states:
        x, p = state.grid.x_mm, state.pressure_mpa
        mu = np.interp(state.distance_m, [0.0, 120.0, 233.0], [0.25, 0.25, -0.25])
        assert state.friction == pytest.approx(mu, abs=1e-14)
        found = violation(
            x, p, x**2 / (2.0 * RADIUS), LOAD, modulus=modulus, coupling=coupling, friction=mu
        )
        assert found < 1e-7 and not state.wear_depth_mm.any()


def test_reversed_friction_wears_as_brute_force_says():
    """Goes wrong: friction between two states is not the table's, and the scar leans wrongly."""
    distances = (120.0, 233.0)
    states = turning(FORTH, distances, spacing=0.02, tolerance=1e-5)
    x = states[0].grid.x_mm
    truth = brute_force(
        x, distances, constants(*CORK)[:2], table=([0, 120, 233], [0.25, 0.25, -0.25])
    )
    for state, (p, depth) in zip(states, truth, strict=True):
        # Euler's first-order error at 4000 steps is some 1e-4; 4e-4 is measured, and 2e-3 on a node
        # beside an edge, of which the brute force knows no more than between which nodes it lies
        error = np.abs(state.wear_depth_mm - depth) / depth.max()
        left, right = state.edges_mm
        assert error[(x > left + 0.03) & (x < right - 0.03)].max() < 1e-3
        assert error.max() < 3e-3
        middle = np.abs(x) < 0.25
        assert np.abs(state.pressure_mpa - p)[middle].max() < 2e-3 * p.max()
    lean = states[1].wear_depth_mm - states[1].wear_depth_mm[::-1]
    assert np.abs(lean).max() > 0.02 * states[1].wear_depth_mm.max()


def brute_force(x, distances, moduli, *, table, rough=0.0, steps_per_m=17):
    """Explicit Euler steps with a dense matrix and plain elimination, friction as the table's."""
    modulus, coupling = moduli
    h = x[1] - x[0]
    normal = influence(x, modulus=modulus)
    tilt = influence(x, modulus=modulus, coupling=coupling, friction=1.0) - normal
    gap = x**2 / (2.0 * RADIUS) + rough
    depth, active, slid = np.zeros(len(x)), np.abs(x) < 0.4, 0.0
    for distance in distances:
        steps = int(steps_per_m * (distance - slid))
        size = (distance - slid) / steps
        for i in range(steps + 1):
            mu = np.interp(slid + i * size, *table)
            p, active = eliminated(normal + mu * tilt, gap + depth, active, h)
            if i < steps:
                depth = depth + 1e3 * WEAR * size * p
        slid = distance
        yield p, depth


def test_a_state_does_not_depend_on_which_others_are_asked_for_when_friction_turns():
    """Goes wrong: friction is followed only at the asked distances, so that one alone sees it flat.

    The table is the scene's: what happened between two frames happened, whether shown or not.
    """
    alone = turning(FORTH, (233.0,))[0]
    among = turning(FORTH)[-1]
    # each within the tolerance, 1e-4, of the truth
    scale = among.wear_depth_mm.max()
    assert np.abs(alone.wear_depth_mm - among.wear_depth_mm).max() < 1e-3 * scale
    assert alone.p_max_mpa == pytest.approx(among.p_max_mpa, rel=5e-4)


def test_friction_of_five_wears_without_hanging_and_holds_its_conditions():
    """Goes wrong: far beyond any real friction a solver loops; it must end, rightly or refused."""
    text = worn([0.0, 31.0, 233.0], friction=5.0, spacing=0.006)
    states = contact_states(contact_scene(text, pair=CORK))
    modulus, coupling, _ = constants(*CORK)
    for state in states:
        x, p = state.grid.x_mm, state.pressure_mpa
        gap = x**2 / (2.0 * RADIUS) + state.wear_depth_mm
        found = violation(x, p, gap, LOAD, modulus=modulus, coupling=coupling, friction=5.0)
        assert found < 1e-7


@pytest.mark.parametrize("distances", [[0.0], [0.0, 0.0], [1e-9], [1e-9, 1e-9, 0.0]])
def test_no_distance_at_all_or_a_nanometre_is_the_unworn_contact(distances):
    """Goes wrong: a first step divides by nothing, or is longer than all that was asked for."""
    states = contact_states(contact_scene(worn(distances, spacing=0.004)))
    plain = contact_states(contact_scene("[numerics]\nspacing_mm = 0.004"))[0]
    for state in states:
        # to the scene's tolerance
        assert state.p_max_mpa == pytest.approx(plain.p_max_mpa, rel=1e-4)
        # h = k p s: 2e-9 times 1e-6 mm times 19 MPa
        depth = WEAR * 1e3 * state.distance_m * plain.p_max_mpa
        assert state.wear_depth_mm.max() == pytest.approx(depth, rel=1e-4, abs=1e-300)
