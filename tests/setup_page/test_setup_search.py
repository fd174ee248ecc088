"""The page's cold search without a browser: what it puts into the scene, and what it leaves."""

import re

import pytest
import tifffile

from drafting.drawn_contacts import drawn_contact
from isochrome.errors import InputError, PhysicsError
from isochrome.scene import load_scene
from isochrome.setup_page import apply_tool, find_in_frames, open_session, page_words, session_state
from isochrome.simulation import simulate

from .conftest import GIVEN

SEED = 5
"""A picture of 219 x 164 pixels, turned, not mirrored: its scene is the truth as it is."""


@pytest.fixture(scope="module")
def case():
    """The drawn contact; its light and sensor share no code with the package."""
    drawn = drawn_contact(SEED, shrunk=3)
    assert drawn.turn and drawn.flip is None
    return drawn


def form_of(case):
    """What its user fills in: nothing of place, friction, field, gamma and turn."""
    specimen, indenter = case.true.specimen, case.true.indenter
    return {
        "specimen.thickness_mm": specimen.thickness_mm,
        "specimen.fringe_value_n_per_mm": specimen.fringe_value_n_per_mm,
        "specimen.young_gpa": specimen.young_gpa, "specimen.poisson": specimen.poisson,
        "indenter.radius_mm": indenter.radius_mm, "indenter.young_gpa": indenter.young_gpa,
        "indenter.poisson": indenter.poisson, "load.normal_n": case.about_n,
        "camera.pixel_mm": case.true.camera.pixel_mm, "camera.bit_depth": 8,
        "polariscope.field": "dark",
    }  # fmt: skip


@pytest.fixture
def drawn(case, tmp_path):
    """A session on its picture, without a scene."""
    tifffile.imwrite(tmp_path / "drawn.tif", case.captured)
    return open_session(tmp_path / "drawn.tif")


@pytest.mark.long
def test_one_search_makes_the_scene_of_the_form_and_finds_the_rest(case, drawn):
    answer = find_in_frames(drawn, 0, form=("contact", form_of(case)))
    scene, true = drawn.scene(), case.true
    assert scene.frames.rotate_deg == case.turn and scene.polariscope.field == case.field
    # as of `init`: within 1 % or three hundredths of friction's range, two pixels, 2 % of gamma
    assert scene.load.normal_n == pytest.approx(true.load.normal_n, rel=0.01)
    assert scene.friction.coefficient == pytest.approx(true.friction.coefficient, abs=0.003)
    assert scene.frames.gamma == pytest.approx(case.gamma, rel=0.02)
    pixel = true.camera.pixel_mm
    assert scene.camera.left_mm == pytest.approx(true.camera.left_mm, abs=2.0 * pixel)
    assert scene.camera.top_mm == pytest.approx(true.camera.top_mm, abs=2.0 * pixel)
    assert "# Load, N" in drawn.text and "# Thickness, mm" in drawn.text
    said = {row["key"]: row["text"] for row in answer["found"]}
    assert re.match(r"[\d.]+ ± [\d.]+$", said["load.normal_n"])
    assert float(said["load.normal_n"].split()[0]) == pytest.approx(scene.load.normal_n, rel=1e-3)
    assert {"camera.left_mm", "camera.top_mm", "frames.gamma", "polariscope.field"} <= set(said)
    apply_tool(drawn, {"tool": "undo"})  # one step back
    assert drawn.text == ""


def test_a_search_in_a_scene_keeps_comments_regions_and_stated_values(case, drawn):
    values = form_of(case) | {"frames.rotate_deg": case.turn, "load.normal_n": case.about_n}
    apply_tool(drawn, {"tool": "new", "kind": "contact", "values": values})
    stated = "normal_n = { value = 7.5, standard_uncertainty = 0.5 } # by the cell"
    load = case.true.load.normal_n
    text = re.sub(r"normal_n = .*", stated.replace("7.5", f"{load:.3f}"), drawn.text)
    apply_tool(drawn, {"tool": "text", "text": text})
    find_in_frames(drawn, 0)
    place = session_state(drawn)["place"]
    rows, cols = session_state(drawn)["frames"]["rows"], session_state(drawn)["frames"]["cols"]
    box = {"top_px": 4, "left_px": 7, "height_px": rows - 9, "width_px": cols - 11}
    apply_tool(drawn, {"tool": "region", "region": box})
    apply_tool(drawn, {"tool": "contact", "point": [place[0] + 9.0, place[1] - 9.0]})
    answer = find_in_frames(drawn, 0)
    assert session_state(drawn)["place"] == pytest.approx(place, abs=0.01)
    scene = drawn.scene()
    assert scene.uncertainties["load.normal_n"] == 0.5
    assert f"value = {load:.3f}" in drawn.text and "# by the cell" in drawn.text
    assert any("load.normal_n is stated" in text for text in answer["warnings"])
    assert "load.normal_n" not in [row["key"] for row in answer["found"]]


