"""A figure for a paper: its parts and style, and how they stand: rows, columns and heights.

Pictures stand in a grid, plots flow in rows below it. What is taller than a page is laid out
closer: pictures beside each other, lower plots, and at last without the plots that may be missing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Protocol

from isochrome.errors import InputError
from isochrome.figures.style import PAPER_LINE_MM, PAPER_PT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from matplotlib.text import Text

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
                "width_mm_figure_give",
                width_mm=self.width_mm,
                narrowest_mm=NARROWEST_MM,
                widest_mm=WIDEST_MM,
            )
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


class WithPanels(Protocol):
    """A result that can be drawn for a paper."""

    @property
    def title(self) -> str:
        """What it is, in a line."""

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the panels of some of its frames."""


def chosen_frames(
    frames: tuple[int, ...] | None, count: int, default: Sequence[int], *, items: str = "frames"
) -> list[int]:
    """The numbers of the frames that a figure shows: those asked for, or the default ones.

    `items` is what they are called. InputError where there is no such frame.
    """
    if frames is None:
        return list(default)
    beyond = [k for k in frames if not 0 <= k < count]
    if beyond:
        raise InputError("frames_figure", beyond=beyond[0], items=items, count=count - 1)
    return list(frames)


_UNIT = re.compile(r"(?<=\d) (?=(?:m|mm|µm|N|px|fringes?)\b|%)")
"""The space between a number and its unit, where no line ends."""
_PT_PER_MM = 72.0 / 25.4
_LEGEND_SHARE, _SAMPLE_MM = 0.7, 9.0
"""Widest legend over its axes, and the room of a line beside its name."""
_SHORTEST_LINE_MM = 15.0
"""A line of text that is never broken further."""
_TICK_MM, _BETWEEN_MM = 10.0, 3.0
"""Least room of a number at a horizontal axis, and what is free between two of them."""
_BAR = "<colorbar>"
"""What Matplotlib calls the axes of a colour bar."""
_FOR_THREE, _MOST_NUMBERS = 3.5, 6
"""Room, in numbers, for three of them; and the most."""
_ROUND_STEPS = [1, 2, 2.5, 5, 10]
"""Round steps from number to number."""
_OVER_MM = 0.5
"""How far one of two numbers may stand out beyond its axis."""
_EDGE_MM = 1.5
"""What stays free at the figure's edge."""
_TICK_DOWN_MM = 7.0
"""Room of a number at a vertical axis."""


