"""Wrong scenes are refused in one sentence: file, key, value, what is allowed, the fix."""

import re

import pytest

from isochrome import scene
from isochrome.errors import InputError
from isochrome.scene import dump_scene, load_scene, parse_scene
from refusals import refusal

GOOD = dump_scene(load_scene("line-contact-wear"))


def sentence(old: str, new: str) -> str:
    """What the shipped scene's text answers with one piece of it replaced."""
    assert GOOD.count(old) >= 1, old
    with pytest.raises(InputError) as refused:
        parse_scene(GOOD.replace(old, new, 1), label="my.toml")
    assert refused.value.exit_code == 2
    text = str(refused.value)
    assert text.startswith("my.toml: ") and "\n" not in text
    assert "pydantic" not in text and "function-" not in text and "constrained" not in text
    return text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("young_gpa = 2.1", "young_gpa = -2.1", ["specimen.young_gpa = -2.1", "greater than 0"]),
        ("young_gpa = 2.1", "young_gpa = inf", ["specimen.young_gpa = inf", "finite"]),
        ("young_gpa = 2.1", "young_gpa = nan", ["specimen.young_gpa = nan", "finite"]),
        ("young_gpa = 2.1", 'young_gpa = "two"', ["specimen.young_gpa = 'two'", "number"]),
        ("normal_n = 44.0", "normal_n = true", ["load.normal_n = True", "not be true or false"]),
        ("width_px = 659", "width_px = 65.5", ["camera.width_px = 65.5", "integer"]),
        ("width_px = 659", "width_px = true", ["camera.width_px = True", "true or false"]),
        ('"dark"', '"dim"', ["polariscope.field = 'dim'", "'dark', 'bright' or 'plane'"]),
        ("31.0", "-3.0", ["wear.distances_m[2] = -3.0", "greater than or equal to 0"]),
        ("coefficient = 0.25", "coefficient = {distance_m = [0, 1], value = [0.1]}",
         ["friction.coefficient.value = [0.1]", "at least 2 items"]),
        ("coefficient = 0.25", "coefficient = {distance_m = [0, 1], value = [0.1, nan]}",
         ["friction.coefficient.value[2] = nan", "finite"]),
        ("coefficient_mm2_per_n = 2e-09",
         "coefficient_mm2_per_n = {distance_m = [0, 1], value = [1e-9, -1e-9]}",
         ["wear.coefficient_mm2_per_n.value[2] = -1e-09", "greater than or equal to 0"]),
        ("normal_n = 44.0", "normal_n = {distance_m = [0, 1], value = [44.0, 0]}",
         ["load.normal_n.value[2] = 0", "greater than 0"]),
        ("[wear]", '[wear]\nlaw = "rabinowicz"',
         ["wear.law = 'rabinowicz'", "'archard', 'sarkar' or 'dissipated_energy'"]),
    ],
)  # fmt: skip
def test_a_wrong_value_names_key_value_and_what_is_allowed(old, new, words):
    text = sentence(old, new)
    assert "is not allowed" in text and "correct it" in text
    assert all(word in text for word in words), text


@pytest.mark.parametrize(
    ("old", "new", "wrong", "right"),
    [
        ("[load]", "[laod]", "laod", "load"),
        ("normal_n", "norml_n", "load.norml_n", "normal_n"),
        ("static_state_first", "static_first", "friction.static_first", "static_state_first"),
    ],
)
def test_a_misspelt_key_names_the_nearest_known_one(old, new, wrong, right):
    text = sentence(old, new)
    assert f"unknown key '{wrong}'" in text and f"did you mean '{right}'?" in text


@pytest.mark.parametrize(
    ("part", "key"),
    [
        (part, key)
        for part in scene.Scene.model_fields
        if hasattr(scene, part.capitalize())
        for key in getattr(scene, part.capitalize()).model_fields
    ],
)
def test_every_key_with_two_letters_swapped_is_recognised(part, key):
    swapped = next(
        (
            key[:i] + key[i + 1] + key[i] + key[i + 2 :]
            for i in range(1, len(key) - 1)
            if key[i] != key[i + 1]
        ),
        None,
    )
    text = refused(f"[{part}]\n{swapped} = 1\n" + "[specimen]\n" * (part != "specimen"))
    assert f"unknown key '{part}.{swapped}'" in text and f"did you mean '{key}'?" in text


