"""Figures for a paper: one size of letters, panels lettered, and the data of each curve as CSV.

The figure is made as high as its pictures need at its width.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.figures.layout import PAGE_MM, FigureLayout, FigureStyle, FittedTexts, WithPanels
from isochrome.figures.style import BOLD_PT, INK, PAPER_PT, add_legend, ends_beyond, new_figure
from isochrome.output import replacing, write_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

Array = NDArray[Any]

_DATA_ONLY = "_data: "
"""In front of a name that no legend shows, as of all that begin with a line below."""


def data_name(words: str) -> str:
    """The label of a curve that has its name in the data alone, and in no legend."""
    return f"{_DATA_ONLY}{words}"


def curve_columns(axes: Axes) -> dict[str, Array]:
    """The data of the curves of a plot, as columns for a spreadsheet, NaN where one is shorter.

    x and y of each curve, the ends of its band or bar; several curves over one x have it once, and
    one that is drawn twice stands once.
    """
    columns: dict[str, Array] = {}
    last: Array | None = None
    across = " ".join(axes.get_xlabel().split()) or "x"
    drawn: list[list[Array]] = []
    for name, up, x, values in _all_curves(axes):
        own = [x, *values.values()]
        if any(len(own) == len(old) and all(map(_same, own, old)) for old in drawn):
            continue  # a line with a band, and its points with bars
        drawn.append(own)
        if last is None or not _same(last, x):
            place = across if x.dtype.kind == "f" else "input"
            place = f"{name}: {place}" if place in columns and name else place
            columns[_free(columns, place)] = last = x
        for ending, column in values.items():
            columns[_free(columns, ": ".join(filter(None, (name, f"{up}{ending}"))))] = column
    longest = max((len(column) for column in columns.values()), default=0)
    for name, column in columns.items():
        blank = np.nan if column.dtype.kind == "f" else ""
        columns[name] = np.concatenate([column, np.full(longest - len(column), blank)])
    return columns


def _all_curves(axes: Axes) -> Iterator[tuple[str, str, Array, dict[str, Array]]]:
    """Curves of Axes and of those over them with a second scale: name, quantity, x, values."""
    others = [one for one in axes.get_shared_x_axes().get_siblings(axes) if one is not axes]
    for own in (axes, *others):
        bars = any(x.dtype.kind != "f" for _, x, _ in _curves(own))
        label = own.get_xlabel() if bars else own.get_ylabel()
        for name, x, values in _curves(own):
            yield name, " ".join(label.split()) or "y", x, values


def _curves(axes: Axes) -> Iterator[tuple[str, Array, dict[str, Array]]]:
    """Name, x and values of each curve, band and set of bars."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb
    from matplotlib.container import BarContainer, ErrorbarContainer

    held = set[Any]()
    for bars in axes.containers:
        if isinstance(bars, ErrorbarContainer):
            held |= {bars.lines[0], *bars.lines[1]}
            yield from _error_bars(bars)
        elif isinstance(bars, BarContainer):
            yield from _bars(axes, bars)
    bands = {
        tuple(np.atleast_2d(band.get_facecolor())[0, :3].tolist()): _band(band)
        for band in axes.collections
        if isinstance(band, PolyCollection) and len(band.get_facecolor())
    }
    for line in axes.lines:
        x, y = _points(line)
        if line in held or line.get_transform() != axes.transData or not len(x):
            continue
        values = {"": y}
        band = bands.pop(to_rgb(line.get_color()), None)
        if band is not None and len(x) == len(y):
            for ending, k in ((" low", 0), (" high", 1)):
                values[ending] = np.array([band.get(at, (np.nan, np.nan))[k] for at in x.tolist()])
        yield _name(line), x, values


def _points(line: Any) -> tuple[Array, Array]:
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def _error_bars(bars: Any) -> Iterator[tuple[str, Array, dict[str, Array]]]:
    """Points with the ends of their bars; none where no frame is of this kind."""
    line, _, sticks = bars.lines
    x, y = _points(line)
    if len(x):
        ends = [np.asarray(stick)[:, 1] for stick in sticks[0].get_segments()] if sticks else []
        values = {"": y}
        if len(ends) == len(y):
            values |= {" low": np.array(ends)[:, 0], " high": np.array(ends)[:, 1]}
        yield _name(bars), x, values


