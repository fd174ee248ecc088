"""What a known point would do to the map is said before it is set, and is what the map then is."""

import re

import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.processing import anchor_preview, part_change
from isochrome.setup_page import ClickPreview, apply_tool, order_map_of_points, server

POINT = {"row": 420, "col": 100, "order": 0.42, "extremum": None}
PART = {"top_px": 300, "left_px": 0, "height_px": 190, "width_px": 300}
"""A region of the frame that takes a fraction of the whole one's time."""
SPAN = r"(\d+\.\d)\.\.(\d+\.\d)"


@pytest.fixture
def gamma_stated(made):
    """The sample's scene with its camera's gamma: what could be followed of frame 0 is one part."""
    apply_tool(made, {"tool": "values", "values": {"frames.gamma": 1.4}})
    return made


@pytest.fixture
def bench(gamma_stated):
    """The same in a region of the frame."""
    apply_tool(gamma_stated, {"tool": "region", "region": PART})
    return gamma_stated


def asked(points=(), lines=(), at=(420, 100), **more):
    return {"points": list(points), "lines": list(lines), "at": list(at), **more}


def map_after(session, points):
    """The orders of the map once the points are set, NaN where none is known."""
    apply_tool(session, {"tool": "known_order", "points": list(points)})
    shown, _ = order_map_of_points(session, 0)
    return np.where(shown > 0, (shown - 1.0) * 0.02, np.nan)


def spans(words):
    """The ranges of order that are said, in turn."""
    return [(float(low), float(high)) for low, high in re.findall(SPAN, words)]


def span_of(orders):
    """The range of a map but for a few of its pixels."""
    return tuple(np.nanpercentile(orders, (0.5, 99.5)))


@pytest.mark.long
def test_what_is_said_beforehand_is_what_the_map_then_is(bench):
    preview = ClickPreview(bench)
    first = preview.answer(0, asked([POINT]))
    assert first["kind"] == "new" and "no order is known in it yet" in first["words"]
    before = map_after(bench, [POINT])
    (said,) = spans(first["words"])
    assert said == pytest.approx(span_of(before), abs=0.15)
    assert first["share"] == pytest.approx(np.isfinite(before).mean(), abs=0.05)
    other = POINT | {"order": 1.42}
    moved = preview.answer(0, asked([other]))
    assert moved["kind"] == "changed" or "1 whole order" in moved["words"]
    after = map_after(bench, [other])
    old, new = spans(moved["words"])
    assert old == pytest.approx(span_of(before), abs=0.15)
    assert new == pytest.approx(span_of(after), abs=0.15)
    same = preview.answer(0, asked([other, other | {"row": 425}], at=(425, 100)))
    assert same["kind"] == "same"


def test_a_part_that_is_shifted_by_whole_orders_says_by_how_many():
    order = np.linspace(1.4, 3.9, 100)
    kind, words = part_change(order, order - 1.0, "the part", "this point")
    assert (kind, words) == (
        "moved",
        "the part moves from 1.4..3.9 to 0.4..2.9, 1 whole order down",
    )
    unknown = np.full(100, np.nan)
    assert part_change(unknown, unknown, "it", "this point")[0] == "nothing"
    assert part_change(order, unknown, "it", "this point")[0] == "lost"
    assert part_change(order, np.abs(order - 3.0), "it", "this point")[0] == "changed"


@pytest.mark.long
def test_where_no_fringe_is_followed_a_point_would_anchor_nothing(bench):
    preview = ClickPreview(bench)
    triangle = [[320, 10], [480, 10], [480, 200]]
    apply_tool(bench, {"tool": "polygon", "points": triangle})
    outside = preview.answer(0, asked([POINT | {"row": 10}], at=(10, 100)))
    assert outside["words"] == "outside of the region: this point would anchor nothing."
    masked = preview.answer(0, asked([POINT | {"row": 330, "col": 250}], at=(330, 250)))
    assert masked["words"] == "no fringe could be followed here: this point would anchor nothing."
    assert masked["kind"] == outside["kind"] == "nothing"
    assert np.isnan(map_after(bench, [POINT | {"row": 330, "col": 250}])).all()
    inside = preview.answer(0, asked([POINT | {"row": 440, "col": 80}], at=(440, 80)))
    assert "of the region" in inside["words"]


@pytest.mark.long
def test_what_fits_no_fringe_or_would_be_refused_is_an_answer_and_changes_nothing(bench):
    text, revision, preview = bench.text, bench.revision, ClickPreview(bench)
    found = preview.answer(0, asked([POINT | {"order": 0.0}]))
    assert found["kind"] == "nothing" and "stays without an order" in found["words"]
    assert any("fits no fringe there" in said for said in found["said"])
    assert (bench.text, bench.revision) == (text, revision)
    line = {"points": [[420, 100], [425, 104]], "order": 0.5}
    found = preview.answer(0, asked(lines=[line], on_line=True))
    assert "this line would anchor nothing" in found["words"] or spans(found["words"])
    one = {"points": [[420, 100]], "order": 1}  # a line of one place
    found = preview.answer(0, asked(lines=[one]))
    assert found["kind"] == "nothing" and "frames.known_line" in found["words"]
    assert preview.answer(9, asked([POINT]))["kind"] == "nothing"


