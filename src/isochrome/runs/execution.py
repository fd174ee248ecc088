"""A long run: chunk after chunk, each kept when it is done; after a crash, it resumes there."""

import json
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.messages import message
from isochrome.progress import RunProgress, Tally
from isochrome.runs.chunks import STORE, ChunkRecord, RunFolder, check_chunk, read_record_of
from isochrome.runs.integrity import seal
from isochrome.runs.job import InTurn, Job, Results, Work
from isochrome.runs.work_folder import (
    check_own,
    check_room,
    faults_of,
    has_run,
    is_finished,
    locked,
    open_run_folder,
    publish,
    take_back,
    wipe,
    working_folder,
)
from isochrome.runs.workers import (
    Finished,
    Waiting,
    WorkersLost,
    alone,
    by_cluster,
    by_processes,
    keep_steady,
    processors,
)

T = TypeVar("T")

WORTH_WORKERS_S = 20.0
"""Seconds still to compute from which worker processes are started, each of which takes a few."""


WORTH_KEEPING_S = 60.0
"""Seconds of work below which a refused run leaves nothing: it is soon done again."""


class Stopped(KeyboardInterrupt):
    """Stopped at the keyboard; the sentence says what is kept."""


@dataclass(frozen=True)
class RunOptions:
    """By whom and how a run is computed; none of it changes a result.

    `workers`, processes on this machine; None: as many as there are processors where it is worth
    starting them; `cluster`, address of a Dask scheduler instead; `restart`, whether to throw away
    what an earlier run left; `keep_going`, whether to leave out items that fail instead of ending
    with the first; `waiting`, workers that were started before.
    """

    workers: int | None = 1
    cluster: str | None = None
    restart: bool = False
    keep_going: bool = False
    waiting: Waiting | None = None


def refuse_without_folder(out: str | Path | None, workers: int | None, cluster: str | None) -> None:
    """Refuse workers or a cluster where no folder is given for results.

    Parameters: `out`, the folder; None where there is none; `workers`, processes on this machine;
    `cluster`, address of a Dask scheduler. Raises InputError.
    """
    if out is None and (cluster is not None or workers != 1):
        raise InputError("workers_cluster_write_folder")


def run_job(
    job: Job,
    out: str | Path,
    finish: Callable[[RunFolder], T],
    *,
    means: RunOptions | None = None,
    progress: RunProgress | None = None,
) -> T | None:
    """Compute a job and leave its results in a folder, all of them or none.

    What is finished is kept in OUT.partial. The same call goes on with it, and ends with the same
    bytes as if nothing had happened. `finish` makes the rest of the files in `run.results` when all
    chunks are there. Returns what it returns, None where the folder holds all results already.
    Raises InputError, and whatever the job raises.
    """
    means = means or RunOptions()
    keep_steady()
    _check_workers(job, means)
    root = working_folder(Path(out))
    target, stamps = Path(out).resolve(), stamps_of(job.identity)
    check_apart(stamps, target)
    with locked(root):
        faults = None if means.restart else faults_of(target, job.identity)
        if faults == {}:
            wipe(root)
            return None
        if not has_run(root):
            check_own(target, (STORE, *(f"{layer.name}.tif" for layer in job.layout.layers)))
        with _saying(root, job) as state:
            state.fresh = means.restart or not has_run(root)
            run = open_run_folder(root, job, restart=means.restart)
            if faults and progress is not None:
                progress(Tally(0, job.layout.count, 0, 0, _of_damage(out, faults)))
            if not (means.restart or is_finished(run)):
                take_back(run, target)
            result: T | None = None
            if is_finished(run):  # and killed before all had its place
                state.finished = True
            else:
                _compute(job, run, state.chunks, means, progress)
                try:
                    result = finish(run)
                except PhysicsError:  # as these frames and this scene would end again
                    state.fresh = True
                    state.chunks.clear()
                    raise
                check_unchanged(stamps)
                _leave_record(run, job)
                state.finished = True
            publish(run, target)
            wipe(root)
            return result


def _check_workers(job: Job, options: RunOptions) -> None:
    """Refuse no worker at all, and several where one process has to do all. Raises InputError."""
    if options.workers is not None and options.workers < 1:
        raise InputError("workers_give_more", workers=options.workers)
    if job.in_turn and (options.cluster is not None or (options.workers or 1) > 1):
        raise InputError("workers_cluster_each_frame")


def _of_damage(out: str | Path, faults: Mapping[str, str]) -> str:
    """What is said of damaged results before they are mended."""
    name, fault = next(iter(faults.items()))
    more = f", and {len(faults) - 1} more" if len(faults) > 1 else ""
    return message("made_anew_what_whole", out=out, name=name, fault=fault, more=more)


@dataclass
class _State:
    """What is kept of a run: its finished `chunks`, or all of it, `finished`.

    `fresh`, whether the working folder holds nothing of an earlier run.
    """

    fresh: bool = False
    chunks: dict[int, ChunkRecord] = field(default_factory=dict)
    finished: bool = False

    @property
    def anything(self) -> bool:
        """Whether something of the run is kept."""
        return bool(self.chunks) or self.finished


