"""Films without a model: key frames are read from nothing, the others are followed from them."""

from __future__ import annotations

import numpy as np
import pytest
from unloaded_films import WHOLE, LoadedFilm, judged

from isochrome.errors import PhysicsError
from isochrome.processing import process

AXIS = {"known_line": [{"row_px": [61, 62], "col_px": [60, 100], "order": 0.0}]}
"""The neutral axis of the small beam, of order 0 in all frames."""


def test_frames_are_followed_from_a_key_frame_in_the_middle_of_a_film():
    film = LoadedFilm(4)
    numbers = list(range(20, 40))
    found = process(film.frames(numbers), film.scene(**AXIS), track=True, every=15)
    kept, wrong, rms = judged(film, found, numbers).T
    assert wrong.max() == 0.0
    assert kept.min() > 0.6
    assert rms.max() < 0.02
    assert "key frame" in found.table["warnings"][0]


@pytest.mark.long
def test_orders_are_read_anew_after_a_gap():
    film = LoadedFilm(4)
    numbers = [*range(20, 26), *range(36, 42)]
    found = process(film.frames(numbers), film.scene(**AXIS), track=True)
    kept, wrong, _ = judged(film, found, numbers).T
    assert wrong.max() == 0.0
    assert kept.min() > 0.6
    assert "read anew in frame 6" in found.table["warnings"][6]


def test_a_film_in_which_nothing_can_be_read_says_so():
    film = LoadedFilm(4)
    with pytest.raises(PhysicsError, match="no order could be read in any of the frames"):
        process(film.frames(range(1)), film.scene(**AXIS), track=True)


@pytest.mark.long
@pytest.mark.study
def test_a_followed_film_keeps_what_single_frames_keep():
    """The issue's row: RMS below .01, wrong below .1 %, kept within 2 % of single frames'."""
    film = LoadedFilm(4, WHOLE)
    numbers = list(range(20, 60))
    axis = {"known_line": [{"row_px": [246, 247], "col_px": [200, 400], "order": 0.0}]}
    images = film.frames(numbers)
    kept, wrong, rms = judged(film, process(images, film.scene(**axis), track=True), numbers).T
    alone = process(images[::13], film.scene(**axis))
    single = judged(film, alone, numbers[::13])[:, 0]
    assert wrong.max() < 1e-3
    assert np.median(rms) < 0.01
    assert (kept[::13] > single - 0.02).all()
