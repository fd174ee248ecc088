"""Thresholds of a fit: what is said of it, what is refused, and which pixels it looks at."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fitting.engine_frames import prepared
from isochrome import fitting
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import HALF, Minimum, PixelLight, Pixels, frame_light, is_explained
from isochrome.fitting.api import asked_for
from isochrome.fitting.search import search_frame
from isochrome.frames import Frame, to_linear
from isochrome.output import write_tiff
from isochrome.scene import dump_scene, parse_scene
from isochrome.simulation import simulate
from scene_texts import PAPER_CONTACT, SMALL_CAMERA, camera_text, disc_text

LOAD, LEFT, PIXEL = "load.normal_n", "camera.left_mm", "camera.pixel_mm"
STATIC = PAPER_CONTACT + SMALL_CAMERA + "noise_grey = 3.0\n"


def scene(**values):
    return parse_scene(STATIC).with_values({k.replace("__", "."): v for k, v in values.items()})


@pytest.fixture(scope="module")
def image():
    return simulate(scene()).frames[0]


@pytest.fixture(scope="module")
def alone(image):
    """One frame's fit of load and place."""
    return fitting.fit_frame(prepared(image, scene()), scene(), (LOAD, LEFT))


def result_of(*fits):
    """What is reported of frames that share nothing."""
    sequence = fitting.make_sequence(scene(), len(fits), (), (LOAD, LEFT))
    return fitting.make_result(fitting.fit_of_each(sequence, fits), list(fits))


def test_a_fit_with_nothing_to_say_says_nothing(alone):
    assert result_of(alone, alone).warnings == ()


@pytest.mark.parametrize(("chi", "said"), [(1.29, False), (1.31, True)])
def test_a_model_that_does_not_describe_a_frame_is_told_from_a_chi_of_1_3(alone, chi, said):
    warnings = result_of(alone, replace(alone, chi=chi)).warnings
    assert any("frame 1" in text and "does not describe" in text for text in warnings) is said


@pytest.mark.parametrize(("chi", "said"), [(1.09, False), (1.11, True)])
def test_tractions_are_recommended_from_a_chi_of_1_1(alone, chi, said):
    told = asked_for(result_of(alone, replace(alone, chi=chi)))
    assert any("frame 1;" in text and "--tractions" in text for text in told) is said


@pytest.mark.parametrize(("share", "said"), [(1.04, True), (1.06, False)])
def test_other_solutions_are_told_that_fit_within_five_per_cent_as_well(alone, share, said):
    rival = Minimum(alone.values * 1.1, share * alone.chi)
    result = result_of(alone, replace(alone, others=(rival,)))
    assert (
        any(
            "frame 1: 1 other solution of nearly the same misfit" in text
            for text in result.warnings
        )
        is said
    )
    assert [len(found) for found in result.other_minima] == [0, int(said)]


def test_one_frame_that_did_not_converge_is_enough_to_be_told(alone):
    warnings = result_of(alone, replace(alone, converged=False)).warnings
    assert any(text.startswith("the fit did not converge fully; ") for text in warnings)


def test_a_smooth_stress_is_kept_that_explains_half_of_what_chi_squared_is_too_large_by():
    before = np.sqrt(1.8)
    assert is_explained(before, np.sqrt(1.39), HALF)
    assert not is_explained(before, np.sqrt(1.41), HALF)


def test_the_band_of_a_figure_is_two_standard_uncertainties_wide(alone):
    spread = alone.standard_uncertainty
    figure = fitting.over_distance_figure("a contact", result_of(alone, alone))
    for axis, u, value in zip(figure.axes[:2], spread, alone.values, strict=True):
        heights = axis.collections[0].get_paths()[0].vertices[:, 1]
        assert np.ptp(heights) == pytest.approx(4.0 * u, rel=1e-6)
        assert np.mean([heights.min(), heights.max()]) == pytest.approx(value, rel=1e-9)
        assert "band ± 2 standard uncertainties" in figure.get_suptitle()


