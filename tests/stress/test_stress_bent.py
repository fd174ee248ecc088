"""Light that stresses bend: the gradient of their sum, and the places that an unfocused camera
sees; stress along a machined edge."""

import numpy as np
import pytest

from isochrome.stress import (
    PixelGrid,
    RegularStress,
    bent_places,
    make_field_grid,
    make_series_grid,
    series_difference,
    stress_trace,
    trace_gradient,
)

HALF, PRESSURE = 0.4, 18.0


def hertz(spacing):
    """Nodes and pressure of Hertz' contact, its hats' own load kept."""
    nodes = 2 * round(1.0 / spacing) + 1
    x = spacing * (np.arange(nodes) - nodes // 2)
    return x, PRESSURE * np.sqrt(np.maximum(0.0, 1.0 - (x / HALF) ** 2))


def gradients(pixel_mm, friction=0.0):
    x, pressure = hertz(pixel_mm / 2)
    pixels = PixelGrid(round(1.2 / pixel_mm), 2 * round(0.8 / pixel_mm) + 1, 0.0, 0.0, pixel_mm)
    left = -0.5 * pixels.cols * pixel_mm
    pixels = PixelGrid(pixels.rows, pixels.cols, left, 0.0, pixel_mm)
    grid = make_field_grid(
        pixels, left_mm=x[0], spacing_mm=pixel_mm / 2, nodes=len(x), dtype=np.complex128
    )
    shear = friction * pressure
    return pixels, grid, pressure, shear, trace_gradient(grid, pressure, shear)


def test_below_hertz_pressure_the_sum_falls_as_the_closed_form_says():
    """On the axis S = -2 p0 [sqrt(a² + z²) - z]/a (Johnson, 1985, eq. 4.46): dS/dz = 2 p0
    [1 - z / sqrt(a² + z²)]/a, and dS/dx = 0. Hats follow the root at the contact's edge by the
    spacing to the power 1.5."""
    errors = []
    for pixel_mm in (0.02, 0.01):
        pixels, *_, gradient = gradients(pixel_mm)
        z, axis = pixels.z_mm, gradient[:, pixels.cols // 2]
        deep = z > 0.1
        truth = 2.0 * PRESSURE / HALF * (1.0 - z / np.hypot(HALF, z))
        assert np.abs(axis.real[deep]).max() < 1e-9 * PRESSURE
        errors.append(np.abs(axis.imag - truth)[deep].max() / (PRESSURE / HALF))
    assert errors[1] < 2e-3 and errors[0] / errors[1] > 2.0**1.3


def test_the_gradient_is_that_of_the_sum():
    """Against differences of the sum, whose error is of the second order in the pixel."""
    errors = []
    for pixel_mm in (0.02, 0.01):
        pixels, grid, pressure, shear, gradient = gradients(pixel_mm, friction=0.3)
        down, across = np.gradient(stress_trace(grid, pressure, shear), pixel_mm)
        deep = pixels.z_mm > 0.3
        error = np.abs(across + 1j * down - gradient)[deep][1:-1, 1:-1]
        errors.append(error.max() / (PRESSURE / HALF))
    assert errors[1] < 2e-3 and errors[0] / errors[1] > 2.0**1.8


def test_waves_tell_the_gradient_that_kernels_do():
    """As their fields do, in single precision."""
    pixels, _, pressure, shear, gradient = gradients(0.02, friction=0.3)
    x, _ = hertz(0.01)
    waves = make_series_grid(
        pixels.rows, pixels.cols, pixels.pixel_mm, nodes=len(x), spacing_mm=0.01, reach_mm=2.5
    )
    made = series_difference(
        waves, x_mm=pixels.x_mm[0], z_mm=pixels.z_mm[0], left_mm=x[0], pressure_mpa=pressure,
        shear_mpa=shear, bending=True,
    )  # fmt: skip
    assert made.along is None and made.down is None
    assert np.abs(made.bending - gradient).max() < 2e-6 * np.abs(gradient).max()


@pytest.mark.parametrize("bend", [4e-5, -4e-4])
def test_what_is_seen_is_where_light_was_bent_to(bend):
    """A place x is seen at X = x + d C h grad S(x), for a sum S = A (x² - z²) + B x z."""
    pixels = PixelGrid(40, 60, -0.6, 0.0, 0.02)
    around = pixels.around(bent=True)
    x, z = around.x_mm[None, :], around.z_mm[:, None]
    a, b = 40.0, 25.0
    gradient = (2 * a * x + b * z) + 1j * (b * x - 2 * a * z)
    seen_x, seen_z = bent_places(gradient, around, pixels, bend)
    shown = pixels.places
    np.testing.assert_allclose(
        seen_x + bend * (2 * a * seen_x + b * seen_z), np.broadcast_to(shown[0], seen_x.shape),
        atol=5e-5 * 0.02 if abs(bend) < 1e-4 else 5e-3 * 0.02,
    )  # fmt: skip
    np.testing.assert_allclose(
        seen_z + bend * (b * seen_x - 2 * a * seen_z), np.broadcast_to(shown[1], seen_z.shape),
        atol=5e-5 * 0.02 if abs(bend) < 1e-4 else 5e-3 * 0.02,
    )  # fmt: skip


def test_a_machined_edge_is_stress_along_it_that_decays():
    edge = RegularStress(edges=((0.4, 0.3),))
    z = np.array([[0.0], [0.15], [0.9]])
    truth = 0.4 * np.exp(-z / 0.3)
    for part in (edge.difference(0.0, z), edge.trace(0.0, z)):
        np.testing.assert_allclose(part, truth, rtol=1e-15)
    both = edge + RegularStress((2.0 + 0j,)) + edge.times(-0.5)
    np.testing.assert_allclose(both.difference(1.0, z), 2.0 + 0.5 * truth, rtol=1e-14)
    assert edge and not RegularStress() and not edge.times(0.0)
