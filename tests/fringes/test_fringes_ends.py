"""The ends of the light and the tone curve from a frame's own fringes, on rendered specimens."""

from functools import lru_cache

import numpy as np
import pytest
from test_fringes_free import errors, rms
from test_fringes_free import reading as read_as_it_is

from isochrome.errors import InputError
from isochrome.fringes import OrderReading, fit_background_modulation, gamma_misfit, widened
from isochrome.fringes.single_frame.background_modulation import as_doubtful
from isochrome.fringes.single_frame.end_search import EndProblem, SmoothImages, search_all
from specimens import NAMES, View, light_of, shoot, view

RMS, WRONG_SHARE, KEPT = 0.05, 0.005, 0.70
"""What a blind reading promises: fringes, share off by over half a fringe, share kept."""
WRONG = 0.5


@lru_cache(maxsize=64)
def reading(name: str, ends: str = "none", said: float | str | None = None, **shot: float):
    """A specimen's view, its light, and its reading as uncertain as the ends leave it."""
    seen, light, found = read_as_it_is(name, ends, said, **shot)
    return seen, light, widened(found.reading, light.error)


def is_right(seen: View, got: OrderReading, kept: float = KEPT) -> bool:
    error = errors(seen, got)
    return bool(
        error.size >= kept * np.count_nonzero(seen.material)
        and rms(error) <= RMS
        and np.mean(error > WRONG) <= WRONG_SHARE
    )


READ = ("disc", "contact, bulk")
"""Fields that are read in each slow run; the others are left to the study."""


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in READ else pytest.mark.study) for n in NAMES]
)
def test_blind_the_order_is_right_and_most_is_kept(name):
    seen, light, got = reading(name)
    assert light.settled and light.tone == 1.0
    assert is_right(seen, got) and is_right(seen, read_as_it_is(name, "none")[2].reading)


@pytest.mark.long
def test_the_dark_end_is_found_where_few_fringes_reach_it():
    """Around the hole the plate is at the crest of order 1.5: a quadratic alone says 0.4 off."""
    seen, light, _ = reading("hole")
    truth = light_of(shoot(seen))
    both = light.valid & truth.valid
    away = (light.background - truth.background)[both] / np.median(truth.contrast[both])
    # the truth's own noise is 3/4 of a grey level of about 220, 0.004
    assert np.sqrt(np.mean(away**2)) < 0.02


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["worn contact, mu 0.3", pytest.param("hole", marks=pytest.mark.study)]
)
def test_errors_are_as_large_as_their_uncertainties_say(name):
    seen, _, got = reading(name)
    ratio = (got.order - seen.order) / got.uncertainty
    spread = np.nanmedian(np.abs(ratio)) / 0.6745  # a normal deviate's median is 0.6745
    assert 0.4 < spread < 1.3  # on the safe side by 2.5 at most


GAMMA = 2.2


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "ends"),
    [
        ("worn contact, mu 0.3", "both"),
        *(
            pytest.param(*case, marks=pytest.mark.study)
            for case in (
                ("worn contact, mu 0.3", "none"), ("worn contact, mu 0.3, bulk", "none"),
                ("disc", "both"), ("beam", "none"), ("hole", "none"),
            )
        ),
    ],
)  # fmt: skip
def test_an_unknown_gamma_is_found_from_the_fringes(name, ends):
    seen, light, got = reading(name, ends, "unknown", gamma=GAMMA)
    # 3 %: with it the light's middle is off by 0.03 * 0.5 ln 2 = 0.01, the order by 0.003
    assert light.tone == pytest.approx(GAMMA, rel=0.03) and is_right(seen, got)


@pytest.mark.long
def test_a_linear_camera_has_an_unknown_gamma_of_one():
    _, light, _ = reading("worn contact, mu 0.3", "none", "unknown")
    assert light.tone == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("gamma", "told"), [(1.0, False), (1.4, True), (2.2, True)])
def test_fringes_contradict_a_wrong_gamma_and_no_right_one(gamma, told):
    light = light_of(shoot(view("worn contact, mu 0.3"), gamma=gamma), gamma=1.0)
    ends = light.background, light.background + light.contrast
    away, spread = gamma_misfit(light.light, light.sigma, light.valid, ends)
    assert (abs(away) > 5.0 * spread) is told and (away > 0.1) is told


def test_a_reading_grows_as_uncertain_as_the_signal():
    """On a slope of order, a signal off by e moves it by e/(pi sin 2 pi N); on a crest by less."""
    order = np.tile(np.linspace(0.05, 0.45, 200), (60, 1))
    ones = np.ones(order.shape)
    sure = OrderReading(order, 1e-4 * ones, ones, 1.0)
    got = widened(sure, 0.01 * ones)
    expected = 0.01 / (np.pi * np.sin(2.0 * np.pi * order))
    middle = np.s_[20:40, 40:160]
    # pooling over some pixels of a slope of 0.002 fringe a pixel: the sine varies by 4 %
    np.testing.assert_allclose(got.uncertainty[middle], expected[middle], rtol=0.05)
    assert not np.isfinite(widened(sure, 0.2 * ones).order).any()  # 0.06 fringe and more


def ramp(seed, gamma, shape=(110, 130), noise=0.01, hard=False):
    """Slanted fringes of a camera's tone curve, and what they were shot with: closed form."""
    rows, cols = np.indices(shape, dtype=float)
    signal = np.sin(np.pi * (cols / 17.0 + 0.006 * rows)) ** 2
    signal = np.where(signal > 0.5, 1.0, 0.0) if hard else signal
    light = (0.05 + 0.8 * signal) ** (1.0 / gamma)
    light = light + noise * np.random.default_rng(seed).standard_normal(shape)
    low, high = (np.full(shape, end ** (1.0 / gamma)) for end in (0.05, 0.85))
    return (light, np.full(shape, noise), np.ones(shape, bool)), {"dark": low, "bright": high}


