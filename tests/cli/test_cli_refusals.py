"""Bad input: one line that says what to do, exit 2 or 3, nothing left behind."""

import contextlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile

from runs.counting import contents
from scene_texts import BENDING_BEAM

BENDING_SET = (
    BENDING_BEAM
    + """
[camera]
pixel_mm = 0.05
bit_depth = 8

[[image]]
file = "gone.png"
load_n = 60.0
"""
)


@pytest.fixture
def refuses(place, quick_isochrome):
    """Run a command, see that it refuses in one line with all words, and leaves all as it was."""

    def run(code, words, *arguments):
        before = contents(place)
        done = quick_isochrome(*arguments)
        assert done.code == code, done.err
        assert done.out == ""
        assert done.err.startswith("isochrome: ") and done.err.count("\n") == 1, done.err
        assert "Traceback" not in done.err
        for word in words:
            assert word in done.err, f"{word!r} is not said: {done.err}"
        assert contents(place) == before

    return run


@pytest.fixture
def scene_with(place):
    """Write the small scene with some text replaced, or added at the end; returns its name."""

    def write(old, new=None, name="wrong scene.toml"):
        text = (place / "small.toml").read_text("utf-8")
        assert new is None or text.count(old) == 1
        (place / name).write_text(text + old if new is None else text.replace(old, new), "utf-8")
        return name

    return write


def write_stack(path, frames):
    tifffile.imwrite(path, frames, photometric="minisblack")


def process(frames, scene="small.toml"):
    return ("process", frames, "--scene", scene, "--out", "out")


def simulate(scene, out="out"):
    return ("simulate", scene, "--out", out)


@pytest.mark.process_too
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_truncated_tiff(place, refuses, share):
    whole = (place / "frames.tif").read_bytes()
    (place / "cut.tif").write_bytes(whole[: int(share * len(whole))])
    refuses(2, ["cut.tif", "frame", "truncated"], *process("cut.tif"))


def test_empty_tiff(place, refuses):
    (place / "nothing.tif").write_bytes(b"")
    refuses(2, ["nothing.tif"], *process("nothing.tif"))


def test_empty_folder(place, refuses):
    (place / "keine Bilder").mkdir()
    refuses(2, ["keine Bilder", "no image"], *process("keine Bilder"))


def test_text_file_named_png(place, refuses):
    (place / "Notiz.png").write_text("not an image\n", "utf-8")
    refuses(2, ["Notiz.png", "not an image"], *process("Notiz.png"))


def test_frames_that_do_not_exist(refuses):
    refuses(2, ["weg.tif", "no such file"], *process("weg.tif"))


@pytest.mark.process_too
def test_a_name_of_two_lines_is_refused_in_one(refuses):
    refuses(2, ["no such file"], *process("two\nlines.tif"))


@pytest.mark.process_too
def test_frames_that_were_left_out_are_counted_and_end_with_2(place, quick_isochrome):
    """The others are there: they are results, and that some are not is no success."""
    (place / "plain.toml").write_text("[specimen]\n", "utf-8")
    col = np.arange(40) + np.zeros((30, 1))
    frames = np.stack([120 - 90 * np.cos(0.4 * col), 0 * col]).astype(np.uint8)
    write_stack(place / "two.tif", frames)
    done = quick_isochrome(*process("two.tif", "plain.toml"), "--keep-going")
    assert done.code == 2
    said = done.err.splitlines()[-1]
    assert said.startswith("isochrome: two.tif: 1 of 2 frames could not be processed")
    assert (place / "out" / "frames.csv").is_file()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device here is always full")
def test_an_output_that_is_full_ends_with_2(place, monkeypatch, capfd):
    from isochrome.cli import main

    monkeypatch.chdir(place)
    monkeypatch.setattr(sys, "argv", ["isochrome", "check", "gone.tif", "--scene", "small.toml"])
    with contextlib.suppress(OSError), open("/dev/full", "w") as full:  # its end is refused too
        monkeypatch.setattr(sys, "stdout", full)
        with pytest.raises(SystemExit) as end:
            main()
    monkeypatch.undo()
    assert end.value.code == 2
    assert "cannot be read or written (No space left on device)" in capfd.readouterr().err


