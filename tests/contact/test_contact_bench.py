"""What a bench's contact has: rough bodies, a load that is not even, a layer that wears in."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.optimize import root

from hard.hard_cases import (
    COUPLING,
    HALF_WIDTH,
    LOAD,
    MODULUS,
    PEAK,
    RADIUS,
    influence,
    parabola,
    table,
    write_profile,
)
from isochrome.contact import (
    contact_states,
    displacement,
    make_surface,
    solve_pressure,
    state,
    wear_course,
)
from isochrome.errors import InputError
from isochrome.reference import hertz_pressure
from isochrome.scene import load_scene
from isochrome.specimens import specimen_model
from isochrome.stress import pixel_grid

PAPER = load_scene("line-contact-wear")
COARSE = {"numerics.spacing_mm": 0.0121, "numerics.tolerance": 1e-3}
ROUGHNESS = 1e-4


def solved(n=201, half=0.8, *, modulus=MODULUS, coupling=0.0, gap=parabola, **options):
    """Nodes, their spacing, the surface, and the contact between rough bodies."""
    x = np.linspace(-half, half, n)
    surface = make_surface(n, x[1] - x[0], contact_modulus_mpa=modulus, coupling_per_mpa=coupling)
    options = {"roughness_mm": ROUGHNESS} | options
    return x, x[1] - x[0], surface, solve_pressure(surface, gap(x), LOAD, **options)


def sliding(**values):
    """The shipped scene, unworn and sliding, with other values; keys with __ for the dot."""
    scene = PAPER.model_copy(update={"wear": None})
    changed = {key.replace("__", "."): value for key, value in values.items()}
    return scene.with_values({"friction.static_state_first": False} | changed)


def worn(*distances, **values):
    """The shipped scene at some distances on a coarse grid, with other values."""
    changed = {key.replace("__", "."): value for key, value in values.items()}
    more = {"friction.static_state_first": False, "wear.distances_m": distances}
    return PAPER.with_values(COARSE | more | changed)


# Rough bodies


@pytest.mark.parametrize("n", [201, 801])  # by elimination, and by conjugate residuals
@pytest.mark.parametrize("roughness", [1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("friction", [0.0, 0.9])
def test_the_pressure_falls_as_the_exponential_of_the_separation(n, roughness, friction):
    """Gap + u + lambda ln p is one number wherever there is pressure, and the load is carried."""
    x, h, surface, rough = solved(n, coupling=COUPLING, friction=friction, roughness_mm=roughness)
    p = rough.pressure
    inside = p > 0.0
    u = displacement(surface, p, friction=friction)
    separation = (parabola(x) + u + roughness * np.log(np.where(inside, p, 1.0)))[inside]
    assert np.ptp(separation) < 1e-9 * (np.ptp(u) + roughness)
    assert h * p.sum() == pytest.approx(LOAD, rel=1e-9)
    assert inside.sum() > np.count_nonzero(np.abs(x) < HALF_WIDTH) - 2


@pytest.mark.parametrize("friction", [0.0, 0.9])
def test_the_rough_pressure_is_that_of_a_direct_solution(friction):
    """A general root finder on ln p and the approach, with the direct sum of hats."""
    x, h, _, rough = solved(81, coupling=COUPLING, friction=friction, roughness_mm=1e-3)
    kernel = influence(x, coupling=COUPLING, friction=friction)

    def equations(unknown):
        logarithm, approach = unknown[:-1], unknown[-1]
        p = np.exp(logarithm)
        height = (parabola(x) + kernel @ p + 1e-3 * logarithm - approach) / 1e-3
        return np.append(height, h * p.sum() / LOAD - 1.0)

    start = np.append(np.log(np.maximum(rough.pressure, 1e-7 * PEAK)), 0.0)
    start[-1] = 1e-3 * equations(start)[40]
    direct = root(equations, start, tol=1e-12)
    assert direct.success
    assert rough.pressure == pytest.approx(np.exp(direct.x[:-1]), abs=1e-6 * PEAK)


def test_roughness_that_vanishes_leaves_hertz_with_an_error_of_the_first_order():
    _, _, _, smooth = solved(801, roughness_mm=0.0)
    off = [
        smooth.pressure.max() - solved(801, roughness_mm=r)[3].pressure.max()
        for r in (1e-6, 2e-6, 4e-6)
    ]
    assert 0.0 < off[0] < 3e-4 * PEAK
    for small, large in pairwise(off):
        assert large / small == pytest.approx(2.0, rel=0.05)


def test_rigid_bodies_that_are_rough_have_gausss_curve():
    """p = P'/√(2πRλ) exp(-x²/2Rλ) without elasticity, whose error is of the first order in 1/E*."""
    wide = np.sqrt(RADIUS * 1e-3)
    errors = []
    for stiff in (1e3, 1e4, 1e5):
        x, _, _, rough = solved(401, 8 * wide, modulus=stiff * MODULUS, roughness_mm=1e-3)
        exact = LOAD / (np.sqrt(2 * np.pi) * wide) * np.exp(-0.5 * (x / wide) ** 2)
        errors.append(np.abs(rough.pressure - exact).max() / exact.max())
    assert errors[-1] < 1e-5
    for large, small in pairwise(errors):
        assert large / small == pytest.approx(10.0, rel=0.05)


