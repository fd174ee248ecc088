"""The renderer of benches beside closed forms, and the study that is made with it."""

from dataclasses import replace

import numpy as np
import pytest

from isochrome.benchmarks import load_benchmarks

OUTSIDE = load_benchmarks("outside_bench")
SIZE = {"shape": (60, 165), "pixel_mm": 4.0 / 165}
RIGID = {"modulus_change": 1e4}
"""Of the plate; the steel that is left gives 45 times less than the paper's plate."""


def made(**facts):
    return OUTSIDE.BenchContact(**(SIZE | facts))


@pytest.mark.parametrize("tilt", [0.0, 0.6])
@pytest.mark.parametrize("friction", [0.0, 0.2, -0.2])
def test_a_bench_without_facts_is_the_closed_form_of_a_contact(friction, tilt):
    """But above the depth of a few strips, of which five lie in a pixel; tilt by other slices."""
    closed = load_benchmarks("outside_contact").Contact(**SIZE, friction=friction, tilt=tilt)
    bench = made(friction=friction, tilt=tilt)
    if not tilt:
        assert bench.pressure_mpa() == pytest.approx(closed.pressure_mpa(), rel=1e-3)
    off = np.abs(bench.seen(5) - closed.seen(5)).max(axis=1)
    assert off[5] < 5e-3 and off[10] < 2e-3 and off[50:].max() < 1e-3


def test_a_load_that_is_uneven_adds_its_curvature():
    """F + κ² P² / 6 ∂²F/∂P² to the second order, of 15 slices 1 - 1/225 of it."""
    share, step = 0.1, 0.05
    x = np.linspace(-1.0, 1.0, 165)[None, :]

    def field(**facts):
        bench = made(**facts)
        x, z = bench._grid()
        stress, pressure = bench.fields(x, z[100:])
        return stress(pressure.mean(axis=(0, 1)))

    even, less, more = (field(load_n=47.3 * part) for part in (1.0, 1.0 - step, 1.0 + step))
    curved = share**2 / 6.0 * (less + more - 2.0 * even) / step**2
    off = field(tilt=share) - even
    assert np.abs(off - curved).max() < 0.05 * np.abs(curved).max() and x.size


def test_a_side_that_lifts_off_carries_nothing():
    shares = made(tilt=1.5).loads
    assert shares.min() == 0.0 and shares.mean() == pytest.approx(1.0)


def test_a_soft_layer_on_stiff_bodies_is_winklers():
    bench = made(layer_mm_per_mpa=1e-3, **RIGID)
    half = np.cbrt(1.5 * bench.load_n / 4.0 * bench.radius_mm * 1e-3)
    assert bench.pressure_mpa() == pytest.approx(half**2 / 2e-3 / bench.radius_mm, rel=0.02)
    (x, _), (((pressure,),)) = bench.strips, bench.tractions
    assert np.abs(x[pressure > 0.0]).max() == pytest.approx(half, rel=0.02)
    assert made(layer_mm_per_mpa=1e-9).pressure_mpa() == pytest.approx(
        made().pressure_mpa(), rel=1e-3
    )


def test_rough_stiff_bodies_have_a_bells_pressure_and_smooth_ones_hertzs():
    bench = made(roughness_mm=1e-3, **RIGID)
    peak = bench.load_n / 4.0 / np.sqrt(2.0 * np.pi * bench.radius_mm * 1e-3)
    assert bench.pressure_mpa() == pytest.approx(peak, rel=0.03)
    assert made(roughness_mm=2e-6).pressure_mpa() == pytest.approx(made().pressure_mpa(), rel=2e-3)


def test_wear_takes_the_loads_volume_and_converges_with_its_steps(monkeypatch):
    bench = made(friction=0.2, worn_m=100.0)
    (x, step), (((pressure,),)) = bench.strips, bench.tractions
    worn = (bench.worn_gap(bench.load_n / 4.0) - x**2 / 2.0 / bench.radius_mm).sum() * step
    assert worn == pytest.approx(2e-9 * bench.load_n / 4.0 * 1e5, rel=1e-9)
    monkeypatch.setattr(OUTSIDE, "STABLE", OUTSIDE.STABLE / 4.0)
    finer = made(friction=0.2, worn_m=100.0).tractions[0, 0]
    assert np.abs(finer - pressure).max() < 5e-3 * pressure.max()


