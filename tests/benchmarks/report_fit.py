"""What a run of `isochrome bench fit` shows: the table in plain text, and the figure."""

from isochrome.figures import LINE_COLOURS

from .report import lines_of, machine
from .rows import FitRow

HEAD = ("problem", "case", "quantity", "error", "bar", "pull", "CPU", "evaluations")
_LEAST = 1e-4
"""Share of its bar at which an error that is none is drawn."""


def table(rows: list[FitRow]) -> str:
    """The rows as a table in plain text, with what they mean."""
    cells, last = [], None
    for row in rows:
        own = row.problem, row.case
        cells.append(_cells(row, first=own != last))
        last = own
    return "\n".join([*lines_of(HEAD, cells, texts=3), "", _FOOT, machine()])


_FOOT = """\
error: of what was found against the truth, beside the bar it is to stay below; pull: errors over
their standard uncertainties, root mean square over all keys of the case where there are several.
CPU: processor time of one thread of one fit (the median of several), and how many evaluations of
the light of a sliding contact at all 659 x 494 pixels would take as long.
Rendered frames of 659 x 494 pixels, 8 bits, noise of 3 grey levels, 30 % vignette."""


def _cells(row: FitRow, *, first: bool) -> tuple[str, ...]:
    """A row's texts; what its case has in common stands in the first of its rows."""
    return (
        row.problem,
        row.case if first else "",
        row.quantity,
        _with_unit(row.error, row.unit),
        _with_unit(row.bar, row.unit),
        f"{row.pull:.2f}" if row.pull == row.pull else "-",
        f"{row.cpu_ms:.0f} ms" if first else "",
        f"{row.evaluations:.0f}" if first else "",
    )


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.2g} {unit}".rstrip() if value < 100.0 else f"{value:.0f} {unit}".rstrip()


def share(row: FitRow) -> float:
    """A row's error over its bar; 1 and less is good."""
    if row.more:
        return row.bar / row.error if row.error > 0.0 else float("inf")
    if row.bar == 0.0:
        return 0.0 if row.error == 0.0 else float("inf")
    return row.error / row.bar


def figure(rows: list[FitRow]):
    """Each error as a share of its bar, and what a fit of each case costs."""
    from isochrome.figures import TICK_PT, new_figure, style_axes

    blue, orange = LINE_COLOURS[:2]
    picture = new_figure(11.0, 0.34 * len(rows) + 1.9)
    errors, costs = picture.subplots(1, 2, sharey=True, width_ratios=(1.3, 1.0))
    cases = {(row.problem, row.case) for row in rows}
    several = {p for p, _ in cases if sum(p == other for other, _ in cases) > 1}
    names, last = [], None
    for k, row in enumerate(rows):
        names.append(f"{row.case if row.problem in several else row.problem}: {row.quantity}")
        part = min(max(share(row), _LEAST), 1.0 / _LEAST)
        colour = blue if share(row) <= 1.0 else orange
        errors.plot([_LEAST, part], [k, k], color=colour, lw=1.2, alpha=0.5)
        errors.plot(part, k, "o", color=colour, ms=6)
        if (row.problem, row.case) != last:
            costs.plot(row.evaluations, k, "s", color=blue, ms=6)
            costs.annotate(
                f"{1e-3 * row.cpu_ms:.2g} s", (row.evaluations, k), (7, 0),
                textcoords="offset points", va="center", fontsize=TICK_PT,
            )  # fmt: skip
        last = row.problem, row.case
    errors.axvline(1.0, color="0.3", lw=1.0, ls="--")
    errors.set_xscale("log")
    costs.set_xscale("log")
    costs.set_xlim(1.0, 4.0 * max(row.evaluations for row in rows))
    errors.set_yticks(range(len(rows)), names)
    errors.invert_yaxis()
    titles = ("Error over its bar (dashed)", "Processor time of one fit, one thread")
    labels = ("error / bar", "evaluations of the renderer")
    for axes, title, label in zip((errors, costs), titles, labels, strict=True):
        style_axes(axes, x_label=label, z_label="", title=title)
        axes.tick_params(labelsize=TICK_PT)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.grid(alpha=0.3, lw=0.5)
        axes.set_axisbelow(True)
    picture.suptitle("What a fit finds in rendered frames, against the truth")
    return picture
