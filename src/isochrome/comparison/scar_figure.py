"""The picture of scars: measured and simulated ones over x, and what they differ by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.comparison.scar_metrics import ScarPair
from isochrome.comparison.simulated_scars import (
    SimulatedScar,
    root_sum_square,
    simulated_text,
)
from isochrome.figures import (
    BAND,
    BOLD_PT,
    FINE_PT,
    GREY,
    INK,
    LINE_COLOURS,
    LINE_PT,
    PaperPanels,
    Plot,
    add_legend,
    chosen_frames,
    draw_band,
    new_figure,
    plain_name,
    style_axes,
    write_head,
)
from isochrome.output import with_uncertainty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_DISTANCES = 8
"""Distances that are drawn, evenly spaced ones of more."""

_FOR_PAPER = 4
"""Distances of a figure for a paper where nobody names them."""
_BESIDE = 1.7
"""Half of what is drawn over half of the widest scar."""


def scars_figure(
    name: str,
    names: Sequence[str],
    scars: Sequence[SimulatedScar],
    pairs: Sequence[ScarPair | None],
) -> Figure:
    """Draw measured scars beside simulated ones, and below each distance's overlay and difference.

    The top row is the paper's Fig. 7 beside its Fig. 9: all measured scars, and all simulated ones
    with the band of the scene's inputs.
    Parameters: `name` of the scene; `names` of the traces; `scars` and `pairs`, one a trace.
    Returns a Figure.
    """
    shown = _spread_distances(sorted({scar.distance_m for scar in scars}), MOST_DISTANCES)
    figure = new_figure(11.0, 3.1 + 2.5 * len(shown) + 0.6)
    rows: Any = figure.subplots(
        len(shown) + 1, 2, squeeze=False, sharex=True, height_ratios=[1.25] + [1.0] * len(shown)
    )
    left, right = rows[0]
    right.sharey(left)
    for k, distance in enumerate(shown):
        colour = LINE_COLOURS[k % len(LINE_COLOURS)]
        members = [i for i, scar in enumerate(scars) if scar.distance_m == distance]
        traces = [(names[i], pair) for i in members if (pair := pairs[i]) is not None]
        _draw_all(left, right, scars[members[0]], traces, colour)
        _draw_distance(rows[k + 1], scars[members[0]], traces, colour)
    half = _BESIDE * 0.5 * max(scar.width_mm for scar in scars)
    left.set_xlim(-half, half)
    left.invert_yaxis()
    style_axes(left, z_label="depth (µm)", title="measured, levelled and aligned")
    style_axes(right, z_label="depth (µm)", title="simulated")
    for axes in rows[0]:
        add_legend(axes, loc="lower right")
    for axes in rows[-1]:
        style_axes(axes, x_label="x (mm)")
    write_head(
        figure,
        f"{plain_name(name)}: measured scars beside simulated ones, bands ± {BAND:g} standard "
        "uncertainties",
    )
    return figure


def _spread_distances(distances: Sequence[float], most: int) -> list[float]:
    """Evenly spaced ones of the distances, the first and the last among them."""
    places = np.linspace(0, len(distances) - 1, min(len(distances), most))
    return [distances[int(k)] for k in np.unique(places.round())]


def scars_panels(
    names: Sequence[str],
    scars: Sequence[SimulatedScar],
    pairs: Sequence[ScarPair | None],
    frames: tuple[int, ...] | None,
) -> PaperPanels:
    """The same for a paper: all measured and all simulated scars, and each distance's.

    Parameters: `names`, `scars`, `pairs` as for `scars_figure`; `frames`, numbers of the distances
    that are shown. Returns PaperPanels. Raises InputError where there is no such distance.
    """
    distances = sorted({scar.distance_m for scar in scars})
    few = [distances.index(s) for s in _spread_distances(distances, _FOR_PAPER)]
    shown = [distances[k] for k in chosen_frames(frames, len(distances), few, items="distances")]
    rows = []
    for k, distance in enumerate(shown):
        members = [i for i, scar in enumerate(scars) if scar.distance_m == distance]
        traces = [(names[i], pair) for i in members if (pair := pairs[i]) is not None]
        rows.append((scars[members[0]], traces, LINE_COLOURS[k % len(LINE_COLOURS)]))
    half = _BESIDE * 0.5 * max(scar.width_mm for scar in scars)

    def within(axes: Axes, draw: Callable[[Axes], None], *, down: bool) -> None:
        draw(axes)
        axes.set_xlim(-half, half)
        if down and not axes.yaxis_inverted():
            axes.invert_yaxis()
        style_axes(axes, x_label="x (mm)", z_label="depth (µm)" if down else "")

    def measured(axes: Axes) -> None:
        for scar, traces, colour in rows:
            if traces:
                _draw_mean(axes, traces, colour, f"{scar.distance_m:g} m")
        add_legend(axes, loc="lower right")

    def simulated(axes: Axes) -> None:
        for scar, _, colour in rows:
            _draw_simulated(axes, scar, colour, lw=LINE_PT, label=f"{scar.distance_m:g} m")

    plots, notes = [], []
    for title, draw in (("measured", measured), ("simulated", simulated)):
        plots.append(Plot(title=title, draw=partial(within, draw=draw, down=True)))
    for scar, traces, colour in rows:
        overlay = partial(_draw_overlay, scar=scar, traces=traces, colour=colour)
        gap = partial(_draw_gap, traces=traces, colour=colour)
        name = f"{scar.distance_m:g} m"
        plots.append(Plot(title=name, draw=partial(within, draw=overlay, down=True)))
        own = partial(within, draw=gap, down=False)
        plots.append(Plot(title=f"{name}, measured − simulated", draw=own))
        notes.append(f"{_area_text(scar, traces)}; {_difference_text(traces)}.")
    notes.append(f"Bands: ± {BAND:g} standard uncertainties.")
    return PaperPanels(plots=plots, notes=notes)


def _draw_all(
    left: Axes,
    right: Axes,
    scar: SimulatedScar,
    traces: Sequence[tuple[str, ScarPair]],
    colour: Any,
) -> None:
    """One distance's lines in the top row: the mean of its traces, and the simulated scar."""
    label = f"{scar.distance_m:g} m"
    if traces:
        _draw_mean(left, traces, colour, label)
    _draw_simulated(right, scar, colour, lw=LINE_PT, label=label)


