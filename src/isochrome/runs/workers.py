"""Who computes the chunks: this process, worker processes on this machine, or a Dask cluster. The
GNU C library keeps what is freed between the pieces of the next chunk, so that a long run would
take more memory than a short one: it is told to give it back. Source: mallopt(3),
malloc_trim(3)."""

from __future__ import annotations

import concurrent.futures as futures
import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from typing import Any, TypeVar

from isochrome.errors import InputError
from isochrome.runs.job import Results, RunFolder, RunLayout, Work, environment, keep

LARGE = 16 << 20
"""Bytes of an array, as a stack of frames, that is given back as soon as it is freed."""

SPARE = 128 << 20
"""Bytes that may stay free at the end of the heap until `trim_heap`: what is given back with each
picture is asked for again with the next, which costs a third of the time."""

_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1


def keep_steady() -> None:
    """Fix from which size on arrays are given back at once, which else grows with the largest."""
    if (library := _gnu()) is not None:
        library.mallopt(_MMAP_THRESHOLD, LARGE)
        library.mallopt(_TRIM_THRESHOLD, SPARE)


def trim_heap() -> None:
    """Give back what is free, between chunks."""
    if (library := _gnu()) is not None:
        library.malloc_trim(0)


@cache
def _gnu() -> ctypes.CDLL | None:
    library = ctypes.CDLL(None) if sys.platform.startswith("linux") else None
    return library if hasattr(library, "mallopt") and hasattr(library, "malloc_trim") else None


T = TypeVar("T")


class WorkersLost(InputError):
    """Worker processes died under their work: what they have finished is kept."""


class NoCluster(InputError):
    """The Dask cluster cannot be had, whatever is to be computed on it."""


def compute(work: Work, run: RunFolder, index: int) -> Counter[str]:
    """Compute a chunk and put it down; the statuses of its items."""
    with single_threaded():
        statuses = keep(run, index, work(*run.layout.span(index)))
    trim_heap()
    return statuses


def by_processes(
    work: Work, run: RunFolder, chunks: Sequence[int], pool: WorkerPool
) -> Generator[Counter[str]]:
    """Compute chunks in worker processes, each of which writes its own to the disk. Raises
    WorkersLost where one was killed."""
    # once for all chunks, as it may know all frames' places; here it can be said that it fails
    task = pickle.dumps((work, run))
    with pool:
        given = in_flight(lambda k: pool.submit(_in_worker, task, k), chunks, 2 * pool.workers)
        yield from (statuses for _, statuses in given)


class WorkerPool(futures.ProcessPoolExecutor):
    """So many worker processes, spawned, deaf to the keyboard, which end when this process does.
    Left by an exception, the block of the pool ends them at once, whatever they are at."""

    def __init__(self, workers: int, ready: Any = None) -> None:
        """`ready`, what they import as they start, beside what is computed here until then."""
        self.workers, self._others = workers, set(multiprocessing.active_children())
        super().__init__(workers, multiprocessing.get_context("spawn"), _start_worker)
        for _ in range(workers if ready is not None else 0):
            self.submit(id, ready)

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Wait for what is under way; after an exception for nothing."""
        if error is not None:  # whoever waits at the keyboard does not wait for a chunk
            for child in set(multiprocessing.active_children()) - self._others:
                child.terminate()
        self.shutdown(wait=True, cancel_futures=True)
        if isinstance(error, futures.process.BrokenProcessPool):
            raise WorkersLost("worker_process_killed_system") from error


def by_cluster(
    work: Work, run: RunFolder, chunks: Sequence[int], address: str
) -> Generator[Counter[str]]:
    """Compute chunks on an existing Dask cluster; the results come here and are written here. The
    workers need the input under the same paths, and the same versions of all that computes."""
    try:
        from distributed import Client
    except ImportError as error:
        raise NoCluster("cluster_needs_package_distributed") from error
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise NoCluster("cluster_no_dask_scheduler", address=address, error=error) from error
    with client:
        if not client.nthreads():
            raise NoCluster("cluster_cluster_has_no", address=address)
        executor = client.get_executor(pure=False)
        everywhere = client.scatter(work, broadcast=True)
        ahead = 2 * max(1, sum(client.nthreads().values()))
        submit = partial(executor.submit, _elsewhere, everywhere, run.layout, environment())
        try:
            for index, results in in_flight(submit, chunks, ahead):
                yield keep(run, index, results)
        finally:
            executor.shutdown(wait=False)


def processors() -> int:
    """Count the processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_flight(
    submit: Callable[[int], futures.Future[T]], items: Sequence[int], ahead: int
) -> Iterator[tuple[int, T]]:
    """Keep `ahead` items submitted; yields each with its result, in the order of completion."""
    waiting: dict[futures.Future[T], int] = {}
    todo = iter(items)
    while True:
        for index in todo:
            waiting[submit(index)] = index
            if len(waiting) >= ahead:
                break
        if not waiting:
            return
        done, _ = futures.wait(waiting, return_when=futures.FIRST_COMPLETED)
        for future in sorted(done, key=waiting.__getitem__):
            yield waiting.pop(future), future.result()


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its workers itself

    def end_with_parent() -> None:
        """Without this, workers of a killed parent would wait for work for ever."""
        if (parent := multiprocessing.parent_process()) is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    keep_steady()


_task: Callable[[bytes], tuple[Work, RunFolder]] = cache(pickle.loads)
"""What a worker process computes, the same in all calls."""


def _in_worker(task: bytes, index: int) -> Counter[str]:
    return compute(*_task(task), index)


def _elsewhere(work: Work, layout: RunLayout, expected: dict[str, Any], index: int) -> Results:
    """Compute a chunk on a cluster's worker, if it has the same code and libraries."""
    here = environment()
    differing = [key for key in expected if here.get(key) != expected[key]]
    if differing:
        raise InputError(
            "worker_cluster_has_another", differing=differing[0], here=here.get(differing[0]),
            expected=expected[differing[0]],
        )  # fmt: skip
    with single_threaded():
        return work(*layout.span(index))


@contextmanager
def single_threaded() -> Iterator[None]:
    """Use one BLAS, OpenMP and OpenCV thread inside the block; what was set before, after it. A sum
    over several threads is rounded in another order: results would differ between machines."""
    from threadpoolctl import threadpool_limits

    with ExitStack() as stack:
        stack.enter_context(threadpool_limits(limits=1))
        if (cv2 := sys.modules.get("cv2")) is not None:
            stack.callback(cv2.setNumThreads, cv2.getNumThreads())
            cv2.setNumThreads(1)
        yield
