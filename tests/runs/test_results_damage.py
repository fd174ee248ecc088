"""Damaged results are named, give nothing wrong, and are mended by the command that left them."""

from __future__ import annotations

import json
import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner
from zarr.abc.store import RangeByteRequest

import isochrome
import isochrome.processing.api
from isochrome.cli import app
from isochrome.errors import InputError
from isochrome.runs import checked_store, integrity, seal
from runs.counting import contents
from runs.damage import FAULTS, commands, damage, uses, write_input

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no alarm, no pipes here")

LONGEST_S = 120
"""Seconds in which a folder, whatever is in it, is refused or read: one that hangs takes all."""

COMMANDS = {command.name: command for command in commands()}
SLOW = ("process", "track", "fit", "campaign")


class Finished:
    """Folders as the commands left them, made when they are asked for, each with a copy NAME-kept.

    `found`, what reads a folder finds in it as it was left.
    """

    def __init__(self, place):
        self.place = place
        self.found = {}

    def __call__(self, name):
        """The folder of a command as it was left, and those that it needs."""
        command = COMMANDS[name]
        for other in command.needs:
            self(other)
        if name not in self.found:
            command.again()
            shutil.copytree(name, f"{name}-kept")
            self.found[name] = {}
            if name == "simulate":
                self("single")  # with which it is compared
            self.found[name] = {use: read(self.place / name) for use, read in uses(name).items()}
        for path in (name, f"{name}-elsewhere", f"{name}.partial"):
            if (path := self.place / path).is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        shutil.copytree(self.place / f"{name}-kept", self.place / name)
        return self.place / name


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """What the commands left, in the folder where one works."""
    place = tmp_path_factory.mktemp("finished")
    before = Path.cwd()
    os.chdir(place)
    write_input(place)
    yield Finished(place)
    os.chdir(before)


def refusal_or_result(read, folder, use):
    """What reading a folder gives, or the sentence that refuses it.

    The maps of a dataset are read by zarr itself, which knows the chunk's checksum and no file.
    """
    try:
        return "", read(folder)
    except InputError as error:
        return str(error), None
    except ValueError as error:
        if use != "open_run" or "checksum" not in str(error):
            raise
        return f"{folder.name}: {error}", None


def end_hanging(*_):
    """What has not ended by now never will."""
    raise TimeoutError(f"not read, refused or mended within {LONGEST_S} s")


def check_fault(finished, name, kind, seed, *, mend=True):
    """One fault: it is named with exit code 2, gives nothing wrong, and is mended."""
    folder = finished(name)
    file = damage(folder, np.random.default_rng(seed), kind)
    what = f"{name}: {kind} of {file}, seed {seed}"
    kept = folder.with_name(f"{name}-kept")
    signal.signal(signal.SIGALRM, end_hanging)
    signal.alarm(LONGEST_S)
    ended = CliRunner().invoke(app, ["verify", name, "--json"])
    if isinstance(ended.exception, InputError):  # the record itself, in one line
        assert Path(file).name in str(ended.exception), what
    else:
        assert ended.exit_code == 2, (what, ended.output, ended.exception)
        damaged = json.loads(ended.stdout)["damaged"]
        assert file in damaged or kind == "linked", (what, damaged)
        assert damaged and set(damaged) <= set(contents(kept)), what
    for use, read in uses(name).items():
        refused, now = refusal_or_result(read, folder, use)
        assert now == finished.found[name][use] if not refused else name in refused, (
            what, use, refused,
        )  # fmt: skip
        assert "\n" not in refused, (what, use)
    if mend:
        COMMANDS[name].again()
        now, before = contents(folder), contents(kept)
        assert not [file for file in before if now.get(file) != before[file]], what
        assert now.keys() == before.keys(), what
    signal.alarm(0)


@pytest.mark.parametrize("kind", ["byte", "other", "pipe"])
def test_a_fault_is_named_gives_nothing_wrong_and_is_mended(finished, kind):
    check_fault(finished, "process", kind, 1)


def test_a_pipe_in_the_place_of_an_empty_file_is_not_opened(tmp_path):
    """It has the size that was left, and reading it would never end."""
    (file := tmp_path / "empty").touch()
    seal(tmp_path, {})
    file.unlink()
    os.mkfifo(file)
    assert isochrome.verify(tmp_path).damaged == {"empty": "is no file"}


@pytest.fixture(autouse=True)
def _no_alarm_is_left():
    """One that a failed test has set would end the whole process."""
    yield
    signal.alarm(0)


@pytest.mark.long
@pytest.mark.parametrize(
    "name",  # the longest, and that of the default tests, are left to the study
    [pytest.param(n, marks=pytest.mark.study) if n in SLOW else n for n in COMMANDS],
)
def test_faults_of_every_command(finished, name):
    first = list(COMMANDS).index(name) % 4
    for kind in FAULTS[first::4]:
        check_fault(finished, name, kind, 2)


