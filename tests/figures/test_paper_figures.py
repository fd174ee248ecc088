"""Figures for a paper: letters of 7 pt or more that do not touch, at both widths; their files."""

import csv
import json
import re
import zlib
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
import tifffile
from matplotlib.figure import Figure
from PIL import Image

import isochrome
from commands import exit_code
from figures.drawn_texts import drawn_texts, outside, overlaps
from isochrome import figures
from isochrome.campaigns import Campaign, Outcome
from isochrome.cli.options import save_paper_figure
from isochrome.demonstration import Demo
from isochrome.errors import InputError
from isochrome.output import FrameValues, write_excel_copies
from isochrome.processing import FOUND_BY, PICTURE, set_figure
from isochrome.processing import Shown as ShownFrame
from made_calibrations import dots_in, three_colours
from scene_texts import PAPER_PAIR, SMALL_CAMERA, WORN_CONTACT
from shipped_sets import some_of_a_shipped_set
from sketches import sketched

WIDTHS = (85.0, 174.0)
LEAST_PT = 7.0
"""The least that journals print."""
ROOT = Path(__file__).parents[2]


def check(figure: Figure, width_mm: float) -> None:
    """What holds for every figure: its width, its letters, and that they stand apart."""
    texts = drawn_texts(figure)
    assert figure.get_figwidth() * 25.4 == pytest.approx(width_mm) and len(texts) > 5
    assert not [text.words for text in texts if text.size_pt < LEAST_PT] and not overlaps(texts)
    assert not outside(texts, figure)


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """A small worn contact: its scene, two states, its frames processed, and the comparison."""
    home = tmp_path_factory.mktemp("worn")
    scene = home / "scene.toml"
    scene.write_text(WORN_CONTACT + SMALL_CAMERA + "noise_grey = 2.0\n", "utf-8")
    with sketched():
        simulated = isochrome.simulate(scene, home / "simulated")
        processed = isochrome.process(home / "simulated" / "frames.tif", scene, home / "processed")
        compared = isochrome.compare(home / "processed", home / "simulated")
    return {"simulate": simulated, "process": processed, "compare": compared, "home": home}


@pytest.fixture(scope="module")
def numbered(worn):
    """Makes figures of its results with their numbers, each once."""
    style = partial(isochrome.FigureStyle, numbers=True)
    return cache(lambda name, mm: isochrome.paper_figure(worn[name], style(width_mm=mm)))


@pytest.mark.parametrize(
    ("name", "width"),
    [
        *((name, WIDTHS[0]) for name in ("simulate", "process", "compare")),
        pytest.param("compare", WIDTHS[1], marks=pytest.mark.study),
    ],
)
def test_letters_are_large_enough_and_apart(numbered, name, width):
    check(numbered(name, width), width)


@pytest.mark.parametrize("name", ["simulate", "compare"])
def test_a_layout_comes_to_rest(worn, name, monkeypatch):
    """Labels below a picture were room too much, or were none: four passes swung by 17 to 3 mm."""
    measure, missing = figures.paper._missing_mm, []
    monkeypatch.setattr(
        figures.paper, "_missing_mm", lambda row: missing.append(measure(row)) or missing[-1]
    )
    figure = isochrome.paper_figure(worn[name], isochrome.FigureStyle(width_mm=85, numbers=True))
    rows = len({axes.get_subplotspec().rowspan.start for axes in figure.axes if axes.images})
    assert len(missing) <= 3 * rows and np.abs(missing[-rows:]).sum() < 0.1


def a_scale(worn: dict) -> object:
    picture = worn["home"] / f"{'a long name of a board ' * 4}.tif"
    return isochrome.calibrate_scale(picture, **dots_in(picture))


def at(worn: dict, distances: list[float]) -> isochrome.Scene:
    scene = isochrome.load_scene(worn["home"] / "scene.toml")
    return scene.with_values({"wear.distances_m": distances})


def a_tracked_video(worn: dict) -> object:
    film = at(worn, [0.5 * k for k in range(4)])
    return isochrome.process(isochrome.simulate(film).frames, film, track=True, every=3)


