"""Figures for a paper: one size of letters, panels lettered, and the data of each curve as CSV.

Matplotlib lays them out; the height is what the pictures need at the width.
"""

from __future__ import annotations

import io
import math
import re
import textwrap
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count, product
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.figures.style import (
    BOLD_PT,
    INK,
    PAPER_LINE_MM,
    PAPER_PT,
    add_legend,
    ends_beyond,
    new_figure,
    write_head,
)
from isochrome.output import Result, replacing, write_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.gridspec import GridSpec
    from matplotlib.image import AxesImage

Array = NDArray[Any]

FORMATS = ("png", "pdf", "svg", "tiff")
"""Formats of a figure for a paper, by the endings of its files."""

NARROWEST_MM, WIDEST_MM = 60.0, 400.0
"""Widths that a figure can have: a label beside a picture fits, and a poster's column."""
LEAST_DPI, MOST_DPI = 50.0, 2400.0


@dataclass(frozen=True, kw_only=True)
class FigureStyle:
    """How a figure for a paper is to be: its width, its frames, and its files.

    `paper_figure` and `save_figure` take it; a command's options --width, --frames, --format, --dpi
    and --numbers say the same.

    Parameters
    ----------
    width_mm : float, default 174.0
        Width of the figure, mm: 85 is usual for one column, 174 for two.
    frames : tuple of int, optional
        Numbers of the frames (states, images) that are shown, from 0; by default the first or
        evenly spaced ones.
    formats : tuple of str, default ('pdf', 'png')
        Files that are written: png, pdf, svg, tiff.
    dpi : float, default 600.0
        Dots per inch of png and tiff.
    numbers : bool, default False
        Whether the numbers of the panels stand below them.

    Raises
    ------
    InputError
        Where a value is not one of these.

    Examples
    --------
    >>> import isochrome
    >>> isochrome.FigureStyle(width_mm=85, formats=("svg",)).dpi
    600.0
    """

    width_mm: float = 174.0
    frames: tuple[int, ...] | None = None
    formats: tuple[str, ...] = ("pdf", "png")
    dpi: float = 600.0
    numbers: bool = False

    def __post_init__(self) -> None:
        if not NARROWEST_MM <= self.width_mm <= WIDEST_MM:
            raise InputError(
                "width_mm_figure_give", width_mm=self.width_mm, narrowest_mm=NARROWEST_MM,
                widest_mm=WIDEST_MM,
            )  # fmt: skip
        if not LEAST_DPI <= self.dpi <= MOST_DPI:
            raise InputError("dpi_give_such", dpi=self.dpi, least_dpi=LEAST_DPI, most_dpi=MOST_DPI)
        wrong = [name for name in self.formats if name not in FORMATS]
        if wrong or not self.formats:
            given = ", ".join(wrong) or "none"
            raise InputError("format_figure_give_some", given=given, formats=", ".join(FORMATS))
        if self.frames is not None and (not self.frames or min(self.frames) < 0):
            given = ",".join(map(str, self.frames)) or "none"
            raise InputError("frames_figure_give_numbers", given=given)


@dataclass(frozen=True, kw_only=True)
class PictureKind:
    """Pictures of one kind, one an item, that share their colours."""

    name: str  # what they show
    draw: Callable[[Axes, int], AxesImage]  # item k, with `show_image`
    bar: str = ""  # label of their colour bar, with its unit; empty: there is none


@dataclass(frozen=True, kw_only=True)
class Plot:
    """A plot of curves or bars."""

    title: str  # what it shows
    draw: Callable[[Axes], Any]
    height_mm: float = 40.0  # of its axes
    least_mm: float = 22.0  # down to which they may be lowered where a page has no room
    spare: int = 0  # rank in which it goes where a page has no room: the largest first, 0 never


@dataclass(frozen=True, kw_only=True)
class PaperPanels:
    """The panels of a figure for a paper."""

    kinds: Sequence[PictureKind] = ()  # each with a picture of every item
    labels: Sequence[str] = ()  # what the items are
    plots: Sequence[Plot] = ()  # below the pictures
    plots_across: int = 3  # most plots beside each other
    legend: Sequence[str] = ()  # names of the lines, where the plots share one legend, below them
    notes: Sequence[str] = ()  # the panels' numbers and what holds for all, a paragraph each


