"""Score tests: what a fit would gain, held against the fits themselves."""

import numpy as np
import pytest

from isochrome.estimation import ScoreProducts


def data(rng, parts=3, n=400):
    """Parts of own columns (2), shared ones (3), others (2) and a residual that has some of all."""
    for i in range(parts):
        own, shared, others = (rng.normal(size=(k, n + 10 * i)) for k in (2, 3, 2))
        value = rng.normal(size=n + 10 * i) + 0.2 * others[0]
        yield own, shared, others, value


def cost_of(parts, others):
    """Least sum of squares with each part's own columns, the shared ones and some others."""
    size = sum(len(own) for own, *_ in parts)
    blocks, at = [], 0
    for own, shared, more, _ in parts:
        left = np.zeros((size, own.shape[1]))
        left[at : at + len(own)] = own
        at += len(own)
        blocks.append(np.vstack((left, shared, more[others])))
    design = np.hstack(blocks).T
    right = np.concatenate([value for *_, value in parts])
    solution, *_ = np.linalg.lstsq(design, right, rcond=None)
    return np.sum((right - design @ solution) ** 2), solution


def gains(products, chosen):
    """What some columns lower the cost by, and the values that they would come out at."""
    right = products.right[chosen]
    values = np.linalg.solve(products.matrix[np.ix_(chosen, chosen)], right)
    return values @ right, values


def test_what_each_part_has_of_its_own_is_fitted_there():
    parts = list(data(np.random.default_rng(5)))
    products = ScoreProducts(parts)
    before, _ = cost_of(parts, [])
    for chosen in ([0], [1], [0, 1]):
        gain, values = gains(products, chosen)
        after, solution = cost_of(parts, chosen)
        # products are in single precision
        assert gain == pytest.approx(before - after, rel=1e-3, abs=1e-2)
        assert values == pytest.approx(solution[-len(chosen) :], rel=1e-3, abs=1e-4)
    assert products.count == sum(value.size for *_, value in parts)
    # two of their own in each of three parts, and three of all
    assert products.noise == pytest.approx(max(1.0, before / (products.count - 9)), rel=1e-4)


def test_what_is_fitted_moves_as_it_does_with_a_column_more():
    parts = list(data(np.random.default_rng(6)))
    products = ScoreProducts(parts)
    _, before = cost_of(parts, [])
    for chosen in ([0], [1], [0, 1]):
        _, after = cost_of(parts, chosen)
        shared = slice(6, 9)  # behind two own ones of each of three parts
        _, values = gains(products, chosen)
        taken = -products.taken_up[:, chosen] @ values
        moved = after[: before.size][shared] - before[shared]
        # products are in single precision
        assert taken == pytest.approx(moved, rel=1e-3, abs=1e-5)
