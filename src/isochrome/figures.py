"""What every picture of the program shares: size, fonts, colour maps, millimetre axes.

Matplotlib's object interface on the Agg canvas only: no pyplot, no global state, so that a
figure made in a thread or in a notebook disturbs nobody. Matplotlib is imported inside the
functions because most commands draw nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from isochrome.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

FRAME_MAP = "gray"
VALUE_MAP = "viridis"
STRESS_MAP = "magma"
DIFFERENCE_MAP = "RdBu_r"

UNKNOWN_COLOUR = "#dcdcdc"
"""Light grey, hatched, where an image holds NaN (not known)."""

LINE_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""Okabe and Ito's colours, told apart by colour-blind readers too."""

TEXT_PT, TITLE_PT, TICK_PT = 9.5, 10.5, 8.5
LONGEST_NAME = 48
"""Letters of a file's name in a title."""
_HATCH_COLOUR = "#c4c4c4"


def new_figure(width_in: float, height_in: float) -> Figure:
    """Make an empty white figure of `width_in` by `height_in` inches with constrained layout.

    Returns a Figure on an Agg canvas; save it with `isochrome.output.write_figure`. Raises
    InputError for a size that is not above zero.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not (width_in > 0 and height_in > 0):
        raise InputError(f"a figure of {width_in} x {height_in} inches: give a size above zero")
    figure = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def style_axes(axes: Axes, *, x_label: str = "", z_label: str = "", title: str = "") -> None:
    """Give one pair of axes the program's fonts, ticks and labels.

    `x_label` and `z_label` name the horizontal and vertical quantity with the unit in brackets;
    an empty text leaves the label that is there. Works for plots as well as for images.
    """
    axes.tick_params(labelsize=TICK_PT, length=3, width=0.7)
    axes.set_xlabel(x_label or axes.get_xlabel(), fontsize=TEXT_PT)
    axes.set_ylabel(z_label or axes.get_ylabel(), fontsize=TEXT_PT)
    if title:
        axes.set_title(title, fontsize=TITLE_PT, loc="left")
    for spine in axes.spines.values():
        spine.set_linewidth(0.7)


def plain_name(name: str, longest: int = LONGEST_NAME) -> str:
    """A file's name as a title may hold it: in one line, not too long, and no formula.

    Parameters: `name`; `longest`, letters that there is room for. Returns it, too long without its
    middle.
    """
    line, half = " ".join(name.splitlines()), (longest - 1) // 2
    short = line if len(line) <= longest else f"{line[:half]}…{line[-half:]}"
    return short.replace("$", r"\$")


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
    """Draw an image at true proportions: x to the right, z down, in mm or in pixels.

    `image` (row, col), or (row, col, 3) in colour, 0 or `vmin` black and 1 or `vmax` full light;
    NaN is left out and the hatched light grey behind shows. `pixel_mm` is the edge of a square
    pixel, `left_mm` and `top_mm` the outer edges of the first column and row;
    without `pixel_mm` the axes count pixels. `vmin`, `vmax` bound the colours (default: the
    finite range), `colour_label` (with its unit) adds a colour bar. Returns the drawn image.
    Raises InputError when the image is neither.
    """
    values = np.asarray(image)
    if values.dtype != np.float32:  # as maps are, of which a picture shows many
        values = values.astype(float)
    if values.ndim != 2 and values.shape[2:] != (3,):
        raise InputError(
            f"an image of shape {values.shape} to draw: give one 2-D image, or one in colour"
        )
    rows, cols = values.shape[:2]
    pixels = values if values.ndim == 2 else _opaque(values, vmin, vmax)
    drawn = axes.imshow(
        pixels,
        cmap=cmap,
        vmin=vmin,
        vmax=vmax,
        extent=image_extent(rows, cols, pixel_mm=pixel_mm, left_mm=left_mm, top_mm=top_mm),
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


def _opaque(colour: np.ndarray, vmin: float | None, vmax: float | None) -> np.ndarray:
    """Colour as light in 0..1 with an opacity (row, col, 4): pixels that hold NaN let through."""
    low, high = vmin or 0.0, 1.0 if vmax is None else vmax
    known = np.isfinite(colour).all(axis=2, keepdims=True)
    light = np.clip((np.where(known, colour, low) - low) / (high - low), 0.0, 1.0)
    return np.concatenate([light, known], axis=2)


def image_extent(
    rows: int,
    cols: int,
    *,
    pixel_mm: float | None = None,
    left_mm: float = 0.0,
    top_mm: float = 0.0,
) -> tuple[float, float, float, float]:
    """Outer edges (left, right, bottom, top) of an image in mm; in pixels without `pixel_mm`.

    In pixels the centre of the first pixel is (0, 0), so that its edges are at -0.5.
    """
    if pixel_mm is None:
        return -0.5, cols - 0.5, rows - 0.5, -0.5
    return left_mm, left_mm + cols * pixel_mm, top_mm + rows * pixel_mm, top_mm


def add_colour_bar(
    drawn: AxesImage,
    label: str,
    *,
    axes: list[Axes] | None = None,
    extend: str | None = None,
    length: float = 1.0,
) -> Colorbar:
    """Add a colour bar with its `label` (quantity and unit) beside the image's axes.

    `axes`: several axes that share the bar (default: the image's own). `extend`: "min", "max" or
    "both" where values lie beyond the colours (default: looked up in the image). `length`: share
    of the axes' common height. Returns the bar.
    """
    figure = drawn.axes.figure
    if extend is None:
        data: np.ma.MaskedArray = np.ma.asarray(drawn.get_array())
        low, high = drawn.get_clim()
        below = bool(data.count()) and float(data.min()) < low
        above = bool(data.count()) and float(data.max()) > high
        extend = ("both" if above else "min") if below else ("max" if above else "neither")
    beside = axes or [drawn.axes]
    slim = 18.0 * max(1.0, length * len(beside))
    bar = figure.colorbar(
        drawn, ax=beside, extend=extend, pad=0.02, aspect=slim, shrink=length, extendfrac=0.03
    )
    bar.set_label(label, fontsize=TEXT_PT)
    bar.ax.tick_params(labelsize=TICK_PT, length=3, width=0.7)
    return bar


def centred_limit(*differences: ArrayLike, percentile: float = 99.0) -> float:
    """Find a symmetric colour limit for difference images: a round number, never zero.

    The `percentile` of |difference| over all finite pixels of all images, rounded up to 1, 1.5,
    2, 3, 5 or 7 times a power of ten; 1.0 when nothing is finite or everything is zero.
    """
    parts = [np.abs(np.asarray(each, dtype=float)).ravel() for each in differences]
    values = np.concatenate([part[np.isfinite(part)] for part in parts] or [np.zeros(0)])
    largest = float(np.percentile(values, percentile)) if values.size else 0.0
    if largest <= 0.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(largest))
    steps = np.array([1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0]) * decade
    return float(steps[np.searchsorted(steps, largest * (1.0 - 1e-9))])
