"""What every picture of the program shares: size, fonts, colour maps, millimetre axes.

No pyplot and no global state, so that a figure made in a thread or a notebook disturbs nobody.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from isochrome.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.image import AxesImage

FRAME_MAP = "gray"
VALUE_MAP = "viridis"
DIFFERENCE_MAP = "RdBu_r"
PAPER_DIRECTION_MAP = "twilight"
"""Of a direction, the same at -90 and at 90 degrees, for colour-blind readers and in grey."""

UNKNOWN_COLOUR = "#dcdcdc"
"""Light grey, hatched, where an image holds NaN (not known)."""

LINE_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""Okabe and Ito's colours, told apart by colour-blind readers too."""

CHANNEL_COLOURS = ("#c4312a", "#2a8f3c", "#2f5fc4")
"""Red, green and blue, dark enough for lines on white."""

LINE_STYLES = ("-", "-.", ":")
"""Of lines whose colours say what they are of, where a reader may not tell these apart."""

OVERLAY_COLOUR = "#ff9d2e"
"""Of a line over a grey picture."""

INK, GREY, PALE = "black", "0.35", "0.65"
"""Of what has no colour: what is compared with, what stands beside, what lies behind."""

PAPER_PT, PAPER_LINE_MM = 8.0, 3.4
"""Size of all letters of a figure for a paper, and the height of a line of them."""

FINE_PT, LINE_PT, BOLD_PT = 0.6, 1.0, 1.4
"""Widths of a line that guides the eye, that shows values, and that stands out."""

LONGEST_NAME, SHORT_NAME = 48, 24
"""Letters of a file's name in a title, and beside others."""
_HATCH_COLOUR = "#c4c4c4"


class Place(TypedDict):
    """Where an image lies: keywords of `show_image`."""

    pixel_mm: float | None  # None: not known
    left_mm: float  # outer edge of the first column
    top_mm: float  # outer edge of the first row


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty white figure with constrained layout, on an Agg canvas, for `write_figure`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not (width_in > 0 and height_in > 0):
        raise InputError("figure_inches_give_size", width_in=width_in, height_in=height_in)
    figure = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def style_axes(axes: Axes, *, x_label: str = "", z_label: str = "", title: str = "") -> None:
    """Give axes their labels, a quantity with its unit in brackets, and title; empty ones stay."""
    axes.set_xlabel(x_label or axes.get_xlabel())
    axes.set_ylabel(z_label or axes.get_ylabel())
    if title:
        axes.set_title(title, loc="left")


def write_head(figure: Figure | SubFigure, text: str, **where: Any) -> None:
    """Write what a figure, or a part that has a head of its own, shows above it."""
    figure.suptitle(text, **where)


def add_legend(holder: Axes | Figure | SubFigure, *entries: Any, **where: Any) -> None:
    """Add a legend without a frame; entries and keywords as `Axes.legend` takes them."""
    holder.legend(*entries, frameon=False, **where)


def plain_name(name: str, longest: int = LONGEST_NAME) -> str:
    """A file's name as a title may hold it: in one line, no formula, if long without its middle."""
    line, half = " ".join(name.splitlines()), (longest - 1) // 2
    return (line if len(line) <= longest else f"{line[:half]}…{line[-half:]}").replace("$", r"\$")


def show_image(
    axes: Axes,
    image: ArrayLike,
    *,
    pixel_mm: float | None = None,
    left_mm: float = 0.0,
    top_mm: float = 0.0,
    cmap: str = VALUE_MAP,
    vmin: float | None = None,
    vmax: float | None = None,
    title: str = "",
    colour_label: str = "",
) -> AxesImage:
    """Draw (row, col) values or (row, col, 3) colours at true proportions: x to the right, z down,
    in mm, or px without a scale. NaN is left out, and the hatched light grey behind shows."""
    values = np.asarray(image)
    if values.dtype != np.float32:  # as maps are, of which a picture shows many
        values = values.astype(float)
    if values.ndim != 2 and values.shape[2:] != (3,):
        raise InputError("image_shape_draw_give", shape=values.shape)
    rows, cols = values.shape[:2]
    shown = values
    if values.ndim == 3:  # light in 0..1 with an opacity: pixels that hold NaN let through
        low, high = vmin or 0.0, 1.0 if vmax is None else vmax
        known = np.isfinite(values).all(axis=2, keepdims=True)
        light = np.clip((np.where(known, values, low) - low) / (high - low), 0.0, 1.0)
        shown = np.concatenate([light, known], axis=2)
    left, top, pixel = (-0.5, -0.5, 1.0) if pixel_mm is None else (left_mm, top_mm, pixel_mm)
    drawn = axes.imshow(
        shown,
        cmap=cmap,
        vmin=vmin,
        vmax=vmax,
        extent=(left, left + cols * pixel, top + rows * pixel, top),
        origin="upper",
        aspect="equal",
        interpolation_stage="data",  # made smaller as numbers, not as colours, which take ten times
    )
    axes.patch.set(facecolor=UNKNOWN_COLOUR, edgecolor=_HATCH_COLOUR, hatch="////", linewidth=0)
    unit = ("column (px)", "row (px)") if pixel_mm is None else ("x (mm)", "z (mm)")
    style_axes(axes, x_label=unit[0], z_label=unit[1], title=title)
    if colour_label:
        add_colour_bar(drawn, colour_label)
    return drawn


def draw_line(axes: Axes, rows: np.ndarray, cols: np.ndarray, place: Place, **look: Any) -> None:
    """Draw a line of points in px over an image that `show_image` has drawn at the same place."""
    x, z, pixel = cols, rows, place["pixel_mm"]
    if pixel:
        x, z = place["left_mm"] + pixel * (x + 0.5), place["top_mm"] + pixel * (z + 0.5)
    axes.plot(x, z, **look)


def ends_beyond(images: list[AxesImage]) -> str:
    """Which ends of the images' common colours values of any of them lie beyond."""
    low, high = images[0].get_clim()
    shown: list[np.ndarray] = [np.ma.asarray(image.get_array()).compressed() for image in images]
    below = any(values.size and float(values.min()) < low for values in shown)
    above = any(values.size and float(values.max()) > high for values in shown)
    ends = {(True, True): "both", (True, False): "min", (False, True): "max"}
    return ends.get((below, above), "neither")


def add_colour_bar(drawn: AxesImage, label: str) -> Colorbar:
    """Add a colour bar beside an image, its ends pointed where values lie beyond the colours."""
    bar = drawn.axes.figure.colorbar(
        drawn, ax=drawn.axes, extend=ends_beyond([drawn]), extendfrac=0.03, pad=0.02, aspect=18.0
    )
    bar.set_label(label)
    return bar


def centred_limit(*differences: ArrayLike, percentile: float = 99.0) -> float:
    """A symmetric limit over 99 % of differences: 1, 1.5, 2, 3, 5 or 7 times a power of ten."""
    parts = [np.abs(np.asarray(each, dtype=float)).ravel() for each in differences]
    values = np.concatenate([part[np.isfinite(part)] for part in parts] or [np.zeros(0)])
    largest = float(np.percentile(values, percentile)) if values.size else 0.0
    if largest <= 0.0:
        return 1.0
    steps = np.array([1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0]) * 10.0 ** np.floor(np.log10(largest))
    return float(steps[np.searchsorted(steps, largest * (1.0 - 1e-9))])
