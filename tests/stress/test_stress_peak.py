"""The largest shear and its place, against closed forms and against the field itself."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from isochrome.errors import InputError
from isochrome.reference import hertz_pressure, hertz_stress, sliding_hertz_stress
from isochrome.stress import PixelGrid, RegularStress, largest_shear, stress_components

A, P0 = 0.37, 18.0
SIZE = {"half_width_mm": A, "peak_pressure_mpa": P0}
WINDOW = (-2.0, 2.0, 0.0, 3.0)


def hertz_nodes(n):
    """Nodes with one on each edge of the contact, and the pressure there."""
    nodes = A / ((n - 1) // 2 - 10) * np.arange(-((n - 1) // 2), (n - 1) // 2 + 1)
    return nodes, hertz_pressure(nodes, **SIZE)


def lost(nodes):
    """Share of the load that straight pieces lack: -ζ(-1/2) 4 sqrt(2)/π (h/a)^1.5, 0.374 of it."""
    return 0.4 * ((nodes[1] - nodes[0]) / A) ** 1.5


def climbed(friction, start, bulk=0.0):
    """Place and size of the closed form's largest shear near a start."""

    def less(at):
        field = sliding_hertz_stress(at[0], abs(at[1]), friction=friction, **SIZE)
        return -0.5 * np.hypot(field.sigma_x - field.sigma_z + bulk, 2 * field.tau_xz)

    found = minimize(less, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-13})
    return found.x, -found.fun


@pytest.mark.parametrize("friction", [0.1, 0.25, -0.25])
def test_under_sliding_it_is_the_closed_forms_maximum(friction):
    nodes, p = hertz_nodes(801)
    peak = largest_shear(nodes, p, friction * p, within=WINDOW)
    place, size = climbed(friction, [np.sign(friction) * 0.6 * A, 0.6 * A])
    # the missing load sits at the edges, one of which is nearer than the middle
    assert peak.shear_mpa == pytest.approx(size, rel=2 * lost(nodes))
    assert (peak.x_mm, peak.z_mm) == pytest.approx(tuple(place), abs=5e-4 * A)


def test_at_large_friction_it_sits_on_the_surface():
    """mu = 0.6: |D|/2 is mu p0 all over the contact's surface; straight pieces overshoot at its
    edges by a share that falls with the root of their length."""
    over = []
    for n in (201, 741):
        nodes, p = hertz_nodes(n)
        assert (n - 1) // 2 - 10 == {201: 90, 741: 360}[n]
        peak = largest_shear(nodes, p, 0.6 * p, within=WINDOW)
        assert peak.z_mm == 0.0 and abs(peak.x_mm) <= A
        over.append(peak.shear_mpa / (0.6 * P0) - 1.0)
    assert 0.0 < over[1] < over[0] < 0.05
    # four times finer; next order in h/a of some 10 %
    assert over[0] / over[1] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("friction", [0.1, 0.25])
def test_its_place_is_far_finer_than_a_spacing(friction):
    """Nodes 5 um apart, and a simplex that climbs the same nodes' field from a start nearby."""
    nodes, p = hertz_nodes(161)
    peak = largest_shear(nodes, p, friction * p, within=WINDOW)

    def less(at):
        return -stress_components(*at, nodes, p, friction * p).principal_difference / 2

    start = [peak.x_mm + 2e-3, peak.z_mm - 3e-3]
    options = {"xatol": 1e-9, "fatol": 1e-15}
    found = minimize(less, start, method="Nelder-Mead", options=options)
    # its top is flat: a rounding of 1e-15 of the value is 1e-8 of the place
    assert (peak.x_mm, peak.z_mm) == pytest.approx(tuple(found.x), abs=1e-6)
    assert peak.shear_mpa == pytest.approx(-found.fun, rel=1e-13)


def test_beyond_the_window_nothing_counts():
    """A window beside and below the peak: the largest value inside lies on its nearest corner."""
    nodes, p = hertz_nodes(401)
    peak = largest_shear(nodes, p, None, within=(0.5, 2.0, 1.0, 3.0))
    x, z = np.meshgrid(np.linspace(0.5, 2.0, 61), np.linspace(1.0, 3.0, 81))
    exact = hertz_stress(x, z, **SIZE).principal_difference / 2
    at = np.unravel_index(exact.argmax(), exact.shape)
    assert (peak.x_mm, peak.z_mm) == pytest.approx((x[at], z[at]), abs=1e-9)
    assert peak.shear_mpa == pytest.approx(exact.max(), rel=lost(nodes))


