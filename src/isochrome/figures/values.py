"""Values over frames or distance, each with its band: one picture for all that find them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.figures.curve_data import data_name
from isochrome.figures.layout import wrap_note
from isochrome.figures.panels import Plot
from isochrome.figures.style import (
    GREY,
    INK,
    LINE_COLOURS,
    LINE_PT,
    NOTE_PT,
    PAPER_PT,
    TEXT_PT,
    new_figure,
    plain_name,
    style_axes,
    write_head,
)
from isochrome.output import FrameValues

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

Array = NDArray[Any]

BAND = 2.0
"""Half-width of a band, in standard uncertainties."""

_SMALL = 1e-3
"""Contributions to an uncertainty below which they are drawn in a power of ten."""

KEY_LABELS = {
    "friction.coefficient": "friction coefficient",
    "load.normal_n": "normal load (N)",
    "camera.left_mm": "left edge of the picture (mm)",
    "camera.top_mm": "top edge of the picture (mm)",
    "wear.coefficient_mm2_per_n": "wear coefficient (mm²/N)",
}
"""What stands at the axis of a key."""

PANEL_IN = 2.1
"""Height of one quantity's panel in inches."""

_LABEL_MM = 25.4 * 0.7 * PANEL_IN * PAPER_PT / TEXT_PT
"""Longest line of a label at the side, in letters of a paper's size: it keeps to its panel."""

_POINTS = 1600
"""Frames that are drawn: twice as many as a panel has pixels across."""
_FEW = 40
"""Frames whose points have room beside each other."""


def frame_axis(found: FrameValues) -> tuple[Array, str]:
    """Where frames stand on an axis, and its label: at their distances (m) where they have several.

    NaN for a frame that stands still among those that slide; else numbers.
    """
    known = found.distance_m[np.isfinite(found.distance_m)]
    if known.size and np.ptp(known) > 0.0:
        return found.distance_m, "sliding distance (m)"
    return np.arange(len(found.chi), dtype=float), "frame"


def draw_band(
    axis: Axes, x: Array, values: Array, spread: Array, *, colour: Any = LINE_COLOURS[0],
    **line: Any,
) -> None:  # fmt: skip
    """Draw values with a band of two standard uncertainties to either side, where it is finite."""
    band = BAND * np.where(np.isfinite(spread), spread, np.nan)
    axis.fill_between(x, values - band, values + band, color=colour, alpha=0.3, lw=0)
    axis.plot(x, values, color=colour, **line)


