"""Residual stress taken out as a tensor: rendered sums of stresses, in equilibrium, known apart."""

import numpy as np
import pytest
from closed_forms import step_light
from plain_frames import seeds

from isochrome.fringes import StepTerms, balance, least_field, read_residual, read_steps
from stepped_sets import (
    BEAM,
    CIRCULAR,
    TEN,
    a_scene,
    chains_at,
    chains_of,
    contact,
    disc,
    disc_residual,
    layer_residual,
    light_of,
    small,
    waves_residual,
    with_residual,
)


def unloaded(sets, scene):
    light, good, sigma = light_of(sets.unloaded, scene)
    return read_residual(light, chains_of(scene), sigma=sigma, valid=good)


def of_load(sets, scene, residual, **options):
    light, good, sigma = light_of(sets.loaded, scene)
    return read_steps(
        light, chains_of(scene), sigma=sigma, valid=good, residual=residual, **options
    )


def right(found, sets, *, kept=0.95, rms=0.005):
    """The errors of the order, that is known nearly everywhere, and nowhere of another branch."""
    error = (found.order - sets.order)[np.isfinite(found.order)]
    assert error.size > kept * np.isfinite(sets.order).sum() and np.abs(error).max() < 0.25
    assert np.sqrt(np.mean(error**2)) <= rms
    return error


def turn_of(found, sets):
    turn = (found.isoclinic - sets.direction + 90.0) % 180.0 - 90.0
    return np.abs(turn[np.isfinite(turn)])


def scalar_error(sets):
    """RMS error of the load's order if orders were subtracted in the place of tensors."""
    return np.sqrt(np.nanmean((np.abs(sets.shown - sets.residual_order) - sets.order) ** 2))


def layered_contact(**values):
    scene = contact(0.3, **values)
    return scene, layer_residual(scene, 0.3, 3.0)


def light_disc():
    scene = disc(**{"load.normal_n": 60.0})
    return scene, disc_residual(scene, 0.35)


def quenched_disc():
    scene = disc()
    return scene, disc_residual(scene, 0.45)


@pytest.mark.long
@pytest.mark.parametrize(
    "case",
    [
        *(pytest.param(d, marks=pytest.mark.study) for d in (light_disc, quenched_disc)),
        layered_contact,
    ],
)
def test_the_loads_own_field_is_left(case):
    scene, residual = case()
    sets = with_residual(scene, residual, exposure=0.9)
    apart = unloaded(sets, scene)
    found = of_load(sets, scene, apart)
    error = right(found, sets)
    assert scalar_error(sets) > 0.1  # directions differ: orders do not subtract
    turn = turn_of(found, sets)
    assert np.median(turn) <= 0.1 and turn.max() < 45.0 and turn.size > 0.9 * error.size
    assert found.parts[0].source == "equilibrium" and found.warnings == () and apart.warnings == ()
    pull = error / found.reading.uncertainty[np.isfinite(found.order)]
    assert 0.85 < np.sqrt(np.mean(pull**2)) < 1.1
    # the dark field is that of the load alone
    dark = found.dark_field - np.sin(np.pi * sets.order) ** 2
    assert np.sqrt(np.nanmean(dark**2)) < np.pi * 0.005


@pytest.mark.long
@pytest.mark.parametrize("highest", [0.05, 0.7])
def test_the_residual_stress_is_read_even_beyond_half_an_order(highest):
    """A direction that does not vary: equilibrium is silent, and most of the beam is below 1/2."""
    scene = small(a_scene(BEAM, pixel_mm=0.05), 2)
    residual = layer_residual(scene, highest, 20.0)
    sets = with_residual(scene, residual)
    found = unloaded(sets, scene)
    # y upward in the reading, z downward in the stress
    true = np.conj(residual) * 6.0 / 7.0
    error = np.abs(found.field - true)[np.isfinite(found.field)]
    assert error.size > 0.95 * np.isfinite(sets.order).sum()
    assert np.sqrt(np.mean(error**2)) <= 0.005 and error.max() < 0.1 and found.warnings == ()
    assert found.largest == pytest.approx(np.nanmax(sets.residual_order), abs=0.03)
    strong = np.isfinite(found.field) & (sets.residual_order > 0.5 * highest)
    turn = found.isoclinic[strong] + 0.5 * np.degrees(np.angle(residual[strong]))
    turn = np.abs((turn + 90.0) % 180.0 - 90.0)
    # noise of 0.0013 fringe, across 0.025 of them and more: 1.5 degrees at most
    assert np.isfinite(turn).mean() > 0.95 and np.nanmedian(turn) < 1.5


