"""A report of a long run: some of its frames, all of its peaks, in bounded room."""

import re
import time

import numpy as np
import pytest
from long_runs import LOAD, lengthen
from pages import Page, data_of, decoded

import isochrome
from processing.tracked_films import contact, film

COUNT = 20_000
EVERY = 50
MOST_BYTES = 10_000_000


@pytest.mark.long
@pytest.mark.parametrize("tracked", [False, pytest.param(True, marks=pytest.mark.study)])
def test_a_run_of_twenty_thousand_frames_has_a_page_of_less_than_ten_megabytes(tmp_path, tracked):
    """Of a camera's 659 x 494 pixels. With -s it says how long it took."""
    shape = (494, 659)
    scene = contact(shape, sliding=tracked, wearing=not tracked)
    if tracked:
        frames = film(scene, {LOAD: [44.0, 44.1, 44.2]}, 1)
        options = {"track": True, "every": 2, "maps": "key"}
    else:
        scene = scene.with_values({"wear.distances_m": (100.0,)})
        frames, options = film(scene, {LOAD: [44.0]}, 1), {}
    isochrome.process(frames, scene, tmp_path / "short", **options)
    table = lengthen(tmp_path / "short", tmp_path / "long", COUNT, EVERY if tracked else 1)
    began = time.perf_counter()
    file = isochrome.report(tmp_path / "long")
    print(f"{time.perf_counter() - began:.2f} s, {file.stat().st_size / 1e6:.2f} MB")
    assert file.stat().st_size < MOST_BYTES
    page = Page(file)
    having = COUNT // EVERY if tracked else COUNT
    what = "key frames" if tracked else "frames"
    assert f"8 of {COUNT} frames are shown, chosen among {having} {what} for" in page.text
    shown = data_of(page)["frames"]
    assert {one["why"] for one in shown} == {
        "the first", "evenly spaced", "the largest chi", "the largest order", "the last",
    }  # fmt: skip
    for one in shown:
        assert one["label"] == table["label"][one["number"]]
        assert [pane["key"] for pane in one["panes"]] == [
            "experiment", "simulation", "difference", "order",
        ], one["number"]  # fmt: skip
        own = decoded(one["order"], one["rows"], one["cols"])
        assert np.isfinite(own).mean() > 0.5  # its map was read: others have no file
    loads = [float(text) for text in re.findall(r"(\d+\.\d+) to (\d+\.\d+)\)", page.text)[0]]
    assert np.allclose(loads, [min(table[LOAD]), max(table[LOAD])], rtol=1e-4)
