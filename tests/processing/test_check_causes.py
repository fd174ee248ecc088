"""`check` asks the first frame that shows fringes, and says what `process` will say of it."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from fitting import sliding_bench
from isochrome import check, process
from isochrome.benchmarks import load_benchmarks
from isochrome.cli import app
from isochrome.errors import PhysicsError
from isochrome.output import write_tiff
from isochrome.samples import samples_path
from isochrome.scene import dump_scene, load_scene

OUTSIDE = load_benchmarks("outside_camera")
ROWS, COLS = 124, 165


def bench():
    """A static contact of 4 mm x 3 mm in view."""
    return sliding_bench.bench(ROWS, COLS).model_copy(update={"friction": None})


def dark(count):
    """Frames of a camera that sees nothing but its noise."""
    return np.random.default_rng(0).integers(50, 60, (count, ROWS, COLS)).astype(np.uint8)


def saved(folder, *frames):
    write_tiff(folder / "frames.tif", np.stack(frames), pixel_mm=4.0 / COLS)
    return folder / "frames.tif"


def asked(found):
    return [f for f in found.findings if "the frame shows" in f.text or "fringes are not" in f.text]


@pytest.mark.long
def test_the_first_frame_with_fringes_is_asked_and_the_key_is_named(tmp_path):
    image = OUTSIDE.frame(bench(), OUTSIDE.Defects(distortion=0.005), 1)
    (finding,) = asked(check(saved(tmp_path, *dark(1), image), bench()))
    assert finding.level == "warning" and finding.frame == 1
    value = float(re.search(r"camera\.distortion = (\S+) ", finding.text).group(1))
    assert value == pytest.approx(0.005, abs=1.75e-3)  # five of its uncertainties, of so few pixels


def test_what_its_scene_says_is_asked_for_nothing_and_the_command_ends_well(tmp_path):
    path = saved(tmp_path, OUTSIDE.frame(bench(), OUTSIDE.Defects(), 1))
    (tmp_path / "scene.toml").write_text(dump_scene(bench()), "utf-8")
    assert not asked(check(path, bench()))
    run = CliRunner().invoke(app, ["check", str(path), "--scene", str(tmp_path / "scene.toml")])
    assert run.exit_code == 0 and "no error found" in run.output


@pytest.mark.long
def test_frames_without_the_scenes_fringes_are_said_to_have_none(tmp_path):
    (finding,) = asked(check(saved(tmp_path, *dark(2)), bench()))
    assert finding.level == "error" and finding.text.startswith("frames 0-1: ")
    (finding,) = asked(check(saved(tmp_path, *dark(9)), bench()))  # others may show them
    assert finding.level == "warning" and finding.text.startswith("frames 0-2, 4: ")


def strange():
    """A frame of rings about a place of its own: the fringes of no contact."""
    row, col = np.mgrid[:ROWS, :COLS] / ROWS
    order = 2.5 * np.exp(-((row - 0.56) ** 2 + (col - 0.4) ** 2) / 0.12)
    light = 40.0 + 170.0 * np.sin(np.pi * order) ** 2
    noise = np.random.default_rng(3).normal(size=light.shape)
    return np.rint(light + 2.0 * noise).astype(np.uint8)


@pytest.mark.parametrize("disc", [False, pytest.param(True, marks=pytest.mark.long)])
def test_what_process_will_refuse_is_an_error_beforehand(tmp_path, monkeypatch, disc):
    """A bar below the noise makes a right model one that is too far off; see the real disc in
    tests/setup_page for one that is. A disc's user is told what there is for it."""
    folder = samples_path() / "disc"
    path, scene = folder / "disc-560N.png", folder / "scene.toml"
    if not disc:
        path, scene = saved(tmp_path, OUTSIDE.frame(bench(), OUTSIDE.Defects(), 1)), bench()
    assert check(path, scene).ok
    monkeypatch.setattr("isochrome.fitting.TOO_FAR", 1e-3)
    found = check(path, scene)
    (said,) = [f.text for f in found.findings if f.level == "error"]
    assert not found.ok and "too far off to name the branches" in said
    with pytest.raises(PhysicsError, match="nothing could be read"):
        process(path, scene)
    assert ("isochrome calibrate disc" in said) == disc


@pytest.mark.long
def test_a_frame_that_the_scene_explains_among_others_is_enough(tmp_path):
    right = OUTSIDE.frame(bench(), OUTSIDE.Defects(), 1)
    found = check(saved(tmp_path, strange(), right), bench())
    assert found.ok and not [f for f in found.findings if "too far off" in f.text]


@pytest.mark.parametrize("times", [1.0, 0.6])
def test_frames_that_are_exposed_otherwise_than_their_no_load_frames_are_named(tmp_path, times):
    """Straight fringes up to order 4, in closed form, of a camera whose shutter was changed."""
    signal = np.sin(np.pi * np.linspace(0.0, 4.0, COLS)) ** 2 * np.ones((ROWS, 1))
    noise = np.random.default_rng(1).normal(size=(3, ROWS, COLS))
    grey = {"dark": 10.0 + 0.0 * signal, "bright": 210.0 + 0.0 * signal}
    for name, image in grey.items():
        write_tiff(tmp_path / f"{name}.tif", np.rint(image + 0.5 * noise[0])[None].astype(np.uint8))
    image = times * (10.0 + 200.0 * signal) + noise[1]
    write_tiff(tmp_path / "frames.tif", np.rint(image)[None].astype(np.uint8))
    (tmp_path / "scene.toml").write_text(
        '[specimen]\nshape = "other"\nthickness_mm = 4.0\n[camera]\nbit_depth = 8\n'
        '[frames]\nno_load_dark = "dark.tif"\nno_load_bright = "bright.tif"\n'
    )
    found = check(tmp_path / "frames.tif", load_scene(tmp_path / "scene.toml"))
    said = [f.text for f in found.findings if "times as long as frames.no_load_bright" in f.text]
    if times == 1.0:
        assert not said
    else:
        factor = float(re.search(r"exposed (\S+) times", said[0]).group(1))
        assert factor == pytest.approx(times, rel=0.01)
