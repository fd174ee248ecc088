"""Bad input: one line that says what to do, exit 2 or 3, nothing left behind."""

import contextlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile

from commands import exit_code
from runs.counting import contents
from scene_texts import BENDING_BEAM, camera_text, disc_text

BENDING_SET = BENDING_BEAM + "[camera]\npixel_mm = 0.05\nbit_depth = 8\n"
BENDING_SET += '[[image]]\nfile = "gone.png"\nload_n = 60.0\n'


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


def write_stack(path, frames):
    tifffile.imwrite(path, frames, photometric="minisblack")


def process(frames, scene="small.toml"):
    return ("process", frames, "--scene", scene, "--out", "out")


def simulate(scene, out="out"):
    return ("simulate", scene, "--out", out)


def fit(*keys):
    frees = [word for key in keys for word in ("--free", key)]
    return ("fit", "frames.tif", "--scene", "small.toml", *frees, "--out", "out")


def compare(one, other):
    return ("compare", one, other, "--out", "out")


def frames_of(place):
    return tifffile.imread(place / "frames.tif")


FILES = {
    "empty folder": (process("keine Bilder"), ["keine Bilder", "no image"],
                     lambda p: (p / "keine Bilder").mkdir()),
    "no such file": (process("weg.tif"), ["weg.tif", "no such file"], None),
    "unknown kind": (process("small.toml"), ["small.toml", "cannot be read"], None),
    "all black": (process("x.tif"), ["x.tif[0]", "all black", "0"],
                  lambda p: write_stack(p / "x.tif", np.full((2, 120, 160), 0, np.uint8))),
    "all white": (process("x.tif"), ["x.tif[0]", "all white", "255"],
                  lambda p: write_stack(p / "x.tif", np.full((2, 120, 160), 255, np.uint8))),
    "a blank frame after a good one": (
        process("x.tif"), ["x.tif[1]", "all black"],
        lambda p: write_stack(p / "x.tif", frames_of(p) * np.uint8([1, 0])[:, None, None]),
    ),
    "another size than the camera's": (
        process("x.tif"), ["x.tif", "100 rows x 160", "120 x 160", "height_px"],
        lambda p: write_stack(p / "x.tif", frames_of(p)[:, :100]),
    ),
    "more frames than states": (
        process("x.tif"), ["x.tif", "3 frames", "2 states", "wear.distances_m"],
        lambda p: write_stack(p / "x.tif", frames_of(p)[[0, 1, 0]]),
    ),
    "no TOML": (simulate("kaputt.toml"), ["kaputt.toml", "not valid TOML", "line 1"],
                lambda p: (p / "kaputt.toml").write_text("[specimen\nyoung", "utf-8")),
    "nearest scene": (simulate("line-contact-waer"), ["line-contact-waer", "did you mean"], None),
    "folder as scene": (simulate("Ordner"), ["Ordner", "folder"],
                        lambda p: (p / "Ordner").mkdir()),
    "frames as scene": (simulate("frames.tif"), ["frames.tif"], None),
    "out is a file": (simulate("small.toml", "Datei"), ["Datei", "is a file", "--out"],
                      lambda p: (p / "Datei").write_text("mine", "utf-8")),
    "out under a file": (simulate("small.toml", "Datei/in"), ["Datei", "cannot be written"],
                         lambda p: (p / "Datei").write_text("mine", "utf-8")),
    "unknown free key": (fit("load.normal_nn"), ["load.normal_nn", "normal_n"], None),
    "free key of an unknown part": (fit("loda.normal_n"), ["loda.normal_n", "no such key"], None),
    "nothing free": (fit(), ["nothing to fit", "--free"], None),
    "a key twice": (fit("load.normal_n", "load.normal_n"), ["load.normal_n", "twice"], None),
    "compare sizes": (compare("frames.tif", "x.tif"), ["(120, 160)", "(100, 160)"],
                      lambda p: write_stack(p / "x.tif", frames_of(p)[:, :100])),
    "compare with nothing": (compare("frames.tif", "weg"), ["weg", "no such file"], None),
    "compare scars without scars": (compare("small.toml", "small.toml"),
                                    ["small", "no [[scar]]", "file and distance_m"], None),
    "no such set": (("calibrate", "bending", "weg.toml", "--out", "out"), ["weg.toml"], None),
}  # fmt: skip
FILES |= {
    key: (fit(key), [key, "no number"], None)
    for key in ("polariscope.field", "wear.distances_m", "specimen.shape", "load.bulk_mpa")
}
FILES |= {
    key: (fit(key), [key, "cannot be fitted"], None)
    for key in ("camera.seed", "camera.vignette", "camera.brightness", "numerics.tolerance")
}
"""Arguments, words of the refusal, and what is written before: refused with 2."""


