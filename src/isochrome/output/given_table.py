"""Tables of numbers that somebody gives: any usual delimiter, decimal points or commas."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.output.tables import check_given_table

_DELIMITERS = (";", "\t", ",")
"""In this order: a comma may be a decimal comma between semicolons, never the other way round."""
_COMMENT = "#"
_LONGEST = 80
"""Letters of a header in a message."""
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True)
class GivenTable:
    """The cells of a table that somebody gives; columns become numbers when they are asked for.

    Parameters
    ----------
    path : Path
        The file.
    names : tuple of str
        Names of the columns, from its header; empty where the first line is numbers already.
    cells : list of list of str
        The cells, a list a row.
    lines : list of int
        The rows' lines in the file, from 1.
    """

    path: Path
    names: tuple[str, ...]
    cells: list[list[str]] = field(repr=False)
    lines: list[int] = field(repr=False)

    @property
    def header(self) -> str:
        """Its columns' names, as a message may hold them."""
        text = ", ".join(self.names) or "no names"
        return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."

    def column(self, name: str) -> NDArray[np.float64]:
        """A column (n,) as finite numbers; InputError that names the line and cell on others."""
        place = self.names.index(name)
        values = [row[place] for row in self.cells]
        number = _number_reader(values)
        try:
            found = np.array([number(cell) for cell in values], dtype=float)
        except ValueError:
            found = np.array([_number_or_nan(number, cell) for cell in values])
        bad = np.flatnonzero(~np.isfinite(found))
        if len(bad):
            row = int(bad[0])
            raise InputError(
                f"{self.path}: line {self.lines[row]}: {name} = {values[row].strip()!r} is not "
                f"allowed: it is a finite number (as 0.25); correct it, or remove the line"
            )
        return found


def read_given_text(path: Path, what: str, *, fallback: str | None = None) -> str:
    """Read the text of a file that somebody gives, in UTF-8 with a byte-order mark or without one.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it is to be, in words, such as 'the friction'.
    fallback : str, optional
        Encoding of what is no UTF-8; without one that is refused.

    Returns
    -------
    str
        Its text.

    Raises
    ------
    InputError
        Where it is no plain file, too large, cannot be read, or is no text.
    """
    try:
        check_given_table(path, what)
        given = path.read_bytes()
    except OSError as error:
        why = error.strerror or str(error)
        raise InputError(f"{path}: {what} cannot be read ({why}); check its name") from error
    try:
        text = given.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if fallback is None:
            raise InputError(
                f"{path}: {what} cannot be read (not UTF-8 text); save it as UTF-8"
            ) from error
        text = given.decode(fallback)
    if "\0" in text:
        raise InputError(f"{path}: is no text; export {what} as a CSV file")
    return text


def numbered_lines(text: str) -> list[tuple[int, str]]:
    """Number the lines of a table from 1; empty ones and those that begin with # are passed over.

    Parameters
    ----------
    text : str
        The table's text.

    Returns
    -------
    list of tuple of int and str
        Number and line.
    """
    return [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith(_COMMENT)
    ]


def read_given_table(path: Path, what: str) -> GivenTable:
    """Read a table of numbers: UTF-8 text with one header line of names, then a line a row.

    Columns are parted by semicolons, tabs, commas or spaces; numbers have decimal points, or
    decimal commas where commas part no columns. Empty lines and those that begin with # are passed
    over.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it is to be, in words, such as 'the friction'.

    Returns
    -------
    GivenTable
        Its cells.

    Raises
    ------
    InputError
        Where it cannot be read, is empty, or a row has another number of cells than the header.
    """
    lines = numbered_lines(read_given_text(path, what))
    if not lines:
        raise InputError(f"{path}: an empty table; give one with a header line")
    try:
        cells = _parted([line for _, line in lines])
    except csv.Error as error:
        raise InputError(f"{path}: {what} is no table ({error}); check the file") from error
    header = [cell.strip() for cell in cells[0]]
    has_names = not all(_is_number(cell) for cell in header)
    first = int(has_names)
    for (number, _), row in zip(lines[first:], cells[first:], strict=True):
        if len(row) != len(header):
            raise InputError(
                f"{path}: line {number} has {len(row)} cells and the first line {len(header)}; "
                "correct that line (between commas, numbers need decimal points)"
            )
    names = tuple(header) if has_names else ()
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise InputError(f"{path}: the column {double[0]} stands there twice; remove one")
    return GivenTable(path, names, cells[first:], [number for number, _ in lines[first:]])


def _parted(lines: list[str]) -> list[list[str]]:
    """Lines as cells, by the delimiter that the first of them has."""
    delimiter = next((d for d in _DELIMITERS if d in lines[0]), None)
    return [
        next(csv.reader([line], delimiter=delimiter or " "))
        if '"' in line
        else line.split(delimiter)
        for line in lines
    ]


def _number_reader(values: list[str]) -> Callable[[str], float]:
    """How the cells of a column are numbers: with decimal points, or all with decimal commas."""
    commas = any("," in cell for cell in values)
    if commas and not any("." in cell for cell in values):
        return lambda cell: _plain(cell.replace(",", ".")) if _comma_or_whole(cell) else math.nan
    return _plain


def _comma_or_whole(cell: str) -> bool:
    return "," not in cell or _DECIMAL_COMMA.fullmatch(cell) is not None


def _plain(cell: str) -> float:
    """A number as it is written everywhere; Python's own 1_000 is none."""
    return math.nan if "_" in cell else float(cell)


def _number_or_nan(number: Callable[[str], float], cell: str) -> float:
    try:
        return number(cell)
    except ValueError:
        return math.nan


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
