"""Measured numbers with a standard uncertainty: plain for all users, kept beside, written back."""

import datetime
import pickle

import pytest

from isochrome.errors import InputError
from isochrome.scene import dump_scene, load_scene, parse_scene, with_value
from refusals import refusal

TEXT = """
[specimen]
shape = "disc"
diameter_mm = 40.0
thickness_mm = { value = 6, standard_uncertainty = 0.02 }
fringe_value_n_per_mm = { value = 14.6, standard_uncertainty = 0.066 }
[load]
normal_n = { value = 300.0, standard_uncertainty = 0 }
[camera]
pixel_mm = { value = 0.1, standard_uncertainty = 2e-4 }
[frames]
gamma = { value = 1.1, standard_uncertainty = 0.01 }
"""


def test_values_are_plain_uncertainties_beside_them_and_written_text_the_same():
    scene = parse_scene(TEXT)
    assert scene.specimen.thickness_mm == 6.0 and isinstance(scene.specimen.thickness_mm, float)
    assert scene.get("frames.gamma") == 1.1
    assert scene.uncertainties == {
        "camera.pixel_mm": 2e-4, "frames.gamma": 0.01, "load.normal_n": 0.0,
        "specimen.fringe_value_n_per_mm": 0.066, "specimen.thickness_mm": 0.02,
    }  # fmt: skip
    with pytest.raises(TypeError):
        scene.uncertainties["load.normal_n"] = 1.0
    assert isinstance(hash(scene), int)
    text = dump_scene(scene)
    assert "thickness_mm = { value = 6.0, standard_uncertainty = 0.02 }\n" in text
    assert parse_scene(text) == scene and pickle.loads(pickle.dumps(scene)) == scene
    plain = parse_scene(TEXT).with_values({}).model_copy(update={"stated_uncertainty": ()})
    assert "standard_uncertainty" not in dump_scene(plain)


def test_changed_values_keep_uncertainties_which_go_with_their_number():
    scene = parse_scene(TEXT)
    moved = scene.with_values({"specimen.thickness_mm": 5.0})
    assert moved.uncertainties == scene.uncertainties
    stated = {"value": 5.0, "standard_uncertainty": 0.5}
    known = scene.with_values({"specimen.thickness_mm": stated, "load.bulk_mpa": 1.0})
    assert known.uncertainties == scene.uncertainties | {"specimen.thickness_mm": 0.5}
    assert known.specimen.thickness_mm == 5.0
    scene = parse_scene(TEXT).with_values({"frames.gamma": "unknown", "camera.pixel_mm": None})
    assert not {"frames.gamma", "camera.pixel_mm"} & set(scene.uncertainties)


def test_neither_tables_nor_wrong_values_have_an_uncertainty():
    text = """
[specimen]
[load]
normal_n = { distance_m = [0, 1], value = [3, 4], standard_uncertainty = 0.1 }
"""
    with pytest.raises(InputError, match=r"load\.normal_n = .* is not allowed: a measured number"):
        parse_scene(text)
    text = "[specimen]\nthickness_mm = { value = -6, standard_uncertainty = 0.02 }"
    with pytest.raises(InputError, match=r"specimen\.thickness_mm = -6 is not allowed"):
        parse_scene(text)
    with pytest.raises(InputError, match="only a single number"):
        parse_scene("[specimen]\nthickness_mm = { value = [6], standard_uncertainty = 0.02 }")
    with pytest.raises(InputError, match="unknown key 'stated_uncertainty'"):
        parse_scene("stated_uncertainty = [['specimen.thickness_mm', 1.0]]\n[specimen]")


