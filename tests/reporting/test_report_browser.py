"""The report in a real browser, opened from a file with the network cut."""

import re
from itertools import product

import pytest
from pages import COLS, HOSTILE, LEFT, PIXEL, ROWS, TOP, order_field
from test_other_reports import wear_set

import isochrome
from browsers import skip_without_browser
from isochrome.calibration import save_calibration
from processing.tracked_films import LOAD, contact, film
from scene_texts import SMALL_CAMERA, WORN_CONTACT

pytestmark = pytest.mark.browser

skip_without_browser()

SCALES = [1.0, 1.5, 2.0, 3.0]
"""Device pixels a pixel of the page: a desk's screen, a telephone's, and the browser's zoom."""

WIDTHS = [360, 768, 1920]


class Opened:
    """A page that was opened, and all that it asked for and complained of."""

    def __init__(self, browser, file, **options):
        options = {"viewport": {"width": 1000, "height": 900}} | options
        self.context = browser.new_context(offline=True, **options)
        self.page = self.context.new_page()
        self.said, self.asked = [], []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(file.as_uri())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.context.close()

    def readout(self, words="row"):
        """What stands under the picture, once it has some words."""
        self.page.wait_for_function(
            "words => document.getElementById('readout').textContent.includes(words)", arg=words
        )
        return self.page.text_content("#readout")

    def share(self):
        """Share (%) of the picture that shows the experiment."""
        cut = self.page.eval_on_selector("#over", "one => getComputedStyle(one).clipPath")
        return 100.0 - float(re.search(r"inset\(0(?:px)? ([\d.]+)", cut)[1])


@pytest.fixture
def opened(chromium, report_file):
    with Opened(chromium, report_file) as own:
        yield own


def is_right(text, row, col, number=0):
    """Whether N, x and z are those of the pixel, each within its rounding."""
    order = order_field(number)[row, col]
    found = dict(re.findall(r"(N|simulation|difference|x|z|row|column) =? ?([-\d.]+)", text))
    x, z = LEFT + (col + 0.5) * PIXEL, TOP + (row + 0.5) * PIXEL
    return (
        abs(float(found["N"]) - order) <= 0.00101
        and abs(float(found["simulation"]) - (order - 0.05)) <= 0.00101
        and abs(float(found["difference"]) - 0.05) <= 0.0021
        and abs(float(found["x"]) - x) <= 1e-4
        and abs(float(found["z"]) - z) <= 1e-4
        and (int(found["row"]), int(found["column"])) == (row, col)
    )


def test_no_error_and_no_request(opened, hostile_file, chromium):
    assert opened.said == []
    assert [url for url in opened.asked if not url.startswith(("file:", "data:"))] == []
    assert sum(url.startswith("file:") for url in opened.asked) == 1
    with Opened(chromium, hostile_file) as hostile:
        hostile.page.hover("#stage")
        assert hostile.said == [] and hostile.page.evaluate("window.stolen") is None
        assert [url for url in hostile.asked if not url.startswith(("file:", "data:"))] == []
        label = hostile.page.text_content("#frame-label")
        assert "<script>window.stolen = 1</script>" in label


def test_the_policy_stops_a_script_that_somebody_puts_in(chromium, report_file, tmp_path):
    """So it is in force, and not only written there."""
    text = report_file.read_text("utf-8")
    other = tmp_path / "other.html"
    bad = "<script>window.stolen = 1</script><img src=x onerror='window.stolen = 1'>"
    other.write_text(text.replace("<main", f"{bad}<main", 1), "utf-8")
    with Opened(chromium, other) as own:
        assert own.page.evaluate("window.stolen") is None
        assert any("Content Security Policy" in line for line in own.said)


@pytest.fixture(scope="module")
def other_files(tmp_path_factory):
    """The pages of a simulation, a calibration whose settings hold hostile text, a comparison."""
    home = tmp_path_factory.mktemp("others")
    scene = isochrome.parse_scene(WORN_CONTACT + SMALL_CAMERA, name="worn")
    isochrome.simulate(scene, home / "simulated")
    path = wear_set(home)
    path.write_text(path.read_text("utf-8") + f"# {' '.join(HOSTILE[:-1])}\n", "utf-8")
    save_calibration(isochrome.calibrate_wear(path), home / "worn", source=path)
    isochrome.compare(home / "simulated", home / "simulated", home / "compared")
    return [home / name / "report.html" for name in ("simulated", "worn", "compared")]


