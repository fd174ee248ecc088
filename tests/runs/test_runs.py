"""A long run leaves all results or none, goes on where it was, and knows what it is a run of."""

import json
import os
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import tifffile

from isochrome.errors import InputError, PhysicsError
from isochrome.frames import open_tiff
from isochrome.runs import RunOptions, Stopped, open_run, run_job
from runs.counting import IDENTITY, Count, calls, computed_again, contents, finish, job, put, truth
from runs.killing import NO_END_S

FILES = IDENTITY["inputs_sha256"]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The files of a run that nothing happened to."""
    place = tmp_path_factory.mktemp("undisturbed")
    run_job(job(Count(place)), place / "out", finish)
    return contents(place / "out")


def stopped(tmp_path, count, at=7, chunk=3, kept=6, **keys):
    """A run that is stopped at the keyboard while it computes an item."""
    switch = tmp_path / "switch"
    switch.touch()
    work = replace(count, fail_at=at, switch=switch)
    words = rf"stopped; {kept} of 10 are finished and kept in .*out\.partial"
    with pytest.raises(Stopped, match=words):
        run_job(job(work, 10, chunk), tmp_path / "out", finish, **keys)
    switch.unlink()
    return work


def test_results_are_those_of_the_items_in_order(count, tmp_path):
    done = []
    found = run_job(job(count), tmp_path / "out", finish, progress=done.append)
    assert [row["frame"] for row in found] == list(range(10))
    assert [row["third"] for row in found] == [i / 3 for i in range(10)]  # to the last bit
    pictures = np.stack([truth(i) for i in range(10)])
    with open_run(tmp_path / "out") as dataset:
        assert dataset.order.dims == ("frame", "row", "col")
        assert dataset.order.attrs == {"units": "1", "long_name": "fringe order"}
        np.testing.assert_array_equal(dataset.order.values, pictures)
        np.testing.assert_array_equal(dataset.order[7].values, truth(7))
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "out" / "order.tif"), pictures)
    assert open_tiff(tmp_path / "out" / "order.tif").pixel_mm == pytest.approx(0.01, rel=1e-6)
    assert (tmp_path / "out" / "lines.txt").read_text() == "1\n3\n5\n7\n9\n"
    assert [(t.done, t.count, t.before) for t in done] == [
        (0, 10, 0), (3, 10, 0), (6, 10, 0), (9, 10, 0), (10, 10, 0),
    ]  # fmt: skip
    assert done[-1].flagged == 1
    assert not (tmp_path / "out.partial").exists()


@pytest.mark.parametrize(("count_of", "chunk"), [(10, 4), (9, 2), (3, 8)])
def test_pictures_of_some_items_have_an_axis_of_their_own(notes, tmp_path, count_of, chunk):
    found = run_job(job(Count(notes, every=2), count_of, chunk), tmp_path / "out", finish)
    assert [row["frame"] for row in found] == list(range(count_of))
    pictures = np.stack([truth(i) for i in range(0, count_of, 2)])
    with open_run(tmp_path / "out") as dataset:
        assert dataset.order.dims == ("key_frame", "row", "col")
        np.testing.assert_array_equal(dataset.order.values, pictures)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "out" / "order.tif"), pictures)


def test_pictures_of_some_items_are_looked_at_when_a_run_goes_on(notes, tmp_path):
    whole = job(Count(notes, every=2), 10, 4)
    run_job(whole, tmp_path / "whole", finish)
    stopped(tmp_path, Count(notes, every=2), at=9, chunk=4, kept=8)
    (store,) = (tmp_path / "out.partial").glob("results-*/run.zarr/order/c/1/0/0")
    data = bytearray(store.read_bytes())
    at = data.find(truth(6).tobytes())  # the second picture of the second chunk
    data[at] ^= 1
    store.write_bytes(data)
    for note in notes.iterdir():
        note.unlink()
    run_job(job(Count(notes, every=2), 10, 4), tmp_path / "out", finish)
    assert calls(notes) == [4, 8]
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_a_stopped_run_goes_on_and_ends_with_the_same_bytes(undisturbed, count, tmp_path):
    stopped(tmp_path, count)
    assert not (tmp_path / "out").exists()
    assert calls(count.notes) == [0, 3, 6]
    done = []
    run_job(job(count), tmp_path / "out", finish, progress=done.append)
    assert calls(count.notes) == [0, 3, 6, 6, 9]  # no finished chunk was computed again
    assert (done[0].before, done[0].done) == (6, 6)
    assert contents(tmp_path / "out") == undisturbed
    assert not (tmp_path / "out.partial").exists()


def test_a_complete_run_is_not_computed_again(undisturbed, count, tmp_path):
    out = tmp_path / "out"
    assert run_job(job(count), out, finish) is not None
    assert run_job(job(count), out, finish) is None
    assert calls(count.notes) == [0, 3, 6, 9]
    (out / "rows.json").write_text("[]", "utf-8")  # no longer what the run left
    assert run_job(job(count), out, finish) is not None
    assert calls(count.notes) == [0, 3, 6, 9]  # it is made of the chunks, which are whole
    assert run_job(job(count), out, finish, options=RunOptions(restart=True)) is not None
    assert calls(count.notes) == sorted(2 * [0, 3, 6, 9])
    assert contents(out) == undisturbed


@pytest.mark.parametrize(
    ("what", "how"),
    [
        (what, how)
        for what in ("order/c/1/0/0", "00000001.json", "lines")
        for how in ("flipped", "cut", "gone")
    ],
)
def test_a_damaged_chunk_is_computed_again_and_no_other(undisturbed, count, tmp_path, what, how):
    stopped(tmp_path, count)
    root = tmp_path / "out.partial"
    name = "00000001-lines.txt" if what == "lines" else what
    (file,) = [f for f in root.rglob("*") if f.as_posix().endswith(name)]
    data = bytearray(file.read_bytes())
    at = len(data) // 2
    data[at] ^= 0x10
    if how == "gone":
        file.unlink()
    else:
        file.write_bytes(data if how == "flipped" else data[:at])
    run_job(job(count), tmp_path / "out", finish)
    assert calls(count.notes) == sorted([0, 3, 6, 3, 6, 9])
    assert contents(tmp_path / "out") == undisturbed


def test_what_a_killed_writer_left_is_cleared_up(undisturbed, count, tmp_path):
    stopped(tmp_path, count)
    (results,) = (tmp_path / "out.partial").glob("results-*")
    for name in (".rows-12ab.json", "run.zarr/order/c/2/0/.0.99.part", "run.zarr/chi/c/0"):
        (results / name).parent.mkdir(parents=True, exist_ok=True)
        (results / name).write_bytes(b"half")
    (results / "run.zarr" / "zarr.json").write_bytes(b"{half")
    run_job(job(count), tmp_path / "out", finish)
    assert contents(tmp_path / "out") == undisturbed


def test_a_run_killed_before_its_manifest_begins_anew(undisturbed, count, tmp_path):
    stopped(tmp_path, count)
    manifest = tmp_path / "out.partial" / "manifest.json"
    manifest.write_bytes(manifest.read_bytes()[:-4])
    run_job(job(count), tmp_path / "out", finish)
    assert contents(tmp_path / "out") == undisturbed


@pytest.mark.parametrize("scene", ["a = 1\nb = 2\n", "a = 1\nb = 3\n"])
def test_a_flipped_byte_in_the_manifest_is_noticed_when_a_run_goes_on(count, tmp_path, scene):
    """One bit makes it the manifest of a run of another scene, whose chunks these are not; and the
    run's own scene would be refused, as one that has changed."""
    stopped(tmp_path, count)
    manifest = tmp_path / "out.partial" / "manifest.json"
    flipped = manifest.read_bytes().replace(b"b = 2", b"b = 3")
    assert flipped != manifest.read_bytes()
    manifest.write_bytes(flipped)
    run_job(job(count, identity=IDENTITY | {"scene": scene}), tmp_path / "out", finish)
    assert calls(count.notes) == sorted([0, 3, 6, 0, 3, 6, 9])


