"""Films without a model: key frames are read from nothing, the others are followed from them."""

import numpy as np
import pytest
from tracked_films import leaves_the_same_bytes, write_video
from unloaded_films import KEYED, WHOLE, KnownFilm, LoadedFilm, judged

from isochrome.errors import PhysicsError
from isochrome.processing import process

AXIS = {"known_line": [{"row_px": [61, 62], "col_px": [60, 100], "order": 0.0}]}
"""The neutral axis of the small beam, of order 0 in all frames."""


@pytest.mark.long
def test_frames_are_followed_from_key_frames_and_read_anew_after_a_gap():
    film = LoadedFilm(4)
    numbers = [*range(20, 26), *range(36, 42)]
    found = process(film.frames(numbers), film.scene(**AXIS), track=True, every=9)
    kept, wrong, rms = judged(film, found, numbers).T
    assert wrong.max() == 0.0 and kept.min() > 0.6 and rms.max() < 0.02
    assert "key frame" in found.table["warnings"][0]
    assert "read anew in frame 6" in found.table["warnings"][6]


def test_a_film_of_nothing_is_refused():
    film = LoadedFilm(4)
    with pytest.raises(PhysicsError, match="no order could be read in any of the frames"):
        process(film.frames(range(1)), film.scene(**AXIS), track=True)


@pytest.mark.long
def test_a_video_is_followed_by_default(tmp_path):
    """Its frames' own times are those of a camera that left out some."""
    film = LoadedFilm(4)
    numbers = [20, 21, 23, 24]
    write_video(tmp_path / "film.mkv", film.frames(numbers), "ffv1", "gray", numbers=numbers)
    found = process(tmp_path / "film.mkv", film.scene(**AXIS))
    assert "key frame" in found.table["warnings"][0]
    kept, wrong, _ = judged(film, found, numbers).T
    assert wrong.max() == 0.0 and kept.min() > 0.6
    apart = np.diff(found.dataset.time_s.values)
    assert apart.max() == pytest.approx(2.0 * apart.min(), rel=1e-3)  # stored in milliseconds


@pytest.mark.long
def test_a_video_whose_loads_are_far_apart_has_its_frames_read_alone_and_says_so(tmp_path):
    """What `--each` finds, and a word about it; asked for, following is refused."""
    film = LoadedFilm(4)
    write_video(tmp_path / "film.mkv", film.frames([22, 32]), "ffv1", "gray")
    arguments = tmp_path / "film.mkv", film.scene(**AXIS)
    found = process(*arguments, tmp_path / "out")
    assert "each frame is read by itself" in found.table["warnings"][0]
    assert not any("read by itself" in text for text in found.table["warnings"][1:])
    alone = process(*arguments, tmp_path / "alone", each=True)
    for name in ("fringe_order.tif", "confidence.tif", "skeleton.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    _, wrong, _ = judged(film, alone, [22, 32]).T
    assert wrong.max() == 0.0
    again = process(*arguments, tmp_path / "out")  # it is done: nothing is read anew
    assert again.table["warnings"][0] == found.table["warnings"][0]
    # each frame can be read, and none of them be followed to from the one before
    with pytest.raises(PhysicsError, match=r"cannot be followed in time.*leave --track out"):
        process(*arguments, track=True)


@pytest.mark.study
def test_workers_and_folders_give_the_same_bytes(tmp_path):
    film = LoadedFilm(4)
    options = {"track": True, "every": 7}  # key frames within chunks, and at none of their ends
    frames = film.frames(range(20, 32))
    assert leaves_the_same_bytes(tmp_path, frames, film.scene(**AXIS), **options)


@pytest.mark.study
@pytest.mark.parametrize("number", range(len(KEYED)))
def test_a_followed_film_keeps_what_single_frames_keep(number):
    """RMS below .01, wrong below .1 %, kept within 2 % of single frames'."""
    film = KnownFilm(number, WHOLE, count=40)
    scene, images = film.scene(**film.known()), film.frames()
    kept, wrong, rms = judged(film, process(images, scene, track=True)).T
    single = judged(film, process(images[::13], scene), range(0, 40, 13))[:, 0]
    assert wrong.max() < 1e-3 and np.median(rms) < 0.01 and np.median(kept[::13] - single) > -0.02
