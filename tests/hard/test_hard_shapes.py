"""Hard cases of a static contact: corners, coupling at its limit, roughness, ledges, any N."""

import numpy as np
import pytest

from hard.hard_cases import (
    COUPLING,
    FLAT,
    LOAD,
    MODULUS,
    RADIUS,
    constants,
    contact_scene,
    cylinder,
    numerics,
    patches,
    rough,
    violation,
    write_profile,
)
from isochrome.contact import contact_states, solve_pressure
from isochrome.reference import coupled_contact, coupled_pressure, punch_pressure


def flat_error(spacing):
    """Largest relative error of a flat's pressure inside 0.9 a, and of the load left of each x."""
    (state,) = contact_states(contact_scene(numerics(spacing=spacing), indenter=FLAT))
    x, p, h = state.grid.x_mm, state.pressure_mpa, state.grid.spacing_mm
    inside = np.abs(x) < 0.45
    exact = punch_pressure(x[inside], half_width_mm=0.5, line_load_n_per_mm=LOAD)
    carried = h * (np.cumsum(p) - 0.5 * p)
    true = LOAD * (0.5 + np.arcsin(np.clip(x / 0.5, -1.0, 1.0)) / np.pi)
    return (
        np.abs(p[inside] / exact - 1.0).max(), np.abs(carried - true)[inside].max() / LOAD, state,
    )  # fmt: skip


def test_flat_with_corners_carries_its_load_as_the_closed_form_does():
    """Goes wrong: the infinite corner pressure spoils the inside, or takes too much of the load."""
    coarse, coarse_load, _ = flat_error(0.01)
    fine, fine_load, state = flat_error(0.005)
    # the corner's hat reaches past it, which makes the flat wider by less than half a spacing d:
    # first order, halved with the spacing; at 0.9 a, p then errs by (d/a)/(1 - 0.9²) of itself and
    # the load by 0.9 (d/a)/(pi sqrt(1 - 0.9²)) of the whole
    assert fine < 0.5 * 0.01 / 0.19
    assert fine_load < 0.5 * 0.01 * 0.9 / (np.pi * np.sqrt(0.19))
    assert 1.8 < coarse / fine < 2.2 and 1.8 < coarse_load / fine_load < 2.2
    x, p = state.grid.x_mm, state.pressure_mpa
    gap = np.where(np.abs(x) > 0.5 + 1e-9, 1e3, 0.0)
    # the pressure in the solver's tolerance; symmetric, largest at the corners, none outside them
    assert violation(x, p, gap, LOAD) < 1e-8
    np.testing.assert_allclose(p, p[::-1], rtol=0, atol=1e-7 * p.max())
    assert np.argmax(p) in (np.flatnonzero(p > 0)[0], np.flatnonzero(p > 0)[-1])
    assert np.abs(x[p > 0]).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 10.0])
def test_flats_pressure_is_the_load_times_one_shape(factor):
    """Goes wrong: 1000 mm stand for 'no contact' beyond the corners, and swamp a tiny indent."""
    rest = numerics(spacing=0.01)
    (one,) = contact_states(contact_scene(rest, indenter=FLAT))
    (other,) = contact_states(contact_scene(rest, indenter=FLAT, load=44.0 * factor))
    # both of residual 1e-10 or better
    np.testing.assert_allclose(
        other.pressure_mpa / factor, one.pressure_mpa, rtol=0, atol=1e-7 * one.p_max_mpa
    )