@pytest.mark.study
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("kind", FAULTS)
def test_a_thousand_faults(finished, name, kind):
    own = name in ("process", "track", "single", "campaign")  # the others compute all again
    for seed in range(100, 110):
        check_fault(finished, name, kind, seed, mend=own or seed < 102)


@pytest.mark.long
@pytest.mark.parametrize("name", ["process", "track"])
def test_a_flipped_bit_of_a_chunks_own_checksum_is_named(finished, name):
    folder = finished(name)  # of maps one by one; of several in whole steps
    chunk = next((folder / "run.zarr" / "fringe_order" / "c").iterdir()) / "0" / "0"
    data = chunk.read_bytes()
    chunk.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    file = chunk.relative_to(folder).as_posix()
    assert list(isochrome.verify(name).damaged) == [file]


@pytest.mark.long
def test_a_part_of_a_file_is_held_against_the_chunks_own_checksum(finished):
    folder = finished("track")  # of which a frame's map is a part of a file
    chunk = folder / "run.zarr" / "fringe_order" / "c" / "0" / "0" / "0"
    data = chunk.read_bytes()
    chunk.write_bytes(data[:10] + bytes([data[10] ^ 1]) + data[11:])
    with isochrome.open_run("track") as run, pytest.raises(ValueError, match="checksum"):
        run.fringe_order[0].values  # noqa: B018


@pytest.mark.long
def test_a_file_that_is_read_in_parts_is_summed_once(finished, monkeypatch):
    """A film's maps lie in one file: one read of it for each frame grew with their square."""
    finished("track")
    summed, own = [], integrity.file_sum
    monkeypatch.setattr(integrity, "file_sum", lambda path: summed.append(path) or own(path))
    with isochrome.open_run("track") as run:
        maps = [run.fringe_order[k].values for k in range(3)]
    assert np.isfinite(maps).any(axis=(1, 2)).all()
    assert len([path for path in summed if "fringe_order" in path.parts]) == 1


def test_a_store_that_is_read_without_an_event_loop_is_verified_too(finished):
    folder = finished("process")
    store, key = checked_store(folder / "run.zarr"), "fringe_order/c/0/0/0"
    chunk = folder / "run.zarr" / key
    assert store.get_sync(key).to_bytes() == chunk.read_bytes()
    assert store.get_sync("fringe_order/c/elsewhere") is None
    data = chunk.read_bytes()
    chunk.write_bytes(data[:10] + bytes([data[10] ^ 1]) + data[11:])
    with pytest.raises(InputError, match="its checksum is another"):
        store.get_sync(key)
    chunk.write_bytes(data[:-1])
    with pytest.raises(InputError, match="bytes, and"):
        store.get_sync(key, byte_range=RangeByteRequest(0, 4))


def test_what_is_damaged_is_computed_again_and_nothing_else(finished, monkeypatch):
    folder = finished("process")
    computed = []
    own = isochrome.processing.api.process_chunk
    monkeypatch.setattr(
        isochrome.processing.api,
        "process_chunk",
        lambda *span: computed.append(span[1:]) or own(*span),
    )
    chunks = sorted((folder / "run.zarr" / "fringe_order" / "c").iterdir())
    assert len(chunks) > 3
    (chunks[1] / "0" / "0").write_bytes(b"")
    (folder / "frames.csv").unlink()
    said = []
    isochrome.process("ring.tif", "ring.toml", "process", progress=said.append)
    assert computed == [(2, 4)]
    assert any("frames.csv is missing, and 1 more; that is made anew" in t.said for t in said)
    assert contents(folder) == contents(folder.with_name("process-kept"))
    computed.clear()
    assert isochrome.process("ring.tif", "ring.toml", "process").already and not computed


def test_results_of_an_earlier_version_open_and_say_that_they_cannot_be_verified(finished):
    folder = finished("process")
    file = folder / "provenance.json"
    record = json.loads(file.read_text("utf-8"))
    del record["outputs_crc32c"], record["record_crc32c"]
    file.write_text(json.dumps(record), "utf-8")
    with pytest.warns(UserWarning, match="earlier versions, and cannot be verified"):
        dataset = isochrome.open_run("process")
    dataset.close()
    verified = isochrome.verify("process")
    assert verified.ok and "cannot be verified" in verified.warnings[0]


def test_a_report_that_was_made_anew_or_removed_is_no_damage_to_what_reads_the_rest(finished):
    folder = finished("process")
    (folder / "report.html").unlink()
    isochrome.open_run("process").close()
    assert list(isochrome.verify("process").damaged) == ["report.html"]
    isochrome.report("process")
    assert isochrome.verify("process").ok


def test_a_folder_of_no_command_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"holds no provenance\.json"):
        isochrome.verify(tmp_path)
