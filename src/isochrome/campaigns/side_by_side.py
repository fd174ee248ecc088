"""Whole recordings computed side by side, a worker process for each of them."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import closing
from typing import Any

from isochrome.campaigns.outcome import Outcome, Task, failed, outcome_of
from isochrome.errors import InputError
from isochrome.runs import WorkersLost, in_flight, worker_pool
from isochrome.scene import Scene

_TASK: list[tuple[Scene, dict[str, Any]]] = []
"""What a worker process was started for."""


def run_side_by_side(
    tasks: Mapping[int, Task], scene: Scene, options: Mapping[str, Any], workers: int
) -> Generator[tuple[int, Outcome]]:
    """Process recordings in worker processes, each of which does one after the other.

    Where a worker is killed, those that were in work then are done again, each by a worker of its
    own: what kills that too has failed, and the rest goes on.
    Parameters: `tasks`, by their number; `scene`; `options` of `process`; `workers`, how many.
    Yields each number with its Outcome, in the order of completion.
    """
    left = dict(tasks)
    while left:
        try:
            with closing(_by_pool(left, scene, options, min(workers, len(left)))) as pool:
                for number, outcome in pool:
                    del left[number]
                    yield number, outcome
        except WorkersLost:
            for number in list(left)[:workers]:  # as many as are given out at a time, in order
                yield number, _by_itself(number, left.pop(number), scene, options)


def _by_pool(
    tasks: Mapping[int, Task], scene: Scene, options: Mapping[str, Any], workers: int
) -> Generator[tuple[int, Outcome]]:
    with worker_pool(workers, _take_task, (scene, dict(options))) as pool:
        given = dict(tasks)
        yield from in_flight(lambda k: pool.submit(_in_worker, given[k]), list(given), workers)


def _by_itself(number: int, task: Task, scene: Scene, options: Mapping[str, Any]) -> Outcome:
    try:
        ((_, outcome),) = _by_pool({number: task}, scene, options, 1)
    except WorkersLost as error:
        lost = InputError(
            "the process that worked on it was killed twice, by the system when memory runs out, "
            "or by a file that breaks its decoder; process it alone, with a smaller frames.roi"
        )
        lost.__cause__ = error
        return failed(task, lost)
    return outcome


def _take_task(scene: Scene, options: dict[str, Any]) -> None:
    _TASK[:] = [(scene, options)]


def _in_worker(task: Task) -> Outcome:
    ((scene, options),) = _TASK
    return outcome_of(task, scene, options | {"workers": 1})