COUPLED = {  # Young's moduli (GPa) and Poisson's ratios of block and cylinder, and mu beta
    "nearly incompressible block": ((2.1, 0.4999, 210.0, 0.3), 1.0),
    "incompressible block": ((2.1, 0.5, 210.0, 0.3), 1.0),
    "incompressible block, cork cylinder as stiff": ((3.0, 0.5, 2.0, 0.0), 1.0),
    "nearly incompressible block, cork cylinder": ((3.0, 0.4999, 2.0, 0.0), -1.0),
    "cork block, rigid cylinder: beta = 1/2": ((2.1, 0.0, 2.1e9, 0.5), 1.0),
    "the same, reversed": ((2.1, 0.0, 2.1e9, 0.5), -1.0),
    "rigid incompressible block, cork cylinder: beta = -1/2": ((2.1e9, 0.5, 2.1, 0.0), 1.0),
    "friction 5 on cork, mu beta = 5/2": ((2.1, 0.0, 2.1e9, 0.5), 5.0),
}


@pytest.mark.parametrize(("pair", "friction"), COUPLED.values(), ids=COUPLED)
def test_incompressible_against_compressible_is_the_coupled_closed_form(pair, friction):
    """Goes wrong: the operator is far from symmetric, and conjugate gradients wander or stop."""
    scene = contact_scene(f"[friction]\ncoefficient = {friction}", pair=pair)
    modulus, coupling, beta = constants(*pair)
    exact = coupled_contact(LOAD, RADIUS, modulus, friction=friction, beta=beta)
    (state,) = contact_states(scene)
    x, p, h = state.grid.x_mm, state.pressure_mpa, state.grid.spacing_mm
    gap = x**2 / (2.0 * RADIUS)
    assert violation(x, p, gap, LOAD, modulus=modulus, coupling=coupling, friction=friction) < 1e-8
    # h = a/350. The largest pressure is smooth there: second order, measured 8e-7. An edge between
    # nodes costs the root's (h/a)^1.5 = 1.5e-4 inside, more with the exponent 1/2 - eps of the
    # steeper edge
    a, e = exact.half_width_mm, abs(exact.exponent)
    inside = np.abs(x - exact.centre_mm) < 0.9 * a
    assert state.p_max_mpa == pytest.approx(exact.peak_pressure_mpa, rel=3e-6)
    error = np.abs(p - coupled_pressure(x, exact))[inside].max()
    assert error < 0.5 * (h / a) ** (1.0 - e) * exact.peak_pressure_mpa
    # the shift, from edges that are known to a node at worst
    assert sum(state.edges_mm) / 2.0 == pytest.approx(exact.centre_mm, abs=h)
    assert state.contact_width_mm == pytest.approx(2.0 * a, abs=2.0 * h)


@pytest.mark.parametrize("name", [k for k in COUPLED if "beta" in k])
def test_pressure_leaves_each_edge_with_the_exponent_of_the_closed_form(name):
    """Goes wrong: a symmetrised operator gives the right load and width, but two equal edges."""
    pair, friction = COUPLED[name]
    modulus, _, beta = constants(*pair)
    exact = coupled_contact(LOAD, RADIUS, modulus, friction=friction, beta=beta)
    (state,) = contact_states(contact_scene(f"[friction]\ncoefficient = {friction}", pair=pair))
    a = exact.half_width_mm
    s = np.geomspace(0.05, 0.5, 30) * a
    left, right = (
        np.interp(exact.centre_mm + place, state.grid.x_mm, state.pressure_mpa)
        for place in (s - a, a - s)
    )
    # p(-a+s)/p(a-s) = (s/(2a-s))^(-2 eps), whatever the scale
    slope = np.polyfit(np.log(s / (2.0 * a - s)), np.log(left / right), 1)[0]
    # what an edge between two nodes leaves from 17 nodes inside on; measured 4.5e-6
    assert slope == pytest.approx(-2.0 * exact.exponent, abs=2e-5)


