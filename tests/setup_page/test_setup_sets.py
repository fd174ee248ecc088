"""Calibration sets on the set-up page: without a browser, and from fresh images to f_sigma in one.
The truth is what was put into the sample images: see their truth.json."""

import json
import shutil
import tomllib

import pytest

import isochrome
from isochrome.calibration import Calibration, ImageFit, cause_sentence
from isochrome.errors import InputError
from isochrome.samples import samples_path
from isochrome.setup_page import apply_tool, calibration_answer, open_session, session_state

BEAM = {"beam.height_mm": 20, "beam.inner_span_mm": 40, "beam.outer_span_mm": 100}
MOST_ACTIONS = 12


def images(kind, place):
    """A fresh folder with a sample's images, and no set."""
    for file in sorted((samples_path() / kind).glob("*.png")):
        shutil.copy(file, place)
    return place


@pytest.fixture
def bending(tmp_path):
    """A session on the images of a beam."""
    return open_session(images("bending", tmp_path), calibration="beam")


@pytest.fixture
def made(bending):
    """The same with its set, whose scale is not known yet."""
    loads = [one["load_n"] for one in session_state(bending)["images"]]
    asked = {"tool": "new", "kind": "bending", "values": BEAM, "loads": loads}
    apply_tool(bending, asked)
    return bending


def test_the_files_names_tell_the_loads(bending, tmp_path):
    assert [one["load_n"] for one in session_state(bending)["images"]] == [60, 100, 150, 200]
    folder = tmp_path / "others"
    folder.mkdir()
    (first, second, third, _) = sorted(tmp_path.glob("*.png"))
    for source, name in ((first, "a 12,5 N.png"), (second, "DSC_0008.png"), (third, "2N 3N.png")):
        shutil.copy(source, folder / name)
    other = open_session(folder, calibration="disc")
    told = {one["file"]: one["load_n"] for one in session_state(other)["images"]}
    assert told == {"2N 3N.png": None, "DSC_0008.png": None, "a 12,5 N.png": 12.5}


def test_what_is_still_open_is_said_and_not_saved(made):
    with pytest.raises(InputError, match=r"camera\.pixel_mm"):
        apply_tool(made, {"tool": "save"})
    assert not made.scene_file.exists()
    apply_tool(made, {"tool": "values", "values": {"camera.pixel_mm": 0.05}})
    apply_tool(made, {"tool": "save"})
    assert isochrome.calibration.load_set(made.scene_file).camera.pixel_mm == 0.05
    with pytest.raises(InputError, match="not beside the scene"):
        apply_tool(made, {"tool": "text", "text": made.text.replace("bending-060N", "../other")})
    with pytest.raises(InputError, match=r"\[disc\] is none of a set of a beam"):
        apply_tool(made, {"tool": "text", "text": made.text + "[disc]\ndiameter_mm = 5.0\n"})


def test_the_inner_rollers_give_the_scale_and_what_is_read(made):
    """Its height of 20 mm over 400 px, each point half a pixel uncertain."""
    apply_tool(made, {"tool": "edges", "points": [[20.0, 200.0], [420.0, 200.0]]})
    values = session_state(made)["values"]
    assert values["camera.pixel_mm"] == pytest.approx(0.05)
    # 0.05 mm times 0.5 px * sqrt(2) over 400 px
    assert values["uncertainty.pixel_mm"] == pytest.approx(8.8e-5, rel=0.01)
    # 40 mm over 400 px is 0.1 mm; half the height of 20 mm, 100 px, is left at either side
    apply_tool(made, {"tool": "rollers", "points": [[30.0, 440.0], [30.0, 40.0]]})
    scene = made.scene()
    assert scene.camera.pixel_mm == pytest.approx(0.1)
    roi = scene.frames.roi
    assert (roi.left_px, roi.width_px, roi.top_px, roi.height_px) == (140, 201, 0, 440)
    before = made.text
    with pytest.raises(InputError, match="nothing is left to read"):
        apply_tool(made, {"tool": "rollers", "points": [[30.0, 60.0], [30.0, 40.0]]})
    assert made.text == before


