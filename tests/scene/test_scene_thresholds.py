"""Every bound of a scene's values: kept to on this side, refused by name on the other."""

import math

import pytest

from isochrome.errors import InputError
from isochrome.scene import dump_scene, load_scene, parse_scene
from refusals import refusal
from scene_texts import PAPER_CONTACT

SCENE = load_scene("line-contact-wear")


def spectrum(first, last=700.0, power=(1.0, 1.0)):
    return {"wavelength_nm": [first, last], "power": list(power)}


def over(*distances, value=0.2):
    return {"distance_m": list(distances), "value": [value] * len(distances)}


def above(value):
    return math.nextafter(value, math.inf)


def below(value):
    return math.nextafter(value, -math.inf)


# key; the last value that is taken; the first that is not; what is said to be allowed
BOUNDS = [
    ("specimen.poisson", 0.5, above(0.5), "less than or equal to 0.5"),
    ("specimen.poisson", above(-1.0), -1.0, "greater than -1"),
    ("indenter.poisson", 0.5, above(0.5), "less than or equal to 0.5"),
    ("specimen.young_gpa", 5e-324, 0.0, "greater than 0"),
    ("specimen.fringe_value_n_per_mm", 5e-324, 0.0, "greater than 0"),
    ("indenter.radius_mm", 5e-324, 0.0, "greater than 0"),
    ("load.normal_n", 5e-324, 0.0, "greater than 0"),
    ("friction.coefficient", 5.0, above(5.0), "less than or equal to 5"),
    ("friction.coefficient", -5.0, below(-5.0), "greater than or equal to -5"),
    ("wear.coefficient_mm2_per_n", 0.0, -5e-324, "greater than or equal to 0"),
    ("wear.distances_m", [0.0], [-5e-324], "greater than or equal to 0"),
    ("wear.distances_m", [0.0], [], "at least 1 item"),
    ("polariscope.wavelength_nm", 200.0, below(200.0), "greater than or equal to 200"),
    ("polariscope.wavelength_nm", 3000.0, above(3000.0), "less than or equal to 3000"),
    ("polariscope.plate_wavelength_nm", 200.0, 0.587, "greater than or equal to 200"),
    ("polariscope.spectrum", spectrum(200.0), spectrum(0.4, 0.7), "greater than or equal to 200"),
    ("polariscope.lines", spectrum(600.0), spectrum(600.0, power=(1, -1)), "or equal to 0"),
    ("camera.width_px", 1, 0, "greater than or equal to 1"),
    ("camera.height_px", 100_000, 100_001, "less than or equal to 100000"),
    ("camera.pixel_mm", 5e-324, 0.0, "greater than 0"),
    ("camera.bit_depth", 1, 0, "greater than or equal to 1"),
    ("camera.bit_depth", 16, 17, "less than or equal to 16"),
    ("camera.brightness", 10.0, above(10.0), "less than or equal to 10"),
    ("camera.brightness", 5e-324, 0.0, "greater than 0"),
    ("camera.background", 1.0, above(1.0), "less than or equal to 1"),
    ("camera.background", 0.0, -5e-324, "greater than or equal to 0"),
    ("camera.vignette", below(1.0), 1.0, "less than 1"),
    ("camera.vignette", 0.0, -5e-324, "greater than or equal to 0"),
    ("camera.gamma", 0.1, below(0.1), "greater than or equal to 0.1"),
    ("camera.gamma", 10.0, above(10.0), "less than or equal to 10"),
    ("camera.blur_px", 100.0, above(100.0), "less than or equal to 100"),
    ("camera.noise_grey", 65535.0, above(65535.0), "less than or equal to 65535"),
    ("camera.noise_grey", 0.0, -5e-324, "greater than or equal to 0"),
    ("camera.full_well_electrons", 5e-324, 0.0, "greater than 0"),
    ("camera.seed", 0, -1, "greater than or equal to 0"),
    ("frames.gamma", 10.0, above(10.0), "less than or equal to 10"),
    ("frames.polygon_px", [[0, 0], [0, 9], [9, 0]], [[0, 0], [0, 9]], "at least 3 items"),
    ("frames.mask", "m", "", "at least 1 character"),
    ("frames.sliding_speed_mm_per_s", 5e-324, 0.0, "greater than 0"),
    ("frames.roi", {"height_px": 1, "width_px": 1}, {"height_px": 0, "width_px": 1}, "equal to 1"),
    ("numerics.tolerance", 0.1, above(0.1), "less than or equal to 0.1"),
    ("numerics.tolerance", 1e-10, below(1e-10), "or equal to 0.0000000001"),
    ("numerics.spacing_mm", 5e-324, 0.0, "greater than 0"),
    ("numerics.window_mm", 5e-324, 0.0, "greater than 0"),
]


@pytest.mark.parametrize(
    ("key", "allowed", "refused", "words"), BOUNDS, ids=[f"{b[0]} {b[3]}" for b in BOUNDS]
)
def test_a_value_is_taken_up_to_its_bound_and_refused_by_name_beyond(key, allowed, refused, words):
    SCENE.with_values({key: allowed})
    text = refusal(SCENE.with_values, {key: refused})
    assert key in text and "is not allowed: " in text and words in text, text
    number = refused[0] if isinstance(refused, list) and refused else refused
    assert isinstance(refused, dict | list) or repr(number) in text, text


