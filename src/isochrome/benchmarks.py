"""`bench`: speed against error, this project beside the paper's own procedure, in one run.
The suites and their cases live with the tests, in `tests/benchmarks` of the repository, so that the
rival's code is there to be read and no part of the installed package. Ratios within one run are the
claim, times are not: they are those of one machine and of what else it did."""

import importlib.util
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from isochrome.errors import InputError
from isochrome.output import Result, staged, write_csv, write_figure

Progress = Callable[[str], None]

_NAME = "isochrome_benchmarks"


@dataclass(frozen=True, repr=False)
class Bench(Result):
    """What a run gave: `rows`, each a Row's fields by name, and `text`, the table to be read."""

    rows: list[dict[str, Any]]
    text: str

    @property
    def columns(self) -> dict[str, list[Any]]:
        """Those of the suite's table on disk."""
        return {name: [row[name] for row in self.rows] for name in self.rows[0]}

    @property
    def warnings(self) -> tuple[str, ...]:
        """None."""
        return ()

    @property
    def title(self) -> str:
        """How many measurements there are."""
        return f"Bench of {len(self.rows)} measurements: print .text"

    def to_json(self) -> dict[str, Any]:
        """All measurements."""
        return {"rows": self.rows}


def bench(
    out: str | Path | None = None,
    *,
    suite: str = "speed",
    quick: bool = False,
    progress: Progress | None = None,
) -> Bench:
    """Run every case of a suite of benchmarks.

    Speed is measured beside the paper's own procedure; fringe orders, fits and tracks beside their
    true values.

    Parameters
    ----------
    out : str or Path, optional
        Folder for the table and the figure, bench.csv and bench.png, of the other suites by their
        own name, as fit.csv and fit.png; by default nothing is written.
    suite : str, default 'speed'
        Which cases to run: 'speed', 'fringes', 'fit', 'defects', 'contacts', 'inputs', 'track',
        'memory', 'tolerance' or 'plan'.
    quick : bool, default False
        Whether to run tiny cases, which only show that everything runs.
    progress : callable, optional
        Called with the name of each case as it begins.

    Returns
    -------
    Bench
        A row a measurement.

    Raises
    ------
    InputError
        Where the benchmarks are not there, or have no such suite.

    Examples
    --------
    Some minutes:

    >>> import isochrome
    >>> isochrome.bench(suite="fit")  # doctest: +SKIP
    """
    suites = load_benchmarks("cases").SUITES
    if suite not in suites:
        raise InputError("bench_has_no_suite", suite=suite, suites=", ".join(suites))
    chosen = suites[suite]
    rows: list[Any] = []
    for name, case in chosen.cases().items():
        if progress is not None:
            progress(name)
        rows += case(quick=quick)
    fields = [asdict(row) for row in rows]
    result = Bench(fields, chosen.table(rows), draw=partial(chosen.figure, rows))
    if out is not None:
        with staged(out) as folder:
            write_csv(folder / f"{chosen.file}.csv", result.columns)
            write_figure(folder / f"{chosen.file}.png", result.figure())
    return result


def benchmarks_folder() -> Path:
    """The repository's tests/benchmarks: of the clone the package is run from, or below here."""
    for root in (Path(__file__).resolve().parents[2], Path.cwd()):
        folder = root / "tests" / "benchmarks"
        if (folder / "paper_procedure.py").is_file():
            return folder
    raise InputError("benchmarks_live_repository_not")


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
