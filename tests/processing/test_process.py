"""`process` on rendered frames whose fringe order is known, and on real ones nearby."""

import json

import numpy as np
import pytest
import tifffile
from PIL import Image

from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import prepare_frame
from isochrome.frames import open_frames
from isochrome.output import read_csv, write_tiff
from isochrome.processing import placed_disc, process
from isochrome.samples import samples_path
from isochrome.scene import load_scene, parse_scene
from isochrome.simulation import simulate
from scene_texts import PAPER_CONTACT, SMALL_CAMERA

CONTACT = samples_path() / "line-contact-wear"
DISC = samples_path() / "disc"

SMALL = PAPER_CONTACT + "\n[friction]\ncoefficient = 0.25\n" + SMALL_CAMERA + "noise_grey = 2.0\n"
STATIC = PAPER_CONTACT + SMALL_CAMERA + "noise_grey = 2.0\n"
WEAR = "\n[wear]\ncoefficient_mm2_per_n = 2e-9\ndistances_m = [0.0, 40.0, 80.0]\n"


def sample_scene(**wear):
    scene = load_scene(CONTACT / "scene.toml")
    known = {f"wear.{k}": v for k, v in wear.items()} | {"camera.blur_px": 0.4}  # its camera's
    return scene.with_values(known).model_copy(update={"folder": CONTACT, "name": "sample"})


@pytest.fixture(scope="module")
def captured():
    return tifffile.imread(CONTACT / "captured.tif")


@pytest.fixture(scope="module")
def true_order():
    return tifffile.imread(CONTACT / "true_fringe_order.tif")


@pytest.fixture(scope="module")
def first_and_last(captured, tmp_path_factory):
    """Frames 0 and 5 of the sample stack, in a stack of their own, processed."""
    path = tmp_path_factory.mktemp("two") / "two.tif"
    write_tiff(path, captured[[0, 5]])
    return process(path, sample_scene(distances_m=(233.0,)))


def right_to_a_hundredth(item, true):
    """The bar of the whole: fringe-order RMS, no wrong branch, chi, share of pixels known."""
    error = item.reading.order - true
    known = np.isfinite(item.reading.order)
    assert np.isfinite(error[known]).all()  # nothing is read where there is no specimen
    assert np.sqrt(np.mean(error[known] ** 2)) <= 0.01 and np.abs(error[known]).max() < 0.25
    assert 0.9 < item.chi < 1.1 and item.reading.kept >= 0.95
    # a worn contact's largest order lies at its edge, on the surface, where none is read
    peak = [text for text in item.warnings if "n_max" in text]
    assert all("n_max and its place are those of the fitted model" in text for text in peak)
    assert abs(item.columns["n_max"] - np.nanmax(true)) <= 2.0 * item.columns["n_max_uncertainty"]


@pytest.mark.long
def test_two_sample_frames_are_read_to_a_hundredth_of_a_fringe(first_and_last, true_order):
    for item, state in zip(first_and_last.frames, (0, 5), strict=True):
        right_to_a_hundredth(item, true_order[state])
    assert first_and_last.columns["label"] == ["static", "233 m"]
    assert first_and_last.columns["n_max_from"] == ["frame", "model"]
    assert not first_and_last.frames[0].warnings
    # it wore under less friction than it has: .236 to .25 before .252
    assert "friction.earlier_change = -0.00" in first_and_last.frames[1].warnings[0]


@pytest.mark.study
def test_all_sample_frames_are_read_to_a_hundredth_of_a_fringe_and_their_friction_within_its_spread(
    true_order,
):
    """They rise from 0.236 to 0.252: with the images' ± alone, that of 77 m was 3.7 of them off."""
    found = process(CONTACT / "captured.tif", CONTACT / "scene.toml")
    for item, true in zip(found.frames, true_order, strict=True):
        right_to_a_hundredth(item, true)
    true = np.array(json.loads((CONTACT / "truth.json").read_text())["friction.coefficient"][1:])
    value, spread = (
        np.array(found.columns[f"friction.coefficient{end}"][1:], dtype=float)
        for end in ("", " standard_uncertainty")
    )
    assert np.all(np.abs(value - true) < 3.0 * spread)
    assert (spread[2:] < 1e-3 * true[2:]).all()  # a thousandth of the friction, no more


@pytest.mark.long
def test_uncertainty_and_confidence_are_those_of_the_errors(first_and_last, true_order):
    for item, state in zip(first_and_last.frames, (0, 5), strict=True):
        pull = (item.reading.order - true_order[state]) / item.reading.uncertainty
        pull = pull[np.isfinite(pull)]
        assert 0.8 < np.sqrt(np.mean(pull**2)) < 1.3
    judged = 0
    for item, state in zip(first_and_last.frames, (0, 5), strict=True):
        known = np.isfinite(item.reading.order)
        confidence = item.reading.confidence
        assert (confidence[~known] == 0.0).all()
        assert (confidence >= 0.0).all() and (confidence <= 1.0).all()
        right = np.abs(item.reading.order - true_order[state])[known] < 0.05
        assert right.mean() == pytest.approx(confidence[known].mean(), abs=2e-3)
        unsure = known & (confidence < 0.99)
        if unsure.sum() > 200:
            judged += 1
            share = (np.abs(item.reading.order - true_order[state])[unsure] < 0.05).mean()
            assert share == pytest.approx(confidence[unsure].mean(), abs=0.1)
    assert judged  # else nobody asked where it is hard