@pytest.mark.parametrize("width", WIDTHS)
def test_pages_of_simulations_and_calibrations_open_and_print(
    chromium, other_files, tmp_path, width
):
    for file in other_files:
        with Opened(chromium, file, viewport={"width": width, "height": 800}) as own:
            assert own.said == [] and own.page.evaluate("window.stolen") is None
            assert [url for url in own.asked if not url.startswith(("file:", "data:"))] == []
            assert own.page.evaluate("document.documentElement.scrollWidth") <= width
            own.page.pdf(path=tmp_path / "report.pdf")
            assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")
    with Opened(chromium, other_files[0]) as own:
        own.page.fill("#frame", "1")
        own.page.hover("#stage")
        assert re.search(r"N = [\d.]+ fringes; x = -?[\d.]+ mm", own.readout())
        assert own.page.text_content(".sides span") == "rendered frame"


@pytest.mark.parametrize("scale", SCALES)
def test_n_x_and_z_under_the_mouse_are_those_of_the_pixel(chromium, report_file, scale):
    with Opened(chromium, report_file, device_scale_factor=scale) as own:
        own.page.evaluate("window.scrollTo(0, 120)")
        for row, col in ((10, 0), (45, 80), (89, 159), (30, 133)):
            box = own.page.eval_on_selector(
                "#under", "one => (({x, y, width, height}) => ({x, y, width, height}))"
                "(one.getBoundingClientRect())"
            )  # fmt: skip
            x = box["x"] + (col + 0.5) * box["width"] / COLS
            y = box["y"] + (row + 0.5) * box["height"] / ROWS
            if not 0 < y < 900:
                own.page.evaluate("y => window.scrollBy(0, y - 400)", y)
                y = own.page.eval_on_selector(
                    "#under", "one => one.getBoundingClientRect().y"
                ) + (row + 0.5) * box["height"] / ROWS  # fmt: skip
            own.page.mouse.move(x, y)
            assert is_right(own.readout(f"row {row}, column {col}"), row, col)


def test_a_pixel_that_is_not_known_says_so(opened):
    box = opened.page.locator("#under").bounding_box()
    opened.page.mouse.move(box["x"] + 50, box["y"] + 4)
    assert opened.readout("row 0").startswith("N = not known; simulation not known; x =")


def test_slider_wipe_and_blink_go_by_the_mouse(opened):
    page = opened.page
    assert opened.share() == 50.0
    page.fill("#wipe", "80")
    assert opened.share() == 80.0
    slider = page.locator("#frame").bounding_box()
    page.mouse.click(slider["x"] + slider["width"] - 3, slider["y"] + slider["height"] / 2)
    assert "31 m" in page.text_content("#frame-label")
    page.get_by_label("difference").check()
    assert page.text_content("#under-label") == "difference"
    page.click("#blink")
    assert page.get_attribute("#blink", "aria-pressed") == "true"
    first = opened.share()
    page.wait_for_function(
        "hidden => getComputedStyle(document.getElementById('over')).clipPath.includes(hidden)",
        arg=f" {first:g}%",  # of the other picture as much is cut as of this one was shown
    )
    assert (first, opened.share()) in ((0.0, 100.0), (100.0, 0.0))
    page.click("#blink")
    assert opened.share() == 80.0


@pytest.fixture(scope="module")
def followed_file(tmp_path_factory):
    """The report of a followed film of four frames, of which the first alone has its picture."""
    scene = contact(sliding=True)
    frames = film(scene, {LOAD: [44.0, 44.5, 45.0, 45.5]}, 1)
    place = tmp_path_factory.mktemp("followed") / "out"
    isochrome.process(frames, scene, place, track=True, every=9)
    return place / "report.html"


def test_the_slider_of_a_followed_film_goes_to_frames_without_a_picture(chromium, followed_file):
    with Opened(chromium, followed_file) as own:
        assert own.page.text_content(".sides span") == "experiment"
        own.page.fill("#frame", "2")
        label = own.page.text_content("#frame-label")
        assert label.startswith("frame 2: ") and "its picture is not kept" in label
        assert own.page.text_content(".sides span") == "fringe order N"
        assert own.page.text_content("#under-label") == "simulation"
        own.page.hover("#stage")
        assert re.search(r"N = [\d.]+ fringes; simulation [\d.]+; difference", own.readout())
        own.page.fill("#frame", "0")
        assert own.page.text_content(".sides span") == "experiment" and own.said == []


