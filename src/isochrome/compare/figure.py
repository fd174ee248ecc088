"""The side-by-side figure: experiment, simulation and their difference, one row a state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from isochrome import figures
from isochrome.compare._panels import (
    MOST_ROWS,
    Place,
    bar_label,
    caption,
    foot_text,
    lay_out,
    short,
    tidy,
    write_line,
)
from isochrome.compare.frame_sets import FrameMetrics, FrameSet, compare_frames, frame_pairs
from isochrome.errors import InputError
from isochrome.fringes.skeleton import order_contours, skeletons

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

_LINE_COLOUR = "#ff9d2e"


def side_by_side(
    experiment: FrameSet,
    simulation: FrameSet,
    metrics: Sequence[FrameMetrics] | None = None,
    *,
    max_rows: int = MOST_ROWS,
    lines: bool = True,
) -> Figure:
    """Draw captured and simulated fringe patterns beside each other, with their difference.

    One row a frame: experiment, simulation, experiment - simulation; one scale, one grey range
    and one difference range for all rows. The difference is that of the fringe order where both
    sets have one, else that of the signal after the gain and offset of `compare_signals`. Beyond
    `max_rows` frames, evenly spaced ones are drawn and the foot says so.

    `metrics`: from `compare_frames` for these sets (default: made here). `max_rows`: 1 to 8.
    `lines`: draw the simulation's dark-fringe centre lines over the experiment. Returns a
    matplotlib Figure. Raises InputError as `compare_frames` does, and when `metrics` belong to
    another number of frames. Layout after Figure 11 of the paper.
    """
    pairs = frame_pairs(experiment, simulation)
    metrics = compare_frames(experiment, simulation) if metrics is None else metrics
    if len(metrics) != len(pairs):
        raise InputError(f"{len(metrics)} metrics for {len(pairs)} frames: give one a frame")
    shown = _evenly_spaced(len(pairs), max_rows)
    of_order = any(metrics[k].orders is not None for k in shown)
    gaps = [_difference(experiment, simulation, pairs[k], metrics[k], of_order) for k in shown]
    grey = _grey_range(experiment, simulation, [pairs[k] for k in shown])

    figure, panels, captions, foot = lay_out(len(shown), experiment.signal.shape[1:])
    limit = figures.centred_limit(*gaps)
    place = _place(experiment, simulation)
    for row, index in enumerate(shown):
        here, there = pairs[index]
        frames = (experiment.signal[here], simulation.signal[there], gaps[row])
        drawn = _draw_row(panels[row], frames, short(metrics[index].label), grey, limit, place)
        if lines:
            _draw_lines(panels[row][0], simulation, there, place)
        tidy(panels[row], row, last=row == len(shown) - 1)
        write_line(captions[row], caption(metrics[index]), size_pt=figures.TEXT_PT)
    figures.add_colour_bar(
        drawn,
        bar_label(of_order),
        axes=[row[2] for row in panels],
        extend=_extend(gaps, limit),
        length=min(1.0, 2.0 / len(shown)),
    )
    text = foot_text(lines, len(shown), len(pairs), place["pixel_mm"])
    write_line(foot, text, size_pt=figures.TICK_PT, colour="0.3")
    return figure


def _draw_row(
    panels: list[Axes],
    frames: tuple[NDArray, NDArray, NDArray],
    label: str,
    grey: tuple[float, float],
    limit: float,
    place: Place,
) -> AxesImage:
    """Draw experiment, simulation and difference of one state; returns the difference's image."""
    grey_map, difference_map = figures.FRAME_MAP, figures.DIFFERENCE_MAP
    styles = (
        (f"experiment: {label}", grey_map, grey),
        ("simulation", grey_map, grey),
        ("experiment − simulation", difference_map, (-limit, limit)),
    )
    for axes, frame, (title, cmap, (low, high)) in zip(panels, frames, styles, strict=True):
        drawn = figures.show_image(
            axes, frame, cmap=cmap, vmin=low, vmax=high, title=title, **place
        )
    return drawn


def _draw_lines(axes: Axes, simulation: FrameSet, index: int, place: Place) -> None:
    """Overlay the simulation's dark-fringe centre lines, thin enough to see what is below."""
    if simulation.order is not None:
        found = order_contours(simulation.order[index])
    else:
        found = skeletons(simulation.signal[index])
    pixel_mm = place["pixel_mm"]
    for line in found:
        if line.kind != "dark":
            continue
        x, z = line.cols, line.rows
        if pixel_mm is not None:
            x = place["left_mm"] + (x + 0.5) * pixel_mm
            z = place["top_mm"] + (z + 0.5) * pixel_mm
        axes.plot(x, z, color=_LINE_COLOUR, linewidth=0.8, scalex=False, scaley=False)


def _difference(
    experiment: FrameSet,
    simulation: FrameSet,
    pair: tuple[int, int],
    numbers: FrameMetrics,
    of_order: bool,
) -> NDArray:
    """Experiment - simulation of one pair, in fringes or in signal units."""
    here, there = pair
    if of_order and experiment.order is not None and simulation.order is not None:
        return np.asarray(experiment.order[here] - simulation.order[there])
    fitted = numbers.signals.gain * simulation.signal[there] + numbers.signals.offset
    return np.asarray(experiment.signal[here] - fitted)


def _grey_range(
    experiment: FrameSet, simulation: FrameSet, pairs: list[tuple[int, int]]
) -> tuple[float, float]:
    """Black and white for all frames of the figure: the range that 99 % of the pixels fill."""
    bounds = []
    for here, there in pairs:
        for frame in (experiment.signal[here], simulation.signal[there]):
            bounds.append(np.nanpercentile(frame, (0.5, 99.5)))
    low, high = float(np.min(bounds)), float(np.max(bounds))
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _place(experiment: FrameSet, simulation: FrameSet) -> Place:
    """Millimetre axes from the set that knows them, the simulation's first."""
    known = simulation if simulation.pixel_mm is not None else experiment
    return {"pixel_mm": known.pixel_mm, "left_mm": known.left_mm, "top_mm": known.top_mm}


def _evenly_spaced(count: int, most: int) -> list[int]:
    """Pick at most `most` of `count` frames, the first and the last among them."""
    if not 1 <= most <= MOST_ROWS:
        raise InputError(f"max_rows = {most} for the side-by-side figure: give 1 to {MOST_ROWS}")
    return [int(index) for index in np.unique(np.linspace(0, count - 1, min(count, most)).round())]


def _extend(gaps: list[NDArray], limit: float) -> str:
    """Point the colour bar's ends where differences lie beyond it."""
    low = min(float(np.nanmin(gap, initial=0.0)) for gap in gaps) < -limit
    high = max(float(np.nanmax(gap, initial=0.0)) for gap in gaps) > limit
    return ("both" if high else "min") if low else ("max" if high else "neither")
