"""The side-by-side figure: experiment, simulation and their difference, one row a state."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from string import ascii_lowercase as LETTERS
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.comparison.frame_folders import SetToCompare, load_frame_set
from isochrome.comparison.frame_sets import (
    ComparedFrames,
    FrameMetrics,
    compare_frames,
    frame_pairs,
)
from isochrome.errors import InputError
from isochrome.figures import (
    DIFFERENCE_MAP,
    FRAME_MAP,
    GREY,
    INK,
    LINE_PT,
    NOTE_PT,
    OVERLAY_COLOUR,
    TEXT_PT,
    TITLE_PT,
    PaperPanels,
    PictureKind,
    Place,
    add_colour_bar,
    centred_limit,
    chosen_frames,
    draw_line,
    new_figure,
    plain_name,
    show_image,
)
from isochrome.fringes import order_contours, skeletons

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

MOST_ROWS = len(LETTERS) // 3

_ROWS_FOR_PAPER = 3
"""Frames of a figure for a paper where nobody names them."""
_PANEL_WIDTH_IN = 3.35
_LABEL_LENGTH = 26


def side_by_side(
    experiment: ComparedFrames,
    simulation: ComparedFrames,
    metrics: Sequence[FrameMetrics] | None = None,
    *,
    max_rows: int = MOST_ROWS,
    lines: bool = True,
) -> Figure:
    """Draw captured and simulated fringe patterns beside each other, with their difference.

    Rows as in Figure 11 of the paper: experiment, simulation, experiment - simulation; one scale,
    grey and difference range. The difference is the order's where both have one, else the signal's
    after gain and offset (`compare_signals`). Beyond `max_rows`, 8 at most, evenly spaced frames
    are drawn, as the foot says. `lines`: simulated dark fringes over the experiment.
    """
    pairs = frame_pairs(experiment, simulation)
    metrics = compare_frames(experiment, simulation) if metrics is None else metrics
    if len(metrics) != len(pairs):
        raise InputError(f"{len(metrics)} metrics for {len(pairs)} frames: give one a frame")
    chosen = [(*pairs[k], metrics[k]) for k in _evenly_spaced(len(pairs), max_rows)]
    of_order = any(numbers.orders is not None for *_, numbers in chosen)
    images = [pair_images(experiment, simulation, each, of_order) for each in chosen]
    grey = grey_range([image for row in images for image in row[:2]])
    limit = centred_limit(*(gap for *_, gap in images))
    place = place_of_pair(experiment, simulation)

    figure, panels, captions, foot = _lay_out(len(chosen), experiment.signal.shape[1:])
    differences = []
    for row, (_, there, numbers) in enumerate(chosen):
        label = plain_name(numbers.label, _LABEL_LENGTH)
        differences.append(_draw_row(panels[row], images[row], grey, limit, label, place))
        if lines:
            _draw_lines(panels[row][0], simulation, there, place)
        _tidy(panels[row], row, last=row == len(chosen) - 1)
        _write_line(captions[row], _caption(numbers), size_pt=TEXT_PT)
    bar = f"difference of {_of_what(of_order)}"
    add_colour_bar(differences, bar, length=min(1.0, 2.0 / len(chosen)))
    text = _foot_text(lines, len(chosen), len(pairs), place["pixel_mm"])
    _write_line(foot, text, size_pt=NOTE_PT, colour=GREY)
    return figure


def side_by_side_panels(
    experiment: ComparedFrames,
    simulation: ComparedFrames,
    metrics: Sequence[FrameMetrics],
    frames: tuple[int, ...] | None,
) -> PaperPanels:
    """The same for a paper: one scale, one grey range and one difference range for all frames.

    Parameters: both sets; their `metrics`; `frames`, numbers of the pairs that are shown. Returns
    PaperPanels. Raises InputError where there is no such pair.
    """
    pairs = frame_pairs(experiment, simulation)
    shown = chosen_frames(frames, len(pairs), _evenly_spaced(len(pairs), _ROWS_FOR_PAPER))
    chosen = [(*pairs[k], metrics[k]) for k in shown]
    of_order = any(numbers.orders is not None for *_, numbers in chosen)
    images = [pair_images(experiment, simulation, each, of_order) for each in chosen]
    grey = grey_range([image for row in images for image in row[:2]])
    limit, place = (
        centred_limit(*(gap for *_, gap in images)),
        place_of_pair(experiment, simulation),
    )

    def draw(axes: Axes, k: int, column: int) -> AxesImage:
        cmap, (low, high) = (FRAME_MAP, grey) if column < 2 else (DIFFERENCE_MAP, (-limit, limit))
        drawn = show_image(axes, images[k][column], cmap=cmap, vmin=low, vmax=high, **place)
        if column == 0:
            _draw_lines(axes, simulation, chosen[k][1], place)
        return drawn

    bars = ("", "", f"difference of {_of_what(of_order)}")
    names = ("experiment", "simulation", "difference")
    labels = [plain_name(numbers.label, _LABEL_LENGTH) for *_, numbers in chosen]
    notes = [f"{own}: {_caption(row[2])}" for own, row in zip(labels, chosen, strict=True)]
    return PaperPanels(
        kinds=[
            PictureKind(name=name, draw=partial(draw, column=column), bar=bar)
            for column, (name, bar) in enumerate(zip(names, bars, strict=True))
        ],
        labels=labels,
        notes=[*notes, "Orange: dark-fringe centre lines of the simulation."],
    )


def plot_side_by_side(
    experiment: SetToCompare,
    simulation: SetToCompare,
    axes: Sequence[Axes] | None = None,
    *,
    frame: int = 0,
    lines: bool = True,
) -> tuple[Axes, Axes, Axes]:
    """Draw one frame of an experiment, its simulation and their difference beside each other.

    As a row of the figure that `compare` makes: the difference is that of the fringe order where
    both have one, else that of the signal.

    Parameters
    ----------
    experiment : str, Path, Processed, array or sequence of arrays
        What was captured, as for `compare`.
    simulation : str, Path, Simulation, array or sequence of arrays
        What was simulated, on the same pixel grid.
    axes : sequence of matplotlib.axes.Axes, optional
        Three of them; by default those of a new figure of matplotlib.pyplot.
    frame : int, default 0
        Number of the pair of frames.
    lines : bool, default True
        Whether the simulation's dark-fringe centre lines are drawn over the experiment.

    Returns
    -------
    tuple of three matplotlib.axes.Axes
        What was drawn on: experiment, simulation, difference.

    Raises
    ------
    InputError
        Where the sets do not fit together, or there is no such frame.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> simulated = isochrome.simulate(scene)
    >>> found = isochrome.process(simulated.frames, scene)
    >>> axes = isochrome.plot_side_by_side(found, simulated)
    >>> [one.get_title(loc="left") for one in axes][1:]
    ['simulation', 'experiment − simulation']
    """
    here, there = load_frame_set(experiment), load_frame_set(simulation)
    pairs = frame_pairs(here, there)
    if not 0 <= frame < len(pairs):
        raise InputError(f"frame = {frame}: there are {len(pairs)}, counted from 0")
    if axes is not None and len(axes) != 3:
        raise InputError(f"{len(axes)} axes for a side-by-side row: give three")
    of_order = here.order is not None and there.order is not None
    own, model = (part.only(at) for part, at in zip((here, there), pairs[frame], strict=True))
    (numbers,) = compare_frames(own, model)
    images = pair_images(own, model, (0, 0, numbers), of_order)
    limit, place = centred_limit(images[2]), place_of_pair(here, there)
    panels = three_axes(images[0].shape) if axes is None else list(axes)
    label = plain_name(here.label(pairs[frame][0]), _LABEL_LENGTH)
    drawn = _draw_row(panels, images, grey_range(list(images[:2])), limit, label, place)
    if lines:
        _draw_lines(panels[0], model, 0, place)
    add_colour_bar(drawn, f"difference of {_of_what(of_order)}")
    return panels[0], panels[1], panels[2]


def three_axes(shape: tuple[int, ...]) -> list[Axes]:
    """Three Axes beside each other in a new figure of pyplot, for pictures of a shape."""
    from matplotlib import pyplot

    height = float(np.clip(_PANEL_WIDTH_IN * shape[0] / shape[1], 0.8, 6.0)) + 0.7
    size = 3 * _PANEL_WIDTH_IN + 1.75, height
    found: Any = pyplot.subplots(1, 3, figsize=size, layout="constrained", sharex=True, sharey=True)
    return list(found[1])


def place_of_pair(experiment: ComparedFrames, simulation: ComparedFrames) -> Place:
    """Where the frames of two sets lie."""
    known = simulation if simulation.pixel_mm is not None else experiment
    return {"pixel_mm": known.pixel_mm, "left_mm": known.left_mm, "top_mm": known.top_mm}


def _of_what(of_order: bool) -> str:
    return "fringe order (fringes)" if of_order else "signal (0 to 1)"


def _draw_row(
    panels: Sequence[Axes],
    images: tuple[NDArray[Any], NDArray[Any], NDArray[Any]],
    grey: tuple[float, float],
    limit: float,
    label: str,
    place: Place,
) -> AxesImage:
    """Experiment, simulation and their difference on three Axes. Returns the difference's image."""
    styles = (
        (f"experiment: {label}", FRAME_MAP, grey),
        ("simulation", FRAME_MAP, grey),
        ("experiment − simulation", DIFFERENCE_MAP, (-limit, limit)),
    )
    drawn = [
        show_image(axes, image, cmap=cmap, vmin=low, vmax=high, title=title, **place)
        for axes, image, (title, cmap, (low, high)) in zip(panels, images, styles, strict=True)
    ]
    return drawn[-1]


