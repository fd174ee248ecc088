"""Figures for a paper: laid out for their width, one size of letters, panels lettered.

Pictures stand in a grid, plots flow in rows below it. The figure is made as high as they need.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import count
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.errors import InputError
from isochrome.figures.fitted_text import fit_texts, wrap_note
from isochrome.figures.panels import FigureStyle, PaperPanels, Plot, WithPanels
from isochrome.figures.scale_bar import add_scale_bar
from isochrome.figures.style import PAPER_LINE_MM, PAPER_PT, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

MM_PER_INCH = 25.4

_BESIDE_MM = 40.0
"""Narrowest picture whose kinds stand beside each other."""
_LEAST_MM, _LEAST_OF_COLUMN_MM = 40.0, 24.0
"""Narrowest picture of several items, in a wide figure and in one of a column."""
_COLUMN_MM = 120.0
"""Width below which a figure is one of a column."""
_PLOT_MM = 56.0
"""Narrowest plot, with its labels."""
_ONE_PLACE = 0.01
"""Over the picture's size: pictures that are no further apart have their numbers once."""
_PLOT = "plot-"
"""In front of a plot's letter, in the name by which its Axes (and an SVG's group) are known."""
_PASSES = 3
"""How often the height is mended by what the pictures leave; the second time leaves little."""