def test_a_region_is_not_turned_under_the_user(case, drawn):
    apply_tool(drawn, {"tool": "new", "kind": "contact", "values": form_of(case)})
    box = {"top_px": 4, "left_px": 7, "height_px": 90, "width_px": 80}
    apply_tool(drawn, {"tool": "region", "region": box})
    before = drawn.text
    with pytest.raises(InputError, match=rf"turned by {case.turn} degrees.*take them away"):
        find_in_frames(drawn, 0)
    assert drawn.text == before


@pytest.mark.long
def test_what_is_held_is_not_searched_for(case, drawn):
    """The wrong field, held, explains nothing: the refusal names the page's fields."""
    wrong = {"dark": "bright", "bright": "dark"}[case.field]
    values = form_of(case) | {"polariscope.field": wrong, "frames.rotate_deg": case.turn}
    with pytest.raises(PhysicsError) as refused:
        find_in_frames(drawn, 0, form=("contact", values | {"frames.gamma": 1.0}), held=True)
    assert "--" not in str(refused.value) and "'Load'" in str(refused.value) and drawn.text == ""


def test_what_is_missing_is_asked_for_by_the_names_of_fields(case, drawn):
    form = form_of(case)
    with pytest.raises(InputError, match=r"^fill in: Thickness, Radius; a scene of a block"):
        find_in_frames(
            drawn,
            0,
            form=("contact", form | {"specimen.thickness_mm": None, "indenter.radius_mm": None}),
        )
    with pytest.raises(InputError, match=r"size of a pixel.*give 'Side of a pixel'"):
        find_in_frames(drawn, 0, form=("contact", form | {"camera.pixel_mm": None}))
    ring = form | {"specimen.diameter_mm": 40.0, "specimen.hole_mm": 9.0}
    with pytest.raises(InputError, match=r"a ring: the search knows a contact .* and a disc"):
        find_in_frames(drawn, 0, form=("ring", ring))
    with pytest.raises(InputError, match="there is no scene yet"):
        find_in_frames(drawn, 0)
    assert page_words("give --bit-depth 12, or --flip") == (
        "give 'Bits of the sensor' 12, or 'Mirrored'"
    )


@pytest.mark.long
def test_a_frame_that_stands_still_tells_no_friction(tmp_path):
    """The paper's contact at rest. Where the user has said so, see test_setup_browser.py."""
    size = {"camera.width_px": 219, "camera.height_px": 164, "camera.pixel_mm": 0.0182}
    scene = load_scene("line-contact-wear").with_values(size | {"camera.noise_grey": 2.0})
    still = simulate(scene.model_copy(update={"friction": None, "wear": None}))
    tifffile.imwrite(tmp_path / "still.tif", still.frames[0])
    session = open_session(tmp_path / "still.tif")
    form = GIVEN | {"friction.coefficient": None, "friction.static_state_first": False}
    form |= {"camera.pixel_mm": 0.0182}
    with pytest.raises(InputError, match=r"frame 0: no friction is seen.*'Friction coefficient'"):
        find_in_frames(session, 0, form=("contact", form))
    answer = find_in_frames(session, 0, form=("contact", form | {"friction.coefficient": 0.3}))
    assert session.scene().friction.coefficient == 0.3
    assert any("no friction is seen in frame 0" in text for text in answer["warnings"])


def test_a_scene_that_changes_during_the_search_is_left_alone(case, drawn, monkeypatch):
    from isochrome.setup_page import edits

    apply_tool(drawn, {"tool": "new", "kind": "contact", "values": form_of(case)})
    search = edits.draft_scene

    def slow(frames, known, leave_out):
        apply_tool(drawn, {"tool": "values", "values": {"specimen.poisson": 0.39}})
        return search(frames, known, leave_out)

    monkeypatch.setattr(edits, "draft_scene", slow)
    with pytest.raises(InputError, match="has changed during the search"):
        find_in_frames(drawn, 0)
    assert drawn.scene().camera.left_mm is None and drawn.scene().specimen.poisson == 0.39
