"""Chunks that each begin with what the one before has left; runs without pictures or a store."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from isochrome.errors import InputError
from isochrome.runs import (
    Job,
    Results,
    RunLayout,
    RunOptions,
    Stopped,
    add_columns,
    column,
    rows,
    run_job,
)
from runs.counting import IDENTITY, contents


@dataclass(frozen=True)
class Sums:
    """Items x(i) = 0.1 + x(i - 1)/3, whose bits tell whether they began with the last one's."""

    switch: Path
    stop_at: int = 7

    def __call__(self, start, stop, left):
        last, found = 0.0 if left is None else left["last"], []
        # the same whether it was read from a record or is still in memory: JSON knows no tuples
        assert left is None if start == 0 else left["span"] == [start - 3, start]
        for item in range(start, stop):
            if item == self.stop_at and self.switch.exists():
                raise KeyboardInterrupt
            last = 0.1 + last / 3
            found.append({"value": last})
        ok = [{"status": "ok"}] * len(found)
        return Results({}, found, ok, {}, {"last": last, "span": (start, stop)})


def finish(bench):
    values = [row["value"] for row, _ in rows(bench)]
    (bench.results / "values.json").write_text(json.dumps(values), "utf-8")
    if bench.layout.store:
        add_columns(bench.results / "run.zarr", {"value": column(values, "item", "value")}, {}, {})
    return values


def job(work, *, store):
    layout = RunLayout(axes={"item": 10}, chunk=3, store=store)
    return Job(work, layout, IDENTITY, in_turn=True)


@pytest.mark.parametrize("store", [True, False])
def test_chunks_in_turn_go_on_with_what_was_left(tmp_path, store):
    work = Sums(tmp_path / "switch")
    whole = run_job(job(work, store=store), tmp_path / "whole", finish)
    expected = [0.1]
    while len(expected) < 10:
        expected.append(0.1 + expected[-1] / 3)
    assert whole == expected  # to the last bit
    assert (tmp_path / "whole" / "run.zarr").is_dir() == store
    work.switch.touch()
    with pytest.raises(Stopped, match="6 of 10 are finished and kept"):
        run_job(job(work, store=store), tmp_path / "out", finish)
    work.switch.unlink()
    done = []
    assert run_job(job(work, store=store), tmp_path / "out", finish, progress=done.append) == whole
    assert done[0].before == 6
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert run_job(job(work, store=store), tmp_path / "out", finish) is None


@pytest.mark.parametrize("means", [RunOptions(workers=2), RunOptions(cluster="tcp://nowhere:1")])
def test_chunks_in_turn_are_one_processs_work(tmp_path, means):
    with pytest.raises(InputError, match="which only one process can do; leave them out"):
        run_job(job(Sums(tmp_path), store=False), tmp_path / "out", finish, options=means)
    assert not any(tmp_path.iterdir())
