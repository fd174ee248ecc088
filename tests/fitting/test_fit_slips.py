"""Scenes with one slip, in frames of a bench that is not ours: the slip is named, nothing is given.
Each row of the issue's table in which nothing was read, and the same sentence was said of
everything, is a test here: the right sentence, and exit 3."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
import tifffile

from commands import exit_code
from fitting.engine_frames import prepared
from fitting.sliding_bench import FRICTION, LOAD, bench
from fitting.test_fit_causes import Defects, frame
from isochrome.errors import PhysicsError
from isochrome.fitting import TOO_FAR, cause_messages, fit, fit_with_causes, opposite_shear
from isochrome.fitting.causes import slips
from isochrome.fitting.causes.slips import _together
from isochrome.frames import as_turned
from isochrome.processing import check, process
from isochrome.scene import dump_scene, parse_scene

ROWS, COLS = 124, 166
"""Half the pixels of a side: a slip is as plain there."""

START = {"load.normal_n": 40.0, "friction.coefficient": 0.25}


@pytest.fixture(scope="module")
def image():
    return frame(bench(ROWS, COLS), Defects(), 1)


def stated(**values):
    """The scene of the bench with a slip in it."""
    named = {key.replace("__", "."): value for key, value in values.items()}
    return bench(ROWS, COLS).with_values(START | named)


def files(folder, image, scene):
    tifffile.imwrite(folder / "frame.tif", image)
    (folder / "scene.toml").write_text(dump_scene(scene), "utf-8")
    return [str(folder / "frame.tif"), "--scene", str(folder / "scene.toml")]


def upside_down(image):
    return np.rot90(image, 2), stated()


def bright_for_dark(image):
    return image, stated(polariscope__field="bright")


def modulus_in_mpa(image):
    return image, stated(specimen__young_gpa=1000.0 * bench().specimen.young_gpa)


def both_moduli_in_mpa(image):
    keys = ("specimen.young_gpa", "indenter.young_gpa")
    moduli = {key.replace(".", "__"): 1000.0 * bench().get(key) for key in keys}
    return image, stated(**moduli)


def far_away(image):
    return image, stated(camera__left_mm=-0.8)


def on_its_side(image):
    return np.rot90(image), stated(camera__width_px=ROWS, camera__height_px=COLS)


SLIPS = {
    upside_down: "the picture is upside down: with frames.rotate_deg = 180 ",
    bright_for_dark: 'the picture is one of the dark field: with polariscope.field = "dark" the',
    modulus_in_mpa: "Young's modulus is given in MPa: with specimen.young_gpa = 2.1 the scene",
    both_moduli_in_mpa: "MPa: with specimen.young_gpa = 2.1 and indenter.young_gpa = 210 the scene",
    far_away: "the contact is elsewhere in the picture: with camera.left_mm = -2",
    on_its_side: "the picture lies on its side: with frames.rotate_deg = 270 and camera.width_px",
}
HELD = r"\(chi = (1\.0|0\.99)"
"""A right scene leaves the noise."""


@pytest.mark.long
@pytest.mark.parametrize(
    "slip",  # `fit` names others, by the same question
    [far_away, *(pytest.param(s, marks=pytest.mark.study) for s in SLIPS if s != far_away)],
    ids=lambda slip: slip.__name__,
)
def test_process_names_the_slip_and_ends_with_3(tmp_path, monkeypatch, capsys, image, slip):
    place = files(tmp_path, *slip(image))
    code = exit_code(monkeypatch, "process", *place, "--out", tmp_path / "out")
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert code == 3 and "nothing could be read in any of its 1 frame " in said
    assert SLIPS[slip] in said and re.search(HELD, said)


def test_a_slip_is_an_error_of_check_and_all_that_is_said(image):
    """It was a warning between others, and the command ended with 0."""
    seen, scene = upside_down(image)
    found = check(seen, scene)
    (finding,) = [each for each in found.findings if each.frame == 0]
    assert finding.level == "error" and not found.ok
    assert finding.text.startswith(f"frame 0: {SLIPS[upside_down]}")


@pytest.mark.long
@pytest.mark.parametrize(
    "slip",  # `check` names the first, above
    [pytest.param(upside_down, marks=pytest.mark.study), bright_for_dark, both_moduli_in_mpa],
)
def test_fit_names_the_slip_and_the_line_that_mends_it(tmp_path, image, slip):
    """Nothing was read, exit 3; the scene with the line in it gives the truth."""
    seen, scene = slip(image)
    place, *_ = files(tmp_path, seen, scene)
    keys = ["load.normal_n", "friction.coefficient"]
    with pytest.raises(PhysicsError) as refused:
        fit(place, scene, keys)
    said = str(refused.value)
    assert refused.value.exit_code == 3 and "nothing could be read in any of the 1 frames" in said
    assert SLIPS[slip] in said and re.search(HELD, said)
    line = said.split(" with ")[1].split(" the scene explains")[0].split(" (")[0]
    pairs = dict(part.split(" = ") for part in line.split(" and "))
    right = scene.with_values({key: json.loads(value) for key, value in pairs.items()})
    found = fit(place, right, keys)
    assert found.chi < 1.1
    assert found.shared[keys[0]]["value"] == pytest.approx(LOAD, rel=1e-3)
    assert found.shared[keys[1]]["value"] == pytest.approx(FRICTION, abs=1e-3)


def explained(image, scene, keys=None):
    return fit_with_causes(prepared(image, scene), scene, keys)


@pytest.mark.parametrize(("share", "lost"), [(0.5, False), (1.5, True)])
def test_a_field_of_no_fringe_is_lost_under_any_light(share, lost):
    """Fringes vary by 1/sqrt(8) of their light, 50 of its noise here, whatever a fit's light is."""
    raw, weight = 0.5 * np.sin(np.linspace(0.0, 20.0 * np.pi, 4000)) ** 2, 100.0
    given = SimpleNamespace(
        fit=SimpleNamespace(positive=True, chi=share * TOO_FAR * 50.0),
        model=SimpleNamespace(pixels=SimpleNamespace(raw=raw, weight=weight)),
        final=SimpleNamespace(gamma_fit=SimpleNamespace(amplitude=[1e4])),
    )
    assert slips.is_lost(given) is lost


