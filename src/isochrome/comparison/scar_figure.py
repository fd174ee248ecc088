"""The picture of scars: measured and simulated ones over x, and what they differ by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.comparison.scar_metrics import ScarPair
from isochrome.comparison.simulated_scars import SimulatedScar, root_sum_square
from isochrome.figures import (
    BAND,
    BOLD_PT,
    FINE_PT,
    GREY,
    INK,
    LINE_COLOURS,
    LINE_PT,
    add_legend,
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
    distances = sorted({scar.distance_m for scar in scars})
    places = np.linspace(0, len(distances) - 1, min(len(distances), MOST_DISTANCES))
    shown = [distances[int(k)] for k in np.unique(places.round())]
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
        x = traces[0][1].x_mm
        each = [np.interp(x, pair.x_mm, pair.trace.depth_um) for _, pair in traces]
        left.plot(x, np.mean(each, axis=0), color=colour, lw=LINE_PT, label=label)
    _draw_simulated(right, scar, colour, lw=LINE_PT, label=label)


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
    _draw_simulated(overlay, scar, INK, lw=BOLD_PT, label="simulated")
    for number, (name, pair) in enumerate(traces):
        tone = {"color": colour, "lw": LINE_PT, "alpha": 1.0 - 0.6 * number / len(traces)}
        overlay.plot(pair.x_mm, pair.trace.depth_um, label=plain_name(name, 24), **tone)
        gap.plot(pair.x_mm, pair.difference_um, **tone)
    overlay.invert_yaxis()
    add_legend(overlay, loc="lower right")
    gap.axhline(0.0, color=GREY, lw=FINE_PT)
    if traces:
        pair = traces[0][1]
        band = BAND * pair.difference_uncertainty_um
        gap.fill_between(pair.x_mm, -band, band, color=colour, alpha=0.2, lw=0)
    style_axes(overlay, z_label="depth (µm)", title=_area_text(scar, traces))
    style_axes(gap, z_label="difference (µm)", title=_difference_text(traces))


def _area_text(scar: SimulatedScar, traces: Sequence[tuple[str, ScarPair]]) -> str:
    """Worn areas, in 1e-3 mm²: the mean of the traces' beside the simulated one."""
    model = with_uncertainty(
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
