"""Maps of every frame of a followed video: as `--each` gives them, compact, whoever makes them."""

import pkgutil
import threading

import cv2
import numpy as np
import pytest
import tifffile
import zarr
from tracked_films import FRICTION, LEFT, LOAD, contact, film, write_video

import isochrome
from isochrome import open_run
from isochrome.comparison import load_frame_set
from isochrome.errors import InputError
from isochrome.output import read_csv
from isochrome.processing import FINEST_STEP, order_step, process
from isochrome.runs import Compact, export
from isochrome.scene import dump_scene
from isochrome.simulation import make_picture, scene_states, state_difference
from isochrome.stress import pixel_grid
from processing.test_process_track import EVERY, SHAPE, save
from reporting.pages import Page, data_of, decoded
from runs.counting import contents

COUNT = 8


def course(count):
    """A load and a friction that swing, and a contact that creeps along."""
    i = np.arange(count)
    return {
        LOAD: 44.0 * (1.0 + 0.03 * np.sin(i / 3)),
        FRICTION: 0.2 + 0.01 * np.sin(i / 5),
        LEFT: -1.9 + 0.004 * np.sin(i / 9),
    }


def true_orders(scene, values):
    """The orders (frames, rows, cols) that a film was rendered from."""
    found = []
    for own in zip(*values.values(), strict=True):
        one = scene.with_values(dict(zip(values, map(float, own), strict=True)))
        pixels = pixel_grid(one, SHAPE)
        difference = state_difference(one, scene_states(one)[-1], pixels)
        found.append(make_picture(one, difference, pixels).order)
    return np.stack(found)


def run(place, out="out", **more):
    where = None if out is None else place / out
    frames, scene = place / "film.tif", place / "scene.toml"
    return process(frames, scene, where, track=True, every=EVERY, **more)


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """Eight frames of a sliding contact, of which 0 and 5 are key frames."""
    scene = contact(sliding=True)
    place = save(tmp_path_factory.mktemp("film"), film(scene, course(COUNT), 1), scene)
    said = []
    found = run(place, progress=lambda tally: said.append(tally.said))
    return place, found, said


def test_each_frame_has_the_map_that_it_has_when_it_is_processed_alone(followed):
    place, _, _ = followed
    with open_run(place / "out") as dataset:
        order, confidence = dataset.fringe_order.values, dataset.confidence.values
    assert order.shape == (COUNT, *SHAPE) and order.dtype == np.float32
    some = [0, 3, 7]
    alone = process(tifffile.imread(place / "film.tif")[some], place / "scene.toml").dataset
    truth = true_orders(contact(sliding=True), course(COUNT))
    error = (order - truth)[np.isfinite(order)]
    # what the noise leaves of a pooled reading; the bar of a frame by itself is the same
    assert np.sqrt(np.mean(error**2)) < 0.005 and np.mean(np.abs(error) > 0.25) == 0.0
    order, confidence = order[some], confidence[some]
    other, sure = alone.fringe_order.values, alone.confidence.values
    both = np.isfinite(order) & np.isfinite(other)
    # both read the same light; their models differ by the noise of a fit, some 1e-4 fringe
    assert np.sqrt(np.mean((order - other)[both] ** 2)) < 0.001
    assert np.abs(order - other)[both].max() < 0.1  # a fifth of a branch
    assert np.mean(np.isfinite(order) != np.isfinite(other)) < 0.005
    assert np.sqrt(np.mean((confidence - sure)[both] ** 2)) < 0.02


def test_a_followed_frame_has_the_columns_and_pages_of_a_whole_one(followed):
    place, found, said = followed
    table = read_csv(place / "out" / "frames.csv")
    truth = true_orders(contact(sliding=True), course(COUNT))
    for name in ("kept_share", "n_max", "n_max_x_mm", "n_max_z_mm", "noise"):
        assert np.isfinite(table[name]).all(), name
    # the largest of 38 400 pixels' orders stands out by some of their 0.003
    assert table["n_max"] == pytest.approx(truth.max(axis=(1, 2)), abs=0.03)
    assert min(table["kept_share"]) > 0.95
    assert [k for k, at in enumerate(found.columns["picture"]) if at is not None] == [0, 5]
    assert any("maps of 8 frames" in text and "MB a frame" in text for text in said)
    with open_run(place / "out") as dataset:
        for name in ("fringe_order", "confidence"):
            stored = dataset[name].values
            with tifffile.TiffFile(place / "out" / f"{name}.tif") as tif:
                np.testing.assert_array_equal(tif.asarray(), stored)
                assert len(tif.imagej_metadata["Labels"]) == COUNT
        assert tifffile.imread(place / "out" / "normalised.tif").shape == (2, *SHAPE)
        compared = load_frame_set(place / "out")
        np.testing.assert_array_equal(compared.order, dataset.fringe_order.values[[0, 5]])