class Death:
    """The end of a process at the rename to "finished", or at the one so many `after` it."""

    def __init__(self, patch, after):
        self.left = None  # renames until then, not known before "finished"
        for name in ("rename", "replace"):
            patch.setattr(os, name, self.counting(getattr(os, name), after))

    def counting(self, rename, after):
        def act(source, target):
            if os.path.basename(target) == "finished":
                self.left = after
            if self.left == 0:
                raise KeyboardInterrupt
            rename(source, target)
            if self.left is not None:
                self.left -= 1

        return act


@pytest.mark.parametrize(
    ("existing", "at"), [*((False, at) for at in range(3)), *((True, at) for at in range(10))]
)
def test_killed_while_results_take_their_place_it_goes_on(
    undisturbed, count, tmp_path, monkeypatch, existing, at
):
    """Every rename of the publication in turn is the first that is not done."""
    out = tmp_path / "out"
    if existing:
        out.mkdir()
        (out / "mine.txt").write_text("mine", "utf-8")
        (out / "run.zarr").mkdir()
        (out / "run.zarr" / "old").write_text("old", "utf-8")
        (out / "provenance.json").write_text('{"outputs": {"old.csv": 3}}', "utf-8")
        (out / "old.csv").write_text("old", "utf-8")
    survived = True
    with monkeypatch.context() as patch:
        Death(patch, at)
        try:
            run_job(job(count), out, finish)
        except Stopped:
            survived = False
    assert survived == (at == (9 if existing else 2))
    run_job(job(count), out, finish)
    assert calls(count.notes) == [0, 3, 6, 9]  # nothing is computed twice
    found = contents(out)
    if existing:
        assert found.pop("mine.txt") == b"mine"
    assert found == undisturbed
    assert not (tmp_path / "out.partial").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scene": "a = 1\nb = 3\n"}, r"the scene \('b = 2' is now 'b = 3'\) has changed"),
        ({"scene": "a = 1\n"}, r"the scene \('b = 2' is no longer there\)"),
        ({"inputs_sha256": FILES | {"film.avi": "01"}}, r"the content of film\.avi has changed"),
        ({"inputs_sha256": {"other.avi": "00", "dark.tif": "11"}},
         r"the input files \(film\.avi, other\.avi\)"),
        ({"inputs_sha256": dict(reversed(FILES.items()))}, r"the input files \(their order\)"),
        ({"options": {"rois": True}}, r"the options \(rois: False, now True\)"),
        ({"isochrome": "2"}, r"Isochrome's version \(1, now 2\)"),
        ({"seed": 2}, r"the seed \(1, now 2\)"),
        ({"code_sha256": 64 * "1"}, r"Isochrome's own code \(its files\)"),
        ({"libraries": {"python": "3", "numpy": "2.1"}},
         r"the version of Python or a library \(numpy: 2, now 2\.1\)"),
    ],
)  # fmt: skip
def test_an_unfinished_run_of_something_else_is_refused(count, tmp_path, change, words):
    stopped(tmp_path, count)
    before = contents(tmp_path / "out.partial")
    other = job(count, identity=IDENTITY | change)
    with pytest.raises(InputError, match=f"out.partial: .*{words}.*--restart"):
        run_job(other, tmp_path / "out", finish)
    assert contents(tmp_path / "out.partial") == before
    run_job(other, tmp_path / "out", finish, options=RunOptions(restart=True))
    assert calls(count.notes) == sorted([0, 3, 6, 0, 3, 6, 9])


