"""Whether results are those that were left: a record of all their files, with sizes and checksums.
It is the folder's provenance.json (of a campaign its summary.json). CRC-32C (Castagnoli), that of
zarr's crc32c codec: it finds damage, not forgery."""

import json
import os
import stat
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from operator import methodcaller
from pathlib import Path, PurePath
from typing import Any

import google_crc32c
import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.messages import message, warnings_json
from isochrome.output import Result, counted, plain, write_text
from isochrome.progress import RunProgress, Tally

PROVENANCE = "provenance.json"
SUMMARY = "summary.json"
"""The record of a campaign, whose recordings have a folder and a record each."""
REPORT = "report.html"
"""A view of the results, which `isochrome report` makes anew: a run is whole without it."""

_SIZES, _SUMS, _OWN = "outputs", "outputs_crc32c", "record_crc32c"
_OWN_KEYS = (b'"outputs_crc32c": {', b'"record_crc32c": "')
"""As they stand in a record, whatever else of it is damaged."""
SUM_BYTES = 4
"""Bytes of the checksum at the end of a chunk in a store, by zarr's crc32c codec."""
_MISSING = "is missing"
_BEHIND_LINK = "lies_behind_link_what"
_BLOCK = 1 << 19
"""Bytes that are read at a time: few enough to be in the processor's cache for their checksum."""
_MOST = 1 << 28
"""Bytes of a record: of a million files. What is larger is none."""


def crc32c(*pieces: Any) -> int:
    """CRC-32C of bytes-like pieces, one after the other."""
    checksum = 0
    for piece in pieces:
        checksum = google_crc32c.extend(checksum, np.frombuffer(piece, np.uint8))
    return int(checksum)


def sum_bytes(checksum: int) -> bytes:
    """A checksum as zarr's crc32c codec puts it behind a chunk."""
    return checksum.to_bytes(SUM_BYTES, "little")


_OF_SUMMED = crc32c(sum_bytes(crc32c()))
"""The checksum of all that ends with the checksum of what lies before it."""


def is_plain(path: Path) -> bool:
    """Whether a regular file is there, and not a link to one: what else is may never end."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def is_record(path: Path) -> bool:
    """Whether a file may be a record of something: it is read at once."""
    return is_plain(path) and path.stat().st_size <= _MOST


def has_own_keys(path: Path) -> bool:
    """Whether a file is a record that this version has left, however damaged."""
    return is_record(path) and any(key in path.read_bytes() for key in _OWN_KEYS)


def checksum_of(pieces: Iterable[Any]) -> int:
    """The checksum of a file of these pieces: that of all of it, or the one at its end. All that
    end with the checksum of what lies before, as a store's chunks do, would have the same."""
    checksum, end = 0, b""
    for piece in pieces:
        data = np.frombuffer(piece, np.uint8)
        checksum = google_crc32c.extend(checksum, data)
        end = (end + data[-SUM_BYTES:].tobytes())[-SUM_BYTES:]
    return int.from_bytes(end, "little") if checksum == _OF_SUMMED else checksum


def file_sum(path: Path) -> int:
    """The checksum of a file, as `checksum_of` gives it. Raises OSError."""
    with open(path, "rb") as file:
        return checksum_of(iter(partial(file.read, _BLOCK), b""))


def write_through(path: Path, *data: bytes | memoryview) -> None:
    """Write a file beside its place, through to the disk, and give it its name. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    with open(beside, "wb") as file:
        for piece in data:
            file.write(piece)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
    sync_folder(path.parent)


def write_checked(path: Path, body: dict[str, Any]) -> None:
    """Write an object as JSON below a line with its checksum: every float keeps all its bits,
    numpy's too. Raises OSError."""
    text = json.dumps(body, default=methodcaller("item")).encode()
    write_through(path, b"%08x\n" % crc32c(text), text)


def read_checked(path: Path) -> Any:
    """What `write_checked` wrote; None where it is not there, or not whole. Raises OSError."""
    try:
        head, _, body = path.read_bytes().partition(b"\n")
    except FileNotFoundError:
        return None
    return json.loads(body) if head == b"%08x" % crc32c(body) else None