def test_frames_of_an_unknown_kind(refuses):
    refuses(2, ["small.toml", "cannot be read"], *process("small.toml"))


@pytest.mark.parametrize(("value", "words"), [(0, "all black"), (255, "all white")])
def test_all_black_and_all_white_frames(place, refuses, value, words):
    write_stack(place / "flat.tif", np.full((2, 120, 160), value, np.uint8))
    refuses(2, ["flat.tif[0]", words, str(value)], *process("flat.tif"))


@pytest.mark.process_too
def test_nan_frames(place, refuses, scene_with):
    scene = scene_with("bit_depth = 8\n", "")
    write_stack(place / "nan.tif", np.full((2, 120, 160), np.nan, np.float32))
    refuses(2, ["nan.tif[0]", "NaN"], *process("nan.tif", scene))


def test_a_blank_frame_after_a_good_one_leaves_nothing_of_the_good_one(place, refuses):
    frames = tifffile.imread(place / "frames.tif")
    frames[1] = 0
    write_stack(place / "half.tif", frames)
    refuses(2, ["half.tif[1]", "all black"], *process("half.tif"))


def test_frames_of_another_size_than_the_camera(place, refuses):
    write_stack(place / "low.tif", tifffile.imread(place / "frames.tif")[:, :100])
    refuses(2, ["low.tif", "100 rows x 160", "120 x 160", "height_px"], *process("low.tif"))


def test_a_count_of_frames_that_is_not_that_of_the_states(place, refuses):
    frames = tifffile.imread(place / "frames.tif")
    write_stack(place / "three.tif", np.concatenate((frames, frames[:1])))
    refuses(2, ["three.tif", "3 frames", "2 states", "wear.distances_m"], *process("three.tif"))


def test_images_of_two_sizes_in_one_folder(place, refuses):
    from PIL import Image

    (place / "folder").mkdir()
    for i, rows in enumerate((120, 100)):
        image = tifffile.imread(place / "frames.tif")[i, :rows]
        Image.fromarray(image).save(place / "folder" / f"{i}.png")
    refuses(2, ["1.png", "100 x 160", "120 x 160"], *process("folder"))


@pytest.mark.parametrize(("bits", "word"), [(12, "uint8"), (4, "15")])
def test_wrong_bit_depth(refuses, scene_with, bits, word):
    scene = scene_with("bit_depth = 8", f"bit_depth = {bits}")
    refuses(2, ["frames.tif", "camera.bit_depth", str(bits), word], *process("frames.tif", scene))


def test_no_load_file_that_is_missing(refuses, scene_with):
    scene = scene_with('\n[frames]\nno_load_dark = "dunkel.tif"\n')
    refuses(2, ["dunkel.tif", "no such file"], *process("frames.tif", scene))


def test_no_load_file_of_another_size(place, refuses, scene_with):
    tifffile.imwrite(place / "dark.tif", np.zeros((100, 160), np.uint8))
    scene = scene_with('\n[frames]\nno_load_dark = "dark.tif"\n')
    words = ["dark.tif", "frames.no_load_dark", "(100, 160)", "(120, 160)"]
    refuses(2, words, *process("frames.tif", scene))


def test_roi_outside_the_frame(refuses, scene_with):
    roi = "{ top_px = 0, left_px = 100, height_px = 120, width_px = 160 }"
    scene = scene_with(f"\n[frames]\nroi = {roi}\n")
    refuses(2, ["frames.tif", "roi", "100 to 260", "frames.roi"], *process("frames.tif", scene))


def test_a_phase_stepped_scene_is_not_processed(refuses, scene_with):
    step = "\n[[polariscope.step]]\npolariser_deg = 90.0\nanalyser_deg = 0.0\n"
    refuses(2, ["polariscope.step"], *process("frames.tif", scene_with(step)))


def test_in_another_process_a_refusal_is_one_line_too(place, isochrome):
    done = isochrome(*simulate("weg.toml"))
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert done.err.startswith("isochrome: weg.toml: ") and not (place / "out").exists()