@lru_cache(maxsize=4096)
def width_mm(text: str) -> float:
    """Width of a line of text in the figure's font and size."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    if not text.strip():
        return 0.0
    path = TextPath((0.0, 0.0), text, size=PAPER_PT, prop=FontProperties(), usetex=False)
    return float(path.get_extents().width) / _PT_PER_MM


def wrap_note(text: str, room_mm: float) -> str:
    """Break a text at its spaces, its own line breaks too, into lines that fit.

    A word that is too long stands alone, and is broken where it must be.
    """
    lines, line = list[str](), ""
    held = _UNIT.sub("\u00a0", " ".join(text.splitlines()))
    for word in held.split(" "):
        longer = f"{line} {word}".strip()
        if line and width_mm(longer) > room_mm:
            lines.append(line)
            longer = word
        while width_mm(longer) > room_mm and len(longer) > 1:
            sizes = range(len(longer) - 1, 0, -1)
            count = next(n for n in sizes if n == 1 or width_mm(longer[:n]) <= room_mm)
            lines.append(longer[:count])
            longer = longer[count:]
        line = longer
    return "\n".join([*lines, line])


class FittedTexts:
    """The titles, labels, legends and numbers of a figure, fitted to its axes again and again.

    The figure's texts have the paper's size.
    """

    def __init__(self, figure: Figure) -> None:
        from matplotlib.axes import Axes
        from matplotlib.ticker import AutoLocator

        self.figure = figure
        self.axes = [axes for axes in figure.findobj(Axes) if axes.get_visible() and axes.axison]
        self._texts = {text: text.get_text() for axes in self.axes for text in _texts(axes)}
        self._thinned = [
            (axes, axis)
            for axes in self.axes
            for axis in (axes.xaxis, axes.yaxis)
            if isinstance(axis.get_major_locator(), AutoLocator)
            or (axes.get_label() == _BAR and axis is axes.xaxis)
        ]

    def fit(self) -> None:
        """Break what is longer than its axes, and give the numbers at axes their room."""
        for text, words in self._texts.items():
            text.set_text("x"[: len(words)])  # so that no text pushes the axes that it is to fit
        self.figure.draw_without_rendering()
        self.wrap()
        for axes, axis in self._thinned:
            wide, high = _size_mm(axes)
            if axis is axes.xaxis:
                longest = max(
                    (width_mm(text.get_text()) for text in axis.get_ticklabels()), default=0
                )
                _thin(axis, wide / max(_TICK_MM, longest + _BETWEEN_MM))
                _give_two(axis, wide, width_mm)
            else:
                _thin(axis, high / _TICK_DOWN_MM)
                _give_two(axis, high, lambda text: PAPER_LINE_MM if text else 0.0)

    def wrap(self) -> None:
        """Break what is longer than its axes are now: the texts at the sides have made them so."""
        for axes in self.axes:
            wide, high = _size_mm(axes)
            title, across, up, *names = _texts(axes)
            beside = _free_beside_mm(axes)
            for text, middle in ((title, 0.0), (across, 0.5)):
                more = min(max(width_mm(self._texts[text]) - wide, 0.0), beside)
                text.set_x(middle - (1.0 - middle) * more / wide)
                text.set_text(wrap_note(self._texts[text], max(wide + more, _SHORTEST_LINE_MM)))
            for text, room in (
                (up, high),
                *((n, _LEGEND_SHARE * wide - _SAMPLE_MM) for n in names),
            ):
                text.set_text(wrap_note(self._texts[text], max(room, _SHORTEST_LINE_MM)))


def _texts(axes: Axes) -> list[Text]:
    """The title at the left, which setting it to what it is gives; labels; names of a legend."""
    title = axes.set_title(axes.get_title(loc="left"), loc="left", fontsize=PAPER_PT)
    legend = axes.get_legend()
    return [title, axes.xaxis.label, axes.yaxis.label, *(legend.get_texts() if legend else ())]


def _free_beside_mm(axes: Axes) -> float:
    """Room at the left of axes for their title and label, mm: names of bars leave them narrow.

    That of a picture in a grid may be its neighbour's.
    """
    part = axes.figure
    assert part is not None
    if len({tuple(own.get_position(original=True).bounds) for own in part.axes}) > 1:
        return 0.0
    start = float(axes.get_position(original=True).x0 * part.bbox.width)
    return max(0.0, start * 25.4 / part.figure.dpi - _EDGE_MM)


def _size_mm(axes: Axes) -> tuple[float, float]:
    """Width and height of the place of axes, which a picture fills in the end, mm.

    A colour bar has a shape of its own, and does not fill its place.
    """
    place, part = axes.get_position(original=axes.get_label() != _BAR), axes.figure
    assert part is not None
    scale = 25.4 / part.figure.dpi
    return place.width * part.bbox.width * scale, place.height * part.bbox.height * scale


def _give_two(axis: Axis, long_mm: float, size_mm: Callable[[str], float]) -> None:
    """Two numbers where there would be one, which tells no scale: the outermost that have room.

    `size_mm` of a number is along the axis, within which it stands: others may be beside it.
    """
    from matplotlib.ticker import FixedLocator, MaxNLocator

    low, high = sorted(axis.get_view_interval())
    scale = long_mm / (high - low)
    if len(_inside(axis.get_major_locator().tick_values(low, high), low, high)) > 1:
        return
    for most in range(2, 2 * _MOST_NUMBERS):  # the roundest first
        result = MaxNLocator(most, steps=_ROUND_STEPS, min_n_ticks=1).tick_values(low, high)
        values = _inside(result, low, high)
        halves = [0.5 * size_mm(text) for text in axis.get_major_formatter().format_ticks(values)]
        inner = [
            (value, half)
            for value, half in zip(values, halves, strict=True)
            if min(value - low, high - value) * scale > half - _OVER_MM
        ]
        if len(inner) < 2:
            continue
        (first, own), (last, other) = inner[0], inner[-1]
        if (last - first) * scale >= own + other + _BETWEEN_MM:
            axis.set_major_locator(FixedLocator([first, last]))
            return


def _inside(values: Iterable[float], low: float, high: float) -> list[float]:
    """Those of some numbers that an axis from `low` to `high` shows."""
    close = 1e-9 * (high - low)
    return [float(value) for value in values if low - close <= value <= high + close]


def _thin(axis: Axis, room: float) -> None:
    """As many numbers at an axis as there is room for."""
    from matplotlib.ticker import MaxNLocator

    least = 3 if room >= _FOR_THREE else 1
    most = max(1, min(int(room), _MOST_NUMBERS))
    axis.set_major_locator(MaxNLocator(most, steps=_ROUND_STEPS, min_n_ticks=least))


PAGE_MM = 230.0
"""Height that a journal's page leaves for a figure."""
_BESIDE_MM = 36.0
"""Narrowest picture whose kinds stand beside each other."""
_LEAST_MM, _LEAST_OF_COLUMN_MM = 40.0, 24.0
"""Narrowest picture of several items, in a wide figure and in one of a column."""
_COLUMN_MM = 120.0
"""Width below which a figure is one of a column."""
_PLOT_MM = 70.0
"""Narrowest plot, with its labels."""
_KEY_MM = 14.0
"""Room of a line in a legend, and between its columns."""
_AROUND_MM = 12.0
"""Room of a picture's title and numbers, to begin with."""
_SLACK_MM = 1.0
"""How far pictures, drawn again, may come out taller."""
_STEPS = 50
"""Heights of plots that are tried, from the full one to the lowest."""


