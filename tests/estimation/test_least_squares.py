"""Damped steps for one problem, against closed forms and known optima."""

from dataclasses import dataclass

import numpy as np
import pytest

from isochrome.estimation import Bounds, Damping, damped, damped_step, minimise, promised_gain


@dataclass(frozen=True)
class Residuals:
    """A point of a problem with residuals r (n,) and derivatives J (n, p) of the model."""

    residual: np.ndarray
    slope: np.ndarray

    @property
    def cost(self):
        return float(self.residual @ self.residual)

    @property
    def normal(self):
        return self.slope.T @ self.slope

    @property
    def gradient(self):
        return self.slope.T @ self.residual


def line(values):
    """A straight line through four points that it meets: 1 + 2 x."""
    design = np.stack([np.ones(4), np.arange(4.0)], axis=1)
    return Residuals(design @ [1.0, 2.0] - design @ values, design)


def rosenbrock(values):
    """(1 - x)² + 100 (y - x²)², least at (1, 1): Rosenbrock (1960), Comput. J. 3, 175."""
    x, y = values
    return Residuals(
        np.array([1.0 - x, 10.0 * (y - x * x)]), np.array([[1.0, 0.0], [20.0 * x, -10.0]])
    )


def powell(values):
    """Powell's singular function, whose derivatives lose their rank at the least, 0 at 0."""
    a, b, c, d = values
    r = np.array([a + 10 * b, 5**0.5 * (c - d), (b - 2 * c) ** 2, 10**0.5 * (a - d) ** 2])
    u, v = 2 * (b - 2 * c), 2 * 10**0.5 * (a - d)
    slope = [[1, 10, 0, 0], [0, 0, 5**0.5, -(5**0.5)], [0, u, -2 * u, 0], [v, 0, 0, -v]]
    return Residuals(-r, np.array(slope))


def go(at, start, **options):
    settings = {"enough": lambda _: 1e-20, "damping": Damping(1e-3), "iterations": 100}
    start = np.asarray(start, float)
    return minimise(at, start, at(start), **(settings | options))


def test_a_linear_problem_is_solved_in_one_step():
    found = go(line, [7.0, -3.0], damping=Damping(0.0), iterations=1)
    np.testing.assert_allclose(found.values, [1.0, 2.0], rtol=1e-12)
    assert found.point.cost < 1e-24


@pytest.mark.parametrize(("at", "start"), [(rosenbrock, [-1.2, 1.0]), (rosenbrock, [5.0, -3.0])])
def test_rosenbrocks_valley_is_followed_to_its_end(at, start):
    found = go(at, start)
    assert found.converged
    # the promised gain, 1e-20, is that of a step of 1e-10 along the steep side
    np.testing.assert_allclose(found.values, [1.0, 1.0], atol=1e-8)


def test_a_least_without_full_rank_is_approached():
    found = go(powell, [3.0, -1.0, 0.0, 1.0])
    assert found.converged and found.point.cost < 1e-10
    assert np.abs(found.values).max() < 1e-2  # the cost there is of the fourth order


def test_no_step_goes_uphill():
    """Some steps in the valley are refused, and none that is taken raises the cost."""
    tried = []

    def at(values):
        tried.append(rosenbrock(values).cost)
        return rosenbrock(values)

    costs = [go(at, [-1.2, 1.0], iterations=n).point.cost for n in range(1, 20)]
    assert (np.diff(costs) <= 0.0).all()
    assert max(tried[-20:]) > costs[0]


def test_where_there_is_no_point_steps_are_shortened():
    """log x = -2 from x = 5: the first full step leads below zero, where there is no logarithm."""

    def at(values):
        if values[0] <= 0.0:
            return None
        return Residuals(-2.0 - np.log(values), np.diag(1.0 / values))

    found = go(at, [5.0])
    np.testing.assert_allclose(found.values, np.exp(-2.0), rtol=1e-8)


def test_an_unknown_at_its_bound_leaves_the_other_where_it_is_best():
    """The line with its slope at most 1: the intercept is then the mean of 1 + x, 2.5."""
    bounds = Bounds(np.array([-9.0, -9.0]), np.array([9.0, 1.0]))
    found = go(line, [0.0, 0.0], bounds=bounds)
    assert found.converged
    np.testing.assert_allclose(found.values, [2.5, 1.0], rtol=1e-12)


def test_damping_follows_nielsens_rule():
    damping = Damping(1.0)
    assert damping.lighter(3.0, 6.0).value == 1.0  # half of what was promised: as it was
    assert damping.lighter(6.0, 6.0).value == 1e-2
    assert damping.lighter(0.0, 6.0).value == 2.0  # 1 - (-1)³
    assert damping.lighter(6.0, -1.0).value == 2.0  # nothing was promised
    heavy = damping.heavier()
    assert (heavy.value, heavy.heavier().value, heavy.heavier().heavier().value) == (2.0, 8.0, 64.0)
    assert heavy.lighter(6.0, 6.0).growth == 2.0
    assert Damping(0.0, least=1e-3).heavier().value == 2e-3


def test_a_step_solves_marquardts_equations_and_keeps_its_promise():
    """s = (N + λ diag N)⁻¹ g by hand; of a linear problem the promise is what comes of it."""
    point = line(np.array([0.0, 0.0]))
    step = damped_step(point.normal, point.gradient, 0.5, np.array([True, True]))
    np.testing.assert_allclose(
        step, np.linalg.solve(damped(point.normal, 0.5), point.gradient), rtol=1e-12
    )
    np.testing.assert_allclose(damped(point.normal, 0.5), [[6.0, 6.0], [6.0, 21.0]])
    gain = promised_gain(point.normal, point.gradient, step)
    assert gain == pytest.approx(point.cost - line(step).cost, rel=1e-12)
    held = damped_step(point.normal, point.gradient, 0.5, np.array([True, False]))
    assert held[1] == 0.0 and held[0] == pytest.approx(point.gradient[0] / 6.0)


def test_the_inverse_of_no_unknowns_is_empty():
    """A frame without wear has none where the wear coefficient alone is free."""
    from isochrome.estimation import scaled_inverse

    assert scaled_inverse(np.zeros((0, 0))).shape == (0, 0)


@pytest.mark.parametrize("told", [True, False])
def test_the_inverse_of_what_the_data_do_not_tell_apart_is_a_pseudo_inverse(told):
    """By Cholesky's factor, or by the eigenvalues; units differ by twelve powers of ten."""
    from isochrome.estimation import scaled_inverse

    columns = np.random.default_rng(5).normal(size=(30, 6))
    if not told:
        columns[:, 5] = columns[:, 4] + 1e-7 * columns[:, 5]
    columns *= 10.0 ** np.linspace(-6.0, 6.0, 6)
    normal = columns.T @ columns
    size = np.outer(np.sqrt(np.diag(normal)), np.sqrt(np.diag(normal)))
    want = np.linalg.pinv(normal / size, 1e-12, hermitian=True)
    # rounding of a 6 x 6 system
    np.testing.assert_allclose(scaled_inverse(normal) * size, want, atol=1e-10)
