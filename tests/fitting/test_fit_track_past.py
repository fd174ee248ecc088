"""The load that wore a contact before its first frame, from that frame."""

import numpy as np
import pytest

from isochrome.fitting import Pixels, local_model, solve_with_gamma
from isochrome.fitting.tracking.tracker import fit_past_load

SIZE, NOISE = 4000, 0.01
PLACE = np.linspace(0.0, 20.0, SIZE)
BY_VALUE, BY_LOAD = 0.3 * np.cos(PLACE), 0.01 * np.sin(PLACE) + 0.007 * np.cos(PLACE)


def moved(load, start):
    """What another load adds to the signal: more than in proportion."""
    away = load - start
    return (away + 0.05 * away**2) * BY_LOAD


def shown(load, value, start, seed):
    """A frame of some load and value, and its model about another load and value 0."""
    signal = (0.5 + 0.4 * np.sin(0.7 * PLACE)).astype(np.float32)
    true = signal + value * BY_VALUE + moved(load, start)
    raw = 0.1 + 0.6 * true + NOISE * np.random.default_rng(seed).standard_normal(SIZE)
    one = np.ones((1, SIZE), np.float32)
    pixels = Pixels(
        raw.astype(np.float32), (one[0] / np.float32(NOISE)), one, one, np.ones((1, SIZE), bool),
        1.0,
    )  # fmt: skip
    gamma_fit = solve_with_gamma(pixels, signal, 1.0)
    rows = (BY_VALUE * gamma_fit.part.amplitude).astype(np.float32)[None]
    return gamma_fit, local_model(("value",), np.zeros(1), gamma_fit, rows)


@pytest.mark.parametrize(("start", "true"), [(44.0, 46.0), (44.0, 41.0), (44.0, 44.0)])
def test_the_load_before_is_found_to_what_the_noise_allows(start, true):
    """Beside a value that takes up a part of its effect: the bound is the Fisher information's."""
    found = []
    for seed in range(20):
        gamma_fit, local = shown(true, 0.02, start, seed)

        def change(load, amplitude=gamma_fit.part.amplitude):
            return (moved(load, start) * amplitude).astype(np.float32)

        found.append(fit_past_load(change, local, gamma_fit.residual, start))
    slope = 0.6 * (1.0 + 0.1 * (true - start)) * BY_LOAD / NOISE
    known = np.stack([BY_VALUE, np.ones(SIZE), np.sin(0.7 * PLACE)])
    alone = slope - known.T @ np.linalg.lstsq(known.T, slope, rcond=None)[0]
    bound = 1.0 / np.sqrt(alone @ alone)
    # twenty of them: their RMS scatters by a sixth; a search rests a fifth of it away at most
    assert np.sqrt(np.mean((np.array(found) - true) ** 2)) < 1.5 * bound


def test_where_the_load_before_changes_nothing_the_start_stays():
    gamma_fit, local = shown(44.0, 0.0, 44.0, 1)
    nothing = np.zeros(SIZE, np.float32)
    assert fit_past_load(lambda load: nothing, local, gamma_fit.residual, 44.0) == 44.0
