"""What a track says of itself: its uncertainties in the keys' own units, and when it is lost."""

import json
from dataclasses import replace
from itertools import repeat

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from fitting.engine_frames import light_of, prepared
from fitting.test_fit_track import FRICTION, LOAD, SHAPE, contact
from fitting.test_fit_track_worn import WEAR, worn_film
from isochrome.contact import (
    Drive,
    GrowingScar,
    contact_grid,
    make_site,
    wear,
    wear_course,
    worn_states,
)
from isochrome.fitting import Tracked, Tracker, placed, track
from isochrome.fitting.result import make_track, track_row
from isochrome.fitting.tracking.tracker import TrackedModel
from isochrome.fitting.tracking.worn_course import GROWTH, WornCourse
from isochrome.frames import Frame, NoiseModel
from isochrome.optics import expose
from isochrome.scene import load_scene

NOISE = 3.0
VARIANCE = NOISE**2 + 1.0 / 12.0
"""Of a grey level: the camera's noise, and the rounding to whole levels."""


@pytest.fixture(scope="module")
def clean():
    """Grey levels of a contact without noise, not rounded."""
    scene = contact()
    ideal = scene.with_values({"camera.bit_depth": None, "camera.noise_grey": 0.0})
    return 255.0 * expose(light_of(scene), ideal.camera)


def stored(grey):
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def odd(clean, chis, rng):
    """Frames with noise, and with waves in them that no contact and no lamp makes, by their chi."""
    row, col = np.mgrid[: SHAPE[0], : SHAPE[1]]
    waves = np.sqrt(2.0) * np.sin(0.3 * row + 0.2 * col)
    for chi in chis:
        size = np.sqrt((chi**2 - 1.0) * VARIANCE)
        yield stored(clean + size * waves + rng.normal(0.0, NOISE, SHAPE))


def tracker_of():
    return Tracker(placed(contact(), SHAPE), (LOAD,), bit_depth=8)


def tracked(tracker, images, distances=None):
    there = repeat(None) if distances is None else distances
    frames = (Frame(i, image, None, str(i)) for i, image in enumerate(images))
    return [tracker.track(frame, s) for frame, s in zip(frames, there, strict=False)]


# Lost: chi over that of the last frame that was searched for


def test_a_track_is_lost_from_a_chi_of_1_1_over_that_of_the_last_search(clean):
    # chi of 14400 pixels scatters by 0.006: each is five of these or more from 1.1 of the last
    chis = (1.0, 1.06, 1.14, 1.20, 1.0, 1.31)
    found = tracked(tracker_of(), odd(clean, chis, np.random.default_rng(5)))
    assert [one.chi for one in found] == pytest.approx(chis, abs=0.03)
    # 1.14 > 1.1 x 1.00, 1.20 < 1.1 x 1.14, 1.31 > 1.1 x 1.14
    assert [one.searched for one in found] == [True, False, True, False, False, True]


def test_a_track_that_goes_on_from_its_state_is_lost_where_it_would_have_been(clean):
    before, after = (odd(clean, chis, np.random.default_rng(6)) for chis in ((1.13,), (1.19, 1.30)))
    first, again = tracker_of(), tracker_of()
    tracked(first, before)
    again.resume(json.loads(json.dumps(first.state())))
    # 1.19 is less than 1.1 of the 1.13 that the search left, and 1.30 is more
    assert [one.searched for one in tracked(again, after)] == [False, True]


def test_a_track_is_widened_where_the_noise_of_neighbours_is_alike(clean):
    """Smoothed by a lens or a codec: 40 frames believed 2.6 times too well, were it not told."""
    rng = np.random.default_rng(7)
    images = []
    for _ in range(40):
        noise = gaussian_filter(rng.normal(0.0, 1.0, SHAPE), 1.5)
        images.append(stored(clean + NOISE * noise / noise.std()))
    found = tracked(tracker_of(), images)
    z = [(one.values[0] - 44.0) / one.standard_uncertainty[0] for one in found]
    # of every second pixel in blocks of 4 x 4 the correlation tells all but a factor of 1.24; the
    # RMS of 40 pulls scatters by a ninth
    assert 1.24 * 0.67 < np.sqrt(np.mean(np.square(z))) < 1.24 * 1.33


# Noise, and what a frame does not tell


