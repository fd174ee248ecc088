"""The picture of a campaign: load and friction of each recording, and how they went in it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import (
    BAND,
    FINE_PT,
    GREY,
    KEY_LABELS,
    LINE_COLOURS,
    LINE_PT,
    VALUE_MAP,
    PaperPanels,
    Plot,
    chosen_frames,
    draw_band,
    new_figure,
    plain_name,
    style_axes,
    write_head,
)
from isochrome.output import counted
from isochrome.processing import SPREAD

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from isochrome.campaigns.api import Outcome

DRAWN = ("load.normal_n", "friction.coefficient")
"""Fitted keys that are drawn."""

_BANDED = 12
"""Recordings whose bands can be told apart; of more, lines alone are drawn."""

_NAMED = 30
"""Recordings whose names have room below an axis; more are counted."""

_LONGEST = 22
"""Letters of a name that are shown."""


def summary_figure(name: str, outcomes: Sequence[Outcome]) -> Figure | None:
    """Values over recordings, and within each over the distance, or the frames, with bands.

    None where no recording has a fitted load or friction.
    """
    keys = [key for key in DRAWN if any(f"{key} mean" in item.row for item in outcomes)]
    if not keys:
        return None
    figure = new_figure(11.0, 3.0 * len(keys) + 1.2)
    axes: Any = figure.subplots(
        len(keys), 2, squeeze=False, sharex="col", sharey="row", width_ratios=(3, 4)
    )
    colours = _colours(len(outcomes))
    slid = any(_moves(item) for item in outcomes)
    for (left, right), key in zip(axes, keys, strict=True):
        _over_recordings(left, key, outcomes, colours)
        _within(right, key, outcomes, colours, "distance_m" if slid else "frame")
        left.ticklabel_format(axis="y", useOffset=False)
        style_axes(left, z_label=KEY_LABELS[key])
        style_axes(right)
    style_axes(axes[0, 0], title="mean, and scatter over the frames (standard deviation)")
    band = f", band ± {BAND:g} standard uncertainties" if len(outcomes) <= _BANDED else ""
    style_axes(axes[0, 1], title=f"each frame{band}")
    _name(axes[-1, 0], outcomes)
    style_axes(axes[-1, 1], x_label="sliding distance (m)" if slid else "frame")
    failed = sum(item.row["status"] == "failed" for item in outcomes)
    head = f"{plain_name(name)}: {counted(len(outcomes), 'recording')}"
    write_head(figure, f"{head}, {failed} of them failed" if failed else head)
    return figure


def campaign_panels(
    outcomes: Sequence[Outcome], recordings: tuple[int, ...] | None
) -> PaperPanels | None:
    """The plots of a campaign for a paper, as in `summary_figure`; None where none has values.

    `recordings` are the numbers of those that are shown, by default all.
    """
    every = range(len(outcomes))
    rows = chosen_frames(recordings, len(outcomes), every, items="recordings")
    chosen = [outcomes[k] for k in rows]
    keys = [key for key in DRAWN if any(f"{key} mean" in item.row for item in chosen)]
    if not keys:
        return None
    colours, slid = _colours(len(chosen)), any(_moves(item) for item in chosen)

    def over(key: str, axes: Axes) -> None:
        _over_recordings(axes, key, chosen, colours)
        # below the axis, which rows of the summary the recordings are, from 1
        places = range(0, len(rows), -(-len(rows) // 8))
        axes.set_xlim(-0.6, len(rows) - 0.4)
        axes.set_xticks(places, [str(rows[k] + 1) for k in places])
        style_axes(axes, x_label="recording", z_label=KEY_LABELS[key])

    def within(key: str, axes: Axes) -> None:
        _within(axes, key, chosen, colours, "distance_m" if slid else "frame")
        label = "sliding distance (m)" if slid else "frame"
        style_axes(axes, x_label=label, z_label=KEY_LABELS[key])

    draws = (("mean", over), ("each frame", within))
    plots = [Plot(title=title, draw=partial(draw, key)) for key in keys for title, draw in draws]
    named = [f"{k + 1} {plain_name(str(outcomes[k].row['folder']), _LONGEST)}" for k in rows]
    note = "Recordings: " + ("; ".join(named) if len(rows) <= _NAMED else "as in summary.csv")
    return PaperPanels(plots=plots, plots_across=2, notes=(note,))


def _moves(item: Outcome) -> bool:
    """Whether a recording's frames stand at several distances."""
    known = item.curves.get("distance_m", np.empty(0))
    known = known[np.isfinite(known)]
    return bool(known.size and np.ptp(known) > 0.0)


def _colours(count: int) -> list[Any]:
    """A colour for each recording: told apart where they are few, else going with their order."""
    if count <= len(LINE_COLOURS):
        return list(LINE_COLOURS[:count])
    from matplotlib import colormaps

    return list(colormaps[VALUE_MAP](np.linspace(0.0, 0.92, count)))


def _over_recordings(
    axes: Axes, key: str, outcomes: Sequence[Outcome], colours: Sequence[Any]
) -> None:
    """Means with the scatter over the frames; a cross at the foot where nothing was found."""
    for place, (item, colour) in enumerate(zip(outcomes, colours, strict=True)):
        mean = item.row.get(f"{key} mean")
        if mean is None:
            foot = axes.get_xaxis_transform()
            axes.plot(place, 0.03, "x", color=GREY, ms=5, transform=foot, clip_on=False)
            continue
        scatter = item.row[f"{key} standard_deviation"] or 0.0
        axes.errorbar(
            place, mean, yerr=scatter, fmt="o", color=colour, ms=4.5, capsize=3, lw=LINE_PT
        )


def _within(
    axes: Axes, key: str, outcomes: Sequence[Outcome], colours: Sequence[Any], across: str
) -> None:
    """A key's course in each recording."""
    few = len(outcomes) <= _BANDED
    for item, colour in zip(outcomes, colours, strict=True):
        if key not in item.curves:
            continue
        x, y = item.curves[across], item.curves[key]
        marker = "o" if len(x) < 15 else None
        if few:
            spread = item.curves[f"{key} {SPREAD}"]
            draw_band(axes, x, y, spread, colour=colour, lw=LINE_PT, marker=marker, ms=3)
        else:
            axes.plot(x, y, color=colour, lw=FINE_PT, alpha=0.7, marker=marker, ms=3)


def _name(axes: Axes, outcomes: Sequence[Outcome]) -> None:
    """The recordings' names below the axis, or their rows in the summary."""
    axes.set_xlim(-0.6, len(outcomes) - 0.4)
    if len(outcomes) > _NAMED:
        axes.xaxis.set_major_formatter(lambda place, _: f"{place + 1:g}")
        axes.set_xticks(range(0, len(outcomes), -(-len(outcomes) // 8)))
        style_axes(axes, x_label="recording, as counted in summary.csv (cross: nothing was found)")
        return
    names = [plain_name(str(item.row["folder"]), _LONGEST) for item in outcomes]
    axes.set_xticks(range(len(names)), names, rotation=90 if len(names) > 4 else 20)
    style_axes(axes, x_label="recording (cross: nothing was found)")
