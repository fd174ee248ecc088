"""One-state scenes: what a frame at one distance is modelled by."""

import pytest

from isochrome.contact import wear_course
from isochrome.errors import InputError
from isochrome.fitting import fit, frame_scene, scene_at
from isochrome.scene import load_scene

RUNNING_IN = {"distance_m": [0.0, 100.0], "value": [4e-9, 2e-9]}
RAMP = {"distance_m": [0.0, 200.0], "value": [0.1, 0.3]}


def scene(**values):
    changed = {key.replace("__", "."): value for key, value in values.items()}
    return load_scene("line-contact-wear").with_values(changed)


@pytest.mark.parametrize("law", ["archard", "sarkar", "dissipated_energy"])
@pytest.mark.parametrize("k", [2e-9, RUNNING_IN])
@pytest.mark.parametrize("mu", [0.25, RAMP])
def test_one_state_has_its_own_numbers_and_the_dose_of_the_whole_course(law, k, mu):
    whole = scene(wear__law=law, wear__coefficient_mm2_per_n=k, friction__coefficient=mu)
    for stop in wear_course(whole)[1][1:]:
        one = scene_at(whole, stop.distance_m)
        assert one.load.normal_n == 44.0
        assert one.friction.coefficient == whole.friction_at(stop.distance_m)
        assert isinstance(one.wear.coefficient_mm2_per_n, float)
        (same,) = wear_course(one)[1]
        # the same integral, once more as a number: rounding
        assert same.dose_mm_per_mpa == pytest.approx(stop.dose_mm_per_mpa, rel=1e-13)


def test_a_law_over_a_constant_friction_stays_the_scenes_own():
    one = scene_at(scene(wear__law="sarkar"), 77.0)
    assert one.wear.law == "sarkar" and one.wear.coefficient_mm2_per_n == 2e-9


def test_a_static_frame_has_neither_wear_nor_friction_and_a_new_one_no_wear():
    static, new, *_ = (frame_scene(scene(), i) for i in range(4))
    assert static.wear is None and static.friction is None
    assert new.wear is None and new.friction.coefficient == 0.25


def test_a_frame_has_the_load_at_its_own_distance():
    late = {"distance_m": [100.0, 200.0], "value": [44.0, 60.0]}
    varied = scene(load__normal_n=late)
    loads = [frame_scene(varied, i).load.normal_n for i in range(4)]
    assert loads == [44.0] * 4  # static, 0 m, 31 m, 77 m
    unworn = scene(load__normal_n=late, wear__coefficient_mm2_per_n=0.0)
    assert scene_at(unworn, 150.0).load.normal_n == 52.0


def test_a_load_that_changed_while_the_contact_wore_is_refused():
    varied = scene(load__normal_n={"distance_m": [50.0, 60.0], "value": [44.0, 50.0]})
    assert scene_at(varied, 31.0).load.normal_n == 44.0
    with pytest.raises(InputError, match=r"load.normal_n is a table that changes before 155 m"):
        scene_at(varied, 155.0)


@pytest.mark.parametrize(
    ("key", "table"),
    [
        ("wear.coefficient_mm2_per_n", RUNNING_IN),
        ("load.normal_n", {"distance_m": [300.0, 400.0], "value": [44.0, 45.0]}),
    ],
)
def test_a_table_is_not_one_unknown_of_all_frames(key, table):
    with pytest.raises(InputError, match=f"{key} cannot be fitted: it is a table over distance"):
        fit("frames-that-are-not-there.tif", scene(**{key: table}), [key])


def test_what_lay_between_the_bodies_while_they_wore_stays_a_table():
    """The scar remembers it; without wear the frame's own value is all there is."""
    over = {"distance_m": [0.0, 40.0], "value": [0.4, 0.0]}
    scene = load_scene("line-contact-wear").with_values(
        {"contact.roughness_um": over, "contact.layer_um_per_mpa": over}
    )
    static, first, worn = (frame_scene(scene, state) for state in (0, 1, 2))
    for one in (static, first):
        assert (one.contact.roughness_um, one.contact.layer_um_per_mpa) == (0.4, 0.4)
    assert worn.contact == scene.contact
    unworn = scene_at(scene.model_copy(update={"wear": None}), 10.0)
    assert unworn.contact.roughness_um == pytest.approx(0.3)
