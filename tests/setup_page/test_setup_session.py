"""The page's tools without a browser: what each does to the scene's text."""

import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib

import numpy as np
import pytest
import tifffile
from PIL import Image

import isochrome
from isochrome.errors import InputError
from isochrome.frames import open_scene_frames
from isochrome.samples import samples_path
from isochrome.scene import load_scene
from isochrome.setup_page import (
    LiveModel,
    apply_tool,
    fit_answer,
    open_session,
    order_map_of_points,
    session_state,
    without_model,
)

from .conftest import GIVEN

TRUE_LOAD, TRUE_FRICTION = 44.66, 0.236
"""Of the sample's frame 1, see its truth.json."""


def values_of(session):
    return tomllib.loads(session.text)


def test_a_fresh_folder_has_no_scene_and_the_form_makes_one(session, fresh):
    state = session_state(session)
    assert (state["has_scene"], state["saved"], state["text"]) == (False, False, "")
    assert state["frames"] == {
        "count": 6, "rows": 494, "cols": 659, "bit_depth": 8, "pixel_mm": 0.00607,
    }  # fmt: skip
    assert state["beside"] == ["no-load-bright.tif", "no-load-dark.tif"]
    apply_tool(session, {"tool": "new", "kind": "contact", "values": GIVEN})
    tables = values_of(session)
    assert tables["frames"] == {
        "no_load_dark": "no-load-dark.tif", "no_load_bright": "no-load-bright.tif",
    }  # fmt: skip
    assert tables["load"]["normal_n"] == 40.0 and tables["wear"]["distances_m"][-1] == 233
    assert "# Thickness, mm" in session.text and not (fresh / "scene.toml").exists()
    apply_tool(session, {"tool": "save"})
    assert load_scene(fresh / "scene.toml").load.normal_n == 40.0
    assert session_state(session)["saved"]


def test_the_form_names_all_that_is_missing(session):
    values = GIVEN | {"specimen.thickness_mm": None, "load.normal_n": None}
    with pytest.raises(InputError, match=r"^fill in: Thickness, Load; a scene of a block"):
        apply_tool(session, {"tool": "new", "kind": "contact", "values": values})
    assert session.text == ""


@pytest.mark.parametrize("kind", ["disc", "ring", "beam", "other"])
def test_every_kind_of_specimen_becomes_a_scene(session, kind):
    values = {
        "specimen.thickness_mm": 5.0, "specimen.fringe_value_n_per_mm": 7.0,
        "specimen.diameter_mm": 40.0, "specimen.hole_mm": 10.0, "specimen.height_mm": 20.0,
        "load.normal_n": 300.0, "load.inner_span_mm": 40.0, "load.outer_span_mm": 100.0,
    }  # fmt: skip
    apply_tool(session, {"tool": "new", "kind": kind, "values": values})
    assert session.scene().model == (None if kind == "other" else kind)


def test_scale_contact_and_surface_are_read_off_the_picture(made):
    apply_tool(made, {"tool": "scale", "points": [[10, 100], [10, 600]], "length_mm": 3.0})
    assert values_of(made)["camera"]["pixel_mm"] == 0.006
    apply_tool(made, {"tool": "contact", "point": [1.5, 324.5]})
    camera = values_of(made)["camera"]
    assert camera["left_mm"] == pytest.approx(-325 * 0.006, abs=1e-6)
    assert camera["top_mm"] == pytest.approx(-2 * 0.006, abs=1e-6)
    state = session_state(made)
    assert state["place"] == pytest.approx([1.5, 324.5], abs=0.01)
    apply_tool(made, {"tool": "surface", "points": [[6.0, 20.0], [2.0, 620.0]]})
    roll = values_of(made)["camera"]["roll_deg"]
    assert roll == pytest.approx(np.degrees(np.arctan(4 / 600)), abs=1e-3)
    state = session_state(made)
    row = 6.0 - 4.0 * (324.5 - 20.0) / 600.0
    assert state["place"] == pytest.approx([row, 324.5], abs=0.02)
    for end_row, end_col in state["surface"]:
        assert end_row == pytest.approx(6.0 - 4.0 * (end_col - 20.0) / 600.0, abs=0.05)
    apply_tool(made, {"tool": "contact", "point": [4.0, 300.0]})
    apply_tool(made, {"tool": "scale", "points": [[0, 0], [0, 400]], "length_mm": 3.0})
    assert session_state(made)["place"] == pytest.approx([4.0, 300.0], abs=0.01)


