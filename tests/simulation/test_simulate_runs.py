"""`simulate` as a long run: killed, stopped, with workers; the same bytes whoever renders."""

import numpy as np
import pytest
import tifffile

from benchmarks.case_memory import long_history
from isochrome.errors import InputError
from isochrome.output import read_csv
from isochrome.runs import Stopped
from isochrome.scene import dump_scene, parse_scene
from isochrome.simulation import RenderWork, simulate
from runs.counting import contents
from runs.killing import killed_command_ends_the_same, needs_sigkill


def scene_of(count):
    """A worn contact with noise, small and coarse, at `count` distances."""
    return parse_scene(long_history(count)).with_values({"camera.noise_grey": 2.0})


SCENE = scene_of(20)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The scene's folder from an undisturbed run, which nobody changes, and what it returned."""
    out = tmp_path_factory.mktemp("whole") / "out"
    return out, simulate(SCENE, out)


def test_what_is_kept_in_memory_is_what_is_written(whole):
    """Of 20 states there are three chunks: 8, 8 and 4."""
    kept, (out, found) = simulate(SCENE), whole
    frames = tifffile.imread(out / "frames.tif")
    assert frames.dtype == kept.frames.dtype
    np.testing.assert_array_equal(frames, kept.frames)
    np.testing.assert_array_equal(tifffile.imread(out / "fringe_order.tif"), kept.orders)
    assert {k: np.array(v).tolist() for k, v in kept.history.items()} == found.history
    assert np.unique(read_csv(out / "pressure.csv")["state"]).tolist() == list(range(20))


def test_workers_and_clusters_need_a_folder():
    with pytest.raises(InputError, match="give out"):
        simulate(SCENE, workers=2)


def stopped(tmp_path, monkeypatch, scene):
    """A simulation that is stopped at the keyboard in its second chunk."""
    work = RenderWork.__call__

    def stop(self, start, end):
        if start:
            raise KeyboardInterrupt
        return work(self, start, end)

    with monkeypatch.context() as patch:
        patch.setattr(RenderWork, "__call__", stop)
        with pytest.raises(Stopped, match=r"3 of 20 are finished and kept in .*out\.partial"):
            simulate(scene, tmp_path / "out")


def test_a_stopped_simulation_goes_on_and_ends_with_the_same_bytes(tmp_path, monkeypatch, whole):
    stopped(tmp_path, monkeypatch, SCENE)
    with pytest.raises(InputError, match=r"the scene .* has changed; undo that"):
        simulate(SCENE.with_values({"camera.seed": 5}), tmp_path / "out")
    with pytest.raises(InputError, match=r"the options .* has changed; undo that"):
        simulate(SCENE, tmp_path / "out", components=True)
    told = []
    simulate(SCENE, tmp_path / "out", progress=told.append)
    assert told[0].before == 3
    assert contents(tmp_path / "out") == contents(whole[0])
    assert not (tmp_path / "out.partial").exists()


@pytest.mark.study
def test_two_workers_leave_the_same_files(tmp_path):
    simulate(SCENE, tmp_path / "one", components=True)
    simulate(SCENE, tmp_path / "two", components=True, workers=2)
    assert contents(tmp_path / "two") == contents(tmp_path / "one")


@pytest.mark.study
@needs_sigkill
@pytest.mark.parametrize("workers", ["1", "2"])
def test_killed_at_random_moments_it_ends_with_the_same_bytes(tmp_path, code, workers):
    (tmp_path / "scene.toml").write_text(dump_scene(scene_of(300)), "utf-8")
    # else nothing was told of going on
    assert killed_command_ends_the_same(tmp_path, code, workers, "simulate", "scene.toml")
