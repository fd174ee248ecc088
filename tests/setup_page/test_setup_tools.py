"""The page's tools in a real browser: points, lines, fields and what they leave in the scene."""

import pytest

from browsers import skip_without_browser
from isochrome.setup_page import apply_tool

from .conftest import GIVEN
from .test_setup_browser import place_on_screen, tab

pytestmark = pytest.mark.browser

skip_without_browser()


def click(own, row, col):
    """Click a pixel of the picture, and wait until the scene has it."""
    own.page.mouse.click(*place_on_screen(own, row, col))
    own.settle(80)


def test_two_clicks_make_the_surface_line_and_stay_where_they_were_set(chromium, made):
    """A click off any point begins a new pair; the answer leaves the user's points alone."""
    with tab(chromium, made) as own:
        page = own.page
        own.tool("surface")
        before = page.evaluate("page.state.revision")
        click(own, 20, 250)
        assert page.evaluate("page.state.revision") == before
        assert len(page.evaluate("own.surface")) == 1
        click(own, 20, 400)
        camera = made.scene().camera
        assert camera.roll_deg in (None, 0.0)
        assert page.evaluate("page.state.place[0]") == pytest.approx(20.0, abs=1.0)
        assert [one["col"] for one in page.evaluate("own.surface")] == pytest.approx(
            [250, 400], abs=1.0
        )
        click(own, 60, 200)
        assert len(page.evaluate("own.surface")) == 1
        click(own, 30, 500)
        assert made.scene().camera.roll_deg == pytest.approx(5.71, abs=0.3)
        own.click("#clear-tool")
        assert made.scene().camera.roll_deg in (None, 0.0) and page.evaluate("own.surface") == []
        page.focus("#stage")
        page.keyboard.press("Enter")
        page.keyboard.press("Shift+ArrowLeft")
        page.keyboard.press("Enter")
        own.settle(350)
        assert len(page.evaluate("own.surface")) == 2
        page.keyboard.press("Enter")
        assert len(page.evaluate("own.surface")) == 1


def test_a_contact_above_the_picture_can_be_set_there(chromium, made):
    """Its place above the first row is no edge of the picture."""
    with tab(chromium, made) as own:
        own.tool("contact")
        own.page.fill("#point-0-row", "-40")
        own.page.press("#point-0-row", "Tab")
        own.settle(80)
        assert made.scene().camera.top_mm == pytest.approx(39.5 * 0.00607, abs=1e-6)
        own.page.focus("#stage")
        own.page.keyboard.press("ArrowRight")
        own.settle(350)
        assert made.scene().camera.top_mm == pytest.approx(39.5 * 0.00607, abs=1e-6)


@pytest.fixture
def lined(made):
    """A scene with two known lines and two free edges."""
    ends = ([[100, 100], [150, 140]], [[300, 400], [350, 460]])
    lines = [{"points": points, "order": order} for points, order in zip(ends, (1, 3), strict=True)]
    apply_tool(made, {"tool": "known_line", "lines": lines})
    apply_tool(made, {"tool": "free_boundary", "lines": [{"points": points} for points in ends]})
    return made


@pytest.mark.parametrize("name", ["line", "boundary"])
def test_a_second_line_is_dragged_chosen_by_keys_and_taken_away(chromium, lined, name):
    """The first line is left as it is, whatever is done to the second."""

    def lines():
        frames = lined.scene().frames
        found = frames.known_line if name == "line" else frames.free_boundary
        return [one.places for one in found]

    first, second = lines()
    with tab(chromium, lined) as own:
        page = own.page
        own.tool(name)
        page.mouse.move(*place_on_screen(own, 350, 460))
        page.mouse.down()
        page.mouse.move(*place_on_screen(own, 400, 470), steps=3)
        page.mouse.up()
        own.settle(80)
        assert lines()[0] == first and lines()[1][0] == second[0]
        assert lines()[1][1] == pytest.approx((400, 470), abs=1.0) and page.evaluate("line") == 1
        assert "Line 2 of 2" in page.locator("#line-number option:checked").inner_text()
        page.focus("#line-number")
        page.keyboard.press("ArrowUp")
        assert page.evaluate("line") == 0
        page.keyboard.press("ArrowDown")
        assert page.evaluate("line") == 1
        own.click("#new-line")
        click(own, 60, 500)  # the first point of a third line, left off
        click(own, 300, 400)
        assert page.evaluate("[line, own[tool].length]") == [1, 2]
        page.focus("#clear-line")
        page.keyboard.press("Enter")
        own.settle(80)
        assert lines() == [first]


