"""Scale and lens from targets painted without the package. A corner is found to .015 px and a dot
to .01, 88 over some 300 px: the scale to 3e-5, distortion and keystone to 1e-4."""

import json
from dataclasses import replace

import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

import isochrome
from benchmarks.outside_camera import seen_places
from isochrome.calibration import calibrate_scale, fit_target
from isochrome.cli import app
from isochrome.errors import InputError, PhysicsError
from isochrome.scene import load_scene

from .target_pictures import Shown, bar, chessboard, dots, drawn

BOARD = {"target": "chessboard", "columns": 11, "rows": 8, "spacing_mm": 0.62}
DOTS = {**BOARD, "target": "dots"}
NAMES = ("pixel_mm", "distortion", "keystone_x", "keystone_z", "roll_deg")


@pytest.fixture
def saved(tmp_path):
    """Saves pictures and returns their paths."""

    def save(*images):
        paths = [tmp_path / f"picture-{k}.tif" for k in range(len(images))]
        for path, image in zip(paths, images, strict=True):
            tifffile.imwrite(path, image)
        return paths

    return save


def pulls(found, shown):
    """Error over uncertainty of each value."""
    return [(v.value - getattr(shown, name)) / v.standard_uncertainty
            for name in NAMES if (v := getattr(found, name))]  # fmt: skip


def holds(found, shown):
    assert found.pixel_mm.value == pytest.approx(shown.pixel_mm, rel=1e-4)
    for name in ("distortion", "keystone_x", "keystone_z"):
        assert getattr(found, name).value == pytest.approx(getattr(shown, name), abs=5e-4)
    # a corner .03 px off over 170 px, twice what they are, turns the target by .01 degrees
    assert found.roll_deg.value == pytest.approx(shown.roll_deg, abs=0.01)


@pytest.mark.parametrize(
    ("paint", "how"),
    [(chessboard, BOARD), (dots, DOTS), (lambda s, k: dots(s, k, bright=True), DOTS)],
    ids=["chessboard", "dots", "bright dots"],
)
def test_scale_lens_and_roll_are_found(saved, paint, how):
    shown = drawn(5, distortion=-0.02, keystone_x=0.015, keystone_z=-0.01, roll_deg=3.0)
    found = calibrate_scale(saved(paint(shown, 5)), **how)
    holds(found, shown)
    assert np.abs(pulls(found, shown)).max() < 4.0
    assert found.corners == 88 and found.warnings == ()
    # half a pixel's blur and noise 2 of 190: what OpenCV finds is that good
    assert found.residual_px < 0.05


@pytest.mark.study
@pytest.mark.parametrize(("paint", "how"), [(chessboard, BOARD), (dots, DOTS)])
def test_the_uncertainties_cover_the_truth(saved, paint, how):
    """30 cameras drawn; five values each: the mean square of 150 pulls is 1 to .12 by chance, and
    the finder's own errors are no noise, but go with the place in a pixel."""
    all_pulls = []
    for seed in range(30):
        shown = drawn(seed)
        found = calibrate_scale(saved(paint(shown, seed)), **how)
        holds(found, shown)
        all_pulls.append(pulls(found, shown))
    assert 0.7 < np.sqrt(np.mean(np.square(all_pulls))) < 1.4
    assert np.abs(all_pulls).max() < 5.0


def exact_places(shown, columns=11, rows=8, turn=lambda grid: grid):
    """Where a target's points are seen, and a way to count them otherwise: (rows, columns, 2)."""
    j, i = np.meshgrid(np.arange(rows) - 0.5 * (rows - 1), np.arange(columns) - 0.5 * (columns - 1),
                       indexing="ij")  # fmt: skip
    x = (shown.spacing_mm * (1.0 - shown.shorten) * i + shown.x_mm) / shown.pixel_mm
    z = (shown.spacing_mm * j + shown.z_mm) / shown.pixel_mm
    half = 0.5 * shown.shape[1], 0.5 * shown.shape[0]
    u, v = seen_places(x, z, half, shown)
    return turn(np.stack([u + half[0] - 0.5, v + half[1] - 0.5], axis=-1))


