"""Identities and limits of the comparison numbers, and what SSIM cannot see."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isochrome.comparison import (
    ComparedFrames,
    compare_frames,
    compare_orders,
    compare_signals,
    skeleton_distance,
)
from isochrome.errors import InputError
from isochrome.fringes import Skeleton, order_contours, skeletons
from isochrome.reference import contact_modulus, hertz_half_width, hertz_peak_pressure, hertz_stress

PIXEL_MM = 4.0 / 659
NOISE = 3.0 / 255.0


def hertz_order(line_load=11.0, shape=(494, 659)):
    """Fringe order of the paper's static contact (44 N on 4 mm, 14.6 N/mm per fringe)."""
    modulus = contact_modulus(2100.0, 0.4, 210e3, 0.3)
    stress = hertz_stress(
        -2.0 + PIXEL_MM * (np.arange(shape[1]) + 0.5),
        PIXEL_MM * (np.arange(shape[0])[:, None] + 0.5),
        half_width_mm=hertz_half_width(line_load, 24.61, modulus),
        peak_pressure_mpa=hertz_peak_pressure(line_load, 24.61, modulus),
    )
    return stress.principal_difference * 4.0 / 14.6


@pytest.fixture(scope="module")
def order():
    return hertz_order()


@pytest.fixture(scope="module")
def signal(order):
    return np.sin(np.pi * order) ** 2


@given(shift=st.floats(-3.0, 3.0))
def test_an_added_order_is_the_bias_and_the_rms(shift):
    order = np.linspace(0.0, 3.0, 60).reshape(6, 10)
    found = compare_orders(order + shift, order)
    assert found["order_bias_fringe"] == pytest.approx(shift, abs=1e-12)
    assert found["order_rms_fringe"] == pytest.approx(abs(shift), abs=1e-12)
    assert found["order_p95_fringe"] == pytest.approx(abs(shift), abs=1e-12)
    if abs(abs(shift) - 0.25) > 1e-6:
        assert found["wrong_branch_share"] == float(abs(shift) > 0.25)


def test_p95_leaves_out_the_worst_twentieth():
    """Of 101 differences 0, 0.01, ... 1.00, in no order and of either sign, it is the 96th."""
    size = np.random.default_rng(5).permutation(101) / 100.0
    size[::2] *= -1.0
    found = compare_orders(2.0 + size[None, :], np.full((1, 101), 2.0))
    assert found["order_p95_fringe"] == pytest.approx(0.95, abs=1e-12)
    # 26 of them are at most 0.25 off
    assert found["wrong_branch_share"] == pytest.approx(75 / 101)


def test_unknown_orders_do_not_count():
    model = np.full((20, 20), 0.2)
    measured = model + 0.01
    measured[:5] = 1.0 - model[:5]
    found = compare_orders(measured, model)
    assert found["wrong_branch_share"] == 0.25
    assert found["order_rms_fringe"] == pytest.approx(np.sqrt(0.25 * 0.36 + 0.75 * 1e-4))
    model = np.zeros((10, 10))
    measured = np.full((10, 10), 0.1)
    measured[0] = np.nan
    found = compare_orders(measured, model)
    assert found["order_rms_fringe"] == pytest.approx(0.1) and found[
        "compared_share"
    ] == pytest.approx(90 / 100)


@pytest.mark.parametrize("compare", [compare_orders, compare_signals])
def test_refusals_say_shapes_and_what_to_do(compare):
    with pytest.raises(InputError, match=r"\(3, 4\).*\(4, 3\).*simulate"):
        compare(np.zeros((3, 4)), np.zeros((4, 3)))
    with pytest.raises(InputError, match="nothing to compare"):
        compare(np.full((8, 8), np.nan), np.zeros((8, 8)))


def test_identical_signals_score_one_by_any_noise_and_what_is_unknown_does_not_count(signal):
    found = compare_signals(signal, signal, noise=NOISE)
    assert found["ncc"] == pytest.approx(1.0, abs=1e-12) and found["ssim"] == pytest.approx(
        1.0, abs=1e-9
    )
    assert found["rmse"] < 1e-12
    assert (found["gain"], found["offset"]) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-12))
    noise = np.where(np.arange(659) < 300, 0.01, 0.03) * np.ones_like(signal)
    measured = signal + noise * np.random.default_rng(2).standard_normal(signal.shape)
    assert compare_signals(measured, signal, noise=noise)["rmse_over_noise"] == pytest.approx(
        1, 0.01
    )
    assert np.isnan(compare_signals(measured, signal)["rmse_over_noise"])
    with pytest.raises(InputError, match="noise"):
        compare_signals(measured, signal, noise=0.0)
    measured = signal.copy()
    measured[100:150, 200:300] = np.nan
    found = compare_signals(measured, signal)
    assert found["ncc"] == pytest.approx(1.0) and found["ssim"] == pytest.approx(1.0)
    assert found["rmse"] < 1e-12


