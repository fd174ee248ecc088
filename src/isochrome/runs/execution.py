"""A long run: chunk after chunk, each kept when it is done; after a crash, it resumes there.
DIR.partial holds the manifest (what the run is a result of), and, in a folder of its own, the files
that become DIR, with the records of finished chunks. One run works on an output at a time."""

from __future__ import annotations

import json
import math
import os
import re
import secrets
import shutil
import socket
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.messages import message
from isochrome.output import check_link
from isochrome.progress import RunProgress, Tally
from isochrome.runs import integrity, workers
from isochrome.runs.job import (
    MANIFEST,
    RECORDS,
    STORE,
    InTurn,
    Job,
    Results,
    RunFolder,
    RunLayout,
    Work,
    check_chunk,
    difference,
    identity_digest,
    read_record_of,
    record_name,
)
from isochrome.runs.store import WORKING, create_store

if TYPE_CHECKING:
    from filelock import FileLock

    from isochrome.runs.workers import WorkerPool

LOCK, OWNER = "lock", "owner.txt"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder for this process alone; it is made if need be, and removed when left empty."""
    from filelock import FileLock, Timeout

    made, lock = not os.path.lexists(folder), FileLock(folder / LOCK, timeout=0, thread_local=False)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if folder.is_symlink():
            raise InputError("symbolic_link_remove_name", folder=folder)
        lock.acquire()
        (folder / OWNER).write_text(f"process {os.getpid()} on {socket.gethostname()}", "utf-8")
    except Timeout:
        owner = ""
        with suppress(OSError):
            owner = (folder / OWNER).read_text("utf-8")
        owner = owner or "unknown process"
        raise InputError("another_run_work_there", folder=folder, owner=owner) from None
    except (OSError, NotImplementedError) as error:
        if made or lock.is_locked:
            _release(folder, lock)
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


FINISHED = "finished"
_GROUP = "group.json"


def working_folder(out: Path) -> Path:
    """The folder beside an output where a run keeps what it has of it."""
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
    """What is damaged of a run's results, by file; None where the record is of no such run."""
    known = None
    with suppress(InputError):
        known = integrity.read_record(target)
    if known is None or known.older or difference(known.record, identity) is not None:
        return None
    return {name: fault for name in known.sizes if (fault := known.fault(name))}


def take_back(run: RunFolder, target: Path) -> None:
    """Take chunks that are left of damaged results back to work, where they are looked at anew."""
    placed = replace(run, results=target)
    for index in range(run.layout.chunks if run.layout.store else 0):
        record = None
        if not (run.results / record_name(index)).exists():
            record = read_record_of(placed, index)
        for name in (*record["files"], record_name(index)) if record is not None else ():
            if integrity.is_plain(target / name):
                (run.results / name).parent.mkdir(parents=True, exist_ok=True)
                os.replace(target / name, run.results / name)


def open_run_folder(root: Path, job: Job, *, restart: bool) -> RunFolder:
    """The working folder of a run: as an earlier one of the same identity left it, or a new one."""
    layout = json.loads(json.dumps(asdict(job.layout)))
    manifest = None if restart else _manifest(root)
    if manifest is not None:
        changed = difference(manifest["identity"], job.identity)
        if changed is None and manifest["layout"] != layout:
            changed = message("layout_results")
        if changed is not None:
            raise InputError("holds_unfinished_run_since", root=root, changed=changed)
        run = RunFolder(root / manifest["token"], job.layout, identity_digest(job.identity))
        if run.results.is_dir() and not is_finished(run):
            clear_up(run)
        if run.results.is_dir() or is_finished(run):
            return run
    wipe(root)
    token = f"results-{secrets.token_hex(4)}"  # a dead run's last worker finds its folder gone
    check_room(root, job.layout, job.layout.count)
    run = RunFolder(root / token, job.layout, identity_digest(job.identity))
    run.results.mkdir()
    (run.chunk_folder / RECORDS).mkdir()
    if job.layout.store:
        create_store(run.results / STORE, job.layout)
        shutil.copyfile(run.results / STORE / "zarr.json", root / _GROUP)
    sync_tree(root)
    body = {"identity": dict(job.identity), "layout": layout, "token": token}
    integrity.write_checked(root / MANIFEST, body)
    return run


def has_run(root: Path) -> bool:
    """Tell whether a working folder holds what an earlier run left."""
    return _manifest(root) is not None


def wipe(root: Path) -> None:
    """Remove all that is in a working folder but its lock."""
    for entry in sorted(root.iterdir(), key=lambda e: e.name != MANIFEST):
        if entry.name not in (LOCK, OWNER):
            _remove(entry)


