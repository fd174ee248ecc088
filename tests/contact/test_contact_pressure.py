"""The contact solver against closed forms, quadrature, and the contact's own conditions."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from hard.hard_cases import COUPLING, HALF_WIDTH, LOAD, MODULUS, PEAK, RADIUS, influence, parabola
from isochrome.contact import displacement, make_surface, solve_pressure
from isochrome.errors import PhysicsError
from isochrome.reference import hertz_pressure, wedge_half_width, wedge_pressure


def solved(gap, n, *, half=0.8, load=LOAD, coupling=0.0, modulus=MODULUS, **options):
    """Nodes, spacing and solution of a gap function on n nodes over -half .. half."""
    x = np.linspace(-half, half, n)
    h = x[1] - x[0]
    surface = make_surface(n, h, contact_modulus_mpa=modulus, coupling_per_mpa=coupling)
    return x, h, solve_pressure(surface, gap(x), load, **options)


def assert_contact_conditions(state, h, load, wear=0.0):
    """p >= 0, gap >= 0, p gap = 0 and the load, each to rounding or to the solver's target."""
    # the size of the elastic displacement, and of what is worn (mm/MPa) in the same equations
    reach = load / MODULUS + wear * state.pressure.max()
    assert state.residual <= 1e-10
    assert state.pressure.min() >= 0.0
    assert state.gap[state.pressure == 0.0].min(initial=0.0) >= -1e-9 * reach
    assert np.abs(state.gap[state.pressure > 0.0]).max() <= 1e-9 * reach
    # a sum of n rounded numbers
    assert h * state.pressure.sum() == pytest.approx(load, rel=1e-12)


@pytest.mark.parametrize("lag", [1, 2, 7, 19, 20, 21, 150])
def test_a_hats_displacement_is_the_integral_of_the_logarithm(lag):
    """Less that at lag 0: a constant is the approach's. From lag 20 on the kernel is a series."""
    h = 0.013
    surface = make_surface(200, h, contact_modulus_mpa=2.0 / np.pi)
    u = -displacement(surface, np.eye(200)[0])

    def integral(lag):
        def integrand(t):
            return (1 - abs(t) / h) * np.log(abs(lag * h - t))

        pairs = itertools.pairwise(sorted({-h, 0.0, h, min(lag * h, h)}))
        options = {"epsabs": 1e-15, "epsrel": 1e-13, "limit": 200}
        return sum(quad(integrand, a, b, **options)[0] for a, b in pairs)

    # the singular end costs quad some digits at lags 0 and 1
    assert u[lag] - u[0] == pytest.approx(integral(lag) - integral(0), rel=1e-11)


@pytest.mark.parametrize("n", [201, 801])
def test_a_layer_on_a_rigid_body_is_winklers_foundation(n):
    """p = (a^2 - x^2) / (2 R c), a^3 = 3 R c P' / 2: Johnson (1985), section 4.3."""
    layer = 1e-3
    half = (1.5 * RADIUS * layer * LOAD) ** (1 / 3)
    x, h, state = solved(parabola, n, half=2 * half, modulus=1e6 * MODULUS, layer_mm_per_mpa=layer)
    want = np.maximum(half**2 - x**2, 0.0) / (2 * RADIUS * layer)
    # the edges lie between nodes, where the pressure has a slope: an error of second order
    assert state.pressure == pytest.approx(want, abs=2 * (h / half) ** 2 * want.max())
    assert h * state.pressure.sum() == pytest.approx(LOAD, rel=1e-12)


def test_a_layer_that_gives_way_little_leaves_hertz_with_an_error_of_its_compliance():
    off = []
    for layer in (0.0, 1e-7, 2e-7):
        _, _, state = solved(parabola, 801, layer_mm_per_mpa=layer)
        off.append(state.pressure.max())
    # its first order: half of the compliance, half of the change
    assert off[1] - off[0] == pytest.approx(0.5 * (off[2] - off[0]), rel=0.02)
    assert off[2] < off[0]


@pytest.mark.parametrize("n", [17, 64, 101, 257])
@pytest.mark.parametrize("friction", [0.0, 0.7])
def test_displacement_is_the_direct_sum_of_hats(n, friction):
    h = 0.01
    surface = make_surface(n, h, contact_modulus_mpa=MODULUS, coupling_per_mpa=COUPLING)
    p = np.random.default_rng(n).random(n)
    u = influence(h * np.arange(n), coupling=COUPLING, friction=friction) @ p
    got = displacement(surface, p, friction=friction)
    # an additive constant is the approach's; rounding of sums of n terms, and of the cancelling
    # second difference: 1e-16 (L/h)² of the kernel
    difference = got - u
    assert np.ptp(difference) <= 1e-11 * np.ptp(u)


def test_displacement_of_several_pressures_is_that_of_each():
    surface = make_surface(65, 0.02, contact_modulus_mpa=MODULUS)
    p = np.random.default_rng(0).random((3, 65))
    each = np.stack([displacement(surface, row) for row in p])
    np.testing.assert_allclose(displacement(surface, p), each, rtol=0, atol=1e-17)