def test_a_found_gammas_uncertainty_is_in_the_signals():
    """Both ends are given, so that gamma alone moves s = (I^g - D^g)/(B^g - D^g)."""
    frame, ends = ramp(0, 1.4)
    found = fit_background_modulation(*frame, **ends, tone=True)
    assert abs(found.tone - 1.4) < 4.0 * found.tone_uncertainty

    def signal(level, g):
        low, high = ((end ** (1.0 / 1.4)) ** g for end in (0.05, 0.85))
        return (level**g - low) / (high - low)

    for share in (0.2, 0.45, 0.7):
        level = share ** (1.0 / 1.4)
        slope = (signal(level, found.tone + 1e-4) - signal(level, found.tone - 1e-4)) / 2e-4
        told = found.signal_uncertainty(np.full((110, 130), level))
        # the finite difference is off by 4e-10
        assert told == pytest.approx(abs(slope) * found.tone_uncertainty, rel=1e-6)


def test_fringes_of_no_gamma_do_not_tell_it():
    """Fringes of black and white alone: no gamma makes them a cosine's; 0.04 was said to."""
    frame, ends = ramp(3, 1.4, hard=True)
    with pytest.raises(InputError, match=r"gamma cannot be found .* state frames\.gamma"):
        fit_background_modulation(*frame, **ends, tone=True)


def problem_of(light, noise):
    """The search for an even bright end over a dark one of 0.05 that is given."""
    one = [np.ones((n, 1)) for n in light.shape]
    even = SmoothImages(*one, np.zeros((1, 2), dtype=int), np.array([np.inf]))
    return EndProblem(
        light=light, sigma=noise, valid=np.ones(light.shape, bool),
        shapes=(np.full(light.shape, 0.05), even), tone=False, scale=0.8, by=1,
    )  # fmt: skip


@pytest.mark.study
def test_a_bright_end_that_may_as_well_be_another_is_as_uncertain_as_the_two_differ():
    """The order rises to 0.44 and falls: the light may reach its bright end there, or not quite."""
    order = np.tile(0.15 + 0.29 * np.sin(np.pi * np.arange(50) / 50.0), (50, 1))
    light = 0.05 + 0.8 * np.sin(np.pi * order) ** 2
    light = light + 0.01 * np.random.default_rng(1).standard_normal(light.shape)
    noise = np.full(light.shape, 0.01)
    problem = problem_of(light, noise)
    low, high = (np.array([1.0, bright, 1.0]) for bright in (0.8, 0.85))
    alone, both = (as_doubtful(search_all(problem, starts)) for starts in ([low], [low, high]))
    # the crest of the light is taken for the bright end, and is 0.026 below it
    assert alone.unknowns[1] < 0.84 and np.sqrt(alone.covariance[1, 1]) < 0.005
    assert abs(both.unknowns[1] - 0.85) < 3.0 * np.sqrt(both.covariance[1, 1])


@pytest.mark.parametrize("side", [70, 85])  # 169 and 256 patches, each pixel in two of them
def test_an_end_is_no_surer_than_the_light_allows(side):
    """With all orders known, B of I = D + (B - D) s is known to sigma/sqrt(sum s²): Cramér, Rao."""
    rows, cols = np.indices((side, side), dtype=float)
    signal = np.sin(np.pi * (cols / 9.0 + 0.01 * rows)) ** 2
    noise = np.full(signal.shape, 0.01)
    light = 0.05 + 0.8 * signal + noise * np.random.default_rng(1).standard_normal(signal.shape)
    problem = problem_of(light, noise)
    found, *_ = search_all(problem, [np.array([1.0, 0.84, 1.0])])
    told = np.sqrt(found.covariance[1, 1])
    assert abs(found.unknowns[1] - 0.85) < 3.0 * told
    # 1.4 times the bound, as the orders are unknown; 0.95 where pixels in two patches count twice
    assert 1.0 < told / (0.01 / np.sqrt(np.sum(signal**2))) < 2.0


@pytest.mark.long
def test_a_found_gamma_and_its_signal_are_as_uncertain_as_they_scatter():
    """Over eight seeds: gamma's pulls, and the signal's error by it half-way between the ends."""
    pulls, moved = [], []
    for seed in range(8):
        frame, ends = ramp(seed, 1.4)
        found = fit_background_modulation(*frame, **ends, tone=True)
        pulls.append((found.tone - 1.4) / found.tone_uncertainty)
        level = np.full((110, 130), 0.45 ** (1.0 / 1.4))
        low, high = found.dark, found.bright
        error = (level**found.tone - low) / (high - low) - 0.5
        moved.append(float((np.abs(error) / found.signal_uncertainty(level)).max()))
    # eight pulls' RMS lies within 0.45 to 1.6 in 99 of 100
    assert 0.4 < np.sqrt(np.mean(np.square(pulls))) < 1.6, pulls
    assert 0.4 < np.sqrt(np.mean(np.square(moved))) < 1.6, moved


def test_light_without_contrast_or_trust_is_refused():
    flat = np.full((160, 220), 0.5)
    with pytest.raises(InputError, match="no contrast"):
        fit_background_modulation(flat, 0.01 + 0.0 * flat, np.ones(flat.shape, bool))
    rising = np.tile(np.linspace(0.0, 1.0, 220), (160, 1))
    with pytest.raises(InputError, match="no part of the frame"):
        fit_background_modulation(rising, 0.01 + 0.0 * rising, np.zeros(rising.shape, bool))