def _bars(axes: Axes, bars: Any) -> Iterator[tuple[str, Array, dict[str, Array]]]:
    """Horizontal bars by the names at their axis."""
    names = [label.get_text().replace("\n", " ") for label in axes.get_yticklabels()]
    widths = np.array([patch.get_width() for patch in bars.patches], dtype=float)
    if len(names) == len(widths):
        yield "", np.array(names)[::-1], {"": widths[::-1]}


def _band(band: Any) -> dict[float, tuple[float, float]]:
    """Lower and upper end of a band at each of its x."""
    result: dict[float, tuple[float, float]] = {}
    for path in band.get_paths():
        for x, y in path.vertices.tolist():
            low, high = result.get(x, (y, y))
            result[x] = min(low, y), max(high, y)
    return result


def _name(artist: Any) -> str:
    """What a legend calls it, or would; empty where it has no name."""
    label = str(artist.get_label()).removeprefix(_DATA_ONLY)
    return "" if label.startswith("_") else " ".join(label.split())


def _same(one: Array, other: Array) -> bool:
    return one.shape == other.shape and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def _free(columns: dict[str, Array], name: str) -> str:
    """A name that no column has yet."""
    if name not in columns:
        return name
    return next(new for k in range(2, len(columns) + 3) if (new := f"{name} ({k})") not in columns)


_SHARE = 0.3
"""Longest bar, over the picture's width."""


def bar_length_mm(width_mm: float) -> float:
    """Length of a scale bar: 1, 2 or 5 times a power of ten, at most 0.3 of the picture's width."""
    decade = 10.0 ** math.floor(math.log10(_SHARE * width_mm))
    return decade * max(s for s in (1.0, 2.0, 5.0) if s * decade <= _SHARE * width_mm * 1.000001)


def bar_label(length_mm: float) -> str:
    """The words at a scale bar: its length in mm, or in µm below a tenth of that."""
    return f"{length_mm:g} mm" if length_mm >= 0.1 else f"{1000.0 * length_mm:g} µm"


def add_scale_bar(axes: Axes) -> None:
    """Draw a scale bar on a picture in mm, on a white ground that shows on any picture.

    A picture in pixels gets none.
    """
    from matplotlib.font_manager import FontProperties
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    if "(mm)" not in axes.get_xlabel():
        return
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    length = bar_length_mm(abs(right - left))
    bar = AnchoredSizeBar(
        axes.transData, length, bar_label(length), "lower right", pad=0.25, borderpad=0.3, sep=2.0,
        size_vertical=0.015 * abs(top - bottom), color=INK,
        fontproperties=FontProperties(size=PAPER_PT),
    )  # fmt: skip
    bar.patch.set(facecolor="white", edgecolor="none", linewidth=BOLD_PT)
    axes.add_artist(bar)


MM_PER_INCH = 25.4

_LARGEST_STEP = 0.4
"""Of the pictures' height, so that no slope of two heights that are alike throws it away."""
_BAR_MM = 1.6
"""Height of a colour bar."""
_MARK_PT = 10.0
"""Room of marks between a picture and its title."""
_ONE_PLACE = 0.01
"""Over the picture's size: pictures that are no further apart have their numbers once."""
_PLOT = "plot-"
"""In front of a plot's letter, in the name by which its Axes (and an SVG's group) are known."""
_PASSES, _CLOSE_MM = 6, 0.8
"""How often the height is mended by what the pictures leave, and how little that may be."""
_PLACES = 6
"""Decimals of places (over the figure) and heights (mm): the layout's last digits are those of
another order of its equations each time, and an SVG's names are made of them."""


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
    return figure_for_page(result, style or FigureStyle())[0]


def figure_for_page(result: WithPanels, style: FigureStyle) -> tuple[Figure, tuple[str, ...]]:
    """Draw `paper_figure`, and give the titles of the plots that have no room on the page.

    What is taller than a page is laid out closer; its letters stay as large. InputError where the
    result has no such picture or no such frame.
    """
    make = getattr(result, "panels", None)
    if make is None:
        raise InputError(
            "has_no_figure_paper", getattr=getattr(result, "title", type(result).__name__)
        )
    layout = FigureLayout(make(style.frames), style)
    figure = _drawn(layout)
    closer = replace(layout, is_close=True)
    if layout.panels.kinds and _tall_mm(figure) > PAGE_MM and closer.grid != layout.grid:
        layout, figure = closer, _drawn(closer)
    lower = layout.within_page(_tall_mm(figure))
    if lower != layout:
        layout, figure = lower, _drawn(lower)
    return figure, tuple(plot.title for plot in layout.left_out)


