"""`bench`: speed against error, this project beside the paper's own procedure, in one run.

The cases live with the tests, in `tests/benchmarks` of the repository, so that the rival's code is
there to be read and no part of the installed package. Ratios within one run are the claim, times
are not: they are those of one machine and of what else it did.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from isochrome.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[int, int], None]

_NAME = "isochrome_benchmarks"
_NAN = float("nan")
_PANELS = ("pressure", "wear", "stress")


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
class Bench:
    """What a run gave: `rows` in the order of the cases, and `text`, the table to be read."""

    rows: list[Row]
    text: str


def bench(
    out: str | Path | None = None, *, quick: bool = False, progress: Progress | None = None
) -> Bench:
    """Run every case and compare with the paper's own procedure.

    Parameters: `out`, a folder for bench.csv and bench.png (None: nothing is written); `quick`,
    tiny cases that only show that everything runs; `progress`, called with (done, all).
    Returns a Bench. Raises InputError where the benchmarks are not there.
    """
    cases = load_benchmarks("cases").CASES
    rows: list[Row] = []
    for done, case in enumerate(cases.values(), start=1):
        rows += case(quick)
        if progress is not None:
            progress(done, len(cases))
    if out is not None:
        from isochrome.output import staged, write_csv, write_figure

        with staged(out) as folder:
            table = [asdict(row) for row in rows]
            write_csv(folder / "bench.csv", {key: [row[key] for row in table] for key in table[0]})
            write_figure(folder / "bench.png", bench_figure(rows))
    return Bench(rows, bench_table(rows))


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


def bench_table(rows: list[Row]) -> str:
    """The rows as a table in plain text, with a line on how it was measured."""
    head = ("case", "method", "setting", "error", "time", "ratio")
    cells = [(r.case, r.method, r.setting, _error(r), _time(r), _ratio(r)) for r in rows]
    widths = [max(len(row[k]) for row in (head, *cells)) for k in range(len(head))]
    lines, last = [], ""
    for row in (head, *cells):
        if row[0] != last:
            lines += [""] if last else []
            last = row[0]
        words = [f"{text:<{w}}" for text, w in zip(row[:3], widths[:3], strict=True)]
        words += [f"{text:>{w}}" for text, w in zip(row[3:], widths[3:], strict=True)]
        lines.append("  ".join(words).rstrip())
    return "\n".join([*lines, "", _FOOT, _machine()])


_FOOT = """\
ratio: time of the fastest setting of the paper's procedure at the same or smaller error over ours,
on the same grid; in brackets where none is as accurate: to its most accurate one.
Medians of five after a warm-up, taken in turns (over four seconds: fewer); set-up not included."""


def _machine() -> str:
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def _error(row: Row) -> str:
    return f"{row.error:.1e}" if row.error == row.error else "-"


def _time(row: Row) -> str:
    return f"{1e3 * row.seconds:.3g} ms" if row.seconds == row.seconds else "-"


def _ratio(row: Row) -> str:
    if row.ratio != row.ratio:
        return ""
    return f"{row.ratio:.2g}" if row.reached else f"({row.ratio:.2g})"


def bench_figure(rows: list[Row]) -> Figure:
    """Time against error, log-log, one panel each for pressure, wear and stress."""
    from isochrome.figures import LINE_COLOURS, new_figure, style_axes

    figure = new_figure(12.0, 4.4)
    panels = figure.subplots(1, len(_PANELS))
    for axes, name in zip(panels, _PANELS, strict=True):
        known = [r for r in rows if r.case.startswith(name) and r.error == r.error]
        cases = list(dict.fromkeys(r.case for r in known))
        colours = dict(
            zip(dict.fromkeys(r.method for r in known), LINE_COLOURS[1::-1], strict=False)
        )
        for case, marker in zip(cases, "osD^vP" * 3, strict=False):
            for method, colour in colours.items():
                line = sorted(
                    (r.error, 1e3 * r.seconds)
                    for r in known
                    if (r.case, r.method) == (case, method)
                )
                axes.loglog(*zip(*line, strict=True), color=colour, marker=marker, ms=5, lw=1.1)
        style_axes(axes, x_label="error (relative)", z_label="time (ms)", title=name)
    return figure
