"""Regular stresses are what they are called: balanced, compatible, and free at the surface."""

import numpy as np
import pytest

from isochrome.scene import load_scene
from isochrome.simulation import simulate
from isochrome.stress import RegularStress, StressComponents, regular_modes

MODES = regular_modes(6)
H = 1e-4
"""Step of the differences (mm): their error is H²/6 times third derivatives, thousands here."""


def components(mode, x, z):
    return StressComponents.from_invariants(mode.difference(x, z), mode.trace(x, z))


@pytest.fixture
def places():
    rng = np.random.default_rng(5)
    return rng.uniform(-1.0, 1.0, 40), rng.uniform(0.0, 1.0, 40)


def along(function, x, z):
    """Central differences of a function of the place along x and z."""
    by_x = (function(x + H, z) - function(x - H, z)) / (2 * H)
    by_z = (function(x, z + H) - function(x, z - H)) / (2 * H)
    return by_x, by_z


@pytest.mark.parametrize("mode", MODES, ids=lambda m: str(m.series[-1]) + f" {len(m.series)}")
def test_a_mode_is_in_equilibrium_compatible_and_free_at_the_surface(mode, places):
    x, z = places
    parts = {
        name: along(lambda x, z, name=name: getattr(components(mode, x, z), name), x, z)
        for name in ("sigma_x", "sigma_z", "tau_xz")
    }
    assert np.abs(parts["sigma_x"][0] + parts["tau_xz"][1]).max() < 2e-5
    assert np.abs(parts["tau_xz"][0] + parts["sigma_z"][1]).max() < 2e-5
    # Beltrami and Michell: the trace is harmonic
    trace, h = mode.trace, 1e-2
    around = trace(x + h, z) + trace(x - h, z) + trace(x, z + h) + trace(x, z - h)
    # h²/12 times two fourth derivatives, 720 each for degree 6 in this square; others' are ~ 100
    assert np.abs((around - 4 * trace(x, z)) / h**2).max() < 720 / 6 * h**2
    surface = components(mode, x, np.zeros_like(x))
    assert np.abs(surface.sigma_z).max() < 1e-14 and np.abs(surface.tau_xz).max() < 1e-14


def test_the_first_modes_are_uniform_stress_its_change_along_x_and_bending(places):
    x, z = places
    flat, along_x, bending = (components(mode, x, z) for mode in MODES[:3])
    assert np.allclose(flat.sigma_x, 1.0) and np.allclose(flat.difference, 1.0)
    assert np.allclose(along_x.sigma_x, x) and np.allclose(along_x.tau_xz, -z)
    assert np.allclose(bending.sigma_x, z) and np.allclose(bending.tau_xz, 0.0)
    for stress in (flat, along_x, bending):
        assert np.allclose(stress.sigma_z, 0.0, atol=1e-15)


def test_sums_and_multiples_are_those_of_the_stress(places):
    x, z = places
    one, other = RegularStress((1 + 0j, 2 - 1j)), RegularStress((0.5j, 1j, -3 + 2j))
    both = one + other.times(2.0)
    for name in ("difference", "trace"):
        sum_of_two = getattr(one, name)(x, z) + 2 * getattr(other, name)(x, z)
        assert np.allclose(getattr(both, name)(x, z), sum_of_two, rtol=1e-13)
    assert not RegularStress() and not RegularStress((0.0,)) and RegularStress((2.0,))
    assert np.all(RegularStress().difference(x[:, None], z[None, :]) == np.zeros((40, 40)))


def test_the_scenes_bulk_stress_and_its_changes_add_up_in_every_output():
    scene = load_scene("line-contact-wear").model_copy(update={"wear": None, "friction": None})
    size = {"camera.width_px": 80, "camera.height_px": 60, "camera.pixel_mm": 0.03}
    scene = scene.with_values({**size, "camera.left_mm": -1.0})
    values = {"bulk_mpa": 3.0, "bulk_along_x_mpa_per_mm": -0.7, "bulk_along_z_mpa_per_mm": 0.4}
    bulky = scene.with_values({f"load.{key}": value for key, value in values.items()})
    alone, both = simulate(scene, components=True), simulate(bulky, components=True)
    pixels = alone.pixels
    x, z = pixels.x_mm[None, :], pixels.z_mm[:, None]
    added = {"sigma_x": 3.0 - 0.7 * x + 0.4 * z, "sigma_z": 0.0 * x + 0.0 * z, "tau_xz": 0.7 * z}
    for name, exact in added.items():
        # single precision of stresses up to 20 MPa, each the sum of some transforms
        assert np.allclose(both.maps[name] - alone.maps[name], exact + 0.0 * x, atol=5e-5), name
    sheared = [2.0 * both.maps["tau_xz"], both.maps["sigma_x"] - both.maps["sigma_z"]]
    order = np.hypot(*sheared) * 4.0 / 14.6
    assert np.allclose(both.orders[0], order, atol=5e-5)
    # and the largest shear is no less than any of these
    assert both.history["shear_max_mpa"][0] >= 0.5 * np.hypot(*sheared).max() - 5e-5
