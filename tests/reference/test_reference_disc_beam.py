"""Disc under diametral compression and the span of pure bending."""

import numpy as np
import pytest
from scipy.integrate import quad

from isochrome.reference import (
    beam_moment,
    beam_stress,
    disc_centre_difference,
    disc_principal_difference,
    disc_stress,
)

NAMES = ("sigma_x", "sigma_z", "tau_xz")
P, D, T = 300.0, 40.0, 6.0
R = D / 2
DISC = {"load_n": P, "diameter_mm": D, "thickness_mm": T}
UNIT = 2.0 * P / (np.pi * D * T)  # the horizontal tension at the centre
BEAM = {"load_n": 150.0, "inner_span_mm": 40.0, "outer_span_mm": 100.0}
SECTION = {"height_mm": 20.0, "thickness_mm": 6.0}


def line_load_stress(x, z, push):
    """Flamant: a line load P/d at the origin pushing along (0, push) into its half-plane."""
    depth = push * z
    angle = np.arctan2(x, depth)
    radial = -2.0 * P / T * np.cos(angle) / (np.pi * np.hypot(x, z))
    return (
        radial * np.sin(angle) ** 2,
        radial * np.cos(angle) ** 2,
        push * radial * np.sin(angle) * np.cos(angle),
    )


def points_inside(count=400, share=0.97):
    rng = np.random.default_rng(3)
    radius, angle = share * R * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    return radius * np.cos(angle), radius * np.sin(angle)


def test_disc_is_two_line_loads_and_a_uniform_tension():
    x, z = points_inside()
    from_top, from_bottom = line_load_stress(x, z + R, 1.0), line_load_stress(x, z - R, -1.0)
    field = disc_stress(x, z, **DISC)
    uniform = (UNIT, UNIT, 0.0)
    for name, top, bottom, rest in zip(NAMES, from_top, from_bottom, uniform, strict=True):
        # roundings, larger next to the loads where stresses reach some dozens of UNIT
        np.testing.assert_allclose(getattr(field, name), top + bottom + rest, atol=1e-10 * UNIT)


def test_disc_rim_is_free_of_traction_away_from_the_loads():
    angle = np.radians(np.concatenate([np.linspace(-80, 80, 81), np.linspace(100, 260, 81)]))
    field = disc_stress(R * np.cos(angle), R * np.sin(angle), **DISC)
    along_x = field.sigma_x * np.cos(angle) + field.tau_xz * np.sin(angle)
    along_z = field.tau_xz * np.cos(angle) + field.sigma_z * np.sin(angle)
    # a rounding of the rim's radius, 1e-16, times the gradient: up to some hundred UNIT/R
    np.testing.assert_allclose(along_x, 0.0, atol=1e-12 * UNIT)
    np.testing.assert_allclose(along_z, 0.0, atol=1e-12 * UNIT)


def test_centre_of_the_disc_has_the_textbook_stresses():
    field = disc_stress(0.0, 0.0, **DISC)
    assert float(field.sigma_x) == pytest.approx(2 * P / (np.pi * D * T), rel=1e-14)
    assert float(field.sigma_z) == pytest.approx(-6 * P / (np.pi * D * T), rel=1e-14)
    assert float(field.tau_xz) == 0.0
    expected = 8 * P / (np.pi * D * T)
    assert disc_centre_difference(**DISC) == pytest.approx(expected, rel=1e-15)
    assert float(disc_principal_difference(0.0, 0.0, **DISC)) == pytest.approx(expected, rel=1e-14)


def test_principal_difference_of_the_disc_agrees_with_its_components_and_textbook_form():
    x, z = points_inside()
    r_squared = x**2 + z**2
    textbook = (
        4 * P * R / (np.pi * T) * (R**2 - r_squared) / ((R**2 + r_squared) ** 2 - 4 * R**2 * z**2)
    )
    direct = disc_principal_difference(x, z, **DISC)
    # the textbook denominator cancels next to the loads
    np.testing.assert_allclose(direct, textbook, rtol=1e-10)
    np.testing.assert_allclose(direct, disc_stress(x, z, **DISC).principal_difference, rtol=1e-12)


def test_outside_the_disc_and_under_the_loads_nothing_is_known():
    x, z = np.array([R * 1.001, 0.0, 0.0, 0.0, R]), np.array([0.0, R, -R, 2 * R, 0.0])
    known = [False, False, False, False, True]
    field = disc_stress(x, z, **DISC)
    for name in NAMES:
        assert np.array_equal(np.isfinite(getattr(field, name)), known)
    assert np.array_equal(np.isfinite(disc_principal_difference(x, z, **DISC)), known)


def test_beam_carries_its_moment_and_no_axial_force():
    moment = beam_moment(**BEAM)
    assert moment == pytest.approx(75.0 * 30.0, rel=1e-15)  # half the load on a 30 mm arm

    def stress(eta):
        return 6.0 * float(beam_stress(eta, **BEAM, **SECTION))

    # a polynomial: the quadrature is exact but for rounding
    assert quad(stress, -10.0, 10.0)[0] == pytest.approx(0.0, abs=1e-12 * moment)
    assert quad(lambda eta: eta * stress(eta), -10.0, 10.0)[0] == pytest.approx(moment, rel=1e-13)


def test_beam_is_compressed_above_and_stretched_below():
    top, middle, bottom = beam_stress([-10.0, 0.0, 10.0], **BEAM, **SECTION)
    assert top == -bottom < middle == 0.0 < bottom
    assert bottom == pytest.approx(6 * 2250.0 / (6.0 * 20.0**2), rel=1e-14)  # 6 M / (d h²)


def test_beyond_the_edges_of_the_beam_nothing_is_known():
    stress = beam_stress([-10.001, -10.0, 10.0, 11.0], **BEAM, **SECTION)
    assert np.array_equal(np.isfinite(stress), [False, True, True, False])
