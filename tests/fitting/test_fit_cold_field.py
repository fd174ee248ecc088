"""A scan's fields against closed forms and solved contacts; what is scanned, and its light."""

import numpy as np
import pytest

from isochrome.errors import PhysicsError
from isochrome.estimation import frame_light, linear_costs, prepare, solve_linear, total_degree
from isochrome.fitting.search import BULK, _Lattice, ladder, rungs, shears_to
from isochrome.reference import disc_stress
from isochrome.scene import parse_scene
from isochrome.simulation import scene_states, state_difference
from isochrome.stress import RegularStress, pixel_grid
from scene_texts import PAPER_CONTACT, PAPER_PAIR, camera_text, disc_text

CAMERA = camera_text(160, 120, 0.025, left_mm=-2.0, top_mm=0.02)
FRICTION = "\n[friction]\ncoefficient = 0.3\n"
SLIDING = PAPER_CONTACT + CAMERA + FRICTION
HELD = SLIDING.replace("normal_n = 44.0", "normal_n = 44.0\ntangential_n = 5.0\nbulk_mpa = 2.0")
FLAT = HELD.replace("radius_mm = 24.61", 'shape = "flat"\nhalf_width_mm = 0.4')
WORN = SLIDING + "\n[wear]\ncoefficient_mm2_per_n = 2e-9\ndistances_m = [155.0]\n"
DISC = disc_text(600.0, fringe_value=14.6, diameter_mm=10.0)
DISC += camera_text(120, 110, 0.1, left_mm=-6.0, top_mm=-0.5)


def scanned(scene, load, shear):
    """The scan's field (rows, cols) of a scene at a load and a shear, on every third pixel,
    and which pixels lie 0.25 mm below the surface and deeper."""
    grid = pixel_grid(scene).every(3)
    (rung,) = rungs(scene, grid, (load,))
    assert rung.load == load
    return rung.fields(np.array([shear]))[0], grid.z_mm > 0.25


def solved(scene):
    grid = pixel_grid(scene).every(3)
    return state_difference(scene, scene_states(scene)[-1], grid)


@pytest.mark.parametrize(
    ("text", "load", "shear", "changes", "bar"),
    [
        (SLIDING, 90.0, 0.15, {"friction.coefficient": 0.15}, 0.05),
        # where it sticks moves with the force, and is no straight line in it; a step of the scan's
        # load alone is 19 % of the stress
        (HELD, 90.0, -0.2, {"load.tangential_n": -18.0}, 0.05),
        (FLAT, 70.0, -0.13, {"load.tangential_n": -9.1}, 0.05),
        (WORN, 70.0, 0.3, {}, 0.02),
    ],
)
def test_a_scans_fields_are_near_the_solved_ones(text, load, shear, changes, bar):
    scene = parse_scene(text)
    field, below = scanned(scene, load, shear)
    true = solved(scene.with_values({"load.normal_n": load} | changes))
    assert np.abs(field - true)[below].max() < bar * np.abs(true[below]).max()


def test_a_bulk_stress_that_changes_along_and_below_the_surface_is_in_the_scan():
    slopes = "\nbulk_along_x_mpa_per_mm = 0.4\nbulk_along_z_mpa_per_mm = -0.7\n"
    scene = parse_scene(HELD.replace("bulk_mpa = 2.0\n", "bulk_mpa = 2.0" + slopes))
    field, below = scanned(scene, 44.0, 0.1)
    even, _ = scanned(parse_scene(HELD), 44.0, 0.1)
    # a series of analytic functions, c (x - i z): sigma_x falls with x where it grows with -tau
    series = RegularStress((0j, complex(0.4, -0.7)))
    assert np.real(series.difference(np.array(1.0), np.array(0.0))) == pytest.approx(0.4)
    assert np.real(series.difference(np.array(0.0), np.array(1.0))) == pytest.approx(-0.7)
    grid = pixel_grid(scene).every(3)
    added = series.difference(grid.x_mm[None, :], grid.z_mm[:, None])
    # single precision of some ten MPa
    np.testing.assert_allclose((field - even)[below], added[below], atol=1e-4)


def test_a_lopsided_indenters_contact_does_not_move_with_the_friction(tmp_path):
    """Where the profile itself leans, no share of the friction says how far the contact stands."""
    x = np.linspace(-2.0, 2.0, 401)
    gap = 1e3 * np.where(x < 0.0, x**2 / 50.0, x**2 / 150.0)
    rows = "\n".join(f"{a},{b}" for a, b in zip(x, gap, strict=True))
    (tmp_path / "leaning.csv").write_text("x_mm,gap_um\n" + rows + "\n", "utf-8")
    text = SLIDING.replace("radius_mm = 24.61", 'profile = "leaning.csv"')
    scene = parse_scene(text, folder=tmp_path)
    field, below = scanned(scene, 44.0, 0.1)
    true = solved(scene.with_values({"friction.coefficient": 0.1}))
    # the friction's own part is a twentieth of the half-width; the profile's, a third
    assert np.abs(field - true)[below].max() < 0.05 * np.abs(true[below]).max()


