"""What a real bench adds to a contact's frame, by a renderer that shares no code: each fact is
named, its size is right, and load and friction are."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import case_benches
from benchmarks.outside_bench import BenchContact
from benchmarks.outside_camera import Defects
from benchmarks.outside_tractions import RealContact
from benchmarks.outside_unlisted import UnlistedContact
from isochrome.errors import InputError
from isochrome.estimation import prepare_frame
from isochrome.fitting import cause_messages, fit_with_causes
from isochrome.frames import Frame
from isochrome.scene import load_scene
from isochrome.simulation import scene_states

SHAPE = 164, 220


def made(kind, seed, *, friction=0.2, **facts):
    rng = np.random.default_rng([seed, 39])
    return kind(
        load_n=rng.uniform(30.0, 55.0), friction=friction, shape=SHAPE, pixel_mm=4.0 / SHAPE[1],
        left_mm=-2.0 + rng.uniform(-0.1, 0.1), defects=Defects(noise=2.0, fall_off=0.2), **facts,
    )  # fmt: skip


def asked(contact, **specimen):
    tables = contact.scene()
    tables["specimen"] = tables["specimen"] | specimen
    scene = load_scene(tables | {"load": {"normal_n": 1.1 * contact.load_n}})
    data = prepare_frame(Frame(0, contact.frame(7), None, "bench"), scene, bit_depth=8)
    return fit_with_causes(data, scene)


def value(freed, key):
    return freed.now.values_of_key(key)[0]


def assert_load(freed, contact):
    load, spread = value(freed, "load.normal_n")
    # three standard uncertainties: one frame in 370
    assert abs(load - contact.load_n) < 3.0 * spread < 0.01 * contact.load_n
    assert 0.95 < freed.fit.chi < 1.05


@pytest.mark.parametrize("stress_mpa", [0.3, -0.2])
def test_stress_along_a_machined_edge_is_found(stress_mpa):
    contact = made(UnlistedContact, 1, edge_mpa=stress_mpa)
    freed = asked(contact)
    assert freed.names == {"stress along a machined surface"}
    found, spread = value(freed, "specimen.edge_stress_mpa")
    depth, of_depth = value(freed, "specimen.edge_depth_mm")
    assert abs(found - stress_mpa) < 3.0 * spread < 0.1 * abs(stress_mpa)
    assert abs(depth - 0.3) < 3.0 * of_depth < 0.1
    assert_load(freed, contact)


def test_a_load_that_swings_in_the_exposure_is_found():
    contact = made(UnlistedContact, 2, swing=0.03)
    freed = asked(contact)
    assert freed.names == {"a load that swings within the exposure"}
    swing, spread = value(freed, "load.swing")
    assert abs(swing - 0.03) < 3.0 * spread < 0.01
    assert_load(freed, contact)


@pytest.mark.parametrize(("plane", "seed"), [("strain", 3), ("stress", 4), ("stress", 5)])
def test_a_frame_tells_plane_strain_from_plane_stress(plane, seed):
    """Without friction only E* differs: (1 - nu²)/E of the block, or 1/E."""
    contact = made(RealContact, seed, friction=0.0)
    block, roller = (contact.scene()[part] for part in ("specimen", "indenter"))
    strain, stress = (
        (1.0 - nu * block["poisson"] ** 2) / block["young_gpa"]
        + (1.0 - nu * roller["poisson"] ** 2) / roller["young_gpa"]
        for nu in (1.0, 0.0)
    )
    if plane == "stress":
        contact = replace(contact, modulus_change=strain / stress - 1.0)
    young = {"value": 1.004 * block["young_gpa"], "standard_uncertainty": 0.01}
    freed = asked(contact, plane="unknown", young_gpa=young)
    share, spread = value(freed, "specimen.plane_stress_share")
    assert abs(share - (plane == "stress")) < 3.0 * spread < 0.3
    assert any(f"plane {plane}" in text for text in cause_messages(freed))
    assert_load(freed, contact)


def test_a_plane_is_told_out_of_focus_too():
    """What is not sure of bent light is of the scene that the fit begins with."""
    contact = made(RealContact, 3, friction=0.0)
    tables = contact.scene()
    tables["specimen"] = tables["specimen"] | {"plane": "unknown"}
    tables["camera"] = tables["camera"] | {"focus_mm": 0.01}
    scene = load_scene(tables | {"load": {"normal_n": contact.load_n}})
    data = prepare_frame(Frame(0, contact.frame(7), None, "bench"), scene, bit_depth=8)
    assert abs(value(fit_with_causes(data, scene), "specimen.plane_stress_share")[0]) < 0.2


def test_a_modulus_that_nobody_knows_leaves_the_plane_open():
    contact = made(RealContact, 3, friction=0.0)
    young = {"value": contact.scene()["specimen"]["young_gpa"], "standard_uncertainty": 0.3}
    freed = asked(contact, plane="unknown", young_gpa=young)
    assert any("not tell plane strain from plane stress" in t for t in cause_messages(freed))


def test_a_plane_that_nobody_knows_is_not_simulated():
    scene = load_scene("line-contact-wear").with_values({"specimen.plane": "unknown"})
    with pytest.raises(InputError, match=r"specimen\.plane = 'unknown'"):
        scene_states(scene)
    for share, plane in ((0.0, "strain"), (1.0, "stress")):
        one = scene.with_values({"specimen.plane_stress_share": share})
        other = load_scene("line-contact-wear").with_values({"specimen.plane": plane})
        first, second = (scene_states(s)[0].surface.pressure_mpa for s in (one, other))
        np.testing.assert_array_equal(first, second)
    with pytest.raises(InputError, match="give plane = 'unknown'"):
        load_scene("line-contact-wear").with_values({"specimen.plane_stress_share": 0.5})


@pytest.mark.long
@pytest.mark.parametrize("seed", [45, 94])
def test_a_focus_beside_a_roll_or_in_a_louder_frame_is_fitted(seed):
    """Hard cases: its field was not made anew for a slope; what is not sure was taken off noise
    that had grown."""
    assert not case_benches.judged("benches", seed).refused


@pytest.mark.long
@pytest.mark.parametrize(("fact", "bar"), [({"roughness_mm": 2e-4}, 0.2), ({}, 0.0)])
def test_rough_surfaces_are_found_in_a_worn_contact_too(fact, bar):
    """It was named tractions, a modulus or a tilt, and the modulus was off by 7 to 37 of its u."""
    contact = made(BenchContact, 9, worn_m=100.0, **fact)
    freed = asked(contact)
    assert freed.names == ({"rough surfaces"} if fact else frozenset())
    if fact:
        found, spread = value(freed, "contact.roughness_um")
        assert abs(found - bar) < 3.0 * spread < 0.3 * bar
    assert_load(freed, contact)