def test_another_scale_takes_the_uncertainty_of_the_last_one_away(made):
    """By number and by two points of another length; with its own, it is that one."""
    edges = {"tool": "edges", "points": [[50.0, 300.0], [450.0, 300.0]]}
    for other in (
        {"tool": "values", "values": {"camera.pixel_mm": 0.04}},
        {"tool": "scale", "points": [[0.0, 0.0], [0.0, 400.0]], "length_mm": 12.0},
    ):
        apply_tool(made, edges)
        assert "pixel_mm" in tomllib.loads(made.text)["uncertainty"]
        apply_tool(made, other)
        assert "pixel_mm" not in tomllib.loads(made.text).get("uncertainty", {})
    own = {"camera.pixel_mm": 0.05, "uncertainty.pixel_mm": 1e-5}
    apply_tool(made, {"tool": "values", "values": own})
    assert tomllib.loads(made.text)["uncertainty"]["pixel_mm"] == 1e-5


def test_three_points_on_the_rim_give_the_square_about_it(tmp_path):
    own = open_session(images("disc", tmp_path), calibration="disc")
    loads = [one["load_n"] for one in session_state(own)["images"]]
    apply_tool(
        own,
        {"tool": "new", "kind": "diametral", "values": {"disc.diameter_mm": 50}, "loads": loads},
    )
    # of a circle about (200, 220) of 150 px: 162 px at either side
    points = [[50.0, 220.0], [200.0, 370.0], [350.0, 220.0]]
    apply_tool(own, {"tool": "rim", "points": points})
    roi = own.scene().frames.roi
    assert (roi.top_px, roi.left_px, roi.height_px, roi.width_px) == (38, 58, 324, 324)


def test_a_load_changes_its_line_alone_and_comments_stay(made):
    apply_tool(made, {"tool": "values", "values": {"camera.pixel_mm": 0.05}})
    text = made.text.replace("load_n = 100.0", "load_n = 100.0   # by the cell")
    apply_tool(made, {"tool": "text", "text": text})
    apply_tool(made, {"tool": "loads", "loads": [60.0, 101.5, 150.0, 200.0]})
    assert made.text == text.replace("load_n = 100.0 ", "load_n = 101.5 ")
    apply_tool(made, {"tool": "loads", "loads": [60.0, None, 150.0, 200.0]})
    assert "bending-100N" not in made.text and "bending-150N" in made.text
    with pytest.raises(InputError, match="4 images"):
        apply_tool(made, {"tool": "loads", "loads": [60.0]})
    # comments of a table, above it and behind its values, and a load with its uncertainty
    apply_tool(made, {"tool": "values", "values": {"camera.pixel_mm": 0.05}})
    apply_tool(made, {"tool": "loads", "loads": [60.0, None, 150.0, None]})
    sure = "load_n = { value = 150.0, standard_uncertainty = 0.5 }  # by the cell"
    text = made.text.replace("load_n = 60.0", "load_n = 60.0  # by hand")
    text = text.replace("load_n = 150.0", f"# the bright one\n{sure}")
    text = text.replace("[[image]]", "# an image\n[[image]]", 1) + "# the others are blurred\n"
    apply_tool(made, {"tool": "text", "text": text})
    apply_tool(made, {"tool": "loads", "loads": [60.0, 100.0, 150.0, 200.0]})
    lines = iter(made.text.splitlines())
    assert all(line in lines for line in text.splitlines())  # all of them, in their order
    assert [one.load_n for one in made.calibration_set().image] == [60.0, 150.0, 100.0, 200.0]
    apply_tool(made, {"tool": "loads", "loads": [61.0, None, 150.0, None]})
    assert made.text.split() == text.replace("60.0  # by hand", "61.0  # by hand").split()