@pytest.mark.long
def test_fitted_values_are_the_rendered_ones(first_and_last):
    static = first_and_last.frames[0].fit
    found = dict(zip(static.keys, static.values, strict=True))
    assert found["load.normal_n"] == pytest.approx(44.66, rel=1e-3)
    assert found["camera.left_mm"] == pytest.approx(-1.973899, abs=0.02 * 0.00607)
    assert found["camera.top_mm"] == pytest.approx(-0.015782, abs=0.02 * 0.00607)
    worn = first_and_last.frames[1].fit
    found = dict(zip(worn.keys, worn.values, strict=True))
    assert found["friction.coefficient"] == pytest.approx(0.252, abs=1e-3)
    assert found["wear.coefficient_mm2_per_n"] == pytest.approx(2.06e-9, rel=3e-3)


@pytest.mark.parametrize("radius_mm", [27.0, pytest.param(49.22, marks=pytest.mark.study)])
def test_a_wrong_scene_gives_a_poor_chi_and_says_so(radius_mm, tmp_path):
    """As stated a radius 10 % off leaves orders to be used with care; one twice too large none."""
    write_tiff(tmp_path / "static.tif", simulate(parse_scene(STATIC)).frames)
    scene = parse_scene(STATIC).with_values({"indenter.radius_mm": radius_mm})
    if radius_mm > 40.0:
        lost = r"nothing could be read in any .*chi = \d.*too far off to name the branches"
        with pytest.raises(PhysicsError, match=lost):
            process(tmp_path / "static.tif", scene, as_stated=True)
        return
    found = process(tmp_path / "static.tif", scene, as_stated=True)
    assert found.columns["chi"][0] > 1.3 and found.columns["kept_share"][0] > 0.5
    assert "the model does not describe this frame" in found.warnings[0]


@pytest.mark.long
def test_a_wrong_radius_looks_like_a_modulus_and_is_said_to(tmp_path):
    """Of a contact's width and pressure E/R is all that the frame knows."""
    write_tiff(tmp_path / "static.tif", simulate(parse_scene(STATIC)).frames)
    found = process(
        tmp_path / "static.tif", parse_scene(STATIC).with_values({"indenter.radius_mm": 27.0})
    )
    assert found.columns["chi"][0] < 1.05 and found.columns["kept_share"][0] > 0.9
    assert "another modulus of the specimen, or another radius" in found.warnings[0]
    assert found.fitted.specimen.young_gpa == pytest.approx(27.0 / 24.61 * 2.1, rel=0.02)


COARSE = (
    STATIC.replace("width_px = 160", "width_px = 80")
    .replace("height_px = 120", "height_px = 60")
    .replace("pixel_mm = 0.025", "pixel_mm = 0.05")
)
"""The same in a quarter of the pixels."""


@pytest.fixture(scope="module")
def coarse():
    return simulate(parse_scene(COARSE)).frames


def test_an_unknown_gamma_is_found_with_the_model():
    scene = parse_scene(STATIC).with_values({"camera.gamma": 1.4})
    rendered = simulate(scene)
    (item,) = process(rendered.frames, scene.with_values({"frames.gamma": "unknown"})).frames
    error = item.reading.order - rendered.orders[0]
    known = np.isfinite(error)
    assert known.sum() >= 0.9 * np.isfinite(rendered.orders[0]).sum()
    assert np.sqrt(np.mean(error[known] ** 2)) <= 0.01 and np.abs(error[known]).max() < 0.25
    gamma = dict(zip(item.fit.keys, item.fit.values, strict=True))["frames.gamma"]
    assert gamma == pytest.approx(1.4, abs=0.01)


def test_a_frame_is_read_alike_alone_and_among_others(coarse):
    other = simulate(parse_scene(COARSE).with_values({"camera.seed": 5})).frames
    both = process(np.concatenate([other, coarse]), parse_scene(COARSE))
    (alone,), (_, among) = process(coarse, parse_scene(COARSE)).frames, both.frames
    assert np.array_equal(alone.reading.order, among.reading.order, equal_nan=True)
    assert np.array_equal(alone.fit.values, among.fit.values) and alone.chi == among.chi


def test_the_share_that_was_read_is_of_the_masked_specimen(coarse, tmp_path):
    """The mask takes the upper half: all of it is read, and that is all that there is to read."""
    write_tiff(tmp_path / "f.tif", coarse)
    corners = [[-0.5, -0.5], [-0.5, 79.5], [29.5, 79.5], [29.5, -0.5]]
    text = f"{COARSE}[frames]\npolygon_px = {corners}\n"
    found = process(tmp_path / "f.tif", parse_scene(text))
    assert found.columns["kept_share"][0] > 0.95
    assert "could be read" not in found.columns["warnings"][0]


