"""What a run of `isochrome bench` shows: the table in plain text, and the figure."""

import os
import platform
from collections.abc import Sequence

import numpy as np

from . import series
from .common import plain
from .rows import Row


def table(rows: list[Row]) -> str:
    """The rows as a table in plain text, with a line on how it was measured."""
    head = ("case", "method", "setting", "error", "time", "ratio")
    cells = [(r.case, r.method, r.setting, _error(r), _time(r), _ratio(r)) for r in rows]
    return "\n".join([*lines_of(head, cells, texts=3), "", _FOOT, machine()])


def lines_of(head: tuple[str, ...], cells: Sequence[tuple[str, ...]], *, texts: int) -> list[str]:
    """A table's lines, an empty one where the first column changes; `texts` columns stand to the
    left."""
    widths = [max(len(row[k]) for row in (head, *cells)) for k in range(len(head))]
    lines, last = [], ""
    for row in (head, *cells):
        if row[0] != last:
            lines += [""] if last else []
            last = row[0]
        words = [f"{text:<{w}}" for text, w in zip(row[:texts], widths[:texts], strict=True)]
        words += [f"{text:>{w}}" for text, w in zip(row[texts:], widths[texts:], strict=True)]
        lines.append("  ".join(words).rstrip())
    return lines


def of_seeds(judged, kind, seeds, quick):
    """A row for each seed's frame of a kind, or with `quick` for the first."""
    return [judged(kind, seed) for seed in (seeds[:1] if quick else seeds)]


_FOOT = """\
ratio: time of the fastest setting of the paper's procedure at the same or smaller error over ours,
on the same grid; in brackets where none is as accurate: to the most accurate one.
Where the paper's procedure also stands in a faster form than the plain one (wear: CG stopped early;
stress: by lags) the ratio is to whichever is faster, and the setting tells that to the plain one.
Errors are relative: of p over p0 in the middle half of a static contact, of p_max and depth in a
worn one, of the field over p0. Frames' are of the order (fringes).
Medians of five after a warm-up, taken in turns (over two seconds: fewer); set-up not included."""


def machine() -> str:
    """What the times are those of."""
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def _error(row: Row) -> str:
    return f"{row.error:.1e}" if row.error == row.error else "-"


def _time(row: Row) -> str:
    if row.seconds != row.seconds:
        return "-"
    return f"{row.seconds:.3g} s" if row.seconds >= 1.0 else f"{1e3 * row.seconds:.3g} ms"


def _ratio(row: Row) -> str:
    if row.ratio != row.ratio:
        return ""
    return plain(row.ratio) if row.reached else f"({plain(row.ratio)})"


def figure(rows: list[Row]):
    """Time against error, log-log, one panel each for pressure, wear and stress."""
    from isochrome.figures import new_figure, style_axes

    picture = new_figure(13.0, 5.2)
    panels = zip(picture.subplots(1, len(series.PANELS)), series.PANELS.items(), strict=True)
    for axes, (title, (x_label, columns, make)) in panels:
        for line in make(rows):
            _draw(axes, line)
        style_axes(axes, x_label=x_label, z_label="time (ms)", title=title)
        axes.grid(alpha=0.3, lw=0.5)
        axes.set_axisbelow(True)
        axes.margins(0.08, 0.10)
        _name_below(axes, columns)
    picture.suptitle("Time against error: below and to the left is better", fontsize=11)
    return picture


def share_figure(pairs, legend, x_label, title, *, mark=None, z_label="share of frames"):
    """Share of each group's values within so much, of pairs (group, value); with a `mark`, a line
    at it, on a logarithmic axis."""
    from isochrome.figures import LINE_COLOURS, new_figure, style_axes

    picture = new_figure(8.0, 5.0)
    axes = picture.subplots()
    for group, colour in zip(dict.fromkeys(name for name, _ in pairs), LINE_COLOURS, strict=False):
        values = sorted(value for name, value in pairs if name == group)
        share = np.arange(1, len(values) + 1) / len(values)
        axes.step(values, share, where="post", color=colour, label=group)
    if mark is not None:
        axes.axvline(mark, color="0.5", lw=0.8, ls="--")
        axes.set_xscale("log")
    axes.legend(title=legend, frameon=False)
    style_axes(axes, x_label=x_label, z_label=z_label, title=title)
    return picture


def _draw(axes, line: series.Series) -> None:
    points = sorted((r.error, 1e3 * r.seconds) for r in line.rows)
    axes.loglog(
        *zip(*points, strict=True), label=line.name, color=line.colour, marker=line.marker,
        markerfacecolor="white" if line.hollow else line.colour, linestyle=line.dashes,
        ms=line.size, lw=1.2,
    )  # fmt: skip


def _name_below(axes, columns: int) -> None:
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.48, -0.17), frameon=False, fontsize="small",
        ncols=columns, columnspacing=1.0, handlelength=2.4,
    )  # fmt: skip
