"""Which wear law the frames speak for."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from fitting.engine_frames import written
from isochrome.fitting import (
    LawFit,
    WearLaws,
    compare_laws,
    fit,
    make_sequence,
    marginal,
    mean_coefficients,
    nearest_point,
    segment_ends,
    segments,
)
from isochrome.scene import parse_scene
from scene_texts import SMALL_CAMERA, WEARING_CONTACT

ENDS = np.array([31.0, 77.0, 155.0, 233.0])
CAMERA = SMALL_CAMERA.replace("left_mm = -2.0", "left_mm = -1.97").replace("= 0.0\n", "= 0.004\n")
WORN = WEARING_CONTACT + f"distances_m = {ENDS.tolist()}\n{CAMERA}noise_grey = 3.0\nseed = 3\n"
WEAR, FRICTION = "wear.coefficient_mm2_per_n", "friction.coefficient"
RISING = {"distance_m": tuple(ENDS), "value": (0.15, 0.22, 0.27, 0.30)}
FROM_A_TENTH = {"distance_m": (0.0, 233.0), "value": (0.1, 0.3)}
RUNNING_IN = {"distance_m": (0.0, 100.0), "value": (4e-9, 2e-9)}


def sarkar_rate(s):
    """The rate by Sarkar's law from a tenth on."""
    return 2e-9 * np.sqrt(1.0 + 3.0 * (0.1 + 0.2 * s / 233.0) ** 2)


def scene(**values):
    return parse_scene(WORN).with_values({k.replace("__", "."): v for k, v in values.items()})


def mean_of(rate, ends=ENDS):
    """Means of a rate between the frames, by quadrature."""
    edges = (0.0, *ends)
    return [
        quad(rate, a, b, points=[100.0] if a < 100.0 < b else None)[0] / (b - a)
        for a, b in pairwise(edges)
    ]


@pytest.mark.parametrize(
    ("values", "rate"),
    [
        ({}, lambda s: 2e-9),
        ({"wear__coefficient_mm2_per_n": RUNNING_IN}, lambda s: 4e-9 - 2e-11 * min(s, 100.0)),
        ({"wear__law": "sarkar", "friction__coefficient": FROM_A_TENTH}, sarkar_rate),
    ],
)  # fmt: skip
def test_mean_coefficients_between_frames_are_the_rates_means(values, rate):
    assert mean_coefficients(scene(**values), ENDS) == pytest.approx(mean_of(rate), rel=1e-9)


# The evidence


def wear_only(values, spread, ends=ENDS, **changes):
    """A run of which only the wear between frames is known, each to a relative uncertainty."""
    whole = scene(wear__distances_m=tuple(ends), **changes)
    sequence = segments(make_sequence(whole, len(ends), (WEAR,), ()))
    assert segment_ends(sequence) == pytest.approx(ends)
    information = np.diag(1.0 / (spread * np.asarray(values)) ** 2)
    return sequence, np.asarray(values), information


def test_evidence_is_the_integral_over_what_the_law_leaves_open():
    # clearly running in, so that its three parameters are known and the integral is Gaussian
    values = np.array(mean_of(lambda s: 4e-9 - 2e-11 * min(s, 100.0)))
    values *= 1.0 + 0.004 * np.array([0.5, -1.0, 0.3, 0.6])
    sequence, values, information = wear_only(values, 0.004)
    found = {
        law.law: law for law in compare_laws(sequence, values, information, cost=100.0, freedom=100)
    }

    turn = float(np.exp(np.mean(np.log(ENDS))))
    edges = np.array([0.0, *ENDS])[:, None]

    def log_likelihood(log_last, log_ratio, log_distance):
        last, first, end = np.exp(log_last), np.exp(log_last + log_ratio), np.exp(log_distance)
        s = np.minimum(edges, end)
        total = first * s - (first - last) * s**2 / (2.0 * end) + last * (edges - s)
        between = np.diff(total, axis=0) / np.diff(edges, axis=0)
        return -0.5 * np.diag(information) @ (between - values[:, None]) ** 2

    def log_integral(log_values, *axes):
        top = log_values.max()
        step = np.prod([axis[1] - axis[0] for axis in axes])
        return top + np.log(np.sum(np.exp(log_values - top)) * step)

    # points 0.15 of a standard deviation apart or closer, far beyond where the integrand ends
    axes = [
        np.log(centre) + np.linspace(-width, width, 81)
        for centre, width in ((2e-9, 0.02), (2.0, 0.06), (100.0, 0.12))
    ]
    last, ratio, distance = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    prior = -0.5 * ratio**2 - 0.5 * (distance - np.log(turn)) ** 2 - np.log(2.0 * np.pi)
    running_in = log_integral(log_likelihood(last, ratio, distance) + prior, *axes)
    even = np.log(2e-9) + np.linspace(-0.2, 0.8, 20_001)
    archard = log_integral(log_likelihood(even, 0.0 * even, 0.0 * even), even)
    margin = found["running_in"].log_evidence - found["archard"].log_evidence
    assert margin > 100.0
    # Laplace's approximation: the integrands' third derivatives, some hundredths
    assert margin == pytest.approx(running_in - archard, abs=0.1)