@pytest.fixture(scope="module")
def remembered(followed):
    """The same run, of which nothing is written."""
    return run(followed[0], out=None)


def test_maps_are_kept_in_whole_steps_whose_error_is_half_of_one(followed, remembered):
    place, kept = followed[0], remembered.dataset
    with open_run(place / "out") as dataset:
        for name, step in (("fringe_order", FINEST_STEP), ("confidence", 1.0 / 254.0)):
            own, stored = kept[name].values, dataset[name].values
            np.testing.assert_array_equal(np.isnan(own), np.isnan(stored))
            # half a step, and single precision of orders up to 4
            assert np.nanmax(np.abs(own - stored)) <= 0.5 * step + 5e-7, name
    group = zarr.open_group(place / "out" / "run.zarr", mode="r")
    assert group["fringe_order"].dtype == "uint16" and group["confidence"].dtype == "uint8"
    size = sum(f.stat().st_size for f in (place / "out/run.zarr/fringe_order").rglob("c/*/*/*"))
    assert size < 1.6 * COUNT * SHAPE[0] * SHAPE[1]  # of two bytes a pixel, one and a quarter
    (stack,) = (f for f in export(place / "out", "tiff", place) if f.stem == "fringe_order")
    assert cv2.imreadmulti(str(stack), flags=cv2.IMREAD_UNCHANGED)[1][3].shape == SHAPE


def shown_maps(figure):
    """The pictures of a figure: what their panels are called, and their values."""
    named = {axes: " ".join(axes.get_title(loc="left").split()) for axes in figure.axes}
    return {
        name: np.ma.filled(axes.images[0].get_array(), np.nan)
        for axes, name in named.items()
        if axes.images and name
    }


@pytest.mark.long
@pytest.mark.parametrize("kept", ["folder", "memory"])
def test_a_figure_shows_the_maps_of_the_frames_that_it_names(followed, remembered, kept):
    """Pictures are numbered by key frame, orders by frame: 5 is the second key frame."""
    found = followed[1] if kept == "folder" else remembered
    order, picture = found.dataset.fringe_order.values, found.dataset.normalised.values
    shown = shown_maps(isochrome.paper_figure(found, isochrome.FigureStyle(frames=(5, 3))))
    of_order, of_frame = ([shown[n] for n in shown if words in n] for words in ("order", "picture"))
    assert [k for k in (5, 3) if any(f"frame {k}" in name for name in shown)] == [5, 3]
    np.testing.assert_array_equal(of_order[0], order[5])
    np.testing.assert_array_equal(of_order[1], order[3])
    np.testing.assert_array_equal(of_frame[0], picture[1])
    assert np.isnan(of_frame[1]).all()  # its picture is not kept, and the panel says so


def test_the_report_shows_frames_between_the_key_frames(followed):
    place, found, _ = followed
    page = Page(place / "out" / "report.html")
    assert "8 of 8 frames are shown." in page.text
    frames = data_of(page)["frames"]
    order = found.dataset.fringe_order.values
    for k, one in enumerate(frames):
        keys = [pane["key"] for pane in one["panes"]]
        kept = k in (0, 5)
        assert keys == (["experiment", "simulation", "difference", "order"] if kept else
                        ["order", "simulation", "difference"])  # fmt: skip
        assert any("its picture is not kept" in note for note in one["notes"]) != kept
        own = decoded(one["order"], one["rows"], one["cols"])
        # orders of a report are rounded to its step
        np.testing.assert_allclose(own, order[k, : one["rows"], : one["cols"]], atol=0.00051)


@pytest.mark.parametrize(("largest", "step"), [(3.0, 1e-4), (6.0, 2e-4), (30.0, 1e-3)])
def test_steps_reach_twice_the_orders_of_the_scene(largest, step):
    scene = contact()
    own = FINEST_STEP * 65534
    fine = order_step(scene, SHAPE)
    assert fine == FINEST_STEP
    # the order grows with the thickness over the fringe value
    peak = true_orders(scene, {LOAD: [44.0]}).max()
    value = scene.specimen.fringe_value_n_per_mm * peak / largest
    found = order_step(scene.with_values({"specimen.fringe_value_n_per_mm": value}), SHAPE)
    assert found == pytest.approx(step) and found / FINEST_STEP * own > 1.9 * largest


