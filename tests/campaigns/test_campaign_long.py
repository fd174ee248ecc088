"""Campaigns that are killed, shared out to workers, or fitted to a model."""

import csv
import os
import shutil

import numpy as np
import pytest

import isochrome
from campaigns.conftest import film
from isochrome import simulate
from isochrome.campaigns import process_campaign
from isochrome.output import read_csv, write_tiff
from isochrome.processing import process
from runs.counting import contents
from runs.killing import (
    children,
    finished,
    finished_chunks,
    kill,
    needs_proc,
    start,
    wait_for_the_end_of,
    wait_until,
)
from scene_texts import SMALL_CAMERA, WORN_CONTACT

pytestmark = pytest.mark.long


@pytest.mark.study
@needs_proc
@pytest.mark.parametrize("workers", ["1", "2"])
def test_killed_in_the_second_recording_it_ends_with_the_same_bytes(place, code, workers):
    for i in range(1, 5):
        write_tiff(place / f"runs/run{i}.tif", film(120, i))

    def begin(out, *more):
        return start(
            place, code, "-m", "isochrome", "process", "runs/*.tif", "--scene", "scene.toml",
            "--out", out, *more,
        )  # fmt: skip

    finished(begin("whole"))
    run = begin("out", "--workers", workers)
    second = place / "out" / "run2"
    wait_until(lambda: finished_chunks(second), "it finished no chunk of run2", run=run)
    workers_of_it = children(run.pid)
    kill(run, with_workers=False)
    wait_for_the_end_of(workers_of_it)
    assert (place / "out" / "run2.partial").exists() and not second.exists()
    assert not (place / "out" / "summary.csv").exists()
    kept = {p: p.stat().st_mtime_ns for p in (place / "out" / "run1").glob("*")}
    assert kept or workers == "2"  # two are in work at a time
    finished(begin("out", "--workers", workers))
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


CONTACT = WORN_CONTACT + SMALL_CAMERA + "noise_grey = 2.0\n"


@pytest.mark.study
@pytest.mark.long
def test_fitted_values_are_summed_up_and_drawn(place):
    (place / "contact.toml").write_text(CONTACT, "utf-8")
    truth = {"first": (44.0, 0.25), "second": (40.0, 0.3)}
    for seed, (name, (load, friction)) in enumerate(truth.items()):
        values = {"load.normal_n": load, "friction.coefficient": friction, "camera.seed": seed}
        scene = isochrome.load_scene("contact.toml").with_values(values)
        simulate(scene, place / name)
        shutil.copy(place / name / "frames.tif", place / "runs" / f"{name}.tif")
    found = process_campaign("runs/*.tif", "contact.toml", "all")
    assert found.exit_code == 0
    with open(place / "all" / "summary.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row, (name, (load, friction)) in zip(rows, truth.items(), strict=True):
        assert row["folder"] == name and row["status"] == "ok"
        for key, value in (("load.normal_n", load), ("friction.coefficient", friction)):
            spread = float(row[f"{key} median_standard_uncertainty"])
            # the mean of two frames: five times its uncertainty is missed once in a million
            assert abs(float(row[f"{key} mean"]) - value) < 5 * spread / np.sqrt(2)
            table = read_csv(place / "all" / name / "frames.csv")
            assert float(row[f"{key} mean"]) == pytest.approx(np.mean(table[key]), rel=1e-8)
        process(f"runs/{name}.tif", "contact.toml", place / "alone" / name)
        assert contents(place / "all" / name) == contents(
            place / "alone" / name
        )  # pictures and all
    assert (place / "all" / "summary.png").read_bytes().startswith(b"\x89PNG")
