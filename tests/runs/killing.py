"""Runs in processes of their own, killed at some moment and begun again, to end with the same."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from runs.counting import contents

needs_sigkill = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")


NO_END_S = 600
"""What takes a run some seconds hangs after so many, on a loaded machine too."""


def listen():
    """Take signals from the keyboard, even where who runs the tests ignores them, as nohup does."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(place, code, *arguments):
    """Start Python in a folder, in a process group of its own, with a copy of the package."""
    return subprocess.Popen(
        [sys.executable, *arguments], cwd=place, env=os.environ | {"PYTHONPATH": str(code)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=None if sys.platform == "win32" else listen,
    )  # fmt: skip


def finished(run):
    """Wait until a run has ended as it should; what it said on standard output."""
    out, err = run.communicate(timeout=NO_END_S)
    assert run.returncode == 0, err
    return out


def kill(run, *, with_workers):
    """Kill a run with its workers, or alone: they are left to end by themselves then."""
    os.killpg(run.pid, signal.SIGKILL) if with_workers else run.kill()
    run.wait()
    run.stdout.close()
    run.stderr.close()


def wait_until(happened, otherwise, *, run=None, seconds=NO_END_S):
    """Wait for what a run does; fail in the words of `otherwise` where it ends before, or hangs."""
    deadline = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < deadline and (run is None or run.poll() is None), otherwise
        time.sleep(0.01)


def children(pid):
    """Processes whose parent is `pid`, by the kernel's own list."""
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def wait_for_the_end_of(workers):
    """Wait until processes are gone, which takes them a moment; those that stay are killed."""
    try:
        wait_until(lambda: all(map(_gone, workers)), "workers outlive their run", seconds=120)
    finally:
        for worker in workers:
            if not _gone(worker):
                os.kill(worker, signal.SIGKILL)


def _gone(pid):
    try:
        return ") Z " in Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return True


needs_proc = pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(), reason="needs /proc to know a process's children"
)


def finished_chunks(out):
    """How many chunks a killed run has kept beside its output, whether among results or apart."""
    folder = out.with_name(f"{out.name}.partial")
    return sum(len(list(folder.glob(at))) for at in ("results-*/records/*.json", "records/*.json"))


def ends_as(whole, run, out):
    """See that a run ends with the same bytes and clears up; what it said."""
    said = finished(run)
    other = {name for name, _ in whole.items() ^ contents(out).items()}
    assert not other, f"{out}: not as undisturbed: {sorted(other)}"
    assert not out.with_name(f"{out.name}.partial").exists(), f"{out}: its working folder is left"
    return said


def killed_and_begun_again(begin, place, with_workers, *, since, seed):
    """Kill runs, see that the same command ends each with the same bytes; how many chunks kept.

    `begin`, called with a name, starts a run; `with_workers`, for each whether its workers are
    killed too; `since`, the share of an undisturbed run's length before which none is. Where none
    had kept any, for the machine's pace has changed, one more is killed once it has.
    """
    began = time.monotonic()
    finished(begin("whole"))
    length, whole = time.monotonic() - began, contents(place / "whole")
    kept, rng = 0, random.Random(seed)
    for number, group in enumerate(with_workers):
        run, out = begin(f"out{number}"), place / f"out{number}"
        time.sleep(rng.uniform(since, 1.0) * length)
        kill(run, with_workers=group)
        kept += finished_chunks(out)
        ends_as(whole, begin(out.name), out)
    if kept == 0:
        run, out = begin("late"), place / "late"
        wait_until(lambda: finished_chunks(out), "it finished no chunk", run=run)
        kill(run, with_workers=True)
        kept = finished_chunks(out)
        ends_as(whole, begin("late"), out)
    return kept


def killed_command_ends_the_same(place, code, workers, *command):
    """How much is kept of a command's runs that are killed, alone and with their workers."""

    def begin(out):
        more = "--out", out, "--workers", workers
        return start(place, code, "-m", "isochrome", *command, *more)

    return killed_and_begun_again(begin, place, [False, True], since=0.3, seed=int(workers))


PROCESS = "process", "film.tif", "--scene", "scene.toml"
