"""Ring under two opposite point loads: what makes the series the only right field."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from isochrome.reference import disc_stress, ring_stress

NAMES = ("sigma_x", "sigma_z", "tau_xz")
P, D, T = 300.0, 40.0, 6.0
R = D / 2
UNIT = 2.0 * P / (np.pi * D * T)  # the horizontal tension at a disc's centre
HOLES = (1e-6, 0.01, 0.2, 0.5, 0.8, 0.95)


def ring(x, z, ratio):
    return ring_stress(x, z, load_n=P, diameter_mm=D, hole_mm=ratio * D, thickness_mm=T)


def tractions(radius, angle, ratio):
    x, z = radius * np.cos(angle), radius * np.sin(angle)
    field = ring(x, z, ratio)
    return (
        field.sigma_x * np.cos(angle) + field.tau_xz * np.sin(angle),
        field.tau_xz * np.cos(angle) + field.sigma_z * np.sin(angle),
    )


def largest(ratio):
    """The stress at the hole below a load, which the roundings are shares of."""
    return abs(float(ring(0.0, ratio * R, ratio).sigma_x))


@pytest.mark.parametrize("ratio", [*HOLES, 0.98])
def test_both_edges_are_free_of_traction_away_from_the_loads(ratio):
    around = np.linspace(0.0, 2.0 * np.pi, 721)
    away = np.radians(np.concatenate([np.linspace(-80, 80, 81), np.linspace(100, 260, 81)]))
    for radius, angle in ((ratio * R, around), (R, away)):
        for part in tractions(radius, angle, ratio):
            # roundings of a sum of some dozen to a thousand terms
            np.testing.assert_allclose(part, 0.0, atol=3e-14 * largest(ratio))


@pytest.mark.parametrize("ratio", HOLES[1:])
def test_either_side_of_the_middle_carries_half_the_load(ratio):
    def component(x, name):
        return T * float(getattr(ring(x, 0.0, ratio), name))

    ends = ratio * R, R * (1.0 - 1e-12)
    assert quad(component, *ends, args=("sigma_z",))[0] == pytest.approx(-0.5 * P, rel=1e-9)
    assert quad(component, *ends, args=("tau_xz",))[0] == pytest.approx(0.0, abs=1e-9 * P)


@pytest.mark.parametrize("level", [-0.8, -0.45, 0.3, 0.9])
def test_every_level_carries_the_load(level):
    ratio = 0.5
    reach = R * np.sqrt(1.0 - level**2) * (1.0 - 1e-12)
    start = R * np.sqrt(max(ratio**2 - level**2, 0.0)) * (1.0 + 1e-12)

    def down(x):
        return 2.0 * T * float(ring(x, level * R, ratio).sigma_z)

    assert quad(down, start, reach)[0] == pytest.approx(-P, rel=1e-8)


def test_field_is_in_equilibrium_and_compatible(assert_equilibrium):
    radius, angle = np.meshgrid(np.linspace(0.45, 0.7, 7), np.linspace(0.0, 2 * np.pi, 17))

    def field(x, z):
        return ring(R * x, R * z, 0.4)

    assert_equilibrium(field, radius * np.cos(angle), radius * np.sin(angle), step=2e-4, scale=UNIT)


@pytest.mark.parametrize("ratio", [1e-3, 1e-2, 0.1])
def test_far_from_a_small_hole_the_ring_is_a_disc(ratio):
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    x, z = 0.5 * R * np.cos(angle), 0.5 * R * np.sin(angle)
    disc = disc_stress(x, z, load_n=P, diameter_mm=D, thickness_mm=T)
    field = ring(x, z, ratio)
    for name in NAMES:
        # Kirsch's hole adds at most 5/2 (a/r)² of each principal stress, here UNIT and -3 UNIT
        difference = np.abs(getattr(field, name) - getattr(disc, name))
        assert difference.max() < 10.0 * UNIT * (ratio / 0.5) ** 2
        assert difference.max() > 0.0


def test_a_small_hole_concentrates_the_discs_centre_as_kirschs_does():
    """Three times the stress across less the one along it: 3 + 3 = 6, and -9 - 1 = -10."""
    ratio = 1e-6
    assert float(ring(0.0, ratio * R, ratio).sigma_x) == pytest.approx(6.0 * UNIT, rel=1e-10)
    assert float(ring(ratio * R, 0.0, ratio).sigma_z) == pytest.approx(-10.0 * UNIT, rel=1e-10)


def test_concentration_at_a_growing_hole_is_the_ring_tests():
    """K = 6 + 38 (a/R)² over the disc's tension: Hobbs (1965), British Journal of Applied Physics
    16, 259, for small holes; the next power is the fourth."""
    for ratio in (1e-3, 1e-2):
        factor = float(ring(0.0, ratio * R, ratio).sigma_x) / UNIT
        assert factor - 6.0 == pytest.approx(38.0 * ratio**2, rel=3.0 * ratio**2 + 1e-7)


@given(x=st.floats(-1.0, 1.0), z=st.floats(-1.0, 1.0), ratio=st.floats(0.01, 0.9))
@example(x=3e-192, z=1.0, ratio=0.5)  # beside a load, where the stress has no number
@settings(max_examples=15)
def test_field_mirrors_left_to_right_and_top_to_bottom(x, z, ratio):
    here = ring(R * x, R * z, ratio)
    for sign_x, sign_z in ((-1, 1), (1, -1), (-1, -1)):
        there = ring(sign_x * R * x, sign_z * R * z, ratio)
        expected = (here.sigma_x, here.sigma_z, sign_x * sign_z * here.tau_xz)
        for name, value in zip(NAMES, expected, strict=True):
            found = float(getattr(there, name))
            np.testing.assert_allclose(found, value, rtol=1e-12, atol=1e-13 * largest(ratio))


def test_outside_in_the_hole_and_under_the_loads_nothing_is_known():
    x = np.array([R * 1.001, 0.0, 0.0, 0.0, 0.0, R, 0.5 * R])
    z = np.array([0.0, R, -R, 0.0, 0.499 * R, 0.0, 0.0])
    field = ring(x, z, 0.5)
    for name in NAMES:
        known = np.isfinite(getattr(field, name))
        assert np.array_equal(known, [False, False, False, False, False, True, True])
