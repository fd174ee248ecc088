"""`check` names frames of the unloaded specimen among loaded ones, and no others."""

import numpy as np
import pytest
import tifffile

import isochrome
from isochrome.frames import look_through
from isochrome.samples import samples_path

BENCH = samples_path() / "line-contact-wear"
STUDY = pytest.mark.study
WORDS = "looks like the unloaded specimen"


@pytest.fixture(scope="module")
def sample():
    """The sample's scene, its frames and its two no-load frames."""
    names = ("captured", "no-load-dark", "no-load-bright")
    images = [tifffile.imread(BENCH / f"{name}.tif") for name in names]
    return isochrome.load_scene(BENCH / "scene.toml"), *images


def without_no_load(scene):
    none = {"no_load_dark": None, "no_load_bright": None}
    return scene.model_copy(update={"frames": scene.frames.model_copy(update=none)})


def named(frames, scene):
    """What is said of unloaded frames."""
    found = look_through(np.stack(frames), scene).findings
    return [f for f in found if WORDS in f.text]


OTHER_PLACES = ("dark", 3), ("dark", 6), ("bright", 0), ("bright", 6)


@pytest.mark.long
@pytest.mark.parametrize(
    ("light", "place"),
    [("dark", 0), ("bright", 3), *(pytest.param(*case, marks=STUDY) for case in OTHER_PLACES)],
)
def test_a_no_load_frame_among_the_frames_is_named_with_what_to_do(sample, place, light):
    scene, captured, dark, bright = sample
    noise = np.random.default_rng(place).normal(0.0, 1.5, dark.shape)
    other = (dark if light == "dark" else 0.93 * bright) + noise  # the lamp drifts
    stack = list(captured)
    stack.insert(place, np.clip(np.rint(other), 0, 255).astype(np.uint8))
    (finding,) = named(stack, scene)
    assert (finding.level, finding.frame) == ("warning", place)
    assert f"frame {place}: {WORDS}: nearly the same picture as" in finding.text
    assert f"as frames.no_load_{light};" in finding.text
    assert "take it out of the frames" in finding.text
    (finding,) = named(stack, without_no_load(scene))
    assert f"frame {place}: {WORDS}: no fringes, where the frames beside show many" in finding.text
    assert "or name it as frames.no_load_dark" in finding.text


@pytest.mark.parametrize(
    ("name", "frames"),
    [
        ("line-contact-wear", "captured.tif"),
        ("disc", "disc-350N.png"),
        pytest.param("sliding-film", "film.avi", marks=pytest.mark.long),
    ],
)
def test_the_samples_frames_are_all_loaded(name, frames):
    folder = samples_path() / name
    found = look_through(folder / frames, isochrome.load_scene(folder / "scene.toml"))
    assert found.count and not [f for f in found.findings if WORDS in f.text]


@pytest.mark.long
@pytest.mark.parametrize("load", [0.3, *(pytest.param(load, marks=STUDY) for load in (1.0, 5.0))])
@pytest.mark.parametrize("field", ["dark", "bright"])
def test_a_contact_at_a_low_load_is_no_unloaded_frame(tmp_path, load, field):
    """Beside no-load frames of the same light; few blocks of it are lit otherwise."""
    scene = isochrome.load_scene("line-contact-wear").with_values({
        "wear.distances_m": [0.0, 100.0], "friction.static_state_first": True,
        "load.normal_n": load, "camera.width_px": 330, "camera.height_px": 247,
        "camera.pixel_mm": 0.012, "camera.left_mm": -2.0, "camera.top_mm": 0.0,
        "camera.noise_grey": 1.0, "polariscope.field": field,
    })  # fmt: skip
    isochrome.simulate(scene, tmp_path / "simulated")
    frames = tifffile.imread(tmp_path / "simulated" / "frames.tif")
    tifffile.imwrite(tmp_path / "d.tif", np.full(frames[0].shape, frames.min(), np.uint8))
    tifffile.imwrite(tmp_path / "b.tif", np.full(frames[0].shape, 230, np.uint8))
    update = {"no_load_dark": str(tmp_path / "d.tif"), "no_load_bright": str(tmp_path / "b.tif")}
    own = scene.model_copy(update={"frames": scene.frames.model_copy(update=update)})
    assert named(frames, own) == [] == named(frames, without_no_load(own))


def ramp(count=12, rest=3):
    """A film that begins unloaded for some frames, whose fringes then come one after the other."""
    row, col = np.mgrid[:120, :160].astype(float)
    far = np.hypot(row - 10.0, col - 80.0) / 160.0
    most = np.concatenate([np.zeros(rest), np.linspace(0.2, 5.0, count - rest)])
    rng = np.random.default_rng(0)
    light = [20.0 + 200.0 * np.sin(np.pi * n * np.exp(-3.0 * far)) ** 2 for n in most]
    return [np.rint(one + rng.normal(0.0, 1.0, one.shape)).astype(np.uint8) for one in light]


def test_a_film_that_begins_unloaded_is_as_it_should_be(tmp_path):
    frames = ramp()
    tifffile.imwrite(tmp_path / "d.tif", frames[0])
    text = '[specimen]\nshape = "other"\n[camera]\nbit_depth = 8\n[frames]\n'
    starts = isochrome.parse_scene(text + "starts_unloaded = true\n", folder=tmp_path)
    assert named(frames, starts) == [] == named(frames[::-1], starts)
    plain = isochrome.parse_scene(text, folder=tmp_path)
    assert named(frames, plain) == []  # its fringes come one after the other
    told = isochrome.parse_scene(text + 'no_load_dark = "d.tif"\n', folder=tmp_path)
    (finding,) = named(frames, told)
    assert "set frames.starts_unloaded = true" in finding.text and "frames 0-2" in finding.text


def test_a_load_that_the_scene_lets_change_may_begin_at_nought(sample):
    scene, captured, dark, _ = sample
    table = {"distance_m": [0.0, 10.0, 233.0], "value": [0.001, 44.0, 44.0]}
    changing = scene.with_values({"load.normal_n": table})
    each = {"known_loads_n": (0.0,) * 6}
    known = scene.model_copy(update={"frames": scene.frames.model_copy(update=each)})
    assert named([dark, *captured[1:]], known) == []
    assert named([dark, *captured[1:]], changing) == [] != named([dark, *captured[1:]], scene)
