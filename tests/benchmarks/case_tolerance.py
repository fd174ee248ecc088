"""Random courses: are p_max and depth within numerics.tolerance of a run at a hundredth of it?
Truths by other code stand in tests/contact/test_contact_tolerance.py."""

import time
from functools import partial

import numpy as np

from isochrome.contact import contact_states
from isochrome.errors import PhysicsError

from .courses import random_course
from .report import lines_of, machine, share_figure
from .rows import ToleranceRow

COURSES, FINER = 300, 100.0
TOLERANCES = (1e-3, 1e-4, 1e-5)


def cases():
    return {f"tolerance {t:g}": partial(courses, t) for t in TOLERANCES}


def courses(tolerance, quick, seeds=range(COURSES)):
    """A row for each seed, or with `quick` for the first."""
    return [judged(seed, tolerance) for seed in (seeds[:1] if quick else seeds)]


def judged(seed, tolerance):
    """The row of one course at a tolerance: refused, or beside a finer run."""
    scene, words = random_course(seed)
    start = time.process_time()
    try:
        values = largest(scene, tolerance)
        seconds = time.process_time() - start
        exact = largest(scene, tolerance / FINER)
    except PhysicsError as error:
        seconds = time.process_time() - start
        return ToleranceRow(seed, words, tolerance, np.nan, np.nan, str(error), seconds)
    # a state before any wear has no depth to err in
    error = np.abs(values - exact) / np.maximum(exact, 1e-300) / tolerance
    return ToleranceRow(seed, words, tolerance, *error.max(axis=0).tolist(), "", seconds)


def largest(scene, tolerance):
    """Largest pressure and depth of each state (m, 2)."""
    states = contact_states(scene.with_values({"numerics.tolerance": tolerance}))
    return np.array([(state.p_max_mpa, state.wear_depth_mm.max()) for state in states])


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
    kept = [
        (f"{t:g}", max(_worst(row), 1e-4))
        for t in _tolerances(rows)
        for row in rows
        if row.tolerance == t and not row.refused
    ]
    return share_figure(
        kept, "tolerance", "error over the tolerance", "Random courses of load, friction and wear",
        mark=1.0, z_label="share of courses",
    )  # fmt: skip
