"""Hard cases of wear: long steps, corners, roughness, reversed friction, odd lists of distances."""

import itertools

import numpy as np
import pytest
from hard_cases import (
    COUPLING,
    FLAT,
    LOAD,
    MODULUS,
    RADIUS,
    WEAR,
    contact_scene,
    influence,
    patches,
    violation,
    worn,
    write_profile,
)

from isochrome.benchmarks import load_benchmarks
from isochrome.contact import contact_states

# --- steps beyond the explicit limit ------------------------------------------------------------


@pytest.mark.long
def test_where_500_mm_steps_double_the_papers_pressure_ours_is_right():
    """Goes wrong: 4096 elements and 500 mm: the largest pressure doubles and nothing warns."""
    paper = load_benchmarks("paper_procedure")
    elements = paper.make_elements(4096, 0.8, contact_modulus_mpa=MODULUS)
    gap = elements.x_mm**2 / (2.0 * RADIUS)
    assert paper.explicit_limit_mm(elements.dx_mm, WEAR, MODULUS) < 500.0 / 4.0
    unworn = paper.solve(elements, gap, LOAD).pressure.max()
    ((explicit, _),) = paper.wear(elements, gap, LOAD, WEAR, [8.0], step_mm=500.0)
    assert explicit.max() > 2.0 * unworn

    fine = contact_states(contact_scene(worn([8.0], spacing=1.6 / 4095, window=1.6)))[0]
    coarse = contact_states(contact_scene(worn([8.0], spacing=0.004, window=1.6)))[0]
    assert 4090 <= fine.grid.nodes <= 4100
    # one run on the mesh, carried to two grids: second order in the coarse one's h/a, measured 1e-5
    assert fine.p_max_mpa == pytest.approx(coarse.p_max_mpa, rel=3e-5)
    assert fine.wear_depth_mm.max() == pytest.approx(coarse.wear_depth_mm.max(), rel=3e-5)
    # the paper's own method within its limit, on elements coarse enough for 40 mm to be short
    small = paper.make_elements(401, 0.8, contact_modulus_mpa=MODULUS)
    short = paper.wear(
        small, small.x_mm**2 / (2.0 * RADIUS), LOAD, WEAR, [8.0], step_mm=40.0, tolerance=1e-8
    )[0][0]
    # the scene's tolerance; measured 5e-6
    assert fine.p_max_mpa == pytest.approx(short.max(), rel=1e-4)
    assert fine.p_max_mpa < unworn


# --- corners ------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("friction", [None, 0.25])
def test_worn_corners_follow_the_matrix_exponential(friction):
    """Goes wrong: a stiff corner node is overstepped, and its pressure rings about the truth."""
    distances = [0.0, 0.1, 1.0, 10.0, 100.0]
    states = flat_history(distances, friction=friction)
    assert [s.distance_m for s in states] == distances
    for state in states:
        on = state.pressure_mpa > 0.0
        assert np.abs(state.grid.x_mm[on]).max() == pytest.approx(0.5, abs=1e-9) and on.sum() == 101
        p, depth = exact_flat_wear(
            state.grid.x_mm[on], 1e3 * WEAR * state.distance_m, friction=friction or 0.0
        )
        # ten times the tolerance of 1e-4 inside, and more on the corner's own node
        assert np.abs(state.pressure_mpa[on] - p)[5:-5].max() < 1e-3 * p.max()
        assert np.abs(state.pressure_mpa[on] - p).max() < 5e-3 * p.max()
        assert np.abs(state.wear_depth_mm[on] - depth).max() <= 1e-3 * depth.max()


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_worn_corners_are_right_to_the_tolerance_asked_for(tolerance):
    """Goes wrong: numerics.tolerance holds under a cylinder, and is missed tenfold at a corner."""
    for state in flat_history([1.0, 10.0, 100.0], tolerance=tolerance):
        on = state.pressure_mpa > 0.0
        p, depth = exact_flat_wear(state.grid.x_mm[on], 1e3 * WEAR * state.distance_m)
        # as for the cylinder: p_max and the largest depth, and a tenth for the comparison
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


