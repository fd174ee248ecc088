"""Points of known order: on lines and between them, one among many that is wrong, open questions.
Each frame is a formula's; what is known of it is what the formula says at the point."""

import re

import numpy as np
import pytest
from plain_frames import COLS, ROWS, SHAPE, SLOPE, assert_kept, read

from isochrome.benchmarks import load_benchmarks


def at(order, row, col, off=0.0):
    return row, col, float(order[row, col]) + off


def on_line(order, level, row=80):
    """The pixel of a row that is nearest to a line, stated as the line."""
    return row, int(np.abs(order[row] - level).argmin()), level


@pytest.mark.parametrize("level", [2.0, 1.5])
def test_a_point_on_a_line_does_not_say_the_side(level):
    """An order that lies on a line once gave 98 % of wrong pixels."""
    got = read(SLOPE, [on_line(SLOPE, level)])
    assert not np.isfinite(got.reading.order).any()
    (said,) = got.said
    assert "cannot decide on which side" in said
    row, col, one, other = re.search(
        r"at row (\d+), column (\d+): ([\d.]+) or ([\d.]+)", said
    ).groups()
    # one of the two answers is the truth at the place that is asked for
    true = SLOPE[int(row), int(col)]
    assert min(abs(true - float(one)), abs(true - float(other))) < 0.05
    assert float(other) - float(one) > 0.2
    # and that answer settles it
    assert_kept(
        read(SLOPE, [on_line(SLOPE, level), at(SLOPE, int(row), int(col))]), SLOPE, 0.95, 0.05
    )


def test_points_on_two_lines_say_the_side_and_two_that_contradict_leave_nothing_known():
    assert_kept(read(SLOPE, [on_line(SLOPE, 2.0), on_line(SLOPE, 2.5)]), SLOPE, 0.95, 0.05)
    got = read(SLOPE, [at(SLOPE, 20, 40), at(SLOPE, 130, 100, 1.0)])
    assert not np.isfinite(got.reading.order).any() and "contradict each other" in got.said[0]


@pytest.mark.parametrize("off", [1.0, -1.0])
@pytest.mark.parametrize("others", [2, 3])
def test_among_several_points_a_wrong_one_is_named_and_the_rest_stand(off, others):
    right = [at(SLOPE, 20, 40), at(SLOPE, 130, 100), at(SLOPE, 60, 190)][:others]
    wrong = at(SLOPE, 90, 125, off)
    got = read(SLOPE, [wrong, *right])
    assert_kept(got, SLOPE, 0.95, 0.05)
    assert got.misses == (wrong,)
    (said,) = got.said
    assert f"contradicted by {others} others" in said and f"{SLOPE[90, 125]:.2f}" in said


def test_an_order_that_the_light_has_nowhere_near_is_told_with_what_it_has():
    row, col, level = on_line(SLOPE, 1.5)
    true, wrong = float(SLOPE[row, col]), (row, col, level + 0.3)
    got = read(SLOPE, [wrong])
    assert got.misses == (wrong,) and "fits no fringe there" in got.said[0]
    assert f"{true:.2f}" in got.said[0]
    valid = COLS < 150
    outside = read(SLOPE, [at(SLOPE, 80, 190)], valid=valid)
    assert "outside the specimen" in outside.said[0]
    rough = np.where(COLS < 150, SLOPE, np.random.default_rng(0).uniform(0.0, 1.0, SHAPE))
    unfollowed = read(rough, [at(SLOPE, 80, 190)])
    assert "no fringe could be followed there" in unfollowed.said[0]


def flat_valley():
    """N touches 1 along a line and no more: beyond it the light leaves two answers."""
    return 1.0 + 6e-5 * (ROWS - 80.0) ** 2


def test_an_open_seam_is_named_with_the_point_that_closes_it_either_way():
    order = flat_valley()
    got = read(order, [at(order, 5, 110)], noise=0.13)
    (said,) = got.said
    assert "goes on or turns back at the line of order 1" in said
    row, col = map(int, re.search(r"at row (\d+), column (\d+)", said).groups())
    assert row > 80
    assert_kept(read(order, [at(order, 5, 110), at(order, row, col)], noise=0.13), order, 0.8, 0.05)
    # the light of 1 + b y² is that of 1 + b y |y|: the point says which it is
    for order in (flat_valley(), 1.0 - 6e-5 * (ROWS - 80.0) * np.abs(ROWS - 80.0)):
        points = [at(order, 5, 110), at(order, 154, 110)]
        got = read(order, points, noise=0.13)
        assert_kept(got, order, 0.8, 0.05)
        assert not got.misses


def test_a_line_of_order_nought_is_no_answer_unless_a_point_says_so():
    """A hill of 1.2: its rim's 0 is known, and read wrongly its closed line of 1 would be 0."""
    order = np.abs((COLS - 110.0) / 60.0)
    # what is known lies on lines: with 0 in the middle the map has its line of nought by right
    right = read(order, [(80, 110, 0.0), at(order, 80, 150)])
    assert_kept(right, order, 0.9, 0.05)
    # the same light, and 1 instead of 0 along the middle: on a line, and two answers
    got = read(1.0 - order, [(80, 110, 1.0)])
    assert not np.isfinite(got.reading.order).any() and got.said


FIELDS = load_benchmarks("outside_fields")


@pytest.mark.parametrize("kind", [name for name in FIELDS.KINDS if name != "bowl"])
def test_the_fields_of_the_study_are_those_of_elastic_bodies(kind):
    """Equilibrium without body forces and compatibility: e is linear in the conjugate place."""
    rng = np.random.default_rng(5)
    w = rng.uniform(-0.9, 0.9, 300) + 1j * rng.uniform(-0.7, 0.7, 300)
    h = 1e-4

    def field(shift):
        return FIELDS.KINDS[kind](w + shift, np.random.default_rng(3))[0]

    here, body = FIELDS.KINDS[kind](w, np.random.default_rng(3))
    xx = (field(h) - 2.0 * here + field(-h)) / h**2
    yy = (field(1j * h) - 2.0 * here + field(-1j * h)) / h**2
    xy = (field(h + 1j * h) - field(h - 1j * h) - field(-h + 1j * h) + field(-h - 1j * h)) / (
        4.0 * h**2
    )
    bent = np.abs(xx - yy + 2j * xy)[body]
    size = (np.abs(xx) + np.abs(yy) + np.abs(xy) + np.abs(here))[body]
    # second differences of step h: h² of the fourth derivative, and rounding over h²
    assert np.max(bent / size) < 1e-4


def test_an_elliptic_holes_rim_is_free():
    """On the rim stress runs along it: e turns with the tangent t as -conj(t²)."""
    turn = np.linspace(0.0, 2.0 * np.pi, 60) + 0.01
    for m in (0.0, 0.4, 0.7):
        s = (1.0 + 1e-7) * np.exp(1j * turn)
        tangent = 1j * s * (1.0 - m / s**2)
        tangent /= np.abs(tangent)
        along = -FIELDS._ellipse(s + m / s, m, 0.7) * tangent**2
        assert np.abs(along.imag).max() < 1e-5 * np.abs(along).max()
