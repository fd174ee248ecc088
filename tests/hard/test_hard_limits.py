"""Hard cases at the limits: loads, windows, grids, profiles; right, or refused with a way out."""

import numpy as np
import pytest
from hard_cases import (
    FLAT,
    LOAD,
    MODULUS,
    RADIUS,
    WEAR,
    contact_scene,
    cylinder,
    numerics,
    worn,
    write_profile,
)

from isochrome.contact import contact_states, solve_pressure
from isochrome.errors import InputError, PhysicsError
from isochrome.reference import hertz_half_width, hertz_peak_pressure

CYLINDER = f"radius_mm = {RADIUS}"


def refused(scene, words):
    """The scene is refused with exit code 3, and with a sentence that says what to change."""
    with pytest.raises(PhysicsError, match=words) as refusal:
        contact_states(scene)
    assert refusal.value.exit_code == 3
    assert str(refusal.value).startswith("scene") and "\n" not in str(refusal.value)


# --- loads --------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1e2])
@pytest.mark.parametrize("friction", ["", "[friction]\ncoefficient = 0.25"])
def test_half_width_and_pressure_go_with_the_root_of_the_load(factor, friction):
    """Goes wrong: a fixed grid sees a millionth of the load as one node, and calls it a contact."""
    one, other = (contact_states(contact_scene(friction, load=44.0 * f))[0] for f in (1.0, factor))
    # the grid scales along, so that both have the same error
    assert other.p_max_mpa == pytest.approx(np.sqrt(factor) * one.p_max_mpa, rel=1e-7)
    assert other.contact_width_mm == pytest.approx(np.sqrt(factor) * one.contact_width_mm, rel=1e-6)
    peak = hertz_peak_pressure(LOAD * factor, RADIUS, MODULUS)
    # (coupling lowers the peak by 1.6e-4)
    assert other.p_max_mpa == pytest.approx(peak, rel=2e-4 if friction else 5e-6)


@pytest.mark.parametrize("factor", [1e6, 1e12, 1e300])
@pytest.mark.parametrize("rest", ["", worn([0.0, 31.0]), "[friction]\ncoefficient = 0.25"])
def test_million_times_the_load_is_refused_for_its_width(factor, rest):
    """Goes wrong: a parabola on a half-plane goes on answering where the cylinder is all sunk."""
    refused(
        contact_scene(rest, load=44.0 * factor),
        r"half-width would be .* of the radius .* lower load\.normal_n",
    )


def test_million_times_a_flats_load_is_refused():
    """Goes wrong: a mean pressure of 4448 E*, and linear theory nods."""
    refused(contact_scene(indenter=FLAT, load=44e6), "lower the load")


@pytest.mark.parametrize("mean", [0.5, 5.0, 50.0])
def test_flats_pressure_near_the_modulus_is_refused(mean):
    """Goes wrong: a flat at half its modulus and more is answered as if strains were small. A
    cylinder is refused at 0.12 E*, where its half-width is 0.3 R."""
    refused(contact_scene(indenter=FLAT, load=4.0 * mean * MODULUS), "lower")


# --- windows and scars --------------------------------------------------------------------------


@pytest.mark.parametrize("window", [0.1, 0.5, 0.7])
@pytest.mark.parametrize("friction", ["", "[friction]\ncoefficient = 0.25\n"])
def test_contact_at_the_edge_of_its_window_is_refused(window, friction):
    """Goes wrong: the grid's end acts as a corner, with a spike of pressure nobody asked for."""
    refused(
        contact_scene(friction + numerics(window=window)),
        r"reaches the edge of its grid.*numerics\.window_mm",
    )


@pytest.mark.parametrize("window", [0.9, 1.0, 1.2])
def test_scar_that_fills_its_window_is_refused(window):
    """Goes wrong: the scar stops at the grid's end and deepens there, in silence."""
    # the contact is 0.75 mm wide at first and 1.28 mm at 233 m
    refused(
        contact_scene(worn([0.0, 233.0], spacing=0.005, window=window)),
        r"reaches the edge of its grid.*numerics\.window_mm",
    )
    (first,) = contact_states(contact_scene(worn([0.0], spacing=0.005, window=window)))
    assert first.contact_width_mm == pytest.approx(0.7466, abs=0.002)


@pytest.mark.parametrize("distance", [2e3, 2e5])
def test_window_grows_with_the_scar_when_it_is_free(distance):
    """Goes wrong: a window set by the unworn contact cuts what wears beyond it."""
    (state,) = contact_states(contact_scene(worn([distance], spacing=0.04, tolerance=1e-3)))
    chord = 2.0 * (1.5 * RADIUS * 1e3 * WEAR * distance * LOAD) ** (1.0 / 3.0)
    # elasticity adds a share (a/c)² of it
    assert state.contact_width_mm == pytest.approx(chord, rel=(0.7466 / chord) ** 2, abs=0.08)
    assert not state.pressure_mpa[[0, -1]].any() and not state.wear_depth_mm[[0, -1]].any()


