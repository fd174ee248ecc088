"""What a run that goes on may take over, and what it must not; input that is left alone."""

import os
from concurrent import futures

import numpy as np
import pytest

from isochrome import runs
from isochrome.errors import InputError
from runs.counting import IDENTITY, Count, calls, contents, finish, job
from runs.test_runs import stopped


@pytest.mark.parametrize(("keep_going", "again"), [(True, [6, 9]), (False, [0, 6, 9])])
def test_failed_items_are_kept_for_those_alone_who_ask_to_keep_going(
    notes, tmp_path, keep_going, again
):
    """To the others the failure is to be said, as it is in a run that was not stopped."""
    work = stopped(tmp_path, Count(notes, failed=1), options=runs.RunOptions(keep_going=True))
    runs.run_job(
        job(work), tmp_path / "out", finish, options=runs.RunOptions(keep_going=keep_going)
    )
    assert calls(notes) == sorted([0, 3, 6, *again])


def test_results_laid_out_otherwise_are_another_run(count, tmp_path):
    stopped(tmp_path, count)
    before = contents(tmp_path / "out.partial")
    with pytest.raises(InputError, match=r"the layout of the results has changed; undo that"):
        runs.run_job(job(count, chunk=4), tmp_path / "out", finish)
    with pytest.raises(InputError, match=r"the layout of the results has changed; undo that"):
        runs.run_job(job(count, count=11), tmp_path / "out", finish)
    assert contents(tmp_path / "out.partial") == before


@pytest.mark.parametrize("how", ["rewritten", "longer"])
def test_input_that_changes_while_it_is_read_gives_no_results(count, tmp_path, how):
    """Rewritten, it has as many bytes as before."""
    film = tmp_path / "film.avi"
    film.write_bytes(b"before")
    of_film = job(count, identity=IDENTITY | {"inputs_sha256": {str(film): "00"}})

    def change(tally):
        if tally.done == 3:
            film.write_bytes(b"change" if how == "rewritten" else b"and more")
            os.utime(film, (2e9, 2e9))  # a clock of coarse ticks would hide it

    with pytest.raises(InputError, match=r"film\.avi: changed while it was read"):
        runs.run_job(of_film, tmp_path / "out", finish, progress=change)
    assert not (tmp_path / "out").exists()


def test_results_are_not_put_among_the_input(count, tmp_path):
    (tmp_path / "own").mkdir()
    film = tmp_path / "own" / "film.avi"
    film.write_bytes(b"film")
    of_film = job(count, identity=IDENTITY | {"inputs_sha256": {str(film): "00"}})
    with pytest.raises(InputError, match=r"film\.avi: lies in the folder .*own, where the results"):
        runs.run_job(of_film, tmp_path / "own", finish)
    assert calls(count.notes) == [] and list((tmp_path / "own").iterdir()) == [film]
    runs.run_job(of_film, tmp_path / "own" / "below", finish)  # which a folder of its own is not


def test_a_lock_whose_owner_cannot_be_noted_is_open_again(count, tmp_path):
    (tmp_path / "out.partial" / "owner.txt").mkdir(parents=True)
    with pytest.raises(InputError, match=r"results cannot be written there") as refused:
        runs.run_job(job(count), tmp_path / "out", finish)
    (tmp_path / "out.partial" / "owner.txt").rmdir()
    runs.run_job(job(count), tmp_path / "out", finish)  # while somebody still holds the refusal
    assert refused.value is not None


def test_workers_that_are_lost_leave_what_is_finished_however_soon(notes, tmp_path):
    """It may have been memory, of which the same work takes as much again: that is not undone."""
    (tmp_path / "switch").touch()
    work = Count(notes, fail_at=7, failure=runs.WorkersLost, switch=tmp_path / "switch")
    with pytest.raises(runs.WorkersLost, match=r"\(6 of 10 are finished and kept in "):
        runs.run_job(job(work), tmp_path / "out", finish)
    (tmp_path / "switch").unlink()
    runs.run_job(job(work), tmp_path / "out", finish)
    assert calls(notes) == [0, 3, 6, 6, 9]


def test_another_run_may_replace_what_one_that_was_killed_had_placed(count, tmp_path, monkeypatch):
    """The record that it leaves for that time names them, for nobody else's are replaced."""
    out = tmp_path / "out"
    out.mkdir()
    rename = os.replace

    def dying(source, target):
        if target == out / "provenance.json" and "results-" in str(source):
            raise KeyboardInterrupt  # the last of all: the others have their places
        rename(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", dying)
        with pytest.raises(runs.Stopped):
            runs.run_job(job(count), out, finish)
    assert (out / "rows.json").exists()
    other = job(count, identity=IDENTITY | {"seed": 2})
    runs.run_job(other, out, finish, options=runs.RunOptions(restart=True))
    runs.run_job(other, tmp_path / "alone", finish)
    assert contents(out) == contents(tmp_path / "alone")


def test_pictures_beyond_the_last_are_not_known(count, tmp_path):
    """Should somebody make the array longer, as zarr lets them."""
    import zarr

    runs.run_job(job(count), tmp_path / "out", finish)
    store = (tmp_path / "out" / "run.zarr").rename(tmp_path / "run.zarr")
    zarr.open_group(store)["order"].resize((12, 5, 7))
    with pytest.warns(UserWarning, match="cannot be verified"):
        dataset = runs.open_run(store)
    with dataset:
        known = np.isfinite(dataset.order.values).all(axis=(1, 2))
    assert known.tolist() == 10 * [True] + 2 * [False]


@pytest.mark.parametrize(
    ("count", "item_bytes", "size"),
    [
        (1000, 4, 32),  # what a crash may cost
        (1000, 1_000_000, 24),  # 24 MB of a layer
        (1000, 10_000_000, 2),
        (1000, 10**9, 1),
        (80, 4, 10),  # eight chunks at least, for several workers
        (81, 4, 11),
        (3, 4, 1),
    ],
)
def test_a_chunk_is_bounded_by_items_by_bytes_and_by_its_share(count, item_bytes, size):
    assert runs.chunk_size(count, item_bytes) == size


def test_no_more_is_given_out_than_asked_for_however_long_the_run():
    """Results that nobody has taken yet lie in memory."""
    given, taken, most = [], [], 0

    def submit(index):
        given.append(index)
        done = futures.Future()
        done.set_result(-index)
        return done

    for index, result in runs.in_flight(submit, range(1000), 4):
        taken.append(index)
        assert result == -index
        most = max(most, len(given) - len(taken))
    assert sorted(taken) == list(range(1000)) and most == 3