TURNS = {
    "as it is": lambda grid: grid, "from the other end": lambda grid: grid[::-1, ::-1],
    "mirrored": lambda grid: grid[:, ::-1], "by columns": lambda grid: grid.transpose(1, 0, 2),
    "by columns, from the end": lambda grid: grid.transpose(1, 0, 2)[::-1],
}  # fmt: skip


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_exact_places_give_the_exact_camera_however_they_are_counted(turn):
    shown = drawn(2)
    fit = fit_target([exact_places(shown, turn=turn)], shown.shape)
    assert fit.values["spacing_px"] == pytest.approx(shown.spacing_mm / shown.pixel_mm, rel=1e-9)
    for name in NAMES[1:4]:
        assert fit.values[name] == pytest.approx(getattr(shown, name), abs=1e-9)
    assert fit.rolls_deg[0][0] == pytest.approx(shown.roll_deg, abs=1e-7)
    # places that agree to the last digit are no promise: .005 px each, over 100 px, by 88 points
    assert 1e-6 < fit.spread["spacing_px"] / fit.values["spacing_px"] < 2e-5
    assert fit.shortening == 0.0


@pytest.mark.long
def test_a_large_soft_picture_is_read_as_a_small_one(saved):
    """Each pixel as six by six: 1800 x 2400 of them, with edges ten pixels wide."""
    shown = drawn(1)
    large = gaussian_filter(np.kron(chessboard(shown, 1), np.ones((6, 6))), 3.0)
    found = calibrate_scale(saved(large.astype(np.float32) / 255.0), **BOARD)
    holds(found, replace(shown, pixel_mm=shown.pixel_mm / 6.0))


@pytest.mark.long
def test_pictures_share_the_camera_and_lie_each_for_itself(saved):
    first = drawn(5, keystone_x=0.01)
    second = replace(first, roll_deg=-2.0, x_mm=0.05, z_mm=-0.08)
    one = calibrate_scale(saved(dots(first, 1)), **DOTS)
    both = calibrate_scale(saved(dots(first, 1), dots(second, 2)), **DOTS)
    holds(both, first)
    assert both.images[1].roll.value == pytest.approx(-2.0, abs=0.01)
    assert both.keystone_x.standard_uncertainty < one.keystone_x.standard_uncertainty


def test_the_spacings_uncertainty_is_in_that_of_the_pixel(saved):
    paths = saved(dots(Shown(), 0))
    plain = calibrate_scale(paths, **DOTS)
    known = calibrate_scale(paths, **DOTS, spacing_uncertainty_mm=0.001)
    assert plain.taken_as_exact == ("spacing_mm",) and known.taken_as_exact == ()
    ruler = known.pixel_mm.value * 0.001 / 0.62
    assert known.pixel_mm.standard_uncertainty == pytest.approx(
        np.hypot(plain.pixel_mm.standard_uncertainty, ruler), rel=1e-9
    )
    assert known.distortion == plain.distortion
    assert {item.input for item in known.budget} >= {"image noise", "spacing_mm"}


def test_a_target_seen_aslant_is_said_and_widens_the_scale(saved):
    shown = Shown(shorten=0.004)
    found = calibrate_scale(saved(dots(shown, 0)), **DOTS)
    assert "0.4 % shorter in one direction" in found.warnings[0]
    assert abs(found.pixel_mm.value / shown.pixel_mm - 1.0) > 1e-3
    # half the shortening: the scale lies between that along and that across
    assert found.pixel_mm.standard_uncertainty == pytest.approx(0.002 * 0.02, rel=0.05)
    assert abs(pulls(found, shown)[0]) < 1.5


def test_places_that_no_lens_explains_widen_the_uncertainty_and_are_said():
    shown = drawn(4)
    exact = exact_places(shown)
    noise = np.random.default_rng(4).normal(size=exact.shape)
    small, large = (fit_target([exact + size * noise], shown.shape) for size in (0.03, 0.3))
    for name, spread in small.spread.items():
        assert large.spread[name] == pytest.approx(10.0 * spread, rel=0.05)  # all but linear
    assert (small.likeness, large.likeness) == (0.0, 0.0)
    wave = 0.1 * np.sin(exact[..., ::-1] / 25.0)
    waved = fit_target([exact + wave + 0.03 * noise], shown.shape)
    assert waved.likeness > 0.4 and waved.spread["distortion"] > 3.0 * small.spread["distortion"]


def test_a_blurred_or_bent_target_is_said(saved, monkeypatch):
    from isochrome.calibration import camera_scale

    shown = Shown()
    noise = 0.4 * np.random.default_rng(0).normal(size=(8, 11, 2))
    monkeypatch.setattr(camera_scale, "target_places", lambda *a, **k: exact_places(shown) + noise)
    found = calibrate_scale(saved(dots(shown, 0)), **DOTS)
    assert "where a sharp target leaves 0.1 or less" in found.warnings[0]
    wave = 0.1 * np.sin(exact_places(shown)[..., ::-1] / 25.0)
    monkeypatch.setattr(camera_scale, "target_places", lambda *a, **k: exact_places(shown) + wave)
    assert "neighbours are alike" in calibrate_scale(saved(dots(shown, 0)), **DOTS).warnings[0]