def test_scar_as_wide_as_the_cylinder_is_refused():
    """Goes wrong: the arc's parabola is worn on long after the cylinder would be buried."""
    refused(
        contact_scene(worn([1e9])), r"half-width would be .* of the radius .* lower load\.normal_n"
    )


@pytest.mark.long
def test_flat_sunk_deeper_than_it_is_wide_is_refused():
    """Goes wrong: a scar of 22 mm under a flat of 1 mm, and a half-plane is still assumed."""
    refused(contact_scene(worn([1e6], spacing=0.01), indenter=FLAT), "lower|fewer|shorten")


@pytest.mark.parametrize("radius", [1e3, 1e4, 1e5, 1e6])
def test_nearly_conforming_radii_are_hertz_while_the_contact_is_shallow(radius):
    """Goes wrong: a gap of 1e-6 mm across the window is lost in the rounding of another number."""
    (state,) = contact_states(contact_scene(indenter=f"radius_mm = {radius}"))
    # 350 nodes in the half-width: (h/a)^1.5 is 1.5e-4, and the peak is far from the edge
    assert state.p_max_mpa == pytest.approx(hertz_peak_pressure(LOAD, radius, MODULUS), rel=5e-6)
    assert state.contact_width_mm == pytest.approx(
        2.0 * hertz_half_width(LOAD, radius, MODULUS), rel=1e-4
    )


# --- grids --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        (numerics(spacing=1e-6), r"more than .*coarser numerics\.spacing_mm"),
        (numerics(spacing=1e-300), r"more than .*coarser numerics\.spacing_mm"),
        (numerics(window=1e6), r"more than .*smaller numerics\.window_mm"),
        (numerics(spacing=0.01, window=0.05), r"only .*finer numerics\.spacing_mm"),
        (numerics(window=1e-12), r"only .*larger numerics\.window_mm"),
        (worn([233.0], spacing=1e-6), r"more than .*coarser numerics\.spacing_mm"),
    ],
)
def test_grid_of_too_many_or_too_few_nodes_is_refused(rest, words):
    """Goes wrong: a spacing typed in the wrong unit fills the memory, or leaves no contact."""
    refused(contact_scene(rest), words)


@pytest.mark.parametrize(
    ("spacing", "load"), [(0.5, 44.0), (0.2, 44.0), (0.006, 44e-6)], ids=["one", "three", "light"]
)
def test_contact_of_a_few_nodes_is_refused(spacing, load):
    """Goes wrong: one node carries P'/h, whatever the physics; the spacing sets the pressure."""
    refused(
        contact_scene(numerics(spacing=spacing, window=40.0 * spacing), load=load),
        r"finer numerics\.spacing_mm",
    )


# --- profiles -----------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("top", [1.0, -1.0])
@pytest.mark.parametrize("height", [0.05, 0.019])
def test_hill_outside_the_window_is_not_overlooked(tmp_path, top, height):
    """Goes wrong: the window misses a hill at x = 1 mm, where the cylinder is 20 um away: one of 50
    um touches first, one of 19 um once it has sunk by 2.8 um and more."""
    x, gap = np.array([-2.0, 0.6, 1.0, 1.4, 2.0]), np.array([0.0, 0.0, -height, 0.0, 0.0])
    if top < 0.0:
        x, gap = -x[::-1], gap[::-1]
    scene = contact_scene(
        indenter=f"{CYLINDER}\n{write_profile(tmp_path, x, gap)}", folder=tmp_path
    )
    (state,) = contact_states(scene)
    assert state.pressure_mpa[np.abs(state.grid.x_mm - top) < 0.01].any()
    middle = state.pressure_mpa[np.abs(state.grid.x_mm) < 0.01]
    assert middle.all() if height < 0.02 else not middle.any()
    if height > 0.02:
        with pytest.raises(PhysicsError, match=r"edge of its grid.*numerics\.window_mm"):
            contact_states(scene.with_values({"numerics.window_mm": 1.0}))


def test_hill_too_steep_for_small_strains_is_refused(tmp_path):
    """Goes wrong: under a ridge of 45 degrees the mean pressure is half of E*, at every load."""
    ridge = write_profile(tmp_path, [-2.0, 0.95, 1.0, 1.05, 2.0], [0.0, 0.0, -0.05, 0.0, 0.0])
    refused(
        contact_scene(indenter=f"{CYLINDER}\n{ridge}", folder=tmp_path),
        r"linear elasticity .* flatten its profile",
    )


def test_spacing_coarser_than_the_profile_is_refused(tmp_path):
    """Goes wrong: a spacing fit for the smooth body passes over the measured roughness."""
    x = np.linspace(-1.0, 1.0, 201)
    line = write_profile(tmp_path, x, x**2 / (2.0 * RADIUS))
    scene = contact_scene(numerics(spacing=0.006), indenter=line, folder=tmp_path)
    refused(scene, r"numerics\.spacing_mm = 0\.006 .* set numerics\.spacing_mm to 0\.005 or less")


