"""The grid and the words of the side-by-side figure."""

from __future__ import annotations

import string
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from isochrome import figures
from isochrome.compare.frame_sets import FrameMetrics

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LETTERS = string.ascii_lowercase
MOST_ROWS = len(LETTERS) // 3

_PANEL_WIDTH_IN = 3.35
_LABEL_LENGTH = 26


class Place(TypedDict):
    """Where the frames lie: the keywords of `show_image`."""

    pixel_mm: float | None
    left_mm: float
    top_mm: float


def lay_out(
    count: int, shape: tuple[int, ...]
) -> tuple[Figure, list[list[Axes]], list[Axes], Axes]:
    """Make the grid: per state a row of three panels over a caption, and one foot."""
    panel_in = float(np.clip(_PANEL_WIDTH_IN * shape[0] / shape[1], 0.8, 6.0))
    row_in, caption_in, foot_in = panel_in + 0.32, 0.3, 0.42
    height = count * (row_in + caption_in) + foot_in + 0.55
    figure = figures.new_figure(3 * _PANEL_WIDTH_IN + 1.75, height)
    grid = figure.add_gridspec(
        2 * count + 1, 3, height_ratios=[row_in, caption_in] * count + [foot_in]
    )
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(wspace=0.05)  # type: ignore[call-arg]
    panels: list[list[Axes]] = []
    captions: list[Axes] = []
    for row in range(count):
        first = panels[0][0] if panels else None
        left = figure.add_subplot(grid[2 * row, 0], sharex=first, sharey=first)
        others = [
            figure.add_subplot(grid[2 * row, col], sharex=left, sharey=left) for col in (1, 2)
        ]
        panels.append([left, *others])
        captions.append(figure.add_subplot(grid[2 * row + 1, :]))
    foot = figure.add_subplot(grid[2 * count, :])
    for axes in (*captions, foot):
        axes.set_axis_off()
    return figure, panels, captions, foot


def tidy(panels: list[Axes], row: int, *, last: bool) -> None:
    """Letter the panels and label only the outer axes."""
    for col, axes in enumerate(panels):
        title = f"({LETTERS[3 * row + col]}) {axes.get_title(loc='left')}"
        axes.set_title(title, fontsize=figures.TITLE_PT, loc="left")
        axes.tick_params(labelleft=col == 0, labelbottom=last)
        if col:
            axes.set_ylabel("")
        if not last:
            axes.set_xlabel("")


def caption(numbers: FrameMetrics) -> str:
    """Say the numbers of one row in one line."""
    parts = []
    if numbers.orders is not None:
        order = numbers.orders
        parts += [
            f"fringe order RMS {order.rms:.2g} (95 % below {order.p95:.2g})",
            f"wrong branch {100 * order.wrong_branch_share:.2g} %",
        ]
    parts.append(f"NCC {numbers.signals.ncc:.4f}")
    if numbers.skeleton is not None and np.isfinite(numbers.skeleton.mean_px):
        distance = f"lines {numbers.skeleton.mean_px:.2g} px"
        if np.isfinite(numbers.skeleton.mean_mm):
            distance += f" ({1000 * numbers.skeleton.mean_mm:.2g} µm)"
        parts.append(f"{distance} apart, {100 * numbers.skeleton.matched_share:.0f} % matched")
    if np.isfinite(numbers.signals.rmse_over_noise):
        parts.append(f"χ {numbers.signals.rmse_over_noise:.3g}")
    return "  ·  ".join(parts)


def write_line(axes: Axes, text: str, *, size_pt: float, colour: str = "black") -> None:
    """Put a line of text into an empty strip without widening the strip for it."""
    line = axes.text(0.0, 0.5, text, va="center", fontsize=size_pt, color=colour)
    line.set_in_layout(False)


def bar_label(of_order: bool) -> str:
    return "difference of fringe order (fringes)" if of_order else "difference of signal (0 to 1)"


def foot_text(lines: bool, shown: int, count: int, pixel_mm: float | None) -> str:
    """Say what holds for all rows."""
    parts = ["One scale, grey range and difference range for all rows; hatched: not known."]
    if lines:
        parts.append("Orange: dark-fringe centre lines of the simulation.")
    if shown < count:
        parts.append(f"{shown} of {count} frames shown, evenly spaced.")
    if pixel_mm is None:
        parts.append("No pixel scale is known.")
    return " ".join(parts)


def short(label: str) -> str:
    """Cut a long label in its middle."""
    return figures.plain_name(label, _LABEL_LENGTH)
