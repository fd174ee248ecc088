"""The working folder beside an output: what is finished of a run, until all of it is.

DIR.partial holds the manifest (what the run is a result of), the records of its finished chunks,
and, in a folder of its own, the files that become DIR. It goes when DIR is there.

One run at a time on one output: a lock that the system opens when its process dies.

The end of a run: its results take their place, and what was there before goes, or stays.
"""

from __future__ import annotations

import json
import math
import os
import re
import secrets
import shutil
import socket
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.output import check_link
from isochrome.runs.chunks import (
    MANIFEST,
    RECORDS,
    STORE,
    RunFolder,
    read_checked,
    read_record_of,
    remove,
    sync_folder,
    write_checked,
    write_through,
)
from isochrome.runs.integrity import (
    PROVENANCE,
    REPORT,
    has_own_keys,
    is_plain,
    is_record,
    read_record,
)
from isochrome.runs.job import Job, RunLayout, difference, identity_digest
from isochrome.runs.store import WORKING, create_store

if TYPE_CHECKING:
    from filelock import FileLock

LOCK, OWNER = "lock", "owner.txt"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder for this process alone; it is made if need be, and removed when left empty.

    Raises InputError.
    """
    from filelock import FileLock, Timeout

    lock, made = None, not os.path.lexists(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if folder.is_symlink():
            raise InputError("symbolic_link_remove_name", folder=folder)
        lock = FileLock(folder / LOCK, timeout=0, thread_local=False)
        lock.acquire()
        (folder / OWNER).write_text(f"process {os.getpid()} on {socket.gethostname()}", "utf-8")
    except Timeout:
        raise InputError("another_run_work_there", folder=folder, owner=_owner(folder)) from None
    except (OSError, NotImplementedError) as error:
        if lock is not None and lock.is_locked:
            _release(folder, lock)
        elif made:
            with suppress(OSError):
                folder.rmdir()
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            "results_cannot_written_there_name", folder=folder, reason=reason
        ) from error
    try:
        yield
    finally:
        _release(folder, lock)


def _release(folder: Path, lock: FileLock) -> None:
    """Open the lock, and remove the folder where nothing else is in it."""
    only_lock = False
    with suppress(OSError):  # the drive may be gone
        (folder / OWNER).unlink(missing_ok=True)
        only_lock = {entry.name for entry in folder.iterdir()} <= {LOCK}
        if only_lock and os.name != "nt":  # while it is held, so that nobody else waits for it
            (folder / LOCK).unlink()
    with suppress(OSError):
        lock.release()
    if only_lock:
        with suppress(OSError):
            (folder / LOCK).unlink(missing_ok=True)
            folder.rmdir()


def _owner(folder: Path) -> str:
    try:
        return (folder / OWNER).read_text("utf-8") or "unknown process"
    except OSError:
        return "unknown process"


FINISHED = "finished"
_GROUP = "group.json"


def working_folder(out: Path) -> Path:
    """Name the folder where a run keeps what it has of its output.

    Returns the folder beside it. Raises InputError.
    """
    try:
        check_link(out)
        target = out.resolve()
        exists = target.exists()
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError) as error:  # a link to itself, or no possible name
        reason = getattr(error, "strerror", None) or error
        raise InputError("results_cannot_written_there_name", folder=out, reason=reason) from error
    if exists and not target.is_dir():
        raise InputError("file_not_folder_name", folder=out)
    if target.parent == target or (exists and os.path.ismount(target)):
        raise InputError("top_drive_name_folder", out=out)
    if target.is_dir() and not os.access(target, os.W_OK):
        raise InputError("results_cannot_written_there_permission", out=out)
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
    placed = replace(run, results=target)
    for index in range(run.layout.chunks if run.layout.store else 0):
        record = None if run.record_file(index).exists() else read_record_of(placed, index)
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
            changed = message("layout_results")
        if changed is not None:
            raise InputError("holds_unfinished_run_since", root=root, changed=changed)
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
    """Tell whether a working folder holds what an earlier run left."""
    return _manifest(root) is not None


def wipe(root: Path) -> None:
    """Remove all that is in a working folder but its lock.

    Raises OSError.
    """
    for entry in sorted(root.iterdir(), key=lambda e: e.name != MANIFEST):
        if entry.name not in (LOCK, OWNER):
            remove(entry)


def _manifest(root: Path) -> dict[str, Any] | None:
    """What a run is a result of; None where it breaks off: so may all that was written after it."""
    try:
        manifest: dict[str, Any] = read_checked(root / MANIFEST)
        known = isinstance(manifest["identity"], dict) and isinstance(manifest["layout"], dict)
        inside = re.fullmatch(r"results-[0-9a-f]+", manifest["token"]) is not None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None  # no manifest of ours
    return manifest if known and inside else None


def _described(layout: RunLayout) -> dict[str, Any]:
    record: dict[str, Any] = json.loads(json.dumps(asdict(layout)))
    return record


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
            "results_need_gb_gb", out=root.with_suffix(""), needed=needed / 1e9, free=free / 1e9
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
            raise InputError("would_replaced_no_there", place=place, provenance=PROVENANCE)


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
    placing = {"placing": results.name, "outputs": dict.fromkeys(names, 0)}
    write_through(target / PROVENANCE, json.dumps(placing).encode())
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