def without_a_model(worn: dict) -> object:
    specimen, light = PAPER_PAIR.split("[indenter]")[0], "[polariscope]\nwavelength_nm = 587.0\n"
    bare = isochrome.parse_scene(specimen + light + SMALL_CAMERA)
    return isochrome.process(worn["home"] / "simulated" / "frames.tif", bare)


def some_of(worn: dict, name: str, images: tuple[int, ...]) -> Path:
    return some_of_a_shipped_set(worn["home"] / "sets", name, images)


STUDY = pytest.mark.study
"""CI draws each figure once, in the narrowest of a journal's columns with its numbers: what fits
there fits elsewhere but for a chance, and the default tests hold both columns of three figures."""

WEAR_SET = ROOT / "sample_images" / "wear" / "set.toml"
OTHERS = {
    "scars": lambda _: isochrome.compare(WEAR_SET, "line-contact-wear"), "scale": a_scale,
    "colour table": lambda _: three_colours(),
    "components": lambda worn: isochrome.simulate(worn["home"] / "scene.toml", components=True),
    "tracked video": a_tracked_video, "no model": without_a_model,
    "beam": lambda worn: isochrome.calibrate_bending(some_of(worn, "bending", (0, 3))),
    "wear": lambda _: isochrome.calibrate_wear(WEAR_SET),
    "paper's case": lambda _: isochrome.simulate("line-contact-wear"),
    "many states": lambda worn: isochrome.simulate(at(worn, list(range(12)))),
    "disc": lambda worn: isochrome.calibrate_disc(some_of(worn, "disc", (0, 2))),
}  # fmt: skip


@pytest.fixture(scope="module")
def others(worn):
    """Makes the other results, each once."""
    return cache(lambda name: OTHERS[name](worn))


@pytest.mark.long
@pytest.mark.parametrize("numbers", [True, pytest.param(False, marks=STUDY)])
@pytest.mark.parametrize(
    "width", [85.0, *(pytest.param(width, marks=STUDY) for width in (174.0, 60.0, 120.0))]
)
@pytest.mark.parametrize(
    # the disc's figure has the panels of the beam's, a tracked video's those of a film's plots
    "name",
    [pytest.param(n, marks=STUDY if n in ("disc", "tracked video") else ()) for n in OTHERS],
)
def test_letters_of_every_figure_are_large_enough_and_apart(others, name, width, numbers):
    style = isochrome.FigureStyle(width_mm=width, numbers=numbers)
    figure = isochrome.paper_figure(others(name), style)
    check(figure, width)
    if name in ("beam", "disc"):  # a row of three, the last with a colour bar
        tops = [axes.get_window_extent().y1 for axes in figure.axes if axes.images][
            : 2 + (width > 60)
        ]
        assert max(tops) - min(tops) < 1.0
    if name in ("beam", "disc", "wear", "scale"):  # at 85 mm they were up to 373 mm tall
        assert 25.4 * figure.get_figheight() <= figures.PAGE_MM


def test_the_frames_are_those_asked_for(worn):
    figure = isochrome.paper_figure(worn["compare"], isochrome.FigureStyle(frames=(1, 0)))
    titles = [text for axes in figure.axes if (text := axes.get_title(loc="left"))]
    labels = [worn["compare"].columns["label"][k] for k in (1, 0)]
    wanted = [f"{kind}, {label}" for label in labels
              for kind in ("experiment", "simulation", "difference")]  # fmt: skip
    plain = [" ".join(title.replace("\xa0", " ").split()) for title in titles]
    assert plain == [f"({'abcdef'[k]}) {words}" for k, words in enumerate(wanted)]
    shown = np.asarray(figure.axes[0].images[0].get_array())
    with tifffile.TiffFile(worn["home"] / "processed" / "normalised.tif") as stack:
        np.testing.assert_array_equal(shown, stack.asarray()[1])


def test_the_scale_bar_has_the_length_that_it_says(numbered):
    figure = numbered("compare", WIDTHS[0])
    texts = [text.words for text in drawn_texts(figure)]
    (words,) = (text for text in texts if re.fullmatch(r"[\d.]+ mm", text))
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    (bar,) = figure.findobj(AnchoredSizeBar)
    (patch,) = bar.size_bar.get_children()
    assert patch.get_width() == pytest.approx(float(words.split()[0]))  # in mm, as the axes are
    left, right = bar.axes.get_xlim()
    assert 0.1 < patch.get_width() / (right - left) <= 0.3