@pytest.mark.long
@pytest.mark.parametrize("angle", [-12.0, 0.0, 3.7, 90.0, 84.0])
def test_two_edges_give_the_pixel(saved, angle):
    shown = Shown(noise=3.0, x_mm=0.013)
    found = calibrate_scale(saved(bar(shown, 3.503, angle, 1)), edges_mm=3.503)
    assert found.pixel_mm.value == pytest.approx(0.02, rel=1e-4)
    assert abs(found.pixel_mm.value - 0.02) < 3.5 * found.pixel_mm.standard_uncertainty
    assert found.distortion is None and found.to_json()["keystone_x"] is None
    assert found.warnings == ()


@pytest.mark.long
def test_the_edges_uncertainty_covers_the_truth(saved):
    """40 bars anywhere in a pixel; the finder's own .01 px is a bound: pulls are smaller."""
    found, rng = [], np.random.default_rng(0)
    for seed in range(40):
        shown = Shown(shape=(200, 200), x_mm=rng.uniform(-0.02, 0.02), blur_px=rng.uniform(0.5, 2))
        width, angle = rng.uniform(1.0, 2.5), rng.uniform(-5.0, 5.0)
        one = calibrate_scale(saved(bar(shown, width, angle, seed)), edges_mm=width)
        found.append((one.pixel_mm.value - 0.02) / one.pixel_mm.standard_uncertainty)
    assert 0.3 < np.sqrt(np.mean(np.square(found))) < 1.4 and np.abs(found).max() < 4.0


def test_pictures_of_edges_are_averaged_and_their_own_uncertainty_counts(saved):
    shown = Shown(noise=3.0)
    many = saved(*(bar(replace(shown, x_mm=0.007 * k), 3.5, 2.0 + k, k) for k in range(3)))
    one = calibrate_scale(many[:1], edges_mm=3.5)
    all_three = calibrate_scale(many, edges_mm=3.5, edges_uncertainty_mm=0.01)
    assert all_three.pixel_mm.standard_uncertainty == pytest.approx(0.02 * 0.01 / 3.5, rel=0.02)
    assert len(all_three.images) == 3 and all_three.corners > 2 * one.corners


def test_edges_that_spread_are_said(saved):
    found = calibrate_scale(saved(bar(Shown(keystone_z=0.02), 3.5, 0.0)), edges_mm=3.5)
    assert "further apart at one end" in found.warnings[0]
    # by 2 % from the middle to either end
    assert found.pixel_mm.standard_uncertainty == pytest.approx(0.02 * 0.02, rel=0.05)


