"""Folders, text, JSON and CSV on disk, whole or not at all; tables of numbers that somebody
gives."""

import csv
import errno
import io
import json
import math
import os
import re
import secrets
import shutil
import stat
import tempfile
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.messages import message

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)
"""What the system says of a full, lost or protected disk."""
_AT_ONCE = 4096
"""Rows of a table that are text in memory at a time."""


def output_folder(path: str | Path) -> Path:
    """Make a folder for results, with its parents, and see that it can be written to."""
    folder = Path(path)
    try:
        check_link(folder)
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except FileExistsError as error:
        raise InputError("file_not_folder_name", folder=folder) from error
    except OSError as error:
        why = error.strerror
        raise InputError("results_cannot_written_there", folder=folder, strerror=why) from error
    return folder


def check_link(folder: Path) -> None:
    """Refuse a link to nowhere, as when a drive is not there: nobody would look behind it."""
    if folder.is_symlink() and not os.path.exists(folder):
        raise InputError("symbolic_link_which_not", folder=folder, target=os.readlink(folder))


@contextmanager
def staged(out_dir: str | Path) -> Iterator[Path]:
    """Give a hidden folder beside the results; its files move there when all went well, or none."""
    target = Path(out_dir)
    made = not os.path.exists(target)
    target = output_folder(target)
    stage = None
    try:
        with _writing(target):
            stage = Path(tempfile.mkdtemp(prefix=".isochrome-", dir=target))
            yield stage
            _move_all(stage, target)
    finally:
        if stage is not None:
            shutil.rmtree(stage, ignore_errors=True)
        if made:
            with suppress(OSError):  # not empty: the results are there
                target.rmdir()


def _move_all(stage: Path, target: Path) -> None:
    """Give all files their places, or none: on an error what was there is put back."""
    old = Path(tempfile.mkdtemp(prefix=".isochrome-", dir=target))
    undo: list[tuple[Path, Path | None]] = []
    try:
        for number, file in enumerate(sorted(p for p in stage.rglob("*") if p.is_file())):
            place = target / file.relative_to(stage)
            place.parent.mkdir(parents=True, exist_ok=True)
            moved = old / str(number) if os.path.lexists(place) else None
            if moved is not None:
                os.rename(place, moved)
            undo.append((place, moved))
            os.rename(file, place)
    except BaseException:
        for place, moved in reversed(undo):
            with suppress(OSError):
                place.unlink(missing_ok=True)
            if moved is not None:
                os.rename(moved, place)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)


@contextmanager
def _writing(place: Path) -> Iterator[None]:
    """Turn what the system says when nothing more can be written into an InputError."""
    try:
        yield
    except OSError as error:
        if error.errno not in FULL:
            raise
        why = error.strerror
        raise InputError("cannot_written_make_room", place=place, strerror=why) from error


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a hidden name beside `path` that becomes `path` on success and vanishes on failure."""
    target = Path(path)
    beside = target.with_name(f".{target.stem}-{secrets.token_hex(4)}{target.suffix}")
    try:
        if target.is_dir():
            raise IsADirectoryError(21, message("folder"))
        beside.touch(exist_ok=False)
    except OSError as error:
        why = error.strerror
        raise InputError("cannot_written_make_folder", file=target, strerror=why) from error
    try:
        with _writing(target):
            yield beside
            os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write text as UTF-8 with plain line ends, whole or not at all."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: str | Path, obj: Any) -> None:
    """Write an object as JSON; numpy values become plain, NaN and infinity become null."""
    write_text(path, json.dumps(plain(obj), indent=2, allow_nan=False) + "\n")


def plain(obj: Any) -> Any:
    """An object as what JSON knows: no numpy scalars, arrays or paths, and None for NaN."""
    if isinstance(obj, Mapping):
        return {str(k): plain(v) for k, v in obj.items()}
    if hasattr(obj, "tolist"):
        return plain(obj.tolist())
    if isinstance(obj, list | tuple | set | frozenset):
        return [plain(v) for v in obj]
    if isinstance(obj, float):
        return obj if math.isfinite(obj) else None
    return obj if isinstance(obj, str | int | bool) or obj is None else str(obj)


_DELIMITERS = (";", "\t", ",")
"""In this order: a comma may be a decimal comma between semicolons, never the other way round."""
_COMMENT = "#"
_LONGEST = 80
"""Letters of a header in a message."""
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True)
class GivenTable:
    """The cells of a table that somebody gives: `names`, empty where the first line is numbers;
    `lines`, the rows', from 1."""

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
        # with decimal points, or all with decimal commas
        commas = any("," in cell for cell in values) and not any("." in cell for cell in values)
        column = np.array([_number(cell, commas=commas) for cell in values], dtype=float)
        for row in np.flatnonzero(~np.isfinite(column)).tolist():
            line, cell = self.lines[row], values[row].strip()
            raise InputError(
                "line_not_allowed_finite", path=self.path, lines=line, name=name, values=cell
            )
        return column


