"""Sliding line contacts: exact field without coupling; lean and shift with it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from isochrome import reference

PAIR = (2100.0, 0.4, 210000.0, 0.3)  # the paper's block and cylinder
MODULUS, BETA = reference.contact_modulus(*PAIR), reference.dundurs_beta(*PAIR)
LOAD, RADIUS = 11.0, 24.61
UNIT = {"half_width_mm": 1.0, "peak_pressure_mpa": 1.0}
FINE = {"epsabs": 1e-13, "epsrel": 1e-11}  # asked of QUADPACK
NAMES = ("sigma_x", "sigma_z", "tau_xz")
frictions = st.floats(-1.0, 1.0)


def contact(friction, beta=BETA):
    return reference.coupled_contact(LOAD, RADIUS, MODULUS, friction=friction, beta=beta)


def weighted(function, weight_powers, lower, upper):
    """∫ f(t) (t - lower)^α (upper - t)^β dt."""
    value, _ = quad(function, lower, upper, weight="alg", wvar=weight_powers, **FINE)
    return value


def displacement(x, c, beta):
    """u(x) into the block, from the definition with p and q = mu p, up to a constant.

    -(2/(π E*)) ∫ p ln|x - t| dt - (1/(2 G*)) ∫_x^{x2} q dt, and 1/(2 G*) = 2 beta / E*.
    """
    left, right = c.centre_mm - c.half_width_mm, c.centre_mm + c.half_width_mm
    behind, ahead = 0.5 - c.exponent, 0.5 + c.exponent

    def rest(t, power, edge_distance):
        """p(t) without the factor that the quadrature's weight holds."""
        return reference.coupled_pressure(t, c) / edge_distance(t) ** power

    def from_left(t):
        return rest(t, behind, lambda t: max(t - left, 1e-300))

    def from_right(t):
        return rest(t, ahead, lambda t: max(right - t, 1e-300))

    # the log of the distance to x is a weight of QUADPACK too: one side of x, then the other
    log_part = quad(from_left, left, x, weight="alg-logb", wvar=(behind, 0.0), **FINE)[0]
    log_part += quad(from_right, x, right, weight="alg-loga", wvar=(0.0, ahead), **FINE)[0]
    dragged = c.friction * weighted(from_right, (0.0, ahead), x, right)
    return -2.0 / (np.pi * MODULUS) * log_part - 2.0 * beta / MODULUS * dragged


@pytest.mark.parametrize("friction", [0.25, -0.7])
def test_sliding_stress_agrees_with_quadrature_of_both_tractions(assert_quadrature, friction):
    x, z = np.meshgrid([-2.0, -1.0, -0.6, 0.0, 0.3, 1.0, 1.7], [0.02, 0.3, 1.0, 4.0])
    field = reference.sliding_hertz_stress(x, z, friction=friction, **UNIT)
    tractions = {"half_width": 1.0, "powers": (0.5, 0.5), "friction": friction}
    assert_quadrature(field, x, z, **tractions, atol=1e-10)


def test_sliding_surface_carries_pressure_and_traction_and_is_pulled_behind():
    x, mu = np.linspace(-3.0, 3.0, 601), 0.25
    field = reference.sliding_hertz_stress(x, 0.0, friction=mu, **UNIT)
    p = reference.hertz_pressure(x, **UNIT)
    outside = np.sign(x) * np.sqrt(np.clip(x**2 - 1.0, 0.0, None))
    # some roundings of order one, and 1e-8 where the root at the edge meets a rounded x
    np.testing.assert_allclose(field.sigma_z, -p, atol=1e-14)
    np.testing.assert_allclose(field.tau_xz, -mu * p, atol=1e-14)
    np.testing.assert_allclose(field.sigma_x, -p - 2.0 * mu * (x - outside), atol=1e-7)
    edges = reference.sliding_hertz_stress([-1.0, 1.0], 0.0, friction=mu, **UNIT).sigma_x
    np.testing.assert_allclose(edges, [2.0 * mu, -2.0 * mu], rtol=1e-15)


@pytest.mark.parametrize(("friction", "beta"), [(0.25, BETA), (-0.25, BETA), (1.0, 0.5)])
def test_coupled_pressure_bends_the_surface_onto_the_parabola(friction, beta):
    c = contact(friction, beta)
    x = c.centre_mm + c.half_width_mm * np.linspace(-0.95, 0.95, 13)
    gap = [point**2 / (2.0 * RADIUS) + displacement(point, c, beta) for point in x]
    sag = c.half_width_mm**2 / (2.0 * RADIUS)
    # three quadratures, each good to 1e-11 of a displacement of some sags
    assert np.ptp(gap) < 1e-10 * sag


def test_coupled_contact_touches_only_where_the_gap_closes():
    c = contact(1.0, 0.4)
    left, right = c.centre_mm - c.half_width_mm, c.centre_mm + c.half_width_mm
    grid = np.linspace(-1.0, 1.0, 4001)
    p = reference.coupled_pressure(grid, c)
    assert np.array_equal(p > 0.0, (grid > left) & (grid < right))

    def slope(x):
        """Of the gap outside, x/R + u'(x): there q = 0 and the kernel is smooth."""
        pull, _ = quad(
            lambda t: c.scale_mpa * c.half_width_mm**-1.0 / (x - t), left, right, weight="alg",
            wvar=(0.5 - c.exponent, 0.5 + c.exponent),
        )  # fmt: skip
        return x / RADIUS - 2.0 / (np.pi * MODULUS) * pull

    assert slope(right + 0.05 * c.half_width_mm) > 0.0  # the gap opens away from both edges
    assert slope(left - 0.05 * c.half_width_mm) < 0.0