@pytest.mark.parametrize("roll", [0.0, 2.0])
def test_a_region_moves_all_that_is_counted_in_it(made, roll):
    apply_tool(made, {"tool": "values", "values": {"camera.roll_deg": roll or None}})
    apply_tool(made, {"tool": "contact", "point": [30.0, 324.0]})
    square = [[50, 100], [400, 100], [400, 600]]
    points = [{"row": 200, "col": 300, "order": 1.5}, {"row": 410, "col": 80, "order": 0}]
    lines = [{"points": [[100, 150], [120, 180.5]], "order": 2}]
    apply_tool(made, {"tool": "polygon", "points": square})
    apply_tool(made, {"tool": "known_order", "points": points})
    apply_tool(made, {"tool": "known_line", "lines": lines})
    box = {"top_px": 20, "left_px": 40, "height_px": 440, "width_px": 600}
    apply_tool(made, {"tool": "region", "region": box})
    tables = values_of(made)["frames"]
    assert tables["roi"] == box and tables["polygon_px"][0] == [30.0, 60.0]
    assert tables["known_order"][0] == {"row_px": 180, "col_px": 260, "order": 1.5}
    assert tables["known_line"][0]["col_px"] == [110.0, 140.5]
    state = session_state(made)
    assert state["place"] == pytest.approx([30.0, 324.0], abs=0.01) and state["polygon"] == square
    assert [(one["row"], one["col"]) for one in state["known_order"]] == [(200, 300), (410, 80)]
    assert state["known_line"] == lines
    apply_tool(made, {"tool": "region", "region": None})
    assert "roi" not in values_of(made)["frames"] and session_state(made)["polygon"] == square
    assert session_state(made)["place"] == pytest.approx([30.0, 324.0], abs=0.02)


def test_a_change_that_is_no_scene_leaves_all_as_it_was_and_undo_takes_one_back(made):
    before = made.text
    with pytest.raises(InputError, match=r"specimen\.thickness_mm"):
        apply_tool(made, {"tool": "values", "values": {"specimen.thickness_mm": -1}})
    with pytest.raises(InputError, match="no key of a scene"):
        apply_tool(made, {"tool": "values", "values": {"a.b.c": 1}})
    with pytest.raises(InputError, match="none of its own"):
        apply_tool(made, {"tool": "contact", "point": ["x", None]})
    with pytest.raises(InputError, match="is none; one of"):
        apply_tool(made, {"tool": "rm"})
    assert made.text == before
    apply_tool(made, {"tool": "values", "values": {"load.normal_n": 50}})
    apply_tool(made, {"tool": "undo"})
    assert made.text == before


def test_a_file_that_another_program_changed_is_not_written_over(made, fresh):
    """Its words are named; a page that is loaded anew has the file's scene, and Undo the page's."""
    apply_tool(made, {"tool": "save"})
    file = fresh / "scene.toml"
    other = file.read_text().replace("normal_n = 40.0", "normal_n = 55.0  # by hand")
    file.write_text(other)
    apply_tool(made, {"tool": "values", "values": {"load.normal_n": 50.0}})
    mine = made.text
    with pytest.raises(InputError, match=r"^scene\.toml: was changed by another program since"):
        apply_tool(made, {"tool": "save"})
    assert file.read_text() == other
    made.read_again()
    assert made.text == other and made.is_saved
    apply_tool(made, {"tool": "undo"})
    assert made.text == mine
    apply_tool(made, {"tool": "save"})
    assert file.read_text() == mine
    file.write_text("no scene [")
    made.read_again()
    assert made.text == mine
    with pytest.raises(InputError, match="was changed by another program"):
        apply_tool(made, {"tool": "save"})
    file.unlink()
    apply_tool(made, {"tool": "save"})
    assert file.read_text() == mine


def test_a_scene_of_a_second_page_is_not_written_over_and_one_of_the_package_copied(made, fresh):
    (fresh / "scene.toml").write_text("# of a second page\n")
    with pytest.raises(InputError, match="was changed by another program"):
        apply_tool(made, {"tool": "save"})
    assert (fresh / "scene.toml").read_text() == "# of a second page\n"


