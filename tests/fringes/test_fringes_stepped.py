"""Phase-stepped sets: linear algebra against Jones products, maps against the scene's own field."""

import closed_forms
import numpy as np
import pytest
from closed_forms import step_light
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter

from isochrome.errors import InputError
from isochrome.fringes import (
    COSINE,
    CROSS,
    SINE,
    SINE_SINE,
    Balance,
    Direction,
    balance,
    fill_gaps,
    make_design,
    read_steps,
    settle,
    solve_steps,
    unwrap,
)
from isochrome.simulation import simulate
from stepped_sets import (
    BEAM,
    CIRCULAR,
    PLANE,
    TEN,
    a_scene,
    as_steps,
    captured,
    chains_at,
    chains_of,
    contact,
    disc,
    errors,
    light_of,
    read,
    small,
    truth,
)

UNMATCHED = {"polariscope.plate_wavelength_nm": 0.95 * 587.0}
MISALIGNED = {
    "polariscope.polariser_error_deg": 0.7, "polariscope.input_plate_error_deg": -1.0,
    "polariscope.output_plate_error_deg": 0.8, "polariscope.analyser_error_deg": -0.5,
}  # fmt: skip


angles = st.floats(0.0, 180.0)
four_angles = st.one_of(
    st.tuples(angles, angles, angles, angles), st.tuples(angles, st.none(), st.none(), angles)
)


@settings(max_examples=60)
@given(
    extra=st.lists(four_angles, max_size=5), ratio=st.floats(0.85, 1.15),
    delta=st.floats(-20.0, 20.0), theta=angles, amplitude=st.floats(0.1, 2.0),
    background=st.floats(0.0, 1.0),
)  # fmt: skip
def test_maps_are_exact_for_any_angles_and_plates(
    extra, ratio, delta, theta, amplitude, background
):
    steps = TEN + extra
    plates = {"wavelength_nm": 600.0, "plate_wavelength_nm": 600.0 * ratio}
    design = make_design(chains_at(steps, **plates))
    assert CROSS in design.solved
    field = delta / (2.0 * np.pi) * np.exp(2j * np.radians(theta))
    light = [
        step_light(field, four, background=background, amplitude=amplitude, plate=ratio)
        for four in steps
    ]
    terms = solve_steps(np.array(light)[:, None, None], design)
    turn = np.exp(2j * np.radians(theta))
    # float64 through a matrix whose inverse is of order 10
    assert terms.cosine[0, 0] == pytest.approx(amplitude * np.cos(delta), abs=1e-9)
    assert terms.sine[0, 0] == pytest.approx(amplitude * np.sin(delta) * turn, abs=1e-9)
    assert terms.cross[0, 0] == pytest.approx(amplitude * (1 - np.cos(delta)) * turn**2, abs=1e-9)
    assert terms.amplitude[0, 0] == pytest.approx(amplitude, abs=1e-9)


@settings(max_examples=60)
@given(
    steps=st.lists(st.tuples(angles, angles, angles, angles), min_size=8, max_size=12),
    delta=st.floats(-20.0, 20.0),
    theta=angles,
)
def test_random_steps_are_exact_or_refused(steps, delta, theta):
    try:
        design = make_design(chains_at(steps, wavelength_nm=600.0, plate_wavelength_nm=630.0))
    except InputError:
        assume(False)
    turn = np.exp(2j * np.radians(theta))
    field = delta / (2.0 * np.pi) * turn
    light = [step_light(field, four, amplitude=1.0, plate=1.05) for four in steps]
    terms = solve_steps(np.array(light)[:, None, None], design, np.array([[turn]]))
    # what is left out leaks by a tenth at most: four passes leave (2 x 0.1)^5 of it
    tolerance = 1e-3 if design.leaks else 1e-9
    assert terms.cosine[0, 0] == pytest.approx(np.cos(delta), abs=tolerance)
    assert terms.sine[0, 0] == pytest.approx(np.sin(delta) * turn, abs=tolerance)


