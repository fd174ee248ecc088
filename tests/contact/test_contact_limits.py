"""Where a contact is refused, on both sides of each limit; and profiles as people save them."""

import math

import numpy as np
import pytest

from hard.hard_cases import (
    COUPLING,
    FLAT,
    HALF_WIDTH,
    LOAD,
    MODULUS,
    RADIUS,
    contact_scene,
    influence,
    numerics,
    refused,
    worn,
    write_profile,
)
from isochrome.contact import ContactGrid, SurfaceState, contact_grid, contact_states
from isochrome.errors import PhysicsError
from isochrome.reference import hertz_half_width, hertz_peak_pressure

CYLINDER = f"radius_mm = {RADIUS}"


def test_a_contact_of_seven_nodes_is_refused_and_one_of_nine_is_not():
    """A flat 1 mm wide on nodes a sixth and an eighth of it apart; eight are needed."""
    refused(
        contact_scene(numerics(spacing=0.5 / 3, window=3.0), indenter=FLAT),
        r"only 7 nodes of 0\.167 mm, fewer than 8; set a finer numerics\.spacing_mm",
    )
    (state,) = contact_states(contact_scene(numerics(spacing=0.125, window=3.0), indenter=FLAT))
    assert np.count_nonzero(state.pressure_mpa) == 9


def test_a_grid_has_sixteen_nodes_to_thirty_two_thousand():
    def nodes(half):
        case = contact_scene(numerics(spacing=0.001, window=2.0 * half))
        return contact_grid(case, largest_dose_mm_per_mpa=0.0).nodes

    assert nodes(0.0075) == 17 and nodes(16.383) == 32767  # the middle, and as many to each side
    with pytest.raises(PhysicsError, match=r"has only 15 nodes .* finer numerics\.spacing_mm"):
        nodes(0.007)
    with pytest.raises(PhysicsError, match=r"needs 32769 nodes .* more than 32768; .* coarser"):
        nodes(16.3835)


@pytest.mark.parametrize("window", [0.745, 0.752])
def test_the_window_must_hold_the_contact_and_no_more(window):
    """2a is 0.7466 mm, on nodes 1 um apart."""
    case = contact_scene(numerics(window=window))
    if window < 2.0 * HALF_WIDTH:
        refused(case, r"reaches the edge of its grid, 0\.74\d mm wide; raise .*window_mm")
    else:
        (state,) = contact_states(case)
        assert state.contact_width_mm == pytest.approx(2.0 * HALF_WIDTH, abs=1e-4)


@pytest.mark.parametrize("asked", [0.0025, 0.003, 0.0059])
def test_the_spacing_divides_the_pixel_and_is_no_coarser_than_asked(asked):
    camera = "[camera]\nwidth_px = 9\nheight_px = 9\npixel_mm = 0.006\n"
    grid = contact_grid(
        contact_scene(camera + numerics(spacing=asked)), largest_dose_mm_per_mpa=0.0
    )
    parts = 0.006 / grid.spacing_mm
    assert parts == pytest.approx(round(parts), rel=1e-14)
    assert asked / 2.0 < grid.spacing_mm <= asked * (1.0 + 1e-8)


def test_the_grid_is_as_fine_as_the_smallest_load_and_as_wide_as_the_largest_needs():
    """350 nodes in a half-width, at each load; the order in which they come does not matter."""
    wide = contact_grid(contact_scene(), largest_dose_mm_per_mpa=0.0)
    for loads in ([44.0, 4.0], [4.0, 44.0]):
        case = contact_scene(worn([0.0, 10.0], k=0.0)).with_values(
            {"load.normal_n": {"distance_m": [0.0, 10.0], "value": loads}}
        )
        states = contact_states(case)
        for load, state in zip(loads, states, strict=True):
            exact = hertz_peak_pressure(load / 4.0, RADIUS, MODULUS)
            assert state.p_max_mpa == pytest.approx(exact, rel=2e-6)  # (h/a)^1.5 and better
            finest = hertz_half_width(1.0, RADIUS, MODULUS) / 350
            assert state.grid.spacing_mm == pytest.approx(finest, rel=1e-6)
            assert state.grid.left_mm == pytest.approx(wide.left_mm, abs=1.01 * wide.spacing_mm)