def _tall_mm(figure: Figure) -> float:
    return MM_PER_INCH * float(figure.get_figheight())


def _drawn(layout: FigureLayout) -> Figure:
    """The figure by a layout."""
    blocks = layout.blocks
    size = layout.style.width_mm / MM_PER_INCH, sum(blocks.values()) / MM_PER_INCH
    figure = new_figure(*size)
    engine: Any = figure.get_layout_engine()
    engine.set(w_pad=0.05, h_pad=0.02, wspace=0.0, hspace=0.0)
    grid = figure.add_gridspec(len(blocks), 1, height_ratios=list(blocks.values()))
    parts = {name: figure.add_subfigure(grid[k]) for k, name in enumerate(blocks)}
    letters = (f"({_letters(k)})" for k in count())
    pictures: list[list[Axes]] = []
    if "pictures" in parts:
        pictures = _draw_pictures(parts["pictures"], layout, letters)
    if "plots" in parts:
        _draw_plots(parts["plots"], layout, letters)
    if "notes" in parts:
        text = parts["notes"].text(0.01, 1.0, layout.notes, va="top")
        text.set_in_layout(False)
    _one_size(figure)
    _fit(figure, grid, blocks, pictures)
    return figure


def _fit(figure: Figure, grid: Any, blocks: dict[str, float], pictures: list[list[Axes]]) -> None:
    """Fit the texts to the panels, and the height to what the pictures need at their width.

    What is missing falls with the height, not by as much: letters at the sides give way where
    pictures do not fill their places. So a step is by the slope of the last two.
    """
    texts, last = FittedTexts(figure), None
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from font")
        for _ in range(_PASSES):
            texts.fit()
            figure.draw_without_rendering()
            missing = sum(_missing_mm(row) for row in pictures)
            if abs(missing) < _CLOSE_MM:
                break
            step = missing
            if last is not None and (missing - last[1]) * (blocks["pictures"] - last[0]) < 0.0:
                step *= (blocks["pictures"] - last[0]) / (last[1] - missing)
            last = blocks["pictures"], missing
            most = _LARGEST_STEP * blocks["pictures"]
            blocks["pictures"] = round(blocks["pictures"] + min(max(step, -most), most), _PLACES)
            grid.set_height_ratios(list(blocks.values()))
            figure.set_figheight(sum(blocks.values()) / MM_PER_INCH)
        texts.wrap()
        figure.draw_without_rendering()  # the layout settles in the second drawing
    figure.set_layout_engine("none")  # what is saved is what was fitted, at any resolution
    _align(pictures)
    _settle(figure)


def _letters(k: int) -> str:
    """Letters of a panel: a to z, aa to zz."""
    more, last = divmod(k, len(ascii_lowercase))
    return (ascii_lowercase[more - 1] if more else "") + ascii_lowercase[last]


def _draw_pictures(part: SubFigure, layout: FigureLayout, letters: Any) -> list[list[Axes]]:
    """Draw the grid of pictures, and give its rows."""
    panels = layout.panels
    kinds, items = len(panels.kinds), len(panels.labels)
    rows, cols = layout.grid
    axes: Any = part.subplots(rows, cols, squeeze=False)
    used: set[int] = set()
    drawn: dict[int, list[Any]] = {}
    places = layout.places
    for (j, k), (row, col) in sorted(places.items(), key=lambda item: item[1]):
        own, kind = axes[row, col], panels.kinds[j]
        drawn.setdefault(j, []).append(kind.draw(own, k))
        words = (kind.name if kinds > 1 else "", panels.labels[k])
        marked = any(not line.get_clip_on() for line in own.lines)  # above the picture too
        title = f"{next(letters)} {', '.join(filter(None, words))}"
        own.set_title(title, loc="left", pad=_MARK_PT if marked else None)
        own.set_anchor("N")
        used.add(row * cols + col)
    add_scale_bar(axes[0, 0])
    for number, own in enumerate(axes.flat):
        own.set_visible(number in used)
    _outer_labels(axes, used)
    for j, images in drawn.items():
        if panels.kinds[j].bar:
            own_places = [places[j, k] for k in range(items)]
            last = max(own_places)[0]
            below = [axes[place] for place in own_places if place[0] == last]
            _add_bar(part, images, panels.kinds[j].bar, below, layout.style.width_mm / cols)
    return [[own for own in row if own.get_visible()] for row in axes]


