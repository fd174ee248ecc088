"""The working folder beside an output: what is finished of a run, until all of it is.

DIR.partial holds the manifest (what the run is a result of), the records of its finished chunks,
and, in a folder of its own, the files that become DIR. It goes when DIR is there.
"""

from __future__ import annotations

import json
import math
import os
import re
import secrets
import shutil
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.output import check_link
from isochrome.runs.chunks import (
    MANIFEST,
    RECORDS,
    RunFolder,
    read_checked,
    read_record_of,
    remove,
    sync_folder,
    write_checked,
)
from isochrome.runs.identity import difference, identity_digest
from isochrome.runs.integrity import is_plain, read_record
from isochrome.runs.job import Job, RunLayout
from isochrome.runs.lock import LOCK, OWNER
from isochrome.runs.store import STORE, WORKING, create_store

FINISHED = "finished"
_GROUP = "group.json"


def working_folder(out: Path) -> Path:
    """Name the folder where a run keeps what it has of its output.

    Parameters
    ----------
    out : Path
        The output folder.

    Returns
    -------
    Path
        The folder beside it.

    Raises
    ------
    InputError
        Where `out` is no place for results.
    """
    try:
        check_link(out)
        target = out.resolve()
        there = target.exists()
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError) as error:  # a link to itself, or no possible name
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{out}: results cannot be written there ({reason}); name another --out folder"
        ) from error
    if there and not target.is_dir():
        raise InputError(f"{out}: is a file, not a folder; name another --out folder")
    if target.parent == target or (there and os.path.ismount(target)):
        raise InputError(f"{out}: is the top of a drive; name a folder in it")
    if target.is_dir() and not os.access(target, os.W_OK):
        raise InputError(
            f"{out}: results cannot be written there (Permission denied); name another folder"
        )
    return target.with_name(target.name + WORKING)


def faults_of(target: Path, identity: Mapping[str, Any]) -> dict[str, str] | None:
    """What is damaged of the results that a run of an identity has left, by a file's path.

    None where the folder's record is of no such run, or is damaged itself.
    """
    try:
        known = read_record(target)
    except InputError:
        return None
    if known is None or known.older or difference(known.record, identity) is not None:
        return None
    return {name: fault for name in known.sizes if (fault := known.fault(name))}


def holds_results(target: Path, identity: Mapping[str, Any]) -> bool:
    """Whether a folder holds all results of an identity, as in a Job: all its files are read."""
    return faults_of(target, identity) == {}


def take_back(run: RunFolder, target: Path) -> None:
    """Take chunks that are left of damaged results back to work, of which only the record is known.

    Whether they are whole is looked at as in any run that goes on. Parameters: `run`, in a working
    folder; `target`, where the results lie. Raises OSError.
    """
    there = replace(run, results=target)
    for index in range(run.layout.chunks if run.layout.store else 0):
        record = None if run.record_file(index).exists() else read_record_of(there, index)
        if record is None:
            continue
        names = [run.chunk_file(name, index) for name in record["layers"]]
        names += [run.part_file(name, index) for name in record["parts"]]
        for place in (*names, run.record_file(index)):
            old = target / place.relative_to(run.results)
            if is_plain(old):
                place.parent.mkdir(parents=True, exist_ok=True)
                os.replace(old, place)


def open_run_folder(root: Path, job: Job, *, restart: bool) -> RunFolder:
    """The working folder of a run: as an earlier one of the same identity left it, or a new one.

    Parameters: `root`, locked; `job`; `restart`, to throw away what an earlier run left. Returns a
    RunFolder. Raises InputError where an earlier run was of something else, OSError.
    """
    manifest = None if restart else _manifest(root)
    if manifest is not None:
        changed = difference(manifest["identity"], job.identity)
        if changed is None and manifest["layout"] != _described(job.layout):
            changed = "the layout of the results"
        if changed is not None:
            raise InputError(
                f"{root}: holds an unfinished run, and since it began {changed} has changed; undo "
                "that to resume it, add --restart to begin anew, or name another --out folder"
            )
        results = root / manifest["token"]
        run = RunFolder(results, job.layout, identity_digest(job.identity))
        if (root / FINISHED).exists():
            return run
        if results.is_dir():
            clear_up(run)
            return run
    wipe(root)
    return _new(root, job)


