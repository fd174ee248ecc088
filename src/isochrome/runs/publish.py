"""The end of a run: its results take their place, and what was there before goes, or stays."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.runs.chunks import RunFolder, sync_folder, write_through
from isochrome.runs.integrity import PROVENANCE, REPORT, has_own_keys, is_record, read_record
from isochrome.runs.store import STORE
from isochrome.runs.work_folder import FINISHED, is_finished, sync_tree


def publish(run: RunFolder, target: Path) -> None:
    """Give finished results their place: by one rename, or file by file into an existing folder.

    Killed in between, the next run goes on with it. Parameters: `run`; `target`, the output
    folder. Raises OSError.
    """
    root = run.root
    if not is_finished(run):
        check_own(target, (entry.name for entry in run.results.iterdir()))
        sync_tree(run.results)
        write_through(root / FINISHED, b"")
    if not run.results.exists():
        pass  # all has its place
    elif target.exists():
        _clear_old(run.results, target)
        last = PROVENANCE  # what says that all is there
        for entry in sorted(run.results.iterdir(), key=lambda e: (e.name == last, e.name)):
            _replace(entry, target / entry.name, root)
        run.results.rmdir()
    else:
        os.rename(run.results, target)
    sync_folder(target)
    sync_folder(target.parent)


def check_own(target: Path, names: Iterable[str]) -> None:
    """Refuse to replace files that no run has left, such as a scene that somebody wrote.

    Parameters: `target`, the output folder; `names` of the results. Raises InputError.
    """
    outputs = _outputs(_record(target))
    known = {name.partition("/")[0] for name in outputs} | {PROVENANCE}
    known |= {STORE, REPORT} if outputs else set()  # of an earlier version too
    if not outputs and _has_damaged_record(target):
        return
    for name in names:
        place = target / name
        if name not in known and place.exists() and not place.is_symlink():
            raise InputError(
                f"{place}: would be replaced, and no {PROVENANCE} there says that a run has made "
                "it; move it away, or name another --out folder"
            )


def _record(target: Path) -> Mapping[str, Any]:
    """What an earlier run has left to say of itself; nothing where it cannot be read."""
    try:
        known = read_record(target)
    except InputError:
        return {}
    return {} if known is None else known.record


def _outputs(record: Mapping[str, Any]) -> list[str]:
    """The files of an earlier run, by its record."""
    outputs = record.get("outputs")
    return list(outputs) if isinstance(outputs, dict) else []


def _has_damaged_record(target: Path) -> bool:
    """Whether a run has left its results, and nobody knows any more which these are."""
    path, store = target / PROVENANCE, target / STORE / "zarr.json"
    if is_record(path):
        return has_own_keys(path)
    return is_record(store) and b'"source": "Isochrome"' in store.read_bytes()


def _clear_old(results: Path, target: Path) -> None:
    """Take from a folder what an older run says of it, and its files that have no successor.

    Else they would pass for results of the new one. What is left of the record are the names of
    all that runs have made there: should this one be killed here, the next knows them.
    """
    record = _record(target)
    outputs = _outputs(record)
    names = sorted({*outputs, *(entry.name for entry in results.iterdir())})
    left = {"placing": results.name, "outputs": dict.fromkeys(names, 0)}
    write_through(target / PROVENANCE, json.dumps(left).encode())
    if record.get("placing") == results.name:  # it was killed here: what is there are its own
        return
    for name in outputs:
        old = target / name
        if Path(name).name == name and not (results / name).exists() and not old.is_dir():
            old.unlink(missing_ok=True)


def _replace(source: Path, place: Path, root: Path) -> None:
    """Put a file or folder in the place of another, which a folder has to leave first."""
    if place.is_dir() and not place.is_symlink():
        old = root / f"old-{place.name}"
        if old.exists():
            shutil.rmtree(old)
        os.rename(place, old)
        shutil.rmtree(old)
    elif place.is_symlink():
        place.unlink()  # the link, never what it points to
    os.replace(source, place)
