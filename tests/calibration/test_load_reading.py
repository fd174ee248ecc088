"""Loads read against known ones, in discs that hold stress, by a renderer that is not ours."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.outside_camera import NONE
from benchmarks.outside_specimens import Bench, disc_images
from isochrome.calibration import LoadReading, lay_series, read_load
from isochrome.errors import PhysicsError

from .conftest import as_shots

RISE = 4e-3
"""Fringes at the centre for each N."""

LOADS = np.array([520.0, 660.0, 800.0, 920.0, 1050.0, 1150.0, 1220.0])
BENCH = Bench(shape=(130, 140), size_px=100.0, defects=replace(NONE, noise=1.0))


def held_stress(rng, size=None):
    """A smooth random tensor, of .1 to .7 fringe (rms) where the disc is read."""
    degree = int(rng.integers(1, 4))
    powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    members = rng.normal(size=len(powers)) + 1j * rng.normal(size=len(powers))
    z, x = np.mgrid[-0.8:0.8:40j, -0.8:0.8:40j]
    inside = np.hypot(x, z) < 0.8

    def bare(x, z):
        return sum(c * x**i * z**j for c, (i, j) in zip(members, powers, strict=True))

    size = rng.uniform(0.1, 0.7) if size is None else size
    scale = size / np.sqrt(np.mean(np.abs(bare(x, z)[inside]) ** 2))
    return lambda x, z: scale * bare(x, z)


def read(images, stated, number) -> LoadReading:
    shots = as_shots([np.asarray(image, dtype=float) for image in images], stated)
    return read_load(lay_series(shots, range(len(shots))), shots[number], number)


def captured(seed, true=LOADS, **bench):
    own = replace(BENCH, **bench)
    return disc_images(RISE * np.asarray(true), own, seed)


@pytest.fixture(scope="module")
def images():
    return captured(4, zero_order=0.2)


@pytest.fixture(scope="module")
def inside(images):
    """One load's reading by the others as they are."""
    return read(images, LOADS, 3)


@pytest.mark.long
def test_a_load_between_others_in_a_disc_that_holds_stress_along_them(inside):
    """Along the loads' own directions the pixels' waves are exact: what is left is the noise."""
    assert abs(inside.load_n / LOADS[3] - 1.0) < 4e-3
    assert abs(inside.load_n - LOADS[3]) < 3.0 * inside.standard_uncertainty
    assert inside.explained > 0.95 and inside.beyond == 0.0


@pytest.mark.long
def test_its_own_stated_load_does_not_matter(images, inside):
    wrong = LOADS.copy()
    wrong[3] = 300.0
    again = read(images, wrong, 3)
    assert inside.load_n == again.load_n
    assert inside.standard_uncertainty == again.standard_uncertainty


@pytest.mark.long
def test_a_load_beyond_the_known_ones_says_how_far_and_knows_less(images, inside):
    outside = read(images, LOADS, 0)
    assert outside.beyond == pytest.approx(0.25, abs=0.02)  # 140 N below 560 N
    assert outside.standard_uncertainty > inside.standard_uncertainty


@pytest.mark.long
def test_loads_that_do_not_agree_among_themselves_widen_it(images, inside):
    """Loads off by 3 %: the truth is the light's, and stays within what is stated."""
    rng = np.random.default_rng(4)
    stated = LOADS * (1.0 + 0.03 * rng.normal(size=len(LOADS)))
    found = read(images, stated, 3)
    assert found.standard_uncertainty > 3.0 * inside.standard_uncertainty
    assert abs(found.load_n - LOADS[3]) < 3.0 * found.standard_uncertainty


def test_four_other_loads_are_too_few():
    with pytest.raises(PhysicsError, match=r"4 other loads are known, and 5 at least"):
        read(captured(5, LOADS[:5]), LOADS[:5], 2)


@pytest.mark.long
def test_a_disc_that_lies_otherwise_is_refused():
    """Turned between the plates by a third of a right angle, it holds its stress elsewhere."""
    rng = np.random.default_rng(6)
    stress = held_stress(rng, 0.7)
    images = captured(6, residual=stress)
    turn = np.exp(0.5j)

    def turned(x, z):
        place = (x + 1j * z) * turn
        return stress(place.real, place.imag) * turn**2

    images[3] = captured(6, residual=turned)[3]
    with pytest.raises(PhysicsError, match="do not tell its load"):
        read(images, LOADS, 3)


def pulls(seeds, **bench):
    """What is read of random discs under loads that a cell tells to .1 to 1 %, over its ±."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng([7, seed])
        true = LOADS * (1.0 + rng.uniform(1e-3, 0.01) * rng.normal(size=len(LOADS)))
        images = captured(
            seed, true, residual=held_stress(rng), angle_deg=rng.uniform(-3.0, 3.0),
            down_px=rng.uniform(-5.0, 5.0),
            defects=replace(NONE, noise=1.0, blur_px=rng.uniform(0.0, 1.0)), **bench,
        )  # fmt: skip
        number = int(rng.integers(len(LOADS)))
        got = read(images, LOADS, number)
        found.append((got.load_n - true[number]) / got.standard_uncertainty)
    return np.array(found)


@pytest.mark.study
def test_coverage_of_twenty_discs():
    """Too wide rather than too narrow: scatter may be the cell's or the orders', nobody can say."""
    found = pulls(range(20), shape=(260, 280), size_px=200.0)
    assert np.sqrt(np.mean(found**2)) < 1.2
    assert np.mean(np.abs(found) < 2.0) >= 0.9
