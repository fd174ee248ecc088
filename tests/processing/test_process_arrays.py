"""What is found in arrays is what is found in the files of their pixels, bit by bit; nothing is
written."""

import json
import re
import subprocess
import sys
import tomllib

import numpy as np
import pytest
import tifffile
import xarray as xr

import isochrome
from isochrome.errors import InputError
from isochrome.output import plain
from isochrome.samples import samples_path
from refusals import refusal
from stepped_sets import CIRCULAR, as_steps

CONTACT = samples_path() / "line-contact-wear"
RING = isochrome.load_scene("ring").with_values(
    {
        "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
        "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0,
    }
)  # fmt: skip
NAMES = ("name", "label", "file")
"""Columns that say where a frame comes from."""


def numbers_of(result):
    """All that a result tells, but for where its frames come from; each float to its last bit."""
    columns = {name: values for name, values in result.columns.items() if name not in NAMES}
    found = json.dumps(plain({"columns": columns, "json": result.to_json()}), sort_keys=True)
    return nameless(json.loads(found))


def nameless(item):
    if isinstance(item, dict):
        return {key: nameless(value) for key, value in item.items() if key not in NAMES}
    return list(map(nameless, item)) if isinstance(item, list) else item


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """A ring's frame and its file."""
    folder = tmp_path_factory.mktemp("ring")
    frames = isochrome.simulate(RING).frames
    tifffile.imwrite(folder / "ring.tif", frames[0])
    return frames, folder / "ring.tif"


@pytest.fixture(autouse=True)
def empty(tmp_path, monkeypatch):
    """An empty working folder, which stays so but for what a test writes into OUT."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert {path.name for path in tmp_path.iterdir()} <= {"OUT", "OTHER"}


@pytest.mark.long
@pytest.mark.parametrize(
    "form",
    [np.asarray, list, lambda f: f[0], lambda f: xr.DataArray(f, dims=("frame", "row", "col"))],
)
def test_process_of_an_array_is_that_of_its_file(ring, form):
    frames, file = ring
    one, other = isochrome.process(form(frames), RING), isochrome.process(file, RING)
    assert numbers_of(one) == numbers_of(other)
    for name, values in other.frames[0].maps().items():
        assert np.array_equal(one.frames[0].maps()[name], values, equal_nan=True), name
    assert one.fitted == other.fitted


@pytest.mark.long
def test_fit_and_check_of_an_array_are_those_of_its_file(ring):
    frames, file = ring
    start = RING.with_values({"load.normal_n": 63.0})
    one, other = (isochrome.fit(given, start, ["load.normal_n"]) for given in (frames, file))
    assert numbers_of(one) == numbers_of(other) and one.scene == other.scene
    assert one.figure().axes  # which goes through the frames once more
    one, other = (isochrome.check(given, RING) for given in (frames, file))
    assert numbers_of(one) == numbers_of(other) and one.ok


def test_arrays_and_tables_are_taken_as_files_are_and_too_many_maps_refused(ring):
    tables = RING.model_dump(exclude_unset=True)
    found = isochrome.simulate(tables)
    assert np.array_equal(found.frames, ring[0]) and isochrome.check(ring[0], tables).ok
    endless = Endless(ring[0][0])
    text = refusal(isochrome.process, endless, RING)
    assert endless.asked < 5 and re.search(r"900000 frames take 177 GB.*give a folder", text)


@pytest.mark.long
def test_an_arrays_results_on_disk_are_those_in_memory_and_not_taken_for_anothers(ring):
    frames, _ = ring
    found, kept = isochrome.process(frames, RING, "OUT"), isochrome.process(frames, RING)
    assert numbers_of(found) == numbers_of(kept)
    for name in ("fringe_order", "normalised", "confidence"):
        (own,) = kept.dataset[name].values
        assert np.array_equal(tifffile.imread(f"OUT/{name}.tif"), own, equal_nan=True)
    assert isochrome.process(frames.copy(), RING, "OUT").already
    changed = frames.copy()
    changed[0, 64, 64] += 1
    assert not isochrome.process(changed, RING, "OUT").already


@pytest.mark.long
def test_results_in_memory_are_compared_as_their_folders_are(ring):
    found, simulated = isochrome.process(ring[0], RING), isochrome.simulate(RING)
    isochrome.process(ring[0], RING, "OUT")
    isochrome.simulate(RING, "OTHER")
    one, other = isochrome.compare(found, simulated), isochrome.compare("OUT", "OTHER")
    assert one.columns["order_rms_fringe"] == other.columns["order_rms_fringe"]
    assert one.columns["ncc"] == other.columns["ncc"]
    assert one.table["rmse_over_noise"][0] == pytest.approx(other.table["rmse_over_noise"][0])
    bare = isochrome.compare(ring[0], simulated.frames)
    assert bare.columns["ncc"] == [1.0] and bare.columns["order_rms_fringe"] == [None]
    with pytest.raises(InputError, match="name that folder"):
        isochrome.compare(isochrome.process(ring[0], RING, "OUT"), simulated)


class Endless:
    """A day's frames, none of which is made before it is asked for."""

    def __init__(self, frame):
        self.frame, self.asked = frame, 0

    def __len__(self):
        return 900_000

    def __getitem__(self, index):
        self.asked += 1
        return self.frame