def sync_folder(folder: Path) -> None:
    """Make a folder's names survive a power cut, where the system knows such a thing."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@dataclass(frozen=True)
class ResultsRecord:
    """A folder of results by its record: the `place`, and all that the `record` says."""

    place: Path
    record: Mapping[str, Any] = field(repr=False)

    @property
    def older(self) -> bool:
        """Whether an earlier version left it, which kept no checksums."""
        return _SUMS not in self.record

    @cached_property
    def sizes(self) -> Mapping[str, int]:
        """Bytes of each file, by its path in the folder; of older results without the report."""
        sizes = self.record.get(_SIZES)
        known = sizes if isinstance(sizes, dict) else {}
        return {name: size for name, size in known.items() if name != REPORT or not self.older}

    def fault(self, name: str, *, content: bool = True) -> str:
        """What is wrong with a file, in words, its `content` read or not; empty where nothing
        is."""
        path = self.place / name
        try:
            if any((self.place / above).is_symlink() for above in PurePath(name).parents[:-1]):
                return message(_BEHIND_LINK)
            status = path.lstat()
        except (FileNotFoundError, NotADirectoryError):
            return _MISSING
        except OSError as error:
            return f"cannot be looked at ({error.strerror})"
        if stat.S_ISLNK(status.st_mode):
            return "is a link"
        if not stat.S_ISREG(status.st_mode):
            return "is no file"
        size, expected = status.st_size, self.sizes[name]
        if size != expected:
            return message("has_bytes_left", size=size, expected=expected)
        if self.older or not content:
            return ""
        try:
            return self._sum_fault(name, file_sum(path))
        except OSError as error:
            return message("cannot_read_2", strerror=error.strerror)

    def check(self, names: Iterable[str] = ()) -> None:
        """Refuse results of which a file is gone or of another size, or `names` of another content.
        Passed over: names that the record does not have, and the report, which may be made anew."""
        to_read = set(names)
        for name in self.sizes:
            if name != REPORT or name in to_read:
                self._refuse(name, self.fault(name, content=name in to_read))

    @cached_property
    def _sound(self) -> set[str]:
        """Files that were summed, and are as they were left: of large ones many parts are read."""
        return set()

    def read(self, name: str, part: slice = slice(None)) -> NDArray[np.uint8]:
        """Bytes of a file, by default all; before its first part all of it is looked at. Raises
        InputError where they are not those that were left."""
        first, last, _ = part.indices(self.sizes[name])
        whole = last - first == self.sizes[name]
        self._refuse(name, self.fault(name, content=not (whole or name in self._sound)))
        try:
            data = np.fromfile(self.place / name, np.uint8, last - first, offset=first)
            fault = self._sum_fault(name, checksum_of([data])) if whole else ""
        except OSError as error:
            fault = message("cannot_read_2", strerror=error.strerror)
        self._refuse(name, fault)
        self._sound.add(name)
        return data

    def _sum_fault(self, name: str, checksum: int) -> str:
        same = self.record[_SUMS].get(name) == f"{checksum:08x}"
        return "" if same else message("damaged_checksum_another")

    def _refuse(self, name: str, what: str) -> None:
        if what:
            place = self.place
            raise InputError("run_command_left_again", name=place / name, what=what, place=place)


def seal(
    folder: Path,
    record: Mapping[str, Any],
    *,
    known: Mapping[str, int] | None = None,
    file: str = PROVENANCE,
    names: Iterable[str] | None = None,
) -> None:
    """Write down what results are of, and all their files: last, when these are there. `known`,
    checksums by the path of a file; `file`, the record's; `names`, by default of all files."""
    if names is None:
        paths = (path for path in folder.rglob("*") if path.is_file())
        names = sorted(path.relative_to(folder).as_posix() for path in paths)
    names = [name for name in names if name != file]
    sums = known or {}
    _write(folder / file, record, {n: sums.get(n) or file_sum(folder / n) for n in names})


def reseal(folder: Path, name: str) -> None:
    """Take a file that was made anew into a folder's record, where that has one of its kind."""
    known = read_record(folder)
    if known is None or known.older or name not in known.sizes:
        return
    _write(folder / PROVENANCE, known.record, {name: file_sum(folder / name)})


def _write(path: Path, record: Mapping[str, Any], sums: Mapping[str, int]) -> None:
    """A record with sizes and checksums of files, and its own: of its text with noughts for it."""
    sizes = {name: (path.parent / name).stat().st_size for name in sums}
    texts = {name: f"{checksum:08x}" for name, checksum in sums.items()}
    bare = {key: value for key, value in record.items() if key != _OWN}
    bare |= {_SIZES: bare.get(_SIZES, {}) | sizes, _SUMS: bare.get(_SUMS, {}) | texts}
    text = json.dumps(plain(bare | {_OWN: "0" * 8}), indent=2, allow_nan=False) + "\n"
    write_text(path, text.replace(_line("0" * 8), _line(f"{crc32c(text.encode()):08x}")))


def _line(checksum: str) -> str:
    return f'"{_OWN}": "{checksum}"\n}}\n'


def read_record(place: Path, file: str = PROVENANCE) -> ResultsRecord | None:
    """A folder's record; None where it has none. Raises InputError where it is damaged."""
    path = place / file
    try:
        status = path.lstat()
        if not stat.S_ISREG(status.st_mode):
            raise InputError("no_file_run_command", path=path, place=place)
        if status.st_size > _MOST:
            raise InputError("has_bytes_no_record", path=path, st_size=status.st_size)
        text = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError("cannot_read_see_drive", path=path, strerror=error.strerror) from error
    try:
        record = json.loads(text)
        checksum = record.get(_OWN)
        as_left = checksum is None and _SUMS not in record
        if isinstance(checksum, str):
            bare = text.replace(_line(checksum).encode(), _line("0" * 8).encode())
            as_left = checksum == f"{crc32c(bare):08x}" and isinstance(record[_SUMS], dict)
    except (ValueError, KeyError, AttributeError, RecursionError):
        as_left, record = False, {}
    if not as_left:
        raise InputError("damaged_so_nobody_knows", path=path, place=place)
    return ResultsRecord(place, record)


