"""Chunks computed by worker processes or a cluster are those of one process, bit for bit."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import tifffile

from isochrome.errors import InputError
from isochrome.runs import RunOptions, WorkerPool, WorkersLost, run_job, single_threaded
from runs import killing
from runs.counting import Count, calls, computed_again, contents, finish, job, truth

TESTS = str(Path(__file__).parents[1])


def test_two_workers_leave_what_one_process_leaves_and_do_not_hear_the_keyboard(count, tmp_path):
    """A terminal tells all processes of Ctrl-C: what becomes of the run is its own to say."""
    run_job(job(count), tmp_path / "one", finish)
    told = []

    def tell(tally):
        told.append(tally)
        for path in count.notes.iterdir():  # those that have begun to work
            if int(path.stem) != os.getpid() and sys.platform != "win32":
                os.kill(int(path.stem), signal.SIGINT)

    # who started the tests in the background ignores the keyboard, and so would all workers
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        run_job(job(count), tmp_path / "two", finish, options=RunOptions(workers=2), progress=tell)
    except KeyboardInterrupt as stop:
        pytest.fail(f"a worker heard the keyboard: {stop}")
    finally:
        signal.signal(signal.SIGINT, before)
    assert contents(tmp_path / "two") == contents(tmp_path / "one")
    assert calls(count.notes) == sorted(2 * [0, 3, 6, 9])
    assert f"{os.getpid()}.txt" in {p.name for p in count.notes.iterdir()}
    assert len(list(count.notes.iterdir())) >= 2  # the second time others did it
    assert told[-1].done == told[-1].count == 10


def test_workers_that_were_started_before_their_work_was_known_compute_it(count, tmp_path):
    """They import what it needs meanwhile."""
    with WorkerPool(2, Count) as pool:
        run_job(job(count), tmp_path / "two", finish, options=RunOptions(workers=2, pool=pool))
    np.testing.assert_array_equal(
        tifffile.imread(tmp_path / "two" / "order.tif"), np.stack([truth(i) for i in range(10)])
    )
    assert f"{os.getpid()}.txt" not in {p.name for p in count.notes.iterdir()}  # not computed here


@pytest.mark.long
def test_a_killed_worker_is_said_and_the_same_call_goes_on(notes, tmp_path):
    """What the system does when memory runs out."""
    switch = tmp_path / "switch"
    switch.touch()
    work = Count(notes, fail_at=7, failure=SystemExit, switch=switch)
    with pytest.raises(WorkersLost, match=r"a worker process was killed.*the same command again"):
        run_job(job(work), tmp_path / "out", finish, options=RunOptions(workers=2))
    switch.unlink()
    run_job(job(work), tmp_path / "out", finish, options=RunOptions(workers=2))
    np.testing.assert_array_equal(
        tifffile.imread(tmp_path / "out" / "order.tif"), np.stack([truth(i) for i in range(10)])
    )


@pytest.mark.long
def test_a_refusal_by_a_worker_is_the_same_sentence(notes, tmp_path):
    (tmp_path / "switch").touch()
    work = Count(notes, fail_at=7, failure=InputError, switch=tmp_path / "switch")
    with pytest.raises(InputError, match=r"^item 7 is bad$"):
        run_job(job(work), tmp_path / "out", finish, options=RunOptions(workers=2))
    assert {p.name for p in tmp_path.iterdir()} == {"notes", "switch"}


RUN = """
import sys
from pathlib import Path
if __name__ == "__main__":
    sys.path.insert(0, sys.argv[3])
    from isochrome.runs import RunOptions, Stopped, run_job
    from runs.counting import Count, finish, job
    work = Count(Path(sys.argv[2]), seconds=0.2)
    try:
        run_job(job(work, count=60), sys.argv[1], finish, options=RunOptions(workers=2))
    except Stopped as stop:
        print(stop)
