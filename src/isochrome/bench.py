"""`bench`: speed against error, this project beside the paper's own procedure, in one run.

A second suite, `fringes`, holds every way to the fringe order against frames whose order is known;
a third, `fit`, what a fit finds in frames, and what that costs, against the truth; a fourth,
`track`, how many frames a second of a video `process --track` does; `memory`, the peak memory of
long runs; `tolerance`, whether 300 random courses of load, friction and wear are within the
tolerance that their scenes ask for.

The cases live with the tests, in `tests/benchmarks` of the repository, so that the rival's code is
there to be read and no part of the installed package. Ratios within one run are the claim, times
are not: they are those of one machine and of what else it did.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from isochrome.errors import InputError

Progress = Callable[[str], None]

_NAME = "isochrome_benchmarks"
_NAN = float("nan")


@dataclass(frozen=True)
class Row:
    """One measurement: `case`, `method`, `setting`, `error` and `seconds` (NaN: has none).

    `ratio`: the time of the paper's procedure at the same or smaller error over this row's; with
    `reached` False, the time of its most accurate setting, which is not as good as this row.
    """

    case: str
    method: str
    setting: str
    error: float = _NAN
    seconds: float = _NAN
    ratio: float = _NAN
    reached: bool = True


@dataclass(frozen=True)
class FringeRow:
    """One reading of one specimen's fringe order, against its truth.

    `rms` and `median` error (fringes) and the share `wrong` by over half a fringe, of what was
    kept; `kept`, share of the specimen's pixels; `right`, share right to 0.05 fringe of the pixels
    that the method calls 95 % sure; `seconds`. NaN: has none.
    """

    specimen: str
    method: str
    rms: float = _NAN
    median: float = _NAN
    wrong: float = _NAN
    kept: float = _NAN
    right: float = _NAN
    seconds: float = _NAN


@dataclass(frozen=True)
class FitRow:
    """One quantity that a fit found, against the truth.

    `problem`, `case`, `quantity`; its `error`, and the `bar` that it is to stay below (`more`:
    above), both in `unit`; `pull`, error over standard uncertainty, root mean square (NaN: has
    none); `cpu_ms`, processor time of one such fit, and the `evaluations` of the renderer at all
    pixels that would take as long.
    """

    problem: str
    case: str
    quantity: str
    error: float
    bar: float
    unit: str
    pull: float
    cpu_ms: float
    evaluations: float
    more: bool = False


@dataclass(frozen=True)
class TrackRow:
    """One run of `process --track`.

    `film`, its kind of file; `workers`; `frames`, and how many a second by the clock; `cpu_ms`,
    processor time of a frame, and the shares of it that `reading` and `writing` took (NaN: spent in
    other processes); `load_error`, relative, and `pull`, error over standard uncertainty, both root
    mean square; `apart_per_s`, frames a second of as many runs of one worker each at the same time,
    which share nothing but the machine (NaN: not measured).
    """

    film: str
    workers: int
    frames: int
    frames_per_s: float
    cpu_ms: float
    reading: float
    writing: float
    load_error: float
    pull: float
    apart_per_s: float = float("nan")


@dataclass(frozen=True)
class MemoryRow:
    """Peak memory of a run in a process of its own.

    `command`; what its `items` are and their `count`; `peak_mb`; `seconds`, by the clock.
    """

    command: str
    items: str
    count: int
    peak_mb: float
    seconds: float


@dataclass(frozen=True)
class ToleranceRow:
    """One random course, its largest pressures and depths beside a run at a hundredth.

    `seed` and `course`, in words; `tolerance`; the largest errors of `p_max` and `depth` over its
    states, each over the tolerance; `refused`, the sentence, or nothing; `seconds`, processor time.
    """

    seed: int
    course: str
    tolerance: float
    p_max: float
    depth: float
    refused: str
    seconds: float


@dataclass(frozen=True)
class Bench:
    """What a run gave: `rows`, each a Row's fields by name, and `text`, the table to be read."""

    rows: list[dict[str, Any]]
    text: str


def bench(
    out: str | Path | None = None,
    *,
    suite: str = "speed",
    quick: bool = False,
    progress: Progress | None = None,
) -> Bench:
    """Run every case of a suite: speed beside the paper's own procedure, fringe orders, fits, runs.

    Parameters: `out`, a folder for the table and the figure, bench.csv and bench.png, of the other
    suites by their own name, as fit.csv and fit.png (None: nothing is written); `suite`, 'speed',
    'fringes', 'fit', 'track', 'memory' or 'tolerance'; `quick`, tiny cases that only show that
    everything runs; `progress`, called with the name of each case as it begins.
    Returns a Bench. Raises InputError where the benchmarks are not there, or have no such suite.
    """
    suites = load_benchmarks("cases").SUITES
    if suite not in suites:
        raise InputError(f"bench has no suite {suite!r}; choose one of {', '.join(suites)}")
    chosen = suites[suite]
    rows: list[Any] = []
    for name, case in chosen.cases().items():
        if progress is not None:
            progress(name)
        rows += case(quick=quick)
    fields = [asdict(row) for row in rows]
    if out is not None:
        from isochrome.output import staged, write_csv, write_figure

        with staged(out) as folder:
            columns = {key: [row[key] for row in fields] for key in fields[0]}
            write_csv(folder / f"{chosen.file}.csv", columns)
            write_figure(folder / f"{chosen.file}.png", chosen.figure(rows))
    return Bench(fields, chosen.table(rows))


def benchmarks_folder() -> Path:
    """The repository's tests/benchmarks: of the clone the package is run from, else below here.

    Raises InputError where neither holds the benchmarks.
    """
    for root in (Path(__file__).resolve().parents[2], Path.cwd()):
        folder = root / "tests" / "benchmarks"
        if (folder / "paper_procedure.py").is_file():
            return folder
    raise InputError(
        "benchmarks live in the repository, not in the installed package; run it from a clone"
    )


def load_benchmarks(module: str) -> ModuleType:
    """Import a module of the benchmarks by its name (`cases`, `paper_procedure`)."""
    if _NAME not in sys.modules:
        folder = benchmarks_folder()
        spec = importlib.util.spec_from_file_location(
            _NAME, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )
        assert spec is not None and spec.loader is not None
        package = importlib.util.module_from_spec(spec)
        sys.modules[_NAME] = package
        spec.loader.exec_module(package)
    return importlib.import_module(f"{_NAME}.{module}")