OF_PROCESSES = {
    "binary scene": (simulate("bin.toml"), ["bin.toml", "UTF-8"],
                     lambda p: (p / "bin.toml").write_bytes(bytes(range(128, 256)))),
    "load and fringe value": (
        fit("load.normal_n", "specimen.fringe_value_n_per_mm"),
        ["load.normal_n", "specimen.fringe_value_n_per_mm", "cannot both be free"], None,
    ),
    "compare counts": (compare("frames.tif", "three.tif"), ["2 frames", "3 of"],
                       lambda p: write_stack(p / "three.tif", frames_of(p)[[0, 1, 0]])),
    "set of the other specimen": (
        ("calibrate", "disc", "Satz.toml"), ["Satz.toml", "[disc]", "bending"],
        lambda p: (p / "Satz.toml").write_text(BENDING_SET, "utf-8"),
    ),
}  # fmt: skip
OF_PROCESSES |= {
    f"truncated to {share}": (
        process("cut.tif"), ["cut.tif", "frame", "truncated"],
        lambda p, share=share: (p / "cut.tif").write_bytes(
            (whole := (p / "frames.tif").read_bytes())[: int(share * len(whole))]
        ),
    )
    for share in (0.1, 0.5, 0.9)
}  # fmt: skip


"""The same, in a process of their own too."""


@pytest.mark.parametrize(
    "name", [*FILES, *(pytest.param(name, marks=pytest.mark.process_too) for name in OF_PROCESSES)]
)
def test_what_cannot_be_read_written_or_done_is_refused(place, refuses, name):
    arguments, words, write = (FILES | OF_PROCESSES)[name]
    if write is not None:
        write(place)
    refuses(2, words, *arguments)


SLIP = [("25.0", "the widest allowed", "not in µm"), ("2.5e-5", "allowed at least", "not in m")]
ROI = "{ top_px = 0, left_px = 100, height_px = 120, width_px = 160 }"
CHANGES = [
    ("poisson = 0.4\n", "", simulate, 2, ["specimen.poisson", "missing"]),
    ("normal_n = 44.0\n", "", simulate, 2, ["load.normal_n", "missing"]),
    ("poisson = 0.4", "poison = 0.4", simulate, 2, ["specimen.poison", "did you mean 'poisson'"]),
    ("[camera]", "[camara]", simulate, 2, ["camara"]),
    ("\n[numerics]\nwindow_mm = 0.5\n", None, simulate, 3, ["numerics.window_mm", "0.5"]),
    ("normal_n = 44.0", "normal_n = 4e6", simulate, 3, ["load.normal_n", "half-width"]),
    ("pixel_mm = 0.025", "pixel_mm = 0.004", simulate, 3, ["wide", "picture"]),
    *(("pixel_mm = 0.025", f"pixel_mm = {value}", simulate, 2,
       [f"camera.pixel_mm = {float(value):g} ", *words]) for value, *words in SLIP),
    *(("bit_depth = 8", f"bit_depth = {bits}", process, 2,
       ["frames.tif", "camera.bit_depth", str(bits), word]) for bits, word in ((12, "uint8"),
                                                                               (4, "15"))),
    ('\n[frames]\nno_load_dark = "dunkel.tif"\n', None, process, 2, ["dunkel.tif", "no such file"]),
    (f"\n[frames]\nroi = {ROI}\n", None, process, 2,
     ["frames.tif", "roi", "100 to 260", "frames.roi"]),
    ("\n[[polariscope.step]]\npolariser_deg = 90.0\nanalyser_deg = 0.0\n", None, process, 2,
     ["polariscope.step"]),
]  # fmt: skip
"""What is changed in the scene, or added (None), the command, exit code and words."""


