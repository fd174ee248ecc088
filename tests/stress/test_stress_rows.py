"""Rows by FFT: deep rows, whose sources stand at pixel spacing, the precisions, the memory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isochrome import stress
from isochrome.errors import InputError


def loads(n, seed=0):
    """Tractions that change sign at random from node to node: nothing smooth to lean on."""
    rng = np.random.default_rng(seed)
    return rng.choice([0.0, 1.0], n), rng.choice([-1.0, 1.0], n)


def bound(depth_px):
    """Relative error of a moved source for 1/(ζ-t), midway between pixels."""
    away = (np.arange(1, stress.HALF_TAPS + 1) - 0.5) ** 2
    return np.prod(away / (depth_px**2 + away))


@pytest.mark.parametrize("dtype", [np.complex64, np.complex128])
@pytest.mark.parametrize("fold", [2, 6, 7])
def test_rows_on_both_sides_of_the_switch_are_the_exact_sum(exact_field, dtype, fold):
    """Deep rows take their sources at pixel spacing: too shallow a switch shows just below it."""
    deep = stress.DEEP_PX[np.dtype(dtype)]
    pixels = stress.PixelGrid(
        rows=8, cols=23, left_mm=-0.4, top_mm=0.02 * (deep - 4), pixel_mm=0.02
    )
    h, n = 0.02 / fold, 31 * fold + 1
    nodes = -0.3 + h * np.arange(n)
    grid = stress.make_field_grid(pixels, left_mm=nodes[0], spacing_mm=h, nodes=n, dtype=dtype)
    assert [band.moved for band in grid.bands] == [1, fold]
    p, q = loads(n)
    difference, trace = exact_field(pixels.x_mm[None, :], pixels.z_mm[:, None], nodes, p, q)
    # the stated errors are per largest pressure and shear together, 2 here
    bar = 2.0 * (stress.SINGLE_ERROR if dtype is np.complex64 else stress.DOUBLE_ERROR)
    assert np.abs(stress.stress_difference(grid, p, q) - difference).max() < bar
    assert np.abs(stress.stress_trace(grid, p, q) - trace).max() < bar


def test_the_switches_lie_where_the_remainder_is_negligible():
    # (2m + 1) times it for the steeper kernel: below a thousandth of single precision's stated
    # error, and below double precision's rounding
    share = 2 * stress.HALF_TAPS + 1
    assert share * bound(stress.DEEP_PX[np.dtype(np.complex64)]) < 1e-2 * stress.SINGLE_ERROR
    assert share * bound(stress.DEEP_PX[np.dtype(np.complex128)]) < 1e-2 * stress.DOUBLE_ERROR


@pytest.mark.parametrize(
    ("tolerance", "dtype"),
    [(1.0, np.complex64), (1e-6, np.complex64), (9e-7, np.complex128), (5e-13, np.complex128)],
)
def test_precision_follows_the_tolerance(tolerance, dtype):
    assert stress.field_dtype(tolerance) is dtype


@pytest.mark.parametrize("tolerance", [1e-13, 0.0, -1.0, float("nan")])
def test_a_tolerance_beyond_double_precision_is_refused(tolerance):
    with pytest.raises(InputError, match="double precision reaches 5e-13; raise it"):
        stress.field_dtype(tolerance)


@settings(max_examples=12)
@given(
    tolerance=st.sampled_from([1e-6, 5e-13]), nodes=st.integers(2, 3000), fold=st.integers(1, 8),
    cols=st.integers(1, 300), seed=st.integers(0, 99),
)  # fmt: skip
def test_the_chosen_precision_keeps_its_tolerance(exact_field, tolerance, nodes, fold, cols, seed):
    """Random signs on grids of any size: the error must stay below what the rule promises."""
    pixel = 0.01
    pixels = stress.PixelGrid(
        rows=15, cols=cols, left_mm=-0.5 * cols * pixel, top_mm=0.0, pixel_mm=pixel
    )
    h = pixel / fold
    at = h * (np.arange(nodes) - nodes // 2)
    grid = stress.make_field_grid(
        pixels, left_mm=at[0], spacing_mm=h, nodes=nodes, dtype=stress.field_dtype(tolerance)
    )
    p, q = loads(nodes, seed)
    rng = np.random.default_rng(seed)
    row, col = rng.integers(0, 15, 12), rng.integers(0, cols, 12)
    row[0] = 0
    exact, _ = exact_field(pixels.x_mm[col], pixels.z_mm[row], at, p, q)
    error = np.abs(stress.stress_difference(grid, p, q)[row, col] - exact).max()
    assert error < tolerance * (np.abs(p).max() + np.abs(q).max())


def test_tractions_that_are_not_the_grids_are_refused():
    """One value too few would be padded with zero by the transform, and nobody would know."""
    pixels = stress.PixelGrid(rows=3, cols=5, left_mm=0.0, top_mm=0.0, pixel_mm=0.1)
    grid = stress.make_field_grid(pixels, left_mm=0.0, spacing_mm=0.1, nodes=6)
    with pytest.raises(InputError, match="6 surface nodes"):
        stress.stress_difference(grid, np.ones(5))
    with pytest.raises(InputError, match="6 surface nodes"):
        stress.stress_trace(grid, np.ones(6), np.ones(7))