def test_a_cameras_noise_is_told_again_after_250_frames():
    """From the second frame on the camera's noise is four fifths of what it was in the first."""
    size = {"camera.width_px": 90, "camera.height_px": 60, "camera.pixel_mm": 0.0417}
    scene = contact().with_values(size)
    light, rng = light_of(scene), np.random.default_rng(8)
    frames = [
        expose(light, scene.with_values({"camera.noise_grey": grey}).camera, rng=rng)
        for grey in [NOISE, *[0.8 * NOISE] * 279]
    ]
    chi = track(np.stack(frames), scene, (LOAD,), as_stated=True).chi
    # a frame's chi scatters by 0.03 here, and the mean of 29 and more by 0.006; the noise that a
    # frame tells of itself, by 0.02
    assert np.mean(chi[1:250]) == pytest.approx(0.8, abs=0.04)
    assert np.mean(chi[251:]) == pytest.approx(1.0, abs=0.05)


def test_a_tracked_key_that_a_frame_does_not_tell_has_no_uncertainty_but_infinity():
    """Nothing rubs in a contact that is held without a tangential force: friction is not seen."""
    scene = contact().with_values({"load.tangential_n": 0.0})
    light = light_of(scene)
    frames = [expose(light, scene.camera, rng=np.random.default_rng(seed)) for seed in range(2)]
    keys = (LOAD, FRICTION)
    found = tracked(Tracker(placed(scene, SHAPE), keys, bit_depth=8), frames)
    for one in found:
        assert np.isinf(one.standard_uncertainty).tolist() == [False, True]
        assert np.isinf(one.cramer_rao_bound).tolist() == [False, True]
        assert abs(one.values[0] - 44.0) < 4.0 * one.standard_uncertainty[0]


def row(index, values, spread, *, chi=1.0, searched=False):
    found = Tracked(
        values=values, standard_uncertainty=spread, cramer_rao_bound=spread, chi=chi,
        searched=searched,
    )  # fmt: skip
    return track_row(index, None, (LOAD, FRICTION), found)


def test_the_mean_that_the_scene_gets_is_of_the_frames_that_tell_a_key():
    rows = [
        row(0, [40.0, 0.1], [0.1, np.inf], searched=True),
        row(1, [44.0, 0.2], [0.1, 0.01]),
        row(2, [np.nan, np.nan], [np.nan, np.nan], searched=True, chi=np.nan),
        row(3, [48.0, 0.4], [0.1, 0.01], searched=True, chi=1.31),
    ]
    result = make_track(rows, (LOAD, FRICTION), contact())
    assert result.scene.load.normal_n == 44.0
    assert result.scene.friction.coefficient == pytest.approx(0.3)
    stated = contact().with_values({"load.normal_n": {"value": 44, "standard_uncertainty": 1}})
    assert (
        "stated uncertainties of load.normal_n are not in"
        in (make_track(rows, (LOAD, FRICTION), stated).warnings[0])
    )
    # each frame is told of once, and for what it is
    assert [text.split(":")[0] for text in result.warnings] == ["frame 2", "frame 3", "frame 3"]
    for text, said in zip(
        result.warnings, ("not in this frame", "no track to follow", "bias"), strict=True
    ):
        assert said in text


def test_pixels_near_black_and_white_are_not_looked_at(clean):
    scene = placed(contact(), SHAPE)
    model = TrackedModel(
        WornCourse(scene, (LOAD,)), prepared(stored(clean), scene), full=255.0, held=(),
        noise=NoiseModel(NOISE**2, 0.0, 0.0), usual_load_n=44.0,
    )  # fmt: skip
    every = model.pixels.size
    light = np.linspace(-0.02, 1.02, every).astype(np.float32)
    model.look(light)
    # 3.5 standard deviations: there one of 4000 is cut
    room = 3.5 * NOISE / 255.0
    assert 0.8 * every < model.pixels.size < every
    clear = np.count_nonzero(abs(light - 0.5) < 0.5 - room)
    assert abs(model.pixels.size - clear) <= 2  # by rounding


LINE = 44.0 / 4.0
"""Load, N/mm."""


def worn(*distances):
    """Scars of a contact that has slid some distances (m), their doses, and its grid of 5 um."""
    given = {"wear.distances_m": [*distances], FRICTION: 0.2, "friction.static_state_first": False}
    scene = load_scene("line-contact-wear").with_values(
        given | {LOAD: 44.0, "numerics.spacing_mm": 0.005, "numerics.tolerance": 1e-5}
    )
    history, stops = wear_course(scene)
    largest = 2.0 * float(history.dose_mm_per_mpa[-1])
    site = make_site(scene, contact_grid(scene, largest_dose_mm_per_mpa=largest))
    scars = [
        GrowingScar(state.wear_depth_mm, Drive(LINE, 0.2), state.pressure_mpa)
        for state in worn_states(site, history, stops)
    ]
    return site, scars, [stop.dose_mm_per_mpa for stop in stops]


