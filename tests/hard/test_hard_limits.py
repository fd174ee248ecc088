"""Hard cases at the limits: loads, windows, grids, profiles; right, or refused with a way out."""

import numpy as np
import pytest

from hard.hard_cases import (
    LOAD,
    MODULUS,
    RADIUS,
    WEAR,
    contact_scene,
    cylinder,
    numerics,
    refused,
    worn,
    write_profile,
)
from isochrome.contact import contact_states, solve_pressure
from isochrome.errors import InputError, PhysicsError
from isochrome.reference import hertz_peak_pressure

CYLINDER = f"radius_mm = {RADIUS}"


@pytest.mark.parametrize(
    ("factor", "rest"),
    [
        (1e6, ""), (1e12, worn([0.0, 31.0])), (1e300, "[friction]\ncoefficient = 0.25"),
        (1.0, worn([1e9])),  # a scar as wide as the cylinder
    ],
)  # fmt: skip
def test_million_times_the_load_is_refused_for_its_width(factor, rest):
    """Goes wrong: a parabola on a half-plane goes on answering where the cylinder is all sunk."""
    refused(
        contact_scene(rest, load=44.0 * factor),
        r"half-width would be .* of the radius .* lower load\.normal_n",
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


@pytest.mark.long
@pytest.mark.parametrize(("top", "height"), [(1.0, 0.05), (-1.0, 0.019)])
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


def test_datum_of_a_profile_changes_nothing_at_a_millionth_of_the_load(tmp_path):
    """Goes wrong: a profile is measured from anywhere, and 0.1 mm of it stops the solver."""
    line = write_profile(tmp_path, [-2.0, 0.0, 2.0], [0.1, 0.1, 0.1])
    scene = contact_scene(indenter=f"{CYLINDER}\n{line}", load=44e-6, folder=tmp_path)
    (state,) = contact_states(scene)
    peak = hertz_peak_pressure(1e-6 * LOAD, RADIUS, MODULUS)
    # 1e-17 mm of rounding over nodes 1e-6 mm apart: 1e-6 of the pressure
    assert state.p_max_mpa == pytest.approx(peak, rel=1e-5)
