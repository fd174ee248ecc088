"""The picture of a track: each key over the frames or the distance, with its band, and chi."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import LINE_COLOURS, new_figure, plain_name, style_axes
from isochrome.fit.over_distance import BAND

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from isochrome.fit.track_result import Track

_POINTS = 4000
"""Frames that are drawn: more than a figure has pixels across."""


def track_figure(name: str, result: Track) -> Figure:
    """Each tracked key with its band, and chi; frames that were searched for are marked.

    Parameters: `name` of the scene; `result`. Returns a Figure.
    """
    count = len(result.keys) + 1
    figure = new_figure(9.0, 2.3 * count + 0.5)
    axes: list[Any] = list(figure.subplots(count, 1, sharex=True, squeeze=False).flat)
    slid = np.isfinite(result.distance_m).all() and len(result.chi) > 1
    x = result.distance_m if slid else np.arange(len(result.chi))
    shown = slice(None, None, -(-len(x) // _POINTS))
    again = list(result.searched)
    for axis, key, y, spread in zip(
        axes, result.keys, result.values.T, result.standard_uncertainty.T, strict=False
    ):
        band = BAND * np.where(np.isfinite(spread), spread, np.nan)[shown]
        axis.fill_between(
            x[shown], y[shown] - band, y[shown] + band, color=LINE_COLOURS[0], alpha=0.35, lw=0
        )
        axis.plot(x[shown], y[shown], color=LINE_COLOURS[0], lw=0.9)
        axis.plot(x[again], y[again], "o", mfc="none", color=LINE_COLOURS[1], ms=5)
        told = spread[np.isfinite(spread)]
        said = f"median u = {np.median(told):.2g}" if told.size else "not told"
        style_axes(axis, x_label="", z_label=key, title=said)
        axis.ticklabel_format(axis="y", useOffset=False)
    axes[-1].plot(x[shown], result.chi[shown], color="0.3", lw=0.9)
    axes[-1].plot(x[again], result.chi[again], "o", mfc="none", color=LINE_COLOURS[1], ms=5)
    across = "sliding distance (m)" if slid else "frame"
    style_axes(axes[-1], x_label=across, z_label="chi", title="circles: found by a full search")
    figure.suptitle(f"{plain_name(name)}: tracked values, band ± {BAND:g} standard uncertainties")
    return figure