@dataclass(frozen=True, repr=False, kw_only=True)
class Verified(Result):
    """Whether a folder holds what was left in it.

    Parameters
    ----------
    folder : Path
        The folder.
    files : int
        How many files were read.
    damaged : mapping of str to str
        What is wrong with a file, by its path in the folder.
    warnings : tuple of str
        Folders of earlier versions, of whose files the sizes alone are known.
    """

    folder: Path
    files: int
    damaged: Mapping[str, str]
    warnings: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing is damaged."""
        return not self.damaged

    @property
    def title(self) -> str:
        """How many files there are, and how many of them are damaged."""
        what = f"{len(self.damaged)} of {counted(self.files, 'file')} damaged"
        return f"{self.folder}: {what if self.damaged else f'{self.files} files as they were left'}"

    @property
    def columns(self) -> dict[str, list[str]]:
        """The damaged files, and what is wrong with each."""
        return {"file": list(self.damaged), "fault": list(self.damaged.values())}

    def main_values(self) -> Iterable[tuple[str, str]]:
        """The damaged files."""
        return self.damaged.items()

    def to_json(self) -> dict[str, Any]:
        """What `--json` prints."""
        verdict = {"ok": self.ok, "folder": str(self.folder), "files": self.files}
        return verdict | {"damaged": dict(self.damaged), **warnings_json(self.warnings)}


def verify(folder: str | Path, *, progress: RunProgress | None = None) -> Verified:
    """Read all files of a results folder and hold them against the checksums that were left.

    Files that no command left there, such as exports, are not looked at.

    Parameters
    ----------
    folder : str or Path
        A folder that a command left; of a campaign with the folders of its recordings.
    progress : callable, optional
        Called with a Tally of the files.

    Returns
    -------
    Verified
        What is damaged.

    Raises
    ------
    InputError
        Where the folder holds no record of results, or a damaged one.

    Examples
    --------
    >>> import isochrome
    >>> found = isochrome.simulate("ring", "simulated")
    >>> isochrome.verify("simulated").ok
    True
    """
    place = Path(folder)
    known, damaged = _records_below(place)
    todo = [(record, name) for record in known for name in record.sizes]
    tell = progress or (lambda _: None)
    for number, (record, name) in enumerate(todo):
        tell(Tally(number, len(todo), 0, len(damaged)))
        if fault := record.fault(name):
            damaged[(record.place / name).relative_to(place).as_posix()] = fault
    tell(Tally(len(todo), len(todo), 0, len(damaged)))
    older = (message("has_no_checksums_results", place=r.place) for r in known if r.older)
    return Verified(folder=place, files=len(todo), damaged=damaged, warnings=tuple(older))


def _records_below(place: Path) -> tuple[list[ResultsRecord], dict[str, str]]:
    """The records of a folder and of its recordings; what is wrong with others, by their names."""
    damaged = dict[str, str]()
    records = {name: read_record(place, name) for name in (PROVENANCE, SUMMARY)}
    if not any(records.values()):
        raise InputError("holds_no_which_files", place=place, provenance=PROVENANCE)
    campaign = records[SUMMARY]
    for row in campaign.record.get("recordings", ()) if campaign is not None else ():
        name, recording = f"{row['folder']}/{PROVENANCE}", place / str(row["folder"])
        if row["status"] == "failed" and not recording.exists():
            continue
        fault = message(_BEHIND_LINK) if recording.is_symlink() else _MISSING
        try:
            records[name] = None if recording.is_symlink() else read_record(recording)
        except InputError as error:
            fault = str(error)
        if records.get(name) is None:
            damaged[name] = fault
    return [record for record in records.values() if record is not None], damaged


def opened_record(place: Path, names: Iterable[str] = ()) -> ResultsRecord | None:
    """The record of results to be read, whose sizes, and of `names` the content, are right; or
    None."""
    if (record := read_record(place)) is not None:
        record.check(names)
        if record.older:
            warn_unverified(place)
    return record


def name_damage(place: Path) -> None:
    """Refuse results by the file that is damaged, of which a library only knows that it is."""
    if (record := read_record(place)) is not None:
        record.check(record.sizes)


def warn_unverified(place: Path) -> None:
    """Say that nobody can tell whether results are those that were left."""
    warnings.warn(message("has_no_checksums_results", place=place), UserWarning, stacklevel=3)
