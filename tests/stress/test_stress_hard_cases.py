"""Hard cases of the stress below the surface: each says what would go wrong."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from isochrome.reference import hertz_pressure
from isochrome.stress import (
    PixelGrid,
    StressComponents,
    make_field_grid,
    stress_components,
    stress_difference,
    stress_trace,
)

A, P0 = 0.37, 18.0


def hertz(n, half=0.5):
    nodes = np.linspace(-half, half, n)
    return nodes, hertz_pressure(nodes, half_width_mm=A, peak_pressure_mpa=P0)


@pytest.mark.parametrize("exponent", range(-9, 4))
def test_direct_sums_keep_their_digits_from_a_picometre_to_a_metre(exact_field, exponent):
    """Antiderivatives cancel far off (all digits gone at z = 1e3 mm) and lose z at the surface."""
    nodes, p = hertz(101)
    z = 10.0**exponent
    x = np.r_[np.linspace(-0.6, 0.6, 13), 0.6 + z]
    field = stress_components(x, np.full_like(x, z), nodes, p, 0.3 * p)
    difference, trace = exact_field(x, np.full_like(x, z), nodes, p, 0.3 * p)
    # second differences of ζ² ln ζ-like terms at 40 spacings lose 40² of 1e-16, some times over
    assert np.abs(field.difference / difference - 1).max() < 2e-12
    got = field.sigma_x + field.sigma_z
    assert np.abs(got - trace).max() < 2e-12 * np.abs(trace).max()


@pytest.mark.parametrize(("dtype", "bar"), [(np.complex64, 1e-6), (np.complex128, 5e-13)])
@pytest.mark.parametrize("fold", [1, 6])
@pytest.mark.parametrize("exponent", range(-9, 4))
def test_rows_keep_their_digits_from_a_picometre_to_a_metre(
    exact_field, exponent, fold, dtype, bar
):
    """A row far down is tiny beside p0: its error must be of its own size, not of p0."""
    h = 0.03 / fold
    nodes = h * np.arange(-16 * fold, 16 * fold + 1)
    p = hertz_pressure(nodes, half_width_mm=A, peak_pressure_mpa=P0)
    pixels = PixelGrid(rows=1, cols=21, left_mm=-0.31, top_mm=10.0**exponent - 0.015, pixel_mm=0.03)
    grid = make_field_grid(pixels, left_mm=nodes[0], spacing_mm=h, nodes=len(nodes), dtype=dtype)
    difference, trace = exact_field(pixels.x_mm, pixels.z_mm[0], nodes, p, 0.3 * p)
    # the stated errors of the two precisions, per size of the row
    got = stress_difference(grid, p, 0.3 * p)[0]
    assert np.abs(got - difference).max() < bar * np.abs(difference).max()
    got = stress_trace(grid, p, 0.3 * p)[0]
    assert np.abs(got - trace).max() < bar * np.abs(trace).max()


@pytest.mark.parametrize("z", [0.0, 1e-9, 1e-6, 1e-3])
def test_a_jump_in_pressure_leaves_no_spike(exact_field, z):
    """Stepwise constant tractions make sx infinite at the jump; a ramp over one spacing bounds it.
    Beside a ramp over h, ∫ q/(ζ-t) dt is at most q0 (1 + ln(2 l/h)), l the length of the load."""
    h, mu = 0.005, 0.25
    nodes = h * np.arange(-100, 101)
    p = np.where(np.abs(nodes) < 0.3 + 1e-9, P0, 0.0)
    near = np.array([-2, -1, -1e-3, -1e-6, 0, 1e-6, 1e-3, 0.5, 1, 1 + 1e-6, 2])
    x = np.r_[0.3 + h * near, -0.3 - h * near]
    field = stress_components(x, np.full_like(x, z), nodes, p, mu * p)
    difference, trace = exact_field(x, np.full_like(x, z), nodes, p, mu * p)
    # rounding of 120 terms of order p0
    assert np.abs(field.difference - difference).max() < 1e-12 * P0
    assert np.abs(field.sigma_x + field.sigma_z - trace).max() < 1e-12 * P0
    most = P0 + 2 / np.pi * 2 * mu * P0 * (1 + np.log(2 * 0.6 / h)) + mu * P0
    assert np.abs(field.sigma_x).max() < most


@pytest.mark.parametrize("fold", [1, 6])
def test_a_jump_and_a_worn_pressure_on_the_pixels(exact_field, fold):
    """Flat with steep ends: all bands are full near the surface, where a cut band would ring."""
    pixels = PixelGrid(rows=25, cols=101, left_mm=-0.505, top_mm=-0.005, pixel_mm=0.01)
    h = 0.01 / fold
    nodes = h * np.arange(-45 * fold, 45 * fold + 1)
    grid = make_field_grid(pixels, left_mm=nodes[0], spacing_mm=h, nodes=len(nodes))
    step = np.where(np.abs(nodes) < 0.3 + 1e-9, P0, 0.0)
    worn = 0.7 * P0 * (1 + 0.1 * nodes) * np.sqrt(np.clip(1 - (nodes / 0.4) ** 8, 0, None))
    col = np.r_[0:101:7, 18:24, 78:84]
    rows = np.r_[0:4, 8:13, 24]
    for p in (step, worn):
        exact, _ = exact_field(pixels.x_mm[None, col], pixels.z_mm[rows, None], nodes, p, 0.25 * p)
        got = stress_difference(grid, p, 0.25 * p)[np.ix_(rows, col)]
        # single precision's stated error
        assert np.isfinite(got).all()
        assert np.abs(got - exact).max() < 1e-6 * P0


@pytest.mark.parametrize("shape", [(1, 37), (41, 1), (1, 1), (31, 8)])
@pytest.mark.parametrize("nodes", [2, 3, 97, 101, 120])
@pytest.mark.parametrize("fold", [1, 5, 6])
def test_any_count_of_nodes_and_pixels(exact_field, shape, nodes, fold):
    """Prime and odd counts, one row, one column: lags that wrap, nodes that fill no last pixel."""
    pixels = PixelGrid(*shape, left_mm=-0.11, top_mm=0.0, pixel_mm=0.01)
    at = 0.003 + 0.01 / fold * (np.arange(nodes) - nodes // 3)
    rng = np.random.default_rng(nodes)
    p, q = rng.random(nodes), rng.normal(size=nodes)
    grid = make_field_grid(
        pixels, left_mm=at[0], spacing_mm=0.01 / fold, nodes=nodes, dtype=np.complex128
    )
    rows = np.unique(np.r_[0, shape[0] // 2, shape[0] - 1])
    difference, trace = exact_field(pixels.x_mm[None, :], pixels.z_mm[rows, None], at, p, q)
    # double precision's stated error
    bar = 5e-13 * (np.abs(p).max() + np.abs(q).max())
    assert stress_difference(grid, p, q).shape == shape
    assert np.abs(stress_difference(grid, p, q)[rows] - difference).max() < bar
    assert np.abs(stress_trace(grid, p, q)[rows] - trace).max() < bar


@pytest.mark.parametrize("above", [0, 1, 6, 7, 13])
def test_a_row_of_pixels_on_the_surface_itself(above):
    """Rows before it hold nothing; it must not be one of them where rounding puts it 7e-18 mm up,
    as with 6 and 7 rows, nor lie 1e-17 mm deep, as with 13."""
    pixel = 0.00607
    pixels = PixelGrid(
        rows=above + 3, cols=41, left_mm=-0.12, top_mm=-above * pixel - 0.5 * pixel, pixel_mm=pixel
    )
    nodes = -0.1 + pixel / 3 * np.arange(100)
    rng = np.random.default_rng(above)
    p, q = rng.random((2, 100))
    p[[0, -1]] = q[[0, -1]] = 0.0
    grid = make_field_grid(
        pixels, left_mm=nodes[0], spacing_mm=pixel / 3, nodes=100, dtype=np.complex128
    )
    difference, trace = stress_difference(grid, p, q), stress_trace(grid, p, q)
    field = StressComponents.from_invariants(difference, trace)
    for stress in (field.sigma_x, field.sigma_z, field.tau_xz):
        assert not stress[:above].any()
    # the tractions come back: linear between nodes; double precision's stated error
    assert_allclose(field.sigma_z[above], -np.interp(pixels.x_mm, nodes, p), rtol=0, atol=1e-12)
    assert_allclose(field.tau_xz[above], -np.interp(pixels.x_mm, nodes, q), rtol=0, atol=1e-12)


def test_a_picture_above_the_surface_alone_is_empty():
    """No row has a kernel: nothing to add up, nothing to fail on."""
    pixels = PixelGrid(rows=4, cols=5, left_mm=0.0, top_mm=-1.0, pixel_mm=0.1)
    grid = make_field_grid(pixels, left_mm=0.0, spacing_mm=0.1, nodes=6)
    assert grid.bands == ()
    for field in (stress_difference, stress_trace):
        assert field(grid, np.ones(6), np.ones(6)).shape == (4, 5)
        assert not field(grid, np.ones(6), np.ones(6)).any()
