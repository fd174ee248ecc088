"""`init`: the right scene from a frame, a refusal, and files that are whole or not there."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile
from drawn_contacts import drawn_contact
from init_contacts import judged, judged_draft, known_of, truth_unmirrored

import isochrome
from isochrome.drafting import KnownValues, api, open_questions
from isochrome.frames import open_frames
from isochrome.samples import samples_path

SHRUNK = 3
"""Pictures of 219 x 164 pixels: what is asked of the whole ones is a study."""


@pytest.fixture(scope="module")
def case():
    """A contact on its side, mirrored, in the bright field, gamma 0.95."""
    return drawn_contact(1, shrunk=SHRUNK)


@pytest.fixture(scope="module")
def draft(case):
    return isochrome.init(case.captured, known_of(case))


def test_a_drawn_contact_ends_in_the_right_scene(case, draft):
    verdict = judged_draft(case, draft)
    assert verdict.kind == "right", verdict.words


@pytest.mark.study
def test_95_of_100_drawn_contacts_end_in_the_right_scene_and_none_in_a_wrong_one():
    verdicts = [judged(drawn_contact(seed)) for seed in range(100)]
    wrong = {k: v.words for k, v in enumerate(verdicts) if v.kind == "wrong"}
    assert not wrong and sum(v.kind == "right" for v in verdicts) >= 95


def test_the_text_is_the_scene_says_where_values_are_from_and_what_is_to_be_filled_in(draft):
    assert isochrome.parse_scene(draft.text, name="scene") == draft.scene
    for value in draft.values:
        assert draft.scene.get(value.key) in _as_written(value.value)
    line = next(row for row in draft.text.split("\n") if row.startswith("young_gpa"))
    assert line.endswith("# as given; GPa")
    load = next(row for row in draft.text.split("\n") if row.startswith("normal_n"))
    assert "# found, ± " in load
    opened = {key.key for key in draft.open}
    assert "polariscope.wavelength_nm" in opened and "frames.no_load_bright" in opened
    filled = draft.text.replace("# wavelength_nm =", "wavelength_nm = 587.0")
    assert isochrome.parse_scene(filled).polariscope.wavelength_nm == 587.0
    printed = repr(draft)
    assert "load.normal_n" in printed and "to fill in" in printed
    found = draft.to_json()
    assert found["values"][0].keys() == {"key", "value", "origin", "standard_uncertainty", "note"}
    assert list(draft.table.columns) == ["key", "value", "standard_uncertainty", "origin"]


def _as_written(value):
    """The value, or numbers that are it to the digits of a text."""
    return [value] if isinstance(value, str) else [pytest.approx(value, rel=1e-4)]


@pytest.mark.long
def test_a_mirror_that_is_known_is_written_and_friction_has_its_own_side(case):
    """The drawn picture was mirrored: with that stated the scene is the true one itself."""
    flip = {"flip": case.flip} if case.flip else {"flip": "horizontal"}
    known = known_of(case) | flip | {"rotate_deg": case.turn}
    scene = isochrome.init(case.captured, known).scene
    sign = 1.0 if case.flip else -1.0
    assert scene.frames.flip == flip["flip"]
    assert scene.friction.coefficient == pytest.approx(
        sign * case.true.friction.coefficient, abs=0.01
    )


def test_a_turned_picture_has_the_camera_of_the_turned_one(draft, case):
    side = "right" if truth_unmirrored(case)["friction.coefficient"] > 0.0 else "left"
    text = " ".join(draft.text.replace("\n# ", " ").split())
    assert f"drags the surface to the {side} of the picture" in text
    assert "run init again with --flip horizontal" in text
    turn = truth_unmirrored(case)["frames.rotate_deg"]
    assert draft.scene.frames.rotate_deg == turn and turn in (90, 270)
    rows, cols = case.captured.shape
    assert (draft.scene.camera.height_px, draft.scene.camera.width_px) == (cols, rows)


def test_check_and_process_take_the_scene_as_it_is(case, draft):
    """Load and friction of `process` are the true ones, within three of its own uncertainties."""
    assert isochrome.check(case.captured, draft.scene).ok
    found = isochrome.process(case.captured, draft.scene).table.iloc[0]
    truth = truth_unmirrored(case)
    for key in ("load.normal_n", "friction.coefficient"):
        error = abs(found[key] - truth[key])
        assert error < 3.0 * found[f"{key} standard_uncertainty"]


NO_CONTACT = {
    "noise": lambda z, x: 0.0 * x + 120.0,
    "light": lambda z, x: 180.0 - 50.0 * (x**2 + z**2),
    "stripes": lambda z, x: 120.0 + 80.0 * np.sin(12.0 * x + 3.0 * z),
    "rings": lambda z, x: 120.0 + 80.0 * np.cos(14.0 * (x**2 + z**2)),
    "an edge": lambda z, x: np.where(z > -0.2, 150.0, 20.0) + 0.0 * x,
}


@pytest.mark.long
@pytest.mark.parametrize(
    "what",  # without fringes: see test_init_words.py
    [
        n if n in ("stripes", "rings") else pytest.param(n, marks=pytest.mark.study)
        for n in NO_CONTACT
    ],
)
def test_a_picture_without_a_contact_is_refused(case, what):
    rows, cols = case.captured.shape
    z, x = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : cols * 1j]
    noise = np.random.default_rng(7).normal(0.0, 3.0, (rows, cols))
    picture = np.clip(np.rint(NO_CONTACT[what](z, x) + noise), 0, 255).astype(np.uint8)
    with pytest.raises(isochrome.PhysicsError) as refused:
        isochrome.init(picture, known_of(case))
    assert what != "rings" or "no fringes" not in str(refused.value)


@pytest.mark.long
@pytest.mark.parametrize(
    ("key", "factor"),
    [
        *(
            pytest.param(key, factor, marks=pytest.mark.study)
            for key, factor in (("radius_mm", 2.0), ("fringe_value_n_per_mm", 1.5))
        ),
        ("load_n", 10.0),
    ],
)
def test_a_wrong_value_is_refused(case, key, factor):
    known = known_of(case)
    known[key] *= factor
    with pytest.raises(isochrome.PhysicsError, match=r"--load-n|load known"):
        isochrome.init(case.captured, known)


def test_twelve_bits_in_sixteen_are_asked_about(case):
    known = known_of(case)
    del known["radius_mm"], known["load_n"]
    with pytest.raises(isochrome.InputError, match=r"give --radius-mm and --load-n"):
        isochrome.init(case.captured, known)
    known = known_of(case)
    del known["pixel_mm"]
    with pytest.raises(isochrome.InputError, match=r"size of a pixel.*--pixel-mm"):
        isochrome.init(case.captured, known)
    with open_frames(case.captured) as frames:
        assert open_questions(frames, KnownValues(**known)) == ("pixel_mm",)
    colours = np.repeat(case.captured[..., None], 3, axis=2)
    with pytest.raises(isochrome.InputError, match=r"--wavelength-nm.*or --channel"):
        isochrome.init(colours, known_of(case))
    deep = case.captured.astype(np.uint16) * 16
    with pytest.raises(isochrome.InputError, match=r"as of 12 bits.*--bit-depth 12"):
        isochrome.init(deep, known_of(case))


def test_a_value_that_is_none_is_refused_by_its_name(case):
    for known, words in (
        ({"radius": 3.0}, "radius: is not known here; known are"),
        ({"shape": "ball"}, "shape = ball: is none of contact, disc, other"),
        ({"rotate_deg": 45}, "rotate_deg = 45: is none of 0, 90, 180, 270"),
        ({"frame": -1}, "frames count from 0"),
        ({"frame": 1}, "give 0 to 0"),
        ({"young_gpa": -2.0}, "specimen.young_gpa"),
    ):
        with pytest.raises(isochrome.InputError, match=words):
            isochrome.init(case.captured, known_of(case) | known)


@pytest.mark.long
def test_the_first_frame_that_shows_the_contact_is_looked_at(case, tmp_path):
    """Of twelve bits, as is given; and a name of a file is a comment whatever it holds."""
    rng = np.random.default_rng(3)
    unloaded = np.clip(rng.normal(10.0, 3.0, case.captured.shape), 0, 255)
    path = tmp_path / 'odd\n[load]\nnormal_n = 1\n".tif'
    tifffile.imwrite(path, np.stack([unloaded, case.captured]).astype(np.uint16) * 16)
    found = isochrome.init(path, known_of(case) | {"bit_depth": 12})
    assert found.frame == 1 and found.scene.camera.bit_depth == 12
    assert found.scene.load.normal_n == pytest.approx(case.true.load.normal_n, rel=0.01)


def test_files_are_left_and_a_scene_is_never_written_over(case, draft, tmp_path, monkeypatch):
    monkeypatch.setattr(api, "draft_scene", lambda frames, given, leave_out: draft)
    found = isochrome.init(case.captured, known_of(case), tmp_path / "bench")
    path = tmp_path / "bench" / "scene.toml"
    assert sorted(p.name for p in path.parent.iterdir()) == ["scene.png", "scene.toml"]
    assert isochrome.load_scene(path).with_values({}) == found.scene.model_copy(
        update={"folder": path.parent}
    )
    path.write_text("mine")
    with pytest.raises(isochrome.InputError, match=r"scene.toml: is there already.*--replace"):
        isochrome.init(case.captured, known_of(case), tmp_path / "bench")
    assert path.read_text() == "mine"
    isochrome.init(case.captured, known_of(case), tmp_path / "bench", replace=True)
    assert path.read_text() == found.text


def test_nothing_is_left_where_the_preview_cannot_be_drawn(case, draft, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError("no room")

    monkeypatch.setattr(api, "draft_scene", lambda frames, given, leave_out: draft)
    monkeypatch.setattr(api, "write_figure", fail)
    with pytest.raises(OSError, match="no room"):
        isochrome.init(case.captured, known_of(case), tmp_path / "bench")
    assert not (tmp_path / "bench").exists()


DISC = {"shape": "disc", "diameter_mm": 50.0, "thickness_mm": 6.0, "fringe_value_n_per_mm": 14.6}
"""The sample disc, as its set states it; 0.13 mm a pixel and gamma 1.4 were put in."""


@pytest.mark.long
def test_a_disc_ends_in_its_scene_though_it_lies_on_its_side():
    image = tifffile_of("disc-560N.png")[::3, ::3]
    found = isochrome.init(np.ascontiguousarray(np.rot90(image)), DISC | {"load_n": 400.0})
    spread = {value.key: value.standard_uncertainty for value in found.values}
    for key, truth in (
        ("load.normal_n", 560.0),
        ("camera.pixel_mm", 3 * 0.13),
        ("frames.gamma", 1.4),
    ):
        assert abs(found.scene.get(key) - truth) < 3.0 * spread[key]
    assert found.scene.frames.rotate_deg == 90 and found.scene.polariscope.field == "dark"


@pytest.mark.long
def test_a_disc_of_another_load_is_refused():
    image = np.ascontiguousarray(tifffile_of("disc-560N.png")[::3, ::3])
    with pytest.raises(isochrome.PhysicsError, match="--load-n"):
        isochrome.init(image, DISC | {"load_n": 4.0, "rotate_deg": 0})


def tifffile_of(name):
    """A sample image as an array."""
    with open_frames(samples_path() / "disc" / name) as frames:
        return next(iter(frames)).image


def test_a_specimen_without_a_model_has_a_scene_to_fill_in(tmp_path):
    image = tifffile_of("disc-560N.png")
    found = isochrome.init(image, {"shape": "other", "pixel_mm": 0.13}, tmp_path)
    assert found.scene.model is None and found.scene.camera.pixel_mm == 0.13
    assert {"specimen.thickness_mm", "frames.known_order"} <= {key.key for key in found.open}
    assert isochrome.check(image, tmp_path / "scene.toml").ok


@pytest.fixture
def folder(tmp_path):
    """A loaded frame, and those of the unloaded specimen."""
    for name in ("disc-560N.tif", "no-load-dark.tif", "no-load-bright.tif"):
        tifffile.imwrite(tmp_path / name, tifffile_of("disc-560N.png"))
    return tmp_path


OTHER = {"shape": "other", "pixel_mm": 0.13}


def test_folders_of_no_load_frames_are_told_apart(folder):
    assert "disc-560N.tif: 1 frame of" in isochrome.init(folder, OTHER).text
    (folder / "no-load-dark.tif").rename(folder / "ground.tif")
    assert ": 2 frames of" in isochrome.init(folder, OTHER).text  # nobody says what it is
    (folder / "scene.toml").write_text(
        '[specimen]\nshape = "other"\n[frames]\nno_load_dark = "ground.tif"\n'
        'no_load_bright = "no-load-bright.tif"\n'
    )
    assert "disc-560N.tif: 1 frame of" in isochrome.init(folder, OTHER).text
    (folder / "ground.tif").rename(folder / "no-load-dark.tif")
    for name in ("scene.toml", "disc-560N.tif"):
        (folder / name).unlink()
    with pytest.raises(isochrome.InputError, match=r"besides no-load-bright\.tif, no-load"):
        isochrome.init(folder, OTHER)
    (folder / "scene.toml").write_text(
        '[specimen]\nshape = "other"\n[frames]\nno_load_dark = "no-load-dark.tif"\n'
        'no_load_bright = "no-load-bright.tif"\n'
    )
    found = isochrome.check(folder, folder / "scene.toml")
    assert not found.ok and "put the loaded frames there" in found.findings[0].text


@pytest.mark.long
def test_two_scenes_that_explain_a_frame_alike_are_refused(case, monkeypatch):
    """A picture whose own turn is told to be two things: the second is the same start, renamed."""
    search = api.fitting.search_picture

    def twice(*given, **choices):
        starts = search(*given, **choices)
        other = starts[0].lying._replace(rotate_deg=0)
        return (starts[0], replace(starts[0], lying=other), *starts[1:])

    monkeypatch.setattr(api.fitting, "search_picture", twice)
    with pytest.raises(isochrome.PhysicsError, match=r"two scenes explain frame 0 alike.*--field"):
        isochrome.init(case.captured, known_of(case))


@pytest.mark.long
@pytest.mark.parametrize(
    ("key", "value"),
    [("friction.coefficient", -2.0), pytest.param("frames.gamma", 0.2, marks=pytest.mark.study)],
)
def test_a_fit_that_has_run_to_what_no_bench_has_is_no_contact(case, monkeypatch, key, value):
    """Of a contact whose middle is outside the picture: light of 80 terms then made chi 1.04."""
    fit = api.fitting.fit_frame

    def run_away(*given, **choices):
        found = fit(*given, **choices)
        return replace(found, scene=found.scene.with_values({key: value}))

    monkeypatch.setattr(api.fitting, "fit_frame", run_away)
    with pytest.raises(isochrome.PhysicsError, match="no contact explains frame 0"):
        isochrome.init(case.captured, known_of(case))