def test_files_are_of_the_width_and_hold_text_as_text(worn, tmp_path):
    style = isochrome.FigureStyle(width_mm=85, formats=("pdf", "svg", "png", "tiff"), dpi=300)
    files = isochrome.save_figure(worn["simulate"], tmp_path / "figure", style)
    by_name = {file.name: file for file in files}
    pdf = by_name["figure.pdf"].read_bytes()
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", pdf)
    assert box is not None and float(box.group(1)) == pytest.approx(85 / 25.4 * 72, abs=0.01)
    assert b"/FontFile2" in pdf and b"/Type3" not in pdf  # TrueType, in the file
    assert _words_of_pdf(pdf)
    svg = by_name["figure.svg"].read_text("utf-8")
    assert "pressure p (MPa)" in re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    assert re.search(r'width="240\.9\d*pt"', svg)  # 85 mm
    for name, format_ in (("figure.png", "PNG"), ("figure.tiff", "TIFF")):
        with Image.open(by_name[name]) as picture:
            assert picture.format == format_
            assert picture.width == pytest.approx(85 / 25.4 * 300, abs=1)
            assert float(picture.info["dpi"][0]) == pytest.approx(300, abs=0.1)


@pytest.mark.long
def test_the_same_figure_is_the_same_file(worn, tmp_path):
    """The layout's equations are solved in an order of addresses: 4 files of 12, before."""
    style = isochrome.FigureStyle(width_mm=85, formats=("pdf", "svg"))
    made = []
    for name in ("figure", "again"):
        files = isochrome.save_figure(worn["simulate"], tmp_path / name, style)
        made.append([file.read_bytes() for file in files[:2]])
    assert made[0] == made[1]
    figure = isochrome.paper_figure(worn["simulate"], style)
    places = [axes.get_position(original=True).bounds for axes in figure.axes]
    places += [part.bbox_relative.bounds for part in figure.subfigs]
    # one ulp is what a sum of two rounded numbers leaves, the layout's own digits are random
    assert np.allclose(places, np.round(places, 6), rtol=0.0, atol=1e-15)


def _words_of_pdf(pdf: bytes) -> bool:
    """Whether a page shows strings, rather than outlines of letters: Tj or TJ of its content."""
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.S)
    plain = []
    for stream in streams:
        try:
            plain.append(zlib.decompress(stream))
        except zlib.error:
            continue
    return any(re.search(rb"T[jJ]\b", text) and b"BT" in text for text in plain)


