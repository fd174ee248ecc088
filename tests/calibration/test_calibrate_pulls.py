"""Pulls of calibrations whose set-up is drawn, and whose inputs' errors are drawn from what the set
states of them."""

import math
import os

import numpy as np
import pytest
from scipy.special import chdtri

from isochrome.calibration import Beam, Uncertainty

from .conftest import BEAM, F_SIGMA, HEIGHT, INNER, OUTER, bending_from_images, bending_load

SHAPE, PIXEL = (150, 170), 0.15
Z_95 = 1.959964


def random_frames(rng, beam_frame):
    """Frames and true loads of one to four loads, 1 to 6 fringes at the edge for the largest."""
    largest = rng.uniform(1.0, 6.0)
    count = rng.integers(1, 5)
    edges = largest * np.linspace(1.0, 0.5, count)
    setup = {
        "tilt": rng.uniform(-4.0, 4.0), "axis_mm": rng.uniform(-1.0, 1.0), "shape": SHAPE,
        "pixel": PIXEL, "noise": rng.uniform(1.0, 6.0), "background": rng.uniform(8.0, 30.0),
    }  # fmt: skip
    return [beam_frame(e, rng, **setup) for e in edges], [bending_load(e) for e in edges]


def value_pull(found):
    return (found.fringe_value_n_per_mm - F_SIGMA) / found.standard_uncertainty


def order_pulls(found, load_of_one):
    """Those of the images' orders, whose load for one fringe is `load_of_one`."""
    return [(i.order - i.load_n / load_of_one) / i.standard_uncertainty for i in found.images]


def calibrated_beam(seed, beam_frame):
    frames, loads = random_frames(np.random.default_rng(seed), beam_frame)
    return bending_from_images(frames, loads, BEAM, PIXEL)


def uncertain_pull(seed, beam_frame):
    """Of one random calibration, whose inputs' uncertainties are negligible to what governs."""
    rng = np.random.default_rng(seed)
    frames, loads = random_frames(rng, beam_frame)
    size = 10.0 ** rng.uniform(-2.0, 0.0, 4)
    known = Uncertainty(
        load_percent=0.5 * size[0], height_mm=0.05 * size[1], span_mm=0.2 * size[2],
        pixel_mm=0.003 * PIXEL * size[3],
    )  # fmt: skip
    beam = Beam(
        height_mm=HEIGHT + rng.normal(0.0, known.height_mm),
        inner_span_mm=INNER + rng.normal(0.0, known.span_mm),
        outer_span_mm=OUTER + rng.normal(0.0, known.span_mm),
    )
    load = 1.0 + 0.01 * rng.normal(0.0, known.load_percent)
    pixel = PIXEL + rng.normal(0.0, known.pixel_mm)
    stated = [p * load for p in loads]
    return value_pull(bending_from_images(frames, stated, beam, pixel, uncertainty=known))


def assert_normal(pulls):
    """Their squares' sum lies between chi-square's 0.1 and 99.9 % points, as with any seeds."""
    total = float(np.sum(np.square(pulls)))
    low, high = chdtri(len(pulls), [0.999, 0.001])
    assert low < total < high, f"root mean square {math.sqrt(total / len(pulls)):.2f}"


@pytest.mark.long
@pytest.mark.parametrize("count", [4, pytest.param(36, marks=pytest.mark.study)])
def test_beams_are_off_by_what_they_say(beam_frame, count):
    """Orders are at h/2, so that a wrong lever, edge or unit is off by hundreds."""
    found = [calibrated_beam(10_000 + seed, beam_frame) for seed in range(count)]
    assert_normal([value_pull(f) for f in found])
    several = [f for f in found if f.order_at_zero_load is not None]
    assert_normal([f.order_at_zero_load / f.order_at_zero_load_uncertainty for f in several])
    # orders of one set share its light, so that fewer are free: one a set is taken
    for one in (0, -1):
        assert_normal([order_pulls(f, bending_load(1.0))[one] for f in found])


@pytest.mark.study
def test_ninety_five_per_cent_of_the_intervals_hold_the_truth(beam_frame):
    """A thousand by ISOCHROME_COVERAGE=1000; the default is what half a minute allows."""
    count = int(os.environ.get("ISOCHROME_COVERAGE", "40"))
    pulls = np.array([uncertain_pull(seed, beam_frame) for seed in range(count)])
    inside = np.mean(np.abs(pulls) <= Z_95)
    # what is asked is 93 to 97 %; a sample of n adds two binomial standard deviations
    room = 0.02 + 2.0 * np.sqrt(0.95 * 0.05 / count)
    assert abs(inside - 0.95) <= room, f"{inside:.1%} of {count}"
    assert abs(np.mean(pulls)) < 4.0 / np.sqrt(count)  # no side is preferred


@pytest.mark.long
@pytest.mark.parametrize("seed", [10_058, 10_080])
def test_dark_edges_of_order_one_are_not_taken_for_what_lies_beyond(beam_frame, seed):
    """The lower load's edges have order 1.08: nearly as dark as the frame outside the beam."""
    found = calibrated_beam(seed, beam_frame)
    assert abs(value_pull(found)) < 4.0
    assert found.standard_uncertainty < 5e-4 * F_SIGMA
