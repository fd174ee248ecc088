"""Pictures for notebooks and figures: a frame, and values over frames, each on given Axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError
from isochrome.figures import style
from isochrome.figures.paper import ENVELOPE, Plot, data_name
from isochrome.output import FittedResult, FrameValues

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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

MOST_POINTS = 240
"""Points of a curve: more than a drawing has pixels to tell them apart."""
_FEW = 40
"""Frames whose points have room beside each other."""


def frame_axis(table: FrameValues) -> tuple[Array, str]:
    """Where frames stand on an axis, and its label: at distances (m; NaN: still), or numbers."""
    known = table.distance_m[np.isfinite(table.distance_m)]
    if known.size and np.ptp(known) > 0.0:
        return table.distance_m, "sliding distance (m)"
    return np.arange(len(table.chi), dtype=float), "frame"


def draw_band(
    axis: Axes, x: Array, values: Array, spread: Array, *, colour: Any = style.LINE_COLOURS[0],
    **line: Any,
) -> None:  # fmt: skip
    """Draw values with a band of two standard uncertainties to either side, where it is finite."""
    band = BAND * np.where(np.isfinite(spread), spread, np.nan)
    axis.fill_between(x, values - band, values + band, color=colour, alpha=0.3, lw=0)
    axis.plot(x, values, color=colour, **line)


def draw_course(
    axis: Axes, place: Array, values: Array, spread: Array | None = None, *,
    colour: Any = style.LINE_COLOURS[0], **line: Any,
) -> Array:  # fmt: skip
    """Draw values over places with their band; of many, neighbours are one point, their mean, in an
    envelope of all their values and of all their bands. Gives which are drawn, rising."""
    order = np.argsort(place, kind="stable")[: int(np.isfinite(place).sum())]
    # a line goes on over frames without the key, and breaks where a video's frame tells nothing
    drawn = order[np.isfinite(values[order])] if len(order) <= _FEW else order
    x, y = place[drawn], values[drawn]
    bands: list[tuple[Array, Array, str | None]] = []
    if spread is not None:
        half = BAND * np.where(np.isfinite(spread[drawn]), spread[drawn], np.nan)
        bands = [(y - half, y + half, None)]
    if len(x) > MOST_POINTS:
        starts = np.arange(0, len(x), -(-len(x) // MOST_POINTS))
        bands = [
            (np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts), name)
            for low, high, name in ((y, y, data_name(ENVELOPE)), *bands)
        ]
        known = np.add.reduceat(np.isfinite(y), starts)
        x = np.add.reduceat(x, starts) / np.diff([*starts, len(x)])
        y = np.add.reduceat(np.nan_to_num(y), starts) / np.where(known, known, np.nan)
    for low, high, name in bands:
        axis.fill_between(x, low, high, color=colour, alpha=0.3, lw=0, label=name)
    axis.plot(x, y, color=colour, **line)
    return drawn


def course_plot(title: str, across: str, place: Array, values: Array) -> Plot:
    """A plot of values over places; `title` and `across` say what they are and in what unit."""

    def draw(axis: Axes) -> None:
        marker = "o" if len(values) <= _FEW else ""
        draw_course(axis, place, values, lw=style.LINE_PT, marker=marker, ms=4)
        style.style_axes(axis, x_label=across, z_label=title)

    return Plot(title=title, draw=draw)


def draw_values(axis: Axes, table: FrameValues, key: str) -> None:
    """Draw a key with its band. Frames that stand still are squares at the distance 0, key frames
    dots, and frames found by a full search circles."""
    j = table.keys.index(key)
    values, spread = table.values[:, j], table.standard_uncertainty[:, j]
    place, across = frame_axis(table)
    still = ~np.isfinite(place) & np.isfinite(values)
    drawn = draw_course(axis, place, values, spread, lw=style.LINE_PT)
    if np.isfinite(place).sum() <= _FEW:
        open_square: dict[str, Any] = {"fmt": "s", "mfc": "white", "label": data_name("static")}
        for frames, look in ((drawn, {"fmt": "o"}), (np.flatnonzero(still), open_square)):
            x = np.where(np.isfinite(place[frames]), place[frames], 0.0)
            bars = BAND * np.where(np.isfinite(spread[frames]), spread[frames], np.nan)
            look |= {"color": style.LINE_COLOURS[0], "ms": 4, "capsize": 2.5, "lw": style.LINE_PT}
            axis.errorbar(x, values[frames], yerr=bars, **look)
    _mark(axis, table, place, values)
    followed = spread[~table.whole] if not table.whole.all() else spread
    known = followed[np.isfinite(followed)]
    title = f"median u = {np.median(known):.2g}" if known.size else "not determined"
    title += " (square: static)" * bool(still.any())
    style.style_axes(axis, x_label=across, z_label=KEY_LABELS.get(key, key), title=title)
    axis.ticklabel_format(axis="y", useOffset=False)


def _mark(axis: Axes, table: FrameValues, place: Array, values: Array) -> None:
    looks: tuple[tuple[Array, str, dict[str, Any]], ...] = (
        (table.whole, "key frames", {"marker": ".", "color": style.INK, "ms": 4}),
        (table.searched, "full search",
         {"marker": "o", "mfc": "none", "color": style.LINE_COLOURS[1], "ms": 5}),
    )  # fmt: skip
    for which, name, look in looks:
        if which.sum() <= MOST_POINTS:
            axis.plot(place[which], values[which], ls="", label=data_name(name), **look)


def values_plots(table: FrameValues) -> list[Plot]:
    """A plot of each key over the frames with its band, and one of chi."""

    def draw_chi(axis: Axes) -> None:
        place, across = frame_axis(table)
        draw_course(axis, place, table.chi, colour=style.GREY, lw=style.LINE_PT)
        _mark(axis, table, place, table.chi)
        style.style_axes(axis, x_label=across, z_label="chi")

    draws: dict[str, Any] = {
        KEY_LABELS.get(key, key): partial(draw_values, table=table, key=key) for key in table.keys
    }
    return [
        Plot(title=title, draw=draw, height_mm=30.0)
        for title, draw in (draws | {"chi": draw_chi}).items()
    ]


def budget_plot(title: str, parts: Mapping[str, float], *, unit: str) -> Plot:
    """An uncertainty budget as bars, the first on top, each with its share. Small ones are drawn in
    a power of ten of the unit, for Matplotlib's own would stand in the label's place."""
    parts = {name: part for name, part in parts.items() if part > 0.0 and np.isfinite(part)}
    tall = max(30.0, 5.0 * (len(parts) + 1))
    largest = max(parts.values(), default=1.0)
    if largest < _SMALL:
        power = math.floor(math.log10(largest))
        parts, unit = {k: part / 10.0**power for k, part in parts.items()}, f"1e{power} {unit}"
    names, sizes = list(parts)[::-1], list(parts.values())[::-1]

    def draw(axes: Axes) -> None:
        axes.barh(names, sizes, height=0.6, color=style.LINE_COLOURS[0])
        total = sum(size**2 for size in sizes)
        for place, size in enumerate(sizes):
            axes.text(size, place, f" {size**2 / total:.0%}", va="center")
        axes.margins(x=0.2)
        axes.set_ylim(-0.6, max(len(sizes), 3) - 0.4)
        axes.locator_params(axis="x", nbins=4)
        style.style_axes(axes, x_label=f"contribution to u ({unit})")

    return Plot(title=title, draw=draw, height_mm=tall, least_mm=tall)  # a line of text a bar


def given_axes(axes: Axes | None) -> Axes:
    """The caller's Axes, or those of a new figure of matplotlib.pyplot, which a notebook shows."""
    if axes is not None:
        return axes
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def place_of_image(
    image: Any, pixel_mm: float | None, left_mm: float, top_mm: float
) -> style.Place:
    """The place of an image: as its coordinates z_mm and x_mm say, or as it is given."""
    coords = getattr(image, "coords", {})
    given: style.Place = {"pixel_mm": pixel_mm, "left_mm": left_mm, "top_mm": top_mm}
    if pixel_mm is not None or not {"x_mm", "z_mm"} <= set(coords):
        return given
    x, z = (np.asarray(coords[name], dtype=float) for name in ("x_mm", "z_mm"))
    if x.ndim != 1 or z.ndim != 1 or min(x.size, z.size) < 2:
        return given
    pixel, edges = float(x[-1] - x[0]) / (x.size - 1), []
    for axis, name in ((x, "shift_x_mm"), (z, "shift_z_mm")):
        shifts = (coords.get(f"{start}{name}") for start in ("", "key_"))
        # of the one frame that an image is, where it is known
        shift = next((float(at) for at in shifts if at is not None and np.ndim(at) == 0), 0.0)
        edges.append(float(axis[0]) - 0.5 * pixel + (shift if np.isfinite(shift) else 0.0))
    return {"pixel_mm": pixel, "left_mm": edges[0], "top_mm": edges[1]}


