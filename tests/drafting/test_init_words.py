"""What `init` says is no surer than its frame: no fringes, richer light, causes that look alike."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
import tifffile

import isochrome
from isochrome.fitting import light_matters
from isochrome.samples import samples_path

SHRUNK, STUDY = 4, pytest.mark.study
KNOWN = {
    "young_gpa": 2.1, "poisson": 0.4, "thickness_mm": 4.0, "fringe_value_n_per_mm": 14.6,
    "radius_mm": 24.61, "indenter_young_gpa": 210.0, "indenter_poisson": 0.3, "load_n": 40.0,
    "pixel_mm": 0.0243,
}  # fmt: skip
ROWS, COLS = 123, 164
NO_FRINGES = r"no fringes in frame 0, .* is it loaded\? take a loaded frame"


def unloaded(kind):
    """A frame without load: the sample's, or a lamp's light with noise."""
    if kind != "lamp":
        image = tifffile.imread(samples_path() / "line-contact-wear" / f"no-load-{kind}.tif")
        rows, cols = (n // SHRUNK for n in image.shape)
        cut = image[: rows * SHRUNK, : cols * SHRUNK]
        return np.rint(cut.reshape(rows, SHRUNK, cols, SHRUNK).mean((1, 3))).astype(np.uint8)
    row, col = np.mgrid[:ROWS, :COLS]
    light = 150.0 - 0.007 * ((col - 67) ** 2 + (row - 45) ** 2)
    noise = np.random.default_rng(0).normal(0.0, 1.5, light.shape)
    return np.rint(light + noise).astype(np.uint8)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """Frames of the sample's contact, with other values."""

    def make(**values):
        scene = isochrome.load_scene("line-contact-wear").with_values({
            "wear.distances_m": [0.0], "friction.static_state_first": False,
            "camera.width_px": COLS, "camera.height_px": ROWS, "camera.pixel_mm": 0.0243,
            "camera.noise_grey": 1.5, "camera.seed": 1,
        } | {key.replace("__", "."): value for key, value in values.items()})  # fmt: skip
        folder = tmp_path_factory.mktemp("simulated") / "out"
        isochrome.simulate(scene, folder)
        return np.squeeze(tifffile.imread(folder / "frames.tif"))

    return make


@pytest.mark.long
@pytest.mark.parametrize(
    "kind", [*(pytest.param(kind, marks=STUDY) for kind in ("dark", "bright")), "lamp"]
)
def test_an_unloaded_frame_is_said_to_have_no_fringes(kind):
    with pytest.raises(isochrome.PhysicsError, match=NO_FRINGES):
        isochrome.init(unloaded(kind), KNOWN)


@pytest.mark.long
@pytest.mark.parametrize("load", [pytest.param(0.05, marks=STUDY), 0.1])
def test_a_ramps_start_is_said_to_have_no_fringes_and_no_two_scenes(simulated, load):
    """Some of these loads end in two scenes that explain the frame alike, some in none."""
    with pytest.raises(isochrome.PhysicsError, match=NO_FRINGES):
        isochrome.init(simulated(load__normal_n=load), KNOWN | {"load_n": 1.3 * load})


@pytest.mark.long
def test_fringes_that_no_contact_explains_are_not_said_to_be_none(simulated):
    with pytest.raises(isochrome.PhysicsError, match="no contact explains frame 0"):
        isochrome.init(simulated(load__normal_n=1.0), KNOWN)


@pytest.mark.long
def test_a_turned_plate_is_not_said_to_be_a_smooth_stress(simulated):
    """In noise one plate turned by a degree leaves what a smooth stress leaves, to 1e-4 of chi."""
    frame = simulated(polariscope__input_plate_error_deg=1.0, camera__noise_grey=6.0)
    draft = isochrome.init(frame, KNOWN)
    (said,) = (text for text in draft.warnings if "quarter-wave plates that are turned" in text)
    assert said.startswith("the frame shows quarter-wave plates") and "smooth stress" not in said
    value, spread = map(
        float, re.search(r"input_plate_error_deg = (\S+) ± ([^,)]+)", said).groups()
    )
    assert abs(value - 1.0) < 3.0 * spread < 2.0


@pytest.mark.long
def test_blur_that_nothing_else_explains_is_said_plainly_and_with_one_uncertainty(simulated):
    draft = isochrome.init(simulated(camera__blur_px=1.2), KNOWN)
    (said,) = (text for text in draft.warnings if "blur" in text)
    assert said.startswith("the frame shows blur (camera.blur_px = ")
    words = dict(draft.main_values())
    for key in [key for key in words if key != "chi" and f"{key} = " in said]:
        assert f"{key} = {words[key]}" in said


@pytest.mark.study  # of a blur: above
def test_a_draft_tells_one_uncertainty_of_what_the_frame_neither_asks_for_nor_excludes(simulated):
    frame = simulated(polariscope__input_plate_error_deg=2.0)
    draft = isochrome.init(frame, KNOWN)
    words = dict(draft.main_values())
    key = "polariscope.input_plate_error_deg"
    assert any(f"{key} = {words[key]}" in text for text in draft.warnings)


def freed(before, after):
    """A fit of load and place as stated, and with richer light; values with their ±."""
    keys = ("load.normal_n", "camera.left_mm")
    scene = SimpleNamespace(camera=SimpleNamespace(pixel_mm=0.01))

    def fit(pairs):
        values, spread = (np.array(column) for column in zip(*pairs, strict=True))
        return SimpleNamespace(keys=keys, values=values, standard_uncertainty=spread, scene=scene)

    return SimpleNamespace(stated=SimpleNamespace(fit=fit(before)), fit=fit(after))


@pytest.mark.parametrize(
    ("after", "wanted"),
    [
        (((44.01, 0.001), (-2.0, 1e-5)), False),  # many of its ±, and nothing
        (((44.5, 0.01), (-2.0, 1e-5)), True),  # a per cent
        (((44.5, 0.3), (-2.0, 1e-5)), True),  # within its ±, which is now 0.7 %
        (((44.0, 0.002), (-2.0, 1e-5)), False),  # a ± twice as large, and nothing
        (((44.0, 0.001), (-2.02, 1e-4)), True),  # two pixels
    ],
)
def test_richer_light_is_said_where_it_changes_something(after, wanted):
    assert light_matters(freed(((44.0, 0.001), (-2.0, 1e-5)), after)) is wanted
