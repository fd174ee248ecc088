"""Campaigns that are killed, shared out to workers, or fitted to a model."""

import os

import pytest

from campaigns.conftest import film
from isochrome.campaigns import process_campaign
from isochrome.output import write_tiff
from runs import killing
from runs.counting import contents

pytestmark = pytest.mark.long


@pytest.mark.study
@killing.needs_proc
@pytest.mark.parametrize("workers", ["1", "2"])
def test_killed_in_the_second_recording_it_ends_with_the_same_bytes(place, code, workers):
    for i in range(1, 5):
        write_tiff(place / f"runs/run{i}.tif", film(120, i))

    def begin(out, *more):
        return killing.start(
            place, code, "-m", "isochrome", "process", "runs/*.tif", "--scene", "scene.toml",
            "--out", out, *more,
        )  # fmt: skip

    killing.finished(begin("whole"))
    run = begin("out", "--workers", workers)
    second = place / "out" / "run2"
    killing.wait_until(
        lambda: killing.finished_chunks(second), "it finished no chunk of run2", run=run
    )
    workers_of_it = killing.children(run.pid)
    killing.kill(run, with_workers=False)
    killing.wait_for_the_end_of(workers_of_it)
    assert (place / "out" / "run2.partial").exists() and not second.exists()
    assert not (place / "out" / "summary.csv").exists()
    kept = {p: p.stat().st_mtime_ns for p in (place / "out" / "run1").glob("*")}
    assert kept or workers == "2"  # two are in work at a time
    killing.finished(begin("out", "--workers", workers))
    assert contents(place / "out") == contents(place / "whole")
    assert {p: p.stat().st_mtime_ns for p in kept} == kept  # what was complete was not touched
    assert not (place / "out.partial").exists()


@pytest.mark.study
def test_recordings_side_by_side_are_the_same_as_one_after_the_other(drawn_stacks, place):
    (place / drawn_stacks[2]).write_bytes(b"no TIFF")
    one = process_campaign(drawn_stacks, "scene.toml", "one")
    told = []
    two = process_campaign(
        drawn_stacks, "scene.toml", "two", workers=2, progress=lambda *both: told.append(both)
    )
    for result in (one, two):
        assert result.exit_code == 2 and result.failed == (drawn_stacks[2],)
    assert contents(place / "two") == contents(place / "one")
    assert told[-1][0].done == 4


class Deadly(str):
    """A recording whose arrival kills the process that is to work on it."""

    __slots__ = ()

    def __reduce__(self):
        return os._exit, (9,)


@pytest.mark.study
def test_a_recording_that_kills_its_worker_harms_no_other(stacks, place):
    named = [stacks[0], Deadly(stacks[1]), *stacks[2:]]
    found = process_campaign(named, "scene.toml", "out", workers=2)
    assert found.failed == (stacks[1],) and found.exit_code == 2
    assert "was killed" in found.columns["error"][1]
    for name in ("run1", "run3", "run4"):
        assert (place / "out" / name / "frames.csv").exists()
