"""A campaign is what its recordings give alone, and one bad one harms no other."""

import csv
import hashlib
import json
import os
import re
import shutil
import statistics
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import isochrome
from campaigns.conftest import COLS, ROWS, film
from commands import exit_code
from isochrome.campaigns import Campaign, Outcome, process_campaign
from isochrome.campaigns import api as run_module
from isochrome.errors import InputError
from isochrome.output import write_tiff
from isochrome.processing import process
from isochrome.runs import Stopped, locked
from processing.tracked_films import write_video
from runs.counting import contents
from scene_texts import PAPER_PAIR, SMALL_CAMERA


def summary(folder):
    with open(folder / "summary.csv", encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def command(monkeypatch, capfd):
    """Run the command line in this process: exit code, output, errors."""

    def run(*arguments):
        capfd.readouterr()
        return exit_code(monkeypatch, *arguments), *capfd.readouterr()

    return run


@pytest.mark.long
def test_each_recording_is_what_it_is_alone_and_a_broken_one_harms_no_other(
    place, no_pictures, command
):
    videos = [place / "runs" / f"Versuch {n}" for n in ("1 場.avi", "2 é.mkv", "10.mkv")]
    for number, (path, count) in enumerate(zip(videos, (3, 4, 5), strict=True)):
        write_video(path, film(count, number), "ffv1", "gray", rate=10)
    write_tiff(place / "runs" / "Versuch 3.tif", film(2, 3))
    videos[2].write_bytes(videos[2].read_bytes()[: videos[2].stat().st_size // 2])
    # by this process alone, however slow it is: the pictures of others are not left out
    code, out, err = command(
        "process", "runs/*", "--scene", "scene.toml", "--out", "all", "--json", "--workers", "1"
    )
    assert code == 2
    *_, line = err.splitlines()
    assert line.startswith("isochrome: 1 of 4 recordings could not be wholly processed")
    assert os.path.join("runs", "Versuch 10.mkv") in line
    names = ["Versuch 1 場", "Versuch 2 é", "Versuch 3", "Versuch 10"]
    rows = summary(place / "all")
    assert [row["folder"] for row in rows] == names
    assert [row["status"] == "failed" for row in rows] == [False, False, False, True]
    assert [row["frames"] for row in rows] == ["3", "4", "2", ""]
    assert [row["duration_s"] for row in rows] == ["0.2", "0.3", "", ""]
    assert [row["pixel_mm"] for row in rows] == ["0.05"] * 3 + [""]
    assert "Versuch 10.mkv" in rows[3]["error"] and not any(row["error"] for row in rows[:3])
    left = {p.name for p in (place / "all").iterdir()}
    assert left == {*names[:3], "summary.csv", "summary.json"}  # nothing fitted: no picture
    for row in rows[1:3]:
        process(row["recording"], "scene.toml", place / "alone" / row["folder"])
        assert contents(place / "all" / row["folder"]) == contents(place / "alone" / row["folder"])
    told = json.loads(out)
    assert told.pop("out") == "all"
    kept = json.loads((place / "all" / "summary.json").read_text("utf-8"))
    for name in ("outputs", "outputs_crc32c", "record_crc32c"):
        del kept[name]  # by which `isochrome verify` tells what is damaged
    assert told == kept
    assert told["isochrome"] == isochrome.__version__
    assert told["scene_sha256"] == hashlib.sha256(told["scene"].encode()).hexdigest()
    for row, item in zip(rows, told["recordings"], strict=True):
        own = (place / row["recording"]).read_bytes()
        assert item["inputs_sha256"][row["recording"]] == hashlib.sha256(own).hexdigest()


@pytest.mark.long
def test_what_is_complete_is_not_done_again(stacks, place):
    first = process_campaign(stacks[:3], "scene.toml", "out")
    assert not any(item.already for item in first.outcomes) and first.exit_code == 0
    before = contents(place / "out")
    stamps = {p: p.stat().st_mtime_ns for p in (place / "out").glob("*/*")}
    shutil.rmtree(place / "out" / "run2")
    again = process_campaign("runs/run[1-3].tif", "scene.toml", "out")
    assert [item.already for item in again.outcomes] == [True, False, True]
    assert contents(place / "out") == before
    for path, stamp in stamps.items():
        assert path.parent.name == "run2" or path.stat().st_mtime_ns == stamp


@pytest.mark.long
def test_stopped_it_says_what_is_kept_and_goes_on(stacks, place):
    process_campaign(stacks[:2], "scene.toml", "whole")

    def stop(recordings, frames):
        if recordings.done == 1 and frames is not None:
            raise KeyboardInterrupt

    with pytest.raises(Stopped, match=r"1 of 2 recordings are finished .*again to resume$"):
        process_campaign(stacks[:2], "scene.toml", "out", progress=stop)
    assert not (place / "out" / "summary.csv").exists()
    process_campaign(stacks[:2], "scene.toml", "out")
    assert contents(place / "out") == contents(place / "whole")
    assert not (place / "out.partial").exists()


@pytest.mark.long
def test_progress_is_told_of_recordings_and_of_the_frames_in_work(stacks):
    told = []
    process_campaign(stacks[:2], "scene.toml", "out", progress=lambda *both: told.append(both))
    assert [r.done for r, _ in told] == sorted(r.done for r, _ in told)
    assert {r.count for r, _ in told} == {2} and told[-1][0].done == 2
    frames = [(r.done, f.done, f.count) for r, f in told if f is not None]
    assert frames[-1] == (1, 3, 3) and (0, 2, 2) in frames


@pytest.mark.long
def test_a_recording_that_goes_or_changes_on_the_way_is_reported(stacks, place):
    def disturb(recordings, frames):
        if recordings.done == 1 and frames is None:
            (place / stacks[1]).unlink()
        if recordings.done == 2 and frames is not None and frames.done == 0:
            with open(place / stacks[2], "ab") as file:
                file.write(b"more")

    found = process_campaign(stacks, "scene.toml", "out", progress=disturb)
    failed = [status == "failed" for status in found.columns["status"]]
    assert failed == [False, True, True, False]
    assert "run2.tif: no such file" in found.columns["error"][1]
    assert "run3.tif: changed while it was read" in found.columns["error"][2]
    assert found.failed == (stacks[1], stacks[2]) and found.exit_code == 2
    assert found.outcomes[1].inputs == {}
    assert {p.name for p in (place / "out").iterdir()} == {
        "run1", "run4", "summary.csv", "summary.json"
    }  # fmt: skip


@pytest.mark.long
def test_frames_that_fail_are_left_out_where_that_is_wanted(stacks, place, command):
    frames = film(3, 1)
    frames[1] = 20  # darkness alone
    write_tiff(place / stacks[1], frames)
    write_tiff(place / stacks[2], np.full_like(film(2, 1), 20))
    known = "[[frames.known_order]]\nrow_px = 2\ncol_px = 1\norder = 0.0\n"
    (place / "scene.toml").write_text((place / "scene.toml").read_text("utf-8") + known, "utf-8")
    code, _, err = command(
        "process", *stacks[:3], "--scene", "scene.toml", "--out", "out", "--keep-going"
    )
    rows = summary(place / "out")
    assert code == 2
    assert [row["status"] for row in rows] == ["ok", "flagged", "failed"]
    # the third is refused as a whole: no results say which of its frames failed
    assert [row["failed_frames"] for row in rows] == ["0", "1", ""]
    assert "nothing could be read in any of its 2 frames" in rows[2]["error"]
    assert rows[1]["error"] == "1 of 3 frames could not be processed"
    assert "2 of 3 recordings could not be wholly processed" in err.splitlines()[-1]
    assert rows[1]["kept_share"] and not rows[2]["kept_share"]


TOO_MUCH = (
    PAPER_PAIR
    + "\n[load]\nnormal_n = 4e6\n\n[polariscope]\nwavelength_nm = 587.0\n"
    + SMALL_CAMERA.replace("160", str(COLS)).replace("120", str(ROWS)).replace("0.025", "0.05")
)
"""A load under which no half-plane is left."""


def test_what_cannot_be_computed_by_its_physics_has_its_own_exit_code(stacks, place):
    (place / "much.toml").write_text(TOO_MUCH, "utf-8")
    found = process_campaign(stacks, "much.toml", "out")
    assert found.exit_code == 3 and found.failed == tuple(stacks)
    assert all("the contact's half-width would be" in text for text in found.columns["error"])
    (place / stacks[1]).write_bytes(b"no TIFF")  # which is for its user to mend
    assert process_campaign(stacks, "much.toml", "out").exit_code == 2
    codes = [Outcome({"recording": "a"}, {}, code) for code in (0, 3, 2)]
    assert [Campaign(None, None, tuple(codes[:n])).exit_code for n in (1, 2, 3)] == [0, 3, 2]


def test_why_a_recording_failed_does_not_depend_on_when(stacks, place, monkeypatch):
    """After a minute's work what is finished is kept, and that is said: to who waits, not here."""
    frames = film(5, 4)
    frames[4] = 255
    write_tiff(place / stacks[3], frames)
    soon = process_campaign(stacks[3:], "scene.toml", "soon")
    clock, ahead = time.perf_counter, [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock() + ahead[0])

    def wait(_, of_frames):
        ahead[0] = 90.0 * (of_frames is not None and of_frames.done >= 3)

    late = process_campaign(stacks[3:], "scene.toml", "late", progress=wait)
    assert (place / "late" / "run4.partial").exists()
    assert not (place / "soon" / "run4.partial").exists()
    assert late.columns["error"] == soon.columns["error"]
    assert "all white" in soon.columns["error"][0]


def test_a_cluster_that_cannot_be_had_is_said_once(stacks, place, monkeypatch):
    """It is no recording's fault."""
    monkeypatch.setitem(sys.modules, "distributed", None)  # as if it were not installed
    with pytest.raises(InputError, match=r"pip install isochrome\[cluster\]"):
        process_campaign(stacks, "scene.toml", "out", cluster="tcp://127.0.0.1:9")
    assert not (place / "out" / "summary.csv").exists()


def test_killed_while_its_summary_takes_its_place_a_campaign_goes_on(stacks, place, monkeypatch):
    """Each of the renames in turn is the first that is not done."""
    process_campaign(stacks[:1], "scene.toml", "whole")
    rename = os.replace
    for last in ("summary.json", "summary.csv"):

        def dying(source, target, last=last):
            if target.parent.name == "out" and target.name == last:
                raise KeyboardInterrupt
            rename(source, target)

        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", dying)
            with pytest.raises(KeyboardInterrupt):
                process_campaign(stacks[:1], "scene.toml", "out")
        process_campaign(stacks[:1], "scene.toml", "out")
        assert contents(place / "out") == contents(place / "whole")
        (place / "out" / "summary.json").unlink()
        (place / "out" / "summary.csv").unlink()


def test_the_picture_of_an_earlier_campaign_goes(stacks, place):
    """Of this one, in which nothing is fitted, there is none."""
    process_campaign(stacks[:1], "scene.toml", "out")
    (place / "out" / "summary.png").write_bytes(b"of values")
    process_campaign(stacks[:1], "scene.toml", "out")
    assert not (place / "out" / "summary.png").exists()


def test_bands_are_as_wide_as_the_pictures_title_says():
    spread = np.array([0.1, 0.2, 0.4])
    curves = {
        "distance_m": np.array([0.0, 5.0, 9.0]), "frame": np.arange(3.0),
        "load.normal_n": np.array([40.0, 41.0, 43.0]), "load.normal_n standard_uncertainty": spread,
    }  # fmt: skip
    row = {
        "folder": "run1", "status": "ok",
        "load.normal_n mean": 41.3, "load.normal_n standard_deviation": 1.5,
    }  # fmt: skip
    scene = SimpleNamespace(name="scene")
    figure = Campaign(None, scene, (Outcome(row, {}, curves=curves),)).figure()
    _, within = figure.axes
    (band,) = within.collections
    corners = band.get_paths()[0].vertices
    width = [np.ptp(corners[corners[:, 0] == x, 1]) for x in curves["distance_m"]]
    (said,) = re.findall(r"band ± (\S+) standard uncertainties", figure.get_suptitle())
    np.testing.assert_allclose(width, 2 * float(said) * spread, rtol=1e-12)


def test_two_campaigns_on_one_folder_are_refused(stacks, place, command):
    with locked(place / "out.partial"):
        code, _, err = command("process", *stacks, "--scene", "scene.toml", "--out", "out")
    assert code == 2 and "another run is at work there" in err and err.count("\n") == 1
    assert not (place / "out").exists()


def test_what_is_refused_leaves_all_as_it_was(stacks, place, command):
    process(stacks[0], "scene.toml", "single")
    (place / "own").mkdir()
    (place / "own" / "summary.csv").write_text("mine")
    shutil.copytree(place / "runs", place / "more" / "runs")
    cases = [
        (stacks, "single", "holds the results of one recording"),
        (stacks, "own", "would be replaced by the campaign's summary"),
        ([stacks[0], "more/runs"], "more", "would be put among its images"),
        ([*stacks, "--workers", "0"], "out", "give 1 or more"),
    ]
    before = contents(place)
    for recordings, out, said in cases:
        code, _, err = command("process", *recordings, "--scene", "scene.toml", "--out", out)
        assert code == 2 and said in err and err.count("\n") == 1
        assert contents(place) == before
    with pytest.raises(InputError, match="no recordings are named"):
        process_campaign([], "scene.toml", "out")


def test_many_recordings_go_side_by_side(stacks, monkeypatch):
    given = []

    def one(task, *rest):
        return Outcome({"recording": task.folder.name, "status": "ok"}, {})

    def several(tasks, scene, options, workers):
        given.append((sorted(tasks), workers))
        yield from ((number, one(task)) for number, task in tasks.items())

    monkeypatch.setattr(run_module, "outcome_of", one)
    monkeypatch.setattr(run_module, "run_side_by_side", several)
    monkeypatch.setattr(run_module.runs, "processors", lambda: 2)
    for few, workers in ((stacks[:3], 2), (stacks[:3], None), (stacks, 1), (stacks, 3)):
        process_campaign(few, "scene.toml", "few", workers=workers)
        assert given == []
    for workers in (2, None):
        process_campaign(stacks, "scene.toml", "many", workers=workers)
        assert given.pop() == ([0, 1, 2, 3], 2)


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no symbolic links there")
def test_results_go_through_no_link_out_of_the_folder(stacks, place):
    elsewhere = place / "elsewhere"
    elsewhere.mkdir()
    (place / "out").mkdir()
    (place / "out" / "run1").symlink_to(elsewhere, target_is_directory=True)
    found = process_campaign(stacks[:2], "scene.toml", "out")
    assert found.columns["status"][0] == "failed" != found.columns["status"][1]
    assert "symbolic link" in found.columns["error"][0] and not list(elsewhere.iterdir())


@pytest.mark.long
def test_files_are_joined_where_that_is_said_and_images_always_are(stacks, place, command):
    code, out, _ = command(
        "process", *stacks[:2], "--join", "--scene", "scene.toml", "--out", "joined", "--json"
    )
    assert code == 0 and len(json.loads(out)["frames"]["frame"]) == 2 + 3
    (place / "images").mkdir()
    for i, image in enumerate(film(3, 5)):
        write_tiff(place / "images" / f"image{i}.tif", image[None])
    for named in (["images/*.tif"], [f"images/image{i}.tif" for i in range(3)]):
        code, out, _ = command(
            "process", *named, "--scene", "scene.toml", "--out", "images-out", "--json"
        )
        assert code == 0 and len(json.loads(out)["frames"]["frame"]) == 3
    assert (place / "images-out" / "frames.csv").exists()


def test_check_goes_through_all_and_fit_wants_one(stacks, place, command):
    (place / stacks[1]).write_bytes(b"no TIFF")
    code, out, _ = command("check", "runs/*.tif", "--scene", "scene.toml", "--json")
    told = json.loads(out)
    assert code == 2 and not told["ok"]
    assert [one["recording"] for one in told["recordings"]] == [os.path.normpath(s) for s in stacks]
    assert [one["ok"] for one in told["recordings"]] == [True, False, True, True]
    code, out, _ = command("check", stacks[0], "--scene", "scene.toml", "--json")
    assert code == 0 and json.loads(out)["frames"] == 2
    code, _, err = command("fit", "runs/*.tif", "--scene", "scene.toml", "--free", "load.normal_n")
    assert code == 2 and "4 recordings" in err and "--join" in err and err.count("\n") == 1


def test_the_summary_holds_the_measures_of_the_frames(stacks, place, monkeypatch):
    """Against the definitions, computed here by the standard library."""
    table = {
        "frame": [0, 1, 2], "distance_m": [0.0, 5.0, 9.0], "chi": [1.0, 4.0, None],
        "pixel_mm": [None, 0.02, 0.02], "kept_share": [0.9, 0.8, float("nan")],
        "load.normal_n": [40.0, 43.0, None], "load.normal_n standard_uncertainty": [0.2, 0.4, None],
        "warnings": ["", "odd", "no fringes"],
    }  # fmt: skip

    def instead(frames, scene, out, **options):
        found = process(frames, scene, out)
        return replace(found, columns=table, warnings=("frame 1: odd",), failed=1)

    monkeypatch.setattr(run_module, "process", instead)
    process_campaign(stacks[:1], "scene.toml", "out")
    (row,) = summary(place / "out")
    loads = [40.0, 43.0]
    assert float(row["load.normal_n mean"]) == statistics.mean(loads)
    assert float(row["load.normal_n standard_deviation"]) == pytest.approx(
        statistics.stdev(loads),
        rel=1e-8,  # nine digits in a table
    )
    assert float(row["load.normal_n median_standard_uncertainty"]) == pytest.approx(0.3, rel=1e-8)
    assert (row["chi_median"], row["chi_max"], row["kept_share"]) == ("2.5", "4", "0.85")
    assert (row["frames"], row["failed_frames"], row["flagged_frames"]) == ("3", "1", "1")
    assert (row["pixel_mm"], row["warnings"], row["status"]) == ("0.02", "frame 1: odd", "flagged")
    assert (place / "out" / "summary.png").read_bytes().startswith(b"\x89PNG")