@pytest.mark.long
def test_the_data_of_each_curve_stand_beside(worn, tmp_path):
    style = isochrome.FigureStyle(formats=("png",), dpi=60)
    files = isochrome.save_figure(worn["simulate"], tmp_path / "figure", style)
    tables = [file for file in files if file.suffix == ".csv"]
    count = len(worn["simulate"].columns["state"])
    assert [file.stem[-1] for file in tables] == ["abcdefghij"[count + k] for k in range(2)]
    pressure = worn["home"] / "simulated" / "pressure.csv"
    with open(pressure, encoding="utf-8", newline="") as file:
        of_state = [row for row in csv.DictReader(file) if row["state"] == "1"]
    with open(tables[0], encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    label = worn["simulate"].columns["label"][1]
    column = next(name for name in rows[0] if name.startswith(f"{label}: pressure p (MPa)"))
    place = list(rows[0])[list(rows[0]).index(column) - 1]
    place = place if place.endswith("x (mm)") else "x (mm)"
    drawn = {row[place]: row[column] for row in rows if row[column]}
    assert len(of_state) > 20  # the nodes in contact: those beyond it have no pressure
    assert all(drawn[row["x_mm"]] == row["pressure_mpa"] for row in of_state)


@pytest.mark.long
def test_a_figure_of_what_is_not_worn_has_no_panel_of_worn_depth(worn):
    titles = []
    for frames in ((0,), (1,)):
        figure = isochrome.paper_figure(worn["simulate"], isochrome.FigureStyle(frames=frames))
        titles.append([axes.figure.get_suptitle()[4:] for axes in figure.axes])
    assert "worn depth" in titles[1] and "worn depth" not in titles[0] and "pressure" in titles[0]


@pytest.mark.long
def test_data_of_plots_that_a_new_figure_does_not_have_are_removed(worn, tmp_path):
    """A figure of one state and then of two: the plots' letters move on by one."""
    style = partial(isochrome.FigureStyle, width_mm=85, formats=("png",), dpi=60)
    first = save_paper_figure(worn["simulate"], tmp_path, style(frames=(0,)))
    write_excel_copies(tmp_path)
    others = [tmp_path / name for name in ("figure_174mm_b.csv", "figure_me.csv", "other_b.csv")]
    for file in others:
        file.write_text("of somebody else\n", "utf-8")
    then = save_paper_figure(worn["simulate"], tmp_path, style(frames=(0, 1)))
    assert {Path(one).name for one in {*first} - {*then}} == {"figure_85mm_b.csv"}
    assert {*tmp_path.iterdir()} == {*map(Path, then), *others}
    isochrome.save_figure(worn["simulate"], tmp_path / "other", style(frames=(0, 1)))
    assert (tmp_path / "other_b.csv").read_text("utf-8") == "of somebody else\n"


@pytest.mark.long
def test_a_figure_that_is_taller_than_a_page_is_written_with_a_warning(
    worn, tmp_path, monkeypatch, capsys
):
    style = isochrome.FigureStyle(width_mm=85, frames=(0, 1) * 4, formats=("png",), dpi=60)
    monkeypatch.setattr("isochrome.cli.options.print_warnings", print)
    (file, *_) = save_paper_figure(worn["compare"], tmp_path, style)
    said = r"\['the figure is (\d+) mm tall; choose fewer --frames'\]"
    (tall,) = map(float, re.findall(said, capsys.readouterr().out))
    with Image.open(file) as picture:
        assert tall > 230.0 and picture.height / 60 * 25.4 == pytest.approx(tall, abs=0.6)


def numbers_shown(axis) -> int:
    """How many numbers an axis shows within its limits."""
    low, high = sorted(axis.get_view_interval())
    return sum(low <= place <= high for place in axis.get_ticklocs())


@pytest.mark.long
@pytest.mark.parametrize("count", [pytest.param(3, marks=STUDY), 6])
def test_each_axis_with_numbers_has_two_at_least(worn, count):
    style = isochrome.FigureStyle(width_mm=85, frames=(0, 1) * (count // 2) + (0,) * (count % 2))
    figure = isochrome.paper_figure(worn["compare"], style)
    check(figure, 85.0)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    found = [
        numbers_shown(axis)
        for axes in shown
        for axis in (axes.xaxis, axes.yaxis)
        if any(text.get_visible() and text.get_text() for text in axis.get_ticklabels())
    ]
    assert len(found) > 4 and min(found) >= 2


@pytest.mark.long
def test_labels_at_the_sides_of_values_over_frames_are_apart():
    keys, count = ("camera.left_mm", "camera.top_mm", "wear.coefficient_mm2_per_n"), 5
    none = np.zeros(count, dtype=bool)
    values = FrameValues(
        keys=keys, values=np.ones((count, 3)), standard_uncertainty=np.full((count, 3), 0.1),
        chi=np.ones(count), distance_m=np.arange(5.0), searched=none, whole=none,
    )  # fmt: skip
    panels = figures.PaperPanels(plots=figures.values_plots(values))
    figure = figures.panels_figure(panels, "film")
    labels = [" ".join(axes.get_ylabel().split()) for axes in figure.axes]
    assert labels[:2] == ["left edge of the picture (mm)", "top edge of the picture (mm)"]
    assert not overlaps(drawn_texts(figure))


class Made:
    """A result of some plots, and of three pictures where `pictures`."""

    title = "made"

    def __init__(self, *plots: figures.Plot, pictures: bool = False) -> None:
        self.plots, self.pictures = plots, pictures

    def panels(self, frames: tuple[int, ...] | None = None) -> figures.PaperPanels:
        def draw(axes, k):
            return axes.imshow(np.zeros((40, 50)), cmap="gray")

        kinds = [figures.PictureKind(name=name, draw=draw) for name in ("one", "two", "three")]
        kinds = kinds if self.pictures else []
        return figures.PaperPanels(kinds=kinds, labels=["60 N"] * bool(kinds), plots=self.plots)


def a_plot(title: str, **options) -> figures.Plot:
    return figures.Plot(title=title, draw=lambda axes: axes.plot([0.0, 1.0], [0.0, 1.0]), **options)


def tall_and_axes(result: Made) -> tuple[float, list]:
    figure = isochrome.paper_figure(result, isochrome.FigureStyle(width_mm=85))
    check(figure, 85.0)
    return 25.4 * figure.get_figheight(), [axes for axes in figure.axes if axes.get_visible()]


@pytest.mark.long
def test_what_is_taller_than_a_page_is_laid_out_closer():
    """Pictures beside each other, lower plots, and no plot left out that has room so."""
    tall, shown = tall_and_axes(Made(*map(a_plot, "abcd"), pictures=True))
    assert tall <= figures.PAGE_MM and len(shown) == 7
    tops = [axes.get_window_extent().y1 for axes in shown[:3]]
    assert max(tops) - min(tops) < 1.0
    low, few = tall_and_axes(Made(*map(a_plot, "ab"), pictures=True))
    assert low < tall  # what has room is laid out as ever: pictures in two rows
    assert len({round(axes.get_window_extent().y1) for axes in few[:3]}) == 2


@pytest.mark.long
def test_spare_plots_are_left_out_last_of_all_and_this_is_said(tmp_path):
    ranks = (0, 1, 0, 2, 0, 0, 0, 0)
    made = Made(*(a_plot(f"plot {k}", spare=rank) for k, rank in enumerate(ranks)))
    style = isochrome.FigureStyle(width_mm=85, formats=("png",), dpi=60)
    with pytest.warns(UserWarning, match=r"a page has no room for: plot 3, plot 1; a wider"):
        files = isochrome.save_figure(made, tmp_path / "figure", style)
    assert [file.name for file in files[1:]] == [f"figure_{letter}.csv" for letter in "abcdef"]
    tall, shown = tall_and_axes(made)
    assert tall <= figures.PAGE_MM and len(shown) == 6
    crowd = Made(*(a_plot(f"plot {k}", spare=k % 2) for k in range(16)))
    with pytest.warns(UserWarning, match=r"^the figure is \d+ mm tall"):  # nothing is left out
        files = isochrome.save_figure(crowd, tmp_path / "crowd", style)
    assert len(files) == 17


@pytest.mark.parametrize("width", [60.0, 85.0])
def test_titles_over_bars_with_long_names_stay_whole(width):
    """They were broken within words over the few millimetres that the names left, or stood out."""
    parts = {"profilometer's lateral scale": 2e-7, "another long name of it": 1e-7}
    budget = figures.budget_plot("uncertainty budget of pixel_mm", parts, unit="mm")
    figure = isochrome.paper_figure(Made(budget), isochrome.FigureStyle(width_mm=width))
    check(figure, width)
    (axes,) = figure.axes
    title = axes.figure.get_suptitle()
    assert title.split() == ["(a)", "uncertainty", "budget", "of", "pixel_mm"]
    assert " ".join(axes.get_xlabel().split()) == "contribution to u (1e-7 mm)"
    assert axes.patches[-1].get_width() == pytest.approx(2.0)


def test_curves_have_names_in_the_data_that_no_legend_shows():
    """Two curves of one quantity were told apart by "(2)"."""
    axes = Figure().subplots()
    x, y, u = np.array([0.0, 1.0]), np.array([5.0, 6.0]), np.array([0.5, 0.25])
    axes.fill_between(x, y - u, y + u, color="#0072b2", alpha=0.3)
    axes.plot(x, y, color="#0072b2")
    axes.errorbar(x, y, yerr=u, fmt="o", color="#0072b2")  # the same once more
    axes.plot(x[:1], y[:1], ".", label=figures.data_name("key frames"))
    axes.set(xlabel="x (m)", ylabel="y (N)")
    names = ["x (m)", "y (N)", "y (N) low", "y (N) high"]
    assert list(figures.curve_columns(axes)) == [*names, "key frames: x (m)", "key frames: y (N)"]
    assert axes.get_legend_handles_labels() == ([], [])


def test_bands_and_bars_of_a_curve_are_among_its_data():
    axes = Figure().subplots()
    x, y, u = np.array([0.0, 1.0, 2.0]), np.array([5.0, 6.0, 7.0]), np.array([0.5, np.nan, 0.25])
    axes.fill_between(x, y - u, y + u, color="#0072b2", alpha=0.3)
    axes.plot(x, y, color="#0072b2", label="one")
    axes.errorbar([1.0, 3.0], [2.0, 4.0], yerr=[0.1, 0.2], fmt="o", label="two")
    axes.errorbar([], [], yerr=[], fmt="s")  # of a film none of whose frames stands still
    axes.axhline(0.0)
    axes.set(xlabel="x (mm)", ylabel="y (N)")
    found = {name: column.tolist() for name, column in figures.curve_columns(axes).items()}
    assert found.pop("x (mm)")[:2] == [1.0, 3.0] and found.pop("one: x (mm)") == [0.0, 1.0, 2.0]
    nan = pytest.approx(np.nan, nan_ok=True)
    assert found == {
        "two: y (N)": [2.0, 4.0, nan],
        "two: y (N) low": [pytest.approx(1.9), pytest.approx(3.8), nan],
        "two: y (N) high": [pytest.approx(2.1), pytest.approx(4.2), nan],
        "one: y (N)": [5.0, 6.0, 7.0],
        "one: y (N) low": [4.5, nan, 6.75],
        "one: y (N) high": [5.5, nan, 7.25],
    }


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"width_mm": 20}, "width = 20 mm of a figure: give 60 to 400 mm"),
        ({"width_mm": float("nan")}, "width = nan"), ({"dpi": 5}, "dpi = 5: give 50 to 2400"),
        ({"formats": ("jpg",)}, "format = jpg of a figure: give some of png, pdf, svg, tiff"),
        ({"formats": ()}, "format = none"), ({"frames": (0, -1)}, "frames = 0,-1 of a figure"),
        ({"frames": ()}, "frames = none"),
    ],
)  # fmt: skip
def test_a_style_that_is_none_is_refused(given, words):
    with pytest.raises(InputError, match=re.escape(words)):
        isochrome.FigureStyle(**given)


