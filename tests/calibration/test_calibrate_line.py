"""Orders against loads 1 to 4 that leave a line by a (+1, -1, -1, +1), orthogonal to the load and
to a constant: the line through them is the true one, and all sums are short."""

import math
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from isochrome.calibration import (
    BudgetItem,
    Calibration,
    ImageFit,
    Input,
    fit_line,
    uncertainty_budget,
    widened_to_held_out,
)
from isochrome.errors import PhysicsError

from .conftest import BEAM, F_SIGMA, bending_from_images, bending_load

LOADS = np.arange(1.0, 5.0)
PATTERN = np.array([1.0, -1.0, -1.0, 1.0])
SPREAD_OF_LOADS = 5.0
"""sum (P - mean)^2 = 2 (1.5^2 + 0.5^2)."""


def bent_line(a, u):
    return fit_line(LOADS, 0.5 * LOADS + 0.1 + a * PATTERN, u * np.ones(4))


def test_scatter_is_that_of_paule_and_mandel():
    """Paule & Mandel (1982), J. Res. Natl. Bur. Stand. 87, 377-385, eq. 11: sum w (n - line)^2 = n
    - 2 (not 3), w = 1/(u^2 + t^2). Equal u: t^2 = 2 a^2 - u^2."""
    a, u = 0.02, 0.01
    line = bent_line(a, u)
    scatter = math.sqrt(2.0 * a**2 - u**2)
    assert line.scatter == pytest.approx(scatter, rel=1e-9)
    assert line.slope == pytest.approx(0.5, rel=1e-9)
    assert line.intercept == pytest.approx(0.1, rel=1e-9)
    assert line.slope_noise == pytest.approx(u / math.sqrt(SPREAD_OF_LOADS), rel=1e-9)
    wide = math.hypot(u, scatter)
    assert line.slope_uncertainty == pytest.approx(wide / math.sqrt(SPREAD_OF_LOADS), rel=1e-9)
    # u(intercept)^2 = s^2 (1/n + mean^2/sum (P - mean)^2)
    ends = wide * math.sqrt(0.25 + 2.5**2 / SPREAD_OF_LOADS)
    assert line.intercept_uncertainty == pytest.approx(ends, rel=1e-9)


def test_scatter_of_orders_that_are_not_equally_sure():
    """Outer orders u, inner v: chi^2 = 8 a^2 w w'/(w + w') = 2, so 4 a^2 = u^2 + v^2 + 2 t^2. A
    mean of plain squares would give 2 a^2 - u^2."""
    a, u, v = 0.02, 0.01, 0.004
    spread = np.array([u, v, v, u])
    line = fit_line(LOADS, 0.5 * LOADS + 0.1 + a * PATTERN, spread)
    assert line.scatter == pytest.approx(math.sqrt(2.0 * a**2 - 0.5 * (u**2 + v**2)), rel=1e-9)
    assert line.slope == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize(("chi_square", "some"), [(5.9, False), (6.1, True)])
def test_scatter_begins_at_the_95_per_cent_point(chi_square, some):
    """Of two degrees of freedom chi-square is exponential: its 95 % point is -2 ln 0.05 = 5.991."""
    assert -2.0 * math.log(0.05) == pytest.approx(5.991, abs=1e-3)
    u = 0.01
    a = u * math.sqrt(chi_square / 4.0)
    line = bent_line(a, u)
    assert (line.scatter > 0.0) == some
    assert (line.slope_uncertainty > line.slope_noise * (1.0 + 1e-9)) == some


@pytest.mark.parametrize(("chi_square", "some"), [(3.7, False), (4.0, True)])
def test_scatter_of_three_orders_begins_at_a_95_per_cent_point_too(chi_square, some):
    """One degree of freedom: 1.96 squared = 3.841; (1, -2, 1) is orthogonal to any line."""
    u = 0.01
    orders = 0.5 * LOADS[:3] + u * math.sqrt(chi_square / 6.0) * np.array([1.0, -2.0, 1.0])
    line = fit_line(LOADS[:3], orders, np.full(3, u))
    assert (line.scatter > 0.0) == some
    if some:
        assert math.hypot(line.scatter, u) == pytest.approx(u * math.sqrt(chi_square), rel=1e-9)


def test_two_orders_have_no_scatter_and_one_no_intercept():
    """Nothing is left to judge them by: two unknowns, two orders."""
    two = fit_line([1.0, 3.0], [0.5, 1.9], [0.01, 0.02])
    assert two.scatter == 0.0 and two.left_out is None
    assert (two.slope, two.intercept) == pytest.approx((0.7, -0.2))
    assert two.slope_uncertainty == pytest.approx(math.hypot(0.01, 0.02) / 2.0)
    one = fit_line([2.0], [1.0], [0.01])
    assert one.slope == pytest.approx(0.5) and one.slope_uncertainty == pytest.approx(0.005)
    assert one.intercept is None and one.intercept_uncertainty is None


