"""Hostile bending sets through the command: an exit code, one sentence with the cause, no file."""

import re

import numpy as np
import pytest
import tifffile

from commands import exit_code

from .conftest import HEIGHT, bending_load

SIZES = {"height_mm": 20.0, "inner_span_mm": 40.0, "outer_span_mm": 100.0}
PIXEL = 0.23
SMALL = {"shape": (100, 120), "pixel": PIXEL}


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Run the command on images and loads; return the exit code and the one line it said."""

    def run(images, loads, *, sizes=SIZES, pixel_mm=PIXEL, more=""):
        text = "[beam]\n" + "".join(f"{k} = {v}\n" for k, v in sizes.items())
        text += f"[camera]\npixel_mm = {pixel_mm}\n{more}"
        for i, (image, load) in enumerate(zip(images, loads, strict=True)):
            if isinstance(image, bytes):
                (tmp_path / f"b{i}.tif").write_bytes(image)
            elif image is not None:
                tifffile.imwrite(tmp_path / f"b{i}.tif", image)
            text += f'[[image]]\nfile = "b{i}.tif"\nload_n = {load}\n'
        (tmp_path / "set.toml").write_text(text, "utf-8")
        words = ["calibrate", "bending", tmp_path / "set.toml", "--out", tmp_path / "out"]
        code = exit_code(monkeypatch, *words)
        said = capsys.readouterr()
        assert said.out == ""
        assert not (tmp_path / "out").exists()
        (line,) = [v for v in said.err.splitlines() if v.startswith("isochrome: ")]
        assert "Traceback" not in said.err
        return code, line

    return run


@pytest.fixture(scope="module")
def beams(beam_frame):
    """Edge order to a small frame of the beam."""
    rng = np.random.default_rng(0)
    return {e: beam_frame(e, rng, **SMALL) for e in (1.5, 2.0, 3.0, 4.0, 4.6, 6.0)}


def loads_of(*edges):
    return [bending_load(e) for e in edges]


def metres(sizes):
    return {k: v / 1000.0 for k, v in sizes.items()}


@pytest.mark.long
@pytest.mark.parametrize(
    ("edges", "said", "cause"),
    [
        # another beam's slope is 1.5 times this one's: two images show it by their origin,
        # three by their line, and four tell which it is
        ((2.0, 4.0), (2.0, 6.0), "both show the same"),
        ((2.0, 3.0, 4.0), (2.0, 3.0, 4.6), "shows another specimen"),
        ((1.5, 2.0, 3.0, 4.0), (1.5, 2.0, 3.0, 6.0), r"b3\.tif.*same specimen"),
        ((1.5, 3.0, 2.0, 4.0), (1.5, 2.0, 3.0, 4.0), "swapped between files"),
    ],
)
def test_one_file_of_another_beam(beams, refused, edges, said, cause):
    code, line = refused([beams[e] for e in said], loads_of(*edges))
    assert code == 3 and re.search(cause, line)


@pytest.mark.parametrize(
    ("sizes", "pixel_mm", "exit_code"),
    [
        (metres(SIZES), PIXEL, 2),
        (metres(SIZES), 1e-3 * PIXEL, 3),  # it has the right number of pixels
        (SIZES, 1e-3 * PIXEL, 2),
        ({**SIZES, "height_mm": HEIGHT / 1000.0}, PIXEL, 2),
        (SIZES, 1e3 * PIXEL, 2),
    ],
    ids=["the beam", "the beam and the pixel", "the pixel", "the height", "the pixel in µm"],
)
def test_metres_given_as_millimetres(beams, refused, sizes, pixel_mm, exit_code):
    edges = (2.0, 4.0)
    images = [beams[e] for e in edges]
    code, line = refused(images, loads_of(*edges), sizes=sizes, pixel_mm=pixel_mm)
    assert code == exit_code and "in mm" in line


@pytest.mark.long
@pytest.mark.parametrize("edge", [0.0, 0.2])
def test_too_few_fringes(beam_frame, refused, edge):
    frame = beam_frame(edge, np.random.default_rng(1), **SMALL)
    code, line = refused([frame], [bending_load(0.3)])
    assert code == 3 and re.search("two fringes|at least two|at least four pixels", line)


def bent(edge, change):
    """A frame whose moment changes along the span by a factor change(t), t = -1..1, with the shear
    that a changing moment has: 2 txz = c dsx/dx (1 - eta²)."""
    rows, cols = SMALL["shape"]
    half = 0.5 * HEIGHT / SMALL["pixel"]  # px
    y, x = np.mgrid[:rows, :cols]
    eta, t, step = (y - rows / 2) / half, 2.0 * x / cols - 1.0, 1e-3
    slope = (change(t + step) - change(t - step)) / (2.0 * step) * 2.0 * half / cols
    shift = 0.15 / (0.5 * HEIGHT)
    order = edge * np.hypot(change(t) * (eta - shift), slope * (1.0 - eta**2))
    light = 12.0 + 200.0 * np.where(np.abs(eta) < 1.0, np.sin(np.pi * order) ** 2, 0.0)
    noise = np.random.default_rng(3).normal(0.0, 3.0, light.shape)
    return np.clip(np.rint(light + noise), 0, 255).astype(np.uint8)


@pytest.mark.long
@pytest.mark.parametrize(
    "change",
    [
        lambda t: 1.0 + 0.05 * t,
        lambda t: 1.0 + 0.3 * t,
        pytest.param(lambda t: np.clip((1.15 - np.abs(t)) / 0.5, 0.0, 1.0), marks=pytest.mark.long),
    ],
    ids=["unequal rollers", "one shear span", "beyond the inner rollers"],
)
def test_shear_in_the_span(refused, change):
    code, line = refused([bent(e, change) for e in (2.5, 4.0)], loads_of(2.5, 4.0))
    assert code == 3 and "pure bending" in line and "inner rollers" in line


@pytest.mark.parametrize("content", [b"", b"II*\x00 this is no image", None])
def test_files_that_are_empty_corrupt_or_missing(beams, refused, content):
    code, line = refused([beams[2.0], content], loads_of(2.0, 4.0))
    assert code == 2 and "b1.tif" in line


SETS = {  # images of the beams, the edges that the loads are of, other sizes, exit code and words
    "two loads swapped": (
        lambda b: [b[2.0], b[4.0]], (4.0, 2.0), {}, 3, r"(?=.*b0\.tif).*swapped between files"
    ),
    "the spans in reverse order": (
        lambda b: [b[2.0]], (2.0,), {"inner_span_mm": 100.0, "outer_span_mm": 40.0}, 2,
        "(?=.*inner_span_mm = 100).*swapped",
    ),
    "saturated": (
        lambda b: [b[2.0], np.clip(8 * b[4.0].astype(int), 0, 255).astype(np.uint8)], (2.0, 4.0),
        {}, 2, r"(?=.*b1\.tif).*saturated",
    ),
    "a beam along the columns": (
        lambda b: [b[e].T.copy() for e in (2.0, 4.0)], (2.0, 4.0), {}, 3, "along the rows|height"
    ),
    "images of different sizes": (
        lambda b: [b[2.0], b[4.0][:75]], (2.0, 4.0), {}, 2, "sizes"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SETS)
def test_sets_that_cannot_be_right(beams, refused, name):
    images, edges, sizes, exit_code, words = SETS[name]
    code, line = refused(images(beams), loads_of(*edges), sizes=SIZES | sizes)
    assert code == exit_code and re.search(words, line)


def test_fringes_finer_than_the_pixels(beam_frame, refused):
    frame = beam_frame(20.0, np.random.default_rng(1), **SMALL)  # 2.2 pixels a fringe
    code, line = refused([frame], loads_of(20.0))
    assert code == 3 and "b0.tif" in line and "pixel" in line


NUMBERS = {  # what is written in place of a number
    "height_mm": ("nan", "inf", "-20.0", '"20 mm"'), "outer_span_mm": ("0", "[100.0]"),
    "load_n": ("nan", "-60.0", "inf", '"60 N"'),
}  # fmt: skip


@pytest.mark.parametrize(("key", "value"), [(k, v) for k, some in NUMBERS.items() for v in some])
def test_nonsense_numbers_in_the_set(beams, refused, key, value):
    of_load = key == "load_n"
    sizes = SIZES if of_load else {**SIZES, key: value}
    code, line = refused([beams[2.0]], [value] if of_load else loads_of(2.0), sizes=sizes)
    assert code == 2
    assert key in line if of_load else f"beam.{key}" in line and "set.toml" in line
