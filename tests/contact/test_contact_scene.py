"""From scene to contact states: constants, grid, profiles, partial slip, refusals."""

import numpy as np
import pytest

from hard.hard_cases import (
    COUPLING,
    FLAT,
    MODULUS,
    PAIR,
    contact_scene,
    refused,
    worn,
    write_profile,
)
from isochrome import reference
from isochrome.contact import contact_states, elastic_constants, line_load
from isochrome.errors import InputError
from isochrome.scene import load_scene

PAPER = load_scene("line-contact-wear")
FLAT_NODES = "[numerics]\nspacing_mm = 0.01"


def test_the_scenes_constants_are_those_of_the_pair():
    modulus, coupling = elastic_constants(PAPER)
    assert modulus == pytest.approx(MODULUS, rel=1e-14)
    assert coupling == pytest.approx(COUPLING, rel=1e-13)
    assert line_load(PAPER) == 11.0


def test_plane_stress_moduli_leave_out_the_lateral_restraint():
    # E* = 1/(1/E1 + 1/E2) in plane stress; the paper's pair then gives about 17.2 MPa
    modulus, _ = elastic_constants(PAPER.with_values({"specimen.plane": "stress"}))
    assert modulus == pytest.approx(1 / (1 / 2100 + 1 / 210000), rel=1e-14)
    assert reference.hertz_peak_pressure(11.0, 24.61, modulus) == pytest.approx(17.2, abs=0.05)


def test_in_plane_stress_the_coupling_is_twice_the_difference_of_one_less_poissons_ratio():
    """(1 - 2ν')/G with ν' = ν/(1 + ν) and G = E/(2(1 + ν)) is 2(1 - ν)/E."""
    _, coupling = elastic_constants(PAPER.with_values({"specimen.plane": "stress"}))
    block, roller = PAPER.specimen, PAPER.indenter
    first, second = (2e-3 * (1.0 - b.poisson) / b.young_gpa for b in (block, roller))
    assert coupling == pytest.approx(first - second, rel=1e-12)


@pytest.mark.parametrize(
    ("radius", "load"), [(24.61, 44e-6), (24.61, 44.0), (24.61, 44e2), (1e6, 44.0)]
)
def test_hertz_at_any_load_and_nearly_conforming_radii(radius, load):
    """Hard case: from a millionth of the nominal load up; the grid follows the contact."""
    (state,) = contact_states(contact_scene(indenter=f"radius_mm = {radius}", load=load))
    # 350 nodes in the half-width: h/a to 1.5
    peak = reference.hertz_peak_pressure(load / 4, radius, MODULUS)
    assert state.p_max_mpa == pytest.approx(peak, rel=2e-6)
    width = 2 * reference.hertz_half_width(load / 4, radius, MODULUS)
    assert state.contact_width_mm == pytest.approx(width, rel=1e-4)  # measured 3.5e-5
    assert state.residual <= 1e-10 and not state.shear_mpa.any() and not state.sliding


def test_the_first_sliding_state_is_the_coupled_closed_form():
    scene = contact_scene("[friction]\ncoefficient = 0.25\nstatic_state_first = true")
    still, sliding = contact_states(scene)
    exact = reference.coupled_contact(
        11.0, 24.61, MODULUS, friction=0.25, beta=reference.dundurs_beta(*PAIR)
    )
    assert (still.sliding, sliding.sliding) == (False, True)
    assert sum(still.edges_mm) / 2 == pytest.approx(0.0, abs=1e-6)
    # an edge is known to a hundredth of the spacing of 1 um; measured 7e-6 mm, and 3e-7 in p_max
    assert sum(sliding.edges_mm) / 2 == pytest.approx(exact.centre_mm, abs=2e-5)
    assert sliding.p_max_mpa == pytest.approx(exact.peak_pressure_mpa, rel=1e-6)
    np.testing.assert_array_equal(sliding.shear_mpa, 0.25 * sliding.pressure_mpa)


def test_a_stuck_contact_slips_at_its_edges_as_cattaneo_and_mindlin_say():
    """q = mu p outside the stuck strip |x| < c, c = a sqrt(1 - Q/(mu P)), and ∫q = Q."""
    scene = contact_scene("tangential_n = 5.0\n[friction]\ncoefficient = 0.25")
    (state,) = contact_states(scene)
    a = reference.hertz_half_width(11.0, 24.61, MODULUS)
    c = a * np.sqrt(1 - 5.0 / 11.0)
    x, h = state.grid.x_mm, state.grid.spacing_mm
    p0 = reference.hertz_peak_pressure(11.0, 24.61, MODULUS)
    whole = reference.hertz_pressure(x, half_width_mm=a, peak_pressure_mpa=p0)
    stuck = reference.hertz_pressure(x, half_width_mm=c, peak_pressure_mpa=p0 * c / a)
    # away from the four edges by 5 nodes; there the root's error is (h/a)^1.5 times 5^-0.5
    away = (np.abs(np.abs(x) - a) > 5 * h) & (np.abs(np.abs(x) - c) > 5 * h)
    error = np.abs(state.shear_mpa - 0.25 * (whole - stuck))
    assert error[away].max() < 1e-3 * 0.25 * p0
    assert state.shear_mpa.sum() * h == pytest.approx(5.0 / 4.0, rel=1e-9)


