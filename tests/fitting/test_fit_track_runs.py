"""`fit --track` as a long run: killed and stopped, on fresh and on worn contacts."""

import numpy as np
import pytest

from fitting.test_fit_track import FRICTION, LOAD, contact, film, frame_of, save
from isochrome import open_run
from isochrome.fitting import api as track_run
from isochrome.fitting import track
from isochrome.runs import Stopped
from isochrome.scene import load_scene
from isochrome.simulation import scene_states
from runs.counting import contents


def load_of(count):
    return 44.0 * (1.0 + 0.04 * np.sin(np.arange(count) / 3.0))


@pytest.fixture
def short_chunks(monkeypatch):
    monkeypatch.setattr(track_run, "CHUNK", 2)


def stopped(folder, scene, keys):
    """A track that is stopped at the keyboard when two of its chunks of two are finished."""

    def stop(tally):
        if tally.done == 4:
            raise KeyboardInterrupt

    with pytest.raises(Stopped, match="4 of 6 are finished and kept"):
        track(folder / "film.tif", scene, keys, out=folder / "out", progress=stop)


@pytest.mark.long
def test_a_stopped_track_goes_on_and_ends_with_the_same_bytes(tmp_path, short_chunks):
    load = load_of(6)
    save(tmp_path, film(contact(), {LOAD: load}, np.random.default_rng(1)))
    path, scene = tmp_path / "film.tif", contact()
    whole = track(path, scene, (LOAD,), out=tmp_path / "whole")
    assert whole.searched == (0,)  # a new chunk looks near the last frame, as any other frame
    pulls = (whole.values[:, 0] - load) / whole.standard_uncertainty[:, 0]
    assert np.abs(pulls).max() < 4.0
    stopped(tmp_path, scene, (LOAD,))
    told = []
    track(path, scene, (LOAD,), out=tmp_path / "out", progress=told.append)
    assert told[0].before == 4
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert not (tmp_path / "out.partial").exists()

    # in memory, and from the folder again, it is the same
    kept = track(path, scene, (LOAD,))
    np.testing.assert_array_equal(kept.values, whole.values)
    again = track(path, scene, (LOAD,), out=tmp_path / "out")
    assert again.already and again.to_json() == whole.to_json() and again.scene == whole.scene
    with open_run(tmp_path / "out") as dataset:
        np.testing.assert_array_equal(dataset.load_normal_n.values, whole.values[:, 0])
        assert (
            dataset.load_normal_n.dims == ("frame",) and dataset.load_normal_n.attrs["units"] == "N"
        )
        assert dataset.searched.values.tolist() == [1] + [0] * 5


@pytest.mark.study
def test_a_stopped_track_of_a_worn_contact_goes_on_with_its_scar(tmp_path, short_chunks):
    count = 6
    distance = 40.0 + 0.5 * np.arange(count)
    table = {"distance_m": distance.tolist(), "value": load_of(count).tolist()}
    base = load_scene("line-contact-wear")
    begun = contact().model_copy(update={"wear": base.wear})
    begun = begun.with_values({"wear.distances_m": distance.tolist()})
    truth, rng = begun.with_values({LOAD: table}), np.random.default_rng(4)
    save(tmp_path, np.stack([frame_of(truth, state, rng) for state in scene_states(truth)]))
    keys = (LOAD, FRICTION)
    whole = track(tmp_path / "film.tif", begun, keys, out=tmp_path / "whole")
    assert whole.searched == (0,)
    pulls = (whole.values[:, 0] - load_of(count)) / whole.standard_uncertainty[:, 0]
    assert np.abs(pulls).max() < 4.0
    stopped(tmp_path, begun, keys)
    track(tmp_path / "film.tif", begun, keys, out=tmp_path / "out")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