def test_an_uncertainty_that_a_file_does_not_hold_is_infinite(tmp_path, alone):
    """JSON knows no infinity: what was not told before is not told after either."""
    result = result_of(alone, alone)
    told = result.to_json()
    told["frames"][1][LEFT] |= {"standard_uncertainty": None, "cramer_rao_bound": None}
    (tmp_path / "fit.json").write_text(json.dumps(told), "utf-8")
    (tmp_path / "scene.toml").write_text(dump_scene(result.scene), "utf-8")
    again = fitting.restore_fit(tmp_path, scene())
    assert again.frames[0] == result.frames[0]
    assert again.frames[1][LEFT]["standard_uncertainty"] == np.inf
    assert again.frames[1][LEFT]["cramer_rao_bound"] == np.inf
    assert again.frames[1][LEFT]["value"] == result.frames[1][LEFT]["value"]


@pytest.mark.parametrize(("correlation", "refused"), [(0.9994, False), (-0.9996, True)])
def test_keys_are_refused_as_alike_from_a_correlation_of_0_9995(correlation, refused):
    spread = np.array([2.0, 1e-9])
    covariance = np.outer(spread, spread) * [[1.0, correlation], [correlation, 1.0]]
    information = np.linalg.inv(covariance)
    if not refused:
        return fitting.refuse_alike((LOAD, LEFT), information)
    with pytest.raises(PhysicsError, match=rf"{LOAD} and {LEFT} .*correlation -0.9996"):
        fitting.refuse_alike((LOAD, LEFT), information)
    return None


def test_what_is_stated_in_common_makes_no_two_values_alike():
    """Two frames' loads, each sure to 1e-3 but for a pixel that no frame knows so well: 0.9999."""
    information = np.diag([1e6, 1e6, 2e6 + 1.0])
    information[:2, 2] = information[2, :2] = -1e6
    spread = np.linalg.inv(information)
    assert spread[0, 1] / spread[0, 0] > 0.9999
    with pytest.raises(PhysicsError, match="cannot be told apart"):
        fitting.refuse_alike((LOAD, LOAD, PIXEL), information)
    fitting.refuse_alike((LOAD, LOAD, PIXEL), information, (PIXEL,))


def test_a_key_is_refused_where_no_frame_tells_it_and_not_where_one_does(alone):
    untold = replace(alone, standard_uncertainty=np.array([0.01, np.inf]))
    fitting.refuse_undetermined(LEFT, [untold, alone])
    with pytest.raises(PhysicsError, match=f"{LEFT} does not change the fringes"):
        fitting.refuse_undetermined(LEFT, [untold, untold])


def test_a_frames_distance_is_its_time_by_the_speed():
    frame = Frame(0, np.zeros((2, 2)), 2.5, "film")
    assert fitting.timed_distance(frame, 257.7) == pytest.approx(0.64425)
    with pytest.raises(InputError, match="has no time"):
        fitting.timed_distance(replace(frame, time_s=None), 257.7)


# Which pixels are looked at


def test_what_a_no_load_frame_does_not_show_is_not_fitted(image):
    blank = np.full(image.shape, 30, np.uint8)
    dark, bright = (to_linear(blank + k, bit_depth=8, allow_blank=True) for k in (0, 90))
    dark.valid[10, 20] = bright.valid[30, 40] = False
    plain = prepared(image, scene())
    data = prepared(image, scene(), no_load=(dark, bright))
    assert plain.valid[10, 20] and plain.valid[30, 40]
    assert np.argwhere(plain.valid & ~data.valid).tolist() == [[10, 20], [30, 40]]


def test_light_read_with_another_exponent_has_the_noise_of_that_light(image):
    data = prepared(image, scene()).toned(2.2)
    level = data.raw > 5.0 * data.raw_sigma  # black itself has no slope
    up, down = ((data.raw + s * 0.1 * data.raw_sigma)[level] ** 2.2 for s in (1.0, -1.0))
    # a tenth of the noise up and down: its cube is some 1e-3 of it
    np.testing.assert_allclose(data.sigma[level], (up - down) / 0.2, rtol=5e-3)