@contextmanager
def _saying(root: Path, job: Job) -> Iterator[_State]:
    """Say what is kept when a run ends before its time; where nothing is, leave nothing."""
    state, start = _State(), time.perf_counter()
    count = job.layout.count

    def count_kept() -> str:
        done = count if state.finished else sum(chunk.items for chunk in state.chunks.values())
        return message("finished_kept", done=done, count=count)

    try:
        yield state
    except IsochromeError as error:
        soon_again = state.fresh and time.perf_counter() - start < WORTH_KEEPING_S
        if soon_again and not isinstance(error, WorkersLost):
            state.chunks.clear()
        if not state.chunks:
            raise
        raise type(error)(error.message + f" ({count_kept()} in {root})") from error
    except KeyboardInterrupt:
        if not state.anything:
            raise Stopped(message("stopped_before_anything_finished")) from None
        raise Stopped(
            message("stopped_run_same_command", count_kept=count_kept(), root=root)
        ) from None
    except OSError as error:
        raise InputError(
            "cannot_written_there_make",
            root=root,
            strerror=error.strerror or error,
            count_kept=count_kept(),
        ) from error
    finally:
        if state.fresh and not state.anything:
            with suppress(OSError):
                wipe(root)


def _compute(
    job: Job,
    run: RunFolder,
    chunks: dict[int, ChunkRecord],
    options: RunOptions,
    progress: RunProgress | None,
) -> None:
    """Compute the chunks that are not there, whole; `chunks`, all that are, grows with each."""
    checked = {index: check_chunk(run, index) for index in range(run.layout.chunks)}
    for index, chunk in checked.items():
        # failed items are for who asked to keep going: to all others they are to be said again
        if chunk is not None and (options.keep_going or not chunk.failed):
            chunks[index] = chunk
    before = sum(chunk.items for chunk in chunks.values())
    check_room(run.root, job.layout, job.layout.count - before)
    todo = [index for index in range(run.layout.chunks) if index not in chunks]

    def tell() -> None:
        if progress is not None:
            done = sum(chunk.items for chunk in chunks.values())
            flagged = sum(chunk.flagged for chunk in chunks.values())
            progress(Tally(done, run.layout.count, before, flagged))

    tell()
    with closing(_finished(job, run, todo, options)) as finished:
        for index, chunk in finished:
            chunks[index] = chunk
            tell()


def _finished(
    job: Job, run: RunFolder, todo: list[int], options: RunOptions
) -> Generator[Finished]:
    """The chunks as they are finished, by whoever computes them."""
    if not todo:
        return
    work = one_by_one(job, run)
    if options.cluster is not None:
        yield from by_cluster(work, run, todo, options.cluster)
        return
    workers = 1 if job.in_turn else options.workers
    if workers is None:
        start = time.perf_counter()
        yield from alone(work, run, todo[:1])
        todo = todo[1:]
        remaining_s = (time.perf_counter() - start) * len(todo)
        workers = processors() if remaining_s > WORTH_WORKERS_S else 1
    workers = min(workers, len(todo))
    if workers > 1:
        yield from by_processes(work, run, todo, workers, options.waiting)
    else:
        yield from alone(work, run, todo)


def _leave_record(run: RunFolder, job: Job) -> None:
    """Write down what the results are of, and which they are: last, when all others are there."""
    known = {
        run.chunk_file(name, index).relative_to(run.results).as_posix(): checksum
        for index in range(run.layout.chunks if run.layout.layers else 0)
        for name, (_, checksum) in (read_record_of(run, index) or {})["layers"].items()
    }
    seal(run.results, json.loads(json.dumps(dict(job.identity))), known=known)


Stamps = Mapping[Path, tuple[int, int]]
"""Size (bytes) and time of the last change (ns) of files."""


def stamps_of(identity: Mapping[str, Any]) -> Stamps:
    """The input files of a run's identity as they are now; those that are not there are left out.

    Parameters: `identity`, as in a Job.
    """
    files = map(Path, identity.get("inputs_sha256") or {})
    return {file: stamp for file in files if (stamp := _stamp(file)) is not None}


def _stamp(file: Path) -> tuple[int, int] | None:
    """The stamp of a file, None where it is not there."""
    try:
        state = file.stat()
    except OSError:
        return None
    return state.st_size, state.st_mtime_ns


def check_apart(stamps: Stamps, target: Path) -> None:
    """Refuse an output folder in which input files lie: the next run would read results as input.

    Parameters: `stamps` of the input; `target`, the resolved output folder. Raises InputError.
    """
    inside = [file for file in stamps if file.resolve().parent == target]
    if inside:
        raise InputError("lies_folder_where_results", inside=inside[0], target=target)


def check_unchanged(stamps: Stamps) -> None:
    """Refuse results of input that was changed while it was read. Raises InputError.

    A file that is no longer there was read before, or its reader has said that it was not.
    """
    for file, stamp in stamps.items():
        now = _stamp(file)
        if now is not None and now != stamp:
            raise InputError(
                "changed_while_read_bytes_before", file=file, stamp=stamp[0], now=now[0]
            )


def one_by_one(job: Job, run: RunFolder) -> Work:
    """A job's work on a chunk, whatever it needs of the chunk before.

    What a chunk leaves goes through JSON whether it is still in memory or read from its record, so
    that a run that goes on computes with the same numbers as one that was never killed.
    Parameters: `job`; `run`, where finished chunks lie. Returns a Work.
    """
    if not job.in_turn:
        return cast(Work, job.work)
    work, last = cast(InTurn, job.work), dict[int, Any]()

    def in_turn(start: int, stop: int) -> Results:
        index = start // run.layout.chunk
        if index and index - 1 not in last:
            record = read_record_of(run, index - 1)
            assert record is not None
            last[index - 1] = record["left"]
        results = work(start, stop, last.get(index - 1))
        last.clear()
        last[index] = json.loads(json.dumps(results.left))
        return results

    return in_turn
