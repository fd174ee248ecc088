"""What a run of `isochrome bench tolerance` shows: the table in plain text, and the figure."""

import numpy as np

from isochrome.figures import LINE_COLOURS

from .report import lines_of, machine
from .rows import ToleranceRow

HEAD = ("tolerance", "courses", "within", "refused", "worst p_max", "worst depth", "time")

_FOOT = """\
Errors over the tolerance, against runs at a hundredth of it; time: median of a course, processor;
to be seen: all within or refused."""


def table(rows: list[ToleranceRow]) -> str:
    """Share within, refused and worst by tolerance, and each course that is neither."""
    cells = []
    for tolerance in _tolerances(rows):
        some = [row for row in rows if row.tolerance == tolerance]
        kept = [row for row in some if not row.refused]
        within = sum(_worst(row) <= 1.0 for row in kept)
        worst = [max((getattr(r, name) for r in kept), default=0.0) for name in ("p_max", "depth")]
        cells.append(
            (f"{tolerance:g}", str(len(some)), f"{100 * within / max(1, len(kept)):.1f} %",
             str(len(some) - len(kept)), *(f"{value:.2f}" for value in worst),
             f"{np.median([row.seconds for row in some]):.2g} s")
        )  # fmt: skip
    beyond = [
        f"{row.tolerance:g}, seed {row.seed}, {_worst(row):.2f} tolerances: {row.course}"
        for row in rows
        if not row.refused and _worst(row) > 1.0
    ]
    reasons = [f"{row.tolerance:g}, seed {row.seed}: {row.refused}" for row in rows if row.refused]
    lines = [*lines_of(HEAD, cells, texts=1), "", *beyond, *reasons, _FOOT, machine()]
    return "\n".join(lines)


def _tolerances(rows: list[ToleranceRow]) -> list[float]:
    return sorted({row.tolerance for row in rows}, reverse=True)


def _worst(row: ToleranceRow) -> float:
    return max(row.p_max, row.depth)


def figure(rows: list[ToleranceRow]):
    """Share of the courses within an error, a line for each tolerance."""
    from isochrome.figures import new_figure, style_axes

    picture = new_figure(8.0, 5.0)
    axes = picture.subplots()
    for tolerance, colour in zip(_tolerances(rows), LINE_COLOURS, strict=False):
        errors = sorted(
            max(_worst(row), 1e-4) for row in rows if row.tolerance == tolerance and not row.refused
        )
        if errors:
            share = np.arange(1, len(errors) + 1) / len(errors)
            axes.step(errors, share, where="post", color=colour, label=f"{tolerance:g}")
    axes.axvline(1.0, color="0.5", lw=0.8, ls="--")
    axes.set_xscale("log")
    axes.legend(title="tolerance", frameon=False)
    title = "Random courses of load, friction and wear"
    style_axes(axes, x_label="error over the tolerance", z_label="share of courses", title=title)
    return picture
