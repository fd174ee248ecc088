"""Folders, text and JSON on disk: whole, or not at all."""

from __future__ import annotations

import json
import math
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from isochrome.errors import InputError


def output_folder(path: str | Path) -> Path:
    """Make a folder for results, with its parents, and see that it can be written to.

    Parameters: `path`, the folder. Returns it as a Path. Raises InputError where it is a file,
    or where it cannot be made or written to.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except FileExistsError as error:
        raise InputError(f"{folder}: is a file, not a folder; name another --out folder") from error
    except OSError as error:
        raise InputError(
            f"{folder}: results cannot be written there ({error.strerror}); name another folder"
        ) from error
    return folder


@contextmanager
def staged(out_dir: str | Path) -> Iterator[Path]:
    """A hidden folder beside the results; its files move to `out_dir` when all went well.

    Parameters: `out_dir`, the folder for the results. Yields a folder to write all results to.
    On an exception nothing of them is left, nor `out_dir` when it was made here.
    """
    target = Path(out_dir)
    made = not target.exists()
    target = output_folder(target)
    stage = Path(tempfile.mkdtemp(prefix=".isochrome-", dir=target))
    try:
        yield stage
        for file in sorted(p for p in stage.rglob("*") if p.is_file()):
            place = target / file.relative_to(stage)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(file, place)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        if made:
            with suppress(OSError):  # not empty: the results are there
                target.rmdir()


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A hidden name beside `path` that becomes `path` on success and vanishes on failure.

    Parameters: `path`, the file wanted. Yields the path to write to. Raises InputError where the
    folder is missing or not writable.
    """
    target = Path(path)
    beside = target.with_name(f".{target.stem}-{secrets.token_hex(4)}{target.suffix}")
    try:
        if target.is_dir():
            raise IsADirectoryError(21, "it is a folder")
        beside.touch(exist_ok=False)
    except OSError as error:
        raise InputError(
            f"{target}: cannot be written ({error.strerror}); make its folder, or name another"
        ) from error
    try:
        yield beside
        os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write text as UTF-8 with plain line ends, whole or not at all. Raises InputError."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: str | Path, obj: Any) -> None:
    """Write an object as JSON; numpy values become plain, NaN and infinity become null."""
    write_text(path, json.dumps(plain(obj), indent=2, allow_nan=False) + "\n")


def plain(obj: Any) -> Any:
    """An object made of what JSON knows: numpy scalars and arrays, paths, NaN to None.

    Parameters: `obj`, nested mappings, sequences and arrays. Returns the same in plain Python.
    """
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
