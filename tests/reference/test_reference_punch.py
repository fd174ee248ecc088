"""Flat punch, blunt wedge and wavy surface."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from isochrome.reference import (
    hertz_half_width,
    hertz_pressure,
    punch_pressure,
    punch_stress,
    wavy_full_contact_pressure,
    wavy_half_width,
    wavy_pressure,
    wedge_half_width,
    wedge_pressure,
)

NAMES = ("sigma_x", "sigma_z", "tau_xz")
PUNCH = {"half_width_mm": 1.0, "line_load_n_per_mm": 1.0}
WAVE = {"amplitude_mm": 0.01, "wavelength_mm": 2.0, "contact_modulus_mpa": 500.0}
FULL = np.pi * 500.0 * 0.01 / 2.0
sizes = st.floats(1e-2, 1e2)


def principal_value(pressure, x, lower, upper, points=None):
    """PV ∫ p(t)/(x - t) dt by folding the integral about x, which cancels the pole."""
    reach = min(x - lower, upper - x)

    def folded(s):
        return float(pressure(x - s) - pressure(x + s)) / s

    value, _ = quad(folded, 0.0, reach, points=points, limit=400, epsabs=1e-10)
    if x - lower > reach:
        value += quad(lambda t: float(pressure(t)) / (x - t), lower, x - reach, limit=400)[0]
    if upper - x > reach:
        value += quad(lambda t: float(pressure(t)) / (x - t), x + reach, upper, limit=400)[0]
    return value


@given(a=sizes, load=sizes)
@settings(max_examples=25, deadline=None)
def test_punch_pressure_carries_the_line_load(a, load):
    scalars = {"half_width_mm": a, "line_load_n_per_mm": load}

    def of_angle(angle):
        return float(punch_pressure(a * np.sin(angle), **scalars)) * a * np.cos(angle)

    carried, _ = quad(of_angle, -1.5, 1.5)
    # dx/sqrt(a² - x²) is the angle itself; sin near ±1.5 loses two digits
    assert carried == pytest.approx(load * 3.0 / np.pi, rel=1e-10)


def test_flat_punch_leaves_a_flat_surface_under_itself():
    # u' = -(2/(π E*)) PV ∫ p/(x - t) dt = 0; with t = sin φ the ends are smooth
    for x in (0.0, 0.3, -0.8):
        place = np.arcsin(x)

        def folded(step, place=place, x=x):
            here = [place - step, place + step]
            return sum(
                np.cos(angle) * float(punch_pressure(np.sin(angle), **PUNCH)) / (x - np.sin(angle))
                for angle in here
            )

        reach = np.pi / 2 - abs(place)
        value, _ = quad(folded, 1e-9, reach * (1 - 1e-9), limit=200)
        rest = (-np.pi / 2, place - reach) if place > 0 else (place + reach, np.pi / 2)
        value += quad(lambda angle, x=x: 1.0 / np.pi / (x - np.sin(angle)), *rest)[0]
        # cut ends of 1e-9 each, and the pole's rounding there
        assert value == pytest.approx(0.0, abs=1e-6)


def test_punch_stress_agrees_with_quadrature_of_the_pressure(assert_quadrature):
    x, z = np.meshgrid([-2.0, -1.0, -0.6, 0.0, 0.3, 1.0, 1.7], [0.02, 0.3, 1.0, 4.0])
    a, load = 0.5, 7.0
    field = punch_stress(x * a, z * a, half_width_mm=a, line_load_n_per_mm=load)
    pressure = {"half_width": a, "powers": (-0.5, -0.5), "scale": load / np.pi}
    assert_quadrature(field, x * a, z * a, **pressure, atol=1e-8)


def test_punch_surface_carries_the_pressure_and_its_corners_are_not_known():
    x = np.array([-3.0, -1.2, -0.99, 0.0, 0.5, 0.999, 2.0])
    field = punch_stress(x, 0.0, **PUNCH)
    # relative rounding of sqrt(a² - x²), some digits lost at 0.999
    np.testing.assert_allclose(field.sigma_z, -punch_pressure(x, **PUNCH), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(field.sigma_x, field.sigma_z, rtol=1e-12, atol=1e-15)
    assert np.all(field.tau_xz == 0.0)
    corners = punch_stress([-1.0, 1.0], 0.0, **PUNCH)
    assert all(np.all(np.isnan(getattr(corners, name))) for name in NAMES)
    assert np.all(np.isinf(punch_pressure([-1.0, 1.0], **PUNCH)))
    just_below = punch_stress([-1.0, 1.0], 1e-300, **PUNCH)
    assert all(np.all(np.isfinite(getattr(just_below, name))) for name in NAMES)


def test_far_away_the_punch_is_a_line_load():
    angle = np.radians([20.0, 45.0, 70.0, 160.0])
    r = 1e6
    field = punch_stress(r * np.cos(angle), r * np.sin(angle), **PUNCH)
    radial = -2.0 * np.sin(angle) / (np.pi * r)
    # the next term is (a/r)² = 1e-12 smaller, times some tens
    np.testing.assert_allclose(field.sigma_x, radial * np.cos(angle) ** 2, rtol=1e-10)
    np.testing.assert_allclose(field.sigma_z, radial * np.sin(angle) ** 2, rtol=1e-10)
    np.testing.assert_allclose(field.tau_xz, radial * np.sin(2 * angle) / 2, rtol=1e-10)


@given(load=sizes, slope=st.floats(1e-3, 0.1), modulus=sizes)
@settings(max_examples=25, deadline=None)
def test_wedge_pressure_carries_the_line_load(load, slope, modulus):
    a = wedge_half_width(load, slope=slope, contact_modulus_mpa=modulus)

    def pressure(x):
        return float(wedge_pressure(x, half_width_mm=a, slope=slope, contact_modulus_mpa=modulus))

    half, _ = quad(lambda v: pressure(a * v**2) * 2.0 * a * v, 0.0, 1.0)  # x = a v² tames the tip
    assert 2.0 * half == pytest.approx(load, rel=1e-7)  # quad's own 1.5e-8


def test_wedge_pressure_bends_the_surface_onto_its_faces():
    scalars = {"half_width_mm": 1.0, "slope": 0.05, "contact_modulus_mpa": 300.0}
    for x in (-0.7, 0.2, 0.5, 0.9):
        # the tip, t = 0, is a logarithmic singularity for the quadrature to know
        pv = principal_value(
            lambda t: wedge_pressure(t, **scalars), x, -1.0, 1.0,
            points=[abs(x)] if abs(x) < 0.5 else None,
        )  # fmt: skip
        slope = -2.0 / (np.pi * 300.0) * pv
        # adaptive quadrature through a logarithm: 1e-6 of the slope, with a margin
        assert slope == pytest.approx(-0.05 * np.sign(x), rel=1e-5)


def test_wedge_pressure_is_zero_outside_infinite_at_the_tip_and_keeps_digits_at_the_edge():
    scalars = {"half_width_mm": 1.0, "slope": np.pi, "contact_modulus_mpa": 1.0}
    assert np.all(wedge_pressure([-2.0, -1.0, 1.0, 3.0], **scalars) == 0.0)
    assert np.isinf(wedge_pressure(0.0, **scalars))
    inner = np.array([0.01, 0.3, 0.8])
    np.testing.assert_allclose(wedge_pressure(inner, **scalars), np.arccosh(1 / inner), rtol=1e-14)
    gap = 2.0**-40
    # arcosh(1 + h) = sqrt(2 h) (1 - h/12 ...), h = gap (1 + gap)
    assert wedge_pressure(1.0 - gap, **scalars) == pytest.approx(
        np.sqrt(2.0 * gap * (1.0 + gap)), rel=1e-12
    )


@pytest.mark.parametrize("share", [0.01, 0.3, 0.8, 0.999, 1.0, 2.5])
def test_wavy_pressure_has_the_mean_it_was_asked_for(share):
    mean = share * FULL
    a = wavy_half_width(mean, **WAVE)
    total, _ = quad(
        lambda angle: (
            float(wavy_pressure(a * np.sin(angle), mean_pressure_mpa=mean, **WAVE))
            * a
            * np.cos(angle)
        ),
        -np.pi / 2,
        np.pi / 2,
    )
    assert total / 2.0 == pytest.approx(mean, rel=1e-7)  # quad's own 1.5e-8


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_wavy_pressure_bends_the_surface_onto_the_wave_and_opens_the_gap_outside(share):
    mean = share * FULL
    wavelength, a = 2.0, wavy_half_width(mean, **WAVE)

    def pressure(t):
        return float(wavy_pressure(t, mean_pressure_mpa=mean, **WAVE))

    def gap_slope(x):
        """h'(x) + u'(x), the periodic kernel being (π/λ) cot(π (x - t)/λ)."""

        def folded(s):
            cot = np.pi / wavelength / np.tan(np.pi * s / wavelength)
            return (pressure(x - s) - pressure(x + s)) * cot

        kinks = sorted({abs(edge - x) for edge in (-a, a, wavelength - a)} - {0.0})
        kinks = [kink for kink in kinks if kink < wavelength / 2]
        pv = quad(folded, 0.0, wavelength / 2, points=kinks, limit=400)[0]
        height = 2.0 * np.pi * 0.01 / wavelength * np.sin(2.0 * np.pi * x / wavelength)
        return height - 2.0 / (np.pi * 500.0) * pv

    steepest = 2.0 * np.pi * 0.01 / wavelength
    for x in (0.1 * a, 0.5 * a, 0.9 * a):
        # adaptive quadrature across the square-root edges
        assert abs(gap_slope(x)) < 1e-6 * steepest
    assert gap_slope(a + 0.3 * (wavelength / 2 - a)) > 1e-3 * steepest


def test_wavy_contact_closes_at_the_full_contact_pressure_without_a_jump():
    assert wavy_full_contact_pressure(**WAVE) == pytest.approx(FULL, rel=1e-15)
    x = np.linspace(-2.0, 2.0, 81)
    below = wavy_pressure(x, mean_pressure_mpa=FULL * (1 - 1e-12), **WAVE)
    above = wavy_pressure(x, mean_pressure_mpa=FULL * (1 + 1e-12), **WAVE)
    # in the trough the root turns a lack of 1e-12 into 1e-6 times |cos| = at most 1e-6
    np.testing.assert_allclose(below, above, atol=1e-5 * FULL)
    assert wavy_half_width(FULL, **WAVE) == wavy_half_width(3 * FULL, **WAVE) == 1.0


def test_wavy_pressure_repeats_with_the_wave_and_vanishes_outside_the_strips():
    mean = 0.4 * FULL
    a = wavy_half_width(mean, **WAVE)
    x = np.linspace(-1.0, 1.0, 201)
    here, next_wave = (wavy_pressure(x + s, mean_pressure_mpa=mean, **WAVE) for s in (0.0, 2.0))
    np.testing.assert_allclose(here, next_wave, atol=1e-6 * FULL)  # roots of rounding at the edges
    assert np.array_equal(here > 0.0, np.abs(x) < a)


def test_lightly_loaded_wave_is_a_row_of_hertz_contacts():
    radius = 2.0**2 / (4.0 * np.pi**2 * 0.01)  # of the crests
    mean = 1e-4 * FULL
    a = hertz_half_width(mean * 2.0, radius, 500.0)
    # neighbours and the wave's shape matter to order (π a/λ)² = p_mean/p*
    assert wavy_half_width(mean, **WAVE) == pytest.approx(a, rel=1e-4)
    x = np.linspace(-0.9, 0.9, 19) * a
    p0 = 2.0 * mean * 2.0 / (np.pi * a)
    hertz = hertz_pressure(x, half_width_mm=a, peak_pressure_mpa=p0)
    found = wavy_pressure(x, mean_pressure_mpa=mean, **WAVE)
    np.testing.assert_allclose(found, hertz, rtol=1e-3)