def _remove(entry: Path) -> None:
    if entry.is_dir() and not entry.is_symlink():
        shutil.rmtree(entry)
    else:
        entry.unlink()


def _manifest(root: Path) -> dict[str, Any] | None:
    """What a run is a result of; None where it breaks off: so may all that was written after it."""
    try:
        manifest: dict[str, Any] = integrity.read_checked(root / MANIFEST)
        known = isinstance(manifest["identity"], dict) and isinstance(manifest["layout"], dict)
        inside = re.fullmatch(r"results-[0-9a-f]+", manifest["token"]) is not None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None  # no manifest of ours
    return manifest if known and inside else None


def clear_up(run: RunFolder) -> None:
    """Remove what a killed run left half-written beside finished chunks."""
    store, known = run.results / STORE, {layer.name for layer in run.layout.layers} | {"zarr.json"}
    for entry in run.results.iterdir():
        if entry.name not in (STORE, RECORDS):
            _remove(entry)
    for entry in store.iterdir() if run.layout.store else ():
        if entry.name not in known:
            _remove(entry)
    for file in run.root.rglob(".*.part"):
        file.unlink()
    if run.layout.store:
        shutil.copyfile(run.root / _GROUP, store / "zarr.json")


def check_room(root: Path, layout: RunLayout, items: int) -> None:
    """Refuse a run whose `items` to come the disk cannot hold, before hours of work."""
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
        out = root.with_suffix("")
        raise InputError("results_need_gb_gb", out=out, needed=needed / 1e9, free=free / 1e9)


def is_finished(run: RunFolder) -> bool:
    """Whether all results are made, and only have to be given their place."""
    return (run.root / FINISHED).exists()


def sync_tree(folder: Path) -> None:
    """Put all files and names below a folder through to the disk."""
    for path, _, files in os.walk(folder):
        for name in files:
            with open(os.path.join(path, name), "rb+") as file:
                os.fsync(file.fileno())
        integrity.sync_folder(Path(path))


def publish(run: RunFolder, target: Path) -> None:
    """Give finished results their place by one rename, or file by file; killed, the next run goes
    on."""
    root = run.root
    if not is_finished(run):
        check_own(target, (entry.name for entry in run.results.iterdir()))
        sync_tree(run.results)
        integrity.write_through(root / FINISHED, b"")
    if run.results.exists() and target.exists():
        _clear_old(run.results, target)
        last = integrity.PROVENANCE  # what says that all is there
        for entry in sorted(run.results.iterdir(), key=lambda e: (e.name == last, e.name)):
            _replace(entry, target / entry.name, root)
        run.results.rmdir()
    elif run.results.exists():  # else all has its place
        os.rename(run.results, target)
    integrity.sync_folder(target)
    integrity.sync_folder(target.parent)


def check_own(target: Path, names: Iterable[str]) -> None:
    """Refuse to replace files that no run has left, such as a scene that somebody wrote."""
    outputs = _record(target)["outputs"]
    known = {name.partition("/")[0] for name in outputs} | {integrity.PROVENANCE}
    known |= {STORE, integrity.REPORT} if outputs else set()  # of an earlier version too
    if not outputs:  # a run may have left its results, and nobody knows any more which these are
        path, store = target / integrity.PROVENANCE, target / STORE / "zarr.json"
        if integrity.is_record(path):
            damaged = integrity.has_own_keys(path)
        else:
            damaged = integrity.is_record(store) and b'"source": "Isochrome"' in store.read_bytes()
        if damaged:
            return
    for name in names:
        place = target / name
        if name not in known and place.exists() and not place.is_symlink():
            raise InputError(
                "would_replaced_no_there", place=place, provenance=integrity.PROVENANCE
            )


def _record(target: Path) -> dict[str, Any]:
    """An earlier run's record, its files as `outputs`: none where it cannot be read."""
    record: Mapping[str, Any] = {}
    with suppress(InputError):
        if (known := integrity.read_record(target)) is not None:
            record = known.record
    outputs = record.get("outputs")
    return {**record, "outputs": outputs if isinstance(outputs, dict) else {}}


def _clear_old(results: Path, target: Path) -> None:
    """Take from a folder what an older run says of it, and its files that have no successor. What
    is left of the record names all that runs have made there, should this one be killed here."""
    record = _record(target)
    names = sorted({*record["outputs"], *(entry.name for entry in results.iterdir())})
    placing = {"placing": results.name, "outputs": dict.fromkeys(names, 0)}
    integrity.write_through(target / integrity.PROVENANCE, json.dumps(placing).encode())
    if record.get("placing") == results.name:  # it was killed here: what is there are its own
        return
    for name in record["outputs"]:
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


