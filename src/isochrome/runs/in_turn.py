"""Chunks that follow one another: each begins with what the one before it has left."""

from __future__ import annotations

import json
from typing import Any, cast

from isochrome.runs.chunks import Bench, read_record
from isochrome.runs.job import InTurn, Job, Results, Work


def one_by_one(job: Job, bench: Bench) -> Work:
    """A job's work on a chunk, whatever it needs of the chunk before.

    What a chunk leaves goes through JSON whether it is still in memory or read from its record, so
    that a run that goes on computes with the same numbers as one that was never killed.
    Parameters: `job`; `bench`, where finished chunks lie. Returns a Work.
    """
    if not job.in_turn:
        return cast(Work, job.work)
    work, last = cast(InTurn, job.work), dict[int, Any]()

    def in_turn(start: int, stop: int) -> Results:
        index = start // bench.layout.chunk
        left = None
        if index:
            record = {"left": last[index - 1]} if index - 1 in last else None
            record = record or read_record(bench, index - 1)
            assert record is not None
            left = record["left"]
        results = work(start, stop, left)
        last.clear()
        last[index] = json.loads(json.dumps(results.left))
        return results

    return in_turn