WRONG = {
    "nothing": ({}, "neither target nor edges_mm"),
    "both": ({**BOARD, "edges_mm": 3.0}, "both given"),
    "another target": ({**BOARD, "target": "rings"}, "rings: is none of chessboard, dots"),
    "no columns": ({**BOARD, "columns": None}, "columns is not given"),
    "two rows": ({**BOARD, "rows": 2}, "rows = 2; .* at least 3"),
    "no spacing": ({**BOARD, "spacing_mm": None}, "spacing_mm is not given"),
    "spacing of nothing": ({**BOARD, "spacing_mm": 0.0}, "spacing_mm = 0; .* above zero"),
    "spacing that is no number": ({**BOARD, "spacing_mm": np.nan}, "spacing_mm = nan"),
    "edges backwards": ({"edges_mm": -1.0}, "edges_mm = -1; .* above zero"),
    "uncertainty of nothing": (
        {"edges_mm": 1.0, "spacing_uncertainty_mm": 0.1}, "there is no spacing_mm"
    ),
    "uncertainty below": ({**BOARD, "spacing_uncertainty_mm": -0.1}, "spacing_uncertainty_mm = -"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_options_that_make_no_sense_are_refused(name, saved):
    options, words = WRONG[name]
    with pytest.raises(InputError, match=words):
        calibrate_scale(saved(np.zeros((40, 50), np.uint8)), **options)


@pytest.mark.long
def test_pictures_that_cannot_serve_are_refused(saved):
    with pytest.raises(InputError, match="list of images is empty"):
        calibrate_scale([], **BOARD)
    with pytest.raises(InputError, match=r"picture-0.tif.*is blank"):
        calibrate_scale(saved(np.zeros((40, 50), np.uint8)), **BOARD)
    board, noise = chessboard(Shown(), 0), np.random.default_rng(0).integers(0, 255, (200, 200))
    with pytest.raises(InputError, match=r"picture-1.tif.*200 rows and 200 columns, and .* 300"):
        calibrate_scale(saved(board, noise.astype(np.uint8)), **BOARD)
    with pytest.raises(PhysicsError, match=r"no chessboard of 9 x 8 inner corners.*--edges-mm"):
        calibrate_scale(saved(board), **{**BOARD, "columns": 9})
    with pytest.raises(PhysicsError, match=r"no dots of 11 x 8 dots"):
        calibrate_scale(saved(board), **DOTS)
    with pytest.raises(PhysicsError, match="no two straight edges"):
        calibrate_scale(saved(noise.astype(np.uint8)), edges_mm=3.0)


def test_a_lens_beyond_the_model_is_refused(saved, monkeypatch):
    from isochrome.calibration import camera_scale

    shown = Shown(keystone_x=0.2)
    monkeypatch.setattr(camera_scale, "target_places", lambda *a, **k: exact_places(shown))
    with pytest.raises(PhysicsError, match=r"keystone 0.200, .* set the camera square"):
        calibrate_scale(saved(dots(Shown(), 0)), **DOTS)


SCENE = "[specimen]\nthickness_mm = 4.0\n\n[camera]  # mine\nwidth_px = 400\nheight_px = 300\n"


def test_the_command_leaves_its_files_and_sets_a_scene(saved, tmp_path, monkeypatch):
    shown = drawn(5, keystone_x=0.015, keystone_z=0.0, distortion=-0.01)
    paths = saved(dots(shown, 5))
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE, "utf-8")
    how = [str(part) for key, value in DOTS.items()
           for part in (f"--{key.replace('_', '-')}", value)]  # fmt: skip
    out = tmp_path / "out"
    command = ["calibrate", "scale", str(paths[0]), *how, "--out", str(out), "--into", str(scene)]
    done = CliRunner().invoke(app, [*command, "--json"])
    assert done.exit_code == 0
    printed = json.loads(done.stdout)
    saved_json = json.loads((out / "scale.json").read_text("utf-8"))
    assert {**saved_json, "out": str(out), "into": str(scene)} == printed
    assert {p.name for p in out.iterdir()} == {
        "budget.csv", "scale.csv", "scale.json", "scale.png", "provenance.json", "report.html",
    }  # fmt: skip
    came = json.loads((out / "provenance.json").read_text("utf-8"))
    assert list(came["inputs_sha256"]) == [str(paths[0])]
    camera = load_scene(scene).camera
    # what is written is rounded two digits beyond the uncertainty
    assert camera.pixel_mm == pytest.approx(printed["pixel_mm"]["value"], rel=1e-6)
    assert camera.keystone_x == pytest.approx(printed["keystone_x"]["value"], abs=1e-6)
    assert camera.keystone_z == 0.0 and camera.roll_deg == 0.0
    text = scene.read_text("utf-8")
    assert text.count("calibrated: residual 0.0") == 3 and "keystone_z" not in text
    assert all(line in text for line in SCENE.splitlines())
    assert set(load_scene(scene).uncertainties) == {
        "camera.pixel_mm", "camera.distortion", "camera.keystone_x"
    }  # fmt: skip


def test_a_value_that_the_scene_states_is_set_however_small(saved, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE + "distortion = 0.05  # of another lens\n", "utf-8")
    found = calibrate_scale(saved(dots(Shown(), 5)), **DOTS)
    assert isochrome.write_into_scene(found, scene) == pytest.approx(0.02, rel=1e-4)
    assert load_scene(scene).camera.distortion == pytest.approx(0.0, abs=5e-4)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("width_px = 400", "width_px = 200", "has 200 x 300 pixels, and the target's picture 400"),
        ("[camera]", "[frames]\nrotate_deg = 90\n[camera]", "has frames.rotate_deg"),
        ("[camera]", "[frames]\nflip = 'vertical'\n[camera]", "has frames.flip"),
    ],
)
def test_a_scene_of_other_pictures_is_not_written(saved, tmp_path, old, new, words):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.replace(old, new), "utf-8")
    found = calibrate_scale(saved(dots(Shown(distortion=0.02), 5)), **DOTS)
    with pytest.raises(InputError, match=words):
        isochrome.write_into_scene(found, scene)
    assert scene.read_text("utf-8") == SCENE.replace(old, new)


def test_the_command_says_each_value_and_what_was_taken_as_exact(saved, tmp_path):
    path = saved(bar(Shown(), 3.5, 2.0, 0))[0]
    done = CliRunner().invoke(
        app, ["calibrate", "scale", str(path), "--edges-mm", "3.5", "--out", str(tmp_path / "o")]
    )
    assert done.exit_code == 0
    assert done.stdout.startswith("pixel_mm = 0.0")
    assert "taken as exact: edges_mm" in done.stdout