def test_a_wedge_given_as_a_profile_has_the_wedges_width(tmp_path):
    slope = 0.01
    line = write_profile(tmp_path, [-2.0, 0.0, 2.0], [2 * slope, 0.0, 2 * slope])
    (state,) = contact_states(contact_scene(indenter=line, folder=tmp_path))
    a = reference.wedge_half_width(11.0, slope=slope, contact_modulus_mpa=MODULUS)
    assert state.contact_width_mm == pytest.approx(2 * a, abs=0.4 * state.grid.spacing_mm)


def test_a_profile_in_micrometres_adds_to_the_cylinder(tmp_path):
    x = np.linspace(-3, 3, 601)
    line = write_profile(tmp_path, x, 1e3 * x**2 / (2 * 50.0), header="x_mm,gap_um")
    shape = f"radius_mm = 50.0\n{line}"
    (state,) = contact_states(contact_scene(indenter=shape, folder=tmp_path))
    # two parabolas of 50 mm are one of 25 mm; straight pieces of 0.01 mm are off by 2.5e-7 mm,
    # 1e-4 of the indentation
    expected = reference.hertz_peak_pressure(11.0, 25.0, MODULUS)
    assert np.median(state.pressure_mpa[np.abs(state.grid.x_mm) < 0.02]) == pytest.approx(
        expected, rel=5e-3
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "the profile cannot be read"),
        ("x_mm,height\n0,1\n1,2\n2,3\n", "needs the columns x_mm and gap_mm"),
        ("x_mm,gap_mm\n0,1\n1,two\n2,3\n", "line 3: gap_mm = 'two'"),
        ("x_mm,gap_mm\n0,1\n1,2\n", "three rows or more"),
        ("x_mm,gap_mm\n0,1\n0,2\n1,3\n", "rising x_mm"),
        ("x_mm,gap_mm\n0,1\n1,nan\n2,3\n", "line 3: gap_mm = 'nan'"),
        ("", "an empty table"),
    ],
)
def test_a_profile_that_cannot_be_used_names_its_file(tmp_path, text, words):
    if text is not None:
        (tmp_path / "scar.csv").write_text(text)
    scene = contact_scene(indenter='profile = "scar.csv"', folder=tmp_path)
    with pytest.raises(InputError, match=words) as refusal:
        contact_states(scene)
    assert "scar.csv" in str(refusal.value)


def test_a_part_that_is_absent_costs_no_state():
    wear = worn([1, 2], spacing=0.01, tolerance=1e-3)
    for rest, count in (("", 1), ("[friction]\ncoefficient = 0.2", 1), (wear, 2)):
        assert len(contact_states(contact_scene(rest))) == count


def test_a_profiles_end_may_be_a_corner_if_the_file_says_so(tmp_path):
    """A file that ends in contact is refused; a last row with a large gap makes it a flat."""
    line = write_profile(tmp_path, [-0.5, 0.0, 0.5], [0.0, 0.0, 0.0])
    scene = contact_scene(FLAT_NODES, indenter=line, folder=tmp_path)
    refused(scene, r"end of the profile .* add a row with a large gap")
    write_profile(
        tmp_path, [-1.0, -0.5 - 1e-9, -0.5, 0.0, 0.5, 0.5 + 1e-9, 1.0], [9, 9, 0, 0, 0, 9, 9]
    )
    (state,) = contact_states(scene)
    (punch,) = contact_states(contact_scene(FLAT_NODES, indenter=FLAT))
    on, there = state.pressure_mpa > 0.0, punch.pressure_mpa > 0.0
    # two solutions of residual 1e-10 on the same nodes
    np.testing.assert_allclose(
        state.pressure_mpa[on], punch.pressure_mpa[there], rtol=0, atol=1e-6 * punch.p_max_mpa
    )


@pytest.mark.parametrize("share", [0.11, 0.13])
def test_a_flats_mean_pressure_is_held_to_that_of_the_widest_cylinder(share):
    """p_mean = pi E* a/(8 R) at a = 0.3 R: 0.118 E*."""
    flat = contact_scene(FLAT_NODES, indenter=FLAT, load=4.0 * share * MODULUS)
    if share < 0.12:
        assert contact_states(flat)[0].line_load_n_per_mm == pytest.approx(share * MODULUS)
    else:
        refused(flat, r"mean pressure .* lower the load")