def test_a_disc_is_its_closed_form_at_any_load():
    scene = parse_scene(DISC)
    grid = pixel_grid(scene)
    keep = np.hypot(grid.x_mm[None, :], grid.z_mm[:, None] - 5.0) < 4.0
    (rung,) = rungs(scene, grid, (900.0,))
    x, z = np.meshgrid(grid.x_mm, grid.z_mm - 5.0)
    true = disc_stress(x[keep], z[keep], load_n=900.0, diameter_mm=10.0, thickness_mm=6.0)
    expected = true.sigma_x - true.sigma_z + 2j * true.tau_xz
    np.testing.assert_allclose(rung.fields(np.zeros(1))[0][keep], expected, rtol=1e-6, atol=1e-6)


def test_a_scene_that_no_load_can_solve_is_refused():
    # a tenth of the radius is the loads' own half-width: no half-plane at any of them
    text = PAPER_PAIR.replace("24.61", "0.01") + "\n[load]\nnormal_n = 5e4\n" + CAMERA
    scene = parse_scene(text)
    with pytest.raises(PhysicsError, match="half-width would be"):
        list(rungs(scene, pixel_grid(scene), 5e4 * ladder(4.0, 0.5)))


def test_steps_are_no_wider_than_asked_and_reach_both_ends():
    factors = ladder(4.0, 0.19)
    assert factors[[0, -1]] == pytest.approx([0.25, 4.0])
    assert np.diff(np.log(factors)) == pytest.approx(np.log(4.0) / 7.5)  # 2 ln 4 / 15
    assert shears_to(0.3) == pytest.approx([-0.225, -0.075, 0.075, 0.225])


def test_what_friction_cannot_hold_is_not_searched():
    scene = parse_scene(HELD)
    held = _Lattice(scene, ("load.normal_n", "load.tangential_n"), 5)
    assert np.abs(held.shears).max() < 0.9 * 0.3
    # friction that is searched for too grows with what it must hold
    both = _Lattice(scene, (*held.keys, "friction.coefficient"), 5)
    assert np.abs(both.shears).max() > 0.4
    moved = both.moved(100.0, 0, -0.4, {})
    assert moved.load.tangential_n == pytest.approx(-40.0)
    assert moved.friction.coefficient == pytest.approx(0.4 / 0.98)
    assert both.moved(100.0, 0, 0.1, {}).friction.coefficient == 0.3


def test_scenes_within_a_step_in_all_that_is_scanned_are_alike():
    scene = parse_scene(HELD)
    lattice = _Lattice(scene, ("load.normal_n", "load.tangential_n", BULK, "camera.left_mm"), 5)
    at = (50.0, 1, 0.1, {BULK: 0.0})
    here = lattice.moved(*at)
    assert lattice.alike(here, lattice.moved(58.0, 2, 0.25, {BULK: lattice.fringe_mpa / 3.0}))
    for j, far in enumerate((75.0, 3, -0.15, {BULK: lattice.fringe_mpa})):
        assert not lattice.alike(here, lattice.moved(*at[:j], far, *at[j + 1 :]))
    away = [rival.load.bulk_mpa - here.load.bulk_mpa for rival in lattice.rivals(here)]
    assert away == pytest.approx([-14.6 / 4.0, 14.6 / 4.0])


def test_what_the_best_light_leaves_of_signals_is_that_of_each_alone():
    rng = np.random.default_rng(5)
    shape, terms = (20, 30), (total_degree(1), total_degree(0))
    along = np.linspace(-1.0, 1.0, 30)
    signals = rng.uniform(0.0, 1.0, (4, *shape))
    image = 0.1 + (0.5 + 0.2 * along) * signals[2] + 0.01 * rng.standard_normal(shape)
    problem = prepare(image, mask=None, sigma=0.01, light=frame_light(shape, terms=terms))
    pictures = np.array([problem.data, -problem.data])
    costs, light = linear_costs(*problem.columns, pictures, signals.reshape(4, -1))
    for signal, cost, mean in zip(signals, costs, light, strict=True):
        alone = solve_linear(problem, signal.ravel())
        assert cost == pytest.approx([alone.cost, alone.cost], rel=1e-6)
        assert mean[0] == pytest.approx(-mean[1])
    assert np.argmin(costs[:, 0]) == 2 and light[2, 0] > 0.0