@pytest.mark.long
def test_a_specimen_without_residual_stress_stays_as_it_is():
    scene = small(contact(0.3), 2)
    sets = with_residual(scene, np.zeros((247, 329), complex))
    apart = unloaded(sets, scene)
    assert apart.largest == 0.0 and apart.kept > 0.95 and apart.warnings == ()
    told = np.isfinite(apart.isoclinic).mean()
    assert told < 0.03  # three standard uncertainties of two components of noise: exp(-9/2)
    with_it, without = of_load(sets, scene, apart), of_load(sets, scene, None)
    both = np.isfinite(with_it.order) & np.isfinite(without.order)
    assert both.sum() > 0.97 * np.isfinite(without.order).sum()
    spread = np.hypot(with_it.reading.uncertainty, without.reading.uncertainty)
    change = (with_it.order - without.order) / spread
    assert np.sqrt(np.mean(change[both] ** 2)) < 1.0
    assert np.sqrt(np.mean((with_it.order - sets.order)[both] ** 2)) <= 0.005


@pytest.mark.study
def test_six_circular_steps_take_it_out_too():
    scene, residual = layered_contact(steps=CIRCULAR)
    sets = with_residual(scene, residual)
    found = of_load(sets, scene, unloaded(sets, scene))
    right(found, sets)
    # no plane images: as without residual stress
    assert np.median(turn_of(found, sets)) <= 0.2


@pytest.mark.long
def test_the_whole_number_of_a_loaded_disc_needs_the_residual_to_be_left_out_of_compatibility():
    scene, _ = light_disc()
    sets = with_residual(scene, disc_residual(scene, 0.45))
    with_it, without = of_load(sets, scene, unloaded(sets, scene)), of_load(sets, scene, None)
    assert with_it.parts[0].source == "equilibrium" and without.parts[0].source == "none"


@pytest.mark.long
def test_known_orders_and_models_are_those_of_the_frames_residual_stress_and_all():
    scene = small(a_scene(BEAM, pixel_mm=0.05), 2)
    sets = with_residual(scene, layer_residual(scene, 0.4, 20.0))
    apart = unloaded(sets, scene)
    row, col = np.unravel_index(np.nanargmin(np.abs(sets.shown - 2.72)), sets.shown.shape)
    for options, source in (
        ({"known_order": [(int(row), int(col), 2.72)]}, "known order"),
        ({"model": lambda: sets.shown}, "model"),
    ):
        found = of_load(sets, scene, apart, **options)
        assert found.parts[0].source == source
        right(found, sets, kept=0.9)


@pytest.mark.long
def test_where_the_residual_is_not_known_nor_is_the_load():
    scene = small(contact(0.3), 2)
    sets = with_residual(scene, layer_residual(scene, 0.2, 3.0))
    light, good, sigma = light_of(sets.unloaded, scene)
    good[:, 100:140, 60:200] = False
    apart = read_residual(light, chains_of(scene), sigma=sigma, valid=good)
    assert not np.isfinite(apart.field[100:140, 60:200]).any()
    found = of_load(sets, scene, apart)
    assert not np.isfinite(found.order[100:140, 60:200]).any()
    assert (found.reading.confidence[100:140, 60:200] == 0.0).all()
    right(found, sets, kept=0.8)


def test_a_residual_that_may_be_beyond_half_an_order_all_over_is_left_out_and_said():
    scene = small(a_scene(BEAM, pixel_mm=0.05), 2)
    residual = 0.5 * 7.0 / 6.0 + layer_residual(scene, 0.2, 20.0)  # 0.4 to 0.7 fringe, all one way
    sets = with_residual(scene, residual)
    found = unloaded(sets, scene)
    right = np.abs(found.field - np.conj(residual) * 6.0 / 7.0) < 0.1
    assert not (np.isfinite(found.field) & ~right).any()
    assert "may pass half an order" in " ".join(found.warnings)


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(4, 1))
def test_noise_of_ten_grey_levels_is_told(seed):
    rng = np.random.default_rng(seed)
    scene = disc(**{"camera.noise_grey": 10.0, "load.normal_n": rng.uniform(50.0, 450.0)})
    sets = with_residual(scene, disc_residual(scene, rng.uniform(0.1, 0.45)))
    found = of_load(sets, scene, unloaded(sets, scene))
    error = right(found, sets, rms=0.02)
    pull = error / found.reading.uncertainty[np.isfinite(found.order)]
    assert 0.8 < np.sqrt(np.mean(pull**2)) < 1.1


