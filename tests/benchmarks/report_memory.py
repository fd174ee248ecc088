"""What a run of `isochrome bench memory` shows: the table in plain text, and the figure."""

from isochrome.figures import LINE_COLOURS

from .report import lines_of, machine
from .rows import MemoryRow

HEAD = ("command", "items", "count", "peak memory", "more", "time")
MOST = 0.10
"""What a long run may take more than a short one."""

_FOOT = f"""\
Peak memory of the whole process, libraries and figure included; more: than the shortest run of the
same command; to be seen: {100 * MOST:.0f} % at most."""


def table(rows: list[MemoryRow]) -> str:
    """The rows as a table in plain text, with what they mean."""
    cells = [
        (row.command, row.items, str(row.count), f"{row.peak_mb:.1f} MB", f"{100 * more:+.1f} %",
         f"{row.seconds:.1f} s")
        for row, more in zip(rows, _more(rows), strict=True)
    ]  # fmt: skip
    return "\n".join([*lines_of(HEAD, cells, texts=2), "", _FOOT, machine()])


def _more(rows: list[MemoryRow]) -> list[float]:
    """What each takes more than the first of its command, relative."""
    first: dict[str, float] = {}
    return [row.peak_mb / first.setdefault(row.command, row.peak_mb) - 1.0 for row in rows]


def figure(rows: list[MemoryRow]):
    """Peak memory, a bar for each run."""
    from isochrome.figures import new_figure, style_axes

    picture = new_figure(8.0, 0.45 * len(rows) + 1.4)
    axes = picture.subplots()
    names = [f"{row.command}: {row.count} {row.items}" for row in rows]
    bars = axes.barh(names, [row.peak_mb for row in rows], color=LINE_COLOURS[0])
    axes.bar_label(bars, [f"{100 * more:+.1f} %" for more in _more(rows)], padding=3, fontsize=9)
    axes.invert_yaxis()
    axes.margins(x=0.15)
    style_axes(axes, x_label="peak memory (MB)", title="Long runs beside short ones")
    return picture
