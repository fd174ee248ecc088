"""The picture of a check: the light of each frame, and how much of it is saturated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import (
    LINE_COLOURS,
    LINE_PT,
    NOTE_PT,
    new_figure,
    style_axes,
)
from isochrome.frames.checks.findings import Survey

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def light_figure(light: Survey) -> Figure:
    """The span of the grey levels of each frame, and the share of its pixels at full scale.

    Parameters: `light`. Returns a Figure.
    """
    figure = new_figure(7.5, 4.6)
    panels: Any = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    levels, saturated = panels
    frame = np.arange(len(light.low))
    levels.fill_between(frame, light.low, light.high, color=LINE_COLOURS[0], alpha=0.3, lw=0)
    for name, values in (("98 %", light.high), ("2 %", light.low)):
        levels.plot(frame, values, color=LINE_COLOURS[0], marker="o", ms=3, lw=LINE_PT)
        levels.annotate(
            name,
            (frame[-1], values[-1]),
            xytext=(5, -3),
            textcoords="offset points",
            fontsize=NOTE_PT,
        )
    style_axes(levels, z_label="grey level", title="98 % and 2 % of the pixels are darker")
    share = 100.0 * np.array(light.saturated)
    saturated.plot(frame, share, color=LINE_COLOURS[1], marker="o", ms=3, lw=LINE_PT)
    style_axes(saturated, x_label="frame", z_label="saturated (% of pixels)")
    return figure