def test_the_rough_pressure_converges_by_the_second_order_in_the_spacing():
    places = np.linspace(-0.5, 0.5, 9)  # nodes of all grids
    rows = []
    for n in (129, 257, 513, 1025):
        x, _, _, rough = solved(n, 1.0)
        rows.append(np.interp(places, x, rough.pressure))
    steps = [np.abs(a - b).max() for a, b in pairwise(rows)]
    assert steps[-1] < 2e-4 * PEAK
    for coarse, fine in pairwise(steps):
        assert np.log2(coarse / fine) > 1.7


@pytest.mark.parametrize("kind", ["flat", "waves", "conforming", "many"])
def test_rough_bodies_of_any_form_touch(kind):
    """Hard case: corners, waves that part the contact, a scar's arc, and large roughness."""
    x = np.linspace(-1.0, 1.0, 1201)
    gap = {
        "flat": np.where(np.abs(x) > 0.3, 1e3, 0.0),
        "waves": parabola(x) + 2e-3 * np.cos(2 * np.pi * x / 0.11),
        "conforming": parabola(x) + 0.9 * np.maximum(0.0, 0.005 - parabola(x)),
        "many": parabola(x),
    }[kind]
    roughness = 0.05 if kind == "many" else 1e-5
    for friction in (-0.9, 0.25):
        _, h, _, rough = solved(
            1201, 1.0, coupling=COUPLING, gap=lambda _: gap, friction=friction,
            roughness_mm=roughness, layer_mm_per_mpa=1e-5,
        )  # fmt: skip
        assert rough.residual <= 1e-10
        assert h * rough.pressure.sum() == pytest.approx(LOAD, rel=1e-9)


def test_a_rough_contact_does_not_depend_on_where_the_solver_starts():
    """Hard case: waves that part the contact, from noise."""

    def waves(x):
        return parabola(x) + 1.6e-3 * np.cos(2 * np.pi * x / 0.07)

    options = {"gap": waves, "coupling": COUPLING, "friction": -0.6, "roughness_mm": 1e-5}
    _, _, _, cold = solved(2501, 1.0, **options)
    rng = np.random.default_rng(0)
    start = rng.random(2501) * rng.integers(0, 2, 2501)
    _, _, _, other = solved(2501, 1.0, **options, start=start)
    assert other.pressure == pytest.approx(cold.pressure, abs=1e-6 * cold.pressure.max())


def test_a_rough_contact_of_a_scene_lies_on_its_grid_and_has_a_width():
    """Hard case: large roughness. The pressure is nothing at the grid's ends; the width is that of
    a hundredth of the largest, Hertz's where the roughness vanishes."""
    (bare,) = contact_states(sliding())
    for roughness, wider in ((1e-4, 0.99), (5.0, 3.0)):
        (rough,) = contact_states(sliding(contact__roughness_um=roughness))
        assert rough.pressure_mpa[[0, -1]].max() == 0.0
        assert rough.contact_width_mm > wider * bare.contact_width_mm
        assert rough.line_load_n_per_mm == pytest.approx(11.0, rel=1e-9)
    (nearly,) = contact_states(sliding(contact__roughness_um=1e-4))
    assert nearly.contact_width_mm == pytest.approx(bare.contact_width_mm, rel=3e-3)


# A load that is not even through the thickness


def hertz_mean(x, change, count=2001):
    """Mean of Hertz's pressure over slices by the midpoint rule, one side lifted off or not."""
    y = (np.arange(count) + 0.5) * 2.0 / count - 1.0
    share = np.maximum(0.0, 1.0 + change * y)
    share /= share.mean()
    pressures = [
        hertz_pressure(x, half_width_mm=HALF_WIDTH * s**0.5, peak_pressure_mpa=PEAK * s**0.5)
        for s in share[share > 0.0]
    ]
    return np.sum(pressures, axis=0) / count