@pytest.mark.parametrize("given", ["-1", "thick"])
def test_a_refused_value_leaves_its_field_and_save_says_that_it_is_without_it(
    chromium, made, given
):
    """One that the scene refuses, and one that is no number; also that of a slider."""
    field = "[id='field-specimen.thickness_mm']"
    with tab(chromium, made, quiet=False) as own:
        page = own.page
        page.fill(field, given)
        page.press(field, "Tab")
        own.settle(80)
        assert page.input_value(field) == "4"
        words = page.text_content("#status")
        assert "hickness" in words and "wrong" in page.get_attribute("#status", "class")
        own.click("#save")
        own.status("Saved, without the value that was refused: " + words)
        own.click("#save")
        assert page.text_content("#status") == "Saved."
        slider = "[id='number-specimen.fringe_value_n_per_mm']"
        page.fill(slider, given)
        page.press(slider, "Tab")
        own.settle(80)
        assert page.input_value(slider) == "14.6"
        assert "wrong" in page.get_attribute("#status", "class")
        assert made.scene().specimen.fringe_value_n_per_mm == 14.6


def test_text_that_is_typed_and_not_used_stays(chromium, made):
    """Whatever tool is used meanwhile; Save says that it is without it."""
    with tab(chromium, made) as own:
        page = own.page
        page.locator("#step-text summary").click()
        assert page.is_hidden("#text-typed")
        typed = page.input_value("#text").replace("normal_n = 40.0", "normal_n = 55.0")
        page.fill("#text", typed)
        assert page.is_visible("#text-typed")
        own.fill("specimen.thickness_mm", "5")
        page.keyboard.press("Tab")
        own.settle(80)
        assert made.scene().specimen.thickness_mm == 5.0 and page.input_value("#text") == typed
        own.click("#save")
        own.status("Saved, without the text that is typed")
        own.click("#use-text")
        assert made.scene().load.normal_n == 55.0 and page.is_hidden("#text-typed")
        page.fill("#text", "nothing")
        page.click("#drop-text")
        assert page.input_value("#text") == made.text and page.is_hidden("#text-typed")
        own.click("#undo")
        assert page.input_value("#text") == made.text


def test_a_mask_that_loses_its_third_corner_is_said_to_stay(chromium, made):
    corners = [[100, 100], [400, 100], [400, 500]]
    apply_tool(made, {"tool": "polygon", "points": corners})
    with tab(chromium, made) as own:
        own.tool("mask")
        own.page.focus("#stage")
        own.page.keyboard.press("Delete")
        own.status("A mask needs three corners; the scene keeps the last one.")
        assert len(made.scene().frames.polygon_px) == 3
        own.click("#clear-tool")
        own.page.wait_for_function("() => page.state.polygon.length === 0")
        assert made.scene().frames.polygon_px is None
        own.click("#undo")
        assert len(own.page.evaluate("points()")) == 3


def test_values_of_a_wrong_model_are_not_offered_together(chromium, made):
    row = {"key": "load.normal_n", "value": 44.0, "text": "44", "line": "", "asked": False}
    told = {"frame": 0, "values": [row], "warnings": [], "kept_share": 0.5}
    with tab(chromium, made, quiet=False) as own:
        page = own.page
        page.locator("#step-fit summary").click()
        show = "given => { page.fit = given; showFit(); }"
        page.evaluate(show, told | {"chi": 4.2, "wrong": True})
        assert page.is_hidden("#take-all") and "chi is over 3" in page.text_content("#fit-result")
        page.evaluate(show, told | {"chi": 1.1, "wrong": False})
        assert page.is_visible("#take-all")
        assert "chi is over 3" not in page.text_content("#fit-result")