def test_an_unknown_key_like_no_other_lists_the_known_ones_without_inner_names():
    text = sentence("[load]\n", "[load]\nqqq = 1\n")
    assert "unknown key 'load.qqq'" in text and "normal_n, tangential_n, bulk_mpa" in text
    text = sentence("coefficient = 0.25", "coefficient = {distance_m = [0, 1], valu = [0.1, 0.2]}")
    assert "unknown key 'friction.coefficient.valu'; did you mean 'value'?" in text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("young_gpa = 2.1\n", "", ["specimen.young_gpa is missing", "a contact needs it; add it"]),
        ("thickness_mm = 4.0\n", "", ["specimen.thickness_mm is missing"]),
        ("normal_n = 44.0\n", "", ["the key 'load.normal_n' is missing; add it"]),
        ("radius_mm = 24.61\n", "", ["[indenter] a cylinder needs radius_mm", "shape = 'flat'"]),
        ("radius_mm = 24.61\n", 'shape = "flat"\n', ["needs half_width_mm; add it"]),
        ("[camera]", "[[polariscope.step]]\npolariser_deg = 1\n[camera]",
         ["the key 'polariscope.step[1].analyser_deg' is missing"]),
        ("[camera]",
         "[[polariscope.step]]\npolariser_deg=1\nanalyser_deg=2\ninput_plate_deg=3\n[camera]",
         ["[polariscope.step[1]]", "both input_plate_deg and output_plate_deg"]),
        ("wavelength_nm = 587.0", "plate_wavelength_nm = 560.0",
         ["[polariscope] plate_wavelength_nm needs wavelength_nm", "add it"]),
        ("coefficient = 0.25", "coefficient = {distance_m = [1, 0], value = [0.1, 2]}",
         ["[friction.coefficient] distance_m must rise", "sort it"]),
        ("coefficient = 0.25", "coefficient = {distance_m = [0, 1], value = [0.1, 0.2, 0.3]}",
         ["distance_m has 2 numbers and value has 3", "as many of each"]),
        ("[load]\n", "[load]\ntangential_n = 2.0\n",
         ["load.tangential_n is for a stuck contact", "remove one"]),
        ("[specimen]\n", '[specimen]\nshape = "disc"\n',
         ["[indenter] and [specimen] shape = 'disc' exclude each other", "remove one"]),
    ],
)  # fmt: skip
def test_parts_that_do_not_agree_are_refused_with_the_way_out(old, new, words):
    text = sentence(old, new)
    assert all(word in text for word in words), text


CONTACT = GOOD[: GOOD.index("[friction]")]


def refused(text: str) -> str:
    return refusal(parse_scene, text, label="my.toml")


def test_tangential_load_needs_friction_and_stays_within_it():
    held = CONTACT.replace("[load]\n", "[load]\ntangential_n = 12.0\n")
    assert "load.tangential_n needs [friction]" in refused(held)
    text = refused(held + "[friction]\ncoefficient = 0.25\n")
    assert "load.tangential_n = 12 is more than friction can hold, 11 N" in text
    assert parse_scene(held + "[friction]\ncoefficient = -0.5\n").load.tangential_n == 12.0
    wear = '[wear]\nlaw = "dissipated_energy"\ncoefficient_mm2_per_n = 1e-9\ndistances_m = [1]\n'
    text = refused(CONTACT + wear)
    assert "wear.law = 'dissipated_energy' needs [friction]" in text and "add it" in text
    assert parse_scene(CONTACT + wear + "[friction]\ncoefficient = 0.1\n").wear.law
    assert parse_scene(CONTACT + wear.replace("dissipated_energy", "sarkar")).wear.law == "sarkar"
    ring = '[specimen]\nshape = "ring"\n'
    assert "need an [indenter]" in refused(ring + "[friction]\ncoefficient = 0.2\n")
    wear = "[wear]\ncoefficient_mm2_per_n = 1e-9\ndistances_m = [1]\n"
    assert "need an [indenter]" in refused(ring + wear)


TABLE_OF_LOADS = "normal_n = {distance_m = [0, 9], value = [44, 20]}"


def test_a_load_over_distance_needs_a_contact_that_slides():
    sliding = CONTACT.replace("normal_n = 44.0", TABLE_OF_LOADS)
    assert parse_scene(sliding).load_at(9.0) == 20.0
    for shape in ('"disc"\ndiameter_mm = 9.0', '"beam"\nheight_mm = 9.0', '"other"'):
        text = refused(
            f"[specimen]\nshape = {shape}\nthickness_mm = 4.0\nfringe_value_n_per_mm = 14.6\n"
            f"[load]\n{TABLE_OF_LOADS}\ninner_span_mm = 1.0\nouter_span_mm = 2.0\n"
        )
        assert "load.normal_n is a table over sliding distance" in text
        assert "give load.normal_n as a number" in text
    held = sliding.replace("[load]\n", "[load]\ntangential_n = 2.0\n")
    text = refused(held + "[friction]\ncoefficient = 0.25\n")
    assert "load.normal_n is a table" in text and "load.tangential_n" in text


