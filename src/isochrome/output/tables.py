"""CSV tables: written at once or row by row, read as numbers where they are numbers."""

from __future__ import annotations

import csv
import io
import math
import re
import stat
from array import array
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import numpy.typing as npt

from isochrome.errors import InputError
from isochrome.output.files import plain, replacing

DIGITS = 9
"""Significant digits of a number in a table."""
_EXCEL = "_excel"
"""What the name of a table for Excel ends in."""
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
MOST_GIVEN = 10_000_000
"""Bytes of a table that somebody gives, such as a profile."""
_AT_ONCE = 4096
"""Rows of a long table that are text in memory at a time."""


class Floats(array):  # type: ignore[type-arg]  # takes none at run time before Python 3.12
    """A column of numbers, `Floats("d", values)`, NaN where one is not known.

    In eight bytes each, a quarter of what a list of them takes, which it is like in all else.
    """

    def __eq__(self, other: object) -> bool:
        """As a list of the same numbers."""
        return self.tolist() == list(other) if isinstance(other, Sequence) else NotImplemented

    def __repr__(self) -> str:
        """As a list's."""
        return repr(self.tolist())


def write_csv(path: str | Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Write a table, one named column each, units in the names (`wear_depth_um`).

    Floats get 9 significant digits, NaN and None an empty cell.

    Parameters
    ----------
    path : str or Path
        The file.
    columns : mapping of str to sequence
        Name to values, all of one length.

    Raises
    ------
    InputError
        Where the lengths differ, or the file cannot be written.
    """
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(
            f"{path}: columns differ in length, {lengths}; give as many values to each"
        )
    with replacing(path) as beside, open(beside, "w", newline="", encoding="utf-8") as file:
        _write_table(file, columns)


def columns_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Turn rows into the columns of a table.

    Parameters
    ----------
    rows : sequence of mapping
        Name to value of each row.

    Returns
    -------
    dict of str to list
        Name to values, in the order in which the names come up; None where a row has none.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def csv_text(columns: Mapping[str, Any], *, header: bool = True) -> str:
    """Give a table as the text that `write_csv` would write, to be put together with others.

    Parameters
    ----------
    columns : mapping of str to sequence
        Name to values, all of one length.
    header : bool, default True
        Whether the line of the names is wanted.

    Returns
    -------
    str
        The table's lines.
    """
    text = io.StringIO(newline="")
    _write_table(text, columns, header=header)
    return text.getvalue()


def write_excel_copies(folder: str | Path) -> list[Path]:
    """Write each table of a folder once more, as a German or French Excel opens it in columns.

    Semicolons between the cells, decimal commas, and a byte-order mark, by which Excel knows UTF-8.

    Parameters
    ----------
    folder : str or Path
        The folder; tables of folders in it count, as those of a campaign's recordings.

    Returns
    -------
    list of Path
        The copies: NAME_excel.csv beside NAME.csv, which stays as it is.

    Raises
    ------
    InputError
        Where a table cannot be read, or a copy cannot be written.
    """
    made = []
    for path in sorted(Path(folder).rglob("*.csv")):
        if path.stem.endswith(_EXCEL) or any(part.endswith(".zarr") for part in path.parts):
            continue
        made.append(path.with_name(f"{path.stem}{_EXCEL}.csv"))
        _copy_for_excel(path, made[-1])
    return made


def _copy_for_excel(path: Path, copy: Path) -> None:
    try:
        with (
            open(path, newline="", encoding="utf-8-sig") as given,
            replacing(copy) as beside,
            open(beside, "w", newline="", encoding="utf-8-sig") as file,
        ):
            writer = csv.writer(file, delimiter=";", lineterminator="\r\n")
            for row in csv.reader(given):
                writer.writerow([_decimal_comma(cell) for cell in row])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a readable CSV table ({error}); check the file") from error


def _decimal_comma(cell: str) -> str:
    """A number with a decimal comma; all else as it is."""
    return cell.replace(".", ",") if _NUMBER.fullmatch(cell) else cell


def _write_table(file: TextIO, columns: Mapping[str, Any], *, header: bool = True) -> None:
    """Write a table's lines, some rows at a time."""
    writer = csv.writer(file, lineterminator="\n")
    if header:
        writer.writerow(columns)
    count = max(map(len, columns.values()), default=0)
    for start in range(0, count, _AT_ONCE):
        parts = (_cells(values[start : start + _AT_ONCE]) for values in columns.values())
        writer.writerows(zip(*parts, strict=True))


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
    """Read a table: numbers where all cells of a column are, else text.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    dict of str to list
        Name to values; an empty cell among numbers is NaN.

    Raises
    ------
    InputError
        Where the file cannot be read or a row is of another length.
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
    """Make an array of a column of numbers.

    Parameters
    ----------
    values : iterable of float or None
        The column; None = not known.

    Returns
    -------
    ndarray, shape (n,)
        The numbers, NaN where one is not known.
    """
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def check_given_table(path: Path, what: str) -> None:
    """Refuse what is no table that somebody gives: no plain file, or one of over 10 MB.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it is to be, in words.

    Raises
    ------
    InputError
        Where it is no such table.
    OSError
        Where it is missing or may not be looked at.
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
