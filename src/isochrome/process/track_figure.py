"""The picture of a tracked video: each value over the frames with its band, and some key frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.figures import LINE_COLOURS, new_figure, plain_name, style_axes
from isochrome.fit.over_distance import BAND
from isochrome.output import numbers
from isochrome.process.figure import Shown, draw_frames, frames_size
from isochrome.process.followed import SEARCHED
from isochrome.process.processed import PICTURE
from isochrome.process.result import SPREAD
from isochrome.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS = 1600
"""Frames that are drawn: twice as many as a panel has pixels across."""
_WIDTH, _PANEL = 7.4, 1.9


def tracked_figure(scene: Scene, table: Mapping[str, list[Any]], items: list[Shown]) -> Figure:
    """Tracked values with their bands and chi, and beside them some key frames.

    Parameters: `scene`; `table`, the columns of frames.csv; `items`, the key frames to be shown.
    Returns a Figure.
    """
    keys = [name for name in table if f"{name} {SPREAD}" in table]
    wide, high = frames_size(items)
    figure = new_figure(_WIDTH + wide, max(high, _PANEL * (len(keys) + 1)) + 0.3)
    parts: Any = figure.subfigures(1, 2, width_ratios=(_WIDTH, wide))
    left, right = parts
    axes: list[Any] = list(left.subplots(len(keys) + 1, 1, sharex=True, squeeze=False).flat)
    distance = numbers(table["distance_m"])
    slid = bool(np.isfinite(distance).all() and np.ptp(distance) > 0.0)
    x = distance if slid else np.arange(len(distance), dtype=float)
    whole = np.array([at is not None for at in table[PICTURE]])
    again = np.array([found == SEARCHED for found in table["found_by"]])
    for axis, key in zip(axes, keys, strict=False):
        values, spread = numbers(table[key]), numbers(table[f"{key} {SPREAD}"])
        _draw(axis, x, values, spread, whole, again)
        told = spread[np.isfinite(spread) & ~whole]
        said = f"median u = {np.median(told):.2g}" if told.size else ""
        style_axes(axis, z_label=key, title=said)
    chi = numbers(table["chi"])
    _draw(axes[-1], x, chi, np.zeros_like(chi), whole, again)
    across = "sliding distance (m)" if slid else "frame"
    style_axes(axes[-1], x_label=across, z_label="chi")
    left.suptitle(
        f"tracked values, band ± {BAND:g} standard uncertainties\n"
        "dots: key frames; circles: found by a full search",
        fontsize=10,
    )
    right.suptitle(f"key frames, normalised; {draw_frames(right, items)}", fontsize=10)
    figure.suptitle(
        f"{plain_name(scene.name)}: {len(x)} frames, {int(whole.sum())} of them key frames"
    )
    return figure


def _draw(
    axis: Any,
    x: NDArray[Any],
    values: NDArray[Any],
    spread: NDArray[Any],
    whole: NDArray[np.bool_],
    again: NDArray[np.bool_],
) -> None:
    """One quantity over the frames."""
    thin = slice(None, None, -(-len(x) // _POINTS))
    band = BAND * np.where(np.isfinite(spread), spread, np.nan)[thin]
    low, high = values[thin] - band, values[thin] + band
    axis.fill_between(x[thin], low, high, color=LINE_COLOURS[0], alpha=0.35, lw=0)
    axis.plot(x[thin], values[thin], color=LINE_COLOURS[0], lw=0.7)
    axis.plot(x[whole], values[whole], ".", color="black", ms=4)
    axis.plot(x[again], values[again], "o", mfc="none", color=LINE_COLOURS[1], ms=5)
    axis.ticklabel_format(axis="y", useOffset=False)