def test_the_same_files_in_another_folder_are_the_same_input(count, tmp_path):
    stopped(tmp_path, count)
    elsewhere = {f"elsewhere/{name}": value for name, value in FILES.items()}
    moved = IDENTITY | {"inputs_sha256": elsewhere}
    run_job(job(count, identity=moved), tmp_path / "out", finish)
    assert calls(count.notes) == [0, 3, 6, 6, 9]


HOLD = """
import sys
from isochrome.runs.execution import locked
from pathlib import Path
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_two_runs_on_one_output_are_refused_until_the_first_is_dead(count, tmp_path):
    root = tmp_path / "out.partial"
    other = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(root)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        assert other.stdout.readline() == b"held\n"
        words = rf"out\.partial: another run is at work there \(process {other.pid} on "
        with pytest.raises(InputError, match=words):
            run_job(job(count), tmp_path / "out", finish)
    finally:
        other.kill()
        other.wait()
        other.stdin.close()
        other.stdout.close()
    assert run_job(job(count), tmp_path / "out", finish) is not None
    assert not root.exists()


@pytest.mark.parametrize(
    ("failure", "seconds", "kept"),
    [(InputError, 57.0, False), (PhysicsError, 57.0, False), (InputError, 63.0, True)],
)
def test_a_refusal_after_long_work_keeps_it_and_says_so(
    notes, tmp_path, monkeypatch, failure, seconds, kept
):
    """From a minute on, by a clock that the third chunk puts on."""
    (tmp_path / "switch").touch()
    work = Count(notes, fail_at=7, failure=failure, switch=tmp_path / "switch")
    clock, ahead = time.perf_counter, [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock() + ahead[0])

    def watch(tally):
        ahead[0] = seconds * (tally.done >= 3)

    said = r" \(6 of 10 are finished and kept in " if kept else "$"
    with pytest.raises(failure, match=rf"^item 7 is bad{said}"):
        run_job(job(work), tmp_path / "out", finish, progress=watch)
    left = {"notes", "switch", *(["out.partial"] * kept)}
    assert {p.name for p in tmp_path.iterdir()} == left
    (tmp_path / "switch").unlink()
    run_job(job(work), tmp_path / "out", finish)
    assert calls(notes) == sorted([0, 3, 6, 6, 9] + [0, 3] * (not kept))


FULL = """
import resource, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from isochrome.errors import InputError
from isochrome.runs import run_job
from runs.counting import Count, finish, job
import signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
big = job(Count(Path(sys.argv[2])), count=60, chunk=3)
limit = int(sys.argv[4])
def watch(tally):
    if tally.done >= 30:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