@settings(max_examples=30, deadline=None)
@given(gain=st.floats(0.05, 20.0), offset=st.floats(-2.0, 2.0))
def test_the_simulations_brightness_and_contrast_do_not_matter(gain, offset):
    rng = np.random.default_rng(0)
    model = rng.random((24, 31))
    measured = model + 0.1 * rng.standard_normal(model.shape)
    plain = compare_signals(measured, model, noise=0.1)
    other = compare_signals(measured, gain * model + offset, noise=0.1)
    for name in ("ncc", "rmse", "rmse_over_noise", "ssim"):
        assert other[name] == pytest.approx(plain[name], abs=1e-7)
    assert other["gain"] * gain == pytest.approx(plain["gain"], rel=1e-6)
    negative = compare_signals(measured, -model)
    assert negative["ncc"] == pytest.approx(-plain["ncc"])


def test_a_part_is_as_like_as_it_is_alone():
    """No window of the SSIM looks beyond what is known: 40 rows of 60 are as those 40 alone."""
    rng = np.random.default_rng(6)
    model = rng.random((60, 50))
    measured = model + 0.2 * rng.standard_normal(model.shape)
    part = compare_signals(measured[:40], model[:40])
    measured[40:] = np.nan
    assert compare_signals(measured, model)["ssim"] == pytest.approx(part["ssim"], abs=1e-9)
    assert part["ssim"] < 0.95
    found = compare_signals(np.random.default_rng(0).random((9, 9)), np.full((9, 9), 0.3))
    assert np.isnan(found["ncc"]) and found["gain"] == 0.0
    assert np.isnan(compare_signals(np.ones((4, 4)), np.ones((4, 4)))["ssim"])  # below its window


@pytest.mark.parametrize("shift", [0, 1, 3, 6])
def test_a_shift_is_the_skeleton_distance(shift):
    col = np.indices((80, 200))[1].astype(float)
    here = np.sin(np.pi * col / 40.0) ** 2
    there = np.sin(np.pi * (col - shift) / 40.0) ** 2
    found = skeleton_distance(skeletons(here), skeletons(there), pixel_mm=0.01)
    assert found["skeleton_distance_px"] == pytest.approx(shift, abs=0.06)
    assert found["skeleton_distance_mm"] == pytest.approx(0.01 * found["skeleton_distance_px"])
    assert found["skeleton_matched_share"] > 0.94  # a line may lie within the rim of one side only


def test_a_missing_line_lowers_the_matched_share_only_and_orders_keep_neighbours_apart():
    col = np.indices((80, 200))[1] / 40.0
    whole = order_contours(col, [1.0, 2.0, 3.0, 4.0])
    found = skeleton_distance([line for line in whole if line.order != 3.0], whole)
    assert found["skeleton_distance_px"] == 0.0 and found[
        "skeleton_matched_share"
    ] == pytest.approx(6 / 7)
    nothing = skeleton_distance([], whole)
    assert np.isnan(nothing["skeleton_distance_px"]) and nothing["skeleton_matched_share"] == 0.0
    with pytest.raises(InputError, match="no fringe line"):
        skeleton_distance([], [])
    col = np.indices((40, 100))[1] / 10.0
    here, there = order_contours(col, [3.0]), order_contours(col, [4.0])
    assert np.isnan(skeleton_distance(here, there)["skeleton_distance_px"])


def line(col, rows=41, kind="dark", order=None):
    """A straight fringe line down a column."""
    return Skeleton(kind, np.arange(float(rows)), np.full(rows, float(col)), order)


@pytest.mark.parametrize("reach_px", [None, 30.0, np.inf])
def test_a_line_without_a_partner_has_no_distance_however_far_one_looks(reach_px):
    """Its gap is infinite: it counts among the unmatched and in no mean."""
    alone = skeleton_distance([line(5)], [line(5, kind="bright")], reach_px=reach_px)
    assert np.isnan(alone["skeleton_distance_px"]) and alone["skeleton_matched_share"] == 0.0
    beside = skeleton_distance([line(5)], [line(8), line(9, kind="bright")], reach_px=reach_px)
    assert beside["skeleton_distance_px"] == 3.0
    assert beside["skeleton_matched_share"] == pytest.approx(2 / 3)


def test_both_directions_count_alike_and_only_within_reach():
    """A short line 2 px off a long one, and a line 19 or 21 px off that nothing else is near."""
    found = skeleton_distance([line(0, rows=11)], [line(2, rows=101)], reach_px=5.0)
    # 11 points there at 2 px; back 11 at 2 px and, within 5 px of the short line's end,
    # sqrt(4 + k^2), k = 1 .. 4
    back = np.sqrt(4.0 + np.concatenate([np.zeros(11), np.arange(1.0, 5.0)]) ** 2)
    assert found["skeleton_distance_px"] == pytest.approx(0.5 * (2.0 + back.mean()), abs=1e-9)
    assert found["skeleton_matched_share"] == pytest.approx(26 / 112)
    assert skeleton_distance([line(0)], [line(19)])["skeleton_distance_px"] == pytest.approx(19.0)
    assert np.isnan(skeleton_distance([line(0)], [line(21)])["skeleton_distance_px"])
    known = [line(0, order=1.0)], [line(99, order=1.0)]
    assert skeleton_distance(*known)["skeleton_distance_px"] == pytest.approx(99.0)