@pytest.fixture
def of_no_scale(place):
    """The frames without the scale that the simulation names in their file."""
    write_stack(place / "bare.tif", tifffile.imread(place / "frames.tif"))
    return "bare.tif"


SLIP = [("25.0", "the widest allowed", "not in µm"), ("2.5e-5", "allowed at least", "not in m")]


@pytest.mark.parametrize("slip", SLIP, ids=["um", "m"])
@pytest.mark.parametrize(
    "command",
    [
        ("process",),
        ("process", "--track"),
        ("fit", "--free", "load.normal_n"),
        ("fit", "--track", "--per-frame", "load.normal_n"),
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_a_pixel_of_another_unit_is_refused_before_any_work(
    refuses, scene_with, of_no_scale, command, slip
):
    """`process` and `fit` with micrometres did not end: a pixel was divided into 5700 nodes."""
    value, *words = slip
    scene = scene_with("pixel_mm = 0.025", f"pixel_mm = {value}")
    words = [f"camera.pixel_mm = {float(value):g} ", *words]
    refuses(2, words, *command, of_no_scale, "--scene", scene, "--out", "out")


@pytest.mark.parametrize("slip", SLIP, ids=["um", "m"])
def test_a_simulation_refuses_a_pixel_of_another_unit(refuses, scene_with, slip):
    value, *words = slip
    scene = scene_with("pixel_mm = 0.025", f"pixel_mm = {value}")
    refuses(2, [f"camera.pixel_mm = {float(value):g} ", *words], *simulate(scene))


DISC = """
[specimen]
shape = "disc"
diameter_mm = 50.0
thickness_mm = 6.0
fringe_value_n_per_mm = 14.6
[load]
normal_n = 560.0
[camera]
width_px = 160
height_px = 120
bit_depth = 8
pixel_mm = """


def test_a_disc_smaller_than_a_pixel_is_refused(place, refuses, of_no_scale):
    (place / "disc.toml").write_text(f"{DISC}500.0\n", "utf-8")
    words = ["camera.pixel_mm = 500 is wider than the disc, 50 mm", "not in µm"]
    refuses(2, words, *process(of_no_scale, "disc.toml"))
    refuses(2, words, *simulate("disc.toml"))
    (place / "disc.toml").write_text(f"{DISC}0.0005\n", "utf-8")
    refuses(2, ["camera.pixel_mm = 0.0005", "not in m"], *process(of_no_scale, "disc.toml"))


@pytest.mark.process_too
@pytest.mark.parametrize("slip", SLIP, ids=["um", "m"])
def test_the_check_names_a_pixel_of_another_unit(quick_isochrome, scene_with, of_no_scale, slip):
    value, *words = slip
    scene = scene_with("pixel_mm = 0.025", f"pixel_mm = {value}")
    done = quick_isochrome("check", of_no_scale, "--scene", scene)
    assert done.code == 2 and done.err == ""
    said = done.out.splitlines()[0]
    assert said.startswith("error: ") and f"camera.pixel_mm = {float(value):g} " in said
    assert all(word in said for word in words)


@pytest.mark.parametrize("command", ["simulate", "process", "check", "fit"])
def test_negative_modulus_in_every_command(refuses, scene_with, command):
    scene = scene_with("young_gpa = 2.1", "young_gpa = -2.1")
    words = [scene, "specimen.young_gpa", "-2.1", "greater than 0"]
    if command == "simulate":
        refuses(2, words, *simulate(scene))
    else:
        refuses(2, words, command, "frames.tif", "--scene", scene)


def test_missing_key(refuses, scene_with):
    scene = scene_with("poisson = 0.4\n", "")
    refuses(2, [scene, "specimen.poisson", "missing"], *simulate(scene))


def test_missing_key_inside_a_part(refuses, scene_with):
    scene = scene_with("normal_n = 44.0\n", "")
    refuses(2, [scene, "load.normal_n", "missing"], *simulate(scene))


def test_unknown_key_names_the_nearest(refuses, scene_with):
    scene = scene_with("poisson = 0.4", "poison = 0.4")
    refuses(2, [scene, "specimen.poison", "did you mean 'poisson'"], *simulate(scene))


def test_unknown_table_names_the_nearest(refuses, scene_with):
    refuses(2, ["camara"], *simulate(scene_with("[camera]", "[camara]")))


def test_scene_that_is_not_toml(place, refuses):
    (place / "kaputt.toml").write_text("[specimen\nyoung", "utf-8")
    refuses(2, ["kaputt.toml", "not valid TOML", "line 1"], *simulate("kaputt.toml"))


def test_scene_that_does_not_exist_names_the_nearest(refuses):
    refuses(2, ["line-contact-waer", "did you mean"], *simulate("line-contact-waer"))


def test_scene_that_is_a_directory(place, refuses):
    (place / "Ordner").mkdir()
    refuses(2, ["Ordner", "folder"], *simulate("Ordner"))


@pytest.mark.process_too
def test_scene_that_is_binary(place, refuses):
    (place / "bin.toml").write_bytes(bytes(range(128, 256)))
    refuses(2, ["bin.toml", "UTF-8"], *simulate("bin.toml"))


def test_frames_given_as_the_scene(refuses):
    refuses(2, ["frames.tif"], *simulate("frames.tif"))


def test_contact_wider_than_its_grid(refuses, scene_with):
    scene = scene_with("\n[numerics]\nwindow_mm = 0.5\n")
    refuses(3, ["wrong scene", "numerics.window_mm", "0.5"], *simulate(scene))


def test_contact_wider_than_the_half_plane_holds(refuses, scene_with):
    scene = scene_with("normal_n = 44.0", "normal_n = 4e6")
    refuses(3, ["wrong scene", "load.normal_n", "half-width"], *simulate(scene))


def test_contact_wider_than_the_picture(refuses, scene_with):
    scene = scene_with("pixel_mm = 0.025", "pixel_mm = 0.004")
    refuses(3, ["wrong scene", "wide", "picture"], *simulate(scene))


@pytest.mark.process_too
def test_fringes_finer_than_two_pixels(refuses, scene_with):
    scene = scene_with("fringe_value_n_per_mm = 14.6", "fringe_value_n_per_mm = 0.3")
    refuses(3, ["wrong scene", "finer than two pixels", "pixel_mm"], *simulate(scene))


def test_pixels_as_wide_as_the_contact_in_a_large_picture(place, refuses, scene_with):
    scene = scene_with("left_mm = -2.0", "left_mm = -24.0", "wide.toml")
    text = (place / scene).read_text("utf-8").replace("pixel_mm = 0.025", "pixel_mm = 0.3")
    (place / scene).write_text(text, "utf-8")
    refuses(3, ["finer than two pixels", "pixel_mm = 0.3"], *simulate(scene))


def test_out_is_an_existing_file(place, refuses):
    (place / "Datei").write_text("mine", "utf-8")
    refuses(2, ["Datei", "is a file", "--out"], *simulate("small.toml", "Datei"))


def test_out_cannot_be_made_under_a_file(place, refuses):
    (place / "Datei").write_text("mine", "utf-8")
    refuses(2, ["Datei", "cannot be written"], *simulate("small.toml", "Datei/in"))


@pytest.mark.process_too
def test_a_refusal_leaves_the_results_of_the_run_before(
    place, quick_isochrome, refuses, scene_with
):
    assert quick_isochrome(*simulate("small.toml")).code == 0
    scene = scene_with("fringe_value_n_per_mm = 14.6", "fringe_value_n_per_mm = 0.3")
    refuses(3, ["finer"], *simulate(scene))
    assert (place / "out" / "history.csv").is_file()


def fit(*keys):
    frees = [word for key in keys for word in ("--free", key)]
    return ("fit", "frames.tif", "--scene", "small.toml", *frees, "--out", "out")


def test_a_free_key_that_is_unknown(refuses):
    refuses(2, ["load.normal_nn", "normal_n"], *fit("load.normal_nn"))


def test_a_free_key_of_an_unknown_part(refuses):
    refuses(2, ["loda.normal_n", "no such key"], *fit("loda.normal_n"))


@pytest.mark.parametrize(
    "key", ["polariscope.field", "wear.distances_m", "specimen.shape", "load.bulk_mpa"]
)
def test_a_free_key_that_is_no_number(refuses, key):
    refuses(2, [key, "no number"], *fit(key))


@pytest.mark.parametrize(
    "key",
    ["camera.seed", "camera.vignette", "camera.brightness", "numerics.tolerance"],
)
def test_a_free_key_that_the_fit_cannot_follow(refuses, key):
    refuses(2, [key, "cannot be fitted"], *fit(key))


@pytest.mark.process_too
def test_load_and_fringe_value_both_free(refuses):
    words = ["load.normal_n", "specimen.fringe_value_n_per_mm", "cannot both be free"]
    refuses(2, words, *fit("load.normal_n", "specimen.fringe_value_n_per_mm"))


def test_nothing_free(refuses):
    refuses(2, ["nothing to fit", "--free"], *fit())


def test_a_key_named_twice(refuses):
    refuses(2, ["load.normal_n", "twice"], *fit("load.normal_n", "load.normal_n"))


def test_compare_of_different_sizes(place, refuses):
    write_stack(place / "low.tif", tifffile.imread(place / "frames.tif")[:, :100])
    refuses(2, ["(120, 160)", "(100, 160)"], "compare", "frames.tif", "low.tif", "--out", "out")


@pytest.mark.process_too
def test_compare_of_different_counts(place, refuses):
    frames = tifffile.imread(place / "frames.tif")
    write_stack(place / "three.tif", np.concatenate((frames, frames[:1])))
    refuses(2, ["2 frames", "3 of"], "compare", "frames.tif", "three.tif", "--out", "out")


def test_compare_with_nothing(refuses):
    refuses(2, ["weg", "no such file"], "compare", "frames.tif", "weg", "--out", "out")


def test_compare_of_scars_without_scars(refuses):
    words = ["small", "no [[scar]]", "file and distance_m"]
    refuses(2, words, "compare", "small.toml", "small.toml", "--out", "out")


def test_compare_of_scars_with_a_trace_that_is_none(place, refuses):
    text = (place / "small.toml").read_text("utf-8")
    scar = '\n[[scar]]\nfile = "Spur.csv"\ndistance_m = 77.0\n'
    (place / "Narben.toml").write_text(text + scar, "utf-8")
    (place / "Spur.csv").write_text("x_mm,z_um\n0,high\n", "utf-8")
    compared = ("compare", "Narben.toml", "small.toml", "--out", "out")
    refuses(2, ["Spur.csv"], *compared)
    (place / "Spur.csv").unlink()
    refuses(2, ["Spur.csv", "check its name"], *compared)


def test_friction_from_a_file_that_falls(place, refuses):
    text = (place / "small.toml").read_text("utf-8")
    falling = text.replace("coefficient = 0.25", 'file = "Reibung.csv"')
    (place / "Reibung.toml").write_text(falling, "utf-8")
    (place / "Reibung.csv").write_text("distance_m;coefficient\n5;0,2\n3;0,2\n", "utf-8")
    words = ["Reibung.toml", "Reibung.csv", "line 3", "distance_m = 3", "sort it"]
    refuses(2, words, "simulate", "Reibung.toml", "--out", "out")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("inner_span_mm = 40.0", "inner_span_mm = 140.0", ["inner_span_mm = 140", "swapped"]),
        ("load_n = 60.0", "load_n = -60.0", ["load_n", "-60", "0"]),
        ("load_n = 60.0", "load_n = 0.0", ["load_n"]),
        ("height_mm", "heigth_mm", ["heigth_mm", "did you mean 'height_mm'"]),
        ("pixel_mm = 0.05\n", "", ["camera.pixel_mm", "missing"]),
        ('file = "gone.png"\n', "", ["file", "missing"]),
        ("load_n = 60.0", "load_n = 60.0", ["gone.png", "no such file"]),
    ],
)
def test_calibration_set_that_is_wrong(place, refuses, old, new, words):
    (place / "Satz.toml").write_text(BENDING_SET.replace(old, new), "utf-8")
    refuses(2, words, "calibrate", "bending", "Satz.toml", "--out", "out")