def test_steps_of_an_array_and_an_array_of_the_unloaded_specimen(empty):
    """A phase-stepped set, with its no-load set as an array in the scene."""
    scene = RING.with_values({"polariscope.step": as_steps(CIRCULAR)})
    frames = isochrome.simulate(scene).frames
    unloaded = isochrome.simulate(scene.with_values({"load.normal_n": 1e-6})).frames
    (empty / "OUT").mkdir()
    tifffile.imwrite("OUT/unloaded.tif", unloaded, photometric="minisblack")
    tifffile.imwrite("OUT/frames.tif", frames, photometric="minisblack")
    of_file = scene.with_values({"frames.no_load_steps": "OUT/unloaded.tif"})
    of_array = scene.with_values({"frames.no_load_steps": unloaded})
    one, other = isochrome.process(frames, of_array), isochrome.process("OUT/frames.tif", of_file)
    assert numbers_of(one) == numbers_of(other)
    assert np.array_equal(one.residual.order, other.residual.order, equal_nan=True)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"image": [{"file": np.zeros((3, 9, 9, 9)), "load_n": 5.0}]}, "image 1: "),
        ({"image": [{"file": np.zeros((9, 9), bool), "load_n": 5.0}]}, "image 1: pixels of type"),
        ({"image": [{"file": np.zeros((2, 9, 9), "u1"), "load_n": 5.0}]}, "more than one frame"),
        ({"image": []}, "image"),
        ({"images": []}, "unknown key 'images'"),
        ({"image": [{"load_n": 5.0}]}, "file"),
    ],
)
def test_a_set_of_wrong_arrays_is_refused_in_one_line(change, words):
    given = tomllib.loads((samples_path() / "bending" / "set.toml").read_text("utf-8")) | change
    text = refusal(isochrome.calibrate_bending, given)
    assert words in text and len(text) < 400


def test_the_scale_of_an_array_is_that_of_its_file(empty):
    row, col = np.indices((220, 300)) // 25
    board = np.where((row + col) % 2 & (row < 8) & (col < 11), 30, 220).astype("uint8")
    board = np.pad(board, 20, constant_values=220)
    (empty / "OUT").mkdir()
    tifffile.imwrite("OUT/board.tif", board)
    size = {"target": "chessboard", "columns": 10, "rows": 7, "spacing_mm": 0.5}
    one, other = (isochrome.calibrate_scale(given, **size) for given in (board, "OUT/board.tif"))
    two = isochrome.calibrate_scale([board, board], **size)
    assert numbers_of(one) == numbers_of(other)
    assert len(two.images) == 2 and two.pixel_mm.value == pytest.approx(one.pixel_mm.value)


WATCHED = """
import isochrome, sys, tifffile
written = []
def watch(event, arguments):
    if event == "open":
        path, mode, flags = arguments
        if isinstance(path, str) and flags & (1 | 2 | 64) and "/dev/" not in path:
            written.append(path)
    elif event in ("os.mkdir", "os.rename", "os.link", "os.symlink"):
        written.append(str(arguments[0]))
sys.addaudithook(watch)
scene, frames = isochrome.load_scene(sys.argv[1]), tifffile.imread(sys.argv[2])[None]
isochrome.process(frames, scene)
isochrome.fit(frames, scene, ["load.normal_n"])
isochrome.check(frames, scene)
print(written)
"""


@pytest.mark.long
def test_of_arrays_no_file_is_written(ring):
    scene, file = ring[1].with_suffix(".toml"), ring[1]
    scene.write_text(isochrome.dump_scene(RING), "utf-8")
    command = [sys.executable, "-B", "-c", WATCHED, str(scene), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