@pytest.mark.parametrize("friction", [0.25, 1.0, -1.0])
def test_sliding_flat_leans_to_one_corner_as_the_closed_form_does(friction):
    """p = P' cos(pi e)/(pi sqrt(a² - x²)) ((a - x)/(a + x))^e, tan(pi e) = mu beta, moving to -x:
    Johnson (1985), 2.8(b). Goes wrong: both corners press alike."""
    pair = (2.1, 0.0, 2.1e9, 0.5)  # beta = 1/2
    rest = f"[friction]\ncoefficient = {friction}\n"
    errors = []
    for spacing in (0.005, 0.0025):
        scene = contact_scene(rest + numerics(spacing=spacing), indenter=FLAT, pair=pair)
        (state,) = contact_states(scene)
        x = state.grid.x_mm
        inside = np.abs(x) < 0.4
        t = x[inside] / 0.5
        e = np.arctan(0.5 * friction) / np.pi
        exact = LOAD * np.cos(np.pi * e) / (0.5 * np.pi * np.sqrt(1.0 - t**2))
        exact *= ((1.0 - t) / (1.0 + t)) ** e
        errors.append(np.abs(state.pressure_mpa[inside] / exact - 1.0).max())
    # first order, from the corner's hats, of which the sharper one weighs more: (1/2 + e) h/a
    # at t = 0.8, over 1 - t
    assert 1.8 < errors[0] / errors[1] < 2.2
    assert errors[1] < (0.5 + abs(e)) * 0.005 / 0.2


@pytest.mark.parametrize("friction", [2.0, 5.0, -5.0])
def test_friction_far_beyond_the_flats_limit_ends_rightly(friction):
    """Goes wrong: at mu beta = 5/2 the corner's pressure runs away and the contact sets cycle."""
    pair = (2.1, 0.0, 2.1e9, 0.5)
    rest = f"[friction]\ncoefficient = {friction}\n" + numerics(spacing=0.01)
    (state,) = contact_states(contact_scene(rest, indenter=FLAT, pair=pair))
    modulus, coupling, _ = constants(*pair)
    x, p = state.grid.x_mm, state.pressure_mpa
    gap = np.where(np.abs(x) > 0.5 + 1e-9, 1e3, 0.0)
    pair = {"modulus": modulus, "coupling": coupling, "friction": friction}
    assert violation(x, p, gap, LOAD, **pair) < 1e-8


def test_reversed_friction_mirrors_any_profiles_mirrored_pressure(tmp_path):
    """Goes wrong: a sign or half a node is lost in the coupling, and forth is not back."""
    x = np.linspace(-2.0, 2.0, 201)
    gap = 1e-3 * np.cumsum(np.random.default_rng(7).normal(size=201)) * 0.3
    forward = write_profile(tmp_path, x, gap, "forward.csv")
    back = write_profile(tmp_path, x, gap[::-1], "back.csv")
    shape = f"radius_mm = {RADIUS}\n"
    pair = (2.1, 0.0, 210.0, 0.5)
    one, other = (
        contact_states(
            contact_scene(
                f"[friction]\ncoefficient = {mu}", indenter=shape + line, pair=pair, folder=tmp_path
            )
        )[0]
        for mu, line in ((1.0, forward), (-1.0, back))
    )
    # two solutions of residual 1e-10
    np.testing.assert_allclose(
        other.pressure_mpa, one.pressure_mpa[::-1], rtol=0, atol=1e-7 * one.p_max_mpa
    )
    assert np.ptp(one.pressure_mpa - one.pressure_mpa[::-1]) > 0.1 * one.p_max_mpa


ROUGH = {
    "on the cylinder": (f"radius_mm = {RADIUS}\n", 0.0, 5e-4),
    "on the cylinder, sliding": (f"radius_mm = {RADIUS}\n", 1.0, 5e-4),
    "on a flat": ("", 0.0, 3e-4),
    "on a flat, sliding": ("", -0.5, 3e-4),
}


