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
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.output import TiffCanvas, check_link, make_canvas, open_canvas
from isochrome.runs.chunks import (
    MANIFEST,
    RECORDS,
    RunFolder,
    read_checked,
    remove,
    sync_folder,
    write_checked,
)
from isochrome.runs.identity import difference
from isochrome.runs.job import Job, RunLayout
from isochrome.runs.lock import LOCK, OWNER
from isochrome.runs.store import STORE, WORKING, create_store

PROVENANCE = "provenance.json"
REPORT = "report.html"
"""A view of the results, which `isochrome report` makes anew: a run is whole without it."""

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


def is_complete(target: Path, job: Job) -> bool:
    """Whether a folder holds all results of a job, as its record names them."""
    stored = not job.layout.store or (target / STORE / "zarr.json").is_file()
    return stored and holds_results(target, job.identity)


def holds_results(target: Path, identity: Mapping[str, Any]) -> bool:
    """Tell whether a folder holds the files of a finished run of an identity, as its record says.

    Parameters
    ----------
    target : Path
        The folder.
    identity : mapping
        What the run is a result of, as in a Job.

    Returns
    -------
    bool
        Whether all of them are there.
    """
    try:
        record = json.loads((target / PROVENANCE).read_text("utf-8"))
        outputs = record.get("outputs")
        if not outputs or difference(record, identity) is not None:
            return False
        files = {name: size for name, size in outputs.items() if name != REPORT}
        sizes = [(target / name).stat().st_size == size for name, size in files.items()]
    except (OSError, ValueError, AttributeError):
        return False
    return all(sizes)


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
        if (root / FINISHED).exists():
            return RunFolder(results, root / RECORDS, job.layout, {})
        if results.is_dir():
            stacks = _stacks(results, job.layout, open_canvas)
            run = RunFolder(results, root / RECORDS, job.layout, stacks)
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
    results.mkdir()
    (root / RECORDS).mkdir()
    if layout.store:
        create_store(results / STORE, layout)
        shutil.copyfile(results / STORE / "zarr.json", root / _GROUP)
    stacks = _stacks(results, layout, partial(make_canvas, pixel_mm=layout.pixel_mm))
    sync_tree(root)
    body = {"identity": dict(job.identity), "layout": _described(layout), "token": token}
    write_checked(root / MANIFEST, body)
    return RunFolder(results, root / RECORDS, layout, stacks)


def _stacks(
    results: Path, layout: RunLayout, lay_out: Callable[[Path, tuple[int, int, int]], TiffCanvas]
) -> dict[str, TiffCanvas]:
    """The TIFF stacks of a run by the name of their layer, made or opened by `lay_out`."""
    stacks = {}
    for layer in (layer for layer in layout.layers if layer.stack):
        rows, cols = list(layout.shape.values())[-2:]
        _, count = layout.pages(layer, 0, layout.count)
        stacks[layer.name] = lay_out(results / f"{layer.name}.tif", (count, rows, cols))
    return stacks


def clear_up(run: RunFolder) -> None:
    """Remove what a killed run left half-written beside finished chunks. Raises OSError."""
    layers = {layer.name for layer in run.layout.layers}
    store = run.results / STORE
    keep = {STORE} | {f"{name}.tif" for name in run.stacks}
    inside = store.iterdir() if run.layout.store else ()
    for entry in [*run.results.iterdir(), *inside]:
        known = layers | {"zarr.json"} if entry.parent == store else keep
        if entry.name not in known:
            remove(entry)
    for folder in (*(store / name for name in layers), run.records):
        for file in folder.rglob(".*.part"):
            file.unlink()
    if run.layout.store:
        shutil.copyfile(run.records.parent / _GROUP, store / "zarr.json")


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
    return (run.records.parent / FINISHED).exists()


def sync_tree(folder: Path) -> None:
    """Put all files and names below a folder through to the disk. Raises OSError."""
    for path, _, files in os.walk(folder):
        for name in files:
            with open(os.path.join(path, name), "rb+") as file:
                os.fsync(file.fileno())
        sync_folder(Path(path))