@pytest.mark.long
def test_a_slip_is_named_beside_a_small_cause():
    """A roll is left for the fit of the mended scene."""
    seen = frame(bench(ROWS, COLS), Defects(roll_deg=0.3, spot=0.2), 2)
    (said,) = cause_messages(explained(np.rot90(seen, 2), stated()))
    assert said.startswith("the picture is upside down")


@pytest.mark.long
def test_a_place_that_is_held_wrong_is_named_with_the_right_one(image):
    held = stated(camera__left_mm=-1.8, camera__top_mm=0.0)
    (said,) = cause_messages(explained(image, held, ("load.normal_n", "friction.coefficient")))
    assert "with camera.left_mm = -2 and camera.top_mm = " in said


@pytest.mark.long
@pytest.mark.parametrize(
    "defects", [pytest.param({"roll_deg": -2.0}, marks=pytest.mark.study), {"gamma": 2.2}]
)
def test_no_slip_is_named_where_a_cause_explains_the_frame(defects):
    freed = explained(frame(bench(ROWS, COLS), Defects(**defects), 1), stated())
    assert freed.slip is None and freed.fit.positive and freed.fit.chi < 1.1


@pytest.mark.long
def test_no_slip_is_named_of_a_frame_that_none_explains():
    noise = np.random.default_rng(3).normal(120.0, 3.0, (62, 83)).astype(np.uint8)
    freed = explained(noise, bench(62, 83).with_values(START))
    assert freed.slip is None and not freed.fit.positive