def test_a_disc_is_not_looked_at_near_its_rim_and_its_loads():
    text = disc_text(100.0, fringe_value=14.6, thickness_mm=4.0, diameter_mm=10.0)
    disc = parse_scene(text + camera_text(120, 120, 0.1, left_mm=-6.0, top_mm=-1.0, bit_depth=8))
    seen = fitting.fit_region(disc, (120, 120), 1, 0.0)
    x = -6.0 + 0.1 * (np.arange(120) + 0.5)
    z = (-1.0 + 0.1 * (np.arange(120) + 0.5))[:, None]
    rim = np.hypot(x, z - 5.0)
    loads = np.minimum(np.hypot(x, z), np.hypot(x, z - 10.0))
    assert not seen[loads < 1.45].any() and not seen[rim > 4.75].any()
    assert seen[(loads > 1.55) & (rim < 4.65)].all()


def test_pixels_whose_model_is_near_black_or_white_are_left_out():
    level = np.linspace(0.0, 1.0, 501)
    light = PixelLight(frame_light((1, level.size)), np.ones((1, level.size), bool))
    pixels = Pixels(level, np.full(level.size, 50.0), light, 2.0)
    # 3.5 standard deviations of 0.02 of the stored level, which is the root of the light
    clear = fitting.clear_of_ends(pixels, level**2, 2.0)
    np.testing.assert_array_equal(clear, np.abs(level - 0.5) < 0.5 - 0.07 - 1e-9)


# A search that is never left out


@pytest.mark.parametrize(("noise", "scanned"), [(3.0, False), (13.0, True)])
def test_a_scene_is_taken_at_its_word_where_the_light_is_25_times_the_noise(noise, scanned, scans):
    """In more noise a wrong solution looks as good: all loads are tried there, whatever chi is."""
    seen = scene(camera__noise_grey=noise, load__bulk_mpa=0.0)
    data = prepared(simulate(seen).frames[0], seen)
    found = search_frame(data, seen, (LOAD, LEFT, "load.bulk_mpa"))
    assert bool(scans) is scanned
    assert found[0].chi < 1.1


# Frames without fringes


def noise_alone(shape, seed):
    grey = np.random.default_rng(seed).normal(120.0, 3.0, shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", [0, 1])
def test_in_a_frame_of_noise_alone_no_fringes_are_found(image, seed):
    """Somewhere in a search noise follows fringes a little, and by half of all chances upwards."""
    data = prepared(noise_alone(image.shape, seed), scene())
    found = fitting.fit_frame(data, scene(), (LOAD, LEFT))
    assert not found.positive


def test_fringes_of_a_third_of_the_noise_are_found():
    dim = scene(camera__brightness=0.004)  # a grey level, and noise of three
    found = fitting.fit_frame(prepared(simulate(dim).frames[0], dim), dim, (LOAD, LEFT))
    assert found.positive
    assert abs(found.values[0] - 44.0) < 4.0 * found.standard_uncertainty[0] < 3.0


def test_a_frame_after_one_without_fringes_is_looked_for_from_the_scene(tmp_path, image):
    frames = np.stack([image, noise_alone(image.shape, 1), image])
    write_tiff(film := tmp_path / "film.tif", frames, pixel_mm=0.025)
    begun = scene(load__normal_n=46.0)
    found = fitting.fit(film, begun, (), per_frame=(LOAD,), follow=True)
    assert any("frame 1: the scene's fringes are not in it" in text for text in found.warnings)
    sequence = fitting.make_sequence(begun, 3, (), (LOAD,))
    work = fitting.FrameWork(fitting.PreparedFrames(film, begun), sequence, follow=True)
    assert work(1, 2, {LOAD: 44.0}).left is None  # noise's own values would be a start's like any
    first, _, last = (own[LOAD] for own in found.frames)
    # two fits of the same pixels, each ended a fiftieth of a standard uncertainty from its least
    assert last["value"] == pytest.approx(first["value"], abs=0.1 * first["standard_uncertainty"])
    assert found.frame_chi[2] == pytest.approx(found.frame_chi[0], rel=1e-3)
