"""Pulls of calibrations, of specimens by the textbook: nothing of the package is in the frames."""

import math

import numpy as np
import pytest
from scipy.special import chdtri

from isochrome.calibration import Beam, Disc

from .conftest import bending_from_images, disc_from_images

F_SIGMA, THICKNESS = 11.3, 5.0
HEIGHT, INNER, OUTER, PIXEL = 18.0, 36.0, 96.0, 0.34
DIAMETER = 36.0
BEAM = Beam(height_mm=HEIGHT, inner_span_mm=INNER, outer_span_mm=OUTER)


def camera(order, inside, rng, noise):
    """Grey levels of an order in the dark field: uneven light, a background, noise, rounding."""
    y, x = (np.linspace(-1.0, 1.0, n) for n in order.shape)
    light = 190.0 * (1.0 - 0.15 * (x[None, :] - 0.2) ** 2 - 0.2 * y[:, None] ** 2)
    clean = 14.0 + np.where(inside, light * np.sin(np.pi * order) ** 2, 0.0)
    return np.clip(np.rint(clean + rng.normal(0.0, noise, order.shape)), 0, 255).astype(np.uint8)


def bent(load_n, rng, *, tilt_deg, noise):
    """A beam between its inner rollers: M = P (Lo - Li)/4, sigma = M y/I, N = sigma d/f."""
    y, x = PIXEL * (np.mgrid[:68, :84].astype(float) - np.array([33.1, 41.5])[:, None, None])
    away = y * math.cos(math.radians(tilt_deg)) + x * math.sin(math.radians(tilt_deg))
    moment = load_n * (OUTER - INNER) / 4.0
    inertia = THICKNESS * HEIGHT**3 / 12.0
    order = moment * away / inertia * THICKNESS / F_SIGMA
    return camera(order, np.abs(away) < 0.5 * HEIGHT, rng, noise)


def pressed(load_n, rng, *, angle_deg, noise, radius_px=60.0, size=140):
    """A disc between two point forces, each sigma_r = -2 P cos(t)/(pi d r), and an even tension,
    which makes no difference: Timoshenko & Goodier (1970), Theory of Elasticity, art. 41."""
    row, col = np.mgrid[:size, :size] - np.array([size / 2 + 1.3, size / 2 - 2.2])[:, None, None]
    scale = 0.5 * DIAMETER / radius_px
    place = scale * (col + 1j * row)
    axis = np.exp(1j * (0.5 * np.pi - math.radians(angle_deg)))  # from the columns' direction
    difference = np.zeros(place.shape, complex)
    for end in (axis, -axis):
        away = place - 0.5 * DIAMETER * end
        along = (away * np.conj(-end)).real  # r cos t, from the force inwards
        r2 = np.maximum(np.abs(away) ** 2, 1e-9)
        radial = -2.0 * load_n * along / (np.pi * THICKNESS * r2)
        difference += radial * away**2 / r2
    inside = np.abs(place) < 0.5 * DIAMETER
    return camera(np.abs(difference) * THICKNESS / F_SIGMA, inside, rng, noise)


def beam_pulls(seed):
    """(found - true)/u of a beam's fringe value, of its order at zero load and of each order."""
    rng = np.random.default_rng([14, seed])
    loads = np.sort(rng.uniform(60.0, 200.0, rng.integers(2, 4)))
    loads[-1] = max(loads[-1], loads[0] + 60.0)
    setup = {"tilt_deg": rng.uniform(-3.0, 3.0), "noise": rng.uniform(1.5, 5.0)}
    found = bending_from_images([bent(p, rng, **setup) for p in loads], loads, BEAM, PIXEL)
    # N at y = h/2 is 6 M/(h^2 f)
    orders = 1.5 * loads * (OUTER - INNER) / (HEIGHT**2 * F_SIGMA)
    return [
        (found.fringe_value_n_per_mm - F_SIGMA) / found.standard_uncertainty,
        found.order_at_zero_load / found.order_at_zero_load_uncertainty,
        *(
            (i.order - n) / i.standard_uncertainty
            for i, n in zip(found.images, orders, strict=True)
        ),
    ]


def disc_pulls(seed):
    """The same of a disc, whose order at the centre is 8 P/(pi D f)."""
    rng = np.random.default_rng([15, seed])
    centres = np.sort(rng.uniform(1.2, 5.0, 2))
    loads = centres * np.pi * DIAMETER * F_SIGMA / 8.0
    setup = {"angle_deg": rng.uniform(-4.0, 4.0), "noise": rng.uniform(1.5, 5.0)}
    images = [pressed(p, rng, **setup) for p in loads]
    found = disc_from_images(images, loads, Disc(diameter_mm=DIAMETER))
    pulls = [(found.fringe_value_n_per_mm - F_SIGMA) / found.standard_uncertainty]
    return pulls + [
        (i.order - n) / i.standard_uncertainty for i, n in zip(found.images, centres, strict=True)
    ]


def assert_normal(pulls):
    """Their squares' sum lies between chi-square's 0.1 and 99.9 % points, as with any seeds."""
    total = float(np.sum(np.square(pulls)))
    low, high = chdtri(len(pulls), [0.999, 0.001])
    assert low < total < high, f"root mean square {math.sqrt(total / len(pulls)):.2f}"


@pytest.mark.long
def test_a_few_beams_are_off_by_what_they_say():
    """Orders are at h/2, so that a wrong lever, edge or unit is off by hundreds."""
    pulls = [beam_pulls(seed) for seed in range(4)]
    assert_normal([p[0] for p in pulls])
    assert_normal([order for p in pulls for order in p[2:]])


@pytest.mark.study
@pytest.mark.long
def test_beams_are_off_by_what_they_say():
    pulls = [beam_pulls(seed) for seed in range(36)]
    assert_normal([p[0] for p in pulls])
    assert_normal([p[1] for p in pulls])
    # orders of one set share its light, so that fewer are free: one a set is taken
    assert_normal([p[2] for p in pulls])
    assert_normal([p[-1] for p in pulls])


@pytest.mark.study
@pytest.mark.long
def test_discs_are_off_by_what_they_say():
    """Of two loads: the fringe value, and the order of each image, fitted by itself."""
    pulls = [disc_pulls(seed) for seed in range(9)]
    assert_normal([p[0] for p in pulls])
    assert_normal([order for p in pulls for order in p[1:]])