@pytest.mark.parametrize("tilt", [0.1, 0.5, -0.5, 1.5])
def test_a_tilted_loads_pressure_is_the_mean_of_its_slices(tilt):
    """Hard case: one side lifted off, where half of the thickness times the tilt is over one."""
    (tilted,) = contact_states(sliding(load__tilt=tilt, friction__coefficient=0.0))
    want = hertz_mean(tilted.grid.x_mm, 2.0 * abs(tilt))
    assert tilted.line_load_n_per_mm == pytest.approx(11.0, rel=1e-12)
    # eight slices have eight edges, each a root
    middle = np.abs(tilted.grid.x_mm) < 0.1
    assert tilted.pressure_mpa[middle] == pytest.approx(want[middle], abs=0.01 * PEAK)
    assert np.abs(np.cumsum(tilted.pressure_mpa - want)).max() < 0.01 * np.sum(want)


def field_at(scene, monkeypatch, count, depth_mm):
    """Stress difference, complex, along the row at a depth, by so many slices."""
    for name, values in zip(("NODES", "WEIGHTS"), leggauss(count), strict=True):
        monkeypatch.setattr(state, name, values)
    (tilted,) = contact_states(scene)
    pixels = pixel_grid(scene).every(4)
    row = int(np.argmin(np.abs(pixels.z_mm - depth_mm)))
    return specimen_model(scene).difference(scene, tilted, pixels)[row].astype(complex)


@pytest.mark.parametrize("tilt", [0.25, 1.0])
def test_slices_converge_geometrically_below_the_surface(tilt, monkeypatch):
    """At a depth z by a factor for each slice, as Gauss's rule does where nothing is singular; at
    the surface, where each slice has an edge, only with their number."""
    scene = sliding(load__tilt=tilt)
    exact = field_at(scene, monkeypatch, 101, 0.1)
    errors = [np.abs(field_at(scene, monkeypatch, n, 0.1) - exact).max() for n in (3, 5, 7)]
    for coarse, fine in pairwise(errors):
        assert coarse / fine > 4.0
    assert errors[-1] < 3e-3 * np.abs(exact).max()


def test_a_small_tilt_acts_by_its_square(monkeypatch):
    """F + (κ d/2)² P²/6 ∂²F/∂P² to the second order; either sign of the tilt is the same."""
    small = [field_at(sliding(load__tilt=t), monkeypatch, 8, 0.2) for t in (0.0, 0.02, 0.04, -0.04)]
    np.testing.assert_array_equal(small[2], small[3])
    one, two = (np.abs(part - small[0]).max() for part in small[1:3])
    assert two / one == pytest.approx(4.0, rel=0.02)
    near = [field_at(sliding(load__normal_n=44.0 * s), monkeypatch, 1, 0.2) for s in (0.98, 1.02)]
    curved = (near[0] + near[1] - 2.0 * small[0]) / 0.02**2
    want = (0.04 * 2.0) ** 2 / 6.0 * curved
    assert np.abs(small[2] - small[0] - want).max() < 0.05 * np.abs(want).max()


