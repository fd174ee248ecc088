"""Orders followed from frame to frame: crests, both ways, and what a state keeps."""

import numpy as np
import pytest

from isochrome.fringes import FilmLight, KeptState, follow_frame, unloaded_state
from isochrome.fringes.film_reading import continued, keep_state, regained

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


@pytest.mark.parametrize("scale", [0.985, 1.0, 1.01])
def test_an_even_region_passes_a_crest_although_its_light_is_not_exact(scale):
    """It comes to the crest all at once, where light that is 1.5 % too weak stands off from it."""
    state = unloaded_state(EVERYWHERE, 0.0)
    loads = np.arange(1, 41) * 0.05
    for frame, load in enumerate(loads, start=1):
        seen = wave(order(load), frame, scale=scale)
        state = follow_frame(state, seen, EVERYWHERE, float(frame), noise=NOISE)
    assert state.known.mean() > 0.8
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


def test_a_kept_state_is_taken_up_again():
    state = unloaded_state(EVERYWHERE, 0.0)
    for frame in range(1, 9):
        seen = wave(order(0.1 * frame), frame)
        state = follow_frame(state, seen, EVERYWHERE, float(frame), noise=NOISE)
    kept = keep_state(state)
    assert isinstance(kept, KeptState)
    again = kept.state()
    assert np.abs(again.order - state.order).max() < 6e-4  # half of its steps of 1e-3
    assert np.array_equal(again.known, state.known) and again.time == state.time
    doubt = np.zeros_like(EVERYWHERE)
    doubt[3, 4] = True
    less = kept.doubting(doubt)
    assert np.array_equal(less.state().known, state.known & ~doubt) and less.doubted == 1


def test_an_order_goes_on_beyond_where_it_is_known_and_a_wave_is_that_of_its_rise():
    zero, two = np.zeros((1, 3)), np.full((1, 3), 2.0)
    light = FilmLight(zero=zero, illumination=two, error=zero, zero_error=zero)
    found = light.wave(np.array([[0.0, 1.0, 2.0]]))
    assert np.allclose(found, [[1.0, 0.0, -1.0]])
    orders, known = tilted(0.06)
    found = continued(np.where(known, orders, 7.0), known)
    edge = COLS // 2
    # gradients are held near to nought by a fiftieth, of a middle three pixels off
    assert np.abs(found - orders)[:, edge : edge + 2].max() < 0.01
    assert np.array_equal(found[known], orders[known]) and (found[:, edge + 10 :] == 7.0).all()


def tilted(slope):
    """Orders that rise along the rows, fringes a pixel, and the left half where they are known."""
    orders = 0.2 + slope * np.arange(COLS, dtype=np.float32) + np.zeros((ROWS, 1), np.float32)
    return orders, np.arange(COLS) < COLS // 2 + np.zeros((ROWS, 1), int)


def test_what_its_light_bears_out_is_regained_and_what_it_speaks_against_not():
    """From a fringe's flank on it is, up to its crest; a film whose fringes move passes those."""
    orders, known = tilted(0.06)
    gained = np.zeros_like(known)
    for start in np.arange(0.0, 0.5, 0.05):
        moved = orders + np.float32(start)
        found, wider = regained(moved * known, known, wave(moved, 3), EVERYWHERE)
        new = wider & ~known
        assert np.abs(found - moved)[new].max(initial=0.0) < 0.03
        crest = np.abs(np.sin(2.0 * np.pi * moved)) < 0.3
        assert not (new & crest).any()
        gained |= new
    assert gained[:, COLS // 2].mean() > 0.95 and not gained[:, COLS // 2 + 4 :].any()
    # beside what is known another body begins, of orders that are a quarter of a fringe apart
    other = np.where(known, orders, orders + 0.25)
    _, wider = regained(orders * known, known, wave(other, 3), EVERYWHERE)
    assert not (wider & ~known).any()
