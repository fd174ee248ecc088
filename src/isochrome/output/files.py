"""Folders, text and JSON on disk: whole, or not at all."""

import errno
import json
import math
import os
import secrets
import shutil
import tempfile
from array import array
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.messages import message

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)
"""What the system says of a full, lost or protected disk."""
_AT_ONCE = 4096
"""Values of a long list that are text in memory at a time."""


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
        raise InputError(
            "results_cannot_written_there", folder=folder, strerror=error.strerror
        ) from error
    return folder


def check_link(folder: Path) -> None:
    """Refuse a folder that is a symbolic link to nowhere, as when its drive is not there.

    To make what it points to would put results where nobody looks for them.
    """
    if folder.is_symlink() and not os.path.exists(folder):
        raise InputError("symbolic_link_which_not", folder=folder, target=os.readlink(folder))


@contextmanager
def staged(out_dir: str | Path) -> Iterator[Path]:
    """Give a hidden folder beside the results; its files move there when all went well.

    On an exception nothing of them is left, nor `out_dir` when it was made here, and what was there
    before is there again.
    """
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
        raise InputError(
            "cannot_written_make_room", place=place, strerror=error.strerror
        ) from error


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
        raise InputError(
            "cannot_written_make_folder", file=target, strerror=error.strerror
        ) from error
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


def json_pieces(obj: Any) -> Iterator[str]:
    """The text ``json.dumps(plain(obj))`` piece by piece: a long table is never all text."""
    if isinstance(obj, Mapping):
        for number, (key, value) in enumerate(obj.items()):
            yield f"{', ' if number else '{'}{json.dumps(str(key))}: "
            yield from json_pieces(value)
        yield "}" if obj else "{}"
    elif isinstance(obj, list | tuple | array) and len(obj) > _AT_ONCE:
        for start in range(0, len(obj), _AT_ONCE):
            piece = json.dumps(plain(obj[start : start + _AT_ONCE]), allow_nan=False)
            yield f"{', ' if start else '['}{piece[1:-1]}"
        yield "]"
    else:
        yield json.dumps(plain(obj), allow_nan=False)


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
    if isinstance(obj, str | int | bool) or obj is None:
        return obj
    return str(obj)
