"""`process` leaves its fringe lines as ImageJ ROIs where they are asked for."""

import sys

import numpy as np
import pytest

from campaigns.conftest import true_orders
from isochrome.errors import InputError
from isochrome.output import read_csv
from isochrome.processing import process
from isochrome.simulation import simulate
from processing.test_process_runs import make_set
from processing.test_process_stepped import image_only
from stepped_sets import contact, small


def read_zip(path):
    roifile = pytest.importorskip("roifile")
    return roifile.roiread(path)


@pytest.mark.long
def test_each_line_of_the_table_is_a_roi_on_its_slice(tmp_path):
    """Of two states of a contact."""
    scene = small(contact(0.3))
    other = scene.with_values({"camera.seed": 5})
    frames = np.concatenate([simulate(scene).frames, simulate(other).frames])
    process(frames, image_only(scene), tmp_path / "out", rois=True)
    table = read_csv(tmp_path / "out" / "skeleton.csv")
    rois = read_zip(tmp_path / "out" / "skeleton.zip")
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
    place, order = make_set(tmp_path, 1, known=True), true_orders(1, 0)[0]
    process(place / "film.tif", place / "scene.toml", place / "out", rois=True)
    table = read_csv(tmp_path / "out" / "skeleton.csv")
    rows, cols, told = (np.array(table[name]) for name in ("row_px", "col_px", "order"))
    numbered = np.isfinite(told)
    assert set(told[numbered]) >= {0.5, 1.0} and numbered.mean() > 0.5
    place = np.rint(rows).astype(int), np.rint(cols).astype(int)
    # two pixels of 0.08 fringe off at most: on its own line, never on the next one
    assert numbered.sum() > 100 and np.abs(order[place] - told)[numbered].max() < 0.16
    names = [roi.name for roi in read_zip(tmp_path / "out" / "skeleton.zip")]
    assert any(name.startswith("frame 0: N = 1 dark") for name in names)
    kinds = {(float(o).is_integer(), k) for o, k in zip(told, table["kind"], strict=True) if o == o}
    assert kinds <= {(True, "dark"), (False, "bright")}


def test_without_the_library_it_is_said_before_anything_is_read(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "roifile", None)
    with pytest.raises(InputError, match=r"pip install isochrome\[imagej\]"):
        process("nowhere.tif", {"specimen": {}}, tmp_path / "out", rois=True)
    assert not (tmp_path / "out").exists()
