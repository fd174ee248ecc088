"""A disc that holds stress without load: its frames' loads, each read against the others."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.outside_camera import NONE
from benchmarks.outside_specimens import Bench, disc_images
from isochrome import InputError, check, load_scene, process
from isochrome.processing import process_frame
from isochrome.scene import frames_of
from real_frames import REAL, needs_real

LOADS = (520.0, 660.0, 800.0, 920.0, 1050.0, 1150.0, 1220.0)
SCENE = {
    "specimen": {
        "shape": "disc", "diameter_mm": 60.0, "thickness_mm": 6.0, "fringe_value_n_per_mm": 10.0,
    },
    "load": {"normal_n": 800.0},
    "camera": {"bit_depth": 8},
    "frames": {"known_loads_n": LOADS},
}  # fmt: skip


@pytest.fixture(scope="module")
def frames():
    bench = Bench(
        shape=(200, 210), size_px=160.0, zero_order=0.3, defects=replace(NONE, noise=1.0),
        residual=lambda x, z: 0.3 * x + 0.2j * z,
    )  # fmt: skip
    images = disc_images(4e-3 * np.array(LOADS), bench, 5)
    return np.asarray(images).astype(np.uint8)


def with_loads(*loads):
    return load_scene(SCENE | {"frames": {"known_loads_n": loads}})


@pytest.mark.long
def test_each_load_is_read_against_the_others(frames, tmp_path):
    """Also that of a frame which nobody measured, and one whose load is stated wrongly is named."""
    stated = list(LOADS)
    stated[2], stated[5] = 0.0, 1110.0
    found = process(frames, with_loads(*stated), tmp_path / "out")
    load = np.array(found.table["load.normal_n"])
    spread = np.array(found.table["load.normal_n standard_uncertainty"])
    assert np.all(np.abs(load - LOADS) < 3.0 * spread) and min(found.table["explained_share"]) > 0.8
    assert "stated as 1110 N" in found.table["warnings"][5]
    assert not any("stated as" in text for k, text in enumerate(found.table["warnings"]) if k != 5)
    assert not found.causes and not found.asks_causes
    assert any("no model names the fringes" in text for text in found.warnings)
    report = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "causes found" not in report and "no simulation" in report
    assert "taken as exact" not in report.lower()
    assert not (tmp_path / "out" / "fringe_order.tif").exists()
    (one,) = process_frame(frames_of(frames), with_loads(*stated), 3).values  # as in the set
    assert one.key == "load.normal_n" and one.value == load[3]


@pytest.mark.long
def test_check_reads_loads_and_refuses_those_that_do_not_belong(frames):
    assert check(frames, with_loads(*LOADS)).ok
    found = check(frames, with_loads(*LOADS[:6]))
    assert any("has 6 numbers, and the set 7 frames" in one.text for one in found.findings)
    few = check(frames[:4], with_loads(*LOADS[:4]))
    assert not few.ok and any("3 other loads are known" in one.text for one in few.findings)


def test_a_number_for_each_frame():
    with pytest.raises(InputError, match=r"known_loads_n has 6 numbers, and the set 7 frames"):
        process(np.full((7, 40, 42), 90, np.uint8), with_loads(*LOADS[:6]))


@pytest.mark.parametrize(
    "other",
    [
        {"specimen": SCENE["specimen"] | {"shape": "ring", "hole_mm": 20.0}},
        {"polariscope": {"light": "white", "wavelength_nm": 589.0}},
    ],
)
def test_for_discs_in_light_of_one_wavelength(other):
    with pytest.raises(InputError, match=r"known_loads_n is for single frames of a disc"):
        load_scene(SCENE | other)


@pytest.mark.study
@needs_real
def test_the_real_disc_by_its_own_loads(tmp_path):
    """Six loads are within their ±; the largest is not what the six others tell, and is named."""
    loads = (523.0, 663.0, 807.0, 922.0, 1045.0, 1152.0, 1221.0)
    for file in (REAL / "disc-seven-loads").glob("*.jpg"):
        shutil.copy(file, tmp_path)
    box = {"top_px": 600, "left_px": 550, "height_px": 980, "width_px": 980}
    own = {"known_loads_n": loads, "channel": "green", "gamma": 2.2, "roi": box}
    found = process(tmp_path, SCENE | {"frames": own})
    load = np.array(found.table["load.normal_n"])
    spread = np.array(found.table["load.normal_n standard_uncertainty"])
    pulls = (load - loads) / spread
    assert np.all(np.abs(pulls[:6]) < 2.0) and np.all(spread < 0.08 * load)
    assert "stated as 1221 N" in found.table["warnings"][6] and abs(load[6] / loads[6] - 1.0) < 0.06