# --- roughness ----------------------------------------------------------------------------------


def write_rough(folder, *, rows, shortest=0.015, height=1.5e-4, seed=4):
    """Roughness on the cylinder, waves from 1 mm down: its table, and the line that names it."""
    table = np.linspace(-0.9, 0.9, rows)
    rng = np.random.default_rng(seed)
    k = np.arange(1, round(0.9 / shortest) + 1)
    phase = 2.0 * np.pi * (k[:, None] * table + rng.random(len(k))[:, None])
    wave = np.cos(phase) * rng.normal(size=len(k))[:, None] / np.sqrt(k)[:, None]
    heights = height * wave.sum(0)
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
        assert violation(x, p, gap, LOAD, coupling=COUPLING, friction=0.25).worst < 1e-7
        assert_worn_area(state)
        assert h.min() >= 0.0
    for one, other in itertools.pairwise(states):
        assert (other.wear_depth_mm >= one.wear_depth_mm - 1e-12).all()
        # what bears is worn, once it has slid
        assert (other.wear_depth_mm[other.pressure_mpa > 0.01 * other.p_max_mpa] > 0.0).all()
    # ten times the wear that levels the roughness: the smooth cylinder's scar is left
    smooth = contact_states(contact_scene(worn([233.0], spacing=0.002, window=1.7, friction=0.25)))
    assert states[-1].contact_width_mm == pytest.approx(smooth[0].contact_width_mm, rel=4e-3)


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


# --- friction that turns round ------------------------------------------------------------------

FORTH = "{ distance_m = [0.0, 120.0, 233.0], value = [0.25, 0.25, -0.25] }"
BACK = "{ distance_m = [0.0, 120.0, 233.0], value = [-0.25, -0.25, 0.25] }"
CORK = (2.1, 0.0, 210.0, 0.5)


def turning(table, distances=(0.0, 60.0, 120.0, 176.5, 200.0, 233.0), **options):
    options = {"spacing": 0.005, "window": 1.8} | options
    return contact_states(contact_scene(worn(distances, friction=table, **options), pair=CORK))


def test_friction_that_changes_sign_mirrors_when_its_table_does():
    """Goes wrong: the sign of friction is lost in wear, in the shear, or between the states."""
    forth, back = turning(FORTH), turning(BACK)
    mu = [0.25, 0.25, 0.25, 0.0, 0.25 - 0.5 * 80.0 / 113.0, -0.25]
    assert [s.friction for s in forth] == pytest.approx(mu, abs=1e-14)
    for one, other in zip(forth, back, strict=True):
        # the same steps up to rounding; each pressure to its residual
        scale = one.p_max_mpa
        np.testing.assert_allclose(
            other.pressure_mpa[::-1], one.pressure_mpa, rtol=0, atol=1e-5 * scale
        )
        np.testing.assert_allclose(other.shear_mpa[::-1], -one.shear_mpa, rtol=0, atol=1e-5 * scale)
        np.testing.assert_allclose(
            other.wear_depth_mm[::-1],
            one.wear_depth_mm,
            rtol=0,
            atol=1e-6 * max(one.wear_depth_mm.max(), 1e-300),
        )
    centres = [sum(s.edges_mm) / 2.0 for s in forth]
    assert centres[0] < -0.02 and centres[-1] > centres[2] + 0.01


def test_friction_is_the_tables_at_every_distance_where_nothing_wears():
    """Goes wrong: without wear all distances are the same dose, and share one state's friction."""
    states = turning(FORTH, k=0.0)
    moduli = pair_modulus()
    for state in states:
        x, p = state.grid.x_mm, state.pressure_mpa
        mu = np.interp(state.distance_m, [0.0, 120.0, 233.0], [0.25, 0.25, -0.25])
        assert state.friction == pytest.approx(mu, abs=1e-14)
        found = violation(
            x, p, x**2 / (2.0 * RADIUS), LOAD, modulus=moduli[0], coupling=moduli[1], friction=mu
        )
        assert found.worst < 1e-7 and not state.wear_depth_mm.any()