def paper_figure(result: WithPanels, style: FigureStyle | None = None) -> Figure:
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
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> figure = isochrome.paper_figure(
    ...     isochrome.simulate(scene), isochrome.FigureStyle(width_mm=85))
    >>> round(25.4 * figure.get_figwidth())
    85
    """
    style = style or FigureStyle()
    make = getattr(result, "panels", None)
    if make is None:
        raise InputError(
            f"{getattr(result, 'title', type(result).__name__)}: has no figure for a paper; its "
            "figure() is a matplotlib Figure, and its table has the numbers"
        )
    panels: PaperPanels = make(style.frames)
    blocks = _blocks(panels, style)
    figure = new_figure(style.width_mm / MM_PER_INCH, sum(blocks.values()) / MM_PER_INCH)
    engine: Any = figure.get_layout_engine()
    engine.set(w_pad=0.02, h_pad=0.02, wspace=0.0, hspace=0.0)
    grid = figure.add_gridspec(len(blocks), 1, height_ratios=list(blocks.values()))
    parts = {name: figure.add_subfigure(grid[k]) for k, name in enumerate(blocks)}
    letters = (f"({_letters(k)})" for k in count())
    pictures: list[list[Axes]] = []
    if "pictures" in parts:
        pictures = _draw_pictures(parts["pictures"], panels, style, letters)
    if "plots" in parts:
        _draw_plots(parts["plots"], panels, style, letters)
    if "notes" in parts:
        text = parts["notes"].text(0.01, 1.0, _notes(panels, style), va="top")
        text.set_in_layout(False)
    _one_size(figure)
    for _ in range(_PASSES):
        fit_texts(figure)
        figure.draw_without_rendering()
        missing = sum(_missing_mm(row, style) for row in pictures)
        if abs(missing) < 0.3:
            break
        blocks["pictures"] += missing
        grid.set_height_ratios(list(blocks.values()))
        figure.set_figheight(sum(blocks.values()) / MM_PER_INCH)
    return figure


def _letters(k: int) -> str:
    """Letters of a panel: a to z, aa to zz."""
    more, last = divmod(k, len(ascii_lowercase))
    return (ascii_lowercase[more - 1] if more else "") + ascii_lowercase[last]


def _notes(panels: PaperPanels, style: FigureStyle) -> str:
    return "\n".join(wrap_note(note, style.width_mm - 2.0) for note in panels.notes)


def _blocks(panels: PaperPanels, style: FigureStyle) -> dict[str, float]:
    """The blocks of a figure, from the top, with their first heights in mm."""
    found: dict[str, float] = {}
    if panels.kinds:
        rows, cols = grid_of_pictures(len(panels.kinds), len(panels.labels), style.width_mm)
        found["pictures"] = rows * (0.75 * style.width_mm / cols)
    if panels.plots:
        rows_of_plots = _plot_rows(panels, style)
        around = 4.5 * PAPER_LINE_MM
        found["plots"] = sum(max(p.height_mm for p in row) + around for row in rows_of_plots)
        found["plots"] += 2.0 * PAPER_LINE_MM if panels.legend else 0.0
    if panels.notes and style.numbers:
        found["notes"] = PAPER_LINE_MM * (_notes(panels, style).count("\n") + 1.5)
    return found


def grid_of_pictures(kinds: int, items: int, width_mm: float) -> tuple[int, int]:
    """Say how pictures stand: the kinds beside each other where they fit, else the items.

    Parameters
    ----------
    kinds : int
        Kinds of pictures.
    items : int
        Pictures of each.
    width_mm : float
        Width of the figure, mm.

    Returns
    -------
    tuple of two ints
        Rows and columns; of the items beside each other, all rows of a kind come together.
    """
    if _beside(kinds, items, width_mm):
        return items, kinds
    least = _LEAST_OF_COLUMN_MM if width_mm < _COLUMN_MM else _LEAST_MM
    most = max(1, int(width_mm / least))
    across = math.ceil(items / math.ceil(items / most))  # rows of one length, or nearly
    return kinds * math.ceil(items / across), across


def _beside(kinds: int, items: int, width_mm: float) -> bool:
    fits = width_mm / kinds >= _BESIDE_MM
    return fits and kinds > 1 and (kinds > 2 or items == 1)


def _draw_pictures(
    part: SubFigure, panels: PaperPanels, style: FigureStyle, letters: Any
) -> list[list[Axes]]:
    """Draw the grid of pictures. Returns its rows."""
    kinds, items = len(panels.kinds), len(panels.labels)
    rows, cols = grid_of_pictures(kinds, items, style.width_mm)
    beside = _beside(kinds, items, style.width_mm)
    axes: Any = part.subplots(rows, cols, squeeze=False)
    rows_of_kind = rows // kinds
    used: set[int] = set()
    drawn: dict[int, list[Any]] = {}
    places = {}
    for j in range(kinds):
        for k in range(items):
            places[j, k] = (k, j) if beside else (j * rows_of_kind + k // cols, k % cols)
    for (j, k), (row, col) in sorted(places.items(), key=lambda item: item[1]):
        own, kind = axes[row, col], panels.kinds[j]
        drawn.setdefault(j, []).append(kind.draw(own, k))
        words = (
            kind.name if kinds > 1 else "",
            panels.labels[k],
        )  # of one kind, its name says nothing
        own.set_title(f"{next(letters)} {', '.join(filter(None, words))}", loc="left")
        own.set_anchor("N")
        used.add(row * cols + col)
    add_scale_bar(axes[0, 0])
    for number, own in enumerate(axes.flat):
        own.set_visible(number in used)
    _outer_labels(axes, used)
    for j, images in drawn.items():
        if panels.kinds[j].bar:
            _add_bar(part, images, panels.kinds[j].bar, below=beside)
    return [[own for own in row if own.get_visible()] for row in axes]


def _add_bar(part: SubFigure, images: list[Any], label: str, *, below: bool) -> None:
    """One colour bar for the pictures of a kind: below their column, or beside their rows."""
    low, high = images[0].get_clim()
    shown = [np.ma.asarray(image.get_array()).compressed() for image in images]
    under = any(values.size and float(values.min()) < low for values in shown)
    over = any(values.size and float(values.max()) > high for values in shown)
    ends = {(True, True): "both", (True, False): "min", (False, True): "max"}
    bar = part.colorbar(
        images[0],
        ax=[image.axes for image in images],
        location="bottom" if below else "right",
        extend=ends.get((under, over), "neither"),
        extendfrac=0.04,
        pad=0.02,
        fraction=0.06,
        aspect=24.0,
    )
    bar.set_label(label)
    bar.ax.tick_params(length=2.0, width=0.6)


def _outer_labels(axes: Any, used: set[int]) -> None:
    """Numbers and labels at the outer axes alone, where all pictures show one place."""
    cols = axes.shape[1]
    shown = [axes.flat[number] for number in sorted(used)]
    limits = np.array([[*own.get_xlim(), *own.get_ylim()] for own in shown])
    one_place = bool(np.all(np.ptp(limits, axis=0) <= _ONE_PLACE * np.ptp(limits)))
    for number in used:
        row, col = divmod(number, cols)
        own = axes[row, col]
        below = number + cols in used
        if one_place and col:
            own.tick_params(labelleft=False)
        if one_place and below:
            own.tick_params(labelbottom=False)
        own.set_ylabel("" if col else own.get_ylabel())
        own.set_xlabel("" if below else own.get_xlabel())


def _plot_rows(panels: PaperPanels, style: FigureStyle) -> list[list[Plot]]:
    """Plots in rows, as many beside each other as fit."""
    plots = panels.plots
    most = max(1, min(int(style.width_mm / _PLOT_MM), panels.plots_across))
    down = math.ceil(len(plots) / most)
    across = math.ceil(len(plots) / down)
    return [list(plots[k : k + across]) for k in range(0, len(plots), across)]


def _draw_plots(part: SubFigure, panels: PaperPanels, style: FigureStyle, letters: Any) -> None:
    rows = _plot_rows(panels, style)
    across = max(map(len, rows))
    heights = [max(plot.height_mm for plot in row) for row in rows]
    axes: Any = part.subplots(len(rows), across, squeeze=False, height_ratios=heights)
    for own, row in zip(axes, rows, strict=True):
        for axis in own[len(row) :]:
            axis.set_axis_off()
        for axis, plot in zip(own, row, strict=False):
            plot.draw(axis)
            letter = next(letters)
            axis.set_title(f"{letter} {plot.title}", loc="left")
            axis.set_gid(f"{_PLOT}{letter.strip('()')}")
    if panels.legend:
        handles, labels = axes[0, 0].get_legend_handles_labels()
        longest = max((len(label) for label in labels), default=1)
        cols = max(1, min(len(labels), int(style.width_mm / (8.0 + 1.6 * longest))))
        part.legend(handles, labels, loc="outside lower center", ncols=cols, frameon=False)


def panel_of_plot(axes: Axes) -> str:
    """Give the letter of a plot of a figure for a paper.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Axes of such a figure.

    Returns
    -------
    str
        Its letter; empty for a picture, a colour bar or a second scale.
    """
    name = axes.get_gid() or ""
    return name.removeprefix(_PLOT) if name.startswith(_PLOT) else ""


def _one_size(figure: Figure) -> None:
    """Give every letter of a figure the size of the paper's."""
    from matplotlib.text import Text

    for axes in figure.findobj(lambda artist: hasattr(artist, "tick_params")):
        axes.tick_params(labelsize=PAPER_PT, length=2.0, width=0.6)  # type: ignore[attr-defined]
    for text in figure.findobj(Text):
        text.set_fontsize(PAPER_PT)  # type: ignore[attr-defined]


def _missing_mm(row: Sequence[Axes], style: FigureStyle) -> float:
    """What the pictures of a row lack in height, or have too much, to be as wide as their place."""
    needed = []
    for own in row:
        place, shown = own.get_position(original=True), own.get_position()
        figure: Any = own.figure
        width, height = figure.bbox.width, figure.bbox.height
        per_mm = own.figure.figure.dpi / MM_PER_INCH  # type: ignore[union-attr]
        aspect = (shown.height * height) / (shown.width * width)
        needed.append((place.width * width * aspect - place.height * height) / per_mm)
    return max(needed, default=0.0)
