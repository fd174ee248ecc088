"""Bayes' information criterion chooses the polynomial that the values were made of."""

import numpy as np
import pytest

from isochrome.estimation import evidence_gain

PIXELS = 2000


def mean_square(degree, y):
    x = np.linspace(-1.0, 1.0, y.size)
    basis = np.polynomial.legendre.legvander(x, degree)
    residual = y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
    return float(np.mean(residual**2)), degree + 1


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_nested_polynomials_are_told_apart(degree):
    """The right degree wins over every other; a spurious term is rarely worth ln n = 7.6."""
    rng = np.random.default_rng(3)
    x = np.linspace(-1.0, 1.0, PIXELS)
    wrong = 0
    for _ in range(100):
        truth = np.polynomial.legendre.legval(x, np.full(degree + 1, 0.3))
        y = truth + rng.normal(0.0, 1.0, PIXELS)
        best = mean_square(degree, y)
        others = [mean_square(d, y) for d in range(7) if d != degree]
        wrong += any(evidence_gain(best, other, pixels=PIXELS) > 0.0 for other in others)
    # one term too many passes where chi-square of one exceeds ln 2000: P = 0.6 %; of two, three ...
    # terms less often still. Of 100 sets, four are the 99.9th percentile of that.
    assert wrong <= 4


def test_the_criterion_is_schwarz_own_for_a_known_noise():
    """n c + k ln n of both, in units of the better fit's noise."""
    gain = evidence_gain((1.2, 3), (1.0, 5), pixels=1000)
    assert gain == pytest.approx((1200.0 + 3 * np.log(1000)) - (1000.0 + 5 * np.log(1000)))
    assert evidence_gain((1.0, 5), (1.2, 3), pixels=1000) == pytest.approx(-gain)


def test_a_unit_of_the_residuals_does_not_matter():
    known = evidence_gain((1.2, 3), (1.0, 5), pixels=1000)
    assert evidence_gain((120.0, 3), (100.0, 5), pixels=1000) == pytest.approx(known)