def test_a_point_between_two_of_the_other_line_is_as_near_as_the_line():
    """A line of few points is filled up: here its ends are 100 px apart."""
    long = Skeleton("dark", np.array([0.0, 100.0]), np.array([7.0, 7.0]), None)
    point = Skeleton("dark", np.array([50.05]), np.array([10.0]), None)
    found = skeleton_distance([point], [long], reach_px=4.0)
    # filled up every 0.2 px, the nearest is at most 0.1 px along the line: 3 px to 2e-3
    assert found["skeleton_distance_px"] == pytest.approx(3.0, abs=2e-3)


def test_ssim_cannot_judge_accuracy_and_the_others_can(order, signal):
    """ANCHORS: a perfect model scores .893 against one noisy frame, 1 % off in load .890."""
    rng = np.random.default_rng(3)
    measured = signal + NOISE * rng.standard_normal(signal.shape)
    off_order = hertz_order(11.0 * 1.01)
    off = np.sin(np.pi * off_order) ** 2
    perfect = compare_signals(measured, signal, noise=NOISE)
    wrong = compare_signals(measured, off, noise=NOISE)
    assert perfect["ssim"] < 0.92  # a perfect model looks bad
    assert perfect["ssim"] - wrong["ssim"] < 0.02  # and hardly better than a wrong one
    assert (
        perfect["rmse_over_noise"] == pytest.approx(1.0, abs=0.01)
        and wrong["rmse_over_noise"] > 1.5
    )
    assert (
        perfect["ncc"] > wrong["ncc"]
        and compare_orders(order, off_order)["order_rms_fringe"] > 0.005
    )
    apart = skeleton_distance(order_contours(order), order_contours(off_order))
    assert 0.5 < apart["skeleton_distance_px"] < 3.0


def frame_set(order, **more):
    return ComparedFrames(signal=np.sin(np.pi * order) ** 2, order=order, **more)


def test_frames_are_paired_one_to_one_or_one_to_all(order):
    small = order[:120, 200:400]
    experiment = frame_set(np.stack([small, 1.02 * small]), labels=("static", "sliding, 31 m"))
    found = compare_frames(experiment, frame_set(small[None], pixel_mm=PIXEL_MM))
    assert [(each.frame, each.label) for each in found] == [(0, "static"), (1, "sliding, 31 m")]
    assert found[0].order_rms_fringe == 0.0 and found[1].order_bias_fringe > 0.005
    assert found[1].skeleton_distance_mm > 0
    with pytest.raises(InputError, match="2 frames of the experiment and 3"):
        compare_frames(experiment, frame_set(np.stack([small] * 3)))
    with pytest.raises(InputError, match="rows x columns"):
        compare_frames(experiment, frame_set(small[None, :-1]))
    scaled = frame_set(small[None], pixel_mm=0.01), frame_set(small[None], pixel_mm=0.0101)
    with pytest.raises(InputError, match=r"0\.01 .*0\.0101"):
        compare_frames(*scaled)


def test_a_frame_without_orders_falls_back_to_its_signal(order):
    small = order[None, :120, 200:400]
    signal_only = ComparedFrames(signal=np.sin(np.pi * small) ** 2, noise=np.array([0.01]))
    found = compare_frames(signal_only, frame_set(small))[0]
    assert found.order_rms_fringe is None and found.skeleton_distance_px < 0.05
    assert found.rmse_over_noise < 1e-9
    empty = ComparedFrames(signal=np.full(small.shape, np.nan))
    with pytest.raises(InputError, match="frame 0"):
        compare_frames(empty, frame_set(small))


@pytest.mark.parametrize(
    "wrong",
    [
        {"signal": np.zeros((4, 4))},
        {"signal": np.zeros((0, 4, 4))},
        {"signal": np.zeros((1, 4, 4)), "order": np.zeros((2, 4, 4))},
        {"signal": np.zeros((1, 4, 4)), "labels": ("a", "b")},
        {"signal": np.zeros((1, 4, 4)), "pixel_mm": 0.0},
        {"signal": np.zeros((3, 4, 4)), "noise": np.zeros(2)},
    ],
)
def test_frame_sets_that_disagree_are_refused(wrong):
    with pytest.raises(InputError):
        ComparedFrames(**wrong)


@pytest.mark.parametrize(("noise", "known"), [(0.0, None), (np.nan, None), (0.02, 0.02)])
def test_a_noise_of_zero_or_none_is_not_known(noise, known):
    """A frame without its noise is compared all the same, but for the residual over noise."""
    rng = np.random.default_rng(4)
    frames = ComparedFrames(signal=rng.random((1, 12, 15)), noise=np.array([noise]))
    assert frames.noise_of(0) == known
    (found,) = compare_frames(frames, ComparedFrames(signal=rng.random((1, 12, 15))))
    assert np.isnan(found.rmse_over_noise) == (known is None)
