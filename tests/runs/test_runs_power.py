"""What a power cut may leave: bytes reach the disk before their names, and all before "finished".

The calls that put something through to the disk, and those that give names, are recorded in order
where they leave Python. Each test names the call without which it fails.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import pytest

from isochrome.runs import run_job
from runs.counting import Count, finish, job

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/fd").is_dir(), reason="needs /proc to say of which file a handle is"
)


@dataclass(frozen=True)
class Call:
    """`place` was put through to the disk, or, of a rename, is the new name of `source`.

    `missing`, what of the working folder was not on the disk then, as it was; `finished`, whether
    the run called itself finished.
    """

    place: Path
    source: Path | None
    missing: frozenset
    finished: bool


class Disk:
    """The calls of a run on OUT, and what they have put through to the disk."""

    def __init__(self, out):
        self.out, self.root, self.calls, self.safe = out, Path(f"{out}.partial"), [], {}

    def note(self, place, source=None):
        missing = frozenset(p for p in self.root.rglob("*") if self.safe.get(p) != now(p))
        finished = (self.root / "finished").exists()
        self.calls.append(Call(Path(place), source and Path(source), missing, finished))

    def named(self, ending):
        """The calls that gave a name that ends so."""
        return [c for c in self.calls if c.source and c.place.as_posix().endswith(ending)]


def now(place):
    """The bytes of a file, or the names in a folder; None where another thread has moved it on."""
    try:
        return sorted(os.listdir(place)) if place.is_dir() else place.read_bytes()
    except FileNotFoundError:
        return None


def noting(disk, rename):
    """A rename that is noted before it is done."""

    def give(source, target):
        disk.note(target, source)
        rename(source, target)
        disk.safe[Path(target)] = disk.safe.get(Path(source))

    return give


def recorded(folder, there):
    """A run of four chunks on an output folder that is there, holding results, or is not."""
    found, sync = Disk(folder / "out"), os.fsync
    if there:
        found.out.mkdir()
        (found.out / "provenance.json").write_text('{"outputs": {}}', "utf-8")

    def fsync(handle):
        sync(handle)
        place = Path(os.readlink(f"/proc/self/fd/{handle}"))
        found.safe[place] = now(place)
        found.note(place)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", fsync)
        patch.setattr(os, "rename", noting(found, os.rename))
        patch.setattr(os, "replace", noting(found, os.replace))
        (folder / "notes").mkdir()
        run_job(job(Count(folder / "notes")), found.out, finish)
    return found


@pytest.fixture(scope="module")
def disk(tmp_path_factory):
    """What a run did that found no output folder."""
    return recorded(tmp_path_factory.mktemp("new"), there=False)


@pytest.fixture(scope="module")
def used(tmp_path_factory):
    """What a run did whose output folder held the results of another."""
    return recorded(tmp_path_factory.mktemp("used"), there=True)


WRITTEN = [
    "manifest.json", "finished", *(f"records/{k:08d}.json" for k in range(4)),
    *(f"records/{k:08d}-lines.txt" for k in range(4)),
    *(f"run.zarr/order/c/{k}/0/0" for k in range(4)),
]  # fmt: skip
"""What a run of four chunks writes down for the time after a power cut."""


@pytest.mark.parametrize("name", WRITTEN)
def test_a_file_is_on_the_disk_before_its_name_and_its_name_before_the_next(disk, name):
    """Without fsync of the file, or of its folder after the rename."""
    (call,) = disk.named(f"/{name}")
    assert call.source not in call.missing
    after = disk.calls[disk.calls.index(call) + 1]
    assert (after.place, after.source) == (call.place.parent, None)


def test_a_chunks_record_comes_after_its_pictures(disk):
    """Without fsync of the store's chunk."""
    records = [call for call in disk.named(".json") if call.place.parent.name == "records"]
    assert len(records) == 4
    for call in records:
        assert not [p for p in call.missing if "order" in p.parts and p.is_file()]


def test_what_chunks_are_put_into_is_on_the_disk_before_the_manifest(disk):
    """Without the sync of the whole working folder that was laid out."""
    (manifest,) = disk.named("/manifest.json")
    assert not [p for p in manifest.missing if p.parent != disk.root or p.is_dir()]


@pytest.mark.parametrize("which", ["disk", "used"])
def test_all_results_are_on_the_disk_before_the_run_is_finished(request, which):
    """Without the sync of all results, or of the folder that they are put into."""
    disk = request.getfixturevalue(which)
    (finished,) = disk.named("/finished")
    assert not [p for p in finished.missing if "results-" in str(p.relative_to(disk.root))]
    placed = [c for c in disk.calls if c.source and disk.out in (c.place, c.place.parent)]
    assert placed and all(call.finished for call in placed)
    own, above = disk.calls[disk.calls.index(placed[-1]) + 1 :]
    # the mark that says so goes after both
    assert (own.place, above.place) == (disk.out, disk.out.parent) and above.finished
    assert disk.safe[disk.out] == now(disk.out) and "out" in disk.safe[disk.out.parent]


def test_in_a_folder_that_is_there_the_record_of_all_takes_its_place_last(used):
    placed = [c.place.name for c in used.calls if c.source and c.place.parent == used.out]
    # first one that says whose the files are, should the run be killed there
    assert placed[0] == placed[-1] == "provenance.json"
    assert sorted(placed[1:-1]) == ["lines.txt", "order.tif", "records", "rows.json", "run.zarr"]
