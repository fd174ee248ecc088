"""Sets of hypotheses: their evidence against integrals, and their means against brute force."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from isochrome.estimation import (
    Evidence,
    Hypothesis,
    Nuisance,
    Regions,
    ScoreProducts,
    cosine_rms,
    cosine_spread,
    cosine_sum,
    cosines,
    weigh,
    weighed,
)


def problem(rng, sizes, n=40, scale=1.0):
    """Columns (k, n), a residual (n,) over its noise, and their products."""
    columns = scale * rng.normal(size=(sum(sizes), n))
    residual = rng.normal(size=n)
    return columns, residual, columns @ columns.T, columns @ residual


def hypotheses(rng, sizes, ways=1):
    """One for each group of columns, or several that exclude one another."""
    found, first = [], 0
    for number, size in enumerate(sizes):
        columns = slice(first, first + size)
        first += size
        for _ in range(ways):
            root = rng.normal(size=(size, size))
            found.append(Hypothesis(f"thing {number}", columns, root, float(rng.normal())))
    return found


def test_the_evidence_of_a_set_is_that_of_its_marginal_likelihood():
    """ln N(r; 0, 1 + J'VJ) - ln N(r; 0, 1), the data's own density with and without it."""
    rng = np.random.default_rng(1)
    sizes = (1, 3, 6, 2, 5)  # large ones are eliminated once, and then small ones
    columns, residual, matrix, right = problem(rng, sizes)
    some = hypotheses(rng, sizes)
    evidence = Evidence(matrix, right, some)
    for chosen in ((0,), (1,), (2,), (0, 3), (0, 1, 3), (0, 2), (2, 4), (0, 1, 2, 3, 4)):
        spread = np.eye(residual.size)
        for k in chosen:
            moved = columns[some[k].columns].T @ some[k].root
            spread = spread + moved @ moved.T
        want = multivariate_normal(np.zeros(residual.size), spread).logpdf(residual)
        want -= norm.logpdf(residual).sum()
        # rounding of determinants of 40 x 40
        got = evidence.of(chosen) - sum(some[k].log_odds for k in chosen)
        assert got == pytest.approx(want, abs=1e-9)


def test_what_is_fitted_already_does_not_change_what_a_set_is_worth():
    """b = g + M now is the same wherever the values stand."""
    rng = np.random.default_rng(2)
    columns, residual, matrix, right = problem(rng, (2, 1))
    some = hypotheses(rng, (2, 1))
    now = rng.normal(size=3)
    moved = Evidence(matrix, columns @ (residual - columns.T @ now) + matrix @ now, some)
    assert moved.of((0, 1)) == pytest.approx(Evidence(matrix, right, some).of((0, 1)), abs=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_amplitude_that_cannot_be_negative_has_the_evidence_of_its_integral(sign):
    rng = np.random.default_rng(3)
    column = sign * np.abs(rng.normal(size=30))
    residual = 0.5 * np.abs(column) + rng.normal(size=30)
    size = 0.7
    one = Hypothesis("even", slice(0, 1), np.array([[size]]), 0.0, positive=True)
    m, g = float(column @ column), float(column @ residual)
    evidence = Evidence(np.array([[m]]), np.array([g]), [one])

    def density(a, power=0):
        return a**power * np.exp(g * a - 0.5 * m * a**2) * 2.0 * norm.pdf(a, scale=size)

    total = quad(density, 0.0, 10.0, epsabs=0.0, epsrel=1e-10)[0]
    assert evidence.of((0,)) == pytest.approx(np.log(total), abs=1e-8)
    mean = quad(density, 0.0, 10.0, args=(1,), epsabs=0.0, epsrel=1e-10)[0] / total
    assert evidence.values((0,))[0] == pytest.approx(mean, rel=1e-8)


def test_means_over_sets_are_those_of_the_integrals():
    """Second moments of what is fitted, over all sets, by brute force."""
    rng = np.random.default_rng(4)
    sizes, ways = (1, 2, 1), 2
    _, _, matrix, right = problem(rng, sizes, n=12, scale=0.6)
    some = hypotheses(rng, sizes, ways)
    sets = weigh(Evidence(matrix, right, some))
    along, about = rng.normal(size=(2, 4)), rng.normal(size=4)
    total, weights, chance = np.zeros((2, 2)), 0.0, 0.0
    groups = [[2 * i, 2 * i + 1] for i in range(3)]
    for size in range(4):
        for names in combinations(groups, size):
            for chosen in product(*names):
                prior = np.zeros((4, 4))
                for k in chosen:
                    prior[some[k].columns, some[k].columns] = some[k].root @ some[k].root.T
                spread = prior @ np.linalg.inv(np.eye(4) + matrix @ prior)
                mean = spread @ right
                log = 0.5 * right @ spread @ right
                log -= 0.5 * np.linalg.slogdet(np.eye(4) + matrix @ prior)[1]
                weight = np.exp(log + sum(some[k].log_odds for k in chosen))
                off = along @ (mean - about)
                total += weight * (along @ spread @ along.T + np.outer(off, off))
                weights += weight
                chance += weight * any(some[k].name == "thing 1" for k in chosen)
    assert len(sets.members) == 27  # none is negligible here
    assert sets.moments(along, about) == pytest.approx(total / weights, rel=1e-9)
    assert sets.chances["thing 1"] == pytest.approx(chance / weights, rel=1e-9)


def test_sets_that_are_judged_otherwise_keep_their_place_among_the_others():
    """ln E from elsewhere counts between two; their likelier one stays as likely as it was."""
    rng = np.random.default_rng(7)
    _, _, matrix, right = problem(rng, (1, 1, 1), n=12, scale=0.6)
    sets = weigh(Evidence(matrix, right, hypotheses(rng, (1, 1, 1))))
    of = dict(zip(sets.members, sets.weights, strict=True))
    first, second, other = sets.members[:3]
    judged = sets.judged({first: 5.0, second: 7.0})
    now = dict(zip(judged.members, judged.weights, strict=True))
    assert judged.members[0] == second and judged.weights.sum() == pytest.approx(1.0)
    assert now[second] / now[first] == pytest.approx(np.exp(2.0))
    assert now[first] / now[other] == pytest.approx(of[first] / of[other])


def test_two_that_say_the_same_have_half_the_chance_each():
    rng = np.random.default_rng(5)
    column, noise = rng.normal(size=50), rng.normal(size=50)
    columns = np.array([column, column])
    residual = 2.0 * column + noise
    some = [Hypothesis(n, slice(i, i + 1), np.eye(1), np.log(1 / 9)) for i, n in enumerate("ab")]
    sets = weigh(Evidence(columns @ columns.T, columns @ residual, some))
    assert sets.chances["a"] == pytest.approx(sets.chances["b"], rel=1e-12)
    assert 0.5 < sets.chances["a"] < 0.7 and sets.members[0] in ((0,), (1,))


def test_the_likeliest_of_many_sets_is_found_where_it_has_four_members():
    """Among twenty things in three ways each: 4e5 sets, of which a thousandth is looked at."""
    rng = np.random.default_rng(6)
    columns = rng.normal(size=(20, 400))
    true = (3, 7, 11, 17)
    residual = rng.normal(size=400) + 0.5 * columns[list(true)].sum(axis=0)
    some = [
        Hypothesis(str(k), slice(k, k + 1), np.array([[size]]), np.log(1 / 27))
        for k in range(20)
        for size in (0.05, 0.5, 5.0)
    ]
    sets = weigh(Evidence(columns @ columns.T, columns @ residual, some))
    assert {hypothesis.name for hypothesis in sets.best} == {str(k) for k in true}
    assert all(hypothesis.root[0, 0] == 0.5 for hypothesis in sets.best)


def test_what_is_fitted_is_weighed_however_unlikely_it_is():
    rng = np.random.default_rng(7)
    _, _, matrix, right = problem(rng, (1, 1))
    some = [Hypothesis(n, slice(i, i + 1), np.eye(1), -40.0) for i, n in enumerate("ab")]
    assert (0, 1) in weigh(Evidence(matrix, right, some), given=(0, 1)).members


def test_at_a_sets_values_its_posterior_cannot_fall():
    rng = np.random.default_rng(8)
    _, _, matrix, right = problem(rng, (3,))
    evidence = Evidence(matrix, right, hypotheses(rng, (3,)))
    values = evidence.values((0,))
    assert evidence.fall((0,), values) == pytest.approx(0.0, abs=1e-18)
    root = evidence.hypotheses[0].root
    normal = matrix + np.linalg.inv(root @ root.T)
    off = rng.normal(size=3)
    assert evidence.fall((0,), values + off) == pytest.approx(off @ normal @ off, rel=1e-9)


def test_sets_are_sought_without_what_is_not_to_be_in_them():
    rng = np.random.default_rng(9)
    _, _, matrix, right = problem(rng, (1, 1, 1))
    some = [Hypothesis(n, slice(i, i + 1), np.eye(1), 3.0) for i, n in enumerate("abc")]
    sets = weigh(Evidence(matrix, right, some), without=("b",))
    assert sets.members[0] == (0, 2) and all(1 not in members for members in sets.members)


def test_the_sum_of_waves_is_that_of_their_products():
    amplitudes = np.random.default_rng(10).normal(size=(2, 25))
    want = np.tensordot(amplitudes.astype(np.float32), cosines((12, 17), 5), 1)
    assert cosine_sum((12, 17), amplitudes) == pytest.approx(want, abs=2e-6)
    within, finely = (np.tensordot(amplitudes[0], cosines((n, n), 5), 1) for n in (20, 200))
    # in single precision; and its grid of 20 by 20 is enough
    assert cosine_rms(amplitudes[0]) == pytest.approx(np.sqrt(np.mean(within**2)), rel=1e-5)
    assert cosine_rms(amplitudes[0]) == pytest.approx(np.sqrt(np.mean(finely**2)), rel=0.02)


@pytest.mark.parametrize("width", [0.12, 0.3])
def test_waves_are_a_process_of_matern(width):
    """Its variance and correlation: Rasmussen & Williams (2006), eq. 4.17."""
    spread = cosine_spread(40, width)
    waves = cosines((81, 81), 40).reshape(1600, 81, 81) * spread[:, None, None]
    # a mean over all the waves, which are larger at their ends, beyond the picture
    assert np.mean(np.square(waves).sum(axis=0)) == pytest.approx(1.0, rel=0.25)
    apart = np.sqrt(3.0) * np.abs(np.arange(81) - 40) / 81.0 / width
    along = waves[:, 40, 40] @ waves[:, 40]
    # the mirror images beyond the waves' ends, and the largest wave's own length
    assert along / along[40] == pytest.approx((1.0 + apart) * np.exp(-apart), abs=0.1)


def test_the_jackknife_by_regions_is_that_of_fits_without_them():
    """Each region left out of a fit by least squares with the prior as rows of its own."""
    rng = np.random.default_rng(11)
    fitted, columns = rng.normal(size=(3, 400)), rng.normal(size=(6, 400))
    residual, region = 1.4 * rng.normal(size=400), rng.integers(0, 5, 400)
    root, now = np.diag([0.3, 0.5]), rng.normal(size=6)
    things = [
        Nuisance(name="a", columns=None, now=now[:2], roots=(root,)),
        Nuisance(name="b", columns=None, now=now[2:], roots=(np.eye(4),)),
    ]
    found = weighed(
        things, ScoreProducts([(fitted[:1], fitted[1:], columns, residual)]), noise=2.0,
        fitted={"a", "b"}, chance=0.1, unknowns=np.arange(2), size=2,
    )  # fmt: skip
    regions = Regions(
        region=region, fitted=fitted, unknowns=np.arange(2), columns=columns, residual=residual
    )
    evidence, members = found.evidence, found.sets.members[0]
    at, size = evidence.places_of(members)
    roots = size[:, None] * evidence.forms[at]
    moved = []
    for k in range(5):
        some = region != k
        rows = np.concatenate((fitted, roots @ columns))[:, some] / np.sqrt(2.0)
        prior = np.eye(len(rows))[3:]
        data = np.r_[(residual + now @ columns)[some] / np.sqrt(2.0), np.zeros(len(prior))]
        moved.append(np.linalg.lstsq(np.vstack((rows.T, prior)), data, rcond=None)[0][1:3])
    assert regions.variance(found) == pytest.approx(4.0 * np.var(moved, axis=0), rel=1e-9)