def test_a_frame_of_which_less_than_half_is_read_says_so(coarse, tmp_path):
    frame = coarse.copy()
    frame[:, 24:] = 255  # saturated, and so not valid
    write_tiff(tmp_path / "f.tif", frame)
    found = process(tmp_path / "f.tif", parse_scene(COARSE))
    (share,) = found.columns["kept_share"]
    assert 0.3 < share <= 0.4  # 24 of 60 rows
    assert f"only {100 * share:.0f} % of the specimen's pixels could be read" in found.warnings[0]


@pytest.fixture(scope="module")
def small_disc(tmp_path_factory):
    """Every third pixel of a sample of the disc, in rows and columns, and its scene."""
    path = tmp_path_factory.mktemp("disc") / "disc.tif"
    write_tiff(path, np.array(Image.open(DISC / "disc-560N.png"))[None, ::3, ::3])
    size = {"camera.width_px": 140, "camera.height_px": 140, "camera.pixel_mm": 0.39}
    return path, load_scene(DISC / "scene.toml").with_values(size)


def test_a_rim_that_is_not_the_discs_is_told(small_disc):
    """The rim is 50 mm wide, and the scene's pixel makes 51 mm of it, and 53 mm.
    Asked of the disc's place alone: a fit to a disc of another size takes seconds to be lost."""
    path, scene = small_disc
    (frame,) = open_frames(path)
    data = prepare_frame(frame, scene, bit_depth=8)
    for wider, told in ((1.02, False), (1.06, True)):
        _, notes = placed_disc(scene.with_values({"camera.pixel_mm": 0.39 * wider}), data)
        assert any("mm wide by camera.pixel_mm" in note for note in notes) == told
    found = process(*small_disc)
    assert found.columns["load.normal_n"][0] == pytest.approx(560.0, rel=1e-3)
    assert 0.9 < found.columns["chi"][0] < 1.1


def test_without_a_model_the_frame_is_normalised_and_that_is_said(tmp_path):
    col = np.arange(80) + np.zeros((60, 1))
    light = {"dark": 20.0, "bright": 220.0, "film": 120.0 - 100.0 * np.cos(0.3 * col)}
    for name, level in light.items():
        noise = np.random.default_rng(len(name)).standard_normal(col.shape)
        write_tiff(tmp_path / f"{name}.tif", np.rint(level + noise).astype(np.uint8)[None])
    text = '[specimen]\n[frames]\nno_load_dark = "dark.tif"\nno_load_bright = "bright.tif"\n'
    scene = parse_scene(text, name="mine", folder=tmp_path)
    found = process(tmp_path / "film.tif", scene, tmp_path / "out")
    assert found.model is None and found.fitted is None
    assert "mine: " in found.warnings[0] and "cannot be simulated" in found.warnings[0]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "frames.csv", "normalised.tif", "skeleton.csv", "scene.toml", "provenance.json",
        "process.png", "report.html", "run.zarr", "records",
    }  # fmt: skip
    signal = tifffile.imread(tmp_path / "out" / "normalised.tif")
    assert signal.shape == (60, 80) and signal.dtype == np.float32
    lines = read_csv(tmp_path / "out" / "skeleton.csv")
    assert len(lines["frame"]) > 100 and found.columns["fringe_lines"][0] > 0


@pytest.mark.long
def test_a_video_gives_distances_from_its_times(tmp_path):
    import cv2

    wear = WEAR.replace(", 80.0", "")
    scene = parse_scene(SMALL.replace("noise_grey = 2.0\n", "") + wear)
    frames = simulate(scene).frames
    film = tmp_path / "Lauf.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter_fourcc(*"MJPG"), 2.0, (160, 120))
    for frame in frames:
        writer.write(np.repeat(frame[..., None], 3, axis=2))
    writer.release()
    text = SMALL + wear + "\n[frames]\nsliding_speed_mm_per_s = 80000.0\n"
    found = process(film, parse_scene(text), tmp_path / "out")
    # Two frames a second and 80 m/s: 40 m from frame to frame.
    assert found.columns["distance_m"] == pytest.approx([0.0, 40.0])
    assert found.columns["label"] == ["0 m", "40 m"]
    assert found.columns["load.normal_n"] == pytest.approx([44.0] * 2, rel=5e-3)
    worn = found.columns["wear.coefficient_mm2_per_n"]
    assert worn[0] is None and worn[1] == pytest.approx(2e-9, rel=0.03)


def test_a_stack_without_times_is_refused_where_a_speed_is_given(tmp_path):
    write_tiff(tmp_path / "stack.tif", simulate(parse_scene(SMALL)).frames)
    text = SMALL + WEAR + "\n[frames]\nsliding_speed_mm_per_s = 80.0\n"
    with pytest.raises(InputError, match=r"no time, which frames\.sliding_speed_mm_per_s needs"):
        process(tmp_path / "stack.tif", parse_scene(text), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_light_that_cannot_be_read_is_refused_before_the_frames():
    text = '[specimen]\nthickness_mm = 4.0\n[polariscope]\nfield = "plane"\n'
    with pytest.raises(InputError, match=r"^my: .*isoclinics look like fringes"):
        process("nowhere.tif", parse_scene(text, name="my"))