def chosen_frames(
    frames: tuple[int, ...] | None, count: int, default: Sequence[int], *, items: str = "frames"
) -> list[int]:
    """The numbers of the frames that a figure shows, as asked for or the default ones."""
    if frames is None:
        return list(default)
    beyond = [k for k in frames if not 0 <= k < count]
    if beyond:
        raise InputError("frames_figure", beyond=beyond[0], items=items, count=count - 1)
    return list(frames)


_DATA_ONLY = "_data: "
"""In front of a name that no legend shows, as of all that begin with a line below."""


def data_name(words: str) -> str:
    """The label of a curve that has its name in the data alone, and in no legend."""
    return f"{_DATA_ONLY}{words}"


ENVELOPE = "least, most"
"""Name of a band that holds all values of which a curve has the means."""


def curve_columns(axes: Axes) -> dict[str, Array]:
    """The data of a plot's curves as columns for a spreadsheet, NaN where one is shorter: x and y,
    the ends of bands or bars, of Axes and of those over them; several curves over one x have it
    once, and one that is drawn twice stands once."""
    columns: dict[str, Array] = {}
    drawn: list[list[Array]] = []
    for name, across, up, x, values in _curves(axes):
        curve = [x, *values.values()]
        if any(len(curve) == len(old) and all(map(_same, curve, old)) for old in drawn):
            continue  # a line with a band, and its points with bars
        if not drawn or not _same(drawn[-1][0], x):
            across = f"{name}: {across}" if across in columns and name else across
            columns[_free(columns, across)] = x
        drawn.append(curve)
        for ending, column in values.items():
            columns[_free(columns, ": ".join(filter(None, (name, f"{up}{ending}"))))] = column
    longest = max((len(column) for column in columns.values()), default=0)
    for name, column in columns.items():
        blank = np.nan if column.dtype.kind == "f" else ""
        columns[name] = np.concatenate([column, np.full(longest - len(column), blank)])
    return columns


_Curve = tuple[str, Array, dict[str, Array]]
"""Name, x and values of a curve: its own, and the ends of its band, by what follows its name."""


def _curves(axes: Axes) -> Iterator[tuple[str, str, str, Array, dict[str, Array]]]:
    """Name, what is across and up, x, values, of Axes and of those over them."""
    from matplotlib.container import ErrorbarContainer

    label = _plain(axes.get_xlabel()) or "x"
    others = [one for one in axes.get_shared_x_axes().get_siblings(axes) if one is not axes]
    for scale in (axes, *others):
        up = _plain(scale.get_ylabel()) or "y"
        bars = [one.lines for one in scale.containers if isinstance(one, ErrorbarContainer)]
        of_bars = {artist for line, caps, _ in bars for artist in (line, *caps)}
        for name, x, values in chain(_bars(scale), _lines(scale, of_bars)):
            # bars stand beside their names
            yield name, *((label, up) if x.dtype.kind == "f" else ("input", label)), x, values


def _bars(axes: Axes) -> Iterator[_Curve]:
    """Points with the ends of their bars, and bars beside their names."""
    from matplotlib.container import BarContainer, ErrorbarContainer

    for bars in axes.containers:
        if isinstance(bars, ErrorbarContainer):
            line, _, sticks = bars.lines
            x, y = (np.asarray(part, dtype=float) for part in line.get_data())
            values = {"": y}
            ends = [np.asarray(stick)[:, 1] for stick in sticks[0].get_segments()] if sticks else []
            if len(ends) == len(y) > 0:
                values |= {" low": np.array(ends)[:, 0], " high": np.array(ends)[:, 1]}
            if len(x):  # else no frame is of this kind
                yield _name(bars), x, values
        elif isinstance(bars, BarContainer):
            names = [label.get_text().replace("\n", " ") for label in axes.get_yticklabels()]
            widths = np.array([patch.get_width() for patch in bars.patches], dtype=float)
            if len(names) == len(widths):
                yield "", np.array(names)[::-1], {"": widths[::-1]}