# key; a table that is taken; one that is not; what the sentence says
TABLES = [
    ("friction.coefficient", over(0.0, 5e-324), over(1.0, 1.0), "distance_m must rise"),
    ("friction.coefficient", over(0.0, 1.0), over(1.0, 0.0), "distance_m must rise"),
    ("load.normal_n", over(0.0, 1.0, 2.0), over(0.0, 1.0, 1.0), "distance_m must rise"),
    ("wear.coefficient_mm2_per_n", over(3.0, 4.0), over(4.0, 4.0), "distance_m must rise"),
    ("polariscope.spectrum", spectrum(below(700.0)), spectrum(700.0), "wavelength_nm must rise"),
    ("polariscope.lines", spectrum(699.0), spectrum(700.0), "wavelength_nm must rise"),
    ("polariscope.spectrum", spectrum(400, power=(0, 1)), spectrum(400, power=(0, 0)), "is zero"),
]


@pytest.mark.parametrize(("key", "allowed", "refused", "words"), TABLES)
def test_equal_places_in_a_table_are_refused_with_what_they_are(key, allowed, refused, words):
    """At two values for one place a table has no value there."""
    SCENE.with_values({key: allowed})
    text = refusal(SCENE.with_values, {key: refused})
    assert f"[{key}]" in text and words in text, text
    if "rise" in words:
        places = refused.get("distance_m") or refused["wavelength_nm"]
        assert f"but is {[float(p) for p in places]}; sort it" in text, text


@pytest.mark.parametrize("mu", [0.25, -0.25])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stuck_contact_is_held_by_friction_of_either_sign_up_to_its_limit(mu, sign):
    """0.25 x 44 N = 11 N to either side."""
    text = PAPER_CONTACT + f"tangential_n = {{}}\n[friction]\ncoefficient = {mu}\n"
    assert parse_scene(text.format(11.0 * sign)).load.tangential_n == 11.0 * sign
    with pytest.raises(InputError, match=rf"tangential_n = {11.5 * sign:g} .* can hold, 11 N"):
        parse_scene(text.format(11.5 * sign))


BLOCK = 'shape = "block"\nwidth_mm = 60.0\nheight_mm = 40.0\nleft_mm = {}\n'


@pytest.mark.parametrize("left", [-60.0, 0.0])
def test_a_block_whose_side_lies_at_the_contacts_centre_is_refused(left):
    inner = {-60.0: above(-60.0), 0.0: -5e-324}[left]
    text = PAPER_CONTACT.replace("[indenter]", BLOCK + "[indenter]")
    assert parse_scene(text.format(inner)).specimen.left_mm == inner
    sentence = rf"specimen.left_mm = {left:g}, .* must lie between -60 .* and 0; correct it"
    with pytest.raises(InputError, match=sentence):
        parse_scene(text.format(left))


def test_spans_that_are_equal_bend_nothing_and_are_refused():
    beam = (
        '[specimen]\nshape = "beam"\nheight_mm = 9.0\nthickness_mm = 4.0\n'
        "fringe_value_n_per_mm = 14.6\n[load]\nnormal_n = 9.0\ninner_span_mm = 20.0\n"
    )
    outer = math.nextafter(20.0, 21.0)
    assert parse_scene(f"{beam}outer_span_mm = {outer!r}\n").load.outer_span_mm == outer
    with pytest.raises(InputError, match=r"inner_span_mm = 20 must be less than .*swapped"):
        parse_scene(f"{beam}outer_span_mm = 20.0\n")


@pytest.mark.parametrize(("allowed", "refused"), [(1e30, above(1e30)), (1e-30, 0.99e-30)])
def test_a_number_of_a_file_whose_size_is_a_slip_is_refused(tmp_path, allowed, refused):
    """Beyond 1e30 and below 1e-30, in any unit; zero is no slip."""
    path = tmp_path / "my.toml"

    def written(load):
        text = dump_scene(SCENE.with_values({"wear.coefficient_mm2_per_n": 0.0}))
        path.write_text(text.replace("normal_n = 44.0", f"normal_n = {load!r}"), "utf-8")
        return load_scene(path)

    assert written(allowed).load.normal_n == allowed
    text = refusal(written, refused)
    assert text.startswith(f"{path}: load.normal_n = {refused:g} is not allowed"), text
    assert "between 1e-30 and 1e+30; correct it" in text


def test_a_settings_file_is_read_up_to_a_megabyte_and_with_a_byte_order_mark(tmp_path):
    path, text = tmp_path / "my.toml", dump_scene(SCENE)
    path.write_text(text + "#" * (1_000_000 - len(text)), "utf-8")
    assert dump_scene(load_scene(path)) == text
    path.write_text(text + "#" * (1_000_001 - len(text)), "utf-8")
    with pytest.raises(InputError, match=r"my\.toml: larger than 1000000 bytes.* settings file"):
        load_scene(path)
    # some editors put three bytes before the first letter of what they call UTF-8
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert dump_scene(load_scene(path)) == text
