"""Workers that are started before their task is known."""

import multiprocessing
import os

import pytest

from isochrome.errors import InputError
from isochrome.runs import RunOptions, WorkersLost, run_job, waiting_workers
from runs.counting import Count, calls, contents, finish, job, truth


@pytest.mark.long
def test_they_compute_what_one_process_does_and_end(notes, tmp_path):
    run_job(job(Count(notes)), tmp_path / "one", finish)
    with waiting_workers(2, truth) as waiting:
        means = RunOptions(workers=2, waiting=waiting)
        ours = {child.pid for child in multiprocessing.active_children()}
        run_job(job(Count(notes)), tmp_path / "two", finish, means=means)
    assert contents(tmp_path / "two") == contents(tmp_path / "one")
    assert calls(notes) == sorted(2 * [0, 3, 6, 9])
    others = {int(path.stem) for path in notes.iterdir()} - {os.getpid()}
    assert others and others <= ours
    assert not multiprocessing.active_children()


def test_without_a_task_they_end():
    """As where the folder holds all results already."""
    with waiting_workers(2, truth):
        assert len(multiprocessing.active_children()) == 2
    assert not multiprocessing.active_children()


def test_where_the_frames_are_refused_they_end():
    with pytest.raises(InputError, match=r"^no such frames$"), waiting_workers(2, truth):
        raise InputError("no such frames")
    assert not multiprocessing.active_children()


@pytest.mark.long
def test_one_that_is_killed_before_its_task_is_said(notes, tmp_path):
    said = pytest.raises(WorkersLost, match="a worker process was killed")
    with said, waiting_workers(2, truth) as waiting:
        multiprocessing.active_children()[0].kill()
        means = RunOptions(workers=2, waiting=waiting)
        run_job(job(Count(notes)), tmp_path / "out", finish, means=means)
    assert not multiprocessing.active_children()
    run_job(job(Count(notes)), tmp_path / "out", finish)  # nothing is in the way
