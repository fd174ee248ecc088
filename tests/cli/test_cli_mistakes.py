"""Mistakes that newcomers make: each is named with its cause and what mends it, in one line."""

import shutil

import numpy as np
import pytest
import tifffile

OUT = ("--out", "out")


@pytest.fixture
def scene_said(scene_with, quick_isochrome):
    """Simulate the small scene with some text replaced; what is said of it."""

    def run(old, new, **how):
        done = quick_isochrome("simulate", scene_with(old, new, **how), *OUT)
        assert done.code == 2 and done.err.count("\n") == 1 and not done.out
        return done.err

    return run


@pytest.mark.parametrize(
    "written", ["4,0", "{ value = 4,0, standard_uncertainty = 0.1 }", "4,0  # mm"]
)
def test_a_decimal_comma(scene_said, written):
    said = scene_said("thickness_mm = 4.0", f"thickness_mm = {written}")
    assert "line " in said and "a decimal comma: write 4.0, with a point" in said


@pytest.mark.parametrize("words", [("--edges-mm", "4,003"), ("--edges-mm=4,003",)])
def test_a_decimal_comma_on_the_command_line(quick_isochrome, words):
    """It was said to be no number, and not why."""
    done = quick_isochrome("calibrate", "scale", "frames.tif", *words)
    assert done.code == 2 and done.err.count("\n") == 1 and not done.out
    assert "'--edges-mm'" in done.err
    assert "4,003 has a decimal comma: write 4.003, with a point" in done.err


def test_a_decimal_comma_where_a_whole_number_is_due(place, quick_isochrome):
    """A point was advised, which is refused as well."""
    done = quick_isochrome("process", "frames.tif", "--scene", "small.toml", "--every", "2,5")
    assert done.code == 2 and done.err.count("\n") == 1 and "'--every'" in done.err
    assert "2,5 is no whole number" in done.err and "point" not in done.err
    # where it parts two values they are named: no point is taken without a word
    done = quick_isochrome("sweep", "small.toml", "--vary", "load.normal_n=6,5:7,5:3", *OUT)
    assert done.code == 2 and "with points in its numbers, not commas" in done.err
    done = quick_isochrome("sweep", "small.toml", "--vary", "friction.coefficient=0,1,0,2", *OUT)
    assert done.code == 2 and "a comma parts values, and a number has a point" in done.err
    done = quick_isochrome("sweep", "small.toml", "--vary", "load.normal_n=42,5", *OUT)
    assert done.code == 0 and "load.normal_n = 42, 5\n2 points" in done.out


def test_a_byte_order_mark_is_read_over(scene_with, quick_isochrome):
    scene = scene_with("", encoding="utf-8-sig")
    assert quick_isochrome("check", "frames.tif", "--scene", scene).code == 0


def test_byte_order_marks_and_backslashes_are_read_over_or_named(scene_said):
    said = scene_said("[load]", "[load]", encoding="utf-16")
    assert "UTF-16" in said and "save it as UTF-8" in said
    said = scene_said("[load]", FRAMES.format(r'"C:\Users\lab\mask.png"'))
    assert "a backslash in double quotes" in said and "single quotes" in said
    said = scene_said("fringe_value_n_per_mm", "f_sigma")
    assert "'specimen.f_sigma'; it is called 'fringe_value_n_per_mm'" in said
    assert "N/mm per fringe" in said


FRAMES = "[frames]\nmask = {}\n[load]"


@pytest.mark.parametrize("path", [r"runs\new.png", r"runs\the.png"])
def test_a_backslash_that_became_another_letter(scene_said, path):
    """It was looked for as a file with a new line or a tab in its name."""
    said = scene_said("[load]", FRAMES.format(f'"{path}"'))
    assert "frames.mask" in said and "a backslash begins an escape" in said and "with /" in said


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("young_gpa = 2.1", "young_gpa = 2100", ("young_gpa = 2100", "2100 MPa are 2.1 GPa")),
        ("young_gpa = 2.1\n", "young_mpa = 2100\n", ("'young_gpa'?", "in GPa, not MPa")),
        ("thickness_mm = 4.0", "thickness_mm = 4000", ("4000 µm are 4 mm",)),
        ("radius_mm = 24.61", "radius_mm = 24610", ("24610 µm are 24.61 mm",)),
        ("pixel_mm = 0.025", "pixel_mm = 25.0", ("camera.pixel_mm = 25 ", "not in µm")),
        ("pixel_mm = 0.025", "pixel_um = 25.0", ("'pixel_mm'?", "in mm, not µm")),
    ],
    ids=["MPa", "young_mpa", "thickness", "radius", "pixel", "pixel_um"],
)
def test_another_unit(scene_said, old, new, words):
    """Moduli in MPa and a thickness in µm were simulated without a word."""
    said = scene_said(old, new)
    assert all(word in said for word in words)


def test_moduli_in_mpa_are_found_by_check(scene_with, quick_isochrome):
    scene = scene_with("young_gpa = 2.1", "young_gpa = 2100")
    done = quick_isochrome("check", "frames.tif", "--scene", scene)
    assert done.code == 2 and "error: " in done.out and "2100 MPa are 2.1 GPa" in done.out


@pytest.mark.parametrize("command", ["simulate", "process"])
def test_a_picture_as_the_scene(place, quick_isochrome, command):
    given = ("small.toml", "--scene") if command == "process" else ()
    done = quick_isochrome(command, *given, "frames.tif", *OUT)
    assert done.code == 2
    assert "frames.tif: is a picture or a video" in done.err and "swapped?" in done.err


@pytest.mark.parametrize("name", ["frames.jpg", "frames.png"])
def test_a_tiff_by_another_name_is_read_as_what_it_is_and_named(place, quick_isochrome, name):
    shutil.copy(place / "frames.tif", place / name)
    done = quick_isochrome("check", name, "--scene", "small.toml")
    assert done.code == 0
    assert f"{name}: is a TIFF by its first bytes" in done.out and "rename it" in done.out
    assert "compressed with loss" not in done.out  # as a JPEG is, and a TIFF is not


def test_an_image_by_its_own_name_is_not_named(place, quick_isochrome):
    tifffile.imwrite(place / "own.tif", np.asarray(tifffile.imread(place / "frames.tif")))
    done = quick_isochrome("check", "own.tif", "--scene", "small.toml")
    assert "by its name" not in done.out