def test_plane_stress_has_moduli_of_its_own():
    """Against 1/E* = Σ 1/E and β = E* [(1 - ν1)/E1 - (1 - ν2)/E2] / 2."""
    stiffness, beta = made(plane_stress=True).moduli
    assert 1.0 / stiffness == pytest.approx(1.0 / 2100.0 + 1.0 / 210e3)
    assert beta == pytest.approx(0.5 * stiffness * (0.6 / 2100.0 - 0.7 / 210e3))
    stiffness, beta = made().moduli
    assert stiffness == pytest.approx(2473.2, abs=0.1) and beta == pytest.approx(0.1618, abs=1e-4)


def test_light_is_bent_by_the_gradient_of_the_sum_of_stresses():
    """The gradient by differences of a force's -2 P z / π r²; X = x + d C h grad S where it is
    the same everywhere; and no light is lost."""
    x, z, step = np.array([[0.3]]), np.array([[0.4]]), 1e-4

    def force(x, z):
        return -2.0 / np.pi * z / (x**2 + z**2)

    slope = OUTSIDE._pull(x, z, 1e-3, 0.0)[0, 0] / 2e-3
    across = force(0.3 + step, 0.4) - force(0.3 - step, 0.4)
    down = force(0.3, 0.4 + step) - force(0.3, 0.4 - step)
    assert slope == pytest.approx((across + 1j * down) / 2.0 / step, rel=1e-4)
    bench = made(load_n=1e-9, bending_mpa_per_mm=30.0, focus_mm=0.5)
    x, z = bench._grid()
    (stress, pressure), bend = bench.fields(x, z), bench.fields(x, z, pull=True)[0]
    mean, seen = bench._traced(stress, bend, pressure[0])
    moved = (seen - np.indices(mean.shape)) * bench.pixel_mm / bench.samples
    # of a parabola the mean lies a third of its end's way off, a sixth of the thickness before
    away = 0.5 + 4.0 / 6.0 / OUTSIDE.INDEX
    assert moved[0] == pytest.approx(4.0 * 1e-4 * away * 30.0, rel=1e-6)
    assert np.abs(moved[1]).max() < 1e-8
    # on its way the ray is C d² / 6n grad S from where it began, in the mean
    along = (mean - stress(pressure[0, 0])).real[50:-50] / 30.0
    bent = 1e-4 * 4.0**2 / 6.0 / OUTSIDE.INDEX * 30.0 * (1.0 - OUTSIDE.STEPS**-2.0)
    assert along == pytest.approx(bent + 0.0 * along, rel=1e-4)
    light = np.random.default_rng(0).random((20, 30))
    light[:3] = light[-3:] = light[:, :3] = light[:, -3:] = 0.0
    place = np.indices(light.shape) + np.random.default_rng(1).uniform(-2.0, 2.0, (2, 20, 30))
    assert OUTSIDE._gathered(light, place).sum() == pytest.approx(light.sum())
    assert OUTSIDE._gathered(light, np.indices(light.shape)) == pytest.approx(light)


def test_an_edge_falls_with_the_depth_and_a_swing_is_the_mean_of_many_moments(monkeypatch):
    bench = made(load_n=1e-9, edge_mpa=0.4, edge_mm=0.2, fringe_change=0.01)
    x, z = bench._grid()
    order = 4.0 / 14.6 / 1.01 * 0.4 * np.exp(-z / 0.2)
    assert bench.order(x, z) == pytest.approx(order + 0.0 * x, rel=1e-6)
    few = made(swing=0.05).signal()
    monkeypatch.setattr(OUTSIDE, "MOMENTS", 32)
    off = np.abs(made(swing=0.05).signal() - few)[25:]
    assert off.max() < 2e-3


def test_a_bench_is_drawn_again_by_its_seed():
    case = load_benchmarks("case_benches")
    for kind in case.FRAMES:
        first, second = (case.bench(kind, 3)[0] for _ in range(2))
        assert first == second
    states = {bool(case.bench("benches", s)[0].worn_m) for s in range(3)}
    assert states == {False, True}
    assert replace(first, load_n=1.0) != first
