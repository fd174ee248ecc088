"""Principal stresses apart, and the largest shear: only when asked for, and right."""

import numpy as np
import pytest
import tifffile

import isochrome.simulation.rendering as rendering
from isochrome import reference
from isochrome.frames import open_tiff
from isochrome.output import read_csv
from isochrome.scene import load_scene, parse_scene
from isochrome.simulation import simulate
from isochrome.stress import pixel_grid
from simulation.test_simulate_scene import BEAM, DISC

MAPS = ("sigma_1", "sigma_2", "sigma_x", "sigma_z", "tau_xz", "sigma_1_direction")
SCENE = load_scene("line-contact-wear").with_values(
    {
        "camera.width_px": 140, "camera.height_px": 80, "camera.left_mm": -1.4,
        "camera.pixel_mm": 0.02, "numerics.spacing_mm": 0.0025, "numerics.tolerance": 1e-3,
        "wear.distances_m": (0.0, 233.0),
    }
)  # fmt: skip
MODULUS = reference.contact_modulus(2100.0, 0.4, 210000.0, 0.3)
HALF_WIDTH = reference.hertz_half_width(11.0, 24.61, MODULUS)
PEAK = reference.hertz_peak_pressure(11.0, 24.61, MODULUS)


@pytest.fixture(scope="module")
def found():
    return simulate(SCENE, components=True)


def test_components_under_the_static_contact_are_mcewens(found):
    pixels = pixel_grid(SCENE)
    truth = reference.hertz_stress(
        pixels.x_mm[None, :], pixels.z_mm[:, None], half_width_mm=HALF_WIDTH, peak_pressure_mpa=PEAK
    )
    for name, exact in (
        ("sigma_x", truth.sigma_x),
        ("sigma_z", truth.sigma_z),
        ("tau_xz", truth.tau_xz),
    ):
        # the edge's root over 150 spacings a half-width, seen half a pixel below the surface
        assert np.abs(found.maps[name][0] - exact).max() < 1e-3 * PEAK


def test_a_bulk_stress_adds_to_the_stress_along_the_surface_alone(found):
    bent = SCENE.with_values({"load.bulk_mpa": 3.0, "wear.distances_m": (0.0,)})
    maps = simulate(bent, components=True).maps
    for name, bulk in (("sigma_x", 3.0), ("sigma_z", 0.0), ("tau_xz", 0.0)):
        # float32
        np.testing.assert_allclose(maps[name] - found.maps[name][:2], bulk, atol=2e-6 * PEAK)


def test_principal_stresses_and_direction_are_the_tensors_eigenvalues_and_axis(found):
    """Eigenvalues of each pixel's stress tensor; the eigenvector's angle, turned up: z is down."""
    x, z, shear = (
        found.maps[k].astype(float)[1:, ::9, ::9] for k in ("sigma_x", "sigma_z", "tau_xz")
    )
    tensor = np.stack([np.stack([x, shear], -1), np.stack([shear, z], -1)], -1)
    values, axes = np.linalg.eigh(tensor)
    first, second, angle = (
        found.maps[k][1:, ::9, ::9] for k in ("sigma_1", "sigma_2", "sigma_1_direction")
    )
    np.testing.assert_allclose(first, values[..., 1], atol=1e-6 * PEAK)  # float32
    np.testing.assert_allclose(second, values[..., 0], atol=1e-6 * PEAK)
    exact = np.degrees(np.arctan2(-axes[..., 1, 1], axes[..., 0, 1]))
    off = (angle - exact + 90.0) % 180.0 - 90.0
    # an angle is known to the rounding of the stresses over their difference
    assert np.abs(np.radians(off) * (first - second)).max() < 2e-6 * PEAK
    assert angle.min() >= -90.0 and angle.max() <= 90.0


def test_largest_shear_is_hertzs_and_between_the_pixels(found):
    truth = reference.hertz_largest_difference(half_width_mm=HALF_WIDTH, peak_pressure_mpa=PEAK)
    # second order in the spacing over the half-width, 1/150; measured 7e-6
    assert found.history["shear_max_mpa"][0] == pytest.approx(0.5 * truth.difference_mpa, rel=2e-5)
    assert found.history["shear_max_x_mm"][0] == pytest.approx(0.0, abs=1e-6)
    assert found.history["shear_max_z_mm"][0] == pytest.approx(truth.depth_mm, rel=1e-5)
    # and no less than at any pixel's centre (float32)
    for index, most in enumerate(found.history["shear_max_mpa"]):
        shear = 0.5 * (found.maps["sigma_1"][index] - found.maps["sigma_2"][index])
        assert most >= np.nanmax(shear) * (1.0 - 1e-6)