def test_six_steps_with_misaligned_elements_take_out_what_they_cannot_solve_for():
    values = {k.split(".")[1]: v for k, v in (MISALIGNED | UNMATCHED).items()}
    design = make_design(chains_at(CIRCULAR, **values))
    assert design.leaks and CROSS not in design.solved
    shift = list(MISALIGNED.values())
    delta, turn = 2.0, np.exp(2j * np.radians(25.0))
    field = delta / (2.0 * np.pi) * turn
    light = [step_light(field, np.add(four, shift), amplitude=0.7, plate=0.95) for four in CIRCULAR]
    stack = np.array(light)[:, None, None]
    first = solve_steps(stack, design)
    second = solve_steps(stack, design, np.array([[turn]]))
    # errors of 1 degree (0.03 rad of 2θ), five times over, of an amplitude of 1
    assert abs(second.cosine[0, 0] - 0.7 * np.cos(delta)) < 1e-5
    assert abs(second.sine[0, 0] - 0.7 * np.sin(delta) * turn) < 1e-5
    assert abs(first.sine[0, 0] - 0.7 * np.sin(delta) * turn) > 1e-3


@pytest.mark.parametrize(
    ("steps", "missing"),
    [
        (PLANE, ["sin δ cos 2θ", "sin δ sin 2θ"]),
        (CIRCULAR[:2], ["sin δ cos 2θ", "sin δ sin 2θ"]),
        (CIRCULAR[2:], ["cos δ (add"]),
        ([*CIRCULAR[:2], CIRCULAR[2], CIRCULAR[4]], ["sin δ cos 2θ"]),
        ([*CIRCULAR[:2], CIRCULAR[3], CIRCULAR[5]], ["sin δ sin 2θ"]),
    ],
)
def test_steps_that_cannot_tell_the_order_are_refused_with_those_that_would(steps, missing):
    with pytest.raises(InputError, match=r"\[\[polariscope.step\]\]") as refused:
        make_design(chains_at(steps))
    for words in missing:
        assert words in str(refused.value)
    told = {"sin δ cos 2θ": [(90, 45, 45, 45), (90, 45, 135, 135)],
            "sin δ sin 2θ": [(90, 45, 0, 0), (90, 45, 90, 90)],
            "cos δ (add": [(90, 45, -45, 0), (90, 45, -45, 90)]}  # fmt: skip
    advised = [four for words in told if words in str(refused.value) for four in told[words]]
    make_design(chains_at([*steps, *advised]))  # the advice is enough


def test_steps_a_little_off_do_not_solve_for_what_they_hardly_tell():
    """Two circular sets, every element off by some degrees: cos δ and sin δ keep their noise."""
    off = np.random.default_rng(2).normal(0.0, 6.0, (12, 4))
    exact, turned = (
        make_design(chains_at([tuple(four) for four in np.array(CIRCULAR * 2) + by]))
        for by in (0.0, off)
    )
    # unit noise over twelve frames: 1 for exact elements, 1.22 at most for these; it is 4.8 where
    # background and 4θ, which they tell by their errors alone, are solved for too
    for term in (COSINE, SINE, SINE_SINE):
        assert exact.variance(term) == pytest.approx(1.0) and turned.variance(term) < 1.5


def test_the_order_of_the_steps_does_not_matter():
    scene = small(contact(0.3))
    light, valid, sigma = captured(scene)
    chains, mixed = chains_of(scene), [7, 2, 9, 0, 4, 1, 8, 3, 6, 5]
    one = read_steps(light, chains, sigma=sigma, valid=valid)
    other = read_steps(light[mixed], [chains[i] for i in mixed], sigma=sigma, valid=valid)
    # single precision sums in another order: 1e-6 of the light, 1e-5 fringe
    both = np.isfinite(one.order) & np.isfinite(other.order)
    assert both.mean() > 0.95 and np.abs(one.order - other.order)[both].max() < 1e-4