def test_orders_of_one_light_lean_on_each_other():
    """A common error does not average: covariance c^2 n n^T + v^2, n = k P, makes u(k)^2 = (c k)^2
    + v^2/sum (P - mean)^2; the intercept has v's part alone."""
    orders = 0.5 * LOADS
    common, own = 0.01, 0.002
    covariance = common**2 * np.outer(orders, orders) + own**2 * np.eye(4)
    line = fit_line(LOADS, orders, covariance)
    expected = math.hypot(common * 0.5, own / math.sqrt(SPREAD_OF_LOADS))
    assert line.slope_noise == pytest.approx(expected, rel=1e-9)
    ends = own * math.sqrt(0.25 + 2.5**2 / SPREAD_OF_LOADS)
    assert line.intercept_uncertainty == pytest.approx(ends, rel=1e-9)


def test_each_order_is_predicted_by_the_other_loads():
    """Leaving out the first of P = 1, 2, 3 with n = 1, 4, 5: the line 4 + (P - 2) gives 3."""
    line = fit_line([1.0, 2.0, 3.0], [1.0, 4.0, 5.0], [0.1, 0.1, 0.1])
    assert line.left_out == pytest.approx((3.0, 3.0, 7.0))
    twice = fit_line([1.0, 1.0, 2.0], [1.0, 1.0, 2.0], [0.1, 0.1, 0.1])
    assert twice.left_out is None  # without the last there is one load only


@pytest.fixture(scope="module")
def off_the_line(beam_frame):
    """Four beams whose orders leave the line of their loads by 0.03 in the pattern above."""
    rng = np.random.default_rng(3)
    orders = LOADS + 0.5
    images = [beam_frame(edge, rng, shape=(64, 80), pixel=0.36) for edge in orders + 0.03 * PATTERN]
    return bending_from_images(images, bending_load(orders), BEAM, 0.36)


def test_repeated_images_scatter_through_the_front_door(off_the_line):
    """t = sqrt(2) 0.03 fringe of four orders; with the root mean square or n - 1 less by 18 %."""
    parts = {b.name: b for b in off_the_line.budget}
    scatter = F_SIGMA * math.sqrt(2.0) * 0.03 / math.sqrt(SPREAD_OF_LOADS)
    # an order's own uncertainty is 1 % of that; in four seeds it moves the scatter by 0.4 % at most
    found = parts["scatter across loads"].contribution_n_per_mm
    assert found == pytest.approx(scatter, rel=0.01)
    noise = parts["image noise and fit"].contribution_n_per_mm
    assert noise < 0.02 * scatter
    total = off_the_line.standard_uncertainty
    # the held-out loads ask for some more: the lowest is 3 times its uncertainty off the others
    more = parts["held-out loads"].contribution_n_per_mm
    # and such scatter leaves some creep between images open
    creep = parts["creep between images"].contribution_n_per_mm
    parts_of_it = math.sqrt(found**2 + noise**2 + more**2 + creep**2)
    assert total == pytest.approx(parts_of_it, rel=1e-3)
    assert creep < 0.3 * found
    assert more < found
    assert parts["scatter across loads"].share == pytest.approx((found / total) ** 2, rel=1e-9)
    assert abs(off_the_line.fringe_value_n_per_mm - F_SIGMA) < 4.0 * noise


def fits(orders, u=1e-3):
    """Images at loads 1, 2, 3 … that were fitted to these orders."""
    return [
        ImageFit(file=f"{i}.tif", load_n=i + 1.0, order=float(n), standard_uncertainty=u, chi=1.5)
        for i, n in enumerate(orders)
    ]


def test_an_error_that_all_orders_share_does_not_average_out():
    """Twelve orders, each 1 % off: taken apart, sqrt(sum (w N)^2) of it; alike, the whole 1 %."""
    orders = np.arange(1.0, 13.0)
    alike = np.outer(orders, orders) * 1e-4 + 1e-12 * np.eye(12)
    found = uncertainty_budget("beam", fits(orders), 1.0, (), covariance=alike)
    parts = {b.name: b for b in found.budget}
    assert parts["image noise and fit"].standard_uncertainty == pytest.approx(0.01, rel=1e-4)
    assert found.order_at_zero_load_uncertainty < 1e-5