@pytest.mark.process_too
def test_calibration_set_of_the_other_specimen(place, refuses):
    (place / "Satz.toml").write_text(BENDING_SET, "utf-8")
    refuses(2, ["Satz.toml", "[disc]", "bending"], "calibrate", "disc", "Satz.toml")


def test_calibration_set_that_does_not_exist(refuses):
    refuses(2, ["weg.toml"], "calibrate", "bending", "weg.toml", "--out", "out")


@pytest.mark.parametrize(
    "arguments",
    [
        simulate("weg.toml"),
        process("weg.tif"),
        ("compare", "weg", "frames.tif"),
        ("calibrate", "bending", "weg.toml"),
        ("calibrate", "disc", "weg.toml"),
        fit("load.normal_nn"),
        ("check", "frames.tif", "--scene", "weg.toml"),
    ],
    ids=lambda a: " ".join(a[:2]),
)
@pytest.mark.process_too
def test_a_refusal_with_json_is_one_object_and_one_line(quick_isochrome, arguments):
    done = quick_isochrome(*arguments, "--json")
    found = done.json()
    assert set(found) == {"error", "exit_code"} and found["exit_code"] == done.code == 2
    assert done.err == f"isochrome: {found['error']}\n"


@pytest.mark.process_too
@pytest.mark.parametrize(
    ("value", "words"), [(0, "all black"), (255, "all white"), (np.nan, "no number")]
)
def test_check_finds_blank_frames_and_ends_with_2(place, quick_isochrome, value, words):
    dtype = np.float32 if np.isnan(value) else np.uint8
    write_stack(place / "flat.tif", np.full((2, 120, 160), value, dtype))
    done = quick_isochrome("check", "flat.tif", "--scene", "small.toml", "--json")
    found = done.json()
    assert (done.code, found["ok"], found["frames"], done.err) == (2, False, 2, "")
    errors = [f["text"] for f in found["findings"] if f["level"] == "error"]
    assert len(errors) == 1 and errors[0].startswith("frames 0-1:") and words in errors[0]


