"""Unknowns held at their bounds, and unknowns that a frame does not tell."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from fitting.engine_frames import fit_jointly, prepared
from isochrome.errors import PhysicsError
from isochrome.fitting import fit_frame, make_sequence, segments
from isochrome.fitting.frame.unknowns import limits
from isochrome.scene import load_scene, parse_scene
from isochrome.simulation import simulate
from scene_texts import PAPER_CONTACT, SMALL_CAMERA

LOAD, WEAR = "load.normal_n", "wear.coefficient_mm2_per_n"
COLOUR = "polariscope.wavelength_nm"
NOISE = 3.0
STATIC = (
    PAPER_CONTACT + SMALL_CAMERA + f"noise_grey = {NOISE}\n[polariscope]\n{COLOUR[12:]} = 587.0\n"
)
SHAPE = (120, 160)


def one(seed):
    scene = parse_scene(STATIC)
    return scene, prepared(simulate(scene.with_values({"camera.seed": seed})).frames[0], scene)


# Held at a bound


def worn(distances, coefficient=2e-9):
    wear = f"[wear]\n{WEAR[5:]} = {coefficient}\ndistances_m = {list(distances)}\n"
    return parse_scene(STATIC + "[friction]\ncoefficient = 0.25\n" + wear)


def test_wear_that_a_new_contact_has_not_is_held_at_none_and_moves_nothing_else():
    """Noise alone would make this frame's scar heal; its load is what it is without any wear."""
    scene = worn([77.0], 5e-10)
    new = scene.with_values({WEAR: 0.0, "camera.seed": 2})
    data = prepared(simulate(new).frames[0], scene)
    unworn = fit_frame(data, scene.model_copy(update={"wear": None}), (LOAD,))
    found = fit_frame(data, scene, (LOAD, WEAR))
    assert found.values[1] == 0.0 and found.converged
    # a fit ends a fiftieth of a standard uncertainty from its least
    assert abs(found.values[0] - unworn.values[0]) < 0.05 * unworn.standard_uncertainty[0]
    # that none was found does not say how little it may be: the bound of one frame does
    assert found.standard_uncertainty[1] == pytest.approx(found.cramer_rao_bound[1], rel=0.15)
    assert 0.0 < found.standard_uncertainty[1] < 1e-12


def test_a_stretch_in_which_nothing_is_worn_is_told_as_that():
    """The wear pauses between two frames; what was worn before is no less for it."""
    pause = {"distance_m": (0.0, 31.0, 31.001, 77.0), "value": (2e-9, 2e-9, 0.0, 0.0)}
    scene = worn([31.0, 77.0])
    paused = simulate(scene.with_values({WEAR: pause, "camera.seed": 2}))
    frames = [prepared(image, scene) for image in paused.frames]
    sequence = segments(make_sequence(scene, 2, (WEAR,), ()))
    found = fit_jointly(frames, sequence, np.array([1.2e-9, 0.9e-9]), shape=SHAPE)
    first, second = found.values
    assert found.converged and found.chi == pytest.approx(1.0, abs=0.03)
    assert abs(first - 2e-9) < 4.0 * found.standard_uncertainty[0] < 2e-11
    # a scar does not heal: nothing below none, and none within its uncertainty
    assert 0.0 <= second < 4.0 * found.standard_uncertainty[1] < 2e-11

    # at its bound it is no unknown: what is left is both frames at the end of the first stretch
    same = worn([31.0, 31.0])
    alone = make_sequence(same, 2, (WEAR,), ())
    wanted = fit_jointly(frames, alone, np.array([1.9e-9]), shape=SHAPE)
    assert second == 0.0
    # two fits that end a thirtieth of a standard uncertainty from their least
    assert abs(first - wanted.values[0]) < 0.1 * wanted.standard_uncertainty[0]


# What a frame does not tell


def test_the_bound_of_what_a_frame_does_not_tell_is_infinite():
    """Ideal plates: the wavelength stands in the scene, and in no equation."""
    scene, data = one(0)
    alone = fit_frame(data, scene, (LOAD,), cold=False).cramer_rao_bound
    found = fit_frame(data, scene, (LOAD, COLOUR), cold=False)
    assert np.isinf(found.standard_uncertainty).tolist() == [False, True]
    limit = found.cramer_rao_bound
    assert limit[1] == np.inf
    assert limit[0] == pytest.approx(alone[0], rel=1e-6) and 0.0 < alone[0] < 0.01
    assert found.values[1] == 587.0 and not found.converged


def test_frames_together_say_what_they_do_not_tell():
    scene, data = one(0)
    own = make_sequence(scene, 1, (LOAD,), (COLOUR,))
    found = fit_jointly([data], own, np.array([44.0, 587.0]), shape=SHAPE)
    assert np.isinf(found.standard_uncertainty).tolist() == [False, True]
    assert np.isinf(found.cramer_rao_bound).tolist() == [False, True]
    assert not found.converged
    shared = make_sequence(scene, 1, (LOAD, COLOUR), ())
    with pytest.raises(PhysicsError, match=f"{COLOUR} does not change the fringes"):
        fit_jointly([data], shared, np.array([44.0, 587.0]), shape=SHAPE)


# Noise that is not as the weights hope


def test_frames_together_are_widened_by_the_noise_that_neighbours_share():
    scene = parse_scene(STATIC)
    ideal = scene.with_values({"camera.noise_grey": 0.0, "camera.bit_depth": None})
    clean = 255.0 * simulate(ideal).frames[0]
    rng = np.random.default_rng(3)
    noise = [gaussian_filter(rng.normal(0.0, 1.0, SHAPE), 1.0) for _ in range(2)]
    images = [np.clip(np.rint(clean + NOISE * n / n.std()), 0, 255).astype(np.uint8) for n in noise]
    sequence = make_sequence(scene, 2, (LOAD,), ())
    found = fit_jointly(
        [prepared(i, scene) for i in images], sequence, np.array([44.0]), shape=SHAPE
    )
    # in blocks of 4 x 4 pixels, noise whose correlation is exp(-d²/4), beside the rounding's
    lag = np.arange(4)[:, None] - np.arange(4)[None, :]
    share = 12.0 * NOISE**2 / (12.0 * NOISE**2 + 1.0)
    together = share * (np.exp(-(lag**2) / 4.0).sum() / 4.0) ** 2 + 1.0 - share
    wider = found.standard_uncertainty[0] / found.cramer_rao_bound[0]
    assert found.chi > 1.5  # differences of neighbours do not tell it
    # White's sum over the pixels scatters by some per cent, and the fit takes a little of it
    assert wider / found.chi == pytest.approx(np.sqrt(together), rel=0.15)


def test_a_place_moves_by_half_a_picture_at_most():
    """A frame that a disc does not explain led it off the picture, and no pixel was left of it."""
    scene = load_scene("ring").with_values({"camera.left_mm": -1.0, "camera.top_mm": 0.5})
    rows, cols = 40, 60
    ends = limits(scene, ("camera.left_mm", "load.normal_n", "camera.top_mm"), (rows, cols))
    start = np.array([scene.camera.left_mm, 0.0, scene.camera.top_mm])
    half = 0.5 * scene.camera.pixel_mm * np.array([cols, 0, rows])
    place = [0, 2]
    assert ends.low[place] == pytest.approx((start - half)[place])
    assert ends.high[place] == pytest.approx((start + half)[place])
    assert ends.low[1] > 0.0