def read_given_text(path: Path, what: str, *, fallback: str | None = None) -> str:
    """The text of a file that somebody gives, `what` it is to be, in UTF-8 or the `fallback`."""
    try:
        check_given_table(path, what)
        given = path.read_bytes()
    except OSError as error:
        why = error.strerror or str(error)
        raise InputError("cannot_read_check_name_3", path=path, what=what, why=why) from error
    try:
        text = given.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if fallback is None:
            raise InputError("cannot_read_not_utf", path=path, what=what) from error
        text = given.decode(fallback)
    if "\0" in text:
        raise InputError("no_text_export_csv", path=path, what=what)
    return text


def numbered_lines(text: str) -> list[tuple[int, str]]:
    """Number the lines of a table from 1, without empty ones and those that begin with #."""
    lines = enumerate(text.splitlines(), start=1)
    return [(number, line) for number, line in lines if line.lstrip()[:1] not in ("", _COMMENT)]


def read_given_table(path: Path, what: str) -> GivenTable:
    """Read a table of numbers: UTF-8 text with one header line of names, then a line a row. Columns
    are parted by semicolons, tabs, commas or spaces; commas that part none are decimal."""
    lines = numbered_lines(read_given_text(path, what))
    if not lines:
        raise InputError("empty_table_give_one", path=path)
    delimiter = next((d for d in _DELIMITERS if d in lines[0][1]), None)
    try:
        cells = [
            next(csv.reader([line], delimiter=delimiter or " "))
            if '"' in line
            else line.split(delimiter)
            for _, line in lines
        ]
    except csv.Error as error:
        raise InputError("no_table_check_file", path=path, what=what, error=error) from error
    header = [cell.strip() for cell in cells[0]]
    # a first line of numbers names nothing
    numbers_only = all(math.isfinite(_number(cell, commas=True)) for cell in header)
    names = () if numbers_only else tuple(header)
    rows, places = cells[1:], [number for number, _ in lines[1:]]
    _check_lengths("line_has_cells_first", path, header, zip(places, rows, strict=True))
    if double := sorted({name for name in names if names.count(name) > 1}):
        raise InputError("column_stands_there_twice", path=path, double=double[0])
    return GivenTable(path, names, rows, places)


def _check_lengths(
    code: str, path: str | Path, header: list[str], rows: Iterable[tuple[int, list[str]]]
) -> None:
    """Refuse the first of some rows, each with its line, that has not as many cells as the head."""
    for number, row in rows:
        if len(row) != len(header):
            raise InputError(
                code, path=path, number=number, row_count=len(row), header_count=len(header)
            )


def _number(cell: str, *, commas: bool) -> float:
    """A number, with a decimal comma or not, NaN for all else; Python's own 1_000 is none."""
    if commas and "," in cell and _DECIMAL_COMMA.fullmatch(cell) is None:
        return math.nan
    try:
        return math.nan if "_" in cell else float(cell.replace(",", ".") if commas else cell)
    except ValueError:
        return math.nan


DIGITS = 9
"""Significant digits of a number in a table."""
_EXCEL = "_excel"
"""What the name of a table for Excel ends in."""
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
MOST_GIVEN = 10_000_000
"""Bytes of a table that somebody gives, such as a profile."""


class Floats(array):  # type: ignore[type-arg]  # takes none at run time before Python 3.12
    """A column of numbers, NaN = not known, in a quarter of the room of a list, which it is
    like."""

    def __eq__(self, other: object) -> bool:
        """As a list of the same numbers."""
        return self.tolist() == list(other) if isinstance(other, Sequence) else NotImplemented

    def __repr__(self) -> str:
        return repr(self.tolist())