def test_a_frame_that_is_not_there_is_refused(worn):
    for name, items in (("compare", "frames"), ("process", "frames"), ("simulate", "states")):
        with pytest.raises(InputError, match=f"frames = 9 of a figure: its {items} are 0 to 1"):
            isochrome.paper_figure(worn[name], isochrome.FigureStyle(frames=(0, 9)))
    with pytest.raises(InputError, match="colour table has none"):
        isochrome.paper_figure(three_colours(), isochrome.FigureStyle(frames=(0,)))
    with pytest.raises(InputError, match="has no figure for a paper"):
        isochrome.paper_figure(object())  # type: ignore[arg-type]


def some_recordings(count: int) -> list[Outcome]:
    """Outcomes of recordings with load and friction, every third of which failed."""
    found = []
    for k in range(count):
        row: dict = {"folder": f"a recording of the {k + 1}. day", "status": "ok"}
        curves = {"distance_m": np.array([0.0, 5.0, 9.0]), "frame": np.arange(3.0)}
        for key, value in (("load.normal_n", 40.0), ("friction.coefficient", 0.25)):
            curves[key] = value * (1.0 + 0.01 * k + np.array([0.0, 0.01, 0.03]))
            curves[f"{key} standard_uncertainty"] = 0.005 * value * np.ones(3)
            if k % 3 != 2:
                row[f"{key} mean"] = float(np.mean(curves[key]))
                row[f"{key} standard_deviation"] = 0.01 * value
        found.append(Outcome(row, {}, curves=curves if k % 3 != 2 else {}))
    return found