def test_text_that_is_no_toml_names_the_line_and_is_not_crashed_on():
    assert "not valid TOML" in sentence("[load]", "[load") and "line" in sentence("[load]", "[load")
    assert "not valid TOML" in refused("a = " + "[" * 100_000)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"load.normal_n": -1.0}, "load.normal_n = -1.0 is not allowed: input should be greater"),
        ({"friction.coefficient": 7.0}, "friction.coefficient = 7.0 is not allowed"),
        # rules between parts hold for changed scenes too
        ({"load.tangential_n": 5.0}, "is for a stuck contact, and \\[wear\\] for a sliding one"),
        ({"specimen.thickness_mm": None}, "specimen.thickness_mm is missing"),
        ({"specimen.shape": "disc"}, "exclude each other"),
        ({"load.norml_n": 1.0}, "load.norml_n: \\[load\\] has no such key; it has normal_n"),
        ({"lode.normal_n": 1.0}, "lode.normal_n: the scene has no such key"),
        ({"specimen": 1.0}, "specimen: the scene has no such key; write it as 'load.normal_n'"),
        ({"name.x": 1.0}, "name.x: the scene has no such key"),
    ],
)
def test_changed_values_are_checked_like_a_file(values, words):
    assert re.search(words, refusal(load_scene("line-contact-wear").with_values, values))


def test_a_key_of_an_absent_part_says_which_part_to_add():
    with pytest.raises(InputError, match=r"friction.coefficient: this scene has no \[friction\]"):
        parse_scene(CONTACT).get("friction.coefficient")


LINE = "[[frames.known_line]]\nrow_px = {}\ncol_px = {}\norder = {}\n"
OUTLINE = "[[frames.free_boundary]]\nrow_px = {}\ncol_px = {}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LINE.format("[3]", "[4]", 1.0), "frames.known_line[1].row_px = [3] is not allowed"),
        (LINE.format("[3, 4]", "[4]", 1.0), "known_line[1].col_px = [4] is not allowed"),
        (LINE.format("[3, 4, 5]", "[4, 5]", 1.0), "row_px has 3 numbers and col_px has 2"),
        (LINE.format("[3, 3]", "[4, 4]", 1.0), "points 1 and 2 are the same; remove one"),
        (LINE.format("[3, nan]", "[4, 5]", 1.0), "row_px[2] = nan is not allowed: input should be"),
        (LINE.format("[3, -1]", "[4, 5]", 1.0), "row_px[2] = -1 is not allowed"),
        (LINE.format("[3, 4]", "[4, 5]", -0.5), "order = -0.5 is not allowed"),
        (LINE.format("[3, 4]", "[4, 5]", "nan"), "order = nan is not allowed"),
        (LINE.format("[3, 4]", "[4, 5]", 1.3),
         "order = 1.3 is not allowed: input should be a mult"),
        (LINE.replace("row_px", "rows_px"), "did you mean 'row_px'?"),
        (OUTLINE.format("[3]", "[4]"), "frames.free_boundary[1].row_px = [3] is not allowed"),
        (OUTLINE.format("[3, 4]", "[4, inf]"), "col_px[2] = inf is not allowed"),
        (OUTLINE.format("[3, 9, 3]", "[4, 9, 4]"), "after 2 points, and an outline has three"),
    ],
)  # fmt: skip
def test_known_lines_and_free_boundaries_that_cannot_be_meant_are_refused(text, words):
    text = text.format("[3, 4]", "[4, 5]", 1.0) if "{" in text else text
    assert words in refusal(parse_scene, "[specimen]\n" + text)


def test_known_lines_are_for_single_frames():
    steps = "[[polariscope.step]]\npolariser_deg = 0.0\nanalyser_deg = 90.0\n"
    with pytest.raises(InputError, match=r"known_line.* is for single frames.*known_order"):
        parse_scene("[specimen]\n" + steps + LINE.format("[3, 4]", "[4, 5]", 1.0))


def test_only_sharp_outward_corners_of_an_outline_with_long_sides_are_free_corners():
    """An L: its corner into the specimen is none; nor is one of 120 degrees, nor a step."""
    shape = OUTLINE.format("[0, 0, 40, 40, 99, 99, 0]", "[0, 90, 90, 40, 40, 0, 0]")
    (outline,) = parse_scene("[specimen]\n" + shape).frames.free_boundary
    places = {(corner.row, corner.col) for corner in outline.corners}
    assert places == {(0, 0), (0, 90), (40, 90), (99, 40), (99, 0)}
    first = next(corner for corner in outline.corners if (corner.row, corner.col) == (40, 90))
    assert first.inward == pytest.approx((-(0.5**0.5), -(0.5**0.5))) and first.angle_deg == 90.0
    backwards = OUTLINE.format("[0, 99, 99, 40, 40, 0, 0]", "[0, 0, 40, 40, 90, 90, 0]")
    (other,) = parse_scene("[specimen]\n" + backwards).frames.free_boundary
    assert {(corner.row, corner.col) for corner in other.corners} == places
    for rows, cols in (("[0, 0, 52]", "[0, 60, 90]"), ("[0, 0, 20]", "[0, 60, 60]")):
        (open_one,) = parse_scene("[specimen]\n" + OUTLINE.format(rows, cols)).frames.free_boundary
        assert not open_one.corners