CASES = {
    "static": PAPER.model_copy(update={"friction": None, "wear": None}),
    "held": PAPER.model_copy(update={"wear": None}).with_values({"load.tangential_n": 8.0}),
    "worn": worn(0.0, 31.0),
    "loads": worn(31.0, 77.0, load__normal_n=table((0.0, 44.0), (50.0, 66.0))),
    "rough": worn(31.0, contact__roughness_um=0.1),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("tilt", [0.3, 0.8])
def test_each_slice_is_a_contact_under_its_own_load(name, tilt):
    """In every state: the mean of contacts with parts of the loads, which wear by themselves."""
    scene = CASES[name].with_values({"load.tilt": tilt} | COARSE)
    shares, weights = state.slice_loads(scene)
    whole = scene.load.normal_n
    parts = []
    for share in shares.tolist():
        load = {"load.tilt": 0.0, "load.normal_n": share * whole} if isinstance(whole, float) else {
            "load.tilt": 0.0, "load.normal_n": table(*(
                (s, share * v) for s, v in zip(whole.distance_m, whole.value, strict=True)
            ))
        }  # fmt: skip
        if scene.load.tangential_n:
            load["load.tangential_n"] = share * scene.load.tangential_n
        window = {"numerics.window_mm": 3.0}
        parts.append(contact_states(scene.with_values(load | window)))
    tilted = contact_states(scene.with_values({"numerics.window_mm": 3.0}))
    for k, mean in enumerate(tilted):
        for key in ("pressure_mpa", "shear_mpa", "wear_depth_mm"):
            want = sum(w * getattr(part[k], key) for w, part in zip(weights, parts, strict=True))
            error = np.abs(getattr(mean, key) - want).max()
            assert error <= 1e-9 * np.abs(want).max()
        widest = max(part[k].contact_width_mm for part in parts)
        if not mean.rough:  # whose edges are a share of the mean
            assert mean.contact_width_mm == pytest.approx(widest, abs=scene.numerics.spacing_mm)


def test_a_tilted_contact_wears_as_much_as_an_even_one():
    """Hard case: one side lifted off and worn. ∫h dx = K P' whatever the slices' shapes."""
    even, tilted = (contact_states(worn(77.0, load__tilt=t))[-1] for t in (0.0, 0.8))
    assert tilted.worn_area_mm2 == pytest.approx(even.worn_area_mm2, rel=2e-3)
    assert tilted.contact_width_mm > 1.2 * even.contact_width_mm
    assert tilted.wear_depth_mm.max() < even.wear_depth_mm.max()


def test_a_tilt_of_a_measured_profile_and_of_a_block(tmp_path):
    x = np.linspace(-1.2, 1.2, 481)
    line = write_profile(tmp_path, x, parabola(x) + 2e-4 * np.cos(40 * x))
    name = line.split('"')[1]
    scene = sliding(
        load__tilt=0.3, indenter__profile=str(tmp_path / name), numerics__tolerance=1e-3
    )
    scene = scene.with_values({"indenter.radius_mm": None})
    (measured,) = contact_states(scene)
    assert measured.line_load_n_per_mm == pytest.approx(11.0, rel=1e-9)
    block = sliding(
        load__tilt=0.3, specimen__shape="block", specimen__width_mm=60.0, specimen__height_mm=40.0
    )
    (state_,) = contact_states(block)
    field = specimen_model(block).difference(block, state_, pixel_grid(block).every(40))
    assert np.isfinite(field[1:]).all()


def test_a_scene_without_a_tilt_is_one_slice():
    assert state.slices(PAPER) == [PAPER] and PAPER.is_bare


def test_a_tilt_needs_a_contact():
    with pytest.raises(InputError, match=r"load\.tilt is the change of a contact's load"):
        load_scene("ring").with_values({"load.tilt": 0.1})


# What lies between the bodies, over distance


def stepped(scene, steps):
    """Depth by so many implicit steps of Euler's, with the layer and roughness of their ends."""
    history, (stop,) = wear_course(scene)
    (reached,) = contact_states(scene)
    grid = reached.grid
    surface = make_surface(
        grid.nodes, grid.spacing_mm, contact_modulus_mpa=MODULUS, coupling_per_mpa=COUPLING
    )
    depth, start = np.zeros(grid.nodes), None
    dose = stop.dose_mm_per_mpa / steps
    for k in range(1, steps + 1):
        load, mu, layer, roughness = history.at(k * dose)
        start = solve_pressure(
            surface, parabola(grid.x_mm) + depth, load, friction=mu, roughness_mm=roughness,
            layer_mm_per_mpa=layer + dose, start=start,
        ).pressure  # fmt: skip
        depth = depth + dose * start
    return reached, depth


@pytest.mark.parametrize("key", ["contact__layer_um_per_mpa", "contact__roughness_um"])
def test_what_wears_in_is_followed_over_the_distance(key):
    """Against the first order's steps of a hundredth and a two-hundredth, and their limit."""
    scene = worn(31.0, **{key: table((0.0, 0.3), (20.0, 0.05))})
    (reached, coarse), (_, fine) = stepped(scene, 100), stepped(scene, 200)
    limit = 2.0 * fine - coarse
    error = np.abs(reached.wear_depth_mm - limit).max() / limit.max()
    assert error < 3e-3 and error < np.abs(coarse - limit).max() / limit.max()
    (constant,) = contact_states(worn(31.0, **{key: 0.05}))
    # it remembers that it was softer: it is wider and not as deep
    assert reached.wear_depth_mm.max() < 0.99 * constant.wear_depth_mm.max()


@pytest.mark.parametrize("key", ["contact__layer_um_per_mpa", "contact__roughness_um"])
def test_a_table_of_one_value_is_that_number(key):
    one, other = (
        contact_states(worn(31.0, **{key: value}))[-1]
        for value in (0.1, table((0, 0.1), (40, 0.1)))
    )
    assert one.pressure_mpa == pytest.approx(other.pressure_mpa, abs=1e-3 * one.p_max_mpa)
    assert one.wear_depth_mm == pytest.approx(
        other.wear_depth_mm, abs=1e-3 * one.wear_depth_mm.max()
    )


def test_a_static_state_has_what_lies_between_at_no_distance():
    over = table((0.0, 0.2), (31.0, 0.0))
    scene = worn(31.0, contact__roughness_um=over, friction__static_state_first=True)
    still, slid = contact_states(scene)
    (want,) = contact_states(sliding(contact__roughness_um=0.2, friction__coefficient=0.0, **{
        key.replace(".", "__"): value for key, value in COARSE.items()
    }))  # fmt: skip
    assert still.p_max_mpa == pytest.approx(want.p_max_mpa, rel=1e-6)
    assert still.rough and not slid.rough