def _lines(axes: Axes, of_bars: set[Any]) -> Iterator[_Curve]:
    """Lines but those `of_bars`, each with the ends of the bands in its colour."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    bands = [band for band in axes.collections if isinstance(band, PolyCollection)]
    for line in axes.lines:
        x, y = (np.asarray(part, dtype=float) for part in line.get_data())
        if line in of_bars or line.get_transform() != axes.transData or not len(x):
            continue
        colour = [*to_rgb(line.get_color())]
        same = [b for b in bands if np.ravel(b.get_facecolor())[:3].tolist() == colour]
        bands = [band for band in bands if band not in same]
        values = {"": y}
        for band in same:
            corners = np.concatenate([path.vertices for path in band.get_paths()])
            at = np.where(corners[:, 0] == x[:, None], corners[:, 1], np.nan)
            low, high = (ENVELOPE if _name(band) == ENVELOPE else "low, high").split(", ")
            values[f" {low}"] = np.fmin.reduce(at, axis=1)
            values[f" {high}"] = np.fmax.reduce(at, axis=1)
        yield _name(line), x, values


def _name(artist: Any) -> str:
    """What a legend calls it, or would; empty where it has no name."""
    label = str(artist.get_label()).removeprefix(_DATA_ONLY)
    return "" if label.startswith("_") else _plain(label)


def _plain(text: str) -> str:
    return " ".join(text.split())


def _same(one: Array, other: Array) -> bool:
    return one.shape == other.shape and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def _free(columns: dict[str, Array], name: str) -> str:
    """A name that no column has yet."""
    names = chain([name], (f"{name} ({k})" for k in count(2)))
    return next(new for new in names if new not in columns)


_SHARE = 0.3
"""Longest bar, over the picture's width."""


def add_scale_bar(axes: Axes) -> None:
    """Draw a scale bar on a picture in mm, on a white ground that shows on any picture."""
    from matplotlib.font_manager import FontProperties
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    if "(mm)" not in axes.get_xlabel():
        return
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    # 1, 2 or 5 times a power of ten, at most a share of the width
    longest = _SHARE * abs(right - left)
    decade = 10.0 ** math.floor(math.log10(longest))
    length = decade * max(s for s in (1.0, 2.0, 5.0) if s * decade <= 1.000001 * longest)
    label = f"{length:g} mm" if length >= 0.1 else f"{1000.0 * length:g} µm"
    bar = AnchoredSizeBar(
        axes.transData, length, label, "lower right", pad=0.25, borderpad=0.3, sep=2.0,
        size_vertical=0.015 * abs(top - bottom), color=INK,
        fontproperties=FontProperties(size=PAPER_PT),
    )  # fmt: skip
    bar.patch.set(facecolor="white", edgecolor="none", linewidth=BOLD_PT)
    axes.add_artist(bar)


MM_PER_INCH = 25.4
PAGE_MM = 230.0
"""Height that a journal's page leaves for a figure."""
_LEAST_MM, _LEAST_OF_COLUMN_MM = 36.0, 24.0
"""Narrowest picture of several, in a wide figure and in one of a column."""
_COLUMN_MM = 120.0
"""Width below which a figure is one of a column."""
_PLOT_MM = 70.0
"""Narrowest plot, with its labels."""
_AROUND_MM = 14.0
"""Room of a panel's numbers and labels at the left, and of a number at a plot's horizontal axis."""
_SCREEN_MM = 260.0
"""Width of a figure for a screen."""
_LETTER_MM = 1.5
"""A letter's width in a line of text."""
_ONE_PLACE = 0.01
"""Over the picture's size: pictures that are no further apart have their numbers once."""
_PLOT = "plot-"
"""In front of a plot's letter, in the name by which its Axes (and an SVG's group) are known."""
_PASSES = 4
"""Times that the height is mended by what the pictures need."""
_PLACES = 6
"""Decimals of places (over the figure) and heights (mm): the layout's last digits are those of
another order of its equations each time, and an SVG's names are made of them."""
_UNIT = re.compile(r"(?<=\d) (?=(?:m|mm|µm|N|px|fringes?)\b|%)")
"""The space between a number and its unit, where no line ends."""


def fold(text: str, room_mm: float) -> str:
    """Break a text at its spaces, its own line breaks too, into lines of about a width."""
    held = _UNIT.sub("\u00a0", " ".join(text.splitlines()))
    return textwrap.fill(held, max(12, int(room_mm / _LETTER_MM)), break_on_hyphens=False)