@pytest.mark.parametrize("n", [16, 17, 65, 128, 255, 256, 257, 401, 1021, 1601, 4093, 16384])
def test_hertz_contact_holds_its_conditions_and_peak(n):
    """Hard case: odd, prime and large grids, and those on either side of the coarse start."""
    _, h, state = solved(parabola, n)
    assert_contact_conditions(state, h, LOAD)
    # the peak converges as (h/a)^1.5 or better, whatever the edge's place between nodes; the
    # factor covers the worst place on the coarsest grid
    share = 0.2 if n < 65 else 0.1
    assert state.pressure.max() == pytest.approx(PEAK, rel=share * (h / HALF_WIDTH) ** 1.5)
    width = h * np.count_nonzero(state.pressure)
    assert width == pytest.approx(2 * HALF_WIDTH, abs=2 * h)


def test_hertz_pressure_converges_with_order_three_halves_away_from_the_edge():
    """Error in p on |x| < 0.9a, averaged over places of the edge between nodes."""
    errors = []
    sizes = (101, 201, 401, 801)
    for n in sizes:
        worst = 0.0
        for shift in np.linspace(0.0, 0.9, 6):
            x, _, state = solved(parabola, n, half=0.8 * (1 + shift / n))
            exact = hertz_pressure(x, half_width_mm=HALF_WIDTH, peak_pressure_mpa=PEAK)
            inside = np.abs(x) < 0.9 * HALF_WIDTH
            worst = max(worst, np.abs(state.pressure - exact)[inside].max() / PEAK)
        errors.append(worst)
    order = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    # an edge between nodes errs by h of its place in a root: h^1.5 inside
    assert order > 1.4
    assert errors[-1] < 1e-4


def test_the_pressure_does_not_depend_on_where_the_solver_starts():
    """Nor on a start without any pressure, which a forecast that left no contact may be."""
    x, _, usual = solved(parabola, 301, coupling=COUPLING, friction=0.5)
    noise = np.random.default_rng(0).random(301)
    beside = np.where(x > 0.5, 1.0, 0.0)
    for start in (noise, beside, np.ones(301), np.eye(301)[150], np.zeros(301)):
        _, _, other = solved(parabola, 301, coupling=COUPLING, friction=0.5, start=start)
        # two solutions of residual 1e-10
        np.testing.assert_allclose(other.pressure, usual.pressure, rtol=0, atol=1e-7 * PEAK)


def test_wedge_has_its_width_and_logarithmic_pressure():
    slope = 0.01
    a = wedge_half_width(LOAD, slope=slope, contact_modulus_mpa=MODULUS)
    x, h, state = solved(lambda x: slope * np.abs(x), 1601)
    assert_contact_conditions(state, h, LOAD)
    assert h * np.count_nonzero(state.pressure) == pytest.approx(2 * a, abs=2 * h)
    away = np.abs(x) > 0.1 * a
    exact = wedge_pressure(x[away], half_width_mm=a, slope=slope, contact_modulus_mpa=MODULUS)
    # first order: the tip's infinite pressure is cut off at a node
    assert np.abs(state.pressure[away] - exact).max() < 3 * h / a * exact.max()


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(16, 300), load=st.floats(1e-3, 1e3),
    friction=st.floats(-1.0, 1.0), wear=st.sampled_from([0.0, 1e-6, 1e-3]),
)  # fmt: skip
def test_every_contact_holds_its_conditions(seed, n, load, friction, wear):
    """Any gap, load, friction and wear diagonal: p >= 0, gap >= 0, p gap = 0 and the load."""
    gap = np.random.default_rng(seed).random(n).cumsum() * 1e-3
    gap += np.linspace(-1, 1, n) ** 2 * 0.01
    h = 1.0 / n
    surface = make_surface(n, h, contact_modulus_mpa=MODULUS, coupling_per_mpa=2 / MODULUS)
    state = solve_pressure(surface, gap, load, friction=friction, layer_mm_per_mpa=wear)
    assert_contact_conditions(state, h, load, wear)
    # and the gap is the one of that pressure
    made = gap + displacement(surface, state.pressure, friction=friction) + wear * state.pressure
    assert np.ptp(made - state.gap) <= 1e-9 * (np.ptp(gap) + load / MODULUS)


def test_a_tolerance_below_rounding_is_refused_and_does_not_hang():
    x = np.linspace(-0.8, 0.8, 300)
    surface = make_surface(300, x[1] - x[0], contact_modulus_mpa=2473.0)
    with pytest.raises(PhysicsError, match=r"refine numerics\.spacing_mm") as refusal:
        solve_pressure(surface, x**2 / 49.22, 11.0, tolerance=1e-30)
    # friction is not to blame where there is none
    assert "friction.coefficient" not in str(refusal.value)