def test_a_scene_that_is_there_keeps_its_comments_and_the_packages_is_copied(fresh):
    session = open_session(fresh / "captured.tif", "line-contact-wear")
    assert session.scene_file == fresh / "scene.toml" and not session.is_saved
    assert session.scene().load.normal_n == 44.0
    own = "# bench 3\n[specimen]\nthickness_mm = 4.0  # calliper\n\n[camera]\r\npixel_mm = 0.006\n"
    (fresh / "scene.toml").write_bytes(own.encode())
    session = open_session(fresh / "captured.tif")
    apply_tool(session, {"tool": "values", "values": {"specimen.thickness_mm": 5.0}})
    apply_tool(session, {"tool": "save"})
    assert (fresh / "scene.toml").read_bytes() == own.replace("4.0", "5.0").encode()


@pytest.mark.parametrize("name", ["/etc/passwd", "../secret.csv", "elsewhere/a.csv"])
def test_no_file_is_read_that_is_not_beside_the_scene(made, fresh, name):
    (fresh.parent / "secret.csv").write_text("wavelength_nm,grey\n500,1\n600,1\n")
    for key in ("camera.response", "frames.mask", "frames.no_load_dark", "indenter.profile"):
        with pytest.raises(InputError, match="is not beside the scene"):
            apply_tool(made, {"tool": "values", "values": {key: name}})
    text = made.text + f'\n[[scar]]\nfile = "{name}"\ndistance_m = 3.0\n'
    with pytest.raises(InputError, match="is not beside the scene"):
        apply_tool(made, {"tool": "text", "text": text})


def test_a_file_that_the_scene_named_at_first_stays_allowed(fresh):
    deep = fresh / "deep"
    deep.mkdir()
    (fresh / "no-load-dark.tif").rename(deep / "dark.tif")
    text = '[specimen]\nthickness_mm = 4.0\n[frames]\nno_load_dark = "deep/dark.tif"\n'
    (fresh / "scene.toml").write_text(text)
    session = open_session(fresh / "captured.tif")
    apply_tool(session, {"tool": "values", "values": {"specimen.thickness_mm": 5.0}})


@pytest.mark.long
def test_the_fit_of_a_frame_is_that_of_process(made):
    """Frame 1 of the sample; its gamma of 1.4 is what the frame asks for."""
    answer = fit_answer(made, 1)
    found = {one["key"]: one for one in answer["values"]}
    # a whole standard uncertainty is 0.001 N; five of them
    assert found["load.normal_n"]["value"] == pytest.approx(TRUE_LOAD, abs=0.006)
    assert found["friction.coefficient"]["value"] == pytest.approx(TRUE_FRICTION, abs=2e-4)
    assert found["frames.gamma"]["asked"] and not found["load.normal_n"]["asked"]
    assert found["frames.gamma"]["value"] == pytest.approx(1.4, abs=0.004)
    assert found["load.normal_n"]["line"].startswith("normal_n = 44.66")
    assert "±" in found["load.normal_n"]["text"] and answer["warnings"]


def test_the_live_model_is_the_simulation_but_for_what_no_eye_sees(made):
    apply_tool(made, {"tool": "values", "values": {"camera.left_mm": -1.97, "camera.top_mm": 0.05}})
    scene = made.scene().model_copy(update={"wear": None}).with_values(
        {"friction.static_state_first": False, "camera.width_px": 659, "camera.height_px": 494}
    )  # fmt: skip
    model = LiveModel(scene, (494, 659))
    for values in ({}, {"load.normal_n": 90.0}, {"camera.roll_deg": 2.0}):
        given = scene.with_values(values)
        (state,) = isochrome.scene_states(given)
        wanted = isochrome.polariscope_light(given, isochrome.stress_map(given, state))
        difference = np.abs(model.signal(values) - wanted.to_numpy())
        # steep stress at the contact's edges, where a pixel shows a mean that is left out here
        assert np.quantile(difference, 0.99) < 0.03 and np.median(difference) < 0.005


def test_live_values_out_of_range_and_a_map_without_known_points_are_refused(made):
    with pytest.raises(InputError, match=r"load\.normal_n"):
        made.live(1, {"load.normal_n": -1.0})
    with pytest.raises(InputError, match="there are 6"):
        made.live(6, {})
    with pytest.raises(InputError, match="no order is known anywhere"):
        order_map_of_points(made, 0)


