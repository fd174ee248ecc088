"""A long run: chunk after chunk, each kept when it is done; killed, it goes on where it was."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from isochrome.errors import InputError, IsochromeError
from isochrome.output import write_json
from isochrome.progress import RunProgress, Tally
from isochrome.runs.chunks import Bench, Kept, check_chunk
from isochrome.runs.in_turn import one_by_one
from isochrome.runs.inputs import check_apart, check_unchanged, stamps_of
from isochrome.runs.job import Job
from isochrome.runs.lock import locked
from isochrome.runs.memory import keep_steady
from isochrome.runs.publish import check_own, publish
from isochrome.runs.store import STORE
from isochrome.runs.workers import (
    Finished,
    Waiting,
    WorkersLost,
    alone,
    by_cluster,
    by_processes,
    processors,
)
from isochrome.runs.workplace import (
    PROVENANCE,
    check_room,
    has_run,
    is_complete,
    is_finished,
    open_bench,
    wipe,
    working_folder,
)

T = TypeVar("T")

WORTH_WORKERS_S = 20.0
"""Seconds still to compute from which worker processes are started, each of which takes a few."""


WORTH_KEEPING_S = 60.0
"""Seconds of work below which a refused run leaves nothing: it is soon done again."""


class Stopped(KeyboardInterrupt):
    """Stopped at the keyboard; the sentence says what is kept."""


@dataclass(frozen=True)
class Means:
    """By whom and how a run is computed; none of it changes a result.

    `workers`, processes on this machine, None: as many as there are processors where it is worth
    starting them; `cluster`, the address of a Dask scheduler instead; `restart`, to throw away what
    an earlier run left; `keep_going`, to leave out items that fail instead of ending with the
    first; `waiting`, workers that were started before.
    """

    workers: int | None = 1
    cluster: str | None = None
    restart: bool = False
    keep_going: bool = False
    waiting: Waiting | None = None


def run_job(
    job: Job,
    out: str | Path,
    finish: Callable[[Bench], T],
    *,
    means: Means | None = None,
    progress: RunProgress | None = None,
) -> T | None:
    """Compute a job and leave its results in a folder, all of them or none.

    What is finished is kept in OUT.partial. The same call goes on with it, and ends with the same
    bytes as if nothing had happened. Parameters: `job`; `out`, the folder; `finish`, which makes
    the rest of the files in `bench.results` when all chunks are there; `means`; `progress`. Returns
    what `finish` does, None where the folder holds all results already. Raises InputError where
    another run is at work there, an unfinished one is of something else, or the disk is full; and
    what the job raises.
    """
    means = means or Means()
    keep_steady()
    if means.workers is not None and means.workers < 1:
        raise InputError(f"--workers {means.workers}: give 1 or more")
    if job.in_turn and (means.cluster is not None or (means.workers or 1) > 1):
        raise InputError(
            "--workers, --cluster: each frame is looked for from the one before, which only one "
            "process can do; leave them out"
        )
    root = working_folder(Path(out))
    target, stamps = Path(out).resolve(), stamps_of(job.identity)
    check_apart(stamps, target)
    with locked(root):
        if not means.restart and is_complete(target, job):
            wipe(root)
            return None
        if not has_run(root):
            check_own(target, (STORE, *(f"{layer.name}.tif" for layer in job.layout.layers)))
        with _saying(root, job) as state:
            state.own = means.restart or not has_run(root)
            bench = open_bench(root, job, restart=means.restart)
            found: T | None = None
            if is_finished(bench):  # and killed before all had its place
                state.finished = True
            else:
                state.kept = _kept(bench, means)
                _compute(job, bench, state.kept, means, progress)
                found = finish(bench)
                check_unchanged(stamps)
                _leave_record(bench, job)
                state.finished = True
            publish(bench, target)
            wipe(root)
            return found


@dataclass
class _State:
    """What is kept of a run: its `kept` chunks, or all of it, `finished`.

    `own`, whether the working folder holds nothing of an earlier run.
    """

    own: bool = False
    kept: dict[int, Kept] = field(default_factory=dict)
    finished: bool = False


@contextmanager
def _saying(root: Path, job: Job) -> Iterator[_State]:
    """Say what is kept when a run ends before its time; where nothing is, leave nothing."""
    state, start = _State(), time.perf_counter()
    count = job.layout.count

    def said() -> str:
        done = count if state.finished else sum(chunk.items for chunk in state.kept.values())
        return f"{done} of {count} are finished and kept"

    try:
        yield state
    except IsochromeError as error:
        soon_again = state.own and time.perf_counter() - start < WORTH_KEEPING_S
        if soon_again and not isinstance(error, WorkersLost):
            state.kept.clear()
        if not state.kept:
            raise
        raise type(error)(f"{error} ({said()} in {root})") from error
    except KeyboardInterrupt:
        something = state.kept or state.finished
        raise Stopped(
            f"stopped; {said()} in {root}: the same command goes on"
            if something
            else "stopped before anything was finished; nothing is left"
        ) from None
    except OSError as error:
        raise InputError(
            f"{root}: cannot be written ({error.strerror or error}); {said()} there: make room, or "
            "see that the drive is there, and the same command goes on"
        ) from error
    finally:
        if state.own and not state.kept and not state.finished:
            with suppress(OSError):
                wipe(root)


def _kept(bench: Bench, means: Means) -> dict[int, Kept]:
    """The chunks that are there, whole."""
    found = {}
    for index in range(bench.layout.chunks):
        chunk = check_chunk(bench, index)
        # failed items are for who asked to keep going: to all others they are to be said again
        if chunk is not None and (means.keep_going or not chunk.failed):
            found[index] = chunk
    return found


def _compute(
    job: Job,
    bench: Bench,
    kept: dict[int, Kept],
    means: Means,
    progress: RunProgress | None,
) -> None:
    """Compute the chunks that are not there; `kept` grows with each."""
    before = sum(chunk.items for chunk in kept.values())
    check_room(bench.records.parent, job.layout, job.layout.count - before)
    todo = [index for index in range(bench.layout.chunks) if index not in kept]

    def tell() -> None:
        if progress is not None:
            done = sum(chunk.items for chunk in kept.values())
            flagged = sum(chunk.flagged for chunk in kept.values())
            progress(Tally(done, bench.layout.count, before, flagged))

    tell()
    with closing(_finished(job, bench, todo, means)) as finished:
        for index, chunk in finished:
            kept[index] = chunk
            tell()


def _finished(job: Job, bench: Bench, todo: list[int], means: Means) -> Generator[Finished]:
    """The chunks as they are finished, by whoever computes them."""
    if not todo:
        return
    work = one_by_one(job, bench)
    if means.cluster is not None:
        yield from by_cluster(work, bench, todo, means.cluster)
        return
    workers = 1 if job.in_turn else means.workers
    if workers is None:
        start = time.perf_counter()
        yield from alone(work, bench, todo[:1])
        todo = todo[1:]
        left = (time.perf_counter() - start) * len(todo)
        workers = processors() if left > WORTH_WORKERS_S else 1
    workers = min(workers, len(todo))
    if workers > 1:
        yield from by_processes(work, bench, todo, workers, means.waiting)
    else:
        yield from alone(work, bench, todo)


def _leave_record(bench: Bench, job: Job) -> None:
    """Write down what the results are of, and which they are: last, when all others are there."""
    outputs = {
        file.name: file.stat().st_size
        for file in sorted(bench.results.iterdir())
        if file.is_file() and file.name != PROVENANCE
    }
    identity = json.loads(json.dumps(dict(job.identity)))
    write_json(bench.results / PROVENANCE, {**identity, "outputs": outputs})
