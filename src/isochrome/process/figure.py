"""The picture that `process` leaves: each frame with its fringes numbered, and its order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import (
    FRAME_MAP,
    LINE_COLOURS,
    VALUE_MAP,
    add_colour_bar,
    new_figure,
    plain_name,
    show_image,
)
from isochrome.fringes.skeleton import Skeleton, order_contours
from isochrome.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure


DIRECTION_MAP = "hsv"
"""Colours of a direction: the same at -90 and at 90 degrees, and none of them the grey of NaN."""

_MOST_LINES = 12
"""Half orders beyond which only every whole one is drawn, and beyond twice as many every fifth."""


_BESIDE = 0.7
"""Inches that an axis' numbers and label take beside a picture."""


@dataclass(frozen=True)
class Shown:
    """A processed frame as it is drawn: maps (rows, cols), NaN = not known, None = not read.

    `label`; `chi`; `kept`, the share of pixels whose order is known; `lines`, found without an
    order; `pixel_mm`, `left_mm`, `top_mm`, its scale and outer corner.
    """

    label: str
    chi: float
    kept: float
    normalised: np.ndarray
    order: np.ndarray | None
    isoclinic: np.ndarray | None
    lines: list[Skeleton]
    pixel_mm: float | None
    left_mm: float
    top_mm: float


def process_figure(scene: Scene, items: list[Shown]) -> Figure:
    """Captured frames with the fringes found in them; beside each its fringe order, if known.

    A phase-stepped state has its dark field in the place of the frame, and its isoclinic angles.

    Parameters: `scene`; `items`, up to six of the frames. Returns a Figure.
    """
    turned = any(item.isoclinic is not None for item in items)
    figure = new_figure(*frames_size(items))
    note = draw_frames(figure, items)
    what = "phase-stepped set as dark field" if turned else "captured frames, normalised"
    what += ", residual stress taken out" if scene.frames.no_load_steps else ""
    figure.suptitle(f"{plain_name(scene.name, 24)}: {what}; {note}", fontsize=11)
    return figure


def _across(items: list[Shown]) -> int:
    """Pictures in a row."""
    if any(item.order is not None for item in items):
        return 2 + any(item.isoclinic is not None for item in items)
    return min(3, len(items))


def frames_size(items: list[Shown]) -> tuple[float, float]:
    """Width and height (inches) that `draw_frames` takes for some frames."""
    read = any(item.order is not None for item in items)
    rows, cols = items[0].normalised.shape
    across = _across(items)
    down = len(items) if read else -(-len(items) // across)
    width = 4.6 if read else 4.0
    picture = width - _BESIDE
    return width * across + 0.8, (picture * min(rows / cols, 1.6) + 0.75) * down + 0.5


def draw_frames(figure: Figure | SubFigure, items: list[Shown]) -> str:
    """Draw frames with their fringes, and beside each its order, if known, on an empty figure.

    Parameters: `figure`; `items`. Returns what the lines are, in words.
    """
    read = any(item.order is not None for item in items)
    across = _across(items)
    down = len(items) if read else -(-len(items) // across)
    axes: Any = figure.subplots(down, across, squeeze=False)
    largest = max((_largest(item) for item in items), default=1.0)
    orders, directions = list[Any](), list[Any]()
    for k, item in enumerate(items):
        place = _place(item)
        ax = axes[k, 0] if read else axes.flat[k]
        judged = item.order is not None and np.isfinite(item.chi)  # no model, no chi
        name = plain_name(item.label)
        title = f"{name}: chi = {item.chi:.2f}" if judged else name
        show_image(ax, item.normalised, cmap=FRAME_MAP, vmin=0, vmax=1, title=title, **place)
        lines = item.lines
        if item.order is not None:
            lines = order_contours(item.order, _line_orders(largest))
            orders.append(show_image(
                axes[k, 1], item.order, cmap=VALUE_MAP, vmin=0, vmax=largest,
                title=f"fringe order, {100 * item.kept:.1f} % known", **place,
            ))  # fmt: skip
        if item.isoclinic is not None:
            directions.append(_show_isoclinic(axes[k, 2], item.isoclinic, place))
        _draw(ax, lines, place)
    _share_bar(orders, "fringe order N (fringes)")
    _share_bar(directions, "counter-clockwise from x (degrees)")
    for ax in list(axes.flat)[len(items) * (across if read else 1) :]:
        ax.set_visible(False)
    first = ", ".join(f"{order:g}" for order in _line_orders(largest)[:3])
    return f"lines: N = {first} ..." if read else "lines: dark (blue) and bright (orange) fringes"


def _line_orders(largest: float) -> np.ndarray:
    """Orders to draw as lines: halves, or as many as can be told apart."""
    step = 0.5 if 2.0 * largest <= _MOST_LINES else 1.0 if largest <= _MOST_LINES else 5.0
    return np.arange(step, largest + step, step)


def _show_isoclinic(axes: Any, isoclinic: np.ndarray, place: dict[str, Any]) -> Any:
    """Direction of sigma_1, in colours that close on themselves."""
    known = 100.0 * float(np.isfinite(isoclinic).mean())
    return show_image(
        axes, isoclinic, cmap=DIRECTION_MAP, vmin=-90.0, vmax=90.0,
        title=f"direction of sigma_1, known in {known:.1f} %", **place,
    )  # fmt: skip


def _share_bar(images: list[Any], label: str) -> None:
    """One colour bar for a column of maps, which have the same colours."""
    if not images:
        return
    for shown in images:
        shown.set_interpolation("nearest")
    above = any(shown.get_array().max() > shown.get_clim()[1] for shown in images)
    add_colour_bar(
        images[0],
        label,
        axes=[shown.axes for shown in images],
        extend="max" if above else "neither",
        length=1.0 if len(images) == 1 else 0.6,
    )


def _largest(item: Shown) -> float:
    if item.order is None or not np.isfinite(item.order).any():
        return 1.0
    return float(np.nanpercentile(item.order, 99.9))


def _place(item: Shown) -> dict[str, Any]:
    return {"pixel_mm": item.pixel_mm, "left_mm": item.left_mm, "top_mm": item.top_mm}


def _draw(axes: Any, lines: list[Skeleton], place: dict[str, Any]) -> None:
    """Fringe lines on an image, in its own coordinates."""
    pixel = place.get("pixel_mm")
    left, top = place.get("left_mm", 0.0), place.get("top_mm", 0.0)
    for line in lines:
        x, z = line.cols, line.rows
        if pixel:
            x, z = left + pixel * (x + 0.5), top + pixel * (z + 0.5)
        whole = line.kind == "dark" if line.order is None else float(line.order).is_integer()
        axes.plot(x, z, color=LINE_COLOURS[0 if whole else 1], lw=0.9)
