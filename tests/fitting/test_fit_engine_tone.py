"""Cameras and polariscopes that are not ideal: gamma, plates, blur, fall-off; and what is refused.
Half-size frames: the load is then known to some 0.003 %, and the bar is 0.05 %."""

import numpy as np
import pytest

from fitting.engine_frames import HALF_SIZE, begun, captured, fitted, pulls, random_contact
from isochrome.errors import InputError
from isochrome.fitting import fit
from isochrome.output import write_tiff

LOAD_BAR = 5e-4
INPUT, OUTPUT = "polariscope.input_plate_error_deg", "polariscope.output_plate_error_deg"


def hard_case(truth, start, free, *, kind="slide", seed=7):
    """A fit from 5 % off with more unknowns free; its values, pulls and the fit itself."""
    rng = np.random.default_rng(seed)
    scene, true = random_contact(rng, kind)
    seen = scene.with_values({**HALF_SIZE, **truth})
    frame = captured(seen, seed)
    first = begun(rng, seen, true, share=0.05).with_values(start)
    found = fitted(frame, first, (*true, *free))
    values = dict(zip(found.keys, found.values.tolist(), strict=True))
    assert abs(values["load.normal_n"] / true["load.normal_n"] - 1.0) <= LOAD_BAR
    assert found.converged and found.chi == pytest.approx(1.0, abs=0.03)
    # six unknowns at the most: one in ten thousand is farther off by chance
    assert np.abs(pulls(found, {**true, **free})).max() < 4.0
    return values


@pytest.mark.parametrize("gamma", [2.2, pytest.param(1 / 2.2, marks=pytest.mark.long)])
def test_an_exponent_is_found_beside_the_load_from_a_linear_start(gamma):
    hard_case({"camera.gamma": gamma}, {"frames.gamma": 1.0}, {"frames.gamma": gamma})


def test_a_known_exponent_leaves_no_bias():
    """Grey levels that are made light first carry noise that is neither even nor centred."""
    hard_case({"camera.gamma": 2.2}, {"frames.gamma": 2.2}, {})


@pytest.mark.parametrize(
    "errors",
    [(5.0, 5.0), *(pytest.param(p, marks=pytest.mark.long) for p in ((5.0, -5.0), (-5.0, 0.0)))],
)
def test_quarter_wave_plates_five_degrees_off(errors):
    truth = dict(zip((INPUT, OUTPUT), errors, strict=True))
    values = hard_case(truth, {INPUT: 0.0, OUTPUT: 0.0}, truth)
    # the side to which a plate is turned is told by the stress's direction
    assert [values[INPUT], values[OUTPUT]] == pytest.approx(errors, abs=0.15)


@pytest.mark.parametrize("start", [pytest.param(1.0, marks=pytest.mark.long), 0.0])
def test_a_blur_of_two_pixels(start):
    truth = {"camera.blur_px": 2.0, "camera.vignette": 0.6}
    hard_case(truth, {"camera.blur_px": start}, {"camera.blur_px": 2.0})


def test_a_strong_vignette():
    hard_case({"camera.vignette": 0.6}, {}, {})


@pytest.mark.long
def test_all_of_it_together():
    truth = {"camera.vignette": 0.6, "camera.blur_px": 2.0, "camera.gamma": 2.2, INPUT: 5.0}
    free = {"camera.blur_px": 2.0, "frames.gamma": 2.2, INPUT: 5.0}
    hard_case(truth, {"camera.blur_px": 1.0, "frames.gamma": 1.0, INPUT: 0.0}, free)


def test_a_pixel_is_found_where_the_load_is_known():
    rng = np.random.default_rng(2)
    scene = random_contact(rng, "slide")[0].with_values(HALF_SIZE)
    keys = ("camera.pixel_mm", "camera.left_mm", "camera.top_mm", "friction.coefficient")
    wanted = {key: scene.get(key) for key in keys}
    start = scene.with_values({"camera.pixel_mm": 1.01 * scene.camera.pixel_mm})
    found = fitted(captured(scene, 9), start, keys)
    assert np.abs(pulls(found, wanted)).max() < 4.0
    assert found.standard_uncertainty[0] < 1e-4 * scene.camera.pixel_mm


@pytest.fixture
def unknown_tone(tmp_path):
    scene, true = random_contact(np.random.default_rng(5), "static")
    scene = scene.with_values({**HALF_SIZE, "camera.gamma": 2.2})
    path = tmp_path / "frame.tif"
    write_tiff(path, captured(scene, 4).image[None], pixel_mm=scene.camera.pixel_mm)
    return path, scene.with_values({"frames.gamma": "unknown"}), true


def test_the_command_frees_an_unknown_exponent_and_tells_it(unknown_tone):
    path, scene, true = unknown_tone
    found = fit(path, scene, list(true))
    gamma = found.to_json()["frames.gamma"]
    assert abs(gamma["value"] - 2.2) < 4.0 * gamma["standard_uncertainty"] < 0.05
    load = found.to_json()["load.normal_n"]
    assert abs(load["value"] / true["load.normal_n"] - 1.0) <= LOAD_BAR
    assert 0.9 < load["standard_uncertainty"] / load["cramer_rao_bound"] < 1.2
    assert found.scene.frames.gamma == gamma["value"]


def test_what_the_fringes_do_not_follow_is_refused(unknown_tone):
    path, scene, _ = unknown_tone
    for key in ("camera.brightness", "camera.gamma", "camera.noise_grey"):
        with pytest.raises(InputError, match=rf"{key} cannot be fitted"):
            fit(path, scene, ["load.normal_n", key])
    with pytest.raises(InputError, match=r"camera.pixel_mm cannot both be free"):
        fit(path, scene, ["load.normal_n", "camera.pixel_mm"])
