"""Fringe centre lines against patterns whose lines are known exactly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isochrome.errors import InputError
from isochrome.fringes import Skeleton, number_lines, order_contours, skeleton_table, skeletons

SHAPE = (247, 330)
ROW, COL = np.indices(SHAPE, dtype=float)
CENTRE = (123.3, 164.6)
NOISE = 3.0 / 255.0


def captured(order, noise=NOISE, seed=0):
    """A dark-field frame of 8 bits with camera noise, as a signal 0..1."""
    signal = np.sin(np.pi * order) ** 2
    signal = signal + noise * np.random.default_rng(seed).standard_normal(order.shape)
    return np.round(255.0 * np.clip(signal, 0.0, 1.0)) / 255.0


def location_errors(lines, position, spacing_px):
    """Signed distance in px of every point to the nearest true line of its kind.
    `position` maps (rows, cols) to px across the fringes, counted from a dark line."""
    parts = []
    for line in lines:
        half_orders = 2.0 * position(line.rows, line.cols) / spacing_px - (line.kind == "bright")
        parts.append((half_orders - 2.0 * np.round(half_orders / 2.0)) * spacing_px / 2.0)
    return np.concatenate(parts)


@pytest.mark.parametrize("spacing", [8.0, 12.0, 25.0, 40.0])
def test_rings_are_located_to_a_fraction_of_a_pixel(spacing):
    def radius(rows, cols):
        return np.hypot(rows - CENTRE[0], cols - CENTRE[1])

    lines = skeletons(captured(radius(ROW, COL) / spacing))
    lines = [each for each in lines if radius(each.rows, each.cols).min() > spacing]
    error = np.abs(location_errors(lines, radius, spacing))
    assert np.median(error) < 0.15 and np.percentile(error, 95) < 0.3
    assert {each.kind for each in lines} == {"dark", "bright"}


@pytest.mark.parametrize(
    ("spacing", "median"), [(8.0, 0.05), (20.0, 0.05), (50.0, 0.15), (100.0, 0.15)]
)
def test_straight_fringes_are_all_found_and_located(spacing, median):
    def across(rows, cols):
        return cols * np.cos(0.4) + rows * np.sin(0.4)

    lines = skeletons(captured(across(ROW, COL) / spacing, seed=1))
    error = location_errors(lines, across, spacing)
    assert np.median(np.abs(error)) < median and abs(error.mean()) < 0.02
    expected = 2.0 * ROW.size / spacing  # px of line: area over the spacing of lines
    found = sum(np.hypot(np.diff(each.rows), np.diff(each.cols)).sum() for each in lines)
    assert found == pytest.approx(expected, rel=0.15)


def test_uneven_curved_fringes_have_no_bias():
    order = (np.hypot(ROW - CENTRE[0], COL - CENTRE[1])) ** 2 / 5000.0
    lines = skeletons(captured(order, noise=0.0))
    rings = 0
    for line in lines:
        radius = np.hypot(line.rows - CENTRE[0], line.cols - CENTRE[1])
        if radius.min() < 30:
            continue
        rings += 1
        half_orders = 2.0 * radius**2 / 5000.0 - (line.kind == "bright")
        error_px = (half_orders - 2 * np.round(half_orders / 2)) / 2 * 5000.0 / (2 * radius)
        assert abs(np.mean(error_px)) < 0.06
    assert rings > 10


@pytest.mark.long
@pytest.mark.parametrize(
    ("level", "noise"), [(0.02, NOISE), (0.5, 0.0), (0.5, NOISE), (0.5, 0.03), (0.9, NOISE)]
)
def test_flat_areas_stay_nearly_empty(level, noise):
    rng = np.random.default_rng(5)
    points = 0
    for _ in range(3):
        flat = level + noise * rng.standard_normal(SHAPE)
        points += sum(each.rows.size for each in skeletons(flat))
    assert points / (3 * ROW.size) < 3e-4  # spurious points a pixel


def test_a_ramp_has_no_line_and_lines_are_ordered():
    assert skeletons(np.round(255 * COL / 400.0) / 255) == []
    lines = skeletons(captured(COL / 30.0))
    # a dark and a bright line every 30 of 330 columns, each about as long as the frame is high
    assert sum(line.rows.size > 200 for line in lines) >= 18
    for line in lines:
        steps = np.hypot(np.diff(line.rows), np.diff(line.cols))
        assert steps.max() < 3.0


def test_unknown_pixels_give_no_line_and_do_not_move_others():
    signal = captured(COL / 25.0, noise=0.0)
    whole = skeletons(signal)
    signal[80:140, 100:200] = np.nan
    rows = np.concatenate([each.rows for each in skeletons(signal)])
    cols = np.concatenate([each.cols for each in skeletons(signal)])
    assert not np.any((rows > 80) & (rows < 139) & (cols > 100) & (cols < 199))
    error = np.abs(location_errors(skeletons(signal), lambda rows, cols: cols, 25.0))
    assert np.percentile(error, 99) < 0.1
    assert rows.size > 0.7 * sum(each.rows.size for each in whole)
    assert skeletons(np.full(SHAPE, np.nan)) == []


def test_order_contours_follow_circles_exactly_and_stop_at_unknown_pixels():
    order = np.hypot(ROW - CENTRE[0], COL - CENTRE[1]) / 20.0
    lines = order_contours(order, [1.0, 2.5, 3.0])
    assert [(each.order, each.kind) for each in lines] == [
        (1.0, "dark"), (2.5, "bright"), (3.0, "dark"),
    ]  # fmt: skip
    for line in lines:
        radius = np.hypot(line.rows - CENTRE[0], line.cols - CENTRE[1])
        assert np.abs(radius - 20.0 * line.order).max() < 0.02
    order = COL / 100.0
    order[:50] = np.nan
    lines = order_contours(order)
    assert [each.order for each in lines] == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    assert all(each.rows.min() >= 50 for each in lines)
    assert order_contours(np.full((5, 5), np.nan)) == []


def test_refusals_name_the_value():
    with pytest.raises(InputError, match="4, 4"):
        skeletons(np.zeros((4, 4)))
    with pytest.raises(InputError, match="fringe-order map"):
        order_contours(np.zeros((4, 1)))


def test_table_places_pixels_in_millimetres():
    lines = [
        Skeleton("dark", np.array([0.0, 1.0]), np.array([2.0, 2.5]), 1.0),
        Skeleton("bright", np.array([4.0]), np.array([5.0])),
    ]
    table = skeleton_table(lines, pixel_mm=0.01, left_mm=-2.0, top_mm=0.5)
    assert list(table) == ["line", "kind", "order", "row_px", "col_px", "x_mm", "z_mm"]
    assert table["line"].tolist() == [0, 0, 1]
    assert table["kind"].tolist() == ["dark", "dark", "bright"]
    np.testing.assert_allclose(table["x_mm"], [-1.975, -1.97, -1.945], rtol=0, atol=1e-12)
    np.testing.assert_allclose(table["z_mm"], [0.505, 0.515, 0.545], rtol=0, atol=1e-12)
    assert np.isnan(table["order"][2]) and np.isnan(skeleton_table(lines)["x_mm"]).all()
    assert all(column.size == 0 for column in skeleton_table([]).values())


@settings(max_examples=12, deadline=None)
@given(gain=st.floats(0.3, 3.0), offset=st.floats(-0.5, 0.5))
def test_brightness_and_contrast_do_not_move_lines(gain, offset):
    signal = np.sin(np.pi * COL[:60, :120] / 20.0) ** 2
    for first, second in zip(skeletons(signal), skeletons(gain * signal + offset), strict=True):
        np.testing.assert_allclose(first.cols, second.cols, rtol=0, atol=1e-6)


def disc_order(rows, cols):
    """Diametral compression along z in closed form, centre order 6, radius 150 px.
    sigma1 - sigma2 is proportional to (1 - x² - z²) / ((x² + z²)² + 1 + 2 (x² - z²)), x and z over
    the radius (Frocht 1948, Photoelasticity II)."""
    x, z = (cols - 170.2) / 150.0, (rows - 160.7) / 150.0
    square = x**2 + z**2
    return 6.0 * (1.0 - square) / (square**2 + 1.0 + 2.0 * (x**2 - z**2))


def bent_order(rows, cols):
    """A beam's |N|, its neutral axis turned by 7 degrees: a kink at N = 0."""
    return np.abs((rows - 150.0) * np.cos(0.12) + (cols - 150.0) * np.sin(0.12)) / 22.0