try:
    run_job(big, sys.argv[1], finish, progress=watch)
except InputError as error:
    print(error)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size there")
def test_a_full_disk_is_said_and_what_is_finished_is_kept(notes, tmp_path):
    """The system itself refuses to let a file grow, as it does where the disk is full."""
    from pathlib import Path

    tests = str(Path(__file__).parents[1])
    out = tmp_path / "out"
    command = [sys.executable, "-c", FULL, str(out), str(notes), tests]
    # a chunk of three pictures takes 424 bytes
    done = subprocess.run([*command, "300"], capture_output=True, text=True, timeout=NO_END_S)
    assert done.stderr == ""
    assert "out.partial: cannot be written (" in done.stdout
    assert "of 60 are finished and kept there: make room" in done.stdout
    assert not out.exists()
    before = len(calls(notes))
    assert 10 <= before < 20
    done = subprocess.run([*command, "-1"], capture_output=True, text=True, timeout=NO_END_S)
    assert (done.stdout, done.stderr) == ("", "")
    assert 1 <= computed_again(notes, 20) <= 2  # those that were being written
    np.testing.assert_array_equal(tifffile.imread(out / "order.tif")[59], truth(59))


def test_results_that_the_disk_cannot_hold_are_refused_before_the_work(count, tmp_path):
    # 3e13 items of 5 x 7 pixels, in the store and in the stack, 4 bytes each: 8.4e15 bytes
    huge = job(count, count=30_000_000_000_000, chunk=3_000_000_000_000)
    words = r"out: the results need 8\.4e\+06 GB, and .* GB are free"
    with pytest.raises(InputError, match=words):
        run_job(huge, tmp_path / "out", finish)
    assert calls(count.notes) == []
    assert not (tmp_path / "out.partial").exists()


def test_links_in_the_output_folder_are_replaced_and_not_followed(count, tmp_path, undisturbed):
    out, other = tmp_path / "out", tmp_path / "other"
    out.mkdir()
    other.mkdir()
    (other / "precious.txt").write_text("precious", "utf-8")
    try:
        (out / "rows.json").symlink_to(other / "precious.txt")
        (out / "run.zarr").symlink_to(other, target_is_directory=True)
    except OSError:
        pytest.skip("no symbolic links here")
    run_job(job(count), out, finish)
    assert contents(out) == undisturbed
    assert contents(other) == {"precious.txt": b"precious"}
    (tmp_path / "next.partial").symlink_to(other, target_is_directory=True)
    with pytest.raises(InputError, match="is a symbolic link"):
        run_job(job(count), tmp_path / "next", finish)
    assert contents(other) == {"precious.txt": b"precious"}


