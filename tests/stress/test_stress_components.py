"""Principal stresses apart: the trace and all components on the pixels."""

import numpy as np
import pytest

from isochrome import stress
from isochrome.reference import hertz_pressure, hertz_stress, sliding_hertz_stress

A, P0 = 0.37, 18.0
EDGE = 0.25 * (0.0025 / A) ** 0.5 * (0.0025 / 0.01)
"""Error over p0 of straight pieces 0.0025 mm long, at the edge of a contact and 0.01 mm deep."""
NAMES = ("sigma_x", "sigma_z", "tau_xz")


def hertz_grid(pixels, fold, dtype=np.complex128):
    """A field grid and a Hertz pressure on its nodes."""
    h = pixels.pixel_mm / fold
    nodes = h * np.arange(-int(0.5 / h), int(0.5 / h) + 1)
    grid = stress.make_field_grid(
        pixels, left_mm=nodes[0], spacing_mm=h, nodes=len(nodes), dtype=dtype
    )
    return grid, nodes, hertz_pressure(nodes, half_width_mm=A, peak_pressure_mpa=P0)


def components_of(grid, p, q):
    """All components of tractions at the nodes of a field grid."""
    difference, trace = stress.stress_difference(grid, p, q), stress.stress_trace(grid, p, q)
    return stress.StressComponents.from_invariants(difference, trace)


@pytest.mark.parametrize("friction", [None, 0.25, -0.6])
def test_components_are_mcewens_and_the_sliding_closed_forms(friction):
    pixels = stress.PixelGrid(rows=60, cols=70, left_mm=-0.7, top_mm=0.0, pixel_mm=0.02)
    grid, _, p = hertz_grid(pixels, fold=8)
    field = components_of(grid, p, None if friction is None else friction * p)
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
    pixels = stress.PixelGrid(rows=30, cols=40, left_mm=-0.7, top_mm=-0.02, pixel_mm=0.02)
    grid, nodes, p = hertz_grid(pixels, fold=5, dtype=dtype)
    q = 0.4 * np.roll(p, 9)
    field = components_of(grid, p, q)
    sums = stress.stress_components(pixels.x_mm[None, :], pixels.z_mm[1:, None], nodes, p, q)
    for name in NAMES:
        # the stated errors of the two precisions, per largest pressure and shear
        error = np.abs(getattr(field, name)[1:] - getattr(sums, name)).max()
        assert error < bar * 1.4 * P0, name
        assert not getattr(field, name)[0].any(), "no material above the surface"
    assert field.sigma_x.dtype == np.empty(0, dtype).real.dtype