@pytest.mark.parametrize("spread", ["-1", "nan", "inf", "'much'", "true", "1e40"])
def test_wrong_uncertainties_are_refused_by_key_and_value(spread):
    text = f"[specimen]\nthickness_mm = {{ value = 6, standard_uncertainty = {spread} }}"
    with pytest.raises(InputError, match=r"specimen\.thickness_mm\.standard_uncertainty = .* 0 or"):
        parse_scene(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[camera]\nbit_depth", r"camera\.bit_depth is no measured number"),
        ("[camera]\nseed", r"camera\.seed is no measured number"),
        ("[numerics]\ntolerance", r"numerics\.tolerance is no measured number"),
        ("[wear]\ndistances_m", r"wear\.distances_m is no measured number"),
        ("[specimen]\nthicknes_mm", r"unknown key 'specimen\.thicknes_mm'; did you mean 'thick"),
        ("[speciment]\nthickness_mm", r"unknown key 'speciment'; did you mean 'specimen'"),
    ],
)
def test_what_is_not_measured_has_no_uncertainty(text, message):
    with pytest.raises(InputError, match=message):
        parse_scene(f"{text} = {{ value = 8, standard_uncertainty = 1 }}")


DATED = TEXT.replace("= 0.066 }", '= 0.066, date = "2026-11-25" }')
FRINGE_VALUE = "specimen.fringe_value_n_per_mm"


@pytest.mark.parametrize("written", ['"2026-11-25"', "2026-11-25"])
def test_a_fringe_value_has_the_day_of_its_calibration(written):
    scene = parse_scene(DATED.replace('"2026-11-25"', written))
    assert scene.fringe_value_date == "2026-11-25"
    assert scene.uncertainties == parse_scene(TEXT).uncertainties
    text = dump_scene(scene)
    line = '{ value = 14.6, standard_uncertainty = 0.066, date = "2026-11-25" }'
    assert f"fringe_value_n_per_mm = {line}\n" in text
    assert parse_scene(text) == scene == pickle.loads(pickle.dumps(scene))
    edited = with_value(DATED.replace('"2026-11-25"', written), "load.normal_n", "310.0")
    assert parse_scene(edited).fringe_value_date == "2026-11-25"


def test_a_date_belongs_to_its_value_in_tables_of_python_too():
    value = {"value": 14.6, "standard_uncertainty": 0.1, "date": datetime.date(2026, 11, 25)}
    scene = load_scene({"specimen": {"fringe_value_n_per_mm": value}})
    assert scene.fringe_value_date == "2026-11-25"
    # A value that a fit has found, or that somebody sets, is not that of the day
    scene = parse_scene(DATED)
    assert scene.with_values({"load.normal_n": 310.0}).fringe_value_date == "2026-11-25"
    assert scene.with_values({FRINGE_VALUE: 14.6}).fringe_value_date == "2026-11-25"
    new = {"value": 14.7, "standard_uncertainty": 0.1}
    for value in (14.5, new):
        other = scene.with_values({FRINGE_VALUE: value})
        assert other.fringe_value_date is None and "date" not in dump_scene(other)
    again = scene.with_values({FRINGE_VALUE: new | {"date": "2027-01-02"}})
    assert again.fringe_value_date == "2027-01-02"


@pytest.mark.parametrize(
    "written", ['"25.11.2026"', '"20261125"', "2026-11-25T08:00:00", "20261125", '"soon"', "[]"]
)
def test_what_is_no_day_is_refused_in_a_line(written):
    text = refusal(parse_scene, DATED.replace('"2026-11-25"', written))
    assert f"{FRINGE_VALUE}.date = " in text and "the day of the calibration is written as" in text


def test_other_values_and_plain_ones_have_no_date():
    text = TEXT.replace(
        "standard_uncertainty = 0.02 }", 'standard_uncertainty = 0.02, date = "a" }'
    )
    with pytest.raises(InputError, match=r"thickness_mm = .* a measured number is written as"):
        parse_scene(text)
    alone = DATED.replace("standard_uncertainty = 0.066, ", "")
    with pytest.raises(InputError, match="its date beside these"):
        parse_scene(alone)
    with pytest.raises(InputError, match="unknown key 'fringe_value_date'"):
        parse_scene('fringe_value_date = "2026-11-25"\n' + TEXT)