@pytest.mark.parametrize(
    ("scene", "highest"),
    [
        pytest.param(disc(), 17.0, marks=pytest.mark.study),
        (disc(**UNMATCHED, **MISALIGNED), 17.0),
        pytest.param(contact(), 3.0, marks=pytest.mark.study),
        pytest.param(contact(0.3), 3.4, marks=pytest.mark.long),
    ],
    ids=["disc", "disc, real elements", "contact", "sliding contact"],
)
def test_ten_steps_are_read_to_a_two_hundredth_of_a_fringe(scene, highest):
    found = read(scene)
    order, turn, kept = errors(found, scene)
    assert np.sqrt(np.mean(order**2)) <= 0.005
    assert np.abs(order).max() < 0.25  # no wrong branch
    assert np.median(np.abs(turn)) <= 0.1
    assert np.abs(turn).max() < 45.0  # sigma_1 is nowhere taken for sigma_2
    assert kept > 0.95 and np.nanmax(found.order) > highest
    assert found.chi == pytest.approx(1.0, abs=0.02)
    assert found.warnings == () and found.parts[0].source == "equilibrium"
    right = (np.abs(order) < 0.05).mean()
    known = found.reading.confidence > 0.0
    assert right == pytest.approx(found.reading.confidence[known].mean(), abs=2e-3)
    pull = order / found.reading.uncertainty[np.isfinite(found.order)]
    assert 0.9 < np.sqrt(np.mean(pull**2)) < 1.1


@pytest.mark.long
def test_six_circular_steps_are_enough():
    scene = contact(0.3, steps=CIRCULAR)
    order, turn, kept = errors(read(scene), scene)
    assert np.sqrt(np.mean(order**2)) <= 0.005 and np.abs(order).max() < 0.25
    # no plane images: a whole order says nothing of the direction, a half one less
    assert np.median(np.abs(turn)) <= 0.2 and kept > 0.95


@pytest.mark.study
def test_six_steps_with_real_plates_leave_out_what_they_cannot_tell():
    """Wide half orders: what the plates leak of 4θ there is more than sin δ exp 2iθ itself."""
    values = {"polariscope.plate_wavelength_nm": 557.0, "load.bulk_mpa": 12.0}
    scene = contact(steps=CIRCULAR, **values).with_values(
        {"load.normal_n": 19.3, "camera.left_mm": -1.1}
    )
    order, turn, kept = errors(read(scene), scene)
    assert np.abs(order).max() < 0.25 and np.abs(turn).max() < 45.0 and kept > 0.85


@pytest.mark.long
@pytest.mark.parametrize("scene", [disc(), contact(0.3)], ids=["disc", "contact"])
def test_noise_of_ten_grey_levels_is_told_and_breaks_no_branch(scene):
    scene = scene.with_values({"camera.noise_grey": 10.0})
    found = read(scene)
    order, turn, kept = errors(found, scene)
    assert np.abs(order).max() < 0.25 and kept > 0.9
    pull = order / found.reading.uncertainty[np.isfinite(found.order)]
    assert 0.9 < np.sqrt(np.mean(pull**2)) < 1.1 and np.abs(turn).max() < 45.0


@pytest.mark.long
@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(n, marks=pytest.mark.study) for n in range(2, 6))]
)
def test_random_angles_and_loads_break_no_branch(seed):
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.0, 180.0, (10, 4)).tolist()
    values = {"load.bulk_mpa": rng.uniform(-10, 10), "polariscope.plate_wavelength_nm": 620.0}
    scene = contact(rng.uniform(0.05, 0.4), steps=steps, **values)
    order, turn, kept = errors(read(scene), scene)
    assert np.abs(order).max() < 0.25 and np.abs(turn).max() < 45.0 and kept > 0.9


def test_wrong_angles_give_a_poor_chi_and_that_is_said():
    scene = small(contact(0.3))
    light, valid, sigma = captured(scene)
    steps = [*CIRCULAR, *PLANE[:3], (170.0, None, None, 80.0)]
    wrong = scene.with_values({"polariscope.step": as_steps(steps)})
    found = read_steps(light, chains_of(wrong), sigma=sigma, valid=valid)
    assert found.chi > 1.3 and "the steps' angles or plates" in " ".join(found.warnings)
    right = read_steps(light, chains_of(scene), sigma=sigma, valid=valid)
    assert np.isfinite(right.isoclinic).mean() > 0.5 and right.warnings == ()
    assert np.isnan(found.isoclinic).all() and np.isnan(found.isoclinic_uncertainty).all()
    assert "no isoclinic is given" in " ".join(found.warnings)