def test_contact_at_the_end_of_a_measured_profile_is_refused(tmp_path):
    """Goes wrong: the file's last row, at 0.3 mm where the contact wants 0.373, becomes a corner
    with eight times the pressure."""
    x = np.linspace(-0.3, 0.3, 301)
    arc = write_profile(tmp_path, x, x**2 / (2.0 * RADIUS))
    refused(contact_scene(indenter=arc, folder=tmp_path), "profile")


@pytest.mark.long
def test_profile_finer_than_the_smooth_grid_is_resolved(tmp_path):
    """Goes wrong: roughness between the nodes is picked at random: pressures off by half."""
    x = np.arange(-0.8, 0.8 + 5e-4, 1e-3)
    heights = x**2 / (2.0 * RADIUS) + 2e-5 * np.cos(2.0 * np.pi * x / 4e-3)
    line = write_profile(tmp_path, x, heights)
    (state,) = contact_states(contact_scene(indenter=line, folder=tmp_path))
    (fine,) = contact_states(
        contact_scene(numerics(spacing=2.5e-4, window=1.2), indenter=line, folder=tmp_path)
    )
    # a wave of 4 um and 2e-5 mm, pressed flat by pi E* A/wavelength = 39 MPa on top of Hertz's 19
    # if it were smooth. The file is straight between rows, and the pressure at its kinks grows as
    # the logarithm of the spacing, 13 % when it is halved: the two agree because both take a
    # quarter of the row step. Solved to a residual of 1e-10; measured 4e-12
    assert state.grid.spacing_mm == pytest.approx(2.5e-4, rel=1e-12)
    assert state.p_max_mpa == pytest.approx(fine.p_max_mpa, rel=1e-9)
    assert state.p_max_mpa > 2.0 * 18.76


# --- numbers that are none ----------------------------------------------------------------------


@pytest.mark.parametrize("where", [3, 50])
@pytest.mark.parametrize("bad", [np.nan, -np.inf, np.inf])
def test_gap_that_is_no_number_is_refused(bad, where):
    """Goes wrong: a hole in a measured profile spreads as NaN, or is passed over in silence."""
    _, surface, gap = cylinder()
    gap[where] = bad
    with pytest.raises(InputError, match=r"gap .* is not finite everywhere; give every node"):
        solve_pressure(surface, gap, LOAD)


@pytest.mark.parametrize("load", [0.0, -11.0, np.nan, np.inf])
def test_load_that_presses_nothing_is_refused(load):
    """Goes wrong: no load, or tension, comes back as a contact full of NaN and no error."""
    _, surface, gap = cylinder()
    with pytest.raises(InputError, match=rf"the load is {load:g} N/mm, .* change load\.normal_n"):
        solve_pressure(surface, gap, load)


def test_start_without_any_pressure_is_no_start():
    """Goes wrong: a forecast that left no contact is divided by its sum, and all becomes NaN."""
    _, surface, gap = cylinder()
    with np.errstate(all="ignore"):
        state = solve_pressure(surface, gap, LOAD, start=np.zeros(101))
    # two solutions of residual 1e-10
    usual = solve_pressure(surface, gap, LOAD).pressure
    np.testing.assert_allclose(state.pressure, usual, rtol=0, atol=1e-7 * usual.max())


@pytest.mark.parametrize(
    ("n", "factor", "datum"), [(101, 1e-6, 3.0), (509, 1e-6, 0.1), (1024, 1.0, 1e3)]
)
def test_datum_of_the_gap_changes_nothing(n, factor, datum):
    """Goes wrong: 0.1 mm added to a gap of 1e-6 mm, and the pressure is off by 1e-3. A node's gap
    is rounded by 1e-16 of the datum, worth E*/h of pressure: below 3e-6."""
    _, surface, gap = cylinder(n, 0.8 * np.sqrt(factor))
    usual = solve_pressure(surface, gap, LOAD * factor).pressure
    lifted = solve_pressure(surface, gap + datum, LOAD * factor).pressure
    np.testing.assert_allclose(lifted, usual, rtol=0, atol=2e-5 * usual.max())


def test_datum_of_a_profile_changes_nothing_at_a_millionth_of_the_load(tmp_path):
    """Goes wrong: a profile is measured from anywhere, and 0.1 mm of it stops the solver."""
    line = write_profile(tmp_path, [-2.0, 0.0, 2.0], [0.1, 0.1, 0.1])
    scene = contact_scene(indenter=f"{CYLINDER}\n{line}", load=44e-6, folder=tmp_path)
    (state,) = contact_states(scene)
    peak = hertz_peak_pressure(1e-6 * LOAD, RADIUS, MODULUS)
    # 1e-17 mm of rounding over nodes 1e-6 mm apart: 1e-6 of the pressure
    assert state.p_max_mpa == pytest.approx(peak, rel=1e-5)
