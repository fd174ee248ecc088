"""Damped steps of many problems at once: each goes as it would alone."""

import numpy as np

from isochrome.estimation import minimise_all, solve_all

X = np.linspace(0.0, 2.0, 30)


def curves(truth):
    """Problems y = a exp(-b x), for `truth` (m, 2) of a and b."""
    data = truth[:, :1] * np.exp(-truth[:, 1:] * X)

    def at(values):
        wave = np.exp(-values[:, 1:] * X)
        residual = data - values[:, :1] * wave
        slope = np.stack([wave, -values[:, :1] * X * wave], axis=1)
        return np.sum(residual**2, axis=1), residual, slope

    def equations(_, now):
        _, residual, slope = now
        return slope @ slope.swapaxes(1, 2), np.einsum("mpk,mk->mp", slope, residual)

    return at, equations


TRUTH = np.array([[1.0, 0.5], [2.0, 1.5], [0.3, 0.1], [5.0, 3.0]])
START = TRUTH * [1.4, 0.6]


def test_exponentials_are_found_from_exact_data():
    found, now, _ = minimise_all(*curves(TRUTH), START, np.full(4, 1e-2), steps=30)
    np.testing.assert_allclose(found, TRUTH, rtol=1e-9)
    assert now[0].max() < 1e-20


def test_each_problem_goes_as_it_would_alone():
    together, _, damping = minimise_all(*curves(TRUTH), START, np.full(4, 1e-2), steps=4)
    for k in range(4):
        own = slice(k, k + 1)
        alone, _, one = minimise_all(*curves(TRUTH[own]), START[own], np.full(1, 1e-2), steps=4)
        # sums of a batch may be taken in another order
        np.testing.assert_allclose(together[own], alone, rtol=1e-10)
        assert damping[k] == one[0]


def test_a_step_that_does_not_lower_the_cost_is_not_taken():
    at, equations = curves(TRUTH)
    start = np.array([[1.0, 0.5], [2.0, -4.0], [0.3, 0.1], [5.0, 3.0]])
    found, now, damping = minimise_all(at, equations, start, np.full(4, 1e-9), steps=1)
    costs = at(start)[0]
    assert (now[0] <= costs).all()
    np.testing.assert_array_equal(found[0], start[0])  # at the least already
    assert damping[0] == 8e-9


def test_a_linear_problem_is_solved_in_one_step():
    normal = np.array([[[4.0, 1.0], [1.0, 3.0]], [[2.0, 0.0], [0.0, 5.0]]])
    wanted = np.array([[1.0, -2.0], [3.0, 0.5]])
    gradient = np.einsum("mij,mj->mi", normal, wanted)

    def stepped(damping):
        found, *_ = minimise_all(
            lambda values: (np.sum((values - wanted) ** 2, axis=1),),
            lambda _, now: (normal.copy(), gradient), np.zeros((2, 2)), damping, steps=1,
        )  # fmt: skip
        return found

    np.testing.assert_allclose(stepped(np.zeros(2)), wanted, rtol=1e-14)
    halved = stepped(np.ones(2))
    np.testing.assert_allclose(halved[1], wanted[1] / 2.0, rtol=1e-14)  # diagonal: N + N


def test_damping_keeps_its_limits_and_its_precision():
    at, equations = curves(TRUTH)
    _, _, damping = minimise_all(
        at, equations, START, np.full(4, 1e-2), steps=9, limits=(1e-4, 1.0)
    )
    assert damping.min() >= 1e-4
    single = np.full(4, 1e-2, np.float32)
    _, _, eased = minimise_all(at, equations, START.astype(np.float32), single, steps=1)
    assert eased.dtype == np.float32
    np.testing.assert_allclose(eased, 2e-3, rtol=1e-6)


def test_a_singular_system_is_not_solved_and_leaves_the_others_alone():
    rng = np.random.default_rng(5)
    matrices = rng.standard_normal((4, 3, 3))
    matrices[1] = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])  # of rank one
    truth = rng.standard_normal((4, 3, 2))
    found = solve_all(matrices, matrices @ truth)
    assert np.isnan(found[1]).all()
    np.testing.assert_allclose(found[[0, 2, 3]], truth[[0, 2, 3]], rtol=1e-9)


def test_a_problem_whose_matrix_is_singular_waits_and_the_others_are_found():
    truth, start = TRUTH.copy(), START.copy()
    truth[2] = start[2] = 0.0  # no amplitude: its decay changes nothing, nor is there a misfit
    found, now, _ = minimise_all(*curves(truth), start, np.full(4, 1e-2), steps=30)
    np.testing.assert_array_equal(found[2], start[2])
    np.testing.assert_allclose(np.delete(found, 2, 0), np.delete(truth, 2, 0), rtol=1e-9)
    assert np.isfinite(now[0]).all()