def test_a_sets_file_alone_opens_it_and_a_scenes_page_has_no_such_tool(made, tmp_path):
    apply_tool(made, {"tool": "values", "values": {"camera.pixel_mm": 0.05}})
    apply_tool(made, {"tool": "save"})
    again = open_session(made.scene_file)
    assert again.subject == "bending" and again.count(None) == 4 and again.is_saved
    assert open_session(tmp_path, made.scene_file).subject == "bending"
    with pytest.raises(InputError, match=r"holds no \[disc\]"):
        open_session(tmp_path, made.scene_file, calibration="disc")
    with pytest.raises(InputError, match="is none of beam, disc"):
        open_session(tmp_path, calibration="bending")
    scene = open_session(tmp_path / "bending-060N.png", tmp_path / "scene.toml")
    assert scene.subject is None
    with pytest.raises(InputError, match="--calibration"):
        apply_tool(scene, {"tool": "loads", "loads": [60.0]})


def calibrated_on_page(own):
    """Press Make, Calibrate and Save, and wait for what is found."""
    own.click("#make")
    own.actions += 1
    own.page.click("#calibrate")
    own.page.wait_for_selector("#fit-result table")
    own.settle()
    own.status("is calibrated")
    own.click("#save")
    own.status("Saved")


@pytest.mark.browser
@pytest.mark.parametrize("width", [360, 1280])
def test_the_sets_page_passes_an_automated_check_and_its_tools_go_by_keys(chromium, made, width):
    from axe_playwright_python.sync_playwright import Axe

    from .test_setup_browser import tab

    apply_tool(made, {"tool": "values", "values": {"camera.pixel_mm": 0.05}})
    view = {"width": width, "height": 800}
    with tab(chromium, made, viewport=view, bypass_csp=True) as own:
        page = own.page
        page.eval_on_selector_all("details", "all => all.forEach(one => one.open = true)")
        for name in ("edges", "rollers", "region", "mask"):
            own.tool(name)
            found = Axe().run(page).response
            assert len(found["passes"]) > 15 and found["violations"] == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.focus("input[name=tool]:checked")
        while page.evaluate("tool") != "edges":
            page.keyboard.press("ArrowUp")
        page.focus("#stage")
        for key in ("ArrowUp", "ArrowDown"):
            page.keyboard.press("Enter")
            for _ in range(20):
                page.keyboard.press(f"Shift+{key}")
        own.settle(400)
        # 400 px apart, and the column by which the page sets the second one beside the first
        assert made.scene().camera.pixel_mm == pytest.approx(20.0 / 400.0, rel=0.15)
        page.fill("#load-1", "101,5")
        page.keyboard.press("Tab")
        page.wait_for_function("() => page.state.images[1].load_n === 101.5")


CAUSES = (
    {"key": "camera.distortion", "cause": "the lens's distortion", "value": -0.00213456,
     "standard_uncertainty": 0.00012},
    {"key": None, "cause": "the light's band of wavelengths", "value": 0.0171,
     "standard_uncertainty": 0.0011},
    {"key": "frames.gamma", "cause": "the camera's tone curve", "value": 1.1,
     "standard_uncertainty": 0.001},
)  # fmt: skip
"""As a calibration gives them: a gamma is a factor to the set's own."""


def with_causes(session, monkeypatch, residual=None):
    """What the page is told where a calibration has found these."""
    image = ImageFit(file="a.png", load_n=60.0, order=1.0, standard_uncertainty=0.1, chi=1.0)
    plain = "one of the loads is far from the line"
    found = Calibration(
        specimen="beam", fringe_value_n_per_mm=14.6, standard_uncertainty=0.1, chi=1.0,
        order_at_zero_load=None, order_at_zero_load_uncertainty=None, slope_per_n=0.01,
        images=(image,), budget=(), warnings=(*map(cause_sentence, CAUSES), plain),
        causes=CAUSES, residual=residual,
    )  # fmt: skip
    run = "calibrate_bending" if session.subject == "bending" else "calibrate_disc"
    monkeypatch.setattr(f"isochrome.setup_page.session.{run}", lambda given: found)
    told = calibration_answer(session)
    assert told["warnings"] == [plain]
    return told