def test_where_one_frame_is_spoilt_its_pixels_alone_have_no_isoclinic():
    """A reflection of a tenth of full scale in one of ten frames, over a part of the picture."""
    scene = small(contact(0.3))
    light, valid, sigma = captured(scene)
    order = truth(scene)[0]
    points = [(row, col, float(order[row, col])) for row, col in ((120, 30), (110, 110))]
    whole = read_steps(light, chains_of(scene), sigma=sigma, valid=valid, known_order=points)
    spoilt = np.zeros(valid.shape, dtype=bool)
    spoilt[60:80, 90:120] = True
    assert spoilt.mean() < 0.05
    light = light.copy()
    light[7][spoilt] += 0.1
    found = read_steps(light, chains_of(scene), sigma=sigma, valid=valid, known_order=points)
    assert np.isfinite(whole.isoclinic[spoilt]).any()
    assert not np.isfinite(found.isoclinic[spoilt]).any()
    far = ~maximum_filter(spoilt, 25)
    same = np.isfinite(found.isoclinic) == np.isfinite(whole.isoclinic)
    assert same[far].mean() > 0.999
    np.testing.assert_allclose(found.isoclinic[far], whole.isoclinic[far], atol=0.5)


@pytest.mark.long
def test_saturated_pixels_are_masked_and_the_rest_is_right():
    scene = small(contact(0.3, **{"camera.brightness": 1.02}), 2)
    light, valid, sigma = captured(scene)
    assert 0.05 < 1.0 - valid.mean() < 0.3
    found = read_steps(light, chains_of(scene), sigma=sigma, valid=valid)
    assert not np.isfinite(found.order[~valid]).any()
    order, _, _ = errors(found, scene)
    assert order.size > 0.6 * valid.size and np.abs(order).max() < 0.25


@pytest.mark.long
@pytest.mark.parametrize("steps", [TEN, CIRCULAR], ids=["ten", "six"])
def test_a_saturated_frame_is_left_out_of_a_pixel_and_the_others_are_used(steps):
    """Over half of the pixels are saturated in one frame or more."""
    scene = small(contact(0.3, steps=steps, **{"camera.brightness": 1.15}), 2)
    light, good, sigma = light_of(simulate(scene).frames, scene)
    assert good.all(axis=0).mean() < 0.5
    found = read_steps(light, chains_of(scene), sigma=sigma, valid=good)
    order, turn, kept = errors(found, scene)
    assert kept > 0.95 and found.warnings == ()
    assert np.sqrt(np.mean(order**2)) <= 0.005 and np.abs(order).max() < 0.25
    assert np.abs(turn).max() < 45.0
    pull = order / found.reading.uncertainty[np.isfinite(found.order)]
    assert np.sqrt(np.mean(pull**2)) < 1.1  # the gap's own noise is told


def test_gaps_are_filled_with_what_least_squares_of_the_rest_gives():
    rng = np.random.default_rng(8)
    design = make_design(chains_of(disc()))
    light, good = rng.uniform(0.1, 0.9, (10, 40, 1)), np.ones((10, 40, 1), bool)
    for pixel in range(30):
        good[rng.choice(10, pixel % 4, replace=False), pixel] = False
    good[:4, 30] = False  # six left, and seven unknowns
    good[:, 31] = False
    filled, (gain, _) = fill_gaps(np.where(good, light, 0.0), good, design)
    terms = solve_steps(filled, design)
    assert (filled[good] == light[good]).all()
    told = np.isfinite(gain[:, 0])
    assert not told[30] and not told[31] and told.sum() > 30
    for pixel in np.flatnonzero(told):
        there = good[:, pixel, 0]
        alone, *_ = np.linalg.lstsq(design.matrix[there], light[there, pixel, 0], rcond=None)
        # two ways through the same equations, of a condition under a hundred
        assert terms.cosine[pixel, 0] == pytest.approx(alone[2], abs=1e-6)
        assert terms.sine[pixel, 0] == pytest.approx(alone[5] + 1j * alone[6], abs=1e-6)
    assert (gain[30:, 0][told[30:]] == 1.0).all() and np.nanmin(gain) == 1.0


