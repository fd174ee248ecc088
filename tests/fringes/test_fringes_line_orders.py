"""Fringe lines found in an image get the order of a reading, or none: truth from closed forms."""

import numpy as np
import pytest

from isochrome.fringes import Skeleton, number_lines, skeletons


def rings(rows=200, cols=240):
    """An order of 4 in the middle that falls with the square of the distance, to 0.1."""
    y, x = np.mgrid[:rows, :cols].astype(float)
    return 4.0 - 0.00016 * ((y - 100.0) ** 2 + (x - 120.0) ** 2)


def test_lines_of_an_image_take_the_order_that_they_lie_on():
    order = rings()
    lines = skeletons(np.sin(np.pi * order) ** 2)
    numbered = number_lines(lines, order)
    assert len(numbered) > 5
    found = {line.order for line in numbered}
    assert found >= {1.5, 2.0, 2.5, 3.0, 3.5}
    for before, line in zip(lines, numbered, strict=True):
        assert np.array_equal(before.rows, line.rows) and before.kind == line.kind
        if line.order is None:
            continue
        assert (line.kind == "dark") == line.order.is_integer()
        radius = np.hypot(line.rows - 100.0, line.cols - 120.0)
        true = np.sqrt(max(0.0, (4.0 - line.order) / 0.00016))
        # the smoothing's shift of curved and unevenly spaced fringes is below half a pixel
        assert np.median(np.abs(radius - true)) < 0.5


@pytest.mark.parametrize(
    ("along", "expected"),
    [
        (np.full(20, 1.5), 1.5),
        (np.full(20, 1.44), 1.5),
        (np.full(20, 1.27), None),  # a crest where the order turns back
        (np.r_[np.full(12, 1.0), np.full(8, 2.0)], None),  # two fringes in one line
        (np.r_[np.full(17, 1.0), np.full(3, 2.0)], 1.0),
        (np.r_[np.full(12, 1.0), np.full(8, np.nan)], 1.0),
        (np.r_[np.full(8, 1.0), np.full(12, np.nan)], None),
        (np.full(20, np.nan), None),
    ],
)
def test_a_line_has_an_order_where_most_of_it_has_that_order(along, expected):
    order = np.full((5, 20), np.nan)
    order[2] = along
    line = Skeleton("dark", np.full(20, 2.2), np.arange(20.0))
    (found,) = number_lines([line], order)
    assert found.order == expected


def test_a_line_on_the_border_is_read_there():
    (found,) = number_lines([Skeleton("dark", np.array([-0.4, 4.4]), np.array([3.0, 3.6]))],
                            np.full((5, 4), 2.0))  # fmt: skip
    assert found.order == 2.0
