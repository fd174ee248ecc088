"""Several frames of one bench: what belongs to the apparatus is asked of all of them together.
Truth is `outside_camera`, which shares no code with our optics and camera."""

import numpy as np
import pytest

from fitting.engine_frames import prepared
from fitting.sliding_bench import bench
from fitting.test_fit_causes import Defects, frame
from isochrome import fit, track
from isochrome.estimation import Unevenness
from isochrome.fitting import Apparatus, Tracker, placed
from isochrome.frames import Frame
from isochrome.output import write_tiff

LOAD, FRICTION, PLACE = "load.normal_n", "friction.coefficient", ["camera.left_mm", "camera.top_mm"]
LOADS, MU = (44.0, 47.3, 51.0), 0.187
FOLLOWED = np.linspace(44.0, 46.0, 6)
ROLL = "camera.roll_deg"

DEFECTS = [
    ("camera.distortion", {"distortion": 0.005}, 0.005, 1e-3),
    (ROLL, {"roll_deg": 0.5}, 0.5, 0.05),
    ("frames.gamma", {"gamma": 1.1}, 1.1, 5e-3),
]
"""Key, what is wrong, its value, and four or five of its uncertainties in pictures this small."""

SMALL, LARGER = (124, 165), (247, 330)
"""In small pictures the truth's own grid of half pixels turns them by some 0.03 degree."""


def captured(folder, defects, loads, seed=1, size=()):
    """The frames of some loads, and the scene that a fit begins with."""
    true = bench(*(size or SMALL))
    images = [
        frame(true.with_values({LOAD: float(load)}), defects, 10 * seed + i)
        for i, load in enumerate(loads)
    ]
    write_tiff(folder / "frames.tif", np.stack(images), pixel_mm=true.camera.pixel_mm)
    return folder / "frames.tif", true.with_values({LOAD: 46.0, FRICTION: 0.2})


def joint(folder, defects, *, size=(), **options):
    path, scene = captured(folder, defects, LOADS, size=size)
    return fit(path, scene, [FRICTION, *PLACE], per_frame=[LOAD], **options)


def pulls(found):
    """Of the frames' loads, and of the friction that they share."""
    loads = zip((one[LOAD] for one in found.frames), LOADS, strict=True)
    pairs = [*loads, (found.shared[FRICTION], MU)]
    return np.array([(v["value"] - true) / v["standard_uncertainty"] for v, true in pairs])


@pytest.mark.long
def test_frames_that_are_what_their_scene_says_ask_for_nothing(tmp_path):
    found = joint(tmp_path, Defects())
    assert found.warnings == () and set(found.shared) == {FRICTION, *PLACE}
    # one noise alone, of three loads and a friction that share the place
    assert np.abs(pulls(found)).max() < 4.0


@pytest.mark.study
@pytest.mark.parametrize(("key", "defects", "value", "bar"), DEFECTS)
def test_what_the_frames_share_is_one_unknown_of_all(tmp_path, key, defects, value, bar):
    found = joint(tmp_path, Defects(**defects), size=LARGER if key == ROLL else ())
    assert set(found.shared) == {FRICTION, *PLACE, key}
    assert found.shared[key]["value"] == pytest.approx(value, abs=bar)
    assert found.scene.get(key) == found.shared[key]["value"]
    assert np.abs(pulls(found)).max() < 4.0 and found.chi < 1.02
    assert found.warnings[0].startswith("the frames show ") and f"{key} = " in found.warnings[0]


@pytest.mark.long
def test_what_the_scene_states_is_held_where_that_is_wanted(tmp_path):
    found = joint(tmp_path, Defects(roll_deg=0.5), as_stated=True)
    assert set(found.shared) == {FRICTION, *PLACE} and not found.scene.get(ROLL)
    assert np.abs(pulls(found)).max() > 10.0  # what the roll does to load and friction


@pytest.mark.study
@pytest.mark.parametrize("defects", [{"spot": 0.5}, {"bar": 0.4}])
def test_light_that_is_uneven_is_as_rich_in_all_frames(tmp_path, defects):
    found = joint(tmp_path, Defects(**defects))
    assert set(found.shared) == {FRICTION, *PLACE} and found.chi < 1.03
    assert np.abs(pulls(found)).max() < 4.0
    assert "the light is more uneven than a quadratic" in found.warnings[0]


