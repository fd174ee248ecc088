"""What a run of `isochrome bench fringes` shows: the table in plain text, and the figure."""

import numpy as np

from isochrome.figures import LINE_COLOURS

from .case_fringes import ALL, ARCSINE, BLIND, COLOUR, FREE, METHODS, MODEL, STEPS
from .report import lines_of, machine
from .rows import FringeRow

HEAD = ("specimen", "method", "wrong", "RMS", "median", "kept", "right", "time")
BLUE, ORANGE, GREEN, PINK, SKY, YELLOW = LINE_COLOURS
LOOKS = {
    ARCSINE: (ORANGE, "x"),
    MODEL: (PINK, "v"),
    FREE: (BLUE, "s"),
    BLIND: (SKY, "D"),
    STEPS: (GREEN, "o"),
    COLOUR: (YELLOW, "^"),
}


def over_all(rows: list[FringeRow]) -> list[FringeRow]:
    """One row a method, of the specimens that it read: root mean square, worst of medians and
    shares, median time; `kept`, the mean over all."""
    found = []
    for method in METHODS:
        of = [r for r in rows if r.method == method]
        read = [r for r in of if r.rms == r.rms]
        if read:
            right = [r.right for r in read if r.right == r.right]
            found.append(
                FringeRow(
                    ALL,
                    method,
                    max(r.wrong for r in read),
                    float(np.sqrt(np.mean([r.rms**2 for r in read]))),
                    max((r.median for r in read if r.median == r.median), default=float("nan")),
                    float(np.mean([r.kept for r in of])),
                    min(right) if right else float("nan"),
                    float(np.median([r.seconds for r in of])),
                )
            )
    return found


def table(rows: list[FringeRow]) -> str:
    """The rows as a table in plain text, the specimens together at its end."""
    cells = [_cells(r) for r in (*rows, *over_all(rows))]
    return "\n".join([*lines_of(HEAD, cells, texts=2), "", _FOOT, machine()])


_FOOT = """\
Wrong: share of the kept pixels that is off by over half a fringe; RMS, median: their error in
fringes; kept: share of the specimen; right: of the pixels called 95 % sure, those right to 0.05.
All specimens: root mean square, worst median, wrong and right, mean kept, median time.
Rendered frames of 659 x 494 pixels, 8 bits, noise of 3 grey levels, 30 % vignette; one point of
known order given, or a scene 5 % off in load and 3 pixels in place. Arcsine: the truth's branch.
Others' light: 330 x 440 pixels by a script that shares no code with ours, lamps of 1 : 3 at most,
noise of 1 to 10, one to five points of known order, some on lines and some wrong; RMS of what is on
its branch."""


def _cells(row: FringeRow) -> tuple[str, ...]:
    return (
        row.specimen,
        row.method,
        _number(row.wrong, "{:.2f} %", 100.0),
        *(_number(v, "{:.4f}", 1.0) for v in (row.rms, row.median)),
        _number(row.kept, "{:.1f} %", 100.0),
        _number(row.right, "{:.1f} %", 100.0),
        _number(row.seconds, "{:.2f} s", 1.0),
    )


def _number(value: float, how: str, factor: float) -> str:
    return how.format(factor * value) if value == value else "-"


def figure(rows: list[FringeRow]):
    """RMS error against what is kept and against time: a point a specimen, the largest of a colour
    all of them."""
    from isochrome.figures import TICK_PT, new_figure, style_axes

    picture = new_figure(10.5, 5.0)
    together = over_all(rows)
    panels = (
        ("kept of the specimen (%)", "Error and what is kept", lambda r: 100.0 * r.kept),
        ("time a state (s)", "Error and time", lambda r: r.seconds),
    )
    for axes, (x_label, title, place) in zip(picture.subplots(1, 2), panels, strict=True):
        for method, (colour, marker) in LOOKS.items():
            for part, size, alpha in ((rows, 25.0, 0.55), (together, 130.0, 1.0)):
                points = [(place(r), r.rms) for r in part if r.method == method and r.rms == r.rms]
                if points:
                    axes.scatter(
                        *zip(*points, strict=True),
                        s=size,
                        c=colour,
                        marker=marker,
                        alpha=alpha,
                        linewidths=1.6 if marker == "x" else 0.0,
                        label=method if part is together else None,
                    )
        axes.set_yscale("log")
        for which in ("major", "minor"):
            axes.tick_params(axis="y", which=which, labelsize=TICK_PT)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(_first_digits)
        style_axes(axes, x_label=x_label, z_label="RMS error (fringes)", title=title)
        axes.grid(alpha=0.3, lw=0.5, which="both")
        axes.set_axisbelow(True)
    picture.axes[1].set_xscale("log")
    picture.axes[1].xaxis.set_major_formatter("{x:g}")
    handles, labels = picture.axes[0].get_legend_handles_labels()
    picture.legend(
        handles,
        labels,
        loc="outside lower center",
        frameon=False,
        fontsize=TICK_PT,
        ncols=len(labels),
        markerscale=0.6,
    )
    picture.suptitle("Fringe order by every method: a point a specimen, large ones all of them")
    return picture


def _first_digits(value: float, _: object) -> str:
    """Between powers of ten: 2 and 5 alone, the others would crowd."""
    return f"{value:g}" if f"{value:e}"[0] in "25" else ""
