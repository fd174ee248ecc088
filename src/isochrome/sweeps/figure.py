"""The picture of a sweep: what its points give over the first of the varied keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import (
    LINE_COLOURS,
    LINE_PT,
    add_legend,
    new_figure,
    style_axes,
    write_head,
)
from isochrome.output import numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN = {"n_max": "largest fringe order", "p_max_mpa": "largest pressure (MPa)"}
"""Columns that are drawn, where they are known, and what stands at their axes."""

_MARKERS = "os^vD*"


def sweep_figure(keys: tuple[str, ...], table: Mapping[str, list[Any]]) -> Figure:
    """Largest order and pressure of the last state, a line for each value of the other keys.

    Parameters: `keys` that were varied; `table`, the columns of sweep.csv. Returns a Figure.
    """
    names = [name for name in DRAWN if np.isfinite(numbers(table[name])).any()]
    figure = new_figure(4.8 * len(names) + 0.4, 3.8)
    state = numbers(table["state"])
    last = state == state.max()
    x = numbers(table[keys[0]])[last]
    others = np.array([numbers(table[key])[last] for key in keys[1:]]).reshape(-1, len(x))
    lines = np.unique(others, axis=1).T if len(keys) > 1 else np.zeros((1, 0))
    axes: Any = figure.subplots(1, len(names), squeeze=False)
    for axis, name in zip(axes[0], names, strict=True):
        y = numbers(table[name])[last]
        for k, line in enumerate(lines):
            own = (others == line[:, None]).all(axis=0)
            look = {"color": LINE_COLOURS[k % 6], "marker": _MARKERS[k // 6 % 6]}
            label = ", ".join(f"{key} = {v:g}" for key, v in zip(keys[1:], line, strict=True))
            axis.plot(x[own], y[own], lw=LINE_PT, ms=4, label=label or None, **look)
        style_axes(axis, x_label=keys[0], z_label=DRAWN[name])
    if 1 < len(lines) <= 12:
        add_legend(axes[0, 0])
    write_head(figure, f"last of {int(state.max()) + 1} states" if state.max() else "one state")
    return figure