def _draw_lines(axes: Axes, simulation: ComparedFrames, index: int, place: Place) -> None:
    """Overlay the simulation's dark-fringe centre lines, thin enough to see what is below."""
    if simulation.order is not None:
        found = order_contours(simulation.order[index])
    else:
        found = skeletons(simulation.signal[index])
    look = {"color": OVERLAY_COLOUR, "linewidth": LINE_PT, "scalex": False, "scaley": False}
    for line in found:
        if line.kind == "dark":
            draw_line(axes, line.rows, line.cols, place, **look)


def pair_images(
    experiment: ComparedFrames,
    simulation: ComparedFrames,
    pair: tuple[int, int, FrameMetrics],
    of_order: bool,
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """The signals of a pair, and experiment - simulation in fringes or in signal units."""
    here, there, numbers = pair
    measured, model = experiment.signal[here], simulation.signal[there]
    if of_order and experiment.order is not None and simulation.order is not None:
        return measured, model, experiment.order[here] - simulation.order[there]
    return measured, model, measured - (numbers.signals.gain * model + numbers.signals.offset)


def grey_range(images: list[NDArray[Any]]) -> tuple[float, float]:
    """Black and white for all frames of the figure: the range that 99 % of the pixels fill."""
    bounds = [np.nanpercentile(image, (0.5, 99.5)) for image in images]
    low, high = float(np.min(bounds)), float(np.max(bounds))
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _evenly_spaced(count: int, most: int) -> list[int]:
    """Pick at most `most` of `count` frames, the first and the last among them."""
    if not 1 <= most <= MOST_ROWS:
        raise InputError(f"max_rows = {most} for the side-by-side figure: give 1 to {MOST_ROWS}")
    return [int(index) for index in np.unique(np.linspace(0, count - 1, min(count, most)).round())]


def _lay_out(
    count: int, shape: tuple[int, ...]
) -> tuple[Figure, list[list[Axes]], list[Axes], Axes]:
    """Make the grid: per state a row of three panels over a caption, and one foot."""
    panel_in = float(np.clip(_PANEL_WIDTH_IN * shape[0] / shape[1], 0.8, 6.0))
    row_in, caption_in, foot_in = panel_in + 0.32, 0.3, 0.42
    height = count * (row_in + caption_in) + foot_in + 0.55
    figure = new_figure(3 * _PANEL_WIDTH_IN + 1.75, height)
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


def _tidy(panels: list[Axes], row: int, *, last: bool) -> None:
    """Letter the panels and label only the outer axes."""
    for col, axes in enumerate(panels):
        title = f"({LETTERS[3 * row + col]}) {axes.get_title(loc='left')}"
        axes.set_title(title, fontsize=TITLE_PT, loc="left")
        axes.tick_params(labelleft=col == 0, labelbottom=last)
        if col:
            axes.set_ylabel("")
        if not last:
            axes.set_xlabel("")


def _caption(numbers: FrameMetrics) -> str:
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


def _write_line(axes: Axes, text: str, *, size_pt: float, colour: str = INK) -> None:
    """Put a line of text into an empty strip without widening the strip for it."""
    line = axes.text(0.0, 0.5, text, va="center", fontsize=size_pt, color=colour)
    line.set_in_layout(False)


def _foot_text(lines: bool, shown: int, count: int, pixel_mm: float | None) -> str:
    """Say what holds for all rows."""
    parts = ["One scale, grey range and difference range for all rows; hatched: not known."]
    if lines:
        parts.append("Orange: dark-fringe centre lines of the simulation.")
    if shown < count:
        parts.append(f"{shown} of {count} frames shown, evenly spaced.")
    if pixel_mm is None:
        parts.append("No pixel scale is known.")
    return " ".join(parts)