@dataclass(frozen=True)
class FigureLayout:
    """How the panels stand, for a width."""

    panels: PaperPanels
    style: FigureStyle
    is_close: bool = False  # pictures stand beside each other at the narrowest
    lowered: float = 0.0  # how far the plots are, 0 to 1: to the least height of each
    left_out: tuple[Plot, ...] = ()  # no room on the page

    @cached_property
    def notes(self) -> str:
        """The notes, in lines of the figure's width; empty where they are not asked for."""
        if not (self.panels.notes and self.style.numbers):
            return ""
        return "\n".join(wrap_note(note, self.style.width_mm - 2.0) for note in self.panels.notes)

    @property
    def blocks(self) -> dict[str, float]:
        """The blocks of a figure, from the top, with their first heights in mm."""
        result: dict[str, float] = {}
        if self.panels.kinds:
            rows, cols = self.grid
            high = 0.75 * self.style.width_mm / cols
            result["pictures"] = rows * (high + _AROUND_MM) + _AROUND_MM
        if self.panels.plots:
            result["plots"] = sum(map(self.plot_height, self.plot_rows)) + self.legend_height
        if self.notes:
            result["notes"] = PAPER_LINE_MM * (self.notes.count("\n") + 1.5)
        return result

    @cached_property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the pictures: the kinds beside each other where they fit, else the
        items, of which all rows of a kind come together.
        """
        kinds, items = len(self.panels.kinds), len(self.panels.labels)
        width = self.style.width_mm
        if items == 1:
            least = _LEAST_OF_COLUMN_MM if self.is_close else _BESIDE_MM
            across = max(1, min(kinds, int(width / least)))
            return math.ceil(kinds / across), across
        if self._is_row_an_item:
            return items, kinds
        least = _LEAST_OF_COLUMN_MM if width < _COLUMN_MM else _LEAST_MM
        most = max(1, int(width / least))
        across = math.ceil(items / math.ceil(items / most))  # rows of one length, or nearly
        return kinds * math.ceil(items / across), across

    @property
    def _is_row_an_item(self) -> bool:
        """Whether kinds of several items stand beside each other, a row an item."""
        kinds = len(self.panels.kinds)
        return kinds > 2 and self.style.width_mm / kinds >= _BESIDE_MM

    @property
    def places(self) -> dict[tuple[int, int], tuple[int, int]]:
        """Row and column of each kind's picture of each item."""
        rows, cols = self.grid
        kinds, items = len(self.panels.kinds), len(self.panels.labels)
        pairs = [(j, k) for j in range(kinds) for k in range(items)]
        if items == 1:
            return {(j, k): (j // cols, j % cols) for j, k in pairs}
        if self._is_row_an_item:
            return {(j, k): (k, j) for j, k in pairs}
        own = rows // kinds
        return {(j, k): (j * own + k // cols, k % cols) for j, k in pairs}

    @cached_property
    def plot_rows(self) -> list[list[Plot]]:
        """Plots in rows, as many beside each other as fit."""
        plots = [plot for plot in self.panels.plots if plot not in self.left_out]
        most = max(1, min(int(self.style.width_mm / _PLOT_MM), self.panels.plots_across))
        down = math.ceil(len(plots) / most)
        across = math.ceil(len(plots) / down)
        return [plots[k : k + across] for k in range(0, len(plots), across)]

    def plot_height(self, row: Sequence[Plot]) -> float:
        """Height of a row of plots with their titles and labels, mm; lower in a column's figure."""
        share = 1.0 if self.style.width_mm >= _COLUMN_MM else 0.8
        heights = []
        for plot in row:
            full = share * plot.height_mm
            heights.append(full + self.lowered * (min(full, plot.least_mm) - full))
        return max(heights) + 4.0 * PAPER_LINE_MM

    @cached_property
    def legend_columns(self) -> int:
        """Columns of the legend below the plots."""
        names = self.panels.legend
        longest = max(map(width_mm, names)) + _KEY_MM
        return max(1, min(len(names), int(self.style.width_mm / longest)))

    @property
    def legend_height(self) -> float:
        """Height of the legend below the plots, mm; 0 where there is none."""
        if not self.panels.legend:
            return 0.0
        lines = math.ceil(len(self.panels.legend) / self.legend_columns)
        return (1.4 * lines + 0.6) * PAPER_LINE_MM

    def within_page(self, tall_mm: float) -> FigureLayout:
        """The layout that leaves out the fewest plots, and lowers them the least, to fit a page.

        `tall_mm` is the figure's height by this one, which stays where none is low enough.
        """
        if tall_mm <= PAGE_MM:
            return self
        room = PAGE_MM - _SLACK_MM - (tall_mm - self.blocks.get("plots", 0.0))
        spare = [p for p in sorted(self.panels.plots, key=lambda p: -p.spare) if p.spare]
        lower = (
            replace(self, left_out=tuple(spare[:count]), lowered=step / _STEPS)
            for count in range(len(spare) + 1)
            for step in range(_STEPS + 1)
        )
        return next((one for one in lower if one.blocks.get("plots", 0.0) <= room), self)