def test_the_papers_coupling_shifts_the_contact_backwards_by_ten_micrometres():
    c = contact(0.25)
    # digits of the checked physics notes
    assert c.exponent == pytest.approx(0.01287, abs=5e-6)
    assert c.centre_mm == pytest.approx(-0.0096, abs=5e-5)
    assert np.tan(np.pi * c.exponent) == pytest.approx(0.25 * BETA, rel=1e-13)


@given(mu=frictions, beta=st.floats(-0.5, 0.5))
@settings(max_examples=40, deadline=None)
def test_coupled_pressure_carries_the_load_and_peaks_where_it_says(mu, beta):
    c = contact(mu, beta)

    def one(t):
        return c.scale_mpa / c.half_width_mm

    powers = (0.5 - c.exponent, 0.5 + c.exponent)
    left, right = c.centre_mm - c.half_width_mm, c.centre_mm + c.half_width_mm
    assert weighted(one, powers, left, right) == pytest.approx(LOAD, rel=1e-10)  # quad's accuracy
    assert float(reference.coupled_pressure(c.peak_mm, c)) == pytest.approx(
        c.peak_pressure_mpa, rel=1e-13
    )
    found = minimize_scalar(
        lambda x: -float(reference.coupled_pressure(x, c)),
        bounds=(left, right),
        options={"xatol": 1e-10},
    )
    assert found.x == pytest.approx(c.peak_mm, abs=1e-6)  # a root of rounding, at a flat maximum


@pytest.mark.parametrize(("mu", "beta"), [(0.0, BETA), (0.25, 0.0)])
def test_without_friction_or_contrast_the_coupled_contact_is_hertz(mu, beta):
    c = contact(mu, beta)
    a = reference.hertz_half_width(LOAD, RADIUS, MODULUS)
    p0 = reference.hertz_peak_pressure(LOAD, RADIUS, MODULUS)
    assert (c.exponent, c.centre_mm) == (0.0, 0.0)
    assert c.half_width_mm == pytest.approx(a, rel=1e-15)
    assert c.peak_pressure_mpa == pytest.approx(p0, rel=1e-14)
    x, z = np.meshgrid(np.linspace(-3.0, 3.0, 61) * a, np.array([0.0, 1e-6, 0.1, 1.0, 9.0]) * a)
    coupled = reference.coupled_stress(x, z, c)
    plain = reference.sliding_hertz_stress(x, z, half_width_mm=a, peak_pressure_mpa=p0, friction=mu)
    for name in NAMES:
        # two ways to write the same root: roundings, and their root next to the edge
        np.testing.assert_allclose(
            getattr(coupled, name), getattr(plain, name), atol=1e-6 if name == "sigma_x" else 1e-7
        )


@pytest.mark.parametrize(("mu", "beta"), [(0.25, BETA), (-1.0, 0.5)])
def test_coupled_stress_agrees_with_quadrature_of_both_tractions(assert_quadrature, mu, beta):
    c = contact(mu, beta)
    a = c.half_width_mm
    ratio, depth = np.meshgrid([-7.0, -1.0, -0.6, 0.0, 0.3, 1.0, 1.7], [0.02, 0.3, 1.0, 5.0])
    powers = (0.5 - c.exponent, 0.5 + c.exponent)
    field = reference.coupled_stress(c.centre_mm + a * ratio, a * depth, c)
    tractions = {"half_width": 1.0, "powers": powers, "friction": mu, "scale": c.scale_mpa}
    assert_quadrature(field, ratio, depth, **tractions, atol=2e-9)  # the scale is 19 MPa


def test_coupled_surface_carries_pressure_and_traction():
    c = contact(0.4, 0.5)
    x = np.linspace(-0.6, 0.6, 241)
    field = reference.coupled_stress(x, 0.0, c)
    p = reference.coupled_pressure(x, c)
    np.testing.assert_allclose(field.sigma_z, -p, atol=1e-13)  # roundings of 19 MPa
    np.testing.assert_allclose(field.tau_xz, -0.4 * p, atol=1e-13)
    edges = reference.coupled_stress(c.centre_mm + c.half_width_mm * np.array([-1.0, 1.0]), 0.0, c)
    assert np.all(np.isfinite(edges.sigma_x))
    assert edges.sigma_x[0] > 0.0 > edges.sigma_x[1]


def test_far_from_the_coupled_contact_the_series_joins_the_closed_form_and_the_line_load():
    c = contact(0.8, 0.5)
    a = c.half_width_mm
    angle = np.radians([15.0, 60.0, 120.0, 165.0])
    inner, outer = 4.0 * (1.0 - 1e-9), 4.0 * (1.0 + 1e-9)
    near, beyond = (
        reference.coupled_stress(c.centre_mm + a * r * np.cos(angle), a * r * np.sin(angle), c)
        for r in (inner, outer)
    )
    for name in NAMES:
        # the field itself changes by 2e-9 of some MPa over the step
        np.testing.assert_allclose(getattr(near, name), getattr(beyond, name), atol=2e-8)
    r = 1e6
    far = reference.coupled_stress(a * r * np.cos(angle), a * r * np.sin(angle), c)
    radial = -2.0 * LOAD * (np.sin(angle) + 0.8 * np.cos(angle)) / (np.pi * a * r)
    # the pressure's centre of gravity lies some ε a off: relative 1e-6 here, with a margin
    np.testing.assert_allclose(far.sigma_x, radial * np.cos(angle) ** 2, rtol=1e-5)
    np.testing.assert_allclose(far.sigma_z, radial * np.sin(angle) ** 2, rtol=1e-5)