T = TypeVar("T")

WORTH_WORKERS_S = 20.0
"""Seconds still to compute from which worker processes are started, each of which takes a few."""


WORTH_KEEPING_S = 60.0
"""Seconds of work below which a refused run leaves nothing: it is soon done again."""


class Stopped(KeyboardInterrupt):
    """Stopped at the keyboard; the sentence says what is kept."""


@dataclass(frozen=True)
class RunOptions:
    """By whom and how a run is computed; none of it changes a result. `workers`, processes on this
    machine (None: as many as are worth it); `cluster`, a Dask scheduler's address; `keep_going`:
    leave out items that fail; `pool`, processes that are started already."""

    workers: int | None = 1
    cluster: str | None = None
    restart: bool = False
    keep_going: bool = False
    pool: WorkerPool | None = None


def refuse_without_folder(out: str | Path | None, workers: int | None, cluster: str | None) -> None:
    """Refuse workers or a cluster where no folder is given for results."""
    if out is None and (cluster is not None or workers != 1):
        raise InputError("workers_cluster_write_folder")


def run_job(
    job: Job,
    out: str | Path,
    finish: Callable[[RunFolder], T],
    *,
    options: RunOptions | None = None,
    progress: RunProgress | None = None,
) -> T | None:
    """Compute a job and leave its results in a folder, all of them or none. The same call goes on
    with what is kept in OUT.partial, and ends with the same bytes. Returns what `finish` does,
    which makes the other files; None where the folder holds all results already."""
    options = options or RunOptions()
    workers.keep_steady()
    root = working_folder(Path(out))
    target, stamps = Path(out).resolve(), stamps_of(job.identity)
    _check_call(job, options, stamps, target)
    with locked(root):
        faults = None if options.restart else faults_of(target, job.identity)
        if faults == {}:
            wipe(root)
            return None
        if not has_run(root):
            check_own(target, (STORE, *(f"{layer.name}.tif" for layer in job.layout.layers)))
        with _saying(root, job) as state:
            state.fresh = options.restart or not has_run(root)
            run = open_run_folder(root, job, restart=options.restart)
            if faults and progress is not None:
                name, fault = next(iter(faults.items()))
                more = f", and {len(faults) - 1} more" if len(faults) > 1 else ""
                damage = message("made_anew_what_whole", out=out, name=name, fault=fault, more=more)
                progress(Tally(0, job.layout.count, 0, 0, damage))
            if not (options.restart or is_finished(run)):
                take_back(run, target)
            result: T | None = None
            if not is_finished(run):  # else it was killed before all had its place
                _compute(job, run, state, options, progress)
                try:
                    result = finish(run)
                except PhysicsError:  # as these frames and this scene would end again
                    state.fresh, state.done = True, 0
                    raise
                _leave_record(run, job, stamps)
            state.done = job.layout.count
            publish(run, target)
            wipe(root)
            return result


def _check_call(job: Job, options: RunOptions, stamps: Stamps, target: Path) -> None:
    """Refuse no worker, several where one has to do all, and an output among the input files."""
    if options.workers is not None and options.workers < 1:
        raise InputError("workers_give_more", workers=options.workers)
    if job.in_turn and (options.cluster is not None or (options.workers or 1) > 1):
        raise InputError("workers_cluster_each_frame")
    if inside := [file for file in stamps if file.resolve().parent == target]:
        raise InputError("lies_folder_where_results", inside=inside[0], target=target)


def _leave_record(run: RunFolder, job: Job, before: Stamps) -> None:
    """Write down what the results are of, and which they are: last, when all others are there.
    Results of input that was changed while it was read are refused; a file that is gone was
    read."""
    for file, now in stamps_of(job.identity).items():
        stamp = before.get(file, now)
        if now != stamp:
            raise InputError(
                "changed_while_read_bytes_before", file=file, stamp=stamp[0], now=now[0]
            )
    known = {  # checksums that need not be read from the files again
        name: checksum
        for index in range(run.layout.chunks if run.layout.store else 0)
        for name, (_, checksum) in (read_record_of(run, index) or {})["files"].items()
    }
    integrity.seal(run.results, json.loads(json.dumps(dict(job.identity))), known=known)


@dataclass
class _State:
    """Items of a run that are `done`; `fresh`: the folder holds nothing of an earlier run."""

    fresh: bool = False
    done: int = 0