def test_places_that_are_no_output_folder_are_refused(count, tmp_path):
    (tmp_path / "file").write_text("mine", "utf-8")
    with pytest.raises(InputError, match="is a file, not a folder"):
        run_job(job(count), tmp_path / "file", finish)
    with pytest.raises(InputError, match="top of a drive"):
        run_job(job(count), tmp_path.anchor, finish)
    with pytest.raises(InputError, match="cannot be written there"):
        run_job(job(count), tmp_path / "file" / "below", finish)
    assert calls(count.notes) == []


def test_the_record_names_what_the_results_are_of(count, tmp_path):
    run_job(job(count), tmp_path / "out", finish)
    record = json.loads((tmp_path / "out" / "provenance.json").read_text("utf-8"))
    sizes, sums, own = (record.pop(k) for k in ("outputs", "outputs_crc32c", "record_crc32c"))
    assert record == IDENTITY and len(own) == 8
    found = {n: data for n, data in contents(tmp_path / "out").items() if data is not None}
    del found["provenance.json"]
    assert sizes == {name: len(data) for name, data in found.items()}
    assert {"order.tif", "run.zarr/order/c/3/0/0", "records/00000003.json"} <= set(sizes)
    # of a chunk of the store, what it ends with by zarr's own codec
    ends = {
        n: data[-4:][::-1].hex() for n, data in found.items() if n.startswith("run.zarr/order/c")
    }
    assert len(ends) == 4 and all(sums[name] == end for name, end in ends.items())
    rest = {n: f"{crc32c_by_table(data):08x}" for n, data in found.items() if n not in ends}
    assert {name: sums[name] for name in rest} == rest
    assert crc32c_by_table(bytes(32)) == 0x8A9136AA  # RFC 3720, appendix B.4


def crc32c_by_table(data):
    """CRC-32C bit by bit."""
    found = 0xFFFFFFFF
    for byte in data:
        found ^= byte
        for _ in range(8):
            found = found >> 1 ^ (0x82F63B78 if found & 1 else 0)
    return found ^ 0xFFFFFFFF


def test_an_unfinished_run_cannot_be_opened_as_a_result(count, tmp_path):
    stopped(tmp_path, count)
    with pytest.raises(InputError, match="the run is not finished"):
        open_run(tmp_path / "out")
    with pytest.raises(InputError, match=r"holds no run\.zarr; name a folder"):
        open_run(tmp_path)


@pytest.mark.parametrize(
    ("of", "part"),
    [
        *(
            ("order/zarr.json", part)
            for part in (b'"shape"', b'"fill_value"', b'"zarr_format"', b'"node_type"', b"3,")
        ),
        *(("zarr.json", part) for part in (b"3,", b"{")),
    ],
)
def test_a_flipped_byte_in_what_describes_the_results_is_noticed_on_opening(
    undisturbed, tmp_path, of, part
):
    """Without it, pictures would be missing from a dataset that opens in silence."""
    put(tmp_path / "out", undisturbed)
    file = tmp_path / "out" / "run.zarr" / of
    text = bytearray(file.read_bytes())
    text[text.index(part) + len(part) // 2] ^= 1
    file.write_bytes(text)
    with pytest.raises(InputError, match=rf"run\.zarr/{of}: is damaged: .* run the command"):
        open_run(tmp_path / "out")


@pytest.mark.filterwarnings("ignore::zarr.errors.ZarrUserWarning")  # of a file that is no array
def test_pictures_are_missed_whose_description_is_damaged_in_a_store_without_its_results(
    undisturbed, tmp_path
):
    """No checksum tells it there, and zarr leaves out what it cannot read."""
    put(tmp_path / "out", undisturbed)
    (tmp_path / "out" / "provenance.json").unlink()
    file = tmp_path / "out" / "run.zarr" / "order" / "zarr.json"
    file.write_bytes(file.read_bytes().replace(b"data_type", b"eata_type"))
    said = pytest.raises(InputError, match=r"run\.zarr: order cannot be read; run the command")
    with pytest.warns(UserWarning, match="cannot be verified"), said:
        open_run(tmp_path / "out" / "run.zarr")