@pytest.mark.parametrize(("old", "new", "command", "code", "words"), CHANGES)
def test_a_scene_with_a_change_is_refused(refuses, scene_with, old, new, command, code, words):
    scene = scene_with(old, new)
    of_scene = command is simulate
    refuses(
        code, [*(["wrong scene"] if of_scene else []), *words],
        *(simulate(scene) if of_scene else process("frames.tif", scene)),
    )  # fmt: skip


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
    monkeypatch.chdir(place)
    with contextlib.suppress(OSError), open("/dev/full", "w") as full:  # its end is refused too
        monkeypatch.setattr(sys, "stdout", full)
        code = exit_code(monkeypatch, "check", "gone.tif", "--scene", "small.toml")
    monkeypatch.undo()
    assert code == 2
    assert "cannot be read or written (No space left on device)" in capfd.readouterr().err


@pytest.mark.long
def test_in_another_process_a_refusal_is_one_line_too(place, isochrome):
    done = isochrome(*simulate("weg.toml"))
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert done.err.startswith("isochrome: weg.toml: ") and not (place / "out").exists()


@pytest.fixture
def of_no_scale(place):
    """The frames without the scale that the simulation names in their file."""
    write_stack(place / "bare.tif", tifffile.imread(place / "frames.tif"))
    return "bare.tif"


@pytest.mark.parametrize("slip", SLIP, ids=["um", "m"])
@pytest.mark.parametrize(
    "command",
    [
        ("process",), ("process", "--track"), ("fit", "--free", "load.normal_n"),
        ("fit", "--track", "--per-frame", "load.normal_n"),
    ],
    ids=lambda words: " ".join(words[:2]),
)  # fmt: skip
def test_a_pixel_of_another_unit_is_refused_before_any_work(
    refuses, scene_with, of_no_scale, command, slip
):
    """`process` and `fit` with micrometres did not end: a pixel was divided into 5700 nodes."""
    value, *words = slip
    scene = scene_with("pixel_mm = 0.025", f"pixel_mm = {value}")
    words = [f"camera.pixel_mm = {float(value):g} ", *words]
    refuses(2, words, *command, of_no_scale, "--scene", scene, "--out", "out")


DISC = disc_text(560.0, fringe_value=14.6, diameter_mm=50.0)
DISC += camera_text(160, 120, "{pixel}", bit_depth=8)


def test_a_disc_smaller_than_a_pixel_is_refused(place, refuses, of_no_scale):
    (place / "disc.toml").write_text(DISC.format(pixel=500.0), "utf-8")
    words = ["camera.pixel_mm = 500 is wider than the disc, 50 mm", "not in µm"]
    refuses(2, words, *process(of_no_scale, "disc.toml"))
    refuses(2, words, *simulate("disc.toml"))
    (place / "disc.toml").write_text(DISC.format(pixel=0.0005), "utf-8")
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


@pytest.mark.process_too
def test_fringes_finer_than_two_pixels(refuses, scene_with):
    scene = scene_with("fringe_value_n_per_mm = 14.6", "fringe_value_n_per_mm = 0.3")
    refuses(3, ["wrong scene", "finer than two pixels", "pixel_mm"], *simulate(scene))


def test_pixels_as_wide_as_the_contact_in_a_large_picture(place, refuses, scene_with):
    scene = scene_with("left_mm = -2.0", "left_mm = -24.0", "wide.toml")
    text = (place / scene).read_text("utf-8").replace("pixel_mm = 0.025", "pixel_mm = 0.3")
    (place / scene).write_text(text, "utf-8")
    refuses(3, ["finer than two pixels", "pixel_mm = 0.3"], *simulate(scene))