def _add_bar(
    part: SubFigure, images: list[Any], label: str, last: list[Axes], column_mm: float
) -> None:
    """One colour bar for the pictures of a kind, below the last row of them and as wide."""
    bar = part.colorbar(
        images[0],
        ax=last,
        location="bottom",
        extend=ends_beyond(images),
        extendfrac=0.04,
        pad=0.02,
        fraction=0.12,  # of the pictures' height, of which the bar takes what its shape needs
        aspect=0.8 * column_mm * len(last) / _BAR_MM,
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


def _draw_plots(part: SubFigure, layout: FigureLayout, letters: Any) -> None:
    rows = layout.plot_rows
    heights = [layout.plot_height(row) for row in rows]
    foot = [layout.legend_height] if layout.panels.legend else []
    grid = part.add_gridspec(len(rows) + len(foot), 1, height_ratios=[*heights, *foot])
    first: Axes | None = None
    for k, row in enumerate(rows):
        own = grid[k].subgridspec(1, max(map(len, rows)))
        for column, plot in enumerate(row):
            axis = part.add_subfigure(own[column]).subplots()
            first = first or axis
            plot.draw(axis)
            letter = next(letters)
            axis.set_title(f"{letter} {plot.title}", loc="left")
            axis.set_gid(f"{_PLOT}{letter.strip('()')}")
    if first is not None and foot:
        handles, labels = first.get_legend_handles_labels()
        holder = part.add_subfigure(grid[len(rows)])
        cols = layout.legend_columns
        add_legend(holder, handles, labels, loc="upper center", ncols=cols)


def _one_size(figure: Figure) -> None:
    """Give every letter of a figure the size of the paper's."""
    from matplotlib.text import Text

    for axes in figure.findobj(lambda artist: hasattr(artist, "tick_params")):
        axes.tick_params(labelsize=PAPER_PT, length=2.0, width=0.6)  # type: ignore[attr-defined]
    for text in figure.findobj(Text):
        text.set(fontsize=PAPER_PT)


def _missing_mm(row: Sequence[Axes]) -> float:
    """What the pictures of a row lack in height, or have too much, to be as wide as their place."""
    needed = []
    for own in row:
        place, shown = own.get_position(original=True), own.get_position()
        part: Any = own.figure
        wide, high = part.bbox.width, part.bbox.height  # of the part, in dots
        aspect = (shown.height * high) / (shown.width * wide)
        dots = place.width * wide * aspect - place.height * high
        needed.append(dots / part.figure.dpi * MM_PER_INCH)
    return max(needed, default=0.0)


def _align(rows: Sequence[Sequence[Axes]]) -> None:
    """Give the pictures of a row one upper edge: a colour bar below moves one and its place."""
    for row in rows:
        places = [own.get_position(original=True) for own in row]
        top = max((place.y1 for place in places), default=0.0)
        for own, place in zip(row, places, strict=True):
            own.set_position((place.x0, top - place.height, place.width, place.height))
            own.set_anchor("N")  # Matplotlib stands a picture with a bar on its place's lower edge


def _settle(figure: Figure) -> None:
    """Round all places, so that the same figure is the same file each time."""
    for part in figure.subfigs:
        part.bbox_relative.set_points(np.round(part.bbox_relative.get_points(), _PLACES))
    for axes in figure.axes:
        place = axes.get_position(original=True)
        axes.set_position(np.round(place.bounds, _PLACES).tolist())


_EMBEDDED: Any = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "isochrome"}
"""Fonts as TrueType, which journals take, and text as text; the same file again."""

_UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


def save_figure(
    result: WithPanels, path: str | Path, style: FigureStyle | None = None
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
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> style = isochrome.FigureStyle(width_mm=85, formats=("svg",))
    >>> files = isochrome.save_figure(isochrome.simulate(scene), "ring", style)
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
        say = f"the figure is {tall:.0f} mm tall; choose fewer --frames"
        warnings.warn(say, UserWarning, stacklevel=2)
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
    """A figure as the bytes of a file."""
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