@pytest.mark.parametrize(("body", "friction", "height"), ROUGH.values(), ids=ROUGH)
@pytest.mark.parametrize("seed", [0, 1])
def test_rough_profile_with_tens_of_patches_holds_every_condition(
    tmp_path, body, friction, height, seed
):
    """Goes wrong: a solver that stops early leaves tension, overlap or open 'contact'."""
    table = np.linspace(-1.0, 1.0, 1001)
    heights = rough(table, seed, height=height)
    if not body:  # a flat with rounded shoulders, so that the file's ends bear nothing
        heights = heights + 0.05 * np.clip(np.abs(table) - 0.8, 0.0, None)
    line = write_profile(tmp_path, table, heights)
    rest = numerics(spacing=0.001, window=1.9)
    if friction:
        rest = f"[friction]\ncoefficient = {friction}\n{rest}"
    (state,) = contact_states(contact_scene(rest, indenter=body + line, folder=tmp_path))
    x, p = state.grid.x_mm, state.pressure_mpa
    gap = np.interp(x, table, heights) + (x**2 / (2.0 * RADIUS) if body else 0.0)
    assert patches(p) >= 20
    # the solver's 1e-10, and the dense matrix' own rounding of 1e-16 n²
    assert violation(x, p, gap, LOAD, coupling=COUPLING, friction=friction) < 1e-8


@pytest.mark.parametrize("height", [1e-5, 2e-4, 5e-3])
@pytest.mark.parametrize("friction", [0.0, 1.0])
def test_ledge_in_the_profile_makes_a_jump_of_pressure_and_no_nonsense(tmp_path, height, friction):
    """Goes wrong: at a step the pressure jumps to a spike and to nothing: NaN, ringing, tension."""
    table = np.array([-2.0, 0.05, 0.05 + 1e-9, 2.0])
    heights = np.array([0.0, 0.0, height, height])
    line = f"radius_mm = {RADIUS}\n" + write_profile(tmp_path, table, heights)
    rest = f"[friction]\ncoefficient = {friction}" if friction else ""
    (state,) = contact_states(contact_scene(rest, indenter=line, folder=tmp_path))
    x, p = state.grid.x_mm, state.pressure_mpa
    assert np.isfinite(p).all()
    gap = np.interp(x, table, heights) + x**2 / (2.0 * RADIUS)
    assert violation(x, p, gap, LOAD, coupling=COUPLING, friction=friction) < 1e-8
    # the corner of the high side presses hardest, the foot of the step least
    edge = np.flatnonzero(x <= 0.05)[-1]
    assert p[edge] > p[edge - 5] and p[edge + 1] < p[edge + 6] + 1e-9
    # (a step of 1 % of a spacing is a slope to this grid, and may still touch)
    assert height == 1e-5 or p[edge + 1] == 0.0
    # a ledge higher than the whole indentation is a corner: all the load is left of it
    if height == 5e-3:
        assert not p[x > 0.05].any() and patches(p) == 1


@pytest.mark.parametrize("n", [509, 1024])
@pytest.mark.parametrize("factor", [1e-12, 1e-6, 1e6, 1e12])
def test_load_a_millionth_and_a_million_times_on_a_grid_that_scales_along(n, factor):
    """Goes wrong: an absolute threshold somewhere takes a small number for none."""
    x, surface, gap = cylinder(n, 0.8 * np.sqrt(factor), coupling_per_mpa=COUPLING)
    h = x[1] - x[0]
    state = solve_pressure(surface, gap, LOAD * factor, friction=0.25)
    beta = 0.25 * MODULUS * COUPLING
    exact = coupled_contact(LOAD * factor, RADIUS, MODULUS, friction=0.25, beta=beta)
    # a ~ sqrt P', p0 ~ sqrt P'
    assert exact.peak_pressure_mpa == pytest.approx(np.sqrt(factor) * 18.7555, rel=1e-5)
    assert state.residual <= 1e-10
    assert state.pressure.max() == pytest.approx(
        exact.peak_pressure_mpa, rel=0.2 * (h / exact.half_width_mm) ** 1.5
    )
    centre = (x @ state.pressure) / state.pressure.sum()
    p = coupled_pressure(x, exact)
    assert centre == pytest.approx((x @ p) / p.sum(), abs=1e-3 * exact.half_width_mm)
