"""`fit` as a long run: killed, stopped, with workers; what nothing ties together stands alone."""

import tracemalloc

import numpy as np
import pytest
import tifffile

from isochrome import fitting, open_run
from isochrome.errors import InputError
from isochrome.output import read_csv, write_tiff
from isochrome.runs import Stopped
from isochrome.scene import dump_scene, parse_scene
from isochrome.simulation import simulate
from runs.counting import contents
from runs.killing import killed_and_begun_again, needs_sigkill, start
from scene_texts import PAPER_CONTACT, SMALL_CAMERA

LOAD, LEFT = "load.normal_n", "camera.left_mm"
COUNT = 3
SMALL = {"camera.width_px": 128, "camera.height_px": 96, "camera.pixel_mm": 0.031}
SCENE = parse_scene(PAPER_CONTACT + SMALL_CAMERA + "noise_grey = 3.0\n").with_values(SMALL)


def load_of(index):
    return 44.0 + 0.7 * np.sin(index)


def make_set(folder, count):
    """A stack of a contact whose load differs from frame to frame, each with noise of its own."""
    frames = [
        simulate(SCENE.with_values({LOAD: load_of(i), "camera.seed": i})).frames[0]
        for i in range(count)
    ]
    write_tiff(folder / "film.tif", np.stack(frames), pixel_mm=0.031)
    (folder / "scene.toml").write_text(dump_scene(SCENE), "utf-8")
    return folder


@pytest.fixture
def place(tmp_path):
    return make_set(tmp_path, COUNT)


def fitted(place, out, **options):
    keys = {"per_frame": (LOAD, LEFT)} | options
    return fitting.fit(
        place / "film.tif", place / "scene.toml", keys.pop("free", ()), out=out, **keys
    )


@pytest.mark.long
def test_frames_that_share_nothing_are_fitted_as_each_is_alone_and_given_again(tmp_path):
    place = make_set(tmp_path, 2)
    found = fitted(place, tmp_path / "out")
    assert found.chi == pytest.approx(1.0, abs=0.03) and found.warnings == ()
    for i, own in enumerate(found.frames):
        true = {LOAD: load_of(i), LEFT: -2.0}
        for key, value in true.items():
            # five of its own standard uncertainties: one of a million fits is off by more
            assert abs(own[key]["value"] - value) < 5.0 * own[key]["standard_uncertainty"]
    with open_run(tmp_path / "out") as dataset:
        load = dataset.load_normal_n
        assert load.dims == ("frame",) and load.attrs["units"] == "N"
        assert load.values.tolist() == [own[LOAD]["value"] for own in found.frames]
        assert dataset.chi.values.tolist() == found.frame_chi
        assert "film.tif" in dataset.attrs["inputs_sha256"]
    table = read_csv(tmp_path / "out" / "fit.csv")
    assert table["key"] == [LOAD, LEFT] * 2
    for frame, key, value in zip(table["frame"], table["key"], table["value"], strict=True):
        # nine digits in a table
        assert value == pytest.approx(found.frames[int(frame)][key]["value"], rel=1e-8)
    before = contents(tmp_path / "out")
    again = fitted(place, tmp_path / "out")
    assert again.already and not found.already
    assert (again.to_json(), again.columns) == (found.to_json(), found.columns)
    assert again.scene == found.scene and contents(tmp_path / "out") == before
    anew = fitted(place, tmp_path / "out", restart=True)
    assert not anew.already and contents(tmp_path / "out") == before


@pytest.mark.long
def test_a_frames_fit_does_not_depend_on_those_beside_it(tmp_path):
    place = make_set(tmp_path, 2)
    both = fitted(place, None)
    frames = tifffile.imread(place / "film.tif")
    write_tiff(place / "film.tif", frames[::-1], pixel_mm=0.031)
    turned = fitted(place, None)
    assert turned.frames == both.frames[::-1] and turned.frame_chi == both.frame_chi[::-1]
    write_tiff(place / "film.tif", frames[1:], pixel_mm=0.031)
    assert fitted(place, None).frames == both.frames[1:]


def test_workers_and_clusters_need_a_folder_and_frames_of_their_own(place):
    with pytest.raises(InputError, match="give out"):
        fitted(place, None, workers=2)
    with pytest.raises(InputError, match=r"looked for from the one before.*leave them out"):
        fitted(place, place / "out", follow=True, workers=2)


def stopped(place, out="out", at=1, **options):
    """A fit that is stopped at the keyboard when so many frames are finished."""

    def stop(tally):
        if tally.done == at:
            raise KeyboardInterrupt

    with pytest.raises(
        Stopped, match=rf"{at} of {COUNT} are finished and kept in .*{out}\.partial"
    ):
        fitted(place, place / out, progress=stop, **options)


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [
        {"free": (LOAD,), "per_frame": (LEFT,)},
        *(pytest.param(each, marks=pytest.mark.study) for each in ({}, {"follow": True})),
    ],
)
def test_a_stopped_fit_goes_on_and_ends_with_the_same_bytes(place, options):
    fitted(place, place / "whole", **options)
    stopped(place, **options)
    assert not (place / "out").exists()
    told = []
    fitted(place, place / "out", progress=told.append, **options)
    assert told[0].before == 1
    assert contents(place / "out") == contents(place / "whole")
    assert not (place / "out.partial").exists()


@pytest.mark.study
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_workers_and_a_cluster_leave_the_same_files(place, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="needs isochrome[cluster]")
    monkeypatch.chdir(place)
    for options in ({}, {"free": (LOAD,), "per_frame": (LEFT,)}):
        out = f"joint-{len(options)}"
        fitted(place, place / out, **options)
        fitted(place, place / f"{out}-two", workers=2, **options)
        assert contents(place / f"{out}-two") == contents(place / out)
    fitting.fit("film.tif", "scene.toml", (), per_frame=(LOAD,), out="one")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        fitting.fit("film.tif", "scene.toml", (), per_frame=(LOAD,), out="two", cluster=address)
    assert contents(place / "two") == contents(place / "one")


@pytest.mark.study
@needs_sigkill
@pytest.mark.parametrize("workers", ["1", "2"])
def test_killed_at_random_moments_it_ends_with_the_same_bytes(tmp_path, code, workers):
    place = make_set(tmp_path, 16)

    def begin(out):
        return start(
            place, code, "-m", "isochrome", "fit", "film.tif", "--scene", "scene.toml",
            "--per-frame", LOAD, "--out", out, "--workers", workers,
        )  # fmt: skip

    alternately = [False, True]
    kept = killed_and_begun_again(begin, place, alternately, since=0.3, seed=int(workers))
    assert kept > 0  # else nothing was told of going on


@pytest.mark.long
def test_many_frames_that_share_nothing_take_memory_in_proportion(tmp_path):
    """Twice the frames, twice the memory at most; a matrix over all of them would take 4 times."""
    place = make_set(tmp_path, 1)
    data = fitting.PreparedFrames(place / "film.tif", SCENE)
    (row,) = fitting.FrameWork(data, fitting.make_sequence(data.scene, 1, (), (LOAD, LEFT)))(
        0, 1
    ).rows
    peaks = []
    for count in (250, 500):
        sequence = fitting.make_sequence(data.scene, count, (), (LOAD, LEFT))
        assert fitting.is_each(sequence)
        work = fitting.FrameWork(data, sequence)
        tracemalloc.start()
        alone = [work.restored(i, row) for i in range(count)]
        found = fitting.make_result(fitting.fit_of_each(sequence, alone), alone)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(found.frames) == count
    assert peaks[1] < 2.2 * peaks[0]