def test_a_disc_of_known_loads_is_read_without_its_model_too():
    text = (
        '[specimen]\nshape = "disc"\ndiameter_mm = 50.0\nthickness_mm = 6.0\n'
        "fringe_value_n_per_mm = 14.6\n[load]\nnormal_n = 100.0\n"
        "[frames]\nknown_loads_n = [100.0, 200.0, 300.0, 400.0, 500.0, 600.0]\n"
    )
    bare = without_model(isochrome.parse_scene(text, name="disc"), text)
    assert bare.model is None and bare.frames.known_loads_n == ()


def test_a_scene_that_names_the_only_picture_of_its_folder_is_refused(tmp_path):
    shutil.copy(samples_path() / "disc" / "disc-560N.png", tmp_path / "unloaded.png")
    session = open_session(tmp_path)
    values = {"specimen.thickness_mm": 4.0, "specimen.fringe_value_n_per_mm": 14.6}
    apply_tool(session, {"tool": "new", "kind": "other", "values": values})
    text = session.text
    with pytest.raises(InputError, match="holds no frame besides"):
        apply_tool(session, {"tool": "values", "values": {"frames.no_load_dark": "unloaded.png"}})
    assert session.text == text and session.count(session.scene()) == 1


KILLED = """
import sys
from isochrome.setup_page import apply_tool, open_session
session = open_session(sys.argv[1])
print("ready", flush=True)
n = 0
while True:
    n += 1
    apply_tool(session, {"tool": "values", "values": {"load.normal_n": float(n)}})
    apply_tool(session, {"tool": "save"})
    print(n, flush=True)
"""


@pytest.mark.long
@pytest.mark.parametrize("times", [1, pytest.param(3, marks=pytest.mark.study)])
def test_a_save_that_is_killed_leaves_a_whole_scene(made, fresh, times):
    """At a moment of chance: the file is a scene, the last or the one before."""
    apply_tool(made, {"tool": "save"})
    whole = (fresh / "scene.toml").read_text("utf-8")
    rng = np.random.default_rng(times)
    for _ in range(times):
        command = [sys.executable, "-c", KILLED, str(fresh / "captured.tif")]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout.readline() == "ready\n"
        process.stdout.readline()
        time.sleep(float(rng.uniform(0.01, 0.1)))
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
        text = (fresh / "scene.toml").read_text("utf-8")
        load = load_scene(fresh / "scene.toml").load.normal_n
        assert load >= 1.0 and len(text.splitlines()) == len(whole.splitlines())


@pytest.fixture
def folder(fresh):
    """A folder of six frames with the no-load frames among them."""
    place = fresh / "capture"
    place.mkdir()
    for number, frame in enumerate(tifffile.imread(fresh / "captured.tif")):
        Image.fromarray(frame).save(place / f"frame_{number:03d}.png")
    for light in ("dark", "bright"):
        Image.fromarray(np.squeeze(tifffile.imread(fresh / f"no-load-{light}.tif"))).save(
            place / f"no-load-{light}.png"
        )
    return place


def test_no_load_frames_beside_the_frames_of_a_folder_are_no_frames(folder, fresh):
    """On the page by their names, and from then on by the scene, as for `process`, which reads what
    the stack beside them holds."""
    session = open_session(folder)
    state = session_state(session)
    assert state["frames"]["count"] == 6
    assert state["beside"] == ["no-load-bright.png", "no-load-dark.png"]
    apply_tool(session, {"tool": "new", "kind": "contact", "values": GIVEN})
    named = {"no_load_dark": "no-load-dark.png", "no_load_bright": "no-load-bright.png"}
    assert values_of(session)["frames"] == named and session_state(session)["frames"]["count"] == 6
    apply_tool(session, {"tool": "save"})
    scene = load_scene(folder / "scene.toml")
    with open_scene_frames(folder, scene) as reader:
        images = [frame.image for frame in reader.iterate(0)]
    np.testing.assert_array_equal(images, tifffile.imread(fresh / "captured.tif"))
    # one that the scene no longer names is a frame again, here and for `process`
    apply_tool(session, {"tool": "values", "values": {"frames.no_load_dark": None}})
    state = session_state(session)
    assert state["frames"]["count"] == 7 and "no-load-dark.png" in state["beside"]
    again = open_session(folder, folder / "scene.toml")
    assert session_state(again)["frames"]["count"] == 6
