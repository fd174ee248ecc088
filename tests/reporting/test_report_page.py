"""The page of a report: what is in it, what cannot be, and how large it is."""

import base64
import hashlib
import io
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pages import (
    COLS,
    HOSTILE,
    LEFT,
    PIXEL,
    ROWS,
    TOP,
    Page,
    charts_of,
    data_of,
    decoded,
    drawing_of,
    made_content,
    made_frame,
    order_field,
)

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.reporting import (
    SIGNAL,
    Pane,
    ReportFrame,
    ReportTable,
    choose_frames,
    encode_frames,
    order_map,
    paper_rows,
    report_html,
    write_report,
)


def test_the_policy_names_the_style_and_the_script_that_are_there(page):
    """And nothing else: no address, no inline style, no script by an attribute."""
    (policy,) = (m["content"] for m in page.of("meta") if m.get("http-equiv"))
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'" and rules["img-src"] == "data:"
    for tag, rule, text in (
        ("style", "style-src", page.inside["style"][0]),
        ("script", "script-src", page.inside["script"][1]),
    ):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert rules[rule] == f"'sha256-{digest}'", tag
    assert page.of("script")[0]["type"] == "application/json"  # data, never run
    assert len(page.of("script")) == 2 and len(page.of("style")) == 1


def test_nothing_is_fetched_from_anywhere(page):
    kinds = {image["src"].partition(",")[0] for image in page.of("img") if "src" in image}
    assert kinds == {"data:image/png;base64", "data:image/svg+xml;base64"}
    for chart in charts_of(page):
        every = [own for element in drawing_of(chart["src"]).iter() for own in element.items()]
        assert every and all(value.startswith("#") for name, value in every if "href" in name)
    links = [a["href"] for a in page.of("a")]
    assert links and all(link.startswith("#") for link in links)
    ids = {own["id"] for _, own in page.elements if "id" in own}
    assert {link[1:] for link in links} <= ids
    named = {tag for tag, _ in page.elements}
    assert not named & {"link", "iframe", "object", "embed", "form", "base", "video", "audio"}
    every = [name for _, own in page.elements for name in own]
    assert not [name for name in every if name == "style" or name.startswith("on")]


def test_hostile_names_are_text_everywhere(hostile_file, page):
    """The page has the elements that one with plain names has, and no others."""
    hostile = Page(hostile_file)
    assert {tag for tag, _ in hostile.elements} == {tag for tag, _ in page.elements}
    assert len(hostile.of("script")) == 2 and not hostile.of("svg")
    every = {name for _, own in hostile.elements for name in own}
    assert every == {name for _, own in page.elements for name in own}
    shown = hostile.text
    for name in HOSTILE[:-1]:
        assert re.sub(r"\s+", " ", name) in shown, name
    assert [frame["label"] for frame in data_of(hostile)["frames"]] == list(HOSTILE)


def test_every_text_of_a_run_is_kept_apart_from_its_neighbours(hostile_file):
    """A name that turns the direction of reading ends in its own <bdi>."""
    text = hostile_file.read_text("utf-8")
    body = re.sub(r"<script.*?</script>", "", text[text.index("<body>") :], flags=re.DOTALL)
    body = re.sub(r'"[^"]*"', "", body)  # attributes are not read in a line with others
    turned = [m.start() for m in re.finditer("\u202e", body)]
    assert len(turned) > 10
    for at in turned:
        before, behind = body[:at], body[at:]
        inside = before.rfind("<bdi>") > before.rfind("</bdi>")
        assert inside and "</bdi>" in behind, body[at - 80 : at]


def test_headings_are_in_order_and_all_that_a_report_promises_is_there(page):
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1 and levels.count(1) == 1 and all(b - a <= 1 for a, b in pairwise(levels))
    assert page.of("html")[0]["lang"] == "en"
    assert all(image.get("alt") for image in page.of("img") if "src" in image)
    ids = [own["id"] for _, own in page.elements if "id" in own]
    assert len(ids) == len(set(ids))
    text = page.text
    for words in ("Causes found", "Uncertainty budget", "Remedy", "For a paper", "Scene",
                  "N is rounded to 0.001 fringe", "two standard uncertainties"):  # fmt: skip
        assert words in text, words
    assert "A file or folder is not there, or may not be read" in text  # of the warning