def test_a_scar_that_is_stepped_on_is_the_one_worn_in_one_go(monkeypatch):
    """From frame to frame, each a step of a hundredth; steps of the first order are 60."""
    site, (scar, whole), (begun, end) = worn(40.0, 44.0)
    take, steps = wear._advance, []
    monkeypatch.setattr(wear, "_advance", lambda *given: steps.append(1) or take(*given))
    first, count = scar, 10
    for _ in range(count):
        scar = scar.grown(site, (end - begun) / count, Drive(LINE, 0.2), tolerance=GROWTH)
    grown = (whole.depth_mm - first.depth_mm).max()
    error = np.sqrt(np.mean((scar.depth_mm - whole.depth_mm) ** 2)) / grown
    # mesh and grid differ by 2e-4; steps of the first order leave 4e-4
    assert error < 3e-4 and len(steps) <= 25  # 18


def test_a_scar_goes_on_from_its_plain_numbers_as_it_would_have():
    site, (scar, _), _ = worn(40.0, 44.0)
    scar = scar.grown(site, 1e-6, Drive(1.01 * LINE, 0.2), tolerance=GROWTH)
    again = GrowingScar.from_json(json.loads(json.dumps(scar.to_json())))
    one, other = (s.grown(site, 1e-6, Drive(LINE, 0.2), tolerance=GROWTH) for s in (scar, again))
    np.testing.assert_array_equal(one.depth_mm, other.depth_mm)


def test_a_load_that_was_corrected_is_no_jump_that_steps_follow(monkeypatch):
    """No step, however short, foresees it: 60 of 69 steps once shrank for it."""
    site, (scar, _), (begun, end) = worn(40.0, 44.0)
    dose, steps = 0.1 * (end - begun), []
    scar = scar.grown(site, dose, Drive(LINE, 0.2), tolerance=GROWTH)
    take = wear._advance
    monkeypatch.setattr(wear, "_advance", lambda *given: steps.append(1) or take(*given))
    replace(scar, drive=Drive(1.02 * LINE, 0.2)).grown(
        site, dose, Drive(1.03 * LINE, 0.2), tolerance=GROWTH
    )
    assert len(steps) <= 12  # 9


def test_a_scar_grows_under_the_loads_on_its_way():
    """From half of the load to all of it: the worn area is their mean times the dose."""
    site, _, (dose,) = worn(44.0)
    unworn = GrowingScar(np.zeros(site.grid.nodes), Drive(0.5 * LINE, 0.2))
    scar = unworn.grown(site, dose, Drive(LINE, 0.2), tolerance=1e-4)
    area = scar.depth_mm.sum() * site.grid.spacing_mm
    assert area == pytest.approx(0.75 * LINE * dose, rel=5e-4)


def test_a_scar_grows_on_where_the_load_in_hand_touches_it():
    """11 N/mm wore it, 6 N/mm are on it: the half-width of a contact goes with the root of these.
    Worn on by loads of long ago, what a frame says of its wear was wrong by half."""
    site, (scar,), (dose,) = worn(0.1)
    on = scar.grown(site, 0.01 * dose, Drive(6.0, 0.2), tolerance=GROWTH)
    more = on.grown(site, 0.5 * dose, Drive(6.0, 0.2), tolerance=GROWTH).depth_mm - on.depth_mm
    wide = [np.count_nonzero(depth > 0.05 * depth.max()) for depth in (scar.depth_mm, more)]
    assert wide[1] / wide[0] == pytest.approx(np.sqrt(6.0 / 11.0), rel=0.03)


# Each key in its own unit


def test_a_tracked_wear_coefficient_has_its_uncertainty_in_its_own_unit():
    count = 8
    distance = 77.0 + 0.05 * np.arange(count)
    friction = np.linspace(0.2, 0.21, count)
    course = distance, np.full(count, 44.0), friction
    frames, start = worn_film(*course, np.random.default_rng(3))
    tracker = Tracker(placed(start, SHAPE), (FRICTION, WEAR), bit_depth=8)
    found = tracked(tracker, frames, distance.tolist())
    truth = np.stack([friction, np.full(count, 2e-9)], axis=1)
    error = np.array([one.values for one in found]) - truth
    spread, bound = (
        np.array([getattr(one, name) for one in found])
        for name in ("standard_uncertainty", "cramer_rao_bound")
    )
    each = np.sqrt(np.mean((error / spread) ** 2, axis=0))
    # eight pulls of each key, whose RMS scatters by a quarter: over six seeds it is 0.6 to 1.6
    assert np.all((each > 0.3) & (each < 2.0)), each
    # White's uncertainty of 14400 pixels scatters by some per cent about the bound
    assert spread / bound == pytest.approx(np.ones_like(bound), abs=0.15)