@pytest.mark.long
@pytest.mark.parametrize(
    ("count", "width"),
    [
        (3, 85.0),
        (40, 174.0),
        *(pytest.param(*one, marks=STUDY) for one in ((3, 174.0), (40, 85.0))),
    ],
)
def test_a_campaigns_letters_are_large_enough_and_apart(count, width):
    scene = isochrome.load_scene("line-contact-wear")
    found = Campaign(Path(), scene, tuple(some_recordings(count)))
    check(isochrome.paper_figure(found, isochrome.FigureStyle(width_mm=width)), width)


def test_a_campaigns_figure_is_of_its_recordings_or_refused():
    scene = isochrome.load_scene("line-contact-wear")
    found = Campaign(Path(), scene, tuple(some_recordings(3)))
    with pytest.raises(InputError, match="its recordings are 0 to 2"):
        found.panels((3,))
    with pytest.raises(InputError, match="nothing to draw"):
        found.panels((2,))  # it failed
    assert len(found.panels((0, 1)).plots) == 4


def run(monkeypatch, capsys, *arguments) -> tuple[object, dict]:
    """The command line in this process: exit code, and the JSON that it printed."""
    capsys.readouterr()
    code = exit_code(monkeypatch, *arguments, "--json")
    return code, json.loads(capsys.readouterr().out or "{}")