def test_orders_are_within_their_stated_rounding(page):
    """Half of the 0.001 fringe that the page states, and not known where they are not known."""
    for number, frame in enumerate(data_of(page)["frames"]):
        assert (frame["rows"], frame["cols"], frame["stride"]) == (ROWS, COLS, 1)
        own = decoded(frame["order"], ROWS, COLS)
        true = order_field(number)
        assert (np.isnan(own) == np.isnan(true)).all()
        assert np.nanmax(np.abs(own - true)) <= 0.0005 + 1e-9
        assert (frame["left_mm"], frame["top_mm"], frame["pixel_mm"]) == (LEFT, TOP, PIXEL)


@pytest.mark.parametrize("order", [
    np.full((3, 4), np.nan), np.array([[-0.3, 0.0, 7.123, np.nan, 80.0]]),
    np.array([[0.0, 655.0, 1e6, np.inf]]), np.zeros((1, 1)),
])  # fmt: skip
def test_orders_of_any_kind_come_back_or_are_not_known(order):
    """What does not fit beside the smallest is given as not known, never as another order."""
    made = order_map(order)
    own = decoded(made, *order.shape)
    fits = np.isfinite(order) & (order < 600.0)
    assert np.abs(own - order)[fits].max(initial=0.0) <= 0.005 + 1e-9
    wrong = np.isfinite(own) & ~(np.abs(own - np.where(np.isfinite(order), order, np.nan)) < 0.006)
    assert not wrong.any()


def test_frames_of_noise_keep_to_their_room_and_their_places():
    """The worst case for compression: then squares of pixels stand for one, and it is said."""
    rng = np.random.default_rng(1)
    order = rng.uniform(0.0, 20.0, (400, 603))
    pane = Pane("experiment", "experiment", rng.uniform(0, 1, order.shape), (0.0, 1.0), SIGNAL)
    frame = ReportFrame(number=0, label="a", why="b", panes=(pane,), order=order, pixel_mm=0.01)
    room = 300_000
    (one, two) = encode_frames([frame, frame], room=room)
    size = sum(len(o["panes"][0]["png"]) + len(o["order"]["data"]) for o in (one, two))
    stride, first = one["stride"], one["first"]
    assert size <= room and stride > 1
    own = decoded(one["order"], one["rows"], one["cols"])
    true = order[first::stride, first::stride][: one["rows"], : one["cols"]]
    assert np.abs(own - true).max() <= 0.005 + 1e-9


def test_orders_are_rounded_to_a_thousandth_where_that_has_room():
    """A difference of some thousandths is read under the mouse; a finer picture goes before it."""
    order = np.random.default_rng(3).uniform(0.0, 20.0, (200, 300))
    pane = Pane("order", "order", order, (0.0, 20.0), SIGNAL)
    frame = ReportFrame(number=0, label="a", why="b", panes=(pane,), order=order)
    (fine,), (tight,) = (encode_frames([frame], room=room) for room in (1_000_000, 195_000))
    far = ReportFrame(number=0, label="a", why="b", panes=(pane,), order=10.0 * order)
    (coarse,) = encode_frames([far], room=1_000_000)
    steps = [one["order"]["step"] for one in (fine, tight, coarse)]
    assert steps == [0.001, 0.01, 0.01] and {fine["stride"], tight["stride"]} == {1}
    own = decoded(fine["order"], *order.shape)
    assert np.abs(own - order).max() <= 0.0005 + 1e-9
    assert np.isfinite(decoded(coarse["order"], *order.shape)).all()


@pytest.mark.long
def test_a_report_of_many_large_frames_has_room_or_is_refused(tmp_path):
    content = made_content()
    rng = np.random.default_rng(2)
    noise = rng.uniform(0.0, 20.0, (1024, 1280))
    panes = tuple(Pane(key, key, noise / 20.0, (0.0, 1.0), SIGNAL)
                  for key in ("experiment", "simulation"))  # fmt: skip
    frame = ReportFrame(number=0, label="a", why="b", panes=panes, order=noise)
    frames = [frame] * 2
    file = write_report(tmp_path / "report.html", replace(content, frames=frames))
    assert file.stat().st_size < 10e6 and "means over squares of" in file.read_text("utf-8")
    file.unlink()
    with pytest.raises(InputError, match=r"would take 10\.\d MB"):
        write_report(file, replace(content, verdict="x" * 10_000_001))
    assert not list(tmp_path.iterdir())


