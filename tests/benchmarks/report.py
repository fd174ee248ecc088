"""What a run of `isochrome bench` shows: the table in plain text, and the figure."""

from __future__ import annotations

import os
import platform
from typing import TYPE_CHECKING

from isochrome.bench import Row

from .common import OURS, PAPER

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANELS = ("pressure", "wear", "stress")


def table(rows: list[Row]) -> str:
    """The rows as a table in plain text, with a line on how it was measured."""
    head = ("case", "method", "setting", "error", "time", "ratio")
    cells = [(r.case, r.method, r.setting, _error(r), _time(r), _ratio(r)) for r in rows]
    widths = [max(len(row[k]) for row in (head, *cells)) for k in range(len(head))]
    lines, last = [], ""
    for row in (head, *cells):
        if row[0] != last:
            lines += [""] if last else []
            last = row[0]
        words = [f"{text:<{w}}" for text, w in zip(row[:3], widths[:3], strict=True)]
        words += [f"{text:>{w}}" for text, w in zip(row[3:], widths[3:], strict=True)]
        lines.append("  ".join(words).rstrip())
    return "\n".join([*lines, "", _FOOT, _machine()])


_FOOT = """\
ratio: time of the fastest setting of the paper's procedure at the same or smaller error over ours,
on the same grid; in brackets where none is as accurate: to its most accurate one.
Medians of five after a warm-up, taken in turns (over two seconds: fewer); set-up not included."""


def _machine() -> str:
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def _error(row: Row) -> str:
    return f"{row.error:.1e}" if row.error == row.error else "-"


def _time(row: Row) -> str:
    return f"{1e3 * row.seconds:.3g} ms" if row.seconds == row.seconds else "-"


def _ratio(row: Row) -> str:
    if row.ratio != row.ratio:
        return ""
    return f"{row.ratio:.2g}" if row.reached else f"({row.ratio:.2g})"


def figure(rows: list[Row]) -> Figure:
    """Time against error, log-log, one panel each for pressure, wear and stress.

    A colour a method, a marker a case; below and to the left is better.
    """
    from matplotlib.lines import Line2D

    from isochrome.figures import LINE_COLOURS, TEXT_PT, TICK_PT, new_figure, style_axes

    picture = new_figure(12.5, 4.8)
    colours = {PAPER: LINE_COLOURS[1], OURS: LINE_COLOURS[0]}
    for axes, name in zip(picture.subplots(1, len(_PANELS)), _PANELS, strict=True):
        known = [r for r in rows if r.case.startswith(name) and r.error == r.error]
        cases = list(dict.fromkeys(r.case for r in known))
        keys = []
        for case, marker in zip(cases, "osD^vP", strict=False):
            keys.append(Line2D([], [], color="0.4", ls="", marker=marker, ms=5.0))
            for method, colour in colours.items():
                group = [r for r in known if (r.case, r.method) == (case, method)]
                line = sorted((r.error, 1e3 * r.seconds) for r in group)
                style = {"color": colour, "marker": marker, "ms": 5.0, "lw": 1.1, "alpha": 0.85}
                axes.loglog(*zip(*line, strict=True), **style)
        style_axes(axes, x_label="error (relative)", z_label="time (ms)", title=name)
        axes.grid(alpha=0.3, lw=0.5)
        labels = [case.removeprefix(name).lstrip(", ") for case in cases]
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "frameon": False}
        axes.legend(keys, labels, fontsize=TICK_PT, **below)
    lines = [Line2D([], [], color=colour, lw=2.0) for colour in colours.values()]
    picture.legend(lines, list(colours), loc="outside upper right", ncols=2, fontsize=TEXT_PT)
    picture.suptitle("Time against error: below and to the left is better", fontsize=11)
    return picture