def draw_values(axis: Axes, found: FrameValues, key: str) -> None:
    """Draw a key over the frames, or the distance, with its band.

    Frames that stand still are squares at the distance 0, key frames dots, and frames found by a
    full search circles.
    """
    j = found.keys.index(key)
    values, spread = found.values[:, j], found.standard_uncertainty[:, j]
    place, across = frame_axis(found)
    still = ~np.isfinite(place) & np.isfinite(values)
    order = np.argsort(place, kind="stable")[: int(np.isfinite(place).sum())]
    order = order[:: -(-len(order) // _POINTS)] if len(order) else order
    # a line goes on over frames without the key, and breaks where a video's frame tells nothing
    drawn = order[np.isfinite(values[order])] if len(order) <= _FEW else order
    draw_band(axis, place[drawn], values[drawn], spread[drawn], lw=LINE_PT)
    if len(order) <= _FEW:
        open_square: dict[str, Any] = {"fmt": "s", "mfc": "white", "label": data_name("static")}
        for frames, look in ((drawn, {"fmt": "o"}), (np.flatnonzero(still), open_square)):
            x = np.where(np.isfinite(place[frames]), place[frames], 0.0)
            bars = BAND * np.where(np.isfinite(spread[frames]), spread[frames], np.nan)
            look |= {"color": LINE_COLOURS[0], "ms": 4, "capsize": 2.5, "lw": LINE_PT}
            axis.errorbar(x, values[frames], yerr=bars, **look)
    _mark(axis, found, place, values)
    followed = spread[~found.whole] if not found.whole.all() else spread
    known = followed[np.isfinite(followed)]
    title = f"median u = {np.median(known):.2g}" if known.size else "not determined"
    title += " (square: static)" * bool(still.any())
    style_axes(axis, x_label=across, z_label=KEY_LABELS.get(key, key), title=title)
    axis.ticklabel_format(axis="y", useOffset=False)


def _mark(axis: Axes, found: FrameValues, place: Array, values: Array) -> None:
    """Mark key frames, and those that were found by a full search."""
    whole, again = found.whole, found.searched
    axis.plot(place[whole], values[whole], ".", color=INK, ms=4, label=data_name("key frames"))
    look: dict[str, Any] = {"mfc": "none", "color": LINE_COLOURS[1], "ms": 5}
    axis.plot(place[again], values[again], "o", label=data_name("full search"), **look)


def draw_chi(axis: Axes, found: FrameValues) -> None:
    """Draw chi over the frames, or the distance."""
    place, across = frame_axis(found)
    thin = slice(None, None, -(-len(place) // _POINTS))
    axis.plot(place[thin], found.chi[thin], color=GREY, lw=LINE_PT)
    _mark(axis, found, place, found.chi)
    style_axes(axis, x_label=across, z_label="chi")


def draw_frame_values(figure: Figure | SubFigure, found: FrameValues) -> None:
    """Draw each key with its band, and below them chi, on an empty figure."""
    count = len(found.keys) + 1
    axes: list[Any] = list(figure.subplots(count, 1, sharex=True, squeeze=False).flat)
    for axis, key in zip(axes, found.keys, strict=False):
        draw_values(axis, found, key)
        axis.set_xlabel("")
        axis.set_ylabel(wrap_note(axis.get_ylabel(), _LABEL_MM))
    draw_chi(axes[-1], found)
    marks = "circles: found by a full search"
    marks = f"dots: key frames; {marks}" if found.whole.any() else marks
    write_head(figure, f"values, band ± {BAND:g} standard uncertainties\n{marks}")


def frame_values_figure(name: str, found: FrameValues) -> Figure:
    """Draw `draw_frame_values` as a picture of its own."""
    figure = new_figure(9.0, PANEL_IN * (len(found.keys) + 1) + 0.8)
    draw_frame_values(figure, found)
    write_head(figure, f"{plain_name(name)}: tracked {figure.get_suptitle()}")
    return figure


def budget_plot(title: str, parts: Mapping[str, float], *, unit: str) -> Plot:
    """`draw_budget` as a plot of a figure for a paper, high enough for its bars.

    Small contributions are drawn in a power of ten of the unit, for Matplotlib's own would stand in
    the label's place.
    """
    shown = _shown_parts(parts)
    tall = max(30.0, 5.0 * (len(shown) + 1))
    largest = max(shown.values(), default=1.0)
    if largest < _SMALL:
        power = math.floor(math.log10(largest))
        parts, unit = {k: part / 10.0**power for k, part in shown.items()}, f"1e{power} {unit}"
    draw = partial(draw_budget, parts=parts, x_label=f"contribution to u ({unit})", title="")
    return Plot(title=title, draw=draw, height_mm=tall, least_mm=tall)  # a line of text a bar


def _shown_parts(parts: Mapping[str, float]) -> dict[str, float]:
    """Those that add something."""
    return {name: part for name, part in parts.items() if part > 0.0 and np.isfinite(part)}


def draw_budget(axes: Axes, parts: Mapping[str, float], *, x_label: str, title: str) -> None:
    """Draw an uncertainty budget as bars, the first on top, each with its share.

    Each input adds a standard uncertainty; none is drawn for those that add nothing.
    """
    items = _shown_parts(parts)
    names, sizes = list(items)[::-1], list(items.values())[::-1]
    axes.barh(names, sizes, height=0.6, color=LINE_COLOURS[0])
    total = sum(size**2 for size in sizes)
    for place, size in enumerate(sizes):
        axes.text(size, place, f" {size**2 / total:.0%}", va="center", fontsize=NOTE_PT)
    axes.margins(x=0.2)
    axes.set_ylim(-0.6, max(len(items), 3) - 0.4)
    axes.locator_params(axis="x", nbins=4)
    style_axes(axes, x_label=x_label, title=title)
