"""Unknowns of a scene from rendered frames, and the quick simulation that finds them."""

import numpy as np
import pytest

from fitting.engine_frames import within, written
from isochrome.errors import InputError, PhysicsError
from isochrome.fitting import SceneRenderer, fit, scene_at, with_numerics
from isochrome.scene import parse_scene
from scene_texts import PAPER_CONTACT, SMALL_CAMERA

STATIC = PAPER_CONTACT + SMALL_CAMERA + "noise_grey = 3.0\nseed = 11\n"
SLIDING = STATIC + "\n[friction]\ncoefficient = 0.25\n"
WORN = SLIDING + "\n[wear]\ncoefficient_mm2_per_n = 2e-9\ndistances_m = [77.0, 155.0]\n"


def test_a_frame_is_fitted_that_stands_on_a_whole_pixel_of_the_fits_grid(tmp_path):
    """Where the fit starts: it is no trap."""
    scene = parse_scene(SLIDING)
    keys = ["load.normal_n", "friction.coefficient", "camera.left_mm", "camera.top_mm"]
    found = fit(written(tmp_path, scene), scene, keys)
    for key in keys:
        within(found.shared[key], scene.get(key))
    assert found.shared["load.normal_n"]["standard_uncertainty"] < 0.01
    assert found.chi == pytest.approx(1.0, abs=0.05) and found.warnings == ()


def test_keys_that_the_frame_cannot_tell_apart_are_refused_by_their_correlation(tmp_path):
    # Modulus and radius enter together: the half-width follows from radius / contact modulus.
    scene = parse_scene(STATIC)
    keys = ["specimen.young_gpa", "indenter.radius_mm"]
    with pytest.raises(PhysicsError, match=r"cannot be told apart .*correlation.*; fix one"):
        fit(written(tmp_path, scene), scene, keys)


@pytest.mark.parametrize("other", ["specimen.fringe_value_n_per_mm", "specimen.thickness_mm"])
def test_keys_with_the_same_effect_as_the_load_are_refused_before_the_frames_are_read(other):
    with pytest.raises(InputError, match="cannot both be free"):
        fit("frames-that-are-not-there.tif", parse_scene(STATIC), ["load.normal_n", other])


# The quick simulation against the direct one


def test_a_cached_signal_is_the_fresh_one_whatever_came_between():
    scene = with_numerics(parse_scene(SLIDING), nodes_per_pixel=2, tolerance=1e-3, room=1.4)
    renderer = SceneRenderer(scene, (120, 160), stride=2)
    others = [{"load.normal_n": 40.0 + k} for k in range(10)]
    others += [{"friction.coefficient": 0.1}, {"specimen.fringe_value_n_per_mm": 10.0}]
    others += [{"camera.blur_px": 2.0}, {"camera.blur_px": 1.0}]
    others += [{"camera.left_mm": -1.2}, {"camera.left_mm": -2.0, "camera.top_mm": 0.9}]
    first = renderer.signal(scene)
    for values in others:
        moved = scene.with_values(values)
        fresh = SceneRenderer(moved, (120, 160), stride=2).signal(moved)
        again = renderer.signal(moved)
        # Waves about two references a shift apart repeat elsewhere: 2e-5 to 6e-5 of the light.
        assert np.abs(again - fresh)[8:].max() < (2e-4 if "camera.left_mm" in values else 1e-6)
    back = SceneRenderer(scene, (120, 160), stride=2)
    assert np.array_equal(back.signal(scene), first)


@pytest.mark.parametrize("stride", [1, 2])
def test_what_a_lens_shows_more_of_is_made_with_the_grid_that_it_needs(stride):
    """The field was one of the size that a smaller roll needs, and went on level beyond it."""
    scene = parse_scene(SLIDING)
    renderer = SceneRenderer(scene, (120, 160), stride=stride)
    for roll in (0.0, 0.5, 8.0, 0.5):
        rolled = scene.with_values({"camera.roll_deg": roll})
        fresh = SceneRenderer(rolled, (120, 160), stride=stride).signal(rolled)
        # waves about two references repeat elsewhere
        assert np.abs(renderer.signal(rolled) - fresh).max() < 2e-4, roll


@pytest.mark.parametrize("key", ["wear.coefficient_mm2_per_n", "load.normal_n"])
def test_a_worn_signal_has_a_derivative_that_a_fit_can_use(key):
    """Goes wrong if nodes flip into contact, or steps change, as a value moves a little."""
    numerics = {"spacing_mm": 0.025 / 4, "tolerance": 1e-4}
    scene = scene_at(parse_scene(WORN), 77.0)
    scene = scene.with_values({f"numerics.{k}": v for k, v in numerics.items()})
    renderer = SceneRenderer(scene, (120, 160))
    slopes = []
    for share in (1e-3, 1e-4):
        ahead, behind = (
            renderer.signal(scene.with_values({key: scene.get(key) * (1.0 + sign * share)}))
            for sign in (1.0, -1.0)
        )
        slopes.append((ahead - behind)[2:] / (2.0 * share))
    # 1 %: single precision over the smaller step, and steps that adapt; a fit's least squares need
    # no better
    difference = (slopes[0] - slopes[1]).astype(float)
    assert np.sqrt(np.mean(difference**2)) < 0.01 * np.sqrt(np.mean(slopes[0].astype(float) ** 2))
