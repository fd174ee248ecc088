"""The picture of what changes from frame to frame: values over distance, each with its band."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import LINE_COLOURS, new_figure, plain_name, style_axes
from isochrome.fit.result import Fit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BAND = 2.0
"""Half-width of a band, in standard uncertainties."""

_COLUMNS = 3
_LABELS = {
    "friction.coefficient": "friction coefficient",
    "load.normal_n": "normal load (N)",
    "camera.left_mm": "left edge of the picture (mm)",
    "camera.top_mm": "top edge of the picture (mm)",
    "wear.coefficient_mm2_per_n": "wear coefficient since the last frame (mm²/N)",
}


def over_distance_figure(name: str, result: Fit) -> Figure | None:
    """Each per-frame key over the sliding distance, and the wear between frames with its laws.

    Parameters: `name` of the scene; `result`. Returns a Figure, None where nothing is per frame.
    """
    keys = list(dict.fromkeys(key for own in result.frames for key in own))
    count = len(keys) + (result.wear_laws is not None)
    if len(result.frames) < 2 or not count:
        return None
    columns = min(_COLUMNS, -(-count // -(-count // _COLUMNS)))
    rows = -(-count // columns)
    figure = new_figure(4.6 * columns, 3.5 * rows + 0.4)
    axes: list[Any] = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axis, key in zip(axes, keys, strict=False):
        _values(axis, key, result)
    if result.wear_laws is not None:
        _wear(axes[len(keys)], result)
    for axis in axes[count:]:
        axis.set_axis_off()
    figure.suptitle(
        f"{plain_name(name)}: values of each frame, band ± {BAND:g} standard uncertainties"
    )
    return figure


def _values(axis: Axes, key: str, result: Fit) -> None:
    """One key: points with their band, over distance where every frame has one."""
    having = [i for i, own in enumerate(result.frames) if key in own]
    slid = any(result.distance_m[i] is not None for i in having)
    still = [i for i in having if slid and result.distance_m[i] is None]
    moving = [i for i in having if i not in still]
    place = {i: result.distance_m[i] or 0.0 if slid else float(i) for i in having}
    moving.sort(key=place.__getitem__)
    looks: list[tuple[list[int], dict[str, Any]]] = [(moving, {"marker": "o", "lw": 1.0})]
    if still:
        looks.append((still, {"marker": "s", "mfc": "white", "lw": 0.0, "elinewidth": 1.0}))
    for frames, look in looks:
        x = np.array([place[i] for i in frames])
        y, spread = (
            np.array([result.frames[i][key][part] for i in frames])
            for part in ("value", "standard_uncertainty")
        )
        band = BAND * spread
        axis.fill_between(x, y - band, y + band, color=LINE_COLOURS[0], alpha=0.3, lw=0)
        axis.errorbar(x, y, yerr=band, color=LINE_COLOURS[0], ms=4, capsize=2.5, **look)
    median = np.median([result.frames[i][key]["standard_uncertainty"] for i in having])
    said = f"median u = {float(median):.2g}" + (" (square: static)" * bool(still))
    across = "sliding distance (m)" if slid else "frame"
    style_axes(axis, x_label=across, z_label=_LABELS.get(key, key), title=said)
    axis.ticklabel_format(axis="y", useOffset=False)


def _wear(axis: Axes, result: Fit) -> None:
    """What was worn between the frames, with its band, and what each law gives there."""
    assert result.wear_laws is not None
    between = result.wear_laws.between
    edges = np.array([item["from_m"] for item in between] + [between[-1]["to_m"]])
    value, spread = (
        np.array([item[part] for item in between]) for part in ("value", "standard_uncertainty")
    )
    low, high = (np.repeat(value + sign * BAND * spread, 2) for sign in (-1.0, 1.0))
    x = np.repeat(edges, 2)[1:-1]
    axis.fill_between(x, low, high, color="0.35", alpha=0.35, lw=0)
    axis.stairs(value, edges, color="0.15", lw=1.5, baseline=None, label="between frames")
    for law, colour, style in zip(
        result.wear_laws.laws, LINE_COLOURS[1:], ("--", "-.", ":", (0, (6, 1))), strict=False
    ):
        label = f"{law.law}: ln Z {law.log_evidence:+.3g}" if law.log_evidence else law.law
        axis.stairs(law.between, edges, color=colour, ls=style, lw=1.3, baseline=None, label=label)
    style_axes(
        axis,
        x_label="sliding distance (m)",
        z_label="mean wear coefficient (mm²/N)",
        title="worn between frames, and by each law",
    )
    axis.legend(frameon=False, fontsize=7.5)