@pytest.mark.parametrize("share", [0.299, 0.301])
def test_a_contact_is_as_wide_as_three_tenths_of_the_radius_at_most(share):
    """a² = 4 P'R/(pi E*); the mean pressure is then pi E* a/(8 R) = 0.118 E*, which is allowed."""
    load = math.pi * MODULUS * share**2 * RADIUS / 4.0
    case = contact_scene(numerics(spacing=0.2), load=4.0 * load)
    if share < 0.3:
        (state,) = contact_states(case)
        assert state.contact_width_mm == pytest.approx(2.0 * share * RADIUS, abs=0.2)  # a spacing
    else:
        refused(case, r"half-width would be 7\.41 mm, over 0\.3 of the radius 24\.61 mm")


@pytest.mark.parametrize("share", [0.295, 0.305])
def test_a_scar_is_as_deep_as_three_tenths_of_the_half_width_at_most(share):
    """A flat of n nodes h apart wears evenly in the end: to K P'/(n h), of which n h/2 is half."""
    wide = 21 * 0.05
    metres = share * wide**2 / (2.0 * LOAD) / 2e-6
    case = contact_scene(worn([0.0, metres], spacing=0.05), indenter=FLAT)
    if share < 0.3:
        # even to what elasticity leaves, P'/E* = 4e-3 mm of 0.15
        assert contact_states(case)[1].wear_depth_mm.max() == pytest.approx(
            share * wide / 2.0, rel=0.01
        )
    else:
        refused(case, r"scar would be 0\.161 mm deep, over 0\.3 of .* 0\.525 mm.* shorten wear")


def arc(start, end, rows=301):
    x = np.linspace(start, end, rows)
    return x, x**2 / (2.0 * RADIUS)


@pytest.mark.parametrize(("start", "end", "place"), [(-0.6, 0.3, "0.3"), (-0.3, 0.6, "-0.3")])
def test_a_contact_at_either_end_of_a_profile_is_refused(tmp_path, start, end, place):
    """The contact wants 0.373 mm to each side, and the file holds 0.3 mm to one of them."""
    case = contact_scene(indenter=write_profile(tmp_path, *arc(start, end)), folder=tmp_path)
    refused(case, rf"end of the profile profile\.csv at x = {place} mm; extend the profile")


def test_a_profile_that_holds_the_contact_is_not_refused(tmp_path):
    case = contact_scene(indenter=write_profile(tmp_path, *arc(-0.4, 0.4)), folder=tmp_path)
    assert contact_states(case)[0].contact_width_mm == pytest.approx(2 * HALF_WIDTH, rel=2e-3)


def test_a_hill_that_wear_brings_into_contact_beyond_the_window_is_not_overlooked(tmp_path):
    """11 um above the contact at x = 1 mm: free at 200 m, and touched once the cylinder has sunk.
    Truth: the same scene on a grid that holds the hill."""
    x = np.array([-2.0, 0.8, 1.0, 1.2, 2.0])
    gap = np.array([0.0, 0.0, 0.011 - 1.0 / (2.0 * RADIUS), 0.0, 0.0])
    body = f"{CYLINDER}\n{write_profile(tmp_path, x, gap)}"
    rest = worn([200.0, 300.0], spacing=0.02, window=2.6, tolerance=1e-3)
    seen = contact_scene(rest, indenter=body, folder=tmp_path)
    touched = [
        state.pressure_mpa[np.abs(state.grid.x_mm - 1.0) < 0.05].any()
        for state in contact_states(seen)
    ]
    assert touched == [False, True]
    narrow = {"numerics.window_mm": 1.7}
    contact_states(seen.with_values({**narrow, "wear.distances_m": (200.0,)}))
    refused(seen.with_values(narrow), r"reaches the edge of its grid, 1\.7\d? mm wide")


def test_a_profile_saved_with_a_byte_order_mark_is_the_same_profile(tmp_path):
    """A spreadsheet's "CSV UTF-8" begins with three bytes that belong to no column's name."""
    peaks = []
    for mark in (b"", b"\xef\xbb\xbf"):
        line = write_profile(tmp_path, *arc(-0.6, 0.6, 121), mark=mark)
        peaks.append(contact_states(contact_scene(indenter=line, folder=tmp_path))[0].p_max_mpa)
    assert peaks[0] == peaks[1]