@pytest.mark.process_too
def test_check_finds_a_truncated_tiff_and_ends_with_2(place, quick_isochrome):
    whole = (place / "frames.tif").read_bytes()
    (place / "cut.tif").write_bytes(whole[: len(whole) // 2])
    done = quick_isochrome("check", "cut.tif", "--scene", "small.toml")
    assert (done.code, done.err) == (2, "")
    assert done.out.startswith("error: cut.tif") and "truncated" in done.out


USAGE = {
    ("simulat", "small.toml"): "Did you mean 'simulate'?; see 'isochrome --help'",
    ("process", "frames.tif"): "process: Missing option '--scene'; see 'isochrome process --help'",
    ("calibrate", "beam", "x.toml"): "calibrate: No such command 'beam'; see",
    ("simulate", "small.toml", "--ot", "x"): "simulate: No such option: --ot",
    (
        "process",
        "frames.tif",
        "--scene",
        "small.toml",
        "--every",
        "two",
    ): "Invalid value for '--every'",
    ("--verson",): "No such option: --verson",
    ("guide", "colours"): "the guide has no such page; did you mean 'colour'?",
}


@pytest.mark.process_too
@pytest.mark.parametrize("arguments", USAGE, ids=" ".join)
def test_a_usage_error_is_one_line_that_names_the_help(quick_isochrome, arguments):
    """They were a box of six lines."""
    done = quick_isochrome(*arguments)
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("isochrome: ") and done.err.count("\n") == 1
    assert USAGE[arguments] in done.err and "Traceback" not in done.err
    done = quick_isochrome(*arguments, "--json")
    assert set(done.json()) == {"error", "exit_code"} and done.json()["exit_code"] == done.code == 2
    if arguments != ("--verson",):  # --json stands before no command
        assert USAGE[arguments] in done.json()["error"]


@pytest.mark.process_too
def test_the_two_json_shapes_cannot_be_mixed_up(quick_isochrome):
    # A result never has the key 'error': a script may tell the two apart by it.
    done = quick_isochrome("check", "frames.tif", "--scene", "small.toml", "--json")
    assert done.code == 0 and "error" not in done.json()
    assert json.dumps(done.json(), allow_nan=False)
