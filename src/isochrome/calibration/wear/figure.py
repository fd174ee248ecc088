"""The picture of a wear calibration: traces, levelled scars, worn areas, k over the distance."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.calibration.wear.result import WearCalibration
from isochrome.calibration.wear.worn_volumes import TraceScar
from isochrome.figures import (
    BAND,
    GREY,
    INK,
    LINE_COLOURS,
    LINE_PT,
    PALE,
    PaperPanels,
    Plot,
    add_legend,
    budget_plot,
    chosen_frames,
    data_name,
    draw_band,
    draw_budget,
    new_figure,
    plain_name,
    style_axes,
    write_head,
)
from isochrome.output import with_uncertainty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_ROWS = 6
"""Distances whose traces are drawn, the first ones."""

_FOR_PAPER = 4
"""Those of a figure for a paper where nobody names them."""

_UNIT = 1e-9
"""Coefficients are drawn in 1e-9 mm²/N."""


def wear_figure(calibration: WearCalibration) -> Figure:
    """Draw the traces as measured and levelled, a row a distance, and k over the distance.

    Parameters: `calibration`. Returns a Matplotlib Figure; save it with `output.write_figure`.
    """
    distances = list(dict.fromkeys(scar.test.distance_m for scar in calibration.traces))[:MOST_ROWS]
    rows = len(distances) + 1
    figure = new_figure(13.0, 2.5 * len(distances) + 4.4)
    panels: Any = figure.subplots(
        rows, 2, squeeze=False, width_ratios=[1, 1.25], height_ratios=[1.0] * (rows - 1) + [1.35]
    )
    for place, (raw, level) in zip(distances, panels[:-1], strict=True):
        scars = [scar for scar in calibration.traces if scar.test.distance_m == place]
        _draw_raw(raw, scars, f"{place:g} m: as measured, less the line through the ends")
        _draw_levelled(level, scars)
    for axes in panels[len(distances) - 1, :] if distances else ():
        axes.set_xlabel("x (mm)")
    _draw_coefficients(panels[-1, 0], calibration)
    parts = {item.input: item.contribution / _UNIT for item in calibration.budget}
    draw_budget(
        panels[-1, 1], parts, x_label="contribution to u (1e-9 mm²/N)", title="uncertainty budget"
    )
    write_head(figure, "    ".join(_values(calibration)))
    return figure


def _values(calibration: WearCalibration) -> tuple[str, str, str]:
    """The coefficient, its interval and its law, in words."""
    k, u = calibration.coefficient_mm2_per_n / _UNIT, calibration.standard_uncertainty / _UNIT
    low, high = (edge / _UNIT for edge in calibration.interval_95)
    value = f"k = {with_uncertainty(k, u)} e-9 mm²/N by Archard's law"
    return value, f"95 %: {low:.4g} to {high:.4g}", f"law by evidence: {calibration.law}"


def wear_panels(calibration: WearCalibration, frames: tuple[int, ...] | None) -> PaperPanels:
    """The same for a paper: levelled scars, k over the distance, and the budget.

    Parameters: `calibration`; `frames`, numbers of the distances that are shown. Returns
    PaperPanels. Raises InputError where there is no such distance.
    """
    distances = list(dict.fromkeys(scar.test.distance_m for scar in calibration.traces))
    few = range(min(len(distances), _FOR_PAPER))
    shown = [distances[k] for k in chosen_frames(frames, len(distances), few, items="distances")]

    def scar(axes: Axes, place: float) -> None:
        _draw_levelled(axes, [s for s in calibration.traces if s.test.distance_m == place])
        axes.set_xlabel("x (mm)")

    plots = [
        Plot(
            title=f"{place:g} m",
            draw=partial(scar, place=place),
            spare=int(frames is None and 0 < k < len(shown) - 1),  # the ends tell the most
        )
        for k, place in enumerate(shown)
    ]
    parts = {item.input: item.contribution / _UNIT for item in calibration.budget}
    plots += [
        Plot(title="V/(P s)", draw=partial(_draw_coefficients, calibration=calibration)),
        budget_plot("uncertainty budget", parts, unit="1e-9 mm²/N"),
    ]
    notes = ["; ".join(_values(calibration)) + ".", f"Bands: ± {BAND:g} standard uncertainties."]
    return PaperPanels(plots=plots, notes=notes)


def _draw_raw(axes: Any, scars: list[TraceScar], title: str) -> None:
    for scar, colour in zip(scars, _colours(len(scars)), strict=True):
        one = scar.levelled
        if one is None:
            continue
        z = one.level_um - one.depth_um
        line = np.interp(one.x_mm, one.x_mm[[0, -1]], z[[0, -1]])
        axes.plot(one.x_mm, z - line, color=colour, lw=LINE_PT, label=plain_name(scar.test.file))
        axes.plot(one.x_mm, one.level_um - line, color=INK, lw=LINE_PT, ls=":")
    style_axes(axes, z_label="height (µm)", title=title)
    if any(scar.levelled for scar in scars):
        add_legend(axes)


def _draw_levelled(axes: Any, scars: list[TraceScar]) -> None:
    """Depths from the scars' middles, downward, with the worn areas and the edges."""
    clear = [scar for scar in scars if scar.levelled is not None]
    found = [scar.levelled for scar in clear if scar.levelled is not None]
    names = [plain_name(scar.test.file, 24) for scar in clear]
    for one, name, colour in zip(found, names, _colours(len(found)), strict=True):
        x = one.x_mm - one.centre_mm
        axes.plot(x, -one.depth_um, color=colour, lw=LINE_PT, label=name)
        for edge, u in zip(one.edges_mm, one.edge_uncertainty_mm, strict=True):
            place = edge - one.centre_mm
            axes.axvspan(place - BAND * u, place + BAND * u, color=colour, alpha=0.12, lw=0)
    if found:
        first = found[0]
        inside = (first.x_mm >= first.window_mm[0]) & (first.x_mm <= first.window_mm[1])
        x = first.x_mm - first.centre_mm
        axes.fill_between(x, -first.depth_um, 0.0, where=inside, color=PALE, lw=0, zorder=0)
        half = first.width_mm
        axes.set_xlim(-1.5 * half, 1.5 * half)
    axes.axhline(0.0, color=GREY, lw=LINE_PT)
    areas = [
        with_uncertainty(1e3 * one.worn_area_mm2, 1e3 * one.worn_area_uncertainty_mm2)
        for one in found
    ]
    text = "worn area (1e-3 mm²): " + ", ".join(areas) if areas else "no clear scar"
    style_axes(axes, z_label="height over the level (µm)", title=text)