@pytest.mark.long
def test_a_campaign_and_the_demo_leave_the_figure_that_is_asked_for(
    worn, tmp_path, monkeypatch, capsys
):
    home = worn["home"]
    names = [tmp_path / f"run{k}.tif" for k in (1, 2)]
    for name in names:
        name.write_bytes((home / "simulated" / "frames.tif").read_bytes())
    asked = ("--width", "85mm", "--format", "png", "--dpi", "60")
    out = tmp_path / "all"
    where = ("--scene", home / "scene.toml", "--out", out)
    code, found = run(monkeypatch, capsys, "process", *names, *where, *asked)
    assert not code and found["figures"][0] == str(out / "figure_85mm.png")
    ready = Demo(tmp_path / "demo", [], {}, worn["compare"])
    (tmp_path / "demo" / "comparison").mkdir(parents=True)
    monkeypatch.setattr("isochrome.demonstration.demo", lambda out, progress: ready)
    code, found = run(monkeypatch, capsys, "demo", *asked, "--frames", "1")
    file = found["figures"][0]
    assert not code and Path(file) == tmp_path / "demo" / "comparison" / "figure_85mm.png"
    with Image.open(file) as picture:
        assert picture.width == pytest.approx(60 * 85 / 25.4, abs=1)
    assert run(monkeypatch, capsys, "demo", "--width", "10mm")[0] == 2  # before its minute of work


@pytest.mark.long
@pytest.mark.parametrize("count", [1, pytest.param(2, marks=STUDY)])
def test_the_colour_bar_of_key_frames_is_no_taller_than_its_pictures(count):
    """Beside six values of a film, that of one key frame was three times as tall."""
    keys = [f"key {k}" for k in range(5)]
    columns = {"frame": [0, 1], "distance_m": [0.0, 1.0], "chi": [1.0, 1.0]}
    columns |= {PICTURE: [0, 1], FOUND_BY: ["whole frame", "track"]}
    for key in keys:
        columns |= {key: [1.0, 1.1], f"{key} standard_uncertainty": [0.1, 0.1]}
    order = np.add.outer(np.linspace(0.0, 3.0, 60), np.zeros(80))
    shown = ShownFrame(
        number=0, label="frame 0", chi=1.0, kept=1.0, normalised=np.sin(np.pi * order) ** 2,
        order=order, isoclinic=None, lines=False,
        place={"pixel_mm": 0.05, "left_mm": -2.0, "top_mm": 0.0},
    )  # fmt: skip
    figure = set_figure(isochrome.parse_scene("[specimen]"), columns, [shown] * count)
    figure.draw_without_rendering()
    maps = [axes for axes in figure.axes if axes.images]
    bars = [image.colorbar for axes in maps for image in axes.images if image.colorbar]
    (high,) = (bar.ax.get_window_extent().height for bar in bars)
    boxes = [axes.get_window_extent() for axes in maps]
    assert len(maps) == 2 * count
    assert high <= max(box.y1 for box in boxes) - min(box.y0 for box in boxes) + 1.0