@pytest.mark.parametrize(("chi", "named"), [(4.7, True), (4.9, False)])
def test_a_slip_is_named_that_leaves_a_sixteenth_of_what_chi_squared_is_too_large_by(
    monkeypatch, image, chi, named
):
    """Of 19² - 1 = 360 that is 22.5: chi = 4.85."""
    monkeypatch.setattr(
        slips, "_tried", lambda data, scene, keys, lost: SimpleNamespace(chi=chi, scene=scene)
    )
    assert (
        slips.explaining_slip(prepared(image, stated()), stated(), None, 19.0) is not None
    ) is named


@pytest.mark.parametrize("lost", [True, False])
def test_what_is_not_lost_is_not_searched_for(monkeypatch, image, lost):
    """It took 20 s of a frame that some other fact makes chi = 2 of."""
    searched = []

    def search(*args):
        searched.append(args)
        raise PhysicsError("nothing is there")

    monkeypatch.setattr(slips, "search_frame", search)
    monkeypatch.setattr(slips, "settle_frame", lambda *args: None)
    assert slips.explaining_slip(prepared(image, stated()), stated(), None, 9.0, lost=lost) is None
    assert bool(searched) is lost


@pytest.mark.parametrize("first", [(0, None), (90, None), (180, "vertical"), (270, "horizontal")])
@pytest.mark.parametrize("then", [(180, None), (90, None), (0, "vertical"), (270, "horizontal")])
def test_a_turn_on_top_of_the_scenes_own_is_named_as_one(first, then):
    marked = np.arange(12).reshape(3, 4)
    both = as_turned(as_turned(marked, *first), *then)
    np.testing.assert_array_equal(as_turned(marked, *_together(first, then)), both)


@pytest.mark.long
def test_a_turned_scene_is_named_with_what_its_keys_should_be(image):
    """A picture that was upright, and was stated upside down: no turn is the right one."""
    scene = parse_scene(dump_scene(stated()) + "\n[frames]\nrotate_deg = 180\n")
    (said,) = cause_messages(explained(np.rot90(image, 2), scene))
    assert "with frames.rotate_deg = 0 " in said


@pytest.mark.long
@pytest.mark.parametrize("mirrored", [False, True])
def test_shear_that_points_the_other_way_is_said_with_the_line_that_mirrors(image, mirrored):
    """A mirrored picture looks as one of sliding the other way: nothing was said of it."""
    seen = np.ascontiguousarray(image[:, ::-1] if mirrored else image)
    found = process(seen, stated(friction__coefficient=0.2))
    said = [text for text in found.warnings if "the other sign" in text]
    value = found.columns["friction.coefficient"][0]
    assert value == pytest.approx(-FRICTION if mirrored else FRICTION, abs=1e-3)
    assert len(said) == mirrored
    if mirrored:
        assert 'if it is mirrored, give frames.flip = "horizontal", else' in said[0]
        scene = stated(friction__coefficient=0.2)
        fitted = fit(seen, scene, ["friction.coefficient", "load.normal_n"], as_stated=True)
        assert sum("the other sign" in text for text in fitted.warnings) == 1


def test_the_line_that_mirrors_goes_on_top_of_the_scenes_own_turn():
    scene = parse_scene(dump_scene(stated()) + "\n[frames]\nrotate_deg = 180\n")
    key = "friction.coefficient"
    said = opposite_shear(scene, key, -0.2, 0.04)
    assert said and 'give frames.rotate_deg = 0 and frames.flip = "vertical", else' in said
    assert opposite_shear(scene, key, -0.2, 0.06) is None  # it may be none at all
    assert opposite_shear(scene, key, 0.2, 0.01) is None
    assert opposite_shear(scene, "load.tangential_n", -2.0, 0.01) is None  # nobody stated it
    held = scene.with_values({"load.tangential_n": 3.0})
    assert opposite_shear(held, "load.tangential_n", -2.0, 0.01) is not None
