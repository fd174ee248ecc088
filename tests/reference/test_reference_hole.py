"""Plate with a round hole under tension: what makes Kirsch's field the only right one."""

import numpy as np
import pytest

from isochrome.reference import hole_stress

S, A = 12.0, 2.5
PLATE = {"tension_mpa": S, "radius_mm": A}
NAMES = ("sigma_x", "sigma_z", "tau_xz")


def on_circle(radius, count=73):
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    return radius * np.cos(angle), radius * np.sin(angle), angle


def test_rim_of_the_hole_is_free_of_traction():
    x, z, angle = on_circle(A)
    field = hole_stress(x, z, **PLATE)
    along_x = field.sigma_x * np.cos(angle) + field.tau_xz * np.sin(angle)
    along_z = field.tau_xz * np.cos(angle) + field.sigma_z * np.sin(angle)
    # the rounding of the rim's radius, 1e-16, times a gradient of some ten S/A
    np.testing.assert_allclose(along_x, 0.0, atol=1e-13 * S)
    np.testing.assert_allclose(along_z, 0.0, atol=1e-13 * S)


def test_stress_is_three_times_the_tension_across_it_and_a_pressure_along_it():
    across = hole_stress([0.0, 0.0], [A, -A], **PLATE)
    along = hole_stress([A, -A], 0.0, **PLATE)
    np.testing.assert_allclose(across.sigma_x, 3.0 * S, rtol=1e-14)
    np.testing.assert_allclose(along.sigma_z, -S, rtol=1e-14)
    # the rim's difference is its hoop stress, largest where the concentration is 3
    rim = hole_stress(*on_circle(A, 3601)[:2], **PLATE)
    assert rim.principal_difference.max() == pytest.approx(3.0 * S, rel=1e-14)


@pytest.mark.parametrize("far", [30.0, 300.0])
def test_far_away_only_the_tension_is_left(far):
    field = hole_stress(*on_circle(far * A)[:2], **PLATE)
    # the hole's own share falls as a²/r², with at most 5/2 before it: (1 + 2 + 2)/2 in the closed
    # forms of sx and sz
    for name, expected in zip(NAMES, (S, 0.0, 0.0), strict=True):
        np.testing.assert_allclose(getattr(field, name), expected, atol=2.5 * S / far**2)


def test_field_is_in_equilibrium_and_compatible(assert_equilibrium):
    radius, angle = np.meshgrid(np.linspace(1.3, 4.0, 9), np.linspace(0.0, 2.0 * np.pi, 17))

    def field(x, z):
        return hole_stress(A * x, A * z, **PLATE)

    assert_equilibrium(field, radius * np.cos(angle), radius * np.sin(angle), step=2e-4, scale=S)


def test_in_the_hole_nothing_is_known():
    field = hole_stress([0.0, 0.999 * A, A, 0.0], [0.0, 0.0, 0.0, 1.001 * A], **PLATE)
    for name in NAMES:
        assert np.array_equal(np.isfinite(getattr(field, name)), [False, False, True, True])