@pytest.mark.parametrize("datum", [5000.0, -5000.0])
def test_a_profile_may_be_measured_from_any_height(tmp_path, datum):
    """Nothing touches beyond its ends, however far above the datum they were measured."""
    x, gap = arc(-0.6, 0.6, 121)
    results = []
    for lifted in (gap, gap + datum):
        line = write_profile(tmp_path, x, lifted)
        results.append(contact_states(contact_scene(indenter=line, folder=tmp_path))[0])
    # the file's numbers are rounded to 5e-13 mm, which kinks over rows of 0.01 mm feel as
    # E* 5e-13/0.01 of pressure
    for one, other in zip(*(s.pressure_mpa for s in results), strict=True):
        assert other == pytest.approx(one, abs=1e-6)


@pytest.mark.parametrize(("spacing", "fine"), [(0.005, True), (0.00501, False)])
def test_a_spacing_is_half_of_a_profiles_row_step_at_most(tmp_path, spacing, fine):
    case = contact_scene(
        numerics(spacing=spacing),
        indenter=write_profile(tmp_path, *arc(-1.0, 1.0, 201)),
        folder=tmp_path,
    )
    if fine:
        assert contact_grid(case, largest_dose_mm_per_mpa=0.0).spacing_mm == spacing
    else:
        refused(case, r"numerics\.spacing_mm = 0\.00501 does not resolve .* to 0\.005 or less")


def test_a_profile_is_resolved_to_a_quarter_of_its_row_step(tmp_path):
    """Goes wrong: roughness between the nodes is picked at random: pressures off by half."""
    case = contact_scene(indenter=write_profile(tmp_path, *arc(-0.8, 0.8, 1601)), folder=tmp_path)
    grid = contact_grid(case, largest_dose_mm_per_mpa=0.0)
    assert grid.spacing_mm == pytest.approx(2.5e-4, rel=1e-12)


@pytest.mark.parametrize("inner", [1.0 + 1e-9, 1.5, 0.5])
def test_an_edge_of_contact_lies_within_a_spacing_of_the_last_loaded_node(inner):
    """A worn flat's pressure is even to its corner, whose p² leads nowhere near."""
    p = np.array([0.0, 1.0, inner, inner, 1.0, 0.0])
    state = SurfaceState(
        grid=ContactGrid(0.0, 0.1, 6), pressure_mpa=p, shear_mpa=0.0 * p, wear_depth_mm=0.0 * p,
        distance_m=0.0, friction=0.0, sliding=False, residual=0.0,
    )  # fmt: skip
    # p² falls by inner² - 1 in a spacing, and 1 is left of it: 0.8 of a spacing for 1.5
    beyond = 0.1 * (0.8 if inner == 1.5 else 1.0)
    assert state.edges_mm == pytest.approx((0.1 - beyond, 0.4 + beyond), rel=1e-12)
    assert state.contact_width_mm == pytest.approx(0.3 + 2.0 * beyond, rel=1e-12)


@pytest.mark.parametrize("mu", [0.25, -0.25])
@pytest.mark.parametrize("tangential", [5.0, -5.0])
def test_a_stuck_contacts_shear_points_along_the_tangential_load(mu, tangential):
    """∫q dx = Q/d whichever sign the friction coefficient is given with, and |q| <= |mu| p."""
    rest = f"tangential_n = {tangential}\n[friction]\ncoefficient = {mu}\n" + numerics(spacing=0.01)
    (state,) = contact_states(contact_scene(rest))
    assert state.shear_mpa.sum() * state.grid.spacing_mm == pytest.approx(
        tangential / 4.0, rel=1e-9
    )
    assert (np.abs(state.shear_mpa) <= 0.25 * state.pressure_mpa + 1e-9).all()


def test_a_worn_states_residual_is_how_far_its_bodies_are_from_touching():
    """Half the range of the gap inside the scar over that of the displacement, by a dense matrix.
    On the mesh that moves with the edges the gap vanishes; carried to the grid it is left with the
    grid's error in space, which the history tells."""
    state = contact_states(contact_scene(worn([0.0, 100.0], friction=0.25, spacing=0.02)))[1]
    x, p = state.grid.x_mm, state.pressure_mpa
    u = influence(x, coupling=COUPLING, friction=0.25) @ p
    left, right = state.edges_mm
    gap = (x**2 / (2.0 * RADIUS) + state.wear_depth_mm + u)[(x > left) & (x < right)]
    assert state.residual == pytest.approx(0.5 * np.ptp(gap) / np.ptp(u), rel=1e-9)
    assert 1e-5 < state.residual < 1e-2
