"""The search's quick fields against closed forms and solved contacts; its light's elimination."""

import numpy as np
import pytest

from isochrome.errors import PhysicsError
from isochrome.fitting.search.coarse_fields import Space, field_maker, pressure_table, theta_of
from isochrome.reference import disc_stress
from isochrome.scene import parse_scene
from isochrome.simulation import scene_states, state_difference
from isochrome.stress import RegularStress, pixel_grid
from scene_texts import PAPER_CONTACT, PAPER_PAIR

CAMERA = """
[camera]
width_px = 160
height_px = 120
left_mm = -2.0
top_mm = 0.02
pixel_mm = 0.025
"""
FRICTION = "\n[friction]\ncoefficient = 0.3\n"
SLIDING = PAPER_CONTACT + CAMERA + FRICTION
HELD = SLIDING.replace("normal_n = 44.0", "normal_n = 44.0\ntangential_n = 5.0\nbulk_mpa = 2.0")
FLAT = HELD.replace("radius_mm = 24.61", 'shape = "flat"\nhalf_width_mm = 0.4')
WORN = SLIDING + "\n[wear]\ncoefficient_mm2_per_n = 2e-9\ndistances_m = [155.0]\n"
DISC = """
[specimen]
shape = "disc"
diameter_mm = 10.0
thickness_mm = 6.0
fringe_value_n_per_mm = 14.6

[load]
normal_n = 600.0

[camera]
width_px = 120
height_px = 110
pixel_mm = 0.1
left_mm = -6.0
top_mm = -0.5
"""


def quick(text, **changes):
    """The scene with `changes`, and the quick field made from the unchanged one; also the places.
    Returns the changed scene, its field (n,), and x, z (n,) of the pixels 0.25 mm below and
    deeper."""
    scene = parse_scene(text)
    moved = scene.with_values({key.replace("__", "."): v for key, v in changes.items()})
    grid = pixel_grid(scene).every(3)
    keep = np.repeat((grid.z_mm > 0.25)[:, None], grid.cols, axis=1)
    field = field_maker(scene)(grid, keep).difference(theta_of(moved)[None])[0]
    there = pixel_grid(moved).every(3)
    x, z = np.meshgrid(there.x_mm, there.z_mm)
    return moved, field, x[keep], z[keep]


def of_stress(stress):
    return stress.sigma_x - stress.sigma_z + 2j * stress.tau_xz


@pytest.mark.parametrize(
    ("text", "changes", "bar"),
    [
        # a flat's pressure is infinite at its corners, and a short series' is not
        (FLAT, {"load__normal_n": 70.0, "load__tangential_n": -9.0}, 0.02),
        # worn at 5 loads and 6 doses, and straight lines between their logarithms
        (WORN, {"load__normal_n": 70.0, "wear__coefficient_mm2_per_n": 1.2e-9}, 0.02),
    ],
)
def test_other_contacts_are_near_the_solved_ones(text, changes, bar):
    scene, field, *_ = quick(text, **changes)
    grid = pixel_grid(scene).every(3)
    keep = np.repeat((pixel_grid(parse_scene(text)).every(3).z_mm > 0.25)[:, None], grid.cols, 1)
    true = state_difference(scene, scene_states(scene)[-1], grid)[keep]
    assert np.abs(field - true).max() < bar * np.abs(true).max()


def test_a_bulk_stress_that_changes_along_and_below_the_surface_is_in_the_quick_field():
    slopes = "\nbulk_along_x_mpa_per_mm = 0.4\nbulk_along_z_mpa_per_mm = -0.7\n"
    _, field, x, z = quick(HELD.replace("bulk_mpa = 2.0\n", "bulk_mpa = 2.0" + slopes))
    _, even, *_ = quick(HELD)
    # a series of analytic functions, c (x - i z): sigma_x falls with x where it grows with -tau
    series = RegularStress((0j, complex(0.4, -0.7)))
    assert np.real(series.difference(np.array(1.0), np.array(0.0))) == pytest.approx(0.4)
    assert np.real(series.difference(np.array(0.0), np.array(1.0))) == pytest.approx(-0.7)
    # single precision of some ten MPa
    np.testing.assert_allclose(field - even, series.difference(x, z), atol=1e-4)


def test_a_lopsided_indenters_contact_does_not_move_with_friction_as_an_even_ones(tmp_path):
    """Where the profile itself leans, no share of the friction says how far the contact stands."""
    x = np.linspace(-2.0, 2.0, 401)
    gap = 1e3 * np.where(x < 0.0, x**2 / 50.0, x**2 / 150.0)
    rows = "\n".join(f"{a},{b}" for a, b in zip(x, gap, strict=True))
    (tmp_path / "leaning.csv").write_text("x_mm,gap_um\n" + rows + "\n", "utf-8")
    text = SLIDING.replace("radius_mm = 24.61", 'profile = "leaning.csv"')
    scene = parse_scene(text, folder=tmp_path)
    moved = scene.with_values({"friction.coefficient": 0.05})
    (state,) = scene_states(moved)[-1:]
    left, right = state.surface.edges_mm
    half, centre, _ = pressure_table(scene).at(np.log([44.0]), np.zeros(1), np.array([0.05]))
    # the friction's own part is a twentieth of the half-width; the profile's, a third
    assert half[0] == pytest.approx(0.5 * (right - left), rel=0.03)
    assert centre[0] == pytest.approx(0.5 * (right + left), abs=0.05 * half[0])


def test_what_friction_cannot_hold_is_not_searched():
    free = np.array([0, 1], dtype=np.intp)
    rows = np.array([[0.0, 0.29, 0.3, 0.0, 0.0, 0.0, 0.0], [0.0, -0.4, 0.3, 0.0, 0.0, 0.0, 0.0]])
    held = Space(free, np.ones(7), held=True).allowed(rows.copy())
    assert held[:, 1] == pytest.approx([0.29, -0.294])  # 98 % of what friction holds
    assert held[:, 2] == pytest.approx([0.3, 0.3])
    # friction that is searched for too grows with what it must hold
    both = Space(np.array([0, 1, 2], dtype=np.intp), np.ones(7), held=True).allowed(rows.copy())
    assert both[:, 1] == pytest.approx([0.29, -0.4])
    assert both[1, 2] == pytest.approx(0.4 / 0.98)


def test_a_disc_is_its_closed_form_at_any_load_and_place():
    scene = parse_scene(DISC)
    moved = scene.with_values({"load.normal_n": 900.0, "camera.left_mm": -5.8})
    grid = pixel_grid(scene)
    keep = np.hypot(grid.x_mm[None, :], grid.z_mm[:, None] - 5.0) < 4.0
    field = field_maker(scene)(grid, keep).difference(theta_of(moved)[None])[0]
    x, z = np.meshgrid(grid.x_mm + 0.2, grid.z_mm - 5.0)
    true = disc_stress(x[keep], z[keep], load_n=900.0, diameter_mm=10.0, thickness_mm=6.0)
    np.testing.assert_allclose(field, of_stress(true), rtol=1e-6, atol=1e-6)


def test_a_scene_that_no_load_can_solve_is_refused():
    # a tenth of the radius is the loads' own half-width: no half-plane at any of them
    text = PAPER_PAIR.replace("24.61", "0.01") + "\n[load]\nnormal_n = 5e4\n" + CAMERA
    with pytest.raises(PhysicsError, match="cannot be solved at any load"):
        field_maker(parse_scene(text))