def paper_figure(result: Result, style: FigureStyle | None = None) -> Figure:
    """Draw a result for a paper, laid out for the width of a journal's column.

    All letters have 8 pt at the final size. Pictures have a scale bar, where their scale is known,
    and panels have letters.

    Parameters
    ----------
    result : Comparison, ScarComparison, Processed, Simulation or a calibration
        What `compare`, `process`, `simulate` or `calibrate_...` found.
    style : FigureStyle, optional
        Width and frames; by default 174 mm.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, to be changed or saved; `save_figure` saves it.

    Raises
    ------
    InputError
        Where the result has no such picture or no such frame.

    Examples
    --------
    >>> import isochrome
    >>> style = isochrome.FigureStyle(width_mm=85)
    >>> figure = isochrome.paper_figure(isochrome.simulate("ring"), style)
    >>> round(25.4 * figure.get_figwidth())
    85
    """
    return figure_for_page(result, style or FigureStyle())[0]


def figure_for_page(result: Result, style: FigureStyle) -> tuple[Figure, tuple[str, ...]]:
    """Draw `paper_figure`, and give the titles of the plots that have no room on the page."""
    make = getattr(result, "panels", None)
    if make is None:
        raise InputError(
            "has_no_figure_paper", title=getattr(result, "title", type(result).__name__)
        )
    panels: PaperPanels = make(style.frames)
    plots = list(panels.plots)
    spare = sorted((plot for plot in plots if plot.spare), key=lambda plot: -plot.spare)
    closer = _picture_rows(panels, style.width_mm, least_mm=_LEAST_OF_COLUMN_MM)
    layouts = [(_picture_rows(panels, style.width_mm), plots, False), (closer, plots, False)]
    for number in range(len(spare) + 1) if plots else ():
        layouts.append((closer, [plot for plot in plots if plot not in spare[:number]], True))
    for rows, few, lowest in layouts:
        figure = _drawn(panels, style, rows, few, lowest=lowest)
        if MM_PER_INCH * figure.get_figheight() <= PAGE_MM:
            return figure, tuple(plot.title for plot in spare if plot not in few)
    return _drawn(panels, style, closer, plots), ()


def panels_figure(panels: PaperPanels, head: str, *, picture_mm: float = 80.0) -> Figure:
    """The same panels for a screen, all of them, with their numbers, below a head; pictures are
    `picture_mm` wide or more."""
    style = FigureStyle(width_mm=_SCREEN_MM, numbers=True)
    rows = _picture_rows(panels, _SCREEN_MM, least_mm=picture_mm)
    return _drawn(panels, style, rows, list(panels.plots), head=head)


def _split(items: Sequence[Any], most: int) -> list[list[Any]]:
    """Rows of one length, or nearly, of at most so many items."""
    rows = math.ceil(len(items) / max(1, most))
    across = math.ceil(len(items) / max(1, rows))
    return [list(items[k : k + across]) for k in range(0, len(items), max(1, across))]