def test_the_map_of_points_is_read_out_renewed_and_of_any_opacity(chromium, made):
    """N stands under the mouse; another point renews the map, another frame takes it away."""
    point = {"row": 420, "col": 100, "order": 0.42}
    apply_tool(made, {"tool": "values", "values": {"frames.gamma": 1.4}})
    apply_tool(made, {"tool": "known_order", "points": [point]})
    with tab(chromium, made) as own:
        page = own.page
        own.tool("order")
        page.click("#show-map")
        page.wait_for_function("() => shown.map !== null")
        page.mouse.move(*place_on_screen(own, 420, 100))
        assert "N = 0.4" in page.text_content("#readout")
        lines = page.locator("#map-said p").all_inner_texts()
        assert len(lines) == 1 and "line of order 0.5" in lines[0]
        page.fill("#wipe", "100")
        page.wait_for_timeout(100)
        before = page.locator("#canvas").screenshot()
        page.fill("#opacity", "20")
        page.wait_for_timeout(100)
        assert page.locator("#canvas").screenshot() != before
        page.evaluate("shown.map.first = true")
        page.fill("#point-0-order", "1.42")
        page.press("#point-0-order", "Tab")
        page.wait_for_function("() => shown.map && !shown.map.first")
        page.mouse.move(*place_on_screen(own, 420, 100))
        assert "N = 1.4" in page.text_content("#readout")
        page.fill("#frame-number", "1")
        page.press("#frame-number", "Tab")
        page.wait_for_function("() => shown.map === null")


def test_something_else_has_no_model_to_slide(chromium, session):
    values = {"specimen.thickness_mm": 4.0, "specimen.fringe_value_n_per_mm": 14.6}
    apply_tool(session, {"tool": "new", "kind": "other", "values": values})
    with tab(chromium, session) as own:
        page = own.page
        for name in ("show-model", "opacity", "wipe", "blink"):
            assert page.is_disabled(f"#{name}")
        for step in ("step-place", "step-model"):
            page.locator(f"#{step} summary").click()
        assert page.is_visible("#order-words") and page.is_hidden("#place-words")
        assert page.is_hidden("#slider-words")
        assert "no model of something else" in page.text_content("#sliders")
        own.click("#undo")
        assert page.is_visible("#place-words") and page.is_hidden("#order-words")
        page.select_option("#kind", "other")
        assert page.is_visible("#order-words") and page.is_hidden("#place-words")


def test_on_a_narrow_page_numbers_stay_whole_and_the_next_step_comes_into_view(chromium, session):
    view = {"width": 360, "height": 740}
    rows = [
        {"key": key, "value": 1.0, "text": text, "line": "", "asked": True}
        for key, text in (
            ("specimen.fringe_value_n_per_mm", "14.6012 ± 0.0034"),
            ("wear.coefficient_mm2_per_n", "1.2345e-09 ± 0.0067e-09"),
        )
    ]
    told = {"frame": 0, "values": rows, "warnings": [], "kept_share": 0.5, "chi": 1.0}
    with tab(chromium, session, viewport=view) as own:
        page = own.page
        for key, value in GIVEN.items():
            if isinstance(value, bool):
                value = str(value).lower()
            text = " ".join(map(str, value)) if isinstance(value, list) else str(value)
            own.page.evaluate("([key, text]) => { get('field-' + key).value = text; }", [key, text])
        own.click("#make")
        page.wait_for_function("() => page.state.has_scene")
        page.wait_for_timeout(100)
        top = page.evaluate("get('step-place').getBoundingClientRect().top")
        assert 0 <= top < 370
        page.evaluate("given => { page.fit = given; showFit(); }", told)
        page.locator("#step-fit summary").click()
        heights = page.eval_on_selector_all(
            "#fit-result td.value",
            "all => all.map(one => { const range = document.createRange();"
            " range.selectNodeContents(one); return range.getClientRects().length; })",
        )
        assert heights == [1, 1] and page.evaluate("document.documentElement.scrollWidth") <= 360
