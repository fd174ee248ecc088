"""Several bodies in a frame, each with a whole number of its own, and bodies with holes."""

import re

import numpy as np
import pytest
from plain_frames import read_free
from scipy.ndimage import label

from isochrome.benchmarks import load_benchmarks

FIELDS = load_benchmarks("outside_fields")
NOISE = 0.04
SHAPE, SAMPLES = (130, 330), 3


def frame(kind, shape=SHAPE, highest=4.0, seed=3):
    """Order at the pixels, body, and the light's means, dark where there is no body."""
    fine, body = FIELDS.order_field(kind, shape, seed, highest=highest, samples=SAMPLES)
    blocks = shape[0], SAMPLES, shape[1], SAMPLES
    wave = np.where(body, np.cos(2.0 * np.pi * fine), 1.0).reshape(blocks).mean(axis=(1, 3))
    middle = np.s_[SAMPLES // 2 :: SAMPLES, SAMPLES // 2 :: SAMPLES]
    wave = wave + NOISE * np.random.default_rng(1).normal(size=shape)
    return fine[middle], body.reshape(blocks).all(axis=(1, 3)), wave


def point(order, body):
    """A place of a body between two lines, well inside, and its order."""
    from scipy.ndimage import distance_transform_edt

    slope = np.hypot(*np.gradient(order))
    between = (np.abs(order % 0.5 - 0.25) < 0.05) & (slope < 0.06)
    depth = np.where(between, distance_transform_edt(body), 0.0)
    row, col = np.unravel_index(depth.argmax(), depth.shape)
    return int(row), int(col), float(order[row, col])


def shares(got, order, body):
    """Share of a body that is known, and of that on a wrong branch."""
    known = np.isfinite(got.reading.order) & body
    error = np.abs(got.reading.order - order)[known]
    return known.sum() / body.sum(), float(np.mean(error > 0.25)) if known.any() else 0.0


@pytest.mark.long
@pytest.mark.parametrize("masked", [True, False])
def test_packed_discs_are_bodies_of_their_own(masked):
    """By a mask, or by the dark about them: two are known by their points, and one is not."""
    order, body, wave = frame("packed discs")
    number, count = label(body)
    assert count == 3
    discs = [number == k for k in (1, 2, 3)]
    known = [point(order, disc) for disc in discs[:2]]
    valid = body if masked else np.ones(SHAPE, dtype=bool)
    got = read_free(wave, np.full(SHAPE, NOISE), valid, known)
    for disc in discs[:2]:
        share, wrong = shares(got, order, disc)
        assert share > 0.7 and wrong == 0.0
    share, wrong = shares(got, order, discs[2])
    assert share == 0.0 if masked else wrong == 0.0
    if masked:
        row, col = map(int, re.search(r"at row (\d+), column (\d+)", got.said[0]).groups())
        assert "no known point" in got.said[0] and discs[2][row, col]
        again = read_free(wave, np.full(SHAPE, NOISE), valid, [*known, point(order, discs[2])])
        share, wrong = shares(again, order, discs[2])
        assert share > 0.7 and wrong == 0.0 and not again.said


def test_two_bodies_a_pixel_apart_do_not_take_each_others_whole_number():
    """Their light goes on across the gap as if they were one; their orders differ by one."""
    rows, cols = np.indices((140, 180))
    bodies = [cols < 88, cols > 88]  # between the middles of two patches, each full enough
    order = 0.3 + cols / 60.0 + rows / 300.0 + bodies[1]
    wave = np.cos(2.0 * np.pi * order) + NOISE * np.random.default_rng(2).normal(size=order.shape)
    known = [(70, 40, float(order[70, 40])), (70, 140, float(order[70, 140]))]
    sigma, valid = np.full(order.shape, NOISE), cols != 88
    both = read_free(wave, sigma, valid, known)
    for body in bodies:
        share, wrong = shares(both, order, body)
        assert share > 0.9 and wrong == 0.0
    one = read_free(wave, sigma, valid, known[:1])
    assert shares(one, order, bodies[0])[0] > 0.9 and shares(one, order, bodies[1])[0] == 0.0
    assert "no known point" in one.said[0]


@pytest.mark.parametrize("kind", ["hole", "ellipse", "thick ring"])
def test_around_a_hole_no_branch_is_wrong(kind):
    order, body, wave = frame(kind, (200, 240))
    got = read_free(wave, np.full(body.shape, NOISE), body, [point(order, body)])
    share, wrong = shares(got, order, body)
    assert share > 0.85 and wrong == 0.0
