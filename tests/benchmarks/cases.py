"""The cases of `isochrome bench`, in order. Each is a function of `quick` that returns its rows."""

from collections.abc import Callable
from dataclasses import dataclass

from . import (
    case_benches,
    case_contacts,
    case_defects,
    case_fit,
    case_frames,
    case_fringes,
    case_inputs,
    case_memory,
    case_plan,
    case_pressure,
    case_rigs,
    case_stress,
    case_tolerance,
    case_track,
    case_wear,
    report,
)

CASES = {
    "pressure": case_pressure.pressure, "wear": case_wear.wear, "stress": case_stress.stress,
    "frames": case_frames.frames,
}  # fmt: skip


@dataclass(frozen=True)
class Suite:
    """What is run together: `cases()` by their names, the `file` they end in, table and figure."""

    cases: Callable[[], dict[str, Callable]]
    file: str
    table: Callable
    figure: Callable


def _suite(module, name: str) -> Suite:
    return Suite(module.cases, name, module.table, module.figure)


SUITES = {"speed": Suite(lambda: CASES, "bench", report.table, report.figure)} | {
    name: _suite(module, name)
    for name, module in {
        "fringes": case_fringes, "fit": case_fit, "defects": case_defects,
        "contacts": case_contacts, "benches": case_benches, "inputs": case_inputs,
        "track": case_track, "memory": case_memory, "tolerance": case_tolerance, "plan": case_plan,
        "rigs": case_rigs,
    }.items()
}  # fmt: skip