@pytest.mark.long
def test_dust_is_left_out_of_all_frames(tmp_path):
    found = joint(tmp_path, Defects(dust=3))  # at other places in each frame
    assert "of the pixels were left out" in found.warnings[0] and found.chi < 1.05
    assert np.abs(pulls(found)).max() < 4.0


@pytest.mark.study
def test_two_causes_at_once(tmp_path):
    found = joint(tmp_path, Defects(roll_deg=-0.5, spot=0.3), size=LARGER)
    assert ROLL in found.shared and "the light is more uneven" in " ".join(found.warnings)
    assert np.abs(pulls(found)).max() < 4.0


def followed(folder, defects, *, size=(), **options):
    path, scene = captured(folder, defects, FOLLOWED, seed=3, size=size)
    return track(path, scene, [LOAD, FRICTION, *PLACE], **options)


def track_pulls(found):
    truth = np.column_stack([FOLLOWED, np.full(len(FOLLOWED), MU)])
    return (found.values[:, :2] - truth) / found.standard_uncertainty[:, :2]


@pytest.mark.long
def test_a_track_of_what_its_scene_says_asks_for_nothing(tmp_path):
    found = followed(tmp_path, Defects())
    assert found.warnings == () and np.abs(track_pulls(found)).max() < 4.0
    assert not any(found.scene.get(key) for key, *_ in DEFECTS[:2])


@pytest.mark.study
@pytest.mark.parametrize(("key", "defects", "value", "bar"), DEFECTS)
def test_what_a_videos_frames_share_is_held_through_the_track(tmp_path, key, defects, value, bar):
    found = followed(tmp_path, Defects(**defects), size=LARGER if key == ROLL else ())
    (said,) = found.warnings
    assert said.startswith("asked of frame 0, and held in all frames: the frame shows ")
    assert f"{key} = " in said and found.scene.get(key) == pytest.approx(value, abs=bar)
    assert found.searched == (0,) and np.abs(track_pulls(found)).max() < 4.0


@pytest.mark.study
def test_rich_light_is_held_through_the_track(tmp_path):
    found = followed(tmp_path, Defects(spot=0.5))
    assert "the light is more uneven than a quadratic" in " ".join(found.warnings)
    assert found.chi.max() < 1.03 and np.abs(track_pulls(found)).max() < 4.0


@pytest.mark.long
def test_a_track_that_is_held_to_its_scene_is_off(tmp_path):
    found = followed(tmp_path, Defects(roll_deg=0.5), as_stated=True)
    assert not found.scene.get(ROLL) and np.abs(track_pulls(found)).min() > 8.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("key", "value", "spread"),
    [pytest.param(ROLL, 0.5, 0.1, marks=pytest.mark.study), ("frames.gamma", 1.1, 0.02)],
)
def test_a_tracked_value_has_the_uncertainty_of_what_is_held(key, value, spread):
    """As much as it moves when that is held one standard uncertainty beside its value."""
    keys = (LOAD, FRICTION, *PLACE)
    image = frame(bench(*SMALL), Defects(**{key.split(".")[1]: value}), 7)
    shot = Frame(index=0, image=image, time_s=None, name="bench")

    def tracked(at, covariance=None):
        scene = placed(bench(*SMALL).with_values({key: at}), image.shape)
        held = Apparatus(scene=scene, keys=(key,) * (covariance is not None), covariance=covariance)
        return Tracker(scene, keys, bit_depth=8, apparatus=held).track(shot, None)

    alone = tracked(value)
    whole = tracked(value, np.array([[spread**2]]))
    moved = (tracked(value + spread).values - tracked(value - spread).values) / 2.0
    added = np.sqrt(whole.standard_uncertainty**2 - alone.standard_uncertainty**2)
    assert np.array_equal(whole.values, alone.values)
    # each value is found to 0.05 of its noise, and the shift is not quite linear over 2 u
    assert added == pytest.approx(
        np.abs(moved), rel=0.1, abs=0.2 * alone.standard_uncertainty.max()
    )


def test_a_held_light_and_pixels_are_those_of_every_frame():
    image = frame(bench(*SMALL), Defects(), 0)
    data = prepared(image, bench(*SMALL))
    outside = np.zeros(image.shape, bool)
    outside[40:50, 60:70] = True
    uneven = Unevenness(0.5, 0.7)
    seen = Apparatus(scene=bench(*SMALL), uneven=uneven, outside=outside).seen(data)
    assert seen.lamp.uneven == uneven
    assert np.array_equal(seen.valid, data.valid & ~outside)