def test_a_frame_is_followed_once_for_all_places_that_are_asked(bench, monkeypatch):
    """To follow it takes over a second, to ask a place of it a tenth."""
    part = {"top_px": 380, "left_px": 0, "height_px": 110, "width_px": 200}
    apply_tool(bench, {"tool": "region", "region": part})
    followed = []

    def counted(frames, scene, index):
        followed.append(index)
        return anchor_preview(frames, scene, index)

    monkeypatch.setattr(server, "anchor_preview", counted)
    preview = ClickPreview(bench)
    ready = preview.answer(0, {"points": [], "lines": []})
    assert ready["kind"] == "ready" and ready["words"] == ""
    for row in (400, 410, 420, 430, 440):
        preview.answer(0, asked([POINT | {"row": row}], at=(row, 100)))
    assert followed == [0]
    other = preview.answer(1, {"points": [], "lines": []})
    assert other["kind"] == "ready" and followed == [0, 1]


def test_what_is_no_point_is_refused(bench):
    preview = ClickPreview(bench)
    for wrong in (
        asked([{"row": "a", "col": 1, "order": 0}]), asked([{}]), asked(at=(1,)), {"at": [1, 2]},
        asked(lines=[{"points": [1, 2], "order": 1}]), asked(at=("x", 1)), asked(at=(1, None)),
        asked([POINT | {"row": float("inf")}]), asked([POINT | {"col": float("nan")}]),
    ):  # fmt: skip
        with pytest.raises(InputError):
            preview.answer(0, wrong)
    found = preview.answer(0, asked([POINT | {"order": float("nan")}]))  # as a click would say
    assert found["kind"] == "nothing" and "order" in found["words"]


def words_at(own, row, col):
    """What is said of a place on which the mouse rests."""
    from .test_setup_browser import place_on_screen

    own.page.mouse.move(*place_on_screen(own, row - 4, col + 3))
    own.page.mouse.move(*place_on_screen(own, row, col))
    own.page.wait_for_function("() => would.found !== null")
    assert own.page.is_visible("#preview-box")
    words = own.page.text_content("#preview")
    assert own.page.text_content("#preview-box") in words
    return words


@pytest.mark.browser
def test_the_words_beside_the_mouse_are_what_the_map_is_after_the_click(chromium, gamma_stated):
    """Of the whole frame."""
    from .test_setup_browser import tab

    with tab(chromium, gamma_stated) as own:
        page = own.page
        own.tool("order")
        page.fill("#new-order", "0.42")
        stage = page.locator("#stage").bounding_box()
        words = words_at(own, 420, 100)
        assert page.locator("#stage").bounding_box() == stage  # the picture does not move
        assert words.startswith("Order 0.42 here: the part under it")
        assert page.get_attribute("#preview", "aria-live") == "polite"
        assert gamma_stated.scene().frames.known_order == ()
        page.mouse.down()
        page.mouse.up()
        page.wait_for_function("() => page.state.known_order.length === 1")
        assert page.is_hidden("#preview-box")
        page.click("#show-map")
        page.wait_for_function("() => shown.map !== null")
        levels = np.array(page.evaluate("Array.from(shown.map.orders)"))
        orders = np.where(levels > 0, (levels - 1.0) * 0.02, np.nan)
        (said,) = spans(words)
        assert said == pytest.approx(span_of(orders), abs=0.15)
        share = float(re.search(r"(\d+) % of the frame", words)[1]) / 100.0
        assert share == pytest.approx(np.isfinite(orders).mean(), abs=0.05)


@pytest.mark.browser
def test_a_number_that_is_typed_says_what_it_would_do_before_it_is_taken(chromium, bench):
    apply_tool(bench, {"tool": "known_order", "points": [POINT]})
    from .test_setup_browser import tab

    with tab(chromium, bench) as own:
        page = own.page
        own.tool("order")
        page.focus("#point-0-order")
        page.keyboard.press("Control+a")
        page.keyboard.type("1.42")
        page.wait_for_function("() => would.found !== null")
        words = page.text_content("#preview")
        assert words.startswith("Order 1.42 here: the part under it") and len(spans(words)) == 2
        assert bench.scene().frames.known_order[0].order == 0.42
        page.keyboard.press("Tab")
        page.wait_for_function("() => page.state.known_order[0].order === 1.42")
        after = map_after(bench, [POINT | {"order": 1.42}])
        assert spans(words)[1] == pytest.approx(span_of(after), abs=0.15)
        own.tool("look")
        assert page.is_hidden("#preview") and page.is_hidden("#preview-box")


@pytest.mark.browser
def test_the_keys_alone_are_told_what_enter_would_set(chromium, bench):
    from .test_setup_browser import tab

    with tab(chromium, bench) as own:
        page = own.page
        page.focus("input[name=tool]:checked")
        while page.evaluate("tool") != "order":
            page.keyboard.press("ArrowDown")
        while page.evaluate("document.activeElement.id") != "stage":
            page.keyboard.press("Tab")
        page.wait_for_function("() => would.found !== null")
        assert "Order 0 here" in page.text_content("#preview")
