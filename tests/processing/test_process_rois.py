"""`process` leaves its fringe lines as ImageJ ROIs where they are asked for."""

import sys

import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.output import read_csv, write_tiff
from isochrome.processing import process
from isochrome.scene import parse_scene
from isochrome.simulation import simulate
from stepped_sets import DISC, contact, small

PLAIN = (
    '[specimen]\nshape = "other"\n\n[polariscope]\nwavelength_nm = 587.0\n\n'
    "[camera]\nbit_depth = 8\npixel_mm = 0.2\n"
)


def read_zip(path):
    roifile = pytest.importorskip("roifile")
    return roifile.roiread(path)


@pytest.fixture(scope="module")
def stepped(tmp_path_factory):
    """Two states of a contact: the folder that `process` left, with ROIs."""
    pytest.importorskip("roifile")
    place = tmp_path_factory.mktemp("stepped")
    scene = small(contact(0.3))
    other = scene.with_values({"camera.seed": 5})
    frames = np.concatenate([simulate(scene).frames, simulate(other).frames])
    write_tiff(place / "set.tif", frames)
    plain = parse_scene(PLAIN).with_values({"polariscope.step": scene.polariscope.step})
    process(place / "set.tif", plain, place / "out", rois=True)
    return place / "out"


@pytest.mark.long
def test_each_line_of_the_table_is_a_roi_on_its_slice(stepped):
    table = read_csv(stepped / "skeleton.csv")
    rois = read_zip(stepped / "skeleton.zip")
    keys = list(dict.fromkeys(zip(table["frame"], table["line"], strict=True)))
    assert {frame for frame, _ in keys} == {0.0, 1.0} and len(rois) == len(keys)
    at = {key: [] for key in keys}
    for k, key in enumerate(zip(table["frame"], table["line"], strict=True)):
        at[key].append(k)
    for key, roi in zip(keys, rois, strict=True):
        first = at[key][0]
        assert roi.position == key[0] + 1  # ImageJ counts slices from 1
        order, kind = table["order"][first], table["kind"][first]
        assert roi.name.startswith(f"frame {key[0]:g}: N = {order:g} {kind}")
        xy = np.stack([np.take(table[n], at[key]) for n in ("col_px", "row_px")], axis=1)
        # ImageJ keeps single precision, the table nine digits
        np.testing.assert_allclose(roi.coordinates(), xy, atol=1e-4)
    assert len({roi.name for roi in rois}) == len(rois)


def test_lines_of_a_single_frame_are_numbered_by_its_reading(tmp_path):
    scene = parse_scene(DISC + "pixel_mm = 0.2\n").with_values(
        {
            "load.normal_n": 80.0, "camera.width_px": 165, "camera.height_px": 155,
            "camera.noise_grey": 1.0, "camera.blur_px": 0.0,
        }
    )  # fmt: skip
    rendered = simulate(scene)
    bright = simulate(scene.with_values({"load.normal_n": 1e-6, "polariscope.field": "bright"}))
    dark = simulate(scene.with_values({"load.normal_n": 1e-6}))
    for name, frames in (("frame", rendered), ("bright", bright), ("dark", dark)):
        write_tiff(tmp_path / f"{name}.tif", frames.frames)
    order = rendered.orders[0]
    row, col = 77, 10  # beside the rim, on the level diameter
    known = {"row_px": row, "col_px": col, "order": float(order[row, col])}
    values = {"frames.known_order": (known,), "frames.no_load_dark": "dark.tif",
              "frames.no_load_bright": "bright.tif"}  # fmt: skip
    plain = parse_scene(PLAIN).with_values(values).model_copy(update={"folder": tmp_path})
    process(tmp_path / "frame.tif", plain, tmp_path / "out", rois=True)
    table = read_csv(tmp_path / "out" / "skeleton.csv")
    rows, cols, told = (np.array(table[name]) for name in ("row_px", "col_px", "order"))
    numbered = np.isfinite(told)
    assert set(told[numbered]) >= {0.5, 1.0} and numbered.mean() > 0.5
    place = np.rint(rows).astype(int), np.rint(cols).astype(int)
    gentle = numbered & (np.hypot(*np.gradient(order))[place] < 0.05)
    # two pixels off at most: on its own line, never on the next one
    assert gentle.sum() > 100 and np.abs(order[place] - told)[gentle].max() < 0.1
    names = [roi.name for roi in read_zip(tmp_path / "out" / "skeleton.zip")]
    assert any(name.startswith("frame 0: N = 1 dark") for name in names)
    kinds = {(float(o).is_integer(), k) for o, k in zip(told, table["kind"], strict=True) if o == o}
    assert kinds <= {(True, "dark"), (False, "bright")}


def test_without_the_library_it_is_said_before_anything_is_read(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "roifile", None)
    with pytest.raises(InputError, match=r"pip install isochrome\[imagej\]"):
        process("nowhere.tif", parse_scene(PLAIN), tmp_path / "out", rois=True)
    assert not (tmp_path / "out").exists()