@pytest.mark.parametrize("chi", [1.0, 2.0])
def test_a_misfit_of_the_pixels_widens_all_that_a_law_says(chi):
    """Worn by Sarkar's law under a rising friction, held against one constant: closed forms."""
    ends = ENDS[[0, 3]]  # of two stretches no running-in is told
    worn = np.array(mean_of(sarkar_rate, ends))
    sequence, values, information = wear_only(worn, 0.01, ends, friction__coefficient=FROM_A_TENTH)
    laws = compare_laws(sequence, values, information, cost=1000.0 * chi**2, freedom=1000)
    found = {law.law: law for law in laws}
    weight = np.diag(information)
    constant = weight @ worn / weight.sum()
    misfit = weight @ (worn - constant) ** 2

    archard = found["archard"]
    assert archard.misfit == pytest.approx(misfit / chi**2, rel=1e-3)
    value, uncertainty = archard.parameters[WEAR].values()
    # forward differences of ln k, by 1e-5 of it
    assert value == pytest.approx(constant, rel=1e-4)
    assert uncertainty == pytest.approx(chi / np.sqrt(weight.sum()), rel=1e-3)
    # the pixels' own cost, and what the law adds to it in the pixels' own noise
    assert archard.chi == pytest.approx(np.sqrt(chi**2 + misfit / 1000.0), rel=1e-5)
    # what is known of ln k is the same to chi; it stands in both margins
    known = 0.5 * np.log((weight @ worn**2) / (weight.sum() * constant**2))
    margin = found["sarkar"].log_evidence - archard.log_evidence
    assert margin == pytest.approx(0.5 * misfit / chi**2 - known, abs=0.01)


def test_a_laws_degrees_of_freedom_are_the_worn_stretches_less_its_parameters():
    sequence, values, information = wear_only(2e-9 * np.ones(4), 0.01)
    laws = compare_laws(sequence, values, information, cost=100.0, freedom=100)
    # four stretches; a coefficient; or two and a distance
    freedom = {"archard": 3, "sarkar": 3, "dissipated_energy": 3, "running_in": 1}
    assert {law.law: law.freedom for law in laws} == freedom
    told = {row["law"]: row["degrees_of_freedom"] for row in WearLaws(laws, (), 1.0).to_json()}
    assert told == freedom


def test_unknowns_that_are_not_asked_about_are_integrated_out():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((6, 6))
    information = root @ root.T + np.eye(6)
    left, size = marginal(information, [1, 4])
    wanted = np.linalg.inv(np.linalg.inv(information)[np.ix_([1, 4], [1, 4])])
    assert left * np.outer(size, size) == pytest.approx(wanted)


def test_the_nearest_point_of_a_circle():
    # a point a thousandth outside, in units in which that is one standard deviation
    place = nearest_point(
        lambda t: np.array([np.cos(t[0]) - 0.6006, np.sin(t[0]) - 0.8008]),
        np.array([0.3]), np.array([0.0]), np.array([1e-6]), 1e6 * np.eye(2), np.zeros(1),
    )  # fmt: skip
    # settled where a thousandth of a variance is left to gain: 0.03 of a standard deviation
    assert place.unknown[0] == pytest.approx(np.arctan2(4.0, 3.0), abs=1e-4)
    assert place.cost == place.distance == pytest.approx(1.0, abs=2e-3)


def law(name, log_evidence, misfit=2.0):
    return LawFit(
        law=name, parameters={}, between=(), misfit=misfit, freedom=3, chi=1.0,
        log_evidence=log_evidence,
    )  # fmt: skip


def test_the_sentence_names_the_law_and_its_margin():
    laws = WearLaws((law("sarkar", 0.0), law("archard", -12.4), law("running_in", -40.0)), (), 1.0)
    assert laws.sentence() == (
        "the frames prefer sarkar, by a margin of 12.4 in ln Z over archard (5 is clear)"
    )
    assert laws.speaks_against("archard") and not laws.speaks_against("sarkar")
    # a law of the scene's that was not among them
    assert not laws.speaks_against("dissipated_energy")


def test_the_sentence_says_what_cannot_be_told_and_what_nothing_explains():
    near = WearLaws((law("archard", 0.0), law("sarkar", -1.0), law("running_in", -9.0)), (), 1.0)
    assert near.sentence().startswith("the frames cannot tell archard and sarkar apart")
    assert "their coefficients make up for it" in near.sentence()
    assert not near.speaks_against("sarkar")
    wrong = replace(near, laws=(law("archard", 0.0, 60.0), *near.laws[1:]))
    assert "misfit of 60 variances where 3 are expected" in wrong.sentence()


