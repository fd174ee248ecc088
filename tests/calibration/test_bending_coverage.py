"""Coverage of the 95 % intervals: the set-up is drawn, and the errors of load, height, spans and
pixel scale from the standard uncertainties that the set states."""

import os

import numpy as np
import pytest

from isochrome.calibration import Beam, Uncertainty

from .conftest import F_SIGMA, HEIGHT, INNER, OUTER, bending_from_images, bending_load

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


def stated(rng):
    """Standard uncertainties of the inputs, each from negligible to what governs the budget."""
    size = 10.0 ** rng.uniform(-2.0, 0.0, 4)
    return Uncertainty(
        load_percent=0.5 * size[0], height_mm=0.05 * size[1], span_mm=0.2 * size[2],
        pixel_mm=0.003 * PIXEL * size[3],
    )  # fmt: skip


def one_pull(seed, beam_frame):
    """(value - truth)/u of one random calibration, whose inputs are off as stated."""
    rng = np.random.default_rng(seed)
    frames, loads = random_frames(rng, beam_frame)
    known = stated(rng)
    beam = Beam(
        height_mm=HEIGHT + rng.normal(0.0, known.height_mm),
        inner_span_mm=INNER + rng.normal(0.0, known.span_mm),
        outer_span_mm=OUTER + rng.normal(0.0, known.span_mm),
    )
    load = 1.0 + 0.01 * rng.normal(0.0, known.load_percent)
    pixel = PIXEL + rng.normal(0.0, known.pixel_mm)
    found = bending_from_images(frames, [p * load for p in loads], beam, pixel, uncertainty=known)
    return (found.fringe_value_n_per_mm - F_SIGMA) / found.standard_uncertainty


@pytest.mark.study
@pytest.mark.long
def test_ninety_five_per_cent_of_the_intervals_hold_the_truth(beam_frame):
    """A thousand by ISOCHROME_COVERAGE=1000; the default is what half a minute allows."""
    count = int(os.environ.get("ISOCHROME_COVERAGE", "40"))
    pulls = np.array([one_pull(seed, beam_frame) for seed in range(count)])
    inside = np.mean(np.abs(pulls) <= Z_95)
    # what is asked is 93 to 97 %; a sample of n adds two binomial standard deviations
    room = 0.02 + 2.0 * np.sqrt(0.95 * 0.05 / count)
    assert abs(inside - 0.95) <= room, f"{inside:.1%} of {count}"
    assert abs(np.mean(pulls)) < 4.0 / np.sqrt(count)  # no side is preferred


@pytest.mark.long
@pytest.mark.parametrize("seed", [10_058, 10_080])
def test_dark_edges_of_order_one_are_not_taken_for_what_lies_beyond(beam_frame, seed):
    """The lower load's edges have order 1.08: nearly as dark as the frame outside the beam."""
    frames, loads = random_frames(np.random.default_rng(seed), beam_frame)
    beam = Beam(height_mm=HEIGHT, inner_span_mm=INNER, outer_span_mm=OUTER)
    found = bending_from_images(frames, loads, beam, PIXEL)
    assert abs(found.fringe_value_n_per_mm - F_SIGMA) < 4 * found.standard_uncertainty
    assert found.standard_uncertainty < 5e-4 * F_SIGMA