def test_causes_are_said_in_plain_words_with_the_key_that_states_them(made, monkeypatch):
    apply_tool(made, {"tool": "values", "values": {"camera.pixel_mm": 0.05, "frames.gamma": 1.4}})
    told = with_causes(made, monkeypatch, residual={"largest_order": 0.123})["causes"]
    lens, band, tone, stress = told
    assert lens["words"] == "The lens's distortion" and lens["note"] == "Of the corner's distance."
    assert (lens["key"], lens["line"]) == ("camera.distortion", "distortion = -0.002135")
    assert band["key"] is None and "fill in the wavelength in step 1" in band["note"]
    assert tone["value"] == pytest.approx(1.54, abs=1e-3) and tone["text"].startswith("1.540")
    assert stress["key"] is None and "no key of a set states a field" in stress["note"]
    assert not any("." in one["words"] or "_" in one["words"] for one in told)
    for one in (lens, tone):
        apply_tool(made, {"tool": "values", "values": {one["key"]: one["value"]}})
    assert made.calibration_set().camera.distortion == -0.002135
    assert made.calibration_set().gamma == pytest.approx(1.54, abs=1e-3)


@pytest.mark.browser
@pytest.mark.parametrize("width", [360, 1280])
def test_a_cause_is_taken_into_the_set_by_its_button(chromium, made, monkeypatch, width):
    from axe_playwright_python.sync_playwright import Axe

    from .test_setup_browser import tab

    apply_tool(made, {"tool": "values", "values": {"camera.pixel_mm": 0.05}})
    told = with_causes(made, monkeypatch)
    view = {"width": width, "height": 800}
    with tab(chromium, made, viewport=view, bypass_csp=True) as own:
        page = own.page
        page.evaluate("told => { showCalibration(told); get('step-fit').open = true; }", told)
        assert page.locator("#fit-result button").count() == 2  # the band has no key without more
        assert "fill in the wavelength" in page.text_content("#fit-result")
        assert "frames.gamma" not in page.inner_text("#fit-result")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert Axe().run(page).response["violations"] == []
        page.get_by_role("button", name="Take The lens's distortion").click()
        own.settle()
        own.status("taken into the set")
        assert made.calibration_set().camera.distortion == -0.002135


@pytest.mark.browser
@pytest.mark.parametrize("kind", ["bending", pytest.param("disc", marks=pytest.mark.study)])
def test_from_fresh_images_to_a_set_that_gives_f_sigma(chromium, kind, tmp_path):
    """In twelve actions at most; sizes, scale and gamma are in the samples' README."""
    folder = images(kind, tmp_path)
    for file in sorted(folder.glob("*.png"))[1:-1]:
        file.unlink()  # the least and the largest load are enough
    calibration = {"bending": "beam", "disc": "disc"}[kind]
    given = {
        "bending": {
            "beam.height_mm": "20", "beam.inner_span_mm": "40", "beam.outer_span_mm": "100",
            "uncertainty.load_percent": "0,3", "uncertainty.span_mm": "0.05",
            "camera.pixel_mm": "0.05", "frames.gamma": "1.4",
        },
        "disc": {
            "disc.diameter_mm": "50", "uncertainty.load_percent": "0.3",
            "uncertainty.diameter_mm": "0.02", "frames.gamma": "1.4",
        },
    }[kind]  # fmt: skip
    from .test_setup_browser import tab

    with tab(chromium, open_session(folder, calibration=calibration), quiet=False) as own:
        for key, text in given.items():
            own.fill(key, text)
        calibrated_on_page(own)
        assert own.actions <= MOST_ACTIONS and own.said == []
        own.page.wait_for_function("() => Number(canvas.dataset.outlines) > 0")
        own.page.wait_for_selector("#check-result[data-ok=true]")
    run = isochrome.calibrate_bending if kind == "bending" else isochrome.calibrate_disc
    found = run(folder / "set.toml")
    truth = json.loads((samples_path() / kind / "truth.json").read_text())
    true = truth["fringe_value_n_per_mm"]
    # the sizes and loads are exact: all that is left of the ± is the images', see the samples
    assert abs(found.fringe_value_n_per_mm - true) < found.standard_uncertainty and found.chi < 1.05