def _draw_coefficients(axes: Any, calibration: WearCalibration) -> None:
    """Each distance's k with two standard uncertainties, and the band of all together."""
    rows = calibration.by_distance
    s = np.array([row.volume.distance_m for row in rows])
    k = np.array([row.coefficient_mm2_per_n for row in rows]) / _UNIT
    u = np.array([row.standard_uncertainty for row in rows]) / _UNIT
    ends = np.array([0.0, 1.08 * s.max()])
    value, spread = calibration.coefficient_mm2_per_n, calibration.standard_uncertainty
    together = data_name("all distances")
    draw_band(axes, ends, np.full(2, value / _UNIT), np.full(2, spread / _UNIT), label=together)
    look: dict[str, Any] = {"fmt": "o", "color": LINE_COLOURS[1], "lw": LINE_PT, "capsize": 3}
    axes.errorbar(s, k, yerr=BAND * u, label=data_name("each distance"), **look)
    axes.set_xlim(*ends)
    style_axes(
        axes,
        x_label="sliding distance (m)",
        z_label="k (1e-9 mm²/N)",
        title="V/(P s) at each distance, ± 2 u, and of all",
    )


def _colours(count: int) -> list[Any]:
    return [LINE_COLOURS[k % len(LINE_COLOURS)] for k in range(count)]
