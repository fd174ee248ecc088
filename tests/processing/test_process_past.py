"""A worn block remembers friction and loads that it was worn under: a frame's ± covers it."""

from math import hypot, sqrt

import numpy as np
import pytest

import isochrome
from isochrome.messages import frame_messages
from isochrome.processing import (
    ProcessedFrame,
    collect,
    process,
    with_past_friction,
    with_past_loads,
)
from isochrome.scene import load_scene

KEY = "friction.coefficient"
SPREAD = f"{KEY} standard_uncertainty"
LOAD, WEAR = "load.normal_n", "wear.coefficient_mm2_per_n"
LOAD_SPREAD, WEAR_SPREAD = (f"{key} standard_uncertainty" for key in (LOAD, WEAR))
SCENE = load_scene("line-contact-wear")


def table(frictions, distances, uncertainty=1e-6):
    return {"distance_m": list(distances), KEY: list(frictions), SPREAD: [uncertainty] * 4}


def test_a_friction_that_was_another_before_is_wider_by_what_the_scar_remembers():
    """0.20 until 50 m, then rising to 0.30 at 100 m: by hand a mean of 0.2 and of 0.225."""
    found = with_past_friction(table([None, 0.2, 0.2, 0.3], [0, 0, 50, 100]), SCENE)
    assert found[SPREAD][:3] == [1e-6] * 3 and found[SPREAD][3] == pytest.approx(0.015 * 0.075)
    assert with_past_friction(found, SCENE) is found  # once is enough


def test_a_friction_of_one_course_or_shown_in_the_frame_stays():
    given = table([0.2] * 4, [0, 31, 77, 155])
    assert with_past_friction(given, SCENE) is given
    given = table([0.2, 0.2, 0.2, 0.3], [0, 31, 77, 155])
    assert with_past_friction(given, SCENE.model_copy(update={"wear": None})) is given
    shown = {"causes": ["", "", "", "friction.earlier_change = -0.1 ± 0.001"]}
    assert with_past_friction(given | shown, SCENE)[SPREAD] == [1e-6] * 4


def table_of_loads(loads, **more):
    """Frames after 50, 100 and 150 m, with a wear coefficient of 2e-9 that is surely known."""
    known = {LOAD_SPREAD: [1e-3] * 3, WEAR_SPREAD: [1e-14] * 3}
    return {"distance_m": [50, 100, 150], LOAD: list(loads), WEAR: [2e-9] * 3} | known | more


def test_a_frame_by_itself_is_as_unsure_as_its_load_was_another():
    """40, 44 and 48 N: by hand a mean of 44 N and of 1944 N² over the way, and so before it."""
    found = with_past_loads(table_of_loads([40.0, 44.0, 48.0]), SCENE)
    scatter = 0.3 * sqrt(1944.0 - 44.0**2) / 44.0
    by_hand = [2e-9 * hypot(scatter, 44.0 / load - 1.0) for load in (40.0, 44.0, 48.0)]
    # of 50 and 100 m the mean until then: 44 N, and (50 x 44 + 50 x 42) / 100 = 43 N
    by_hand[1] = 2e-9 * hypot(0.3 * sqrt((1944.0 + 1768.0) / 2.0 - 43.0**2) / 43.0, 43 / 44 - 1)
    assert found[WEAR_SPREAD] == pytest.approx(by_hand)
    assert with_past_loads(found, SCENE) is found  # once is enough


def test_a_followed_frame_knows_the_loads_since_its_track_began():
    by = {"found_by": ["whole frame", "track", "track"]}
    found = with_past_loads(table_of_loads([40.0, 44.0, 48.0], **by), SCENE)
    begun = 0.3 * sqrt(8.0) / 44.0  # at 50 m: a third of the way at the end
    assert found[WEAR_SPREAD][1:] == pytest.approx([2e-9 * begun / 2, 2e-9 * begun / 3])
    given = table_of_loads([44.0] * 3)
    assert with_past_loads(given, SCENE) is given
    swinging = table_of_loads([40.0, 44.0, 48.0])
    given = {name: column for name, column in swinging.items() if LOAD not in name}
    assert with_past_loads(given, SCENE) is given
    given = {name: column[:1] for name, column in swinging.items()}
    assert with_past_loads(given, SCENE) is given


def worn(**friction):
    """The paper's block after 155 m, on pixels of three."""
    return SCENE.with_values(
        {
            "friction.static_state_first": False, "wear.distances_m": [155.0],
            "camera.width_px": 220, "camera.height_px": 165, "camera.pixel_mm": 0.01821,
            "camera.noise_grey": 1.0,
        }
        | {f"friction.{key}": value for key, value in friction.items()}
    )  # fmt: skip


def changed(past):
    """A friction that was another until two centimetres before the frame."""
    return {"distance_m": [0.0, 154.98, 154.99], "value": [past, past, 0.25]}


def one_frame(scene):
    return np.asarray(isochrome.simulate(scene).frames)[-1]


@pytest.mark.study  # of a change by a twentieth see the sample's last frame in test_process.py
@pytest.mark.parametrize("past", [0.15, 0.0, 0.22, 0.4])
def test_a_single_frame_whose_friction_was_another_before_is_right_within_its_uncertainty(past):
    """Its truth is a table over distance, which the frame's model has not.
    With the scar of one friction the frame of 0.15 came out at 0.2605, 20 of its ±, with a camera
    that was turned and looked from the side."""
    stated = worn(coefficient=0.25)
    row = process(one_frame(worn(coefficient=changed(past))), stated).table.iloc[0]
    for key in ("friction.coefficient", "load.normal_n", "camera.left_mm"):
        # one in 370 beyond three of them by chance alone
        assert abs(row[key] - stated.get(key)) < 3.0 * row[f"{key} standard_uncertainty"]
    (cause,) = row["causes"].split("; ")
    key, _, text = cause.partition(" = ")
    value, spread = map(float, text.split(" ± "))
    assert key == "friction.earlier_change"
    assert abs(value - (past - 0.25)) < 3.0 * spread + 1e-3  # the last two centimetres


@pytest.mark.long
def test_a_single_frame_of_one_friction_asks_for_no_other_before():
    scene = worn(coefficient=0.25)
    row = process(one_frame(scene), scene).table.iloc[0]
    assert not row["causes"] and abs(row[KEY] - 0.25) < 3.0 * row[SPREAD]


def test_an_earlier_change_beside_a_table_is_refused():
    with pytest.raises(isochrome.InputError, match=r"earlier_change.*says what it was before"):
        worn(coefficient=changed(0.15), earlier_change=0.1)


def test_a_frame_that_is_made_wider_and_has_nothing_to_say_says_nothing():
    columns = {"chi": 1.0, KEY: 0.3, SPREAD: 1e-6}
    blank = np.full((2, 2), np.nan)
    frames = [
        ProcessedFrame(index=i, name="", label="", distance_m=s, normalised=blank, columns=columns)
        for i, s in enumerate((0.0, 31.0, 77.0, 155.0))
    ]
    rows = table([0.2, 0.2, 0.2, 0.3], [0, 31, 77, 155]) | {"chi": [1.0] * 4}
    rows |= {
        "pixel_mm": [None] * 4, "frame": [0, 1, 2, 3], "warnings": ["", "", "", "dark | small"],
    }  # fmt: skip
    cells = ["", "", "", frame_messages(["dark", "small"])]
    more = {"status": ["done"] * 4, "messages": cells}
    found = collect(SCENE, rows, more, frames, (2, 2)).frames
    assert found[3].columns[SPREAD] > 1e-4
    assert [item.warnings for item in found] == [(), (), (), ("dark", "small")]
