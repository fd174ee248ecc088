"""Stress below the surface: closed forms, direct sums, equilibrium, the limit at the surface."""

import numpy as np
import pytest
from scipy.integrate import quad

from isochrome.errors import InputError
from isochrome.reference import (
    contact_modulus,
    coupled_contact,
    coupled_stress,
    dundurs_beta,
    hertz_half_width,
    hertz_largest_difference,
    hertz_peak_pressure,
    hertz_pressure,
    hertz_stress,
    sliding_hertz_stress,
)
from isochrome.scene import load_scene
from isochrome.simulation import scene_states, state_difference
from isochrome.stress import (
    PixelGrid,
    StressComponents,
    cauchy_of_hat,
    make_field_grid,
    pixel_grid,
    principal_direction,
    stress_components,
    stress_difference,
)

PAIR = (2100.0, 0.4, 210000.0, 0.3)
MODULUS = contact_modulus(*PAIR)
A = hertz_half_width(11.0, 24.61, MODULUS)
P0 = hertz_peak_pressure(11.0, 24.61, MODULUS)


@pytest.fixture(scope="module")
def shipped():
    scene = load_scene("line-contact-wear")
    states = scene_states(scene.with_values({"wear.distances_m": (0.0,)}))
    return scene, states, pixel_grid(scene)


def closed_difference(field):
    return (field.sigma_x - field.sigma_z) + 2j * field.tau_xz


def test_static_field_is_mcewens_to_a_thousandth_of_p0_everywhere(shipped):
    scene, states, pixels = shipped
    field = state_difference(scene, states[0], pixels)
    exact = hertz_stress(
        pixels.x_mm[None, :], pixels.z_mm[:, None], half_width_mm=A, peak_pressure_mpa=P0
    )
    assert field.shape == (494, 659)
    # the bar of the issue; both components at once
    assert np.abs(field - closed_difference(exact)).max() < 1e-3 * P0


def test_sliding_field_is_the_coupled_closed_form_to_a_thousandth_of_p0_everywhere(shipped):
    scene, states, pixels = shipped
    contact = coupled_contact(11.0, 24.61, MODULUS, friction=0.25, beta=dundurs_beta(*PAIR))
    exact = coupled_stress(pixels.x_mm[None, :], pixels.z_mm[:, None], contact)
    field = state_difference(scene, states[1], pixels)
    assert np.abs(field - closed_difference(exact)).max() < 1e-3 * P0


def test_largest_difference_sits_where_hertz_puts_it(shipped):
    scene, states, pixels = shipped
    size = np.abs(state_difference(scene, states[0], pixels))
    largest = hertz_largest_difference(half_width_mm=A, peak_pressure_mpa=P0)
    row, col = np.unravel_index(size.argmax(), size.shape)
    # flat at its top: half a pixel off costs 5e-6 of it
    assert size.max() == pytest.approx(largest.difference_mpa, rel=2e-5)
    assert pixels.z_mm[row] == pytest.approx(largest.depth_mm, abs=pixels.pixel_mm)
    assert abs(pixels.x_mm[col]) <= pixels.pixel_mm


@pytest.mark.parametrize("x", [0.0, 0.3, 1.0, 1.7, 12.0, 39.0, 41.0, 300.0])
@pytest.mark.parametrize("z", [1e-3, 0.2, 1.0, 39.0, 41.0, 500.0])
def test_hat_integrals_are_those_of_quadrature(x, z):
    """Both sides of the switch to the series, at 40 spacings."""
    h = 0.5
    zeta = complex(x, -z) * h

    def integral(power):
        def part(pick):
            return quad(
                lambda t: pick((1 - abs(t) / h) / (zeta - t) ** power),
                -h,
                h,
                points=[0.0, *([x * h] if x < 1 else [])],
                epsabs=1e-11 * min(1.0, h / abs(zeta) ** power),
                epsrel=1e-11,
                limit=500,
            )[0]

        return complex(part(np.real), part(np.imag))

    first, second = cauchy_of_hat(np.array([x * h]), z * h, h)
    # quad's own 1e-11 near by; from 40 spacings the second differences lose (|zeta|/h)² of 1e-16
    assert abs(first[0] - integral(1)) < 1e-10 * abs(first[0])
    assert abs(second[0] - integral(2)) < 1e-10 * abs(second[0])


