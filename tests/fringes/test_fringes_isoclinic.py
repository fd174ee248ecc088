"""The isoclinic's uncertainty covers its error: stepped sets of closed forms, by Jones products."""

from functools import lru_cache

import numpy as np
import pytest
from closed_forms import disc, grey, point_load, step_light, valley
from test_fringes_branch import rms

from isochrome.fringes import ResidualStress, read_steps
from stepped_sets import CIRCULAR, TEN, chains_at

SHAPE = (150, 190)
SIGMA = np.sqrt(3.0**2 + 1.0 / 12.0) / 255.0
"""Three grey levels, and rounding."""

FIELDS = {
    # isotropic points and a valley of the order near N = 0 beside them
    "leaning force": point_load(SHAPE, load=55.0, bulk=-0.8, tilt_deg=16.0),
    # sigma_1 turns over by 90 degrees within three pixels, at an order of 0.01 to 0.03
    "valley": valley(SHAPE, slope=0.016, lowest=0.012),
    # N = 0 all along the rim
    "disc": disc(SHAPE, 72.0, 2.2),
}


EDGE = np.ones(SHAPE, dtype=bool)
EDGE[1:-1, 1:-1] = False


@lru_cache
def reading(name, angles, seed, stated=1.0):
    """A field's order and the reading's isoclinic: its error and uncertainty, degrees.
    `stated`, share of the noise that the reading is told."""
    field, rng = FIELDS[name], np.random.default_rng([seed, 31])
    inside = np.isfinite(field)
    shown = np.where(inside, field, 0.0)
    light = np.stack([grey(step_light(shown, four), 3.0, rng) for four in angles])
    order = np.where(inside, np.abs(field), np.nan)
    places = [np.unravel_index(np.nanargmin(np.abs(order - n)), SHAPE) for n in (0.7, 1.3)]
    known = [(int(row), int(col), float(order[row, col])) for row, col in places]
    found = read_steps(
        light, chains_at(angles), sigma=stated * SIGMA, valid=inside, known_order=known
    )
    turn = (found.isoclinic - 0.5 * np.degrees(np.angle(field)) + 90.0) % 180.0 - 90.0
    return order, turn, found.isoclinic_uncertainty


def pulls(order, turn, uncertainty):
    """Pulls of all pixels, of those near whole orders, near none, and on the frame's border."""
    whole = np.abs(order - np.rint(order)) < 0.05
    places = np.isfinite(order), whole & (order > 0.5), order < 0.1, EDGE & (order > 0.1)
    return [(turn / uncertainty)[place & np.isfinite(turn)] for place in places]


@pytest.mark.parametrize(
    ("name", "angles"),
    [(name, tuple(TEN)) for name in FIELDS] + [("leaning force", tuple(CIRCULAR))],
    ids=[*FIELDS, "leaning force, six steps"],
)
def test_the_isoclinics_error_is_as_large_as_its_uncertainty_says(name, angles):
    """Over two seeds, near isotropic points, whole orders and the border as everywhere."""
    seeds = [reading(name, angles, seed) for seed in (0, 1)]
    for order, turn, uncertainty in seeds:
        known = np.isfinite(turn)
        # a tenth of the disc's pixels lie where N < 0.1 and no direction is told to 2 degrees
        assert np.count_nonzero(known) > 0.95 * np.count_nonzero(np.isfinite(order))
        assert (np.isfinite(uncertainty) == known).all()
        # noise of 1.4 % in a window of 32 pixels: 0.05 degree at best
        assert np.nanmin(uncertainty) > 0.03
    everywhere, *places = (
        np.concatenate(parts) for parts in zip(*(pulls(*seed) for seed in seeds), strict=True)
    )
    assert 0.9 < rms(everywhere) < 1.1
    # the largest of 30 000 normal deviates is 4.2; some errors are of the window and not of noise
    assert np.abs(everywhere).max() < 6.0
    whole, low, edge = places
    assert min(whole.size, low.size) > 100
    assert (edge.size == 0) == (name == "disc")  # which does not reach the border
    for place in (part for part in places if part.size):
        # a few hundred neighbours that share their noise: 0.75 to 1.17 over eight seeds
        assert 0.6 < rms(place) < 1.35


def test_the_isoclinic_is_as_uncertain_as_the_light_scatters_not_as_was_stated():
    """Less noise is stated: the misfit of ten steps with seven unknowns tells the rest.
    Of half the noise chi were 2, which may be wrong steps as well: no direction is told then."""
    order, turn, uncertainty = reading("disc", tuple(TEN), 0, stated=0.8)
    (everywhere, *_) = pulls(order, turn, uncertainty)
    assert 0.9 < rms(everywhere) < 1.15


def test_what_is_not_known_of_a_residual_stress_is_not_known_of_the_load():
    """A residual stress of nil, known to 0.02 fringe: no order of the load is known better."""
    field, rng = FIELDS["leaning force"], np.random.default_rng(3)
    light = np.stack([grey(step_light(field, four), 3.0, rng) for four in TEN])
    nil = ResidualStress(np.zeros(SHAPE, complex), np.full(SHAPE, 0.02), 1.0, ())
    known = [(*np.unravel_index(np.abs(np.abs(field) - n).argmin(), SHAPE), n) for n in (0.7, 1.3)]
    found = read_steps(light, chains_at(TEN), sigma=SIGMA, residual=nil, known_order=known)
    assert np.isfinite(found.order).mean() > 0.9
    assert 0.02 <= np.nanmin(found.reading.uncertainty) < 0.021
    # a direction is told to 2 degrees where the order is 0.02/(2 sin 2) = 0.29 at least
    assert np.abs(field)[np.isfinite(found.isoclinic)].min() > 0.25


def test_no_direction_is_told_where_the_loads_order_is_within_its_noise_of_zero():
    """The load is 0.006 fringe beside a residual stress of 0.3 that turns by 3° a pixel.
    At the frame's ends the turning is seen from one side: what is left there of the residual
    stress is as large as the load, and turns its direction by up to 90°."""
    turning = np.exp(0.1j * np.indices((60, 120))[1])
    shown, load = 0.3 * turning, 0.006j * turning
    light = np.stack([step_light(shown, four) for four in TEN])
    light += 3e-4 * np.random.default_rng(0).standard_normal(light.shape)
    found = read_steps(
        light, chains_at(TEN), sigma=3e-4,
        residual=ResidualStress(shown - load, np.full(shown.shape, 1e-5), 1.0, ()),
        known_order=[(30, 60, 0.3)],
    )  # fmt: skip
    turn = (found.isoclinic - 0.5 * np.degrees(np.angle(load)) + 90.0) % 180.0 - 90.0
    assert np.isfinite(found.order).all() and np.isfinite(turn).mean() > 0.7
    # 4.5 times what is said of the noise is 0.6°, and 1.3° are measured; without a bar, 89°
    assert np.nanmax(np.abs(turn)) < 4.0