def test_wear_brings_the_largest_shear_to_the_surface_at_an_edge(found):
    """At 233 m both edges have nearly as much; before wear it lies 0.2 mm deep."""
    edges = np.array(found.states[-1].surface.edges_mm)
    assert found.history["shear_max_z_mm"][1] > 0.1
    assert found.history["shear_max_z_mm"][-1] < 0.005
    assert np.abs(edges - found.history["shear_max_x_mm"][-1]).min() < 0.01


def test_a_discs_centre_has_the_stresses_of_frocht():
    out = simulate(parse_scene(DISC), components=True)
    # 8 P/(pi D f); float32
    assert out.orders[0, 120, 120] == pytest.approx(8 * 120 / (np.pi * 20 * 12), rel=1e-6)
    assert np.isnan(out.history["p_max_mpa"][0])
    unit = 2.0 * 120.0 / (np.pi * 20.0 * 6.0)  # 2 P/(pi D d)
    assert out.maps["sigma_x"][0, 120, 120] == pytest.approx(unit, rel=1e-6)
    assert out.maps["sigma_z"][0, 120, 120] == pytest.approx(-3.0 * unit, rel=1e-6)
    assert out.maps["sigma_1_direction"][0, 120, 120] == pytest.approx(0.0, abs=1e-4)
    assert np.isnan(out.maps["sigma_1"][0, 0, 0])


def test_a_beams_largest_shear_is_that_of_its_edge():
    out = simulate(parse_scene(BEAM), components=True)
    moment, inertia = 500.0 * (100.0 - 40.0) / 4.0, 6.0 * 20.0**3 / 12.0
    assert out.history["shear_max_mpa"][0] == pytest.approx(0.5 * moment * 10.0 / inertia)
    assert out.history["shear_max_z_mm"][0] in (0.0, 20.0)
    # compressed above, stretched below: nothing across
    assert np.nanmax(out.maps["sigma_1"][0, :120]) == 0.0 > np.nanmin(out.maps["sigma_2"][0, :120])
    assert np.nanmin(out.maps["sigma_2"][0, 120:]) == 0.0 < np.nanmax(out.maps["sigma_1"][0, 120:])


def test_nobody_computes_components_unasked(monkeypatch):
    def refuse(*_):
        raise AssertionError

    monkeypatch.setattr(rendering, "state_components", refuse)
    out = simulate(SCENE)
    assert out.maps == {}
    assert out.history["shear_max_x_mm"] == out.history["n_max_x_mm"]
    assert out.history["shear_max_z_mm"] == out.history["n_max_z_mm"]
    # N = (sigma_1 - sigma_2) d / f_sigma, float32
    for shear, order in zip(out.history["shear_max_mpa"], out.history["n_max"], strict=True):
        assert 2.0 * shear * 4.0 / 14.6 == pytest.approx(order, rel=1e-6)


@pytest.mark.long
def test_components_are_left_as_maps_with_a_scale_and_a_figure(tmp_path, found):
    above = SCENE.with_values({"camera.top_mm": -0.1, "wear.distances_m": (0.0,)})
    simulate(above, tmp_path, components=True)
    assert {f"{name}.tif" for name in MAPS} | {"stress.png"} <= {p.name for p in tmp_path.iterdir()}
    for name in MAPS:
        stack = tifffile.imread(tmp_path / f"{name}.tif")
        assert stack.dtype == np.float32 and stack.shape == (2, 80, 140)
        assert np.isnan(stack[:, :5]).all()  # above the surface
        below = found.maps[name][0, :75]
        # the same field, five rows further down; the angle is loose where there is no difference
        if name != "sigma_1_direction":
            np.testing.assert_allclose(stack[0, 5:], below, atol=1e-6 * PEAK)
        assert open_tiff(tmp_path / f"{name}.tif").pixel_mm == pytest.approx(0.02, rel=1e-6)
    history = read_csv(tmp_path / "history.csv")
    assert history["shear_max_z_mm"][0] == pytest.approx(found.history["shear_max_z_mm"][0])
    assert (tmp_path / "stress.png").read_bytes().startswith(b"\x89PNG")