@contextmanager
def _saying(root: Path, job: Job) -> Iterator[_State]:
    """Say what is kept when a run ends before its time; where nothing is, leave nothing."""
    state, start = _State(), time.perf_counter()

    def count_kept() -> str:
        return message("finished_kept", done=state.done, count=job.layout.count)

    try:
        yield state
    except IsochromeError as error:
        soon_again = state.fresh and time.perf_counter() - start < WORTH_KEEPING_S
        if soon_again and not isinstance(error, workers.WorkersLost):
            state.done = 0
        if not state.done:
            raise
        raise type(error)(error.message + f" ({count_kept()} in {root})") from error
    except KeyboardInterrupt:
        if not state.done:
            raise Stopped(message("stopped_before_anything_finished")) from None
        words = message("stopped_run_same_command", count_kept=count_kept(), root=root)
        raise Stopped(words) from None
    except OSError as error:
        raise InputError(
            "cannot_written_there_make", root=root, strerror=error.strerror or error,
            count_kept=count_kept(),
        ) from error  # fmt: skip
    finally:
        if state.fresh and not state.done:
            with suppress(OSError):
                wipe(root)


def _compute(
    job: Job, run: RunFolder, state: _State, options: RunOptions, progress: RunProgress | None
) -> None:
    """Compute the chunks that are not there, whole; what is done of the `state` grows with each."""
    total, todo = Counter[str](), list[int]()  # items by their status; chunks
    for index in range(run.layout.chunks):
        statuses = check_chunk(run, index)
        # failed items are for who asked to keep going: to all others they are to be said again
        if statuses is not None and (options.keep_going or not statuses["failed"]):
            total.update(statuses)
        else:
            todo.append(index)
    before, count = total.total(), job.layout.count
    check_room(run.root, job.layout, count - before)

    def tell() -> None:
        state.done = total.total()
        if progress is not None:
            progress(Tally(state.done, count, before, state.done - total["ok"]))

    tell()
    with closing(_finished(job, run, todo, options)) as finished:
        for statuses in finished:
            total.update(statuses)
            tell()


def _finished(
    job: Job, run: RunFolder, todo: list[int], options: RunOptions
) -> Generator[Counter[str]]:
    """The statuses of chunks as they are finished, by whoever computes them."""
    if not todo:
        return
    work = one_by_one(job, run)
    if options.cluster is not None:
        yield from workers.by_cluster(work, run, todo, options.cluster)
        return
    count = 1 if job.in_turn else options.workers
    if count is None:
        start = time.perf_counter()
        yield workers.compute(work, run, todo[0])
        todo = todo[1:]
        remaining_s = (time.perf_counter() - start) * len(todo)
        count = workers.processors() if remaining_s > WORTH_WORKERS_S else 1
    count = min(count, len(todo))
    if count > 1:
        yield from workers.by_processes(work, run, todo, options.pool or workers.WorkerPool(count))
    else:
        yield from (workers.compute(work, run, index) for index in todo)


Stamps = Mapping[Path, tuple[int, int]]
"""Size (bytes) and time of the last change (ns) of files."""


def stamps_of(identity: Mapping[str, Any]) -> Stamps:
    """The input files of a run's identity as they are now, without those that are not there."""
    stamps = dict[Path, tuple[int, int]]()
    for file in map(Path, identity.get("inputs_sha256") or {}):
        with suppress(OSError):
            state = file.stat()
            stamps[file] = state.st_size, state.st_mtime_ns
    return stamps


def computed(job: Job, progress: RunProgress | None) -> Iterator[dict[str, Any]]:
    """The rows of a job without pictures, of which nothing is kept on the disk."""
    work, count, flagged = one_by_one(job, None), job.layout.count, 0
    for index in range(job.layout.chunks):
        start, stop = job.layout.span(index)
        results = work(start, stop)
        flagged += sum(more["status"] != "ok" for more in results.more)
        if progress is not None:
            progress(Tally(stop, count, 0, flagged))
        yield from results.rows


def one_by_one(job: Job, run: RunFolder | None) -> Work:
    """A job's work on a chunk, whatever it needs of the chunk before. What a chunk leaves goes
    through JSON in memory too, so that a run that goes on has the same bits."""
    if not job.in_turn:
        return cast(Work, job.work)
    work, last = cast(InTurn, job.work), dict[int, Any]()

    def in_turn(start: int, stop: int) -> Results:
        index = start // job.layout.chunk
        if index and index - 1 not in last:
            record = read_record_of(run, index - 1) if run else None
            assert record is not None
            last[index - 1] = record["left"]
        results = work(start, stop, last.get(index - 1))
        last.clear()
        last[index] = json.loads(json.dumps(results.left))
        return results

    return in_turn