"""


def started(tmp_path, code, notes):
    """A run with two workers in another process, and its workers once each has begun a chunk."""
    run = killing.start(tmp_path, code, "-c", RUN, "out", notes, TESTS)

    def at_work():
        return len(list(notes.iterdir())) >= 2 and len(calls(notes)) >= 4

    killing.wait_until(at_work, "no two workers are at work", run=run)
    return run, killing.children(run.pid)


def goes_on_with_what_was_kept(notes, out):
    """Let a run of 20 chunks that has ended go on: what it has kept is not computed again."""
    kept, before = kept_chunks(out), Counter(calls(notes))
    assert len(before) - len(kept) <= 4  # two workers, each with one in hand and one on its way
    run_job(job(Count(notes), count=60), out, finish)
    assert Counter(calls(notes)) - before == Counter(set(range(0, 60, 3)) - kept)


def kept_chunks(out):
    """The starts of the chunks that a run has kept beside its output."""
    records = out.with_name(f"{out.name}.partial").glob("results-*/records/*.json")
    return {3 * int(file.stem) for file in records}


@pytest.mark.long
@killing.needs_proc
def test_workers_end_with_a_killed_run_and_it_goes_on(notes, tmp_path, code):
    run, workers = started(tmp_path, code, notes)
    killing.kill(run, with_workers=False)
    killing.wait_for_the_end_of(workers)
    goes_on_with_what_was_kept(notes, tmp_path / "out")
    run_job(job(Count(notes), count=60), tmp_path / "other", finish)
    assert contents(tmp_path / "out") == contents(tmp_path / "other")


@pytest.mark.long
@killing.needs_proc
def test_a_run_with_workers_stops_at_the_keyboard_at_once(notes, tmp_path, code):
    run, workers = started(tmp_path, code, notes)
    run.send_signal(signal.SIGINT)
    said = killing.finished(run)
    assert said.startswith("stopped; ") and "run the same command again to resume" in said
    killing.wait_for_the_end_of(workers)
    goes_on_with_what_was_kept(notes, tmp_path / "out")


def test_libraries_compute_with_one_thread_and_get_theirs_back():
    """Two before, whatever the machine has and however it is set.

    A library that is built for one thread is left out.
    """
    import cv2
    from threadpoolctl import threadpool_info, threadpool_limits

    def threads():
        pools = [pool for pool in threadpool_info() if pool.get("threading_layer") != "disabled"]
        return {pool["num_threads"] for pool in pools}

    own = cv2.getNumThreads()
    try:
        cv2.setNumThreads(2)
        with threadpool_limits(limits=2):
            assert threads() == {2} and cv2.getNumThreads() == 2
            with single_threaded():
                assert threads() == {1} and cv2.getNumThreads() == 1
            assert threads() == {2} and cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(own)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_cluster_that_loses_a_worker_completes_with_the_same_bytes(notes, tmp_path):
    import distributed

    run_job(job(Count(notes), count=60), tmp_path / "one", finish)
    one = contents(tmp_path / "one")
    for note in notes.iterdir():
        note.unlink()
    work = Count(notes, seconds=0.05)
    killed = []

    def kill_one(tally):
        if tally.done >= 12 and not killed:
            busy = [int(p.stem) for p in notes.iterdir()]
            killed.append(busy[0])
            os.kill(busy[0], signal.SIGKILL)

    with distributed.LocalCluster(
        n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        run_job(
            job(work, count=60), tmp_path / "cluster", finish,
            options=RunOptions(cluster=cluster.scheduler_address), progress=kill_one,
        )  # fmt: skip
    assert killed and killed[0] != os.getpid()
    assert f"{os.getpid()}.txt" not in {p.name for p in notes.iterdir()}  # not computed here
    assert len(list(notes.iterdir())) >= 3
    assert contents(tmp_path / "cluster") == one


OTHER_CODE = """
import sys
from pathlib import Path
if __name__ == "__main__":
    sys.path.insert(0, sys.argv[3])
    from distributed import LocalCluster
    import isochrome
    from isochrome.errors import InputError
    from isochrome.runs import RunOptions, environment, run_job
    from runs.counting import Count, finish, job
    environment()  # as the code is here
    with open(Path(isochrome.__file__).with_name("errors.py"), "a") as file:
        file.write("# newer there")
    with LocalCluster(n_workers=1, processes=True, dashboard_address=None) as cluster:
        means = RunOptions(cluster=cluster.scheduler_address)
        try:
            run_job(job(Count(Path(sys.argv[2]))), sys.argv[1], finish, options=means)
        except InputError as error:
            print(error)
"""


@pytest.mark.long
def test_a_clusters_worker_with_other_code_is_refused(notes, tmp_path, code):
    """Else results would depend on which worker computed them."""
    newer = shutil.copytree(code, tmp_path / "newer")
    command = [sys.executable, "-c", OTHER_CODE, tmp_path / "out", notes, TESTS]
    env = os.environ | {"PYTHONPATH": str(newer)}
    said = subprocess.run(
        command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=killing.NO_END_S
    )
    assert said.stdout.startswith("a worker of the cluster has another code_sha256 ("), said
    assert not (tmp_path / "out").exists() and not list(notes.iterdir())


@pytest.mark.long
def test_no_cluster_is_said(count, tmp_path):
    with pytest.raises(InputError, match=r"--cluster tcp://127\.0\.0\.1:9: no Dask scheduler"):
        run_job(
            job(count), tmp_path / "out", finish, options=RunOptions(cluster="tcp://127.0.0.1:9")
        )
    assert not (tmp_path / "out.partial").exists()


def test_workers_below_one_are_refused(count, tmp_path):
    with pytest.raises(InputError, match="--workers 0: give 1 or more"):
        run_job(job(count), tmp_path / "out", finish, options=RunOptions(workers=0))


@pytest.mark.study
@killing.needs_proc
@pytest.mark.parametrize("workers", [1, 2])
def test_killed_at_random_moments_no_more_than_the_chunks_in_hand_are_lost(
    notes, tmp_path, code, workers
):
    """Twenty kills in all, each after so many chunks were begun, and some time."""
    rng = random.Random(workers)
    run_job(job(Count(notes), count=60), tmp_path / "whole", finish)
    whole = contents(tmp_path / "whole")
    script = RUN.replace("0.2", "0.02").replace("workers=2", f"workers={workers}")
    kept = 0
    for k in range(10):
        out, own = tmp_path / f"out{k}", tmp_path / f"notes{k}"
        own.mkdir()
        run = killing.start(tmp_path, code, "-c", script, out, own, TESTS)
        begun = rng.randrange(1, 19)
        killing.wait_until(
            lambda own=own, n=begun: len(calls(own)) >= n, "it began too few", run=run
        )
        time.sleep(rng.uniform(0.0, 0.06))  # a chunk takes so long
        killing.kill(run, with_workers=False)
        kept += killing.finished_chunks(out)
        killing.ends_as(whole, killing.start(tmp_path, code, "-c", script, out, own, TESTS), out)
        # one process computes a chunk while it writes the one before
        in_hand = 2 if workers == 1 else workers
        assert computed_again(own, 20) <= in_hand, (k, begun)
    assert kept > 0  # else nothing was told of going on