@pytest.mark.long
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.study) for n in range(1, 12))]
)
def test_random_residual_stresses_break_no_branch_and_turn_no_direction(seed):
    rng = np.random.default_rng(seed)
    values = {"camera.noise_grey": rng.uniform(1.0, 6.0)}
    if seed % 3 == 0:
        values["polariscope.plate_wavelength_nm"] = 560.0
    if seed % 2:
        scene = small(disc(**values, **{"load.normal_n": rng.uniform(40.0, 450.0)}), 2)
    else:
        bulk = {"load.bulk_mpa": rng.uniform(-8.0, 8.0)}
        scene = small(contact(rng.uniform(0.05, 0.4), **values, **bulk), 2)
    sets = with_residual(scene, waves_residual(scene, rng, rng.uniform(0.05, 0.42)))
    found = of_load(sets, scene, unloaded(sets, scene))
    # twice the noise of the bar, and pixels of twice the size about the loads
    right(found, sets, kept=0.85, rms=0.01)
    assert turn_of(found, sets).max() < 45.0


def test_the_least_order_is_the_order_below_a_half_and_its_mirror_above():
    order, theta = np.array([[0.0, 0.1, 0.49, 0.7, 1.2]]), 0.4
    delta, twice = 2.0 * np.pi * order, np.exp(2j * theta)
    found = least_field(StepTerms(np.ones((1, 5)), np.cos(delta), np.sin(delta) * twice, None))
    expected = np.array([[0.0, 0.1, 0.49, -0.3, 0.2]]) * twice
    np.testing.assert_allclose(found, expected, atol=1e-12)  # float64 through one arctangent


def airy_field(size):
    """(sigma_x - sigma_y) + 2i tau_xy of phi = exp(-x² - y²/2 + 0.3 xy), and a disc of it."""
    y, x = np.indices((size, size)) / (0.275 * size)
    x, y = x - 1.8, 1.8 - y
    bell = 8.0 * np.exp(-(x**2) - 0.5 * y**2 + 0.3 * x * y)
    slope_x, slope_y = -2.0 * x + 0.3 * y, -y + 0.3 * x
    stress_y = bell * (slope_x**2 - 2.0)
    stress_x = bell * (slope_y**2 - 1.0)
    shear = -bell * (slope_x * slope_y + 0.3)
    return stress_x - stress_y + 2j * shear, np.hypot(x, y) < 1.4


def test_equilibrium_alone_finds_the_whole_number_of_a_stress_that_is_not_compatible():
    """The stress of an Airy function that is not biharmonic."""
    field, inside = airy_field(400)
    field = 0.2 * field + 3.0
    twice = field / np.abs(field)
    still = np.full(inside.shape, 1e-4)
    turns = np.abs(field) - 2.0
    found = balance(turns, twice, inside, spread=still, compatible=False)
    # blocks of four pixels and Gaussians cut off at 3.5 widths: a hundredth
    assert found.whole == 2 and found.number == pytest.approx(2.0, abs=0.05)
    assert balance(turns, twice, inside, spread=still).whole != 2


def test_where_equilibrium_says_more_the_least_order_is_not_believed():
    """Orders of 0.3 to 1.2: over most of the disc the least that the light allows is below 0.4."""
    field, inside = airy_field(200)
    field = 0.05 * field + 0.75  # a uniform stress is in equilibrium too
    light = np.stack([step_light(field, four) for four in TEN])
    light += 0.005 * np.random.default_rng(0).standard_normal(light.shape)
    found = read_residual(light, chains_at(TEN), sigma=0.005, valid=inside)
    error = np.abs(found.field - field)[np.isfinite(found.field)]
    assert error.size > 0.9 * np.count_nonzero(inside)
    # 0.037 at the rim, by the widest window; it is 1 where the least order is taken
    assert error.max() < 0.1 and np.median(error) < 0.003