def _draw_mean(axes: Axes, traces: Sequence[tuple[str, ScarPair]], colour: Any, label: str) -> None:
    """The mean of a distance's traces."""
    x = traces[0][1].x_mm
    each = [np.interp(x, pair.x_mm, pair.trace.depth_um) for _, pair in traces]
    axes.plot(x, np.mean(each, axis=0), color=colour, lw=LINE_PT, label=label)


def _draw_simulated(axes: Axes, scar: SimulatedScar, colour: Any, **line: Any) -> None:
    spread = np.broadcast_to(root_sum_square(scar.moved_um), scar.depth_um.shape)
    draw_band(axes, scar.x_mm, scar.depth_um, spread, colour=colour, **line)


def _draw_distance(
    panels: Sequence[Axes],
    scar: SimulatedScar,
    traces: Sequence[tuple[str, ScarPair]],
    colour: Any,
) -> None:
    """Overlay and difference of one distance."""
    overlay, gap = panels
    _draw_overlay(overlay, scar, traces, colour)
    _draw_gap(gap, traces, colour)
    style_axes(overlay, title=_area_text(scar, traces))
    style_axes(gap, title=_difference_text(traces))


def _draw_overlay(
    overlay: Axes, scar: SimulatedScar, traces: Sequence[tuple[str, ScarPair]], colour: Any
) -> None:
    """The traces of a distance over its simulated scar."""
    _draw_simulated(overlay, scar, INK, lw=BOLD_PT, label="simulated")
    for number, (name, pair) in enumerate(traces):
        tone = {"color": colour, "lw": LINE_PT, "alpha": 1.0 - 0.6 * number / len(traces)}
        overlay.plot(pair.x_mm, pair.trace.depth_um, label=plain_name(name, 24), **tone)
    overlay.invert_yaxis()
    add_legend(overlay, loc="lower right")
    style_axes(overlay, z_label="depth (µm)")


def _draw_gap(gap: Axes, traces: Sequence[tuple[str, ScarPair]], colour: Any) -> None:
    """What the traces of a distance differ by from the simulated scar."""
    for number, (name, pair) in enumerate(traces):
        tone = {"color": colour, "lw": LINE_PT, "alpha": 1.0 - 0.6 * number / len(traces)}
        gap.plot(pair.x_mm, pair.difference_um, label=plain_name(name, 24), **tone)
    gap.axhline(0.0, color=GREY, lw=FINE_PT)
    if traces:
        pair = traces[0][1]
        band = BAND * pair.difference_uncertainty_um
        gap.fill_between(pair.x_mm, -band, band, color=colour, alpha=0.2, lw=0)
    style_axes(gap, z_label="difference (µm)")


def _area_text(scar: SimulatedScar, traces: Sequence[tuple[str, ScarPair]]) -> str:
    """Worn areas, in 1e-3 mm²: the mean of the traces' beside the simulated one."""
    model = simulated_text(
        1e3 * scar.worn_area_mm2, 1e3 * float(root_sum_square(scar.moved_area_mm2))
    )
    head = f"{scar.distance_m:g} m: worn area (1e-3 mm²)"
    if not traces:
        return f"{head}: no clear scar, simulated {model}"
    area = [1e3 * pair.trace.worn_area_mm2 for _, pair in traces]
    spread = [1e3 * pair.trace.worn_area_uncertainty_mm2 for _, pair in traces]
    own = with_uncertainty(float(np.mean(area)), float(np.hypot.reduce(spread)) / len(spread))
    return f"{head} {own}, simulated {model}"


def _difference_text(traces: Sequence[tuple[str, ScarPair]]) -> str:
    if not traces:
        return "measured − simulated: nothing to compare"
    rms = np.mean([pair.rms_um for _, pair in traces])
    chi = np.mean([pair.chi for _, pair in traces])
    return f"measured − simulated: {rms:.2g} µm rms, χ = {chi:.2f}"
