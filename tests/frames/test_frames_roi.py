"""Fringe lines as ImageJ ROIs, read back byte by byte."""

import struct
import sys
import zipfile

import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.fringes import Skeleton
from isochrome.output import add_rois, roi_entries

POLYLINE, SUB_PIXEL = 5, 128
"""ImageJ's own numbers for the type and the option."""

LINES = [
    Skeleton("dark", np.array([3.25, 4.5, 6.0]), np.array([10.0, 11.75, 12.5]), 1.0),
    Skeleton("dark", np.array([30.0, 31.0]), np.array([1.0, 2.0]), 1.0),
    Skeleton("bright", np.array([8.0, 9.0]), np.array([2.5, -0.25]), 1.5),
    Skeleton("bright", np.array([5.0, 5.0]), np.array([0.0, 7.0])),
    Skeleton("dark", np.array([5.0]), np.array([0.0]), 2.0),
]


def decode(data):
    """(name, type, sub-pixel?, slice, [(x, y), ...]) of a ROI, after ImageJ's published layout."""
    assert data[:4] == b"Iout"
    kind, (count,) = data[6], struct.unpack(">H", data[16:18])
    (options,) = struct.unpack(">H", data[50:52])
    place, header = struct.unpack(">ii", data[56:64])
    values = np.frombuffer(data, ">f4", 2 * count, 64 + 4 * count)
    start, length = struct.unpack(">ii", data[header + 16 : header + 24])
    name = data[start : start + 2 * length].decode("utf-16-be")
    return name, kind, bool(options & SUB_PIXEL), place, values.reshape(2, count).T


def written(path, lines=LINES, frame=0):
    pytest.importorskip("roifile")
    with zipfile.ZipFile(path, "w") as archive:
        add_rois(archive, roi_entries(lines, frame))
    with zipfile.ZipFile(path) as file:
        assert file.testzip() is None
        names = file.namelist()
        return names, [decode(file.read(name)) for name in names]


def test_lines_are_polylines_named_by_their_order_and_kind_on_pixel_centres(tmp_path):
    names, rois = written(tmp_path / "lines.zip")
    assert [roi[0] for roi in rois] == [
        "frame 0: N = 1 dark", "frame 0: N = 1 dark #2", "frame 0: N = 1.5 bright",
        "frame 0: line 3 bright",
    ]  # fmt: skip
    assert names == [f"{roi[0].replace(':', '')}.roi" for roi in rois]  # for Windows
    for line, (_, kind, sub_pixel, place, points) in zip(LINES, rois, strict=False):
        assert (kind, sub_pixel, place) == (POLYLINE, True, 1)  # ImageJ counts slices from 1
        # ImageJ counts lines from pixel centres, as rows and cols do; floats hold these exactly
        np.testing.assert_array_equal(points, np.stack([line.cols, line.rows], axis=1))


def test_lines_of_a_stack_stand_on_their_slices(tmp_path):
    _, rois = written(tmp_path / "lines.zip", LINES[1:3], frame=6)
    assert [roi[3] for roi in rois] == [7, 7]
    assert [roi[0] for roi in rois] == ["frame 6: N = 1 dark", "frame 6: N = 1.5 bright"]
    for name in ("a.zip", "b.zip"):
        written(tmp_path / name)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    assert written(tmp_path / "none.zip", []) == ([], [])


def test_without_the_library_one_sentence_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "roifile", None)
    with pytest.raises(InputError, match=r"pip install isochrome\[imagej\]"):
        roi_entries(LINES, 0)
