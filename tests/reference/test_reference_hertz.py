"""Hertz line contact: constants of the pair, pressure, McEwen's stress field."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import minimize

from isochrome.reference import (
    contact_modulus,
    coupling_modulus_inverse,
    dundurs_beta,
    hertz_half_width,
    hertz_largest_difference,
    hertz_peak_pressure,
    hertz_pressure,
    hertz_stress,
)

PAIR = (2100.0, 0.4, 210000.0, 0.3)  # the paper's block and cylinder
UNIT = {"half_width_mm": 1.0, "peak_pressure_mpa": 1.0}
NAMES = ("sigma_x", "sigma_z", "tau_xz")
sizes = st.floats(1e-3, 1e3)


def test_the_papers_pair_has_the_papers_moduli():
    # the numbers in the checked physics notes carry this many digits
    assert contact_modulus(*PAIR) == pytest.approx(2473.2, abs=0.05)
    assert dundurs_beta(*PAIR) == pytest.approx(0.1618, abs=5e-5)
    assert 4 * dundurs_beta(*PAIR) == pytest.approx(
        contact_modulus(*PAIR) * coupling_modulus_inverse(*PAIR), rel=1e-15
    )


def test_the_papers_contact_has_the_checked_width_and_peak():
    e = contact_modulus(*PAIR)
    assert hertz_half_width(11.0, 24.61, e) == pytest.approx(0.37332, abs=5e-6)
    assert hertz_peak_pressure(11.0, 24.61, e) == pytest.approx(18.7584, abs=5e-5)


@given(young=sizes, nu=st.floats(0.0, 0.5), other=sizes, other_nu=st.floats(0.0, 0.5))
@settings(max_examples=100, deadline=None)
def test_swapping_the_bodies_keeps_contact_modulus_and_flips_the_coupling(
    young, nu, other, other_nu
):
    ahead, swapped = (young, nu, other, other_nu), (other, other_nu, young, nu)
    assert contact_modulus(*ahead) == pytest.approx(contact_modulus(*swapped), rel=1e-14)
    assert coupling_modulus_inverse(*ahead) == -coupling_modulus_inverse(*swapped)
    assert abs(dundurs_beta(*ahead)) <= 0.5


def test_like_materials_do_not_couple_and_a_rigid_indenter_adds_no_compliance():
    assert dundurs_beta(2100.0, 0.4, 2100.0, 0.4) == 0.0
    assert contact_modulus(2100.0, 0.4, np.inf, 0.3) == pytest.approx(2100.0 / 0.84, rel=1e-15)
    assert dundurs_beta(2100.0, 0.5, np.inf, 0.3) == 0.0  # an incompressible block


@given(load=sizes, radius=sizes, modulus=sizes)
@settings(max_examples=25, deadline=None)
def test_hertz_pressure_carries_the_line_load(load, radius, modulus):
    a, p0 = hertz_half_width(load, radius, modulus), hertz_peak_pressure(load, radius, modulus)
    carried, _ = quad(
        lambda angle: (
            a
            * np.cos(angle)
            * hertz_pressure(a * np.sin(angle), half_width_mm=a, peak_pressure_mpa=p0)
        ),
        -np.pi / 2,
        np.pi / 2,
    )
    assert carried == pytest.approx(load, rel=1e-10)  # adaptive quadrature of a smooth integrand


def test_hertz_pressure_is_zero_outside_and_keeps_its_digits_at_the_edge():
    x = np.array([-3.0, -1.0, 1.0, 1.5])
    assert np.all(hertz_pressure(x, **UNIT) == 0.0)
    gap = 2.0**-40
    expected = np.sqrt(2.0 * gap - gap**2)
    assert hertz_pressure(1.0 - gap, **UNIT) == pytest.approx(expected, rel=1e-14)


def test_stress_agrees_with_quadrature_of_the_surface_pressure(assert_quadrature):
    x, z = np.meshgrid([-2.0, -1.0, -0.6, 0.0, 0.3, 1.0, 1.7], [0.02, 0.3, 1.0, 4.0])
    a, p0 = 0.5, 18.0
    field = hertz_stress(x * a, z * a, half_width_mm=a, peak_pressure_mpa=p0)
    pressure = {"half_width": a, "powers": (0.5, 0.5), "scale": p0 / a}
    assert_quadrature(field, x * a, z * a, **pressure, atol=1e-8)


def test_surface_is_loaded_by_the_pressure_alone_and_sigma_x_equals_sigma_z():
    x = np.linspace(-3.0, 3.0, 601)
    field = hertz_stress(x, 0.0, **UNIT)
    # some roundings of order one
    np.testing.assert_allclose(field.sigma_z, -hertz_pressure(x, **UNIT), atol=1e-14)
    np.testing.assert_allclose(field.sigma_x, field.sigma_z, atol=1e-14)
    assert np.all(field.tau_xz == 0.0)


def test_stress_is_finite_at_and_continuous_towards_the_edges_of_the_contact():
    for edge in (-1.0, 1.0):
        at_edge = hertz_stress(edge, 0.0, **UNIT)
        assert [float(getattr(at_edge, name)) for name in NAMES] == [0.0, 0.0, 0.0]
        for depth in (1e-4, 1e-8, 1e-100, 5e-324):
            near = hertz_stress(edge, depth, **UNIT)
            # near the edge stresses grow like the root of the distance
            assert max(abs(float(getattr(near, n))) for n in NAMES) <= 2.0 * np.sqrt(depth)


def test_a_negative_zero_depth_is_the_surface_too():
    x = np.linspace(-2.0, 2.0, 9)
    above, at = hertz_stress(x, -0.0, **UNIT), hertz_stress(x, 0.0, **UNIT)
    for name in NAMES:  # -0.0 lies on the other side of the square root's cut
        np.testing.assert_array_equal(getattr(above, name), getattr(at, name))


@pytest.mark.parametrize("distance", [1e3, 1e5, 1e7])
def test_far_away_the_contact_is_a_line_load_without_cancellation(distance):
    angle = np.radians([20.0, 45.0, 70.0, 110.0, 160.0])
    x, z = distance * np.cos(angle), distance * np.sin(angle)
    field = hertz_stress(x, z, **UNIT)
    radial = -2.0 * (np.pi / 2.0) * np.sin(angle) / (np.pi * distance)  # Flamant, P' = π a p0 / 2
    shapes = (np.cos(angle) ** 2, np.sin(angle) ** 2, np.cos(angle) * np.sin(angle))
    for name, shape in zip(NAMES, shapes, strict=True):
        # the next term of the expansion is (a/r)² smaller; below that only rounding is left
        tolerance = 20.0 / distance**2 + 1e-13
        np.testing.assert_allclose(getattr(field, name), radial * shape, rtol=tolerance)


def test_far_along_the_surface_every_component_keeps_its_digits():
    x, z = 1e4, 1.0
    field = hertz_stress(x, z, **UNIT)
    flamant = -((x**2 + z**2) ** -2.0)
    # sz is 1e8 times smaller than sx here; the line load is off by (a/x)² = 1e-8
    assert float(field.sigma_x) == pytest.approx(flamant * z * x**2, rel=1e-6)
    assert float(field.sigma_z) == pytest.approx(flamant * z**3, rel=1e-6)
    assert float(field.tau_xz) == pytest.approx(flamant * z**2 * x, rel=1e-6)


def test_largest_difference_is_the_largest_of_the_whole_field():
    claimed = hertz_largest_difference(half_width_mm=0.4, peak_pressure_mpa=18.0)
    x, z = np.meshgrid(np.linspace(-3.0, 3.0, 121), np.linspace(0.0, 3.0, 121))
    scanned = hertz_stress(0.4 * x, 0.4 * z, half_width_mm=0.4, peak_pressure_mpa=18.0)
    assert scanned.principal_difference.max() <= claimed.difference_mpa

    def lack(point):
        return -float(hertz_stress(point[0], abs(point[1]), **UNIT).principal_difference)

    found = minimize(lack, (0.2, 0.6), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 0})
    # at a maximum the value is good to rounding, the place to its square root
    assert -found.fun * 18.0 == pytest.approx(claimed.difference_mpa, rel=1e-13)
    assert found.x == pytest.approx((0.0, claimed.depth_mm / 0.4), abs=1e-6)
    assert claimed.difference_mpa / 18.0 == pytest.approx(0.600, abs=1e-3)
    assert claimed.depth_mm / 0.4 == pytest.approx(0.786, abs=1e-3)


def test_the_papers_contact_shows_three_fringes():
    e = contact_modulus(*PAIR)
    largest = hertz_largest_difference(
        half_width_mm=hertz_half_width(11.0, 24.61, e),
        peak_pressure_mpa=hertz_peak_pressure(11.0, 24.61, e),
    )
    # N = (s1 - s2) d / f_sigma with the exact 0.60057 p0, to the digits given
    assert largest.difference_mpa * 4.0 / 14.6 == pytest.approx(3.0865, abs=5e-5)


def test_stress_has_the_broadcast_shape_of_its_coordinates():
    field = hertz_stress(np.zeros(5), np.ones((3, 1)), **UNIT)
    assert field.sigma_x.shape == field.tau_xz.shape == field.principal_difference.shape == (3, 5)
    assert hertz_stress(0.0, 1.0, **UNIT).sigma_z.shape == ()