def test_a_window_far_from_the_contact_is_searched_too():
    nodes, p = hertz_nodes(401)
    peak = largest_shear(nodes, p, None, within=(30.0, 50.0, 0.0, 100.0))
    # a line load P': the size is 2 P' z/(pi r²), largest at x = 30, z = 30
    assert (peak.x_mm, peak.z_mm) == pytest.approx((30.0, 30.0), rel=1e-3)
    load = p.sum() * (nodes[1] - nodes[0])
    # spread over a: (a/r)² = 8e-5
    assert peak.shear_mpa == pytest.approx(load / (np.pi * 60.0), rel=1e-4)


def test_a_pixel_grid_means_its_outer_edges():
    nodes, p = hertz_nodes(201)
    pixels = PixelGrid(rows=30, cols=40, left_mm=-0.4, top_mm=-0.1, pixel_mm=0.02)
    assert largest_shear(nodes, p, 0.3 * p, within=pixels.window) == largest_shear(
        nodes, p, 0.3 * p, within=(-0.4, -0.4 + 40 * 0.02, -0.1, -0.1 + 30 * 0.02)
    )


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_above_the_surface_there_is_nothing_to_find(friction):
    """A window that begins above the surface holds what one from the surface does."""
    nodes, p = hertz_nodes(201)
    above, from_there = (
        largest_shear(nodes, p, friction * p, within=(-1.0, 1.0, top, 1.0)) for top in (-0.5, 0.0)
    )
    assert above == from_there and above.z_mm >= 0.0


def test_an_unloaded_surface_leaves_the_bulk_stress():
    nodes = np.linspace(-1, 1, 11)
    peak = largest_shear(nodes, 0 * nodes, None, within=WINDOW, regular=RegularStress((-3.0,)))
    assert peak.shear_mpa == 1.5


@pytest.mark.parametrize("window", [(0.0, 1.0, -2.0, -1.0), (1.0, 0.0, 0.0, 1.0)])
def test_a_window_without_material_is_refused(window):
    nodes, p = hertz_nodes(201)
    with pytest.raises(InputError, match="holds no material"):
        largest_shear(nodes, p, None, within=window)


def test_tractions_that_are_not_finite_are_refused():
    nodes, p = hertz_nodes(201)
    with pytest.raises(InputError, match="shear_mpa holds NaN"):
        largest_shear(nodes, p, np.where(p > 0, np.nan, 0.0), within=WINDOW)


@pytest.mark.parametrize("loaded", [0, 7, 10])
def test_one_loaded_node_is_enough(loaded):
    """A hat alone, at an end or not: under a line load hP the largest shear is on its axis."""
    nodes = 0.1 * np.arange(11)
    p = np.where(np.arange(11) == loaded, 4.0, 0.0)
    peak = largest_shear(nodes, p, None, within=(-1.0, 2.0, 5.0, 6.0))
    assert (peak.x_mm, peak.z_mm) == pytest.approx((nodes[loaded], 5.0), abs=1e-6)
    # Flamant's P'/(pi z); the hat's own spread, (h/z)² = 4e-4
    assert peak.shear_mpa == pytest.approx(4.0 * 0.1 / (np.pi * 5.0), rel=4e-4)


# these hide a hill between the nodes, near the surface
@example(seed=201, bulk=0.0)
@example(seed=366, bulk=-1.0)
@example(seed=115, bulk=2.0)
@example(seed=87, bulk=2.0)
@example(seed=272, bulk=2.0)
@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), bulk=st.sampled_from([0.0, -1.0, 2.0]))
def test_no_place_in_the_window_has_more(seed, bulk):
    """Patches of any pressure and shear: places at random, dense at the surface, never exceed."""
    rng = np.random.default_rng(seed)
    nodes = 0.02 * np.arange(-30, 31)
    p = np.maximum(np.cumsum(rng.normal(size=61)), 0.0)
    q = rng.uniform(-1, 1) * p
    peak = largest_shear(nodes, p, q, within=(-0.8, 0.8, 0.0, 1.0), regular=RegularStress((bulk,)))
    x = np.r_[rng.uniform(-0.8, 0.8, 600), nodes]
    z = np.r_[10 ** rng.uniform(-5, 0, 600), 0 * nodes]
    field = stress_components(x, z, nodes, p, q)
    sizes = 0.5 * np.abs(field.difference + bulk)
    # climbed to 1e-7 of a hill's width; a cusp at the surface loses that times its logarithm
    assert peak.shear_mpa >= sizes.max() * (1 - 1e-6)
    here = stress_components(np.array([peak.x_mm]), np.array([peak.z_mm]), nodes, p, q)
    assert peak.shear_mpa == pytest.approx(0.5 * abs(here.difference[0] + bulk), rel=1e-12)
