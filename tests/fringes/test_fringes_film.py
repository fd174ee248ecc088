"""Orders followed from frame to frame: crests, both ways, and what a state keeps."""

from __future__ import annotations

import numpy as np
import pytest

from isochrome.fringes import (
    FilmLight,
    FilmPath,
    KeptState,
    follow_frame,
    light_wave,
    unloaded_state,
)
from isochrome.fringes.film.film_path import keep_state

ROWS, COLS = 90, 120
NOISE = 0.02
EVERYWHERE = np.ones((ROWS, COLS), dtype=bool)


def order(load, *, steep=3.0):
    """Orders up to `load`, nearly even in the right half."""
    x = np.linspace(0.0, 1.0, COLS)
    shape = np.where(x < 0.5, 1.0 - steep * 0.25 * x, 1.0 - steep * 0.125 + 0.02 * (0.5 - x))
    return load * np.broadcast_to(shape, (ROWS, COLS))


def wave(orders, frame, *, scale=1.0):
    """cos 2 pi N with noise; `scale`, the true illumination over the one that is taken for it."""
    noise = NOISE * np.random.default_rng([frame, 5]).standard_normal(orders.shape)
    signal = 0.5 - 0.5 * np.cos(2 * np.pi * orders)
    return (1.0 - 2.0 * scale * signal + noise).astype(np.float32)


def light_of(orders, frame):
    return (0.5 - 0.5 * wave(orders, frame)).astype(np.float32)


def even_light():
    """Light of a black background and an illumination of 1, exactly known."""
    none = np.zeros((ROWS, COLS), dtype=np.float32)
    return FilmLight(zero=none, illumination=none + 1.0, error=none, zero_error=none)


@pytest.mark.parametrize("scale", [0.985, 1.0, 1.01])
def test_an_even_region_passes_a_crest_although_its_light_is_not_exact(scale):
    """It comes to the crest all at once, where light that is 1.5 % too weak stands off from it."""
    state = unloaded_state(EVERYWHERE, 0.0)
    loads = np.arange(1, 41) * 0.05
    for frame, load in enumerate(loads, start=1):
        seen = wave(order(load), frame, scale=scale)
        state = follow_frame(state, seen, EVERYWHERE, float(frame), noise=NOISE)
    assert state.known.mean() > 0.95
    error = np.abs(state.order - order(loads[-1]))[state.known]
    assert error.max() < 0.1


def test_a_rate_is_that_of_time_and_not_of_frames():
    state = unloaded_state(EVERYWHERE, 0.0)
    time = 0.0
    for frame in range(1, 13):
        apart = 0.5 if frame % 3 else 1.5
        time += apart
        state = follow_frame(state, wave(order(0.1 * time), frame), EVERYWHERE, time, noise=NOISE)
    inside = state.rate[20:-20, 20:-20]
    assert np.abs(inside - order(0.1)[20:-20, 20:-20]).max() < 0.02


def test_where_both_ways_differ_nothing_is_known():
    """In a strip of its own the order rises to 0.45 and on; its light is then that of a fall."""
    light = even_light()
    path = FilmPath(unloaded_state(EVERYWHERE, 0.0), light, noise=NOISE, chunk=8)
    loads = np.minimum(np.arange(17) * 0.08, 1.0)
    frames = []
    for frame, load in enumerate(loads):
        orders = order(load).copy()
        if frame in (5, 6, 7):  # another picture for three frames, as a passing thing makes it
            orders[30:60, 70:110] = orders[30:60, 70:110] + 0.3 * (frame - 4)
        frames.append((light_of(orders, frame), EVERYWHERE, float(frame)))
    path.follow(frames)
    later = path.kept[16].state()
    truth = order(loads[16])
    wrong = np.abs(later.order - truth) > 0.25
    assert not (wrong & later.known).any()
    assert later.known[5:25, 5:50].all()


def test_a_kept_state_is_taken_up_again():
    state = unloaded_state(EVERYWHERE, 0.0)
    for frame in range(1, 9):
        seen = wave(order(0.1 * frame), frame)
        state = follow_frame(state, seen, EVERYWHERE, float(frame), noise=NOISE)
    kept = keep_state(state)
    assert isinstance(kept, KeptState)
    again = kept.state()
    assert np.abs(again.order - state.order).max() < 6e-4  # half of its steps of 1e-3
    assert np.array_equal(again.known, state.known)
    assert again.time == state.time
    doubt = np.zeros_like(EVERYWHERE)
    doubt[3, 4] = True
    assert np.array_equal(kept.doubting(doubt).doubt(), doubt)
    assert kept.doubting(doubt).doubts == 1


def test_a_wave_is_that_of_its_rise():
    found = light_wave(np.array([[0.0, 1.0, 2.0]]), np.array([[2.0, 2.0, 2.0]]))
    assert np.allclose(found, [[1.0, 0.0, -1.0]])