def test_the_shares_are_parts_of_the_variance():
    """3 % of load and 4 % of height make 5 %: shares of 0.36 and 0.64, not of 3/7 and 4/7."""
    inputs = (Input("load", 3.0, "%", 0.01), Input("height", 0.4, "mm", 0.1))
    found = uncertainty_budget("beam", fits(LOADS[:2], u=1e-9), 1.0, inputs)
    parts = {b.name: b for b in found.budget}
    assert found.standard_uncertainty == pytest.approx(0.05, rel=1e-6)
    assert parts["load"].share == pytest.approx(0.36, rel=1e-6)
    assert parts["height"].share == pytest.approx(0.64, rel=1e-6)


@pytest.mark.parametrize(
    ("orders", "refused"),
    [
        # three: the middle one leaves the line through all by two thirds of what it is moved
        ((1.0, 2.1, 3.0), False),  # 0.067 of a range of 2 is 3.3 %
        ((1.0, 2.15, 3.0), True),  # 0.1 of 2 is 5 %
        # two: the line passes the origin by so much
        ((1.4, 1.8), True),  # 1.0 at zero load, more than a quarter of 1.8
        ((1.2, 2.0), False),  # 0.4, less than a quarter of 2.0
        # four: the last is off the other loads' line
        ((1.0, 2.0, 3.0, 4.25), False),  # 0.25 of a range of 3.25 is 8 %
        ((1.0, 2.0, 3.0, 4.45), True),  # 0.45 of 3.45 is 13 %
    ],
)
def test_a_line_that_is_none_is_refused(orders, refused):
    with pytest.raises(PhysicsError, match="check") if refused else nullcontext():
        assert len(uncertainty_budget("beam", fits(orders), 1.0, ()).images) == len(orders)


@pytest.mark.parametrize(
    ("factor", "refused"), [(0.02, True), (0.04, False), (1900.0, False), (2100.0, True)]
)
def test_a_fringe_value_that_no_material_has_is_refused(factor, refused):
    """Gelatine to glass: 0.03 to 2000 N/mm."""
    with pytest.raises(PhysicsError, match="no photoelastic") if refused else nullcontext():
        found = uncertainty_budget("beam", fits(LOADS), factor, ())
        assert found.fringe_value_n_per_mm == pytest.approx(factor)


def calibration_of(orders, uncertainty, spread=1e-3):
    """A calibration of loads 100 to 600 N with these orders."""
    images = [
        ImageFit(
            file=f"{i}.tif", load_n=100.0 * (i + 1), order=n, standard_uncertainty=spread, chi=1.0
        )
        for i, n in enumerate(orders)
    ]
    line = fit_line([i.load_n for i in images], orders, [spread] * len(orders))
    predicted = zip(images, line.left_out, line.left_out_uncertainty, strict=True)
    images = [replace(i, predicted_order=p, predicted_uncertainty=u) for i, p, u in predicted]
    return Calibration(
        specimen="beam", fringe_value_n_per_mm=14.6, standard_uncertainty=14.6 * uncertainty,
        chi=1.0, order_at_zero_load=0.0, order_at_zero_load_uncertainty=spread,
        slope_per_n=line.slope, images=tuple(images), warnings=(),
        budget=(BudgetItem("image noise and fit", 1.0, "", 14.6 * uncertainty, 1.0),),
    )  # fmt: skip


def test_a_held_out_load_that_contradicts_the_value_widens_it():
    """Five loads on a line, the third off by 5 %: another line cannot tell it better than that."""
    orders = [0.5 * (i + 1) for i in range(6)]
    orders[2] *= 1.05
    found = widened_to_held_out(calibration_of(orders, 0.001))
    # it is off the others' line by 0.075 of 1.575, which are three standard uncertainties then
    assert found.standard_uncertainty / 14.6 >= 0.075 / 1.575 / 3.0 * 0.99
    for image in found.images:
        off = abs(image.order - image.predicted_order)
        assert off < 3.001 * image.predicted_uncertainty
    assert found.budget[-1].name == "held-out loads"
    assert sum(item.share for item in found.budget) == pytest.approx(1.0)
    assert "2.tif at 300 N" in found.warnings[0]


def test_held_out_loads_that_agree_change_nothing():
    orders = [0.5 * (i + 1) for i in range(6)]
    orders[2] *= 1.05
    enough, exact = calibration_of(orders, 0.03), calibration_of([0.5, 1.0, 1.5], 0.001)
    for before in (enough, exact):
        found = widened_to_held_out(before)
        assert found.standard_uncertainty == before.standard_uncertainty
        assert found.budget == before.budget and not found.warnings