def plot_frame(
    frame: ArrayLike,
    axes: Axes | None = None,
    *,
    full: float | None = None,
    pixel_mm: float | None = None,
    left_mm: float = 0.0,
    top_mm: float = 0.0,
    title: str = "",
) -> Axes:
    """Draw a frame in grey at true proportions, x to the right and z down.

    In mm where its coordinates z_mm and x_mm, or `pixel_mm`, tell the scale; else in pixels.

    Parameters
    ----------
    frame : array_like, shape (rows, cols) or (rows, cols, 3)
        Grey levels, light, or colours.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure of matplotlib.pyplot.
    full : float, optional
        The level of full light, which is white; by default that of the type, 255, 65535 or 1.
    pixel_mm : float, optional
        Side of a pixel, mm.
    left_mm : float, default 0.0
        Outer edge of the first column, mm.
    top_mm : float, default 0.0
        Outer edge of the first row, mm.
    title : str, default ''
        Title.

    Returns
    -------
    matplotlib.axes.Axes
        What was drawn on.

    Raises
    ------
    InputError
        Where the frame has another shape.

    Examples
    --------
    >>> import isochrome
    >>> sample = isochrome.samples.line_contact_wear()
    >>> axes = isochrome.plot_frame(sample.frames[0], pixel_mm=0.00607)
    >>> axes.get_xlabel()
    'x (mm)'
    """
    values = np.asarray(frame)
    if full is None:
        full = float(np.iinfo(values.dtype).max) if values.dtype.kind == "u" else 1.0
    place = place_of_image(frame, pixel_mm, left_mm, top_mm)
    drawn = given_axes(axes)
    style.show_image(drawn, values, cmap=style.FRAME_MAP, vmin=0, vmax=full, title=title, **place)
    return drawn


def plot_over_distance(result: FittedResult, key: str, axes: Axes | None = None) -> Axes:
    """Draw a fitted value over the sliding distance, or the frames, with its band of 2 u.

    Frames that stand still are squares at the distance 0; frames without distances are counted.

    Parameters
    ----------
    result : Processed, Fit or Track
        What `process`, `fit` or `track` found.
    key : str
        A key with values in each frame, such as 'friction.coefficient'.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure of matplotlib.pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        What was drawn on.

    Raises
    ------
    InputError
        Where the result has no such key.

    Examples
    --------
    >>> import isochrome
    >>> found = isochrome.process(isochrome.simulate("ring").frames, "ring")
    >>> isochrome.plot_over_distance(found, "load.normal_n").get_ylabel()
    'normal load (N)'
    """
    values = result.over_frames
    if key not in values.keys:
        raise InputError("has_no_value_each", key=key, known=", ".join(values.keys) or "none")
    drawn = given_axes(axes)
    draw_values(drawn, values, key)
    return drawn