def test_every_tool_goes_by_the_keyboard_alone(opened):
    """From the top of the page with Tab, and each place shows where it is."""
    page, seen = opened.page, []
    for _ in range(60):
        page.keyboard.press("Tab")
        name = page.evaluate("document.activeElement.id || document.activeElement.name")
        ring = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        if page.evaluate("document.activeElement === document.body"):
            break
        assert ring != "none", page.evaluate("document.activeElement.outerHTML.slice(0, 80)")
        seen.append(name)
        if name == "frame":
            page.keyboard.press("ArrowRight")
            assert "31 m" in page.text_content("#frame-label")
        elif name == "beside":
            page.keyboard.press("ArrowDown")
            assert page.text_content("#under-label") == "difference"
        elif name == "wipe":
            page.keyboard.press("Home")
            assert opened.share() == 0.0
        elif name == "blink":
            page.keyboard.press("Space")
            assert page.get_attribute("#blink", "aria-pressed") == "true"
            page.keyboard.press("Space")
        elif name == "stage":
            page.keyboard.press("ArrowRight")
            page.keyboard.press("Shift+ArrowDown")
            assert is_right(opened.readout("row 55, column 81"), 55, 81, number=1)
    assert [name for name in seen if name in ("frame", "beside", "wipe", "blink", "stage")] == [
        "frame", "beside", "wipe", "blink", "stage",
    ]  # fmt: skip


def test_nothing_moves_by_itself_for_who_asks_for_calm(chromium, report_file):
    with Opened(chromium, report_file, reduced_motion="reduce") as own:
        assert own.page.text_content("#blink") == "Swap"
        own.page.click("#blink")
        assert own.share() == 100.0
        own.page.wait_for_timeout(800)  # longer than a blink
        assert own.share() == 100.0
        own.page.click("#blink")
        assert own.share() == 0.0


@pytest.mark.parametrize("width", WIDTHS)
def test_it_is_readable_at_any_width(chromium, report_file, hostile_file, width):
    """Nothing is wider than the screen, and no letter below 9 pixels."""
    for file in (report_file, hostile_file):
        with Opened(chromium, file, viewport={"width": width, "height": 800}) as own:
            assert own.page.evaluate("document.documentElement.scrollWidth") <= width
            sizes = own.page.evaluate(
                "[...document.querySelectorAll('p, td, th, li, label, text')].map(one => "
                "parseFloat(getComputedStyle(one).fontSize) * (one.ownerSVGElement ? "
                "one.getScreenCTM().a : 1))"
            )
            assert min(sizes) >= 9.0


def test_contrast_labels_and_roles_pass_an_automated_check(chromium, report_file, other_files):
    """All rules of axe-core, at both ends of the widths and with the tables unfolded.
    Of a run with frames, of a simulation and of a calibration."""
    from axe_playwright_python.sync_playwright import Axe

    axe = Axe()
    for file, width in product((report_file, *other_files), (WIDTHS[0], WIDTHS[-1])):
        view = {"width": width, "height": 800}
        with Opened(chromium, file, viewport=view, bypass_csp=True) as own:
            own.page.eval_on_selector_all("details", "all => all.forEach(one => one.open = true)")
            found = axe.run(own.page).response
            assert len(found["passes"]) > 20
            assert found["violations"] == [], [
                (rule["id"], [node["html"][:120] for node in rule["nodes"]])
                for rule in found["violations"]
            ]


def test_it_prints_all_that_is_folded_away_or_behind_the_slider(chromium, report_file, tmp_path):
    with Opened(chromium, report_file) as own:
        file = tmp_path / "report.pdf"
        own.page.pdf(path=file)
        data = file.read_bytes()
        assert data.startswith(b"%PDF") and len(re.findall(rb"/Type\s*/Page\b", data)) >= 2
        own.page.emulate_media(media="print")
        assert not own.page.is_visible("#viewer") and not own.page.is_visible("nav")
        figures = own.page.locator("#figures .frame")
        assert figures.count() == 2 and all(one.is_visible() for one in figures.all())
        own.page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert all(own.page.locator("details").nth(k).get_attribute("open") is not None
                   for k in range(own.page.locator("details").count()))  # fmt: skip


def test_heads_of_a_printed_table_keep_their_words(chromium, other_files):
    """A comparison's has 14 columns; its words break at their underscores alone."""
    with Opened(chromium, other_files[2], viewport={"width": 680, "height": 900}) as own:
        own.page.emulate_media(media="print")
        lines = own.page.eval_on_selector_all(
            "#trust thead bdi",
            "all => all.map(one => [one.textContent, "
            "new Set([...one.getClientRects()].map(box => Math.round(box.top))).size])",
        )
        assert len(lines) > 10
        assert all(count <= 1 + name.count("_") for name, count in lines), lines


def test_without_scripts_all_frames_stand_there(chromium, report_file):
    with Opened(chromium, report_file, java_script_enabled=False) as own:
        assert not own.page.is_visible("#viewer")
        assert own.page.locator("#figures img").first.is_visible()
