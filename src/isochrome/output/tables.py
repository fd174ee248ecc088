"""CSV tables: written at once or row by row, read as numbers where they are numbers."""

from __future__ import annotations

import csv
import io
import math
import stat
from array import array
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from isochrome.errors import InputError
from isochrome.output.files import plain, replacing

DIGITS = 9
"""Significant digits of a number in a table."""
MOST_GIVEN = 10_000_000
"""Bytes of a table that somebody gives, such as a profile."""
_AT_ONCE = 4096
"""Rows of a long table that are text in memory at a time."""


class Floats(array):
    """A column of numbers, `Floats("d", values)`, NaN where one is not known.

    In eight bytes each, a quarter of what a list of them takes, which it is like in all else.
    """

    def __eq__(self, other: object) -> bool:
        """As a list of the same numbers."""
        return self.tolist() == list(other) if isinstance(other, Sequence) else NotImplemented

    def __repr__(self) -> str:
        """As a list's."""
        return repr(self.tolist())


class TableWriter:
    """A table written some rows at a time, in memory that does not grow with it.

    Rows go to a hidden file beside `path`; a clean end of the `with` block makes it the table, an
    exception discards it.
    """

    def __init__(self, path: str | Path, names: Iterable[str] = ()) -> None:
        """Prepare a table at `path` with the columns `names`, by default those of the first rows.

        Units stand in the names (`wear_depth_um`).
        """
        self.path = Path(path)
        self.names = tuple(names)
        self._ending = ExitStack()

    def __enter__(self) -> TableWriter:
        """Open the hidden file. Raises InputError where the folder cannot be written to."""
        beside = self._ending.enter_context(replacing(self.path))
        file = self._ending.enter_context(open(beside, "w", newline="", encoding="utf-8"))
        self._writer = csv.writer(file, lineterminator="\n")
        if self.names:
            self._writer.writerow(self.names)
        return self

    def append(self, columns: Mapping[str, Any]) -> None:
        """Add rows: a sequence or an array of one length for each of the table's columns.

        Floats get 9 significant digits, NaN and None an empty cell. Raises InputError where names
        or lengths differ.
        """
        lengths = {name: len(values) for name, values in columns.items()}
        if not self.names:
            self.names = tuple(columns)
            self._writer.writerow(self.names)
        if tuple(columns) != self.names:
            raise InputError(
                f"{self.path}: columns {list(columns)} for a table of {list(self.names)}; give "
                "each of its columns, in its order"
            )
        if len(set(lengths.values())) > 1:
            raise InputError(
                f"{self.path}: columns differ in length, {lengths}; give as many values to each"
            )
        self._writer.writerows(zip(*map(_cells, columns.values()), strict=True))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the table its name after a clean block; else discard it."""
        self._ending.__exit__(kind, error, trace)


def write_csv(path: str | Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Write a table, one named column each, units in the names (`wear_depth_um`).

    Parameters: `columns`, name to values, all of one length. Floats get 9 significant digits,
    NaN and None an empty cell. Raises InputError where the lengths differ.
    """
    count = max((len(values) for values in columns.values()), default=0)
    with TableWriter(path) as table:
        for start in range(0, max(count, 1), _AT_ONCE):
            table.append(
                {name: values[start : start + _AT_ONCE] for name, values in columns.items()}
            )


def csv_text(columns: Mapping[str, Any]) -> str:
    """A table as the text that `write_csv` would write, to be put together with others.

    Parameters: `columns`, name to values, all of one length.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*map(_cells, columns.values()), strict=True))
    return text.getvalue()


def _cells(values: Any) -> list[str]:
    """Values as the text of their cells; long arrays of floats by the short way."""
    if isinstance(values, np.ndarray) and values.dtype.kind == "f" and np.isfinite(values).all():
        return [f"{value:.{DIGITS}g}" for value in values.tolist()]
    return [_cell(value) for value in values]


def _cell(value: Any) -> str:
    value = plain(value)
    if value is None:
        return ""
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)


def read_csv(path: str | Path) -> dict[str, list[Any]]:
    """Read a table: column name to values, numbers where all cells are (empty: NaN), else text.

    Raises InputError where the file cannot be read or a row is of another length.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a readable CSV table ({error}); check the file") from error
    if not rows:
        raise InputError(f"{path}: an empty table; give one with a header line")
    header, *body = rows
    for number, row in enumerate(body, start=2):
        if len(row) != len(header):
            raise InputError(
                f"{path}: line {number} has {len(row)} cells and the header {len(header)}; "
                "correct that line"
            )
    return {name: _numbers([row[i] for row in body]) for i, name in enumerate(header)}


def numbers(values: Iterable[float | None]) -> npt.NDArray[np.float64]:
    """A column of numbers (n,), NaN where one is not known (None)."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def check_given_table(path: Path, what: str) -> None:
    """Refuse what is no table that somebody gives: no plain file, or one of over 10 MB.

    Parameters: `path`; `what` it is to be, in words. Raises InputError; OSError where it is missing
    or may not be looked at.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: is not a file; name {what} itself, a CSV file")
    if found.st_size > MOST_GIVEN:
        raise InputError(
            f"{path}: larger than {MOST_GIVEN} bytes; is it {what}? name that, a CSV file"
        )


def _numbers(cells: list[str]) -> list[Any]:
    try:
        return [float(c) if c.strip() else math.nan for c in cells]
    except ValueError:
        return list(cells)