def distances(line, order):
    """Distance in px of a line's points to the true iso-order line, and the gradient (1/px) there.
    To first order (N - level) / |grad N|, with N and its gradient from the closed form."""
    step = 1e-4
    down = (order(line.rows + step, line.cols) - order(line.rows - step, line.cols)) / (2 * step)
    right = (order(line.rows, line.cols + step) - order(line.rows, line.cols - step)) / (2 * step)
    steep = np.hypot(down, right)
    return np.abs(order(line.rows, line.cols) - line.order) / steep, steep


@pytest.mark.parametrize("order", [disc_order, bent_order])
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_order_lines_lie_within_a_tenth_of_a_pixel_of_the_closed_form(order, noise):
    rows, cols = np.indices((320, 340), dtype=float)
    field = order(rows, cols)
    known = np.hypot(rows - 160.7, cols - 170.2) < 140
    noisy = field + noise * np.random.default_rng(1).standard_normal(field.shape)
    lines = order_contours(np.where(known & (field < 11), noisy, np.nan))
    found = {each.order for each in lines}
    assert {0.5 * n for n in range(1, 11)} <= found
    for line in lines:
        away, steep = distances(line, order)
        # noise of 0.002 fringe moves a line by 0.002 / gradient: 5 deviations are 0.1 px at 0.1;
        # the curvature of N leaves N''/(8 N'), below 0.1 px except in the cones under the loads
        good = steep > (0.1 if noise else 0.02)
        good &= steep < 0.3
        assert away[good].max(initial=0.0) < 0.1