def test_reversed_friction_wears_as_brute_force_says():
    """Goes wrong: friction between two states is not the table's, and the scar leans wrongly."""
    distances = (120.0, 233.0)
    states = turning(FORTH, distances, spacing=0.02, tolerance=1e-5)
    x = states[0].grid.x_mm
    truth = brute_force(x, distances, pair_modulus(), table=([0, 120, 233], [0.25, 0.25, -0.25]))
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


def pair_modulus():
    from isochrome.reference import contact_modulus, coupling_modulus_inverse

    mpa = (1e3 * CORK[0], CORK[1], 1e3 * CORK[2], CORK[3])
    return contact_modulus(*mpa), coupling_modulus_inverse(*mpa)


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
            p, active = eliminate(normal + mu * tilt, gap + depth, h, active)
            if i < steps:
                depth = depth + 1e3 * WEAR * size * p
        slid = distance
        yield p, depth


def eliminate(matrix, gap, h, active):
    """Pressure on a contact set found by trial: tension leaves it, overlap joins it."""
    for _ in range(100):
        on = np.flatnonzero(active)
        system = np.zeros((len(on) + 1, len(on) + 1))
        system[:-1, :-1] = matrix[np.ix_(on, on)]
        system[:-1, -1], system[-1, :-1] = -1.0, h
        answer = np.linalg.solve(system, np.r_[-gap[on], LOAD])
        p = np.zeros(len(gap))
        p[on] = answer[:-1]
        wrong = (active & (p < 0.0)) | (~active & (gap + matrix @ p - answer[-1] < -1e-15))
        if not wrong.any():
            return p, active
        active = active ^ wrong
    raise AssertionError("no contact set holds")


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
    modulus, coupling = pair_modulus()
    for state in states:
        x, p = state.grid.x_mm, state.pressure_mpa
        gap = x**2 / (2.0 * RADIUS) + state.wear_depth_mm
        found = violation(x, p, gap, LOAD, modulus=modulus, coupling=coupling, friction=5.0)
        assert found.worst < 1e-7


# --- distances ----------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [None, 0.25])
def test_distances_unsorted_equal_and_zero_give_the_states_of_the_sorted_ones(friction):
    """Goes wrong: states come back in another order, or an equal distance wears twice."""
    asked = (155.0, 0.0, 31.0, 155.0, 77.0, 0.0, 31.0)
    options = {"friction": friction, "spacing": 0.006, "tolerance": 1e-3}
    states = contact_states(contact_scene(worn(asked, **options)))
    assert tuple(s.distance_m for s in states) == asked
    in_order = contact_states(contact_scene(worn(sorted(asked), **options)))
    once = {s.distance_m: s for s in in_order}
    for state in states:
        np.testing.assert_array_equal(state.wear_depth_mm, once[state.distance_m].wear_depth_mm)
        np.testing.assert_allclose(
            state.pressure_mpa, once[state.distance_m].pressure_mpa, rtol=0, atol=1e-7 * 19.0
        )
        assert_worn_area(state, tolerance=1e-3)
    for i, j in ((0, 3), (1, 5), (2, 6)):
        np.testing.assert_array_equal(states[i].wear_depth_mm, states[j].wear_depth_mm)
        np.testing.assert_allclose(
            states[i].pressure_mpa, states[j].pressure_mpa, rtol=0, atol=1e-7 * 19.0
        )
    unworn = contact_states(contact_scene(worn([0.0], **options)))[0]
    assert not states[1].wear_depth_mm.any()
    np.testing.assert_allclose(states[1].pressure_mpa.max(), unworn.pressure_mpa.max(), rtol=1e-3)


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