@pytest.mark.parametrize(("margin", "clear"), [(4.9, False), (5.1, True)])
def test_a_margin_is_clear_from_odds_of_150_to_1(margin, clear):
    laws = WearLaws((law("archard", 0.0), law("sarkar", -margin)), (), 1.0)
    assert laws.speaks_against("sarkar") is clear
    assert ("the frames prefer archard" in laws.sentence()) is clear


@pytest.mark.parametrize(("chance", "said"), [(1.2e-4, False), (0.8e-4, True)])
def test_no_law_fits_where_chance_alone_would_not_leave_its_misfit(chance, said):
    # chi squared of two degrees is beyond Q with the chance exp(-Q/2)
    best = replace(law("archard", 0.0, -2.0 * np.log(chance)), freedom=2)
    assert WearLaws((best, law("sarkar", -9.0)), (), 1.0).none_fits is said
    # a law with as many parameters as there are stretches fits by itself
    assert not WearLaws((replace(best, freedom=0), law("sarkar", -9.0)), (), 1.0).none_fits


def fitted(folder, truth, **start):
    return fit(
        written(folder, truth), scene(**start), [WEAR, "load.normal_n"], per_frame=[FRICTION]
    )


@pytest.mark.study
@pytest.mark.parametrize(
    ("name", "k"), [("dissipated_energy", 8e-9), ("archard", 2e-9), ("sarkar", 2e-9)]
)
def test_every_law_is_preferred_where_it_wore(tmp_path, name, k):
    # the steps of the wear are the same in truth and fit: their own errors do not matter here
    steps = {"numerics__tolerance": 1e-3}
    worn = {"wear__law": name, "wear__coefficient_mm2_per_n": k}
    found = fitted(tmp_path, scene(**worn, friction__coefficient=RISING, **steps), **steps)
    laws = found.wear_laws
    assert [near.law for near in laws.close] == [name]
    best = laws.laws[0].parameters[WEAR]
    assert abs(best["value"] - k) < 4.0 * best["standard_uncertainty"]
    stated = name == "archard"  # the law of the scene that is fitted
    assert laws.speaks_against("archard") is not stated
    said = any("wear.law = 'archard' is not what the frames show" in w for w in found.warnings)
    assert said is not stated
    rows = found.to_json()["wear_laws"]
    assert {"law", "chi", "log_evidence", "coefficient_mm2_per_n"} <= set(rows[0])


@pytest.mark.long
def test_running_in_is_told_with_its_distance(tmp_path):
    steps = {"numerics__tolerance": 1e-3}  # as above
    found = fitted(tmp_path, scene(wear__coefficient_mm2_per_n=RUNNING_IN, **steps), **steps)
    (best,) = found.wear_laws.close
    assert best.law == "running_in"
    for key, true in {WEAR: 2e-9, "first_over_last": 2.0, "running_in_distance_m": 100.0}.items():
        value, spread = best.parameters[key].values()
        assert abs(value - true) < 4.0 * spread, key


@pytest.mark.study
def test_laws_of_friction_are_alike_where_it_is_constant(tmp_path):
    found = fitted(tmp_path, scene())
    close = {near.law for near in found.wear_laws.close}
    assert {"archard", "sarkar", "dissipated_energy"} <= close
    assert "cannot tell" in found.wear_laws.sentence() and found.warnings == ()
    for near in found.wear_laws.laws:
        if near.law in ("sarkar", "dissipated_energy"):
            factor = {"sarkar": np.sqrt(1.0 + 3.0 * 0.25**2), "dissipated_energy": 0.25}[near.law]
            # the coefficient makes up for the law: 2e-9 over its factor; 1 %: the friction's noise
            assert near.parameters[WEAR]["value"] == pytest.approx(2e-9 / factor, rel=0.01)


@pytest.mark.study
def test_the_right_law_leaves_a_misfit_of_its_degrees_of_freedom():
    rng = np.random.default_rng(1)
    misfits = []
    for _ in range(40):
        values = 2e-9 * (1.0 + 1e-3 * rng.standard_normal(4))
        found = compare_laws(*wear_only(2e-9 * np.ones(4), 1e-3)[:1], values,
                             np.eye(4) / 4e-24, cost=100.0, freedom=100)  # fmt: skip
        misfits.append(next(law.misfit for law in found if law.law == "archard"))
    # chi-squared of 3 degrees: mean 3, standard deviation sqrt(6); of 40: 0.39
    assert np.mean(misfits) == pytest.approx(3.0, abs=1.5)