@pytest.mark.process_too
def test_a_refusal_leaves_the_results_of_the_run_before(
    place, quick_isochrome, refuses, scene_with
):
    assert quick_isochrome(*simulate("small.toml")).code == 0
    scene = scene_with("fringe_value_n_per_mm = 14.6", "fringe_value_n_per_mm = 0.3")
    refuses(3, ["finer"], *simulate(scene))
    assert (place / "out" / "history.csv").is_file()


def test_compare_of_scars_with_a_trace_that_is_none(place, refuses, scene_with):
    scene = scene_with('\n[[scar]]\nfile = "Spur.csv"\ndistance_m = 77.0\n')
    (place / "Spur.csv").write_text("x_mm,z_um\n0,high\n", "utf-8")
    compared = compare(scene, "small.toml")
    refuses(2, ["Spur.csv"], *compared)
    (place / "Spur.csv").unlink()
    refuses(2, ["Spur.csv", "check its name"], *compared)


@pytest.mark.parametrize(
    "arguments",
    [
        simulate("weg.toml"), process("weg.tif"), ("compare", "weg", "frames.tif"),
        ("calibrate", "bending", "weg.toml"), ("calibrate", "disc", "weg.toml"),
        fit("load.normal_nn"), ("check", "frames.tif", "--scene", "weg.toml"),
    ],
    ids=lambda a: " ".join(a[:2]),
)  # fmt: skip
@pytest.mark.process_too
def test_a_refusal_with_json_is_one_object_and_one_line(quick_isochrome, arguments):
    done = quick_isochrome(*arguments, "--json")
    found = done.json()
    assert set(found) == {"error", "exit_code", "message"} and found["exit_code"] == done.code == 2
    assert found["message"]["code"] and found["message"]["text"] == found["error"]
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
def test_check_finds_a_truncated_tiff_and_its_json_is_no_refusals(place, quick_isochrome):
    whole = (place / "frames.tif").read_bytes()
    (place / "cut.tif").write_bytes(whole[: len(whole) // 2])
    done = quick_isochrome("check", "cut.tif", "--scene", "small.toml")
    assert (done.code, done.err) == (2, "")
    assert done.out.startswith("error: cut.tif") and "truncated" in done.out
    # A result never has the key 'error': a script may tell the two apart by it.
    done = quick_isochrome("check", "frames.tif", "--scene", "small.toml", "--json")
    assert done.code == 0 and "error" not in done.json()
    assert json.dumps(done.json(), allow_nan=False)


USAGE = {
    ("simulat", "small.toml"): "Did you mean 'simulate'?; see 'isochrome --help'",
    ("process", "frames.tif"): "process: Missing option '--scene'; see 'isochrome process --help'",
    ("calibrate", "beam", "x.toml"): "calibrate: No such command 'beam'; see",
    ("simulate", "small.toml", "--ot", "x"): "simulate: No such option: --ot",
    (
        "process", "frames.tif", "--scene", "small.toml", "--every", "two",
    ): "Invalid value for '--every'",
    ("--verson",): "No such option: --verson",
    ("guide", "colours"): "the guide has no such page; did you mean 'colour'?",
}  # fmt: skip


@pytest.mark.process_too
@pytest.mark.parametrize("arguments", USAGE, ids=" ".join)
def test_a_usage_error_is_one_line_that_names_the_help(quick_isochrome, arguments):
    """They were a box of six lines."""
    done = quick_isochrome(*arguments)
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("isochrome: ") and done.err.count("\n") == 1
    assert USAGE[arguments] in done.err and "Traceback" not in done.err
    done = quick_isochrome(*arguments, "--json")
    assert done.json()["exit_code"] == done.code == 2
    if arguments != ("--verson",):  # --json stands before no command
        assert USAGE[arguments] in done.json()["error"]
