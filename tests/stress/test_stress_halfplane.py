"""Stress below the surface: closed forms, the limit at the surface, pixels, principal stresses."""

import numpy as np
import pytest

from isochrome import reference, stress
from isochrome.errors import InputError
from isochrome.scene import load_scene
from isochrome.simulation import scene_states, state_difference

PAIR = (2100.0, 0.4, 210000.0, 0.3)
MODULUS = reference.contact_modulus(*PAIR)
A = reference.hertz_half_width(11.0, 24.61, MODULUS)
P0 = reference.hertz_peak_pressure(11.0, 24.61, MODULUS)


@pytest.fixture(scope="module")
def shipped():
    scene = load_scene("line-contact-wear")
    states = scene_states(scene.with_values({"wear.distances_m": (0.0,)}))
    return scene, states, stress.pixel_grid(scene)


@pytest.mark.parametrize("friction", [0.0, 0.25], ids=["static, McEwen's", "sliding, coupled"])
def test_the_field_is_the_closed_form_to_a_thousandth_of_p0_everywhere(shipped, friction):
    scene, states, pixels = shipped
    contact = reference.coupled_contact(
        11.0, 24.61, MODULUS, friction=friction, beta=reference.dundurs_beta(*PAIR)
    )
    at = pixels.x_mm[None, :], pixels.z_mm[:, None]
    exact = reference.coupled_stress(*at, contact)
    if not friction:
        exact = reference.hertz_stress(*at, half_width_mm=A, peak_pressure_mpa=P0)
    field = state_difference(scene, states[friction > 0.0], pixels)
    assert field.shape == (494, 659)
    # the bar of the issue; both components at once
    difference = (exact.sigma_x - exact.sigma_z) + 2j * exact.tau_xz
    assert np.abs(field - difference).max() < 1e-3 * P0


def test_on_the_surface_the_tractions_come_back_exactly():
    """sz = -p and txz = -q at z = 0, at nodes, between them and outside the contact."""
    rng = np.random.default_rng(3)
    nodes = np.linspace(-1, 1, 41)
    p, q = rng.random(41), rng.normal(size=41)
    p[[0, -1]] = q[[0, -1]] = 0.0
    x = np.r_[nodes, rng.uniform(-1.5, 1.5, 50)]
    field = stress.stress_components(x, np.zeros_like(x), nodes, p, q)
    # linear tractions between nodes, zero beyond: rounding of 41 terms
    np.testing.assert_allclose(field.sigma_z, -np.interp(x, nodes, p), rtol=0, atol=1e-13)
    np.testing.assert_allclose(field.tau_xz, -np.interp(x, nodes, q), rtol=0, atol=1e-13)


def test_every_few_pixels_are_the_same_centres():
    pixels = stress.PixelGrid(rows=10, cols=11, left_mm=-1.0, top_mm=0.2, pixel_mm=0.1)
    few = pixels.every(3)
    np.testing.assert_allclose(few.x_mm, pixels.x_mm[::3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(few.z_mm, pixels.z_mm[::3], rtol=0, atol=1e-15)


def test_a_spacing_that_nearly_divides_the_pixel_is_refused_too():
    """Of 800 nodes that are 1 % too far apart the last stand eight spacings off: 0.1 p0 of stress.
    Rounding is no reason to refuse."""
    pixels = stress.PixelGrid(rows=2, cols=2, left_mm=0.0, top_mm=0.0, pixel_mm=0.1)
    for off in (-0.1, 1e-2, -1e-4, 1e-8):
        with pytest.raises(
            InputError, match=r"the pixel, 0\.1 mm, .* spacings, 0\.0\d+ mm; change"
        ):
            stress.make_field_grid(pixels, left_mm=0.0, spacing_mm=0.1 / 3 * (1.0 + off), nodes=4)
    for off in (0.0, 3e-16, -1e-12):
        grid = stress.make_field_grid(
            pixels, left_mm=0.0, spacing_mm=0.1 / 3 * (1.0 + off), nodes=4
        )
        assert grid.bands[0].fold == 3


def test_direction_of_sigma1_is_counter_clockwise_as_the_camera_sees_it():
    """In the image z points down, so that a camera's angle theta is the vector (cos, -sin)."""
    rng = np.random.default_rng(6)
    sx, sz, txz = rng.normal(size=(3, 50))
    theta = stress.principal_direction((sx - sz) + 2j * txz)
    assert (theta > -np.pi / 2).all() and (theta <= np.pi / 2).all()
    for k in range(50):
        along = np.array([np.cos(theta[k]), -np.sin(theta[k])])  # x right, z down
        tensor = np.array([[sx[k], txz[k]], [txz[k], sz[k]]])
        high = np.linalg.eigvalsh(tensor)[1]
        np.testing.assert_allclose(tensor @ along, high * along, rtol=0, atol=1e-13)