def test_a_pixel_whose_other_frames_tell_badly_is_not_read():
    """Without plates at 45° and 135°, sin δ cos 2θ is told by those at 8° alone."""
    angles = [*CIRCULAR, *PLANE[:3], (90, 45, 8, 8)]
    design = make_design(chains_at(angles))
    good = np.ones((10, 4, 1), bool)
    good[3, 1] = good[4, 2] = False
    good[[3, 5], 3] = False
    covariance = np.linalg.inv(design.matrix.T @ design.matrix)
    growth = []
    for pixel in range(4):
        part = design.matrix[good[:, pixel, 0]]
        less = np.diag(np.linalg.inv(part.T @ part)) / np.diag(covariance)
        growth.append(np.sqrt(less[1:].max()))  # the background is not used
    assert growth[0] == pytest.approx(1.0) and max(growth[1:3]) < 2.0 and 5.0 < growth[3] < 10.0
    _, (gain, _) = fill_gaps(np.where(good, 0.5, 0.0), good, design)
    assert gain[:3, 0] == pytest.approx(growth[:3], rel=1e-5) and np.isnan(gain[3, 0])


def test_frames_without_a_readable_pixel_and_known_orders_outside_are_said():
    rng = np.random.default_rng(5)
    light = rng.normal(0.5, 0.01, (10, 60, 80))
    found = read_steps(light, chains_of(disc()), sigma=0.01)
    assert not np.isfinite(found.order).any() and not np.isfinite(found.isoclinic).any()
    assert (found.reading.confidence == 0.0).all() and found.reading.kept == 0.0
    assert any("could be read" in words for words in found.warnings)
    found = read(small(disc(**{"load.normal_n": 150.0}), 2), known_order=[(5, 5, 0.0)])
    assert "row 5, column 5" in " ".join(found.warnings) and found.parts[0].source == "equilibrium"


def disc_field(side=400, radius=170.0):
    """(sigma_1 - sigma_2) exp 2iθ of a disc, y upward, 0 outside, and where its pixels are."""
    field = closed_forms.disc((side, side), radius, 4.0)
    return np.nan_to_num(field), np.isfinite(field)


@pytest.mark.parametrize("wrong", [-3, 0, 4])
def test_equilibrium_gives_the_whole_number_of_a_disc(wrong):
    field, inside = disc_field()
    twice = np.where(inside, field / np.maximum(np.abs(field), 1e-12), 0.0)
    turns = np.abs(field) - wrong
    found = balance(turns, twice, inside, spread=np.full(inside.shape, 1e-3))
    # blocks of four pixels and Gaussians cut off at 3.5 widths: a hundredth
    assert found.number == pytest.approx(wrong, abs=0.05) and found.whole == wrong
    flipped = balance(-turns, -twice, inside, spread=np.full(inside.shape, 1e-3))
    assert flipped.number == pytest.approx(-wrong, abs=0.05)  # the same n


@pytest.mark.parametrize(
    ("number", "uncertainty", "whole"),
    # 0.3 of a fringe is the most that distance and twice the uncertainty may be together
    [(2.0, 0.1, 2), (1.9, 0.08, 2), (-3.0, 0.14, -3), (2.0, 0.2, None), (1.75, 0.05, None)],
)
def test_a_whole_number_is_left_open_where_it_is_uncertain(number, uncertainty, whole):
    assert Balance(number, uncertainty).whole == whole


def test_the_uncertainty_of_a_parts_number_covers_its_error():
    """A disc's direction under noise: the number that equilibrium gives, over twelve seeds."""
    field, inside = disc_field(240, 105.0)
    size = np.maximum(np.abs(field), 1e-12)
    noise, pulls = 0.1, []
    for seed in range(12):
        turn = noise * np.random.default_rng(seed).standard_normal(field.shape)
        twice = np.where(inside, field / size * np.exp(1j * turn), 0.0)
        spread = np.full(inside.shape, noise)
        found = balance(np.abs(field) - 2.0, twice, inside, spread=spread)
        pulls.append((found.number - 2.0) / found.standard_uncertainty)
    # 0.28: on the safe side, as the misfit of blocks at the edge is counted as noise
    assert 0.1 < np.sqrt(np.mean(np.square(pulls))) < 0.9, pulls


def test_equilibrium_does_not_pretend_where_the_direction_does_not_vary():
    rng = np.random.default_rng(3)
    rows, cols = 300, 400
    turns = np.repeat(np.linspace(-5.3, 4.2, rows)[:, None], cols, axis=1)
    noise = 0.02
    twice = np.exp(1j * noise * rng.normal(size=(rows, cols)))
    inside = np.ones((rows, cols), bool)
    found = balance(turns, twice, inside, spread=np.full(inside.shape, noise))
    assert found is None or found.whole is None


