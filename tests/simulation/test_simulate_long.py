"""Long histories: states go to disk as they are solved, and memory does not grow with them."""

import weakref
from dataclasses import replace
from importlib import import_module

import pytest
import tifffile

from isochrome.benchmarks import load_benchmarks
from isochrome.output import read_csv
from isochrome.scene import parse_scene
from isochrome.simulation import scene_states, simulate

WORK = import_module("isochrome.simulation.rendering")


@pytest.mark.long
@pytest.mark.parametrize(
    "components",
    [False, pytest.param(True, marks=pytest.mark.study)],
    ids=["fringes", "components"],
)
def test_a_state_is_let_go_once_it_is_written(tmp_path, monkeypatch, components):
    """Of 20 states no more live at any time than the six of the figure, and the two at hand."""
    scene = parse_scene(load_benchmarks("case_memory").long_history(20))
    (state,) = scene_states(scene.with_values({"wear.distances_m": (0.0,)}))
    seen, most = [], []

    def copies(_):
        for k in range(20):
            most.append(sum(ref() is not None for ref in seen))
            copy = replace(state, label=f"copy {k}")
            seen.append(weakref.ref(copy))
            yield copy

    monkeypatch.setattr(WORK, "iter_scene_states", copies)
    done = []
    out = simulate(scene, tmp_path, components=components, progress=done.append)
    assert max(most) <= 6 + 2
    assert [tally.done for tally in done] == [*range(0, 20, 3), 20]
    assert {tally.count for tally in done} == {20}
    assert out.states == [] and out.history["label"] == [f"copy {k}" for k in range(20)]
    assert read_csv(tmp_path / "history.csv")["label"] == out.history["label"]
    assert tifffile.imread(tmp_path / "frames.tif").shape == (20, 48, 64)
    pressure = read_csv(tmp_path / "pressure.csv")
    assert sorted(set(pressure["state"])) == list(range(20))