def _picture_rows(
    panels: PaperPanels, width_mm: float, *, least_mm: float = _LEAST_MM
) -> list[list[tuple[int, int]]]:
    """Rows of pictures, as numbers of their kind and item: the kinds beside each other where they
    fit, else the items."""
    kinds, items = range(len(panels.kinds)), range(len(panels.labels))
    if not kinds:
        return []
    if len(items) == 1 or (len(kinds) > 2 and width_mm / len(kinds) >= _LEAST_MM):
        few = _split(items, int(width_mm / least_mm) // len(kinds))
        groups = [[(j, k) for k in some for j in kinds] for some in few]
    else:
        groups = [[(j, k) for k in items] for j in kinds]
        least_mm = _LEAST_OF_COLUMN_MM if width_mm < _COLUMN_MM else least_mm
    return [row for group in groups for row in _split(group, int(width_mm / least_mm))]


def _plot_heights(
    panels: PaperPanels, style: FigureStyle, rows: Sequence[Sequence[Plot]], *, lowest: bool
) -> list[float]:
    """Heights (mm) of the rows of plots with titles and labels, and of the legend below them."""
    share = 1.0 if style.width_mm >= _COLUMN_MM else 0.8
    heights = []
    for row in rows:
        sizes = [(share * plot.height_mm, plot.least_mm) for plot in row]
        tall = max(min(size) if lowest else size[0] for size in sizes)
        heights.append(tall + 4.0 * PAPER_LINE_MM)
    lines = math.ceil(len(panels.legend) / _legend_columns(panels, style))
    return [*heights, (1.4 * lines + 0.6) * PAPER_LINE_MM] if lines else heights


def _legend_columns(panels: PaperPanels, style: FigureStyle) -> int:
    longest = _LETTER_MM * max(map(len, panels.legend), default=0) + _AROUND_MM
    return max(1, min(len(panels.legend), int(style.width_mm / longest)))


def _drawn(
    panels: PaperPanels,
    style: FigureStyle,
    rows: list[list[tuple[int, int]]],
    plots: Sequence[Plot],
    *,
    lowest: bool = False,
    head: str = "",
) -> Figure:
    """Texts may be long, and Matplotlib gives them room."""
    notes = "\n".join(fold(note, style.width_mm - 2.0) for note in panels.notes if style.numbers)
    plot_rows = _split(plots, min(int(style.width_mm / _PLOT_MM), panels.plots_across))
    heights = _plot_heights(panels, style, plot_rows, lowest=lowest)
    head = "\n".join(fold(line, style.width_mm - 8.0) for line in head.splitlines())
    blocks = {
        "pictures": sum(0.75 * style.width_mm / len(rows[0]) + _AROUND_MM for _ in rows),
        "plots": sum(heights),
        "notes": PAPER_LINE_MM * (notes.count("\n") + 1.5) if notes else 0.0,
    }
    blocks = {name: high for name, high in blocks.items() if high}
    head_mm = 1.2 * PAPER_LINE_MM * (head.count("\n") + 1.5) if head else 0.0
    tall = head_mm + sum(blocks.values())
    figure = new_figure(style.width_mm / MM_PER_INCH, tall / MM_PER_INCH)
    engine: Any = figure.get_layout_engine()
    engine.set(w_pad=0.04, h_pad=0.02, wspace=0.0, hspace=0.0)
    grid = figure.add_gridspec(len(blocks), 1, height_ratios=list(blocks.values()))
    parts = {name: figure.add_subfigure(grid[k]) for k, name in enumerate(blocks)}
    singles, pairs = ascii_lowercase, product(ascii_lowercase, repeat=2)
    letters = (f"({''.join(letter)})" for letter in chain(singles, pairs))
    pictures: list[list[Axes]] = []
    if head:
        write_head(figure, head)
    if rows:
        pictures = _draw_pictures(parts["pictures"], panels, rows, style.width_mm, letters)
    if plots:
        _draw_plots(parts["plots"], panels, style, plot_rows, heights, letters)
    if notes:
        parts["notes"].text(0.01, 1.0, notes, va="top").set_in_layout(False)
    _lay_out(figure, grid, blocks, pictures, head_mm)
    return figure


def _lay_out(
    figure: Figure, grid: GridSpec, blocks: dict[str, float], pictures: list[list[Axes]],
    head_mm: float,
) -> None:  # fmt: skip
    """Give letters the paper's size, and the figure the height of its pictures at their width;
    places are rounded, so that the same figure is the same file each time."""
    from matplotlib.text import Text

    for drawn in figure.findobj(lambda artist: hasattr(artist, "tick_params")):
        drawn.tick_params(labelsize=PAPER_PT, length=2.0, width=0.6)  # type: ignore[attr-defined]
    for text in figure.findobj(Text):
        text.set(fontsize=PAPER_PT)
    engine: Any = figure.get_layout_engine()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from font")
        for _ in range(_PASSES):
            for _ in range(2):  # which draws nothing; margins are of where pictures stood before
                engine.execute(figure)
            missing = sum(_missing_mm(row) for row in pictures)
            if abs(missing) < 0.1:
                break
            blocks["pictures"] = round(max(blocks["pictures"] + missing, 10.0), _PLACES)
            grid.set_height_ratios(list(blocks.values()))
            figure.set_figheight((head_mm + sum(blocks.values())) / MM_PER_INCH)
        else:
            engine.execute(figure)
    figure.set_layout_engine("none")  # what is saved is what was laid out, at any resolution
    for part in figure.findobj(lambda artist: hasattr(artist, "bbox_relative")):
        block: Any = part
        block.bbox_relative.set_points(np.round(block.bbox_relative.get_points(), _PLACES))
    for axes in figure.axes:
        place = axes.get_position(original=True)
        axes.set_position(np.round(place.bounds, _PLACES).tolist())


def _draw_pictures(
    part: SubFigure,
    panels: PaperPanels,
    rows: list[list[tuple[int, int]]],
    width_mm: float,
    letters: Iterator[str],
) -> list[list[Axes]]:
    """Each kind's colour bar stands below its last row, and is as wide."""
    cols = max(map(len, rows))
    grid: Any = part.add_gridspec(len(rows), cols)
    shown = [[part.add_subplot(grid[r, c]) for c in range(len(row))] for r, row in enumerate(rows)]
    room = (width_mm - _AROUND_MM) / cols - 2.0
    below: dict[int, list[Axes]] = {}
    images = defaultdict[int, list[Any]](list)
    for row, cells in zip(shown, rows, strict=True):
        for axes, (j, k) in zip(row, cells, strict=True):
            kind = panels.kinds[j]
            images[j].append(kind.draw(axes, k))
            below[j] = [one for one, cell in zip(row, cells, strict=True) if cell[0] == j]
            words = (kind.name if len(panels.kinds) > 1 else "", panels.labels[k])
            marked = any(not line.get_clip_on() for line in axes.lines)  # above the picture too
            title = fold(f"{next(letters)} {', '.join(filter(None, words))}", room)
            pad = 1.25 * PAPER_PT if marked else None  # a line's room for the marks
            axes.set_title(title, loc="left", pad=pad)
            axes.set_anchor("N")
    add_scale_bar(shown[0][0])
    _outer_labels(shown)
    for j, kind in enumerate(panels.kinds):
        if kind.bar:
            last = below[j]
            bar = part.colorbar(
                images[j][0],
                ax=last,
                location="bottom",
                extend=ends_beyond(images[j]),
                extendfrac=0.04,
                pad=0.02,
                panchor=False,
                fraction=0.12,  # of the pictures' height, of which it takes what its shape needs
                aspect=0.5 * width_mm / cols * len(last),  # 1.6 mm high, 0.8 of its pictures wide
            )
            bar.set_label(fold(kind.bar, room * len(last)))
    return shown


def _outer_labels(rows: list[list[Axes]]) -> None:
    """Numbers and labels at the outer axes alone, where all pictures show one place."""
    limits = np.array([[*axes.get_xlim(), *axes.get_ylim()] for row in rows for axes in row])
    one_place = bool(np.all(np.ptp(limits, axis=0) <= _ONE_PLACE * np.ptp(limits)))
    for r, row in enumerate(rows):
        for col, axes in enumerate(row):
            inner = bool(col), r + 1 < len(rows) and col < len(rows[r + 1])
            if one_place:
                axes.tick_params(labelleft=not inner[0], labelbottom=not inner[1])
            axes.set_ylabel("" if inner[0] else axes.get_ylabel())
            axes.set_xlabel("" if inner[1] else axes.get_xlabel())


def _draw_plots(
    part: SubFigure,
    panels: PaperPanels,
    style: FigureStyle,
    rows: Sequence[Sequence[Plot]],
    heights: list[float],
    letters: Iterator[str],
) -> None:
    """In rows, each with its title over its numbers too, and a legend below all."""
    from matplotlib.ticker import AutoLocator

    cols = max(map(len, rows))
    room = style.width_mm / cols - 3.0
    grid = part.add_gridspec(len(heights), cols, height_ratios=heights)
    entries: Any = None
    for r, row in enumerate(rows):
        for col, plot in enumerate(row):
            panel = part.add_subfigure(grid[r, col])
            axes: Axes = panel.subplots()
            plot.draw(axes)
            entries = entries or axes.get_legend_handles_labels()
            letter = next(letters)
            axes.set_title("", loc="left")
            write_head(panel, fold(f"{letter} {plot.title}", room), x=0.01, ha="left")
            axes.set_gid(f"{_PLOT}{letter.strip('()')}")
            axes.set_ylabel(fold(axes.get_ylabel(), heights[r] - 4.0 * PAPER_LINE_MM))
            names = max((len(text.get_text()) for text in axes.get_yticklabels()), default=0)
            axes.set_xlabel(fold(axes.get_xlabel(), room - _LETTER_MM * names))
            if isinstance(axes.xaxis.get_major_locator(), AutoLocator):
                axes.locator_params(axis="x", nbins=max(2, min(int((room - 25.0) / _AROUND_MM), 6)))
            legend = axes.get_legend()
            for name in legend.get_texts() if legend else ():
                name.set_text(fold(name.get_text(), 0.6 * (room - _AROUND_MM)))
    if panels.legend:
        foot = part.add_subfigure(grid[len(rows), :])
        add_legend(foot, *entries, loc="upper center", ncols=_legend_columns(panels, style))


def _missing_mm(row: Sequence[Axes]) -> float:
    """What pictures lack in height, or have too much, to be as wide as their place. Numbers and
    labels below a picture that ends above its place are no room too much."""
    lacking = []
    for axes in row:
        axes.apply_aspect()
        shown, part = axes.get_window_extent(), axes.figure
        box: Any = axes.get_position(original=True).transformed(part.transSubfigure)  # in dots
        tight: Any = axes.get_tightbbox(for_layout_only=True)
        lack = box.width * shown.height / shown.width - box.height
        lacking.append((lack if lack > 0.0 else min(0.0, box.y0 - tight.y0)) / part.figure.dpi)
    return MM_PER_INCH * float(max(lacking))


_EMBEDDED: Any = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "isochrome"}
"""Fonts as TrueType, which journals take, and text as text; the same file again."""

_UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


def save_figure(
    result: Result, path: str | Path, style: FigureStyle | None = None
) -> tuple[Path, ...]:
    """Write a result's figure for a paper, and beside it the data of each plot as CSV.

    PDF and SVG hold text as text, with the fonts of a PDF in it. A figure that would be taller
    than a page (230 mm) is laid out closer; a UserWarning says which plots have no room, or how
    tall it is still.

    Parameters
    ----------
    result : Comparison, ScarComparison, Processed, Simulation or a calibration
        What `compare`, `process`, `simulate` or `calibrate_...` found.
    path : str or Path
        The files' name without its ending, such as 'paper/figure-3'.
    style : FigureStyle, optional
        Width, frames, formats; by default 174 mm, as PDF and PNG.

    Returns
    -------
    tuple of Path
        The files: one a format, and one a plot, NAME_LETTER.csv.

    Raises
    ------
    InputError
        Where the result has no such picture or no such frame, or a file cannot be written.

    Examples
    --------
    >>> import isochrome
    >>> style = isochrome.FigureStyle(width_mm=85, formats=("svg",))
    >>> files = isochrome.save_figure(isochrome.simulate("ring"), "ring", style)
    >>> [file.name for file in files]
    ['ring.svg']
    """
    style = style or FigureStyle()
    figure, left_out = figure_for_page(result, style)
    if left_out:
        say = f"a page has no room for: {', '.join(left_out)}; a wider figure has"
        warnings.warn(say, UserWarning, stacklevel=2)
    tall = MM_PER_INCH * figure.get_figheight()
    if tall > PAGE_MM:
        warnings.warn(f"the figure is {tall:.0f} mm tall; choose fewer --frames", stacklevel=2)
    base = Path(path)
    files = []
    for form in dict.fromkeys(style.formats):
        file = base.with_name(f"{base.name}.{form}")
        with replacing(file) as beside:
            Path(beside).write_bytes(_content(figure, form, style.dpi))
        files.append(file)
    tables = []
    for axes in figure.axes:
        name = axes.get_gid() or ""
        columns = curve_columns(axes) if name.startswith(_PLOT) else {}
        if columns:
            tables.append(base.with_name(f"{base.name}_{name.removeprefix(_PLOT)}.csv"))
            write_csv(tables[-1], {key: column.tolist() for key, column in columns.items()})
    return (*files, *tables)


def _content(figure: Figure, form: str, dpi: float) -> bytes:
    from matplotlib import rc_context
    from matplotlib.image import AxesImage

    more: dict[str, Any] = {"metadata": _UNDATED[form]} if form in _UNDATED else {}
    if form == "tiff":
        more["pil_kwargs"] = {"compression": "tiff_lzw"}
    drawn: list[Any] = figure.findobj(AxesImage)
    ways = [image.get_interpolation() for image in drawn]
    content = io.BytesIO()
    with rc_context(_EMBEDDED), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from font")
        for image in drawn if form in _UNDATED else ():
            image.set_interpolation("none")  # the pixels themselves, which no printer blurs
        figure.savefig(content, format=form, dpi=dpi, **more)
        for image, way in zip(drawn, ways, strict=True):
            image.set_interpolation(way)
    return content.getvalue()