@pytest.mark.parametrize("exponent", range(-9, 4))
def test_kernels_are_finite_at_any_depth_from_a_picometre_to_a_metre(exponent):
    """Hard case: z from 1e-9 mm to 1e3 mm; antiderivatives over- or underflow or cancel."""
    x = np.linspace(-3, 3, 601)
    z = 10.0**exponent
    first, second = cauchy_of_hat(x, z, 0.01)
    normal, shear = -2 / np.pi * z * second, -2 / np.pi * (1j * z * second + first)
    assert np.isfinite(normal).all() and np.isfinite(shear).all()
    # no response exceeds the traction's own size by more than the logarithm of the hat's shear
    assert np.abs(normal).max() <= 2.0
    assert np.abs(shear).max() <= 4.0


def hertz_nodes(n=201, half=0.5, friction=0.0):
    nodes = np.linspace(-half, half, n)
    p = hertz_pressure(nodes, half_width_mm=A, peak_pressure_mpa=P0)
    return nodes, p, friction * p


def test_on_the_surface_the_tractions_come_back_exactly():
    """sz = -p and txz = -q at z = 0, at nodes, between them and outside the contact."""
    rng = np.random.default_rng(3)
    nodes = np.linspace(-1, 1, 41)
    p, q = rng.random(41), rng.normal(size=41)
    p[[0, -1]] = q[[0, -1]] = 0.0
    x = np.r_[nodes, rng.uniform(-1.5, 1.5, 50)]
    field = stress_components(x, np.zeros_like(x), nodes, p, q)
    # linear tractions between nodes, zero beyond: rounding of 41 terms
    np.testing.assert_allclose(field.sigma_z, -np.interp(x, nodes, p), rtol=0, atol=1e-13)
    np.testing.assert_allclose(field.tau_xz, -np.interp(x, nodes, q), rtol=0, atol=1e-13)


@pytest.mark.parametrize("z", [0.0, 1e-9, 1e-7, 1e-5, 1e-3])
def test_no_spikes_at_element_edges_just_below_the_surface(z):
    """Hard case: stepwise constant tractions leave a logarithmic spike in sx at every edge."""
    nodes, p, q = hertz_nodes(friction=0.25)
    h = nodes[1] - nodes[0]
    # across nodes well inside the contact, at places near and far from them
    x = (np.arange(-40, 40)[:, None] * h + np.array([-1e-7, 0, 1e-7, 0.25 * h, 0.5 * h])).ravel()
    field = stress_components(x, np.full_like(x, z), nodes, p, q)
    exact = sliding_hertz_stress(
        x, np.full_like(x, z), half_width_mm=A, peak_pressure_mpa=P0, friction=0.25
    )
    # straight pieces with h/a = 1/75: (h/a)^1.5 = 1.5e-3; a spike would be -ln(1e-7) times a step
    # in traction of p0 h/a, 0.2 p0
    for name in ("sigma_x", "sigma_z", "tau_xz"):
        error = np.abs(getattr(field, name) - getattr(exact, name))
        assert error.max() < 2e-3 * P0, name


@pytest.mark.parametrize(("dtype", "bar"), [(np.complex64, 1e-6), (np.complex128, 1e-12)])
@pytest.mark.parametrize("fold", [1, 3, 6])
def test_fft_rows_are_the_direct_sum(dtype, bar, fold):
    """Rows by FFT against adding up hats in plain numpy, tractions not proportional."""
    pixels = PixelGrid(rows=7, cols=41, left_mm=-0.62, top_mm=0.0, pixel_mm=0.03)
    spacing = pixels.pixel_mm / fold
    nodes = -0.5 + spacing * np.arange(round(1.0 / spacing))
    rng = np.random.default_rng(fold)
    p, q = rng.random(len(nodes)), rng.normal(size=len(nodes))
    grid = make_field_grid(
        pixels, left_mm=nodes[0], spacing_mm=spacing, nodes=len(nodes), dtype=dtype
    )
    exact = np.zeros((7, 41), complex)
    for row, z in enumerate(pixels.z_mm):
        zeta = (pixels.x_mm[:, None] - nodes[None, :]) - 1j * z

        def log(t, zeta=zeta):
            return np.log(zeta - t)

        def entropy(t, zeta=zeta):
            return (zeta - t) * np.log(zeta - t)

        h = spacing
        first = (entropy(-h) - 2 * entropy(0) + entropy(h)) / h
        second = -(log(-h) - 2 * log(0) + log(h)) / h
        exact[row] = -2 / np.pi * (z * second @ (p + 1j * q) + first @ q)
    got = stress_difference(grid, p, q)
    scale = np.abs(q).max()
    # single precision's 6e-8 over sums of tens of terms; double's own cancellation in `entropy`
    assert got.dtype == dtype
    assert np.abs(got - exact).max() < bar * scale * 10 ** (dtype is np.complex128)
    # and proportional tractions, q = mu p, take the short way to the same field
    both = stress_difference(grid, p, 0.3 * p)
    apart = stress_difference(grid, p) + stress_difference(grid, 0 * p + 1e-300, 0.3 * p)
    assert np.abs(both - apart).max() < 4 * bar * scale


