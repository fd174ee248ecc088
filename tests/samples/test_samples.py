"""The sample images: honest, small, repeatable, and true to theory."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

import isochrome.samples as samples
from isochrome.calibration import calibrate_bending, calibrate_disc, load_set
from isochrome.demonstration import read_truth
from isochrome.frames import look_through, open_tiff
from isochrome.reference import (
    contact_modulus,
    coupled_contact,
    coupled_stress,
    dundurs_beta,
    hertz_half_width,
    hertz_peak_pressure,
    hertz_stress,
)
from isochrome.scene import load_scene
from render_samples import (
    SEED,
    render_bending,
    render_disc,
    render_film,
    render_wear,
    write_small_tiff,
)

FOLDER = samples.samples_path()
RENDER = str(Path(__file__).parents[1] / "render_samples.py")
CONTACT = FOLDER / "line-contact-wear"
ROUNDING = 2.0**-14
LINE_LOAD = 1.015 * 44.0 / 4.0
MODULI = (2100.0, 0.4, 210000.0, 0.3)
MAX_BYTES = 9_500_000


def files_in(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def truth_of(name: str) -> dict:
    return json.loads((FOLDER / name / "truth.json").read_text("utf-8"))


def same_image(shipped: Path, rendered: Path) -> None:
    """Equal but for roundings that other machines' last digits tip; these also choose the steps of
    wear, which moves a worn contact's edge a little."""
    if shipped.suffix == ".png":
        pictures = [Image.open(p) for p in (shipped, rendered)]
        assert pictures[0].info == pictures[1].info
        one, two = (np.asarray(p) for p in pictures)
    else:
        one, two = (tifffile.imread(p) for p in (shipped, rendered))
        assert open_tiff(shipped).pixel_mm == pytest.approx(open_tiff(rendered).pixel_mm, rel=1e-9)
    assert one.shape == two.shape and one.dtype == two.dtype
    if one.dtype == np.uint8:
        assert np.abs(one.astype(int) - two.astype(int)).max() <= 1
        assert np.mean(one != two) < 1e-3
    else:
        assert np.array_equal(np.isnan(one), np.isnan(two))
        off = np.abs(one - two)[np.isfinite(one)]
        assert np.mean(off > 0.0) < 1e-2 and off.max() <= 2.0**-10


def film(path: Path) -> np.ndarray:
    """All frames of a film, by OpenCV itself."""
    video, frames = cv2.VideoCapture(str(path)), []
    while True:
        there, frame = video.read()
        if not there:
            return np.array(frames)[..., 0]
        frames.append(frame)


def same_set(shipped: Path, rendered: Path, names: list[str]) -> None:
    for name in names:
        if name.endswith((".png", ".tif")):
            same_image(shipped / name, rendered / name)
        elif name.endswith(".avi"):
            one, two = (film(folder / name) for folder in (shipped, rendered))
            assert one.shape == two.shape
            assert np.abs(one.astype(int) - two.astype(int)).max() <= 1
            assert np.mean(one != two) < 1e-3  # as of pictures
        else:
            assert (shipped / name).read_text("utf-8") == (rendered / name).read_text("utf-8"), name


