"""What a run of `isochrome bench inputs` shows: the table in plain text, and the figure."""

import numpy as np

from isochrome.figures import LINE_COLOURS

from .case_inputs import COVERED
from .report import lines_of, machine
from .rows import InputRow

HEAD = (
    "inputs", "frames", "load within 1.96 u", "friction", "pull load", "pull friction", "u load",
    "of it noise", "freed", "CPU ms",
)  # fmt: skip

_FOOT = """\
u: combined standard uncertainty; pulls: errors over it, root mean square. Inputs are drawn about
the truth: pixel 0.2 %, thickness and f_sigma 0.5 %, E 2 %, R 0.1 %, and the load cell 0.5 %.
held: as stated, with their budget; asked: fitted with their priors where the frame asks. Frames of
220 x 165 pixels by a script that shares no code with our optics and camera."""


def table(rows: list[InputRow]) -> str:
    """By what is done with the inputs; then what was refused."""
    kinds = dict.fromkeys(row.kind for row in rows)
    cells = [_cells(kind, [row for row in rows if row.kind == kind]) for kind in kinds]
    reasons = [f"{row.kind} {row.seed}: {row.refused}" for row in rows if row.refused]
    return "\n".join([*lines_of(HEAD, cells, texts=1), "", *reasons, _FOOT, machine()])


def _cells(kind: str, some: list[InputRow]) -> tuple[str, ...]:
    kept = [row for row in some if not row.refused]
    if not kept:
        return (kind, str(len(some)), *["-"] * (len(HEAD) - 2))
    pulls = np.array([(row.load_pull, row.friction_pull) for row in kept])
    within = np.mean(abs(pulls) <= COVERED, axis=0)
    return (
        kind,
        str(len(some)),
        *(f"{100.0 * share:.1f} %" for share in within),
        *(f"{rms:.2f}" for rms in np.sqrt(np.mean(pulls**2, axis=0))),
        f"{np.median([row.combined_percent for row in kept]):.3f} %",
        f"{np.median([row.noise_percent for row in kept]):.4f} %",
        f"{100.0 * np.mean([row.freed for row in kept]):.0f} %",
        f"{1e3 * np.median([row.seconds for row in kept]):.0f}",
    )


def figure(rows: list[InputRow]):
    """Share of the loads within so many standard uncertainties, beside a normal distribution's."""
    from scipy.stats import halfnorm

    from isochrome.figures import new_figure, style_axes

    picture = new_figure(8.0, 5.0)
    axes = picture.subplots()
    kinds = dict.fromkeys(row.kind for row in rows)
    for kind, colour in zip(kinds, LINE_COLOURS, strict=False):
        pulls = sorted(abs(row.load_pull) for row in rows if row.kind == kind and not row.refused)
        share = np.arange(1, len(pulls) + 1) / max(1, len(pulls))
        axes.step(pulls, share, where="post", color=colour, label=kind)
    place = np.linspace(0.0, 4.0, 200)
    axes.plot(place, halfnorm.cdf(place), color="0.5", lw=0.9, ls="--", label="normal")
    axes.legend(title="inputs", frameon=False)
    style_axes(
        axes,
        x_label="error of the load over combined standard uncertainty",
        z_label="share of frames",
        title="Inputs that are off by chance",
    )
    return picture
