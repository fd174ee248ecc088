"""Principal stresses apart: the trace and all components on the pixels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isochrome.reference import hertz_pressure, hertz_stress, sliding_hertz_stress
from isochrome.stress import (
    PixelGrid,
    components_on_grid,
    make_field_grid,
    stress_components,
    stress_difference,
    stress_trace,
    uniform_stress,
)

A, P0 = 0.37, 18.0
EDGE = 0.25 * (0.0025 / A) ** 0.5 * (0.0025 / 0.01)
"""Error over p0 of straight pieces 0.0025 mm long, at the edge of a contact and 0.01 mm deep."""
NAMES = ("sigma_x", "sigma_z", "tau_xz")


def hertz_grid(pixels, fold, dtype=np.complex128):
    """A field grid and a Hertz pressure on its nodes."""
    h = pixels.pixel_mm / fold
    nodes = h * np.arange(-int(0.5 / h), int(0.5 / h) + 1)
    grid = make_field_grid(pixels, left_mm=nodes[0], spacing_mm=h, nodes=len(nodes), dtype=dtype)
    return grid, nodes, hertz_pressure(nodes, half_width_mm=A, peak_pressure_mpa=P0)


@pytest.mark.parametrize("friction", [None, 0.25, -0.6])
def test_components_are_mcewens_and_the_sliding_closed_forms(friction):
    pixels = PixelGrid(rows=60, cols=70, left_mm=-0.7, top_mm=0.0, pixel_mm=0.02)
    grid, _, p = hertz_grid(pixels, fold=8)
    field = components_on_grid(grid, p, None if friction is None else friction * p)
    at = pixels.x_mm[None, :], pixels.z_mm[:, None]
    exact = hertz_stress(*at, half_width_mm=A, peak_pressure_mpa=P0)
    if friction is not None:
        exact = sliding_hertz_stress(*at, half_width_mm=A, peak_pressure_mpa=P0, friction=friction)
    # at an edge straight pieces miss p0 sqrt(h/a) over h, of which h/z is left at depth z = 4 h;
    # a quarter of that, as the missing piece changes its sign
    for name in NAMES:
        error = np.abs(getattr(field, name) - getattr(exact, name)).max()
        assert error < (1.0 + abs(friction or 0.0)) * EDGE * P0, name


@pytest.mark.parametrize(("dtype", "bar"), [(np.complex64, 1e-6), (np.complex128, 5e-13)])
def test_components_are_the_direct_sums(dtype, bar):
    pixels = PixelGrid(rows=30, cols=40, left_mm=-0.7, top_mm=-0.02, pixel_mm=0.02)
    grid, nodes, p = hertz_grid(pixels, fold=5, dtype=dtype)
    q = 0.4 * np.roll(p, 9)
    field = components_on_grid(grid, p, q, regular=uniform_stress(3.0))
    sums = stress_components(pixels.x_mm[None, :], pixels.z_mm[1:, None], nodes, p, q)
    for name, bulk in zip(NAMES, (3.0, 0.0, 0.0), strict=True):
        # the stated errors of the two precisions, per largest pressure and shear
        error = np.abs(getattr(field, name)[1:] - getattr(sums, name) - bulk).max()
        assert error < bar * 1.4 * P0, name
        assert not getattr(field, name)[0].any(), "no material above the surface"
    assert field.sigma_x.dtype == np.empty(0, dtype).real.dtype


def test_principal_stresses_apart_are_the_closed_forms_and_the_difference():
    pixels = PixelGrid(rows=40, cols=60, left_mm=-0.6, top_mm=0.0, pixel_mm=0.02)
    grid, _, p = hertz_grid(pixels, fold=8)
    field = components_on_grid(grid, p, 0.25 * p)
    high, low = field.principal
    exact = sliding_hertz_stress(
        pixels.x_mm[None, :],
        pixels.z_mm[:, None],
        half_width_mm=A,
        peak_pressure_mpa=P0,
        friction=0.25,
    )
    tensor = np.array([[exact.sigma_x, exact.tau_xz], [exact.tau_xz, exact.sigma_z]])
    values = np.linalg.eigvalsh(tensor.transpose(2, 3, 0, 1))
    # as above
    np.testing.assert_allclose(low, values[..., 0], rtol=0, atol=1.25 * EDGE * P0)
    np.testing.assert_allclose(high, values[..., 1], rtol=0, atol=1.25 * EDGE * P0)
    np.testing.assert_allclose(field.largest_shear, 0.5 * (high - low), rtol=0, atol=1e-13 * P0)
    # what fringes see is the same field
    np.testing.assert_allclose(
        field.difference, stress_difference(grid, p, 0.25 * p), rtol=0, atol=1e-14 * P0
    )


def test_the_field_on_the_pixels_is_in_equilibrium():
    """div sigma = 0 by central differences over one and over two pixels: second order in them."""
    pixels = PixelGrid(rows=44, cols=60, left_mm=-0.6, top_mm=0.15, pixel_mm=0.02)
    grid, _, p = hertz_grid(pixels, fold=6)
    field = components_on_grid(grid, p, 0.4 * p)

    def residual(k):
        def along_x(s):
            return (s[2:-2, 2 + k : 58 + k] - s[2:-2, 2 - k : 58 - k]) / (2 * k * 0.02)

        def along_z(s):
            return (s[2 + k : 42 + k, 2:-2] - s[2 - k : 42 - k, 2:-2]) / (2 * k * 0.02)

        x = along_x(field.sigma_x) + along_z(field.tau_xz)
        z = along_x(field.tau_xz) + along_z(field.sigma_z)
        return max(np.abs(x).max(), np.abs(z).max())

    # p0/a = 49 MPa/mm is the size of a slope; at 0.2 mm the next term is some (step/z)² = 1 %
    assert residual(1) < 0.02 * P0 / A
    assert residual(2) / residual(1) == pytest.approx(4.0, rel=0.1)


SMALL = PixelGrid(rows=14, cols=17, left_mm=-0.34, top_mm=0.0, pixel_mm=0.04)
SMALL_GRID = make_field_grid(SMALL, left_mm=-0.5, spacing_mm=0.01, nodes=101, dtype=np.complex128)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), factor=st.floats(-10, 10))
def test_traces_add_up_and_mirror(seed, factor):
    """Linear in the tractions; x -> -x with q -> -q leaves sx + sz even."""
    p, q, r, s = np.random.default_rng(seed).normal(size=(4, 101))
    trace = stress_trace(SMALL_GRID, p, q)
    both = stress_trace(SMALL_GRID, p + factor * r, q + factor * s)
    # rounding of sums of some tens
    np.testing.assert_allclose(
        both, trace + factor * stress_trace(SMALL_GRID, r, s), rtol=0, atol=1e-11
    )
    mirrored = stress_trace(SMALL_GRID, p[::-1], -q[::-1])
    np.testing.assert_allclose(mirrored, trace[:, ::-1], rtol=0, atol=1e-11)


def test_the_trace_is_harmonic():
    """Laplace's equation for sx + sz (compatibility), by the five-point star: second order."""
    x, z = np.meshgrid(np.linspace(-0.5, 0.5, 7), np.linspace(0.2, 0.8, 5))
    nodes = np.linspace(-0.5, 0.5, 201)
    p = hertz_pressure(nodes, half_width_mm=A, peak_pressure_mpa=P0)

    def trace(dx, dz):
        field = stress_components(x + dx, z + dz, nodes, p, 0.4 * p)
        return field.sigma_x + field.sigma_z

    star = [
        np.abs(trace(s, 0) + trace(-s, 0) + trace(0, s) + trace(0, -s) - 4 * trace(0, 0)).max()
        / s**2
        for s in (0.02, 0.01)
    ]
    # p0/a² = 131 MPa/mm² is the size of a curvature
    assert star[1] < 0.05 * P0 / A**2
    assert star[0] / star[1] == pytest.approx(4.0, rel=0.05)