def order_grid(frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Places of the pixels of a captured frame: x (mm) and z (mm) from the true contact."""
    truth = truth_of("line-contact-wear")
    x = truth["camera.left_mm"][frame] + 0.00607 * (np.arange(659) + 0.5)
    z = truth["camera.top_mm"][frame] + 0.00607 * (np.arange(494) + 0.5)
    return x, z


def test_readme_names_every_file_says_rendered_and_gives_the_command():
    text = (FOLDER / "README.md").read_text("utf-8")
    named = re.findall(r"^\| `([^`]+)`", text, re.MULTILINE)
    assert sorted([*named, "README.md"]) == files_in(FOLDER)
    assert "Every image here is rendered by Isochrome" in text
    assert f"python tests/render_samples.py sample_images --seed {SEED}" in text


def test_every_image_says_in_its_own_file_that_it_is_rendered():
    for name in files_in(FOLDER):
        if name.endswith(".png"):
            with Image.open(FOLDER / name) as image:
                assert "not captured" in image.info["Comment"]
        elif name.endswith(".tif"):
            with tifffile.TiffFile(FOLDER / name) as tif:
                assert all("not captured" in page.description for page in tif.pages)


def test_a_stack_is_written_with_its_scale_and_says_that_it_is_rendered(tmp_path):
    write_small_tiff(tmp_path / "a.tif", np.zeros((2, 20, 30), np.uint8), pixel_mm=0.025)
    assert open_tiff(tmp_path / "a.tif").pixel_mm == pytest.approx(0.025, rel=1e-6)
    with tifffile.TiffFile(tmp_path / "a.tif") as tif:
        assert len(tif.pages) == 2
        assert all("not captured" in page.description for page in tif.pages)


def test_the_demo_is_held_against_what_was_put_in():
    """1.015 of the nominal 44 N; one epoxy for the beam and the disc."""
    assert read_truth(FOLDER) == {
        "load": "44.66, rendered", "film": "41.13 to 48.27, rendered",
        "bending": "14.6, rendered", "disc": "14.6, rendered",
    }  # fmt: skip


def test_the_sample_images_are_at_most_nine_and_a_half_megabytes():
    assert sum((FOLDER / name).stat().st_size for name in files_in(FOLDER)) <= MAX_BYTES


@pytest.mark.long
@pytest.mark.parametrize(
    ("render", "name"),
    [
        (render_bending, "bending"), (render_disc, "disc"), (render_wear, "wear"),
        pytest.param(render_film, "sliding-film", marks=pytest.mark.study),
    ],
)  # fmt: skip
def test_a_set_renders_to_the_shipped_one(tmp_path, render, name):
    render(tmp_path, SEED)
    names = files_in(tmp_path)
    assert names == files_in(FOLDER / name)
    same_set(FOLDER / name, tmp_path, names)


@pytest.mark.study
def test_the_command_renders_the_shipped_files_and_the_same_bytes_twice(tmp_path):
    for run in ("one", "two"):
        command = [sys.executable, RENDER, run]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout.strip(), done.stderr) == (0, run, "")
    names = files_in(tmp_path / "one")
    assert names == files_in(tmp_path / "two") == files_in(FOLDER)
    for file in names:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    same_set(FOLDER, tmp_path / "one", names)


@pytest.mark.long
def test_another_seed_gives_other_noise_on_the_same_fringes(tmp_path):
    render_disc(tmp_path, SEED + 1)
    one, two = (
        np.asarray(Image.open(p / "disc-560N.png")).astype(float)
        for p in (tmp_path, FOLDER / "disc")
    )
    spread = 1.4826 * np.median(np.abs(one - two))
    assert spread == pytest.approx(3.0 * np.sqrt(2.0), rel=0.1)


def test_static_truth_is_hertz_at_the_true_place_and_load():
    order = tifffile.imread(CONTACT / "true_fringe_order.tif")[0]
    modulus = contact_modulus(*MODULI)
    half = hertz_half_width(LINE_LOAD, 24.61, modulus)
    peak = hertz_peak_pressure(LINE_LOAD, 24.61, modulus)
    x, z = order_grid(0)
    below = z >= 0.0
    stress = hertz_stress(x, z[below][:, None], half_width_mm=half, peak_pressure_mpa=peak)
    error = order[below] - stress.principal_difference * 4.0 / 14.6
    assert np.abs(error).max() < 1e-3 * peak * 4.0 / 14.6 + ROUNDING
    assert np.isnan(order[~below]).all() and 0 < np.count_nonzero(~below) < 10


def test_first_sliding_truth_is_the_coupled_sliding_contact_at_its_true_place():
    order = tifffile.imread(CONTACT / "true_fringe_order.tif")[1]
    friction = truth_of("line-contact-wear")["friction.coefficient"][1]
    contact = coupled_contact(
        LINE_LOAD, 24.61, contact_modulus(*MODULI), friction=friction, beta=dundurs_beta(*MODULI)
    )
    x, z = order_grid(1)
    below = z >= 0.0
    stress = coupled_stress(x, z[below][:, None], contact).principal_difference
    error = order[below] - stress * 4.0 / 14.6
    assert np.abs(error).max() < 1e-3 * contact.peak_pressure_mpa * 4.0 / 14.6 + ROUNDING


def test_contact_scene_is_nominal_and_its_frames_pass_the_check():
    scene = load_scene(CONTACT / "scene.toml")
    nominal = load_scene("line-contact-wear")
    for part in ("specimen", "indenter", "load", "friction", "wear", "polariscope", "camera"):
        assert getattr(scene, part) == getattr(nominal, part)
    checked = look_through(CONTACT / "captured.tif", scene)
    assert checked.count == 6 and {f.level for f in checked.findings} <= {"note"}
    assert open_tiff(CONTACT / "captured.tif").pixel_mm == pytest.approx(0.00607, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "calibrate"),
    [("bending", calibrate_bending), pytest.param("disc", calibrate_disc, marks=pytest.mark.study)],
)
def test_calibration_finds_the_true_fringe_value_within_the_images_own_uncertainty(name, calibrate):
    """All that is stated beside the images is taken as exact: their own part must cover it."""
    given = load_set(FOLDER / name / "set.toml")
    exact = given.model_copy(update={"uncertainty": type(given.uncertainty)()})
    found, truth = calibrate(exact), truth_of(name)
    off = found.fringe_value_n_per_mm - truth["fringe_value_n_per_mm"]
    assert abs(off) < 4.0 * found.standard_uncertainty
    assert found.standard_uncertainty < 1e-3 * truth["fringe_value_n_per_mm"]
    assert found.order_at_zero_load == pytest.approx(truth["order_at_zero_load"], abs=2e-3)
    assert 0.9 < found.chi < 1.1


def test_an_installed_package_has_its_own_images_or_says_in_one_sentence_that_they_are_missing(
    code, tmp_path
):
    package = tmp_path / "isochrome"
    shutil.copytree(code / "isochrome", package)
    words = f"""
from pathlib import Path
from isochrome.errors import InputError
from isochrome.samples import samples_path
try:
    samples_path()
except InputError as error:
    print(error)
images = Path({str(package)!r}) / "sample_images"
images.mkdir()
(images / "README.md").write_text("rendered")
print(samples_path())
"""
    home = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", words], env=home, capture_output=True, text=True, check=True
    )
    said, found = done.stdout.splitlines()
    assert "sample images are not there; install" in said
    assert Path(found) == (package / "sample_images").resolve()


@pytest.mark.long
def test_a_wrong_seed_or_folder_ends_with_exit_code_2_and_leaves_nothing(tmp_path):
    (tmp_path / "file").write_text("in the way")
    for arguments in (["out", "--seed", "-1"], ["file"]):
        command = [sys.executable, RENDER, *arguments]
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, check=False, env=os.environ
        )
        assert done.returncode == 2
        assert len(done.stderr.strip().splitlines()) == 1
    assert files_in(tmp_path) == ["file"]
