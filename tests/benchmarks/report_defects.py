"""What a run of `isochrome bench defects` shows: the table in plain text, and the figure."""

import numpy as np

from isochrome.figures import LINE_COLOURS

from .report import lines_of, machine
from .rows import DefectRow

HEAD = (
    "frames", "count", "within 3 u", "beyond 6 u, not flagged", "pull load", "pull friction",
    "worst load", "named", "first", "freed in vain", "over bound", "cost",
)  # fmt: skip

_FOOT = """\
u: standard uncertainty; pulls: errors over it, root mean square; named: each defect is among what
was found; first: one of them is said first (of three: among the first two); freed in vain:
something else was; over bound: median of the uncertainty over its Cramér-Rao bound; cost: median
processor time over that of the fit as stated. Frames of 659 x 494 pixels by a script that shares no
code with our optics and camera."""

_BEYOND, _FAR = 3.0, 6.0


def table(rows: list[DefectRow]) -> str:
    """By kind of frame and single defect; then each frame whose values are beyond 3 u."""
    groups = {}
    for row in rows:
        groups.setdefault(row.defects if row.kind == "single" else row.kind, []).append(row)
    cells = [_cells(name, some) for name, some in groups.items()]
    beyond = [
        f"{row.kind} {row.seed}: {row.defects} -> {row.found}; load {row.load_percent:+.3f} %, "
        f"pulls {row.load_pull:+.1f}, {row.friction_pull:+.1f}, chi {row.chi:.2f}"
        for row in rows
        if not row.refused and _worst(row) > _BEYOND
    ]
    reasons = [
        f"{row.kind} {row.seed}: {row.defects}: {row.refused}" for row in rows if row.refused
    ]
    return "\n".join([*lines_of(HEAD, cells, texts=1), "", *beyond, *reasons, _FOOT, machine()])


def _cells(name: str, some: list[DefectRow]) -> tuple[str, ...]:
    kept = [row for row in some if not row.refused]
    within = np.mean([_worst(row) <= _BEYOND for row in kept]) if kept else np.nan
    far = sum(_worst(row) > _FAR and not row.flagged for row in kept)
    vain = sum(not _asked_for(row) for row in kept)
    pulls = ([getattr(row, key) for row in kept] for key in ("load_pull", "friction_pull"))
    worst = max((abs(row.load_percent) for row in kept), default=np.nan)
    named, first = (
        np.mean([getattr(row, key) for row in kept] or [np.nan]) for key in ("named", "first")
    )
    return (
        name,
        str(len(some)),
        f"{100.0 * within:.0f} %",
        str(far),
        *(f"{_rms(values):.2f}" for values in pulls),
        f"{worst:.3f} %",
        f"{100.0 * named:.0f} %",
        f"{100.0 * first:.0f} %",
        str(vain),
        f"{np.median([row.over_bound for row in kept] or [np.nan]):.2f}",
        f"{np.median([row.cost for row in kept] or [np.nan]):.1f}",
    )


def _asked_for(row: DefectRow) -> bool:
    """Whether nothing was found that is not there; light and dust have two names each."""
    alike = {"light": "stray light", "stray light": "light", "dust": "shadow", "shadow": "dust"}
    there = set(row.defects.split(", "))
    there |= {alike[name] for name in there if name in alike}
    return set(row.found.split(", ")) - {""} <= there


def _worst(row: DefectRow) -> float:
    return float(np.nanmax(np.abs([row.load_pull, row.friction_pull])))


def _rms(values: list[float]) -> float:
    known = [value for value in values if value == value]  # a static contact has no friction
    return float(np.sqrt(np.mean(np.square(known)))) if known else float("nan")


def figure(rows: list[DefectRow]):
    """Share of the frames within so many standard uncertainties, a line for each kind."""
    from isochrome.figures import new_figure, style_axes

    picture = new_figure(8.0, 5.0)
    axes = picture.subplots()
    kinds = dict.fromkeys(row.kind for row in rows)
    for kind, colour in zip(kinds, LINE_COLOURS, strict=False):
        errors = sorted(_worst(row) for row in rows if row.kind == kind and not row.refused)
        if errors:
            share = np.arange(1, len(errors) + 1) / len(errors)
            axes.step(errors, share, where="post", color=colour, label=kind)
    axes.axvline(_BEYOND, color="0.5", lw=0.8, ls="--")
    axes.set_xscale("log")
    axes.legend(title="frames", frameon=False)
    style_axes(
        axes,
        x_label="error over standard uncertainty",
        z_label="share of frames",
        title="Frames of benches that are not ours",
    )
    return picture