def write_csv(path: str | Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Write a table, one named column each: floats in 9 digits, NaN and None an empty cell."""
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError("columns_differ_length_give", path=path, lengths=lengths)
    with replacing(path) as beside, open(beside, "w", newline="", encoding="utf-8") as file:
        _write_table(file, columns)


def columns_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Rows as the columns of a table; None where a row has none. Of an hour of video there are a
    hundred thousand: numbers are Floats, and a text that is the one before takes no room."""
    table: dict[str, Any] = {}
    for number, row in enumerate(rows):
        for name, value in row.items():
            if name not in table:
                first = not number and type(value) is float
                table[name] = Floats("d") if first else [None] * number
        for name, values in table.items():
            value = row.get(name)
            if isinstance(values, Floats) and type(value) is not float:
                values = table[name] = values.tolist()
            again = number and isinstance(value, str) and values[-1] == value
            values.append(values[-1] if again else value)
    return table


def csv_text(columns: Mapping[str, Any], *, header: bool = True) -> str:
    """A table as the text that `write_csv` would write, to be put together with others."""
    text = io.StringIO(newline="")
    _write_table(text, columns, header=header)
    return text.getvalue()


def write_excel_copies(folder: str | Path) -> list[Path]:
    """Write each table below a folder as NAME_excel.csv, which a German or French Excel opens:
    semicolons, decimal commas, and a byte-order mark."""
    made = []
    for path in sorted(Path(folder).rglob("*.csv")):
        if path.stem.endswith(_EXCEL) or any(part.endswith(".zarr") for part in path.parts):
            continue
        made.append(path.with_name(f"{path.stem}{_EXCEL}.csv"))
        # a number gets a decimal comma, all else stays
        rows = (
            [c.replace(".", ",") if _NUMBER.fullmatch(c) else c for c in row]
            for row in _csv_rows(path)
        )
        with (
            replacing(made[-1]) as beside,
            open(beside, "w", newline="", encoding="utf-8-sig") as file,
        ):
            csv.writer(file, delimiter=";", lineterminator="\r\n").writerows(rows)
    return made


def _csv_rows(path: str | Path) -> Iterator[list[str]]:
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            yield from csv.reader(file)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError("not_readable_csv_table", path=path, error=error) from error


def _write_table(file: TextIO, columns: Mapping[str, Any], *, header: bool = True) -> None:
    writer = csv.writer(file, lineterminator="\n")
    if header:
        writer.writerow(columns)
    for start in range(0, max(map(len, columns.values()), default=0), _AT_ONCE):
        parts = (_cells(values[start : start + _AT_ONCE]) for values in columns.values())
        writer.writerows(zip(*parts, strict=True))


def _cells(values: Any) -> list[str]:
    """Values as the text of their cells; long arrays of floats by the short way."""
    if isinstance(values, np.ndarray) and values.dtype.kind == "f" and np.isfinite(values).all():
        return [f"{value:.{DIGITS}g}" for value in values.tolist()]
    return [
        "" if v is None else f"{v:.{DIGITS}g}" if isinstance(v, float) else str(v)
        for v in map(plain, values)
    ]


def read_csv(path: str | Path) -> dict[str, list[Any]]:
    """Read a table: numbers where all cells of a column are, an empty one NaN; else text."""
    rows = [row for row in _csv_rows(path) if row]
    if not rows:
        raise InputError("empty_table_give_one", path=path)
    header, *body = rows
    _check_lengths("line_has_cells_header", path, header, enumerate(body, start=2))
    columns: dict[str, list[Any]] = {n: [row[i] for row in body] for i, n in enumerate(header)}
    for name, cells in columns.items():
        with suppress(ValueError):
            columns[name] = [float(c) if c.strip() else math.nan for c in cells]
    return columns


def numbers(values: Iterable[float | None]) -> NDArray[np.float64]:
    """A column of numbers as an array (n,), NaN where None says that one is not known."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def check_given_table(path: Path, what: str) -> None:
    """Refuse what is no table that somebody gives: no plain file, or one of over 10 MB."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise InputError("not_file_name_itself", path=path, what=what)
    if status.st_size > MOST_GIVEN:
        raise InputError("larger_bytes_name_csv", path=path, most_given=MOST_GIVEN, what=what)