@pytest.mark.long
def test_a_beam_needs_an_anchor_and_takes_its_neutral_axis_from_one():
    scene = small(a_scene(BEAM, pixel_mm=0.05), 2)
    order, _ = truth(scene)
    row, col = int(np.nanargmin(np.abs(order[:110, 150] - 3.72))), 150
    alone = read(scene)
    assert not np.isfinite(alone.order).any()  # no light can tell a bent beam from a pulled one
    assert "give a point of it in [[frames.known_order]]" in alone.warnings[0]
    heavier = scene.with_values({"load.normal_n": 220.0})
    for options, source in (
        ({"known_order": [(row, col, float(order[row, col]))]}, "known order"),
        ({"model": lambda: truth(heavier)[0]}, "model"),
    ):
        found = read(scene, **options)
        assert found.parts[0].source == source
        wrong, turn, kept = errors(found, scene)
        assert np.abs(wrong).max() < 0.25 and kept > 0.95
        assert np.abs(turn).max() < 45.0  # sigma_1 turns by 90 degrees at the neutral axis


def test_known_orders_go_before_equilibrium_and_their_quarrel_is_said():
    scene = small(contact(0.3))
    order, _ = truth(scene)
    # 2 N far from a whole number: N and -N then ask for different whole numbers
    row, col = np.unravel_index(np.nanargmin(np.abs(order - 1.72)), order.shape)
    right = float(order[row, col])
    found = read(scene, known_order=[(row, col, right)])
    assert found.parts[0].source == "known order" and found.warnings == ()
    other = read(scene, known_order=[(row, col, right + 1.0)])
    assert "disagree by 1 fringe" in " ".join(other.warnings)
    assert other.order[row, col] == pytest.approx(right + 1.0, abs=0.05)
    neither = read(scene, known_order=[(row, col, right + 0.28)])
    assert not np.isfinite(neither.order).any()
    assert "disagrees with the light" in " ".join(neither.warnings)


def test_a_model_that_singles_out_no_whole_number_gives_none():
    """A ramp of orders, and a model that is half a fringe off: m and m + 1 are as likely."""
    order = np.tile(np.linspace(2.0, 6.0, 200), (150, 1))
    still, ones = np.full(order.shape, 1e-3), np.ones(order.shape)
    direction = Direction(ones.astype(complex), still, still, still)
    known = np.ones(order.shape, bool)
    for off, source in ((0.1, "model"), (0.5, "none")):
        _, parts, notes = settle(order - 3.0, direction, known, model=lambda away=off: order + away)
        assert parts[0].source == source and notes
        assert parts[0].number == (3 if source == "model" else None)


def test_unwrapping_leaves_out_what_is_not_a_number():
    rows, cols = np.mgrid[:60, :80]
    true = 0.31 * cols + 0.12 * rows
    phase = np.angle(np.exp(1j * true))
    phase[20:24, 30:50] = np.nan
    mask = np.ones(phase.shape, bool)
    mask[:, :3] = False
    found = unwrap(phase, mask)
    assert (np.isnan(found) == (np.isnan(phase) | ~mask)).all()
    shift = (found - true)[np.isfinite(found)]
    assert np.ptp(shift) < 1e-6  # scikit-image works in double precision
    assert np.isnan(unwrap(phase, np.zeros_like(mask))).all()


def test_small_parts_are_left_open():
    """A spot apart from the rest has no whole number of its own, nor does it take the rest's."""
    field, inside = disc_field()
    inside[2:8, 2:8] = True
    turns = np.abs(field) - 2.0
    twice = np.where(np.abs(field) > 0, field / np.maximum(np.abs(field), 1e-12), 1.0)
    still = np.full(inside.shape, 1e-3)
    direction = Direction(twice, still, still, still)
    numbers, parts, _ = settle(turns, direction, inside)
    assert np.isnan(numbers[2:8, 2:8]).all() and len(parts) == 1
    assert (numbers[inside & np.isfinite(numbers)] == 2.0).all()