def test_shipped_scenes_single_precision_is_a_millionth_of_p0_from_the_exact_sum(shipped):
    scene, states, pixels = shipped
    surface = states[1].surface
    few = pixels.every(29)
    field = state_difference(scene, states[1], pixels)[::29, ::29]
    exact = stress_components(
        few.x_mm[None, :],
        few.z_mm[:, None],
        surface.grid.x_mm,
        surface.pressure_mpa,
        surface.shear_mpa,
    ).difference
    # the bar of the issue
    assert np.abs(field - exact).max() < 1e-6 * P0


def test_pixels_above_the_surface_hold_no_stress():
    pixels = PixelGrid(rows=6, cols=21, left_mm=-1.0, top_mm=-0.3, pixel_mm=0.1)
    grid = make_field_grid(pixels, left_mm=-0.5, spacing_mm=0.05, nodes=21)
    field = stress_difference(grid, np.ones(21))
    assert not field[:3].any() and (np.abs(field[3:]) > 0).all()


def test_every_few_pixels_are_the_same_centres():
    pixels = PixelGrid(rows=10, cols=11, left_mm=-1.0, top_mm=0.2, pixel_mm=0.1)
    few = pixels.every(3)
    np.testing.assert_allclose(few.x_mm, pixels.x_mm[::3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(few.z_mm, pixels.z_mm[::3], rtol=0, atol=1e-15)


def test_a_pixel_that_is_no_whole_number_of_spacings_is_refused():
    pixels = PixelGrid(rows=2, cols=2, left_mm=0.0, top_mm=0.0, pixel_mm=0.1)
    with pytest.raises(InputError, match="whole number of surface spacings"):
        make_field_grid(pixels, left_mm=0.0, spacing_mm=0.03, nodes=4)


def test_a_spacing_that_nearly_divides_the_pixel_is_refused_too():
    """Of 800 nodes that are 1 % too far apart the last stand eight spacings off: 0.1 p0 of stress.
    Rounding is no reason to refuse."""
    pixels = PixelGrid(rows=2, cols=2, left_mm=0.0, top_mm=0.0, pixel_mm=0.1)
    for off in (1e-2, -1e-4, 1e-8):
        with pytest.raises(
            InputError, match=r"the pixel, 0\.1 mm, .* spacings, 0\.0\d+ mm; change"
        ):
            make_field_grid(pixels, left_mm=0.0, spacing_mm=0.1 / 3 * (1.0 + off), nodes=4)
    for off in (0.0, 3e-16, -1e-12):
        grid = make_field_grid(pixels, left_mm=0.0, spacing_mm=0.1 / 3 * (1.0 + off), nodes=4)
        assert grid.fold == 3


def test_principal_stresses_are_the_eigenvalues():
    rng = np.random.default_rng(5)
    sx, sz, txz = rng.normal(size=(3, 20))
    high, low = StressComponents(sx, sz, txz).principal
    values = np.linalg.eigvalsh(np.array([[sx, txz], [txz, sz]]).transpose(2, 0, 1))
    np.testing.assert_allclose(low, values[:, 0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(high, values[:, 1], rtol=0, atol=1e-14)


def test_direction_of_sigma1_is_counter_clockwise_as_the_camera_sees_it():
    """In the image z points down, so that a camera's angle theta is the vector (cos, -sin)."""
    rng = np.random.default_rng(6)
    sx, sz, txz = rng.normal(size=(3, 50))
    theta = principal_direction((sx - sz) + 2j * txz)
    assert (theta > -np.pi / 2).all() and (theta <= np.pi / 2).all()
    for k in range(50):
        along = np.array([np.cos(theta[k]), -np.sin(theta[k])])  # x right, z down
        tensor = np.array([[sx[k], txz[k]], [txz[k], sz[k]]])
        high = np.linalg.eigvalsh(tensor)[1]
        np.testing.assert_allclose(tensor @ along, high * along, rtol=0, atol=1e-13)


def test_pure_tension_points_along_its_axis():
    # along x: 0; along z: 90 degrees; tension up to the right as seen: +45 degrees, txz < 0
    directions = principal_direction(np.array([1.0 + 0j, -1.0 + 0j, -1j, 1j]))
    np.testing.assert_allclose(np.abs(directions[1]), np.pi / 2)
    np.testing.assert_allclose(directions[[0, 2, 3]], [0.0, np.pi / 4, -np.pi / 4])