def has_run(root: Path) -> bool:
    """Tell whether a working folder holds what an earlier run left.

    Parameters
    ----------
    root : Path
        The working folder.

    Returns
    -------
    bool
        Whether it does.
    """
    return _manifest(root) is not None


def wipe(root: Path) -> None:
    """Remove all that is in a working folder but its lock.

    Parameters
    ----------
    root : Path
        The working folder.

    Raises
    ------
    OSError
        Where the disk cannot be written or read.
    """
    for entry in sorted(root.iterdir(), key=lambda e: e.name != MANIFEST):
        if entry.name not in (LOCK, OWNER):
            remove(entry)


def _manifest(root: Path) -> dict[str, Any] | None:
    """What a run is a result of; None where it breaks off: so may all that was written after it."""
    try:
        found: dict[str, Any] = read_checked(root / MANIFEST)
        known = isinstance(found["identity"], dict) and isinstance(found["layout"], dict)
        inside = re.fullmatch(r"results-[0-9a-f]+", found["token"]) is not None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None  # no manifest of ours
    return found if known and inside else None


def _described(layout: RunLayout) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(asdict(layout)))
    return found


def _new(root: Path, job: Job) -> RunFolder:
    token = f"results-{secrets.token_hex(4)}"  # a dead run's last worker finds its folder gone
    results, layout = root / token, job.layout
    check_room(root, layout, layout.count)
    run = RunFolder(results, layout, identity_digest(job.identity))
    results.mkdir()
    run.records.mkdir()
    if layout.store:
        create_store(results / STORE, layout)
        shutil.copyfile(results / STORE / "zarr.json", root / _GROUP)
    sync_tree(root)
    body = {"identity": dict(job.identity), "layout": _described(layout), "token": token}
    write_checked(root / MANIFEST, body)
    return run


def clear_up(run: RunFolder) -> None:
    """Remove what a killed run left half-written beside finished chunks. Raises OSError."""
    layers, store, keep = set(run.layout.names), run.results / STORE, {STORE, RECORDS}
    inside = store.iterdir() if run.layout.store else ()
    for entry in [*run.results.iterdir(), *inside]:
        known = layers | {"zarr.json"} if entry.parent == store else keep
        if entry.name not in known:
            remove(entry)
    for folder in (*(store / name for name in layers), run.records):
        for file in folder.rglob(".*.part"):
            file.unlink()
    if run.layout.store:
        shutil.copyfile(run.root / _GROUP, store / "zarr.json")


def check_room(root: Path, layout: RunLayout, items: int) -> None:
    """Refuse a run whose pictures the disk cannot hold, before hours of work.

    Parameters: `root`, the working folder; `layout`; `items` still to come. Raises InputError.
    """
    pixels, pictures = math.prod(layout.shape.values()), -(-items // layout.every)
    needed = 0
    for layer in layout.layers:
        compact = layer.compact
        every_item = compact is not None and compact.pages
        needed += 4 * pixels * (items if every_item else pictures) * layer.stack
        needed += pixels * (4 * pictures if compact is None else items * compact.bits // 8)
    needed += (items + layout.count) * layout.part_bytes  # as parts, and put together
    free = shutil.disk_usage(root).free
    if needed > free:
        raise InputError(
            f"{root.with_suffix('')}: the results need {needed / 1e9:.3g} GB, and "
            f"{free / 1e9:.3g} GB are free there; make room, or name an --out folder elsewhere"
        )


def is_finished(run: RunFolder) -> bool:
    """Whether all results are made, and only have to be given their place."""
    return (run.root / FINISHED).exists()


def sync_tree(folder: Path) -> None:
    """Put all files and names below a folder through to the disk. Raises OSError."""
    for path, _, files in os.walk(folder):
        for name in files:
            with open(os.path.join(path, name), "rb+") as file:
                os.fsync(file.fileno())
        sync_folder(Path(path))
