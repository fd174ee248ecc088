"""The cases of `isochrome bench`, in order. Each is a function of `quick` that returns its rows."""

from collections.abc import Callable
from dataclasses import dataclass

from . import (
    case_defects,
    case_fit,
    case_frames,
    case_fringes,
    case_inputs,
    case_memory,
    case_peers,
    case_pressure,
    case_stress,
    case_tolerance,
    case_track,
    case_wear,
    report,
    report_defects,
    report_fit,
    report_fringes,
    report_inputs,
    report_memory,
    report_tolerance,
    report_track,
)

CASES = {
    "pressure": case_pressure.pressure,
    "cost with size": case_pressure.cost,
    "peers": case_peers.peers,
    "wear": case_wear.wear,
    "stress": case_stress.stress,
    "frames": case_frames.frames,
}


@dataclass(frozen=True)
class Suite:
    """What is run together: `cases()` by their names, the `file` they end in, table and figure."""

    cases: Callable[[], dict[str, Callable]]
    file: str
    table: Callable
    figure: Callable


SUITES = {
    "speed": Suite(lambda: CASES, "bench", report.table, report.figure),
    "fringes": Suite(case_fringes.cases, "fringes", report_fringes.table, report_fringes.figure),
    "fit": Suite(case_fit.cases, "fit", report_fit.table, report_fit.figure),
    "defects": Suite(case_defects.cases, "defects", report_defects.table, report_defects.figure),
    "inputs": Suite(case_inputs.cases, "inputs", report_inputs.table, report_inputs.figure),
    "track": Suite(case_track.cases, "track", report_track.table, report_track.figure),
    "memory": Suite(case_memory.cases, "memory", report_memory.table, report_memory.figure),
    "tolerance": Suite(
        case_tolerance.cases, "tolerance", report_tolerance.table, report_tolerance.figure
    ),
}