def test_what_grows_with_a_run_is_bounded_and_the_rest_is_named(tmp_path):
    """A warning a frame, a file a frame, a measured course in the scene: no run is too long."""
    count = 20_000
    record = {"inputs_sha256": {f"{k:06}.tif": "a" * 64 for k in range(count)}}
    own = replace(
        made_content(),
        warnings=[message("no_such_file_check", path=f"{k}.tif") for k in range(count)],
        tables=[ReportTable("fit.csv", {"frame": list(range(count))})],
        paper=paper_rows(None, record),
        scene="distances_m = 1.0\n" * count,
    )
    file = write_report(tmp_path / "report.html", own)
    assert file.stat().st_size < 1e6
    text = Page(file).text
    for words in (
        "and 19940 more of this kind", "SHA-256 of 19940 files more", "and 19940 more rows",
        "and more in the run's own file",
    ):  # fmt: skip
        assert words in text, words


@pytest.mark.long
def test_a_large_figure_of_a_run_is_made_smaller_until_it_has_room(monkeypatch):
    from PIL import Image

    room = 100_000
    monkeypatch.setattr("isochrome.reporting.page.ROOM_BYTES", 2 * room)
    bare = len(report_html(replace(made_content(), frames=())))
    noise = np.random.default_rng(3).integers(0, 256, (600, 500, 3), np.uint8)
    file = io.BytesIO()
    Image.fromarray(noise).save(file, "PNG")
    assert len(file.getvalue()) > 4 * room  # even half as wide it has no room
    own = report_html(replace(made_content(), frames=(), picture=file.getvalue()))
    assert bare + 0.2 * room < len(own) < bare + 1.1 * room


def test_a_figure_that_has_room_when_it_is_packed_tighter_is_whole(monkeypatch):
    from PIL import Image

    stripes = np.random.default_rng(3).integers(0, 256, (1, 500, 3), np.uint8)
    whole, (loose, tight) = np.tile(stripes, (400, 1, 1)), (io.BytesIO(), io.BytesIO())
    Image.fromarray(whole).save(loose, "PNG", compress_level=1)
    Image.fromarray(whole).save(tight, "PNG")
    room = (len(loose.getvalue()) + len(tight.getvalue())) * 2 // 3  # between the two, as base64
    monkeypatch.setattr("isochrome.reporting.page.ROOM_BYTES", 2 * room)
    page = report_html(replace(made_content(), frames=(), picture=loose.getvalue()))
    pictures = re.findall('data:image/png;base64,([^"]+)', page)
    shown = [Image.open(io.BytesIO(base64.b64decode(each))) for each in pictures]
    assert any(np.array_equal(np.asarray(one), whole) for one in shown)


def test_a_report_is_the_same_each_time(report_file):
    """No date, no random name: a run that is computed again leaves the same bytes."""
    assert report_html(made_content()).encode() == report_file.read_bytes()


def test_few_frames_are_all_shown_unknown_ones_too():
    assert list(choose_frames(np.ones(8), np.ones(8))) == list(range(8))
    nothing = np.full(50, np.nan)
    assert len(choose_frames(nothing, nothing)) == 8


@pytest.mark.parametrize("count", [9, 10, 100, 20_000])
def test_of_many_frames_the_ends_the_worst_and_the_largest_are_among_the_chosen(count):
    chi, order = np.ones(count), np.zeros(count)
    chi[0], chi[count // 3], order[count // 2] = np.nan, 3.0, 9.0
    chosen = choose_frames(chi, order)
    assert len(chosen) == 8 and list(chosen) == sorted(chosen)
    assert chosen[0] == "the first" and chosen[count - 1] == "the last"
    assert chosen[count // 3] == "the largest chi" and chosen[count // 2] == "the largest order"
    gaps = np.diff(sorted(chosen))
    assert gaps.max() <= max(3, count // 3)  # nowhere is much left out


def test_frames_without_an_order_or_a_scale_have_a_page(tmp_path):
    content = made_content()
    bare = made_frame(0, "bare")
    frame = ReportFrame(number=0, label="bare", why="b", panes=bare.panes[:1])
    file = write_report(tmp_path / "r.html", replace(
        content, frames=[frame], curves=(), budget=None, no_budget="none", causes=None, warnings=(),
    ))  # fmt: skip
    page = Page(file)
    assert "Nobody asked the frames" in page.text and data_of(page)["frames"][0]["order"] is None