def test_scattered_unknown_pixels_only_interrupt_the_lines():
    rows, cols = np.indices((200, 200), dtype=float)
    field = bent_order(rows, cols)
    lost = np.random.default_rng(2).random(field.shape) < 0.01
    field[lost] = np.where(rows[lost] > 100, np.nan, np.inf)
    lines = order_contours(field)
    for line in lines:
        assert np.isfinite(line.rows).all() and np.isfinite(line.cols).all()
        assert distances(line, bent_order)[0].max() < 1e-6  # N is linear: no other error is left
        for row, col in zip(line.rows, line.cols, strict=True):
            near = lost[int(row) : int(np.ceil(row)) + 1, int(col) : int(np.ceil(col)) + 1]
            assert not near.any()
    whole = order_contours(bent_order(rows, cols))
    length = [
        sum(np.hypot(np.diff(each.rows), np.diff(each.cols)).sum() for each in some)
        for some in (lines, whole)
    ]
    # one square in 25 has an unknown corner
    assert 0.9 * length[1] < length[0] < length[1]
    assert len(order_contours(field, min_length_px=30.0)) < len(lines)


def test_short_lines_of_noise_are_dropped_and_long_ones_kept():
    rows, cols = np.indices((200, 200), dtype=float)
    level = 1.0 + 0.004 * np.random.default_rng(3).standard_normal(rows.shape)
    field = np.where(cols < 100, level, 1.3 + 0.01 * (cols - 100))
    assert len(order_contours(field, [1.0, 1.5])) > 100
    kept = order_contours(field, [1.5], min_length_px=150.0)
    assert len(kept) == 1 and np.abs(kept[0].cols - 120.0).max() < 1e-6


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