@pytest.mark.long
def test_orders_beyond_the_steps_and_maps_beyond_the_pages_are_left_out_and_said(
    followed, monkeypatch
):
    place, said = followed[0], []
    monkeypatch.setattr("isochrome.processing.kinds.tracked.order_step", lambda *_: 4e-5)
    room = 4 * COUNT * SHAPE[0] * SHAPE[1] - 1
    monkeypatch.setattr("isochrome.processing.kinds.tracked.MOST_PAGED", room)
    found = run(place, out="cut", progress=lambda tally: said.append(tally.said))
    assert any("the TIFF stacks hold the key frames" in text for text in said)
    stack = tifffile.imread(place / "cut" / "fringe_order.tif")
    assert load_frame_set(place / "cut").order.shape == stack.shape == (2, *SHAPE)
    assert any(
        "orders above 2.621 fringes, which run.zarr cannot hold" in t for t in found.warnings
    )
    with open_run(place / "cut") as dataset:
        assert 2.6 < np.nanmax(dataset.fringe_order.values) < 2.622
        # the pages are the maps before they are kept in steps
        assert np.nanmax(np.abs(stack - dataset.fringe_order.values[[0, 5]])) <= 2e-5 + 5e-7


def test_a_map_is_packed_to_the_same_bytes_in_any_thread():
    values = np.random.default_rng(2).normal(3.0, 1.0, (500, 400)).astype(np.float32)
    values[values < 0.5] = np.nan
    kind, found = Compact(1e-4, 16), []
    threads = [threading.Thread(target=lambda: found.append(kind.pack(values))) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(found) == {kind.pack(values)}


@pytest.mark.long
def test_a_video_is_followed_unless_each_frame_is_wanted(tmp_path):
    scene = contact((60, 90), sliding=True)
    (tmp_path / "scene.toml").write_text(dump_scene(scene), "utf-8")
    write_video(tmp_path / "film.avi", film(scene, course(2), 1), "rawvideo", "gray")
    arguments = tmp_path / "film.avi", tmp_path / "scene.toml"
    found = process(*arguments)
    assert found.columns["found_by"] == ["whole frame", "track"]
    assert found.dataset.fringe_order.dims[0] == "frame"
    assert not process(*arguments, each=True).tracked
    none = process(*arguments, tmp_path / "none", maps="none")
    assert none.columns["picture"] == [None] * 2 and none.fitted is not None
    assert not list((tmp_path / "none").glob("*.tif"))
    with open_run(tmp_path / "none") as dataset:
        assert "fringe_order" not in dataset and dataset.load_normal_n.size == 2
    assert not shown_maps(isochrome.paper_figure(none))  # its values alone
    with pytest.raises(InputError, match="frames that have one: none"):
        isochrome.paper_figure(none, isochrome.FigureStyle(frames=(0,)))


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"track": True, "each": True}, "--track and --each"),
        ({"track": True, "maps": "some"}, "--maps some: give all, key, none"),
        ({"maps": "all"}, "--maps all: is for a video that is followed"),
        ({"every": 5}, "--every 5: is for a video that is followed"),
        ({"track": True, "preview": True}, "preview: is written beside the results"),
    ],
)
def test_options_that_say_nothing_are_refused(tmp_path, more, said):
    place = save(tmp_path / "film", np.full((3, *SHAPE), 90, np.uint8))
    with pytest.raises(InputError, match=said):
        process(place / "film.tif", place / "scene.toml", **more)


@pytest.mark.long
def test_a_growing_run_can_be_opened_and_looked_at(followed, monkeypatch):
    place, _, _ = followed
    follow_of = "isochrome.processing.kinds.tracked.KeyFrames.follow"
    looks, follow = [], pkgutil.resolve_name(follow_of)

    def looked(self, frame):
        if frame.index == 7:
            with open_run(place / "grown.partial") as dataset:
                looks.append((dataset.finished.values.tolist(), dataset.load_normal_n.values,
                              dataset.fringe_order.values))  # fmt: skip
            looks.append(cv2.imread(str(place / "grown.partial" / "preview.png")))
        return follow(self, frame)

    monkeypatch.setattr(follow_of, looked)
    run(place, out="grown", preview=True)
    (finished, load, order), picture = looks
    assert finished == [True] * 5 + [False] * 3 and np.isfinite(load).tolist() == finished
    assert np.isfinite(order).any(axis=(1, 2)).tolist() == finished
    assert picture.shape == (SHAPE[0] + 22, SHAPE[1], 3)
    assert picture[22:].std(axis=(0, 1)).min() > 10.0  # colours, not a blank
    assert not (place / "grown.partial").exists()
    with pytest.raises(InputError, match="no run is at work there"):
        open_run(place / "grown.partial")


@pytest.mark.study
def test_two_workers_leave_the_same_bytes(followed):
    place = followed[0]
    run(place, out="two", workers=2)
    assert contents(place / "two") == contents(place / "out")
