"""What a disc's calibration is made of, each by itself: starts, rivals, rise, spread."""

import numpy as np
import pytest

from isochrome.calibration import Circle, Disc, ImageFit
from isochrome.calibration.disc import disc_field
from isochrome.calibration.disc.api import fit_disc, of_whole_orders
from isochrome.calibration.disc.disc_field import (
    ORDERS,
    THIN,
    Overlay,
    Rise,
    Scan,
    choose_centre_orders,
    fit_rise,
    overlay,
)
from isochrome.errors import PhysicsError

from .conftest import DIAMETER, as_shots, disc_from_images, disc_load
from .conftest import TINY_DISC as SMALL

CIRCLE = Circle(51.0, 53.0, 42.0, 0.0)
ANGLE = np.radians(2.0)


def placed(orders):
    """The true unknowns of discs of these centre orders, (n, 5)."""
    return np.array([[n, CIRCLE.row, CIRCLE.col, CIRCLE.radius, ANGLE] for n in orders])


def test_two_centre_orders_that_explain_an_image_alike_are_refused(disc_frame):
    """Half the exposure at 2.4 and half at 3.0: with the rival under light of degree two and the
    best under four, 2.4 would be found, with no word of 3.0."""
    rng = np.random.default_rng(0)
    twice = 0.5 * sum(disc_frame(n, rng, **SMALL).astype(float) for n in (2.4, 3.0))
    (shot,) = as_shots([np.rint(twice)], [disc_load(2.4)])
    with pytest.raises(PhysicsError, match=r"two centre orders near .* explain it equally well"):
        fit_disc(shot, placed((2.4, 3.0, 2.5, 2.9)))


@pytest.mark.long
def test_too_small_a_noise_makes_the_orders_no_surer(disc_frame):
    """The fit's misfit counts: with a third of the noise chi is 3, and what is stated the same."""
    rng = np.random.default_rng(0)
    images, loads = [disc_frame(n, rng, **SMALL) for n in (2.0, 3.0)], disc_load(np.array([2, 3]))
    spreads = []
    for sigma in (3.0, 1.0):
        found = disc_from_images(images, loads, Disc(diameter_mm=DIAMETER), sigma=sigma)
        spreads.append([image.standard_uncertainty for image in found.images])
        orders = np.array([image.order for image in found.images])
        assert np.all(np.abs(orders - [2.0, 3.0]) < 4 * np.array(spreads[-1]))
    # what else may be there is weighed by the noise, and is a part of what is stated
    np.testing.assert_allclose(spreads[1], spreads[0], rtol=0.2)


def scan_of(*dips):
    """A scan whose misfit dips at some orders to some chi."""
    chi = np.full(ORDERS.size, 10.0)
    for order, depth in dips:
        chi = np.minimum(chi, depth + 20.0 * np.abs(ORDERS - order))
    return Scan(CIRCLE, np.zeros((1, 4)), chi[None, :], 10.0)


def test_starts_follow_the_line_that_suits_all_loads():
    """Each scan alone is best elsewhere, on lines that leave 14 fringes at no load."""
    scans = [scan_of((1.0, 1.0), (2.02, 1.1)), scan_of((2.5, 1.1), (4.96, 1.0))]
    found = choose_centre_orders(scans, [200.0, 250.0])
    assert found == pytest.approx((2.02, 2.5), abs=1e-6)


@pytest.mark.long
def test_a_tone_curve_is_not_taken_for_residual_stress(disc_frame):
    rng = np.random.default_rng(0)
    centres = (1.8, 2.6, 3.4)
    images = [disc_frame(n, rng, gamma=1.3, **SMALL) for n in centres]
    found = disc_from_images(images, disc_load(np.array(centres)), Disc(diameter_mm=DIAMETER))
    assert found.residual is None
    assert [cause["key"] for cause in found.causes] == ["frames.gamma"]


@pytest.mark.parametrize(
    ("explained", "runner_up", "clear"),
    [(0.9, 0.5, True), (0.9, 0.8, False), (0.45, 0.1, False)],
    ids=["clear", "another is as good", "most is left"],
)
def test_a_rise_is_clear_where_no_other_explains_as_much(explained, runner_up, clear):
    assert Rise(0.01, 0.0, explained, runner_up, 0.02).clear is clear


def test_a_slopes_share_is_what_its_waves_explain_and_these_are_of_least_squares():
    rng, unit, loads = np.random.default_rng(1), np.linspace(-0.8, 0.8, 30), 60.0 * np.arange(1, 7)
    images, slopes = Overlay(rng.random((6, 30, 30)), unit, loads), np.arange(0.4, 16.0, 0.04) / 360
    shares, used = disc_field._shares(images, 0.02, slopes), images.used[:, ::THIN]
    data, field = images.stack[:, :, ::THIN][:, used], images.field(0.02)[:, ::THIN][used]
    for k in (0, 200, 389):
        left, wave = disc_field.pixel_waves(data, slopes[k] * loads, field)
        assert shares[k] == pytest.approx(1.0 - np.sum(left**2) / (6 * data.var(axis=0).sum()))
    phase, i = 2.0 * np.pi * slopes[k] * loads * field.max(), field.argmax()
    columns = np.stack([np.ones(6), np.cos(phase), np.sin(phase)], axis=1)
    assert [wave[i].real, wave[i].imag] == pytest.approx(
        np.linalg.lstsq(columns, data[:, i])[0][1:]
    )


def test_orders_from_the_rise_are_off_by_what_they_say(disc_frame):
    """Noise and misfit go together over four pixels: the pulls' root mean square of twelve such
    discs is 1.03; by single pixels it would be 4."""
    centres = np.array((1.5, 2.1, 2.8, 3.3, 4.1, 4.6))
    pulls = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        p, s = rng.uniform(0.0, 2.0 * np.pi, 3), rng.uniform(1.0, 3.0, 2)

        def residual(x, z, p=p, s=s):
            return 0.8 * np.cos(s[0] * x + p[0]) * np.cos(s[1] * z + p[1]) + 0.5 * x * np.cos(p[2])

        images = [disc_frame(n, rng, residual=residual, **SMALL) for n in centres]
        shots, circles = as_shots(images, disc_load(centres)), [CIRCLE] * 6
        rise = Rise(1.0 / disc_load(1.0), ANGLE, 0.9, 0.1, 0.5)
        found = fit_rise(shots, circles, overlay(shots, circles), rise, DIAMETER)
        rises = np.array([i.order for i in found[1:]]) - found[0].order
        spread = np.array([i.standard_uncertainty for i in found[1:]])
        pulls.append((rises - (centres[1:] - centres[0])) / spread)
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 2.0


@pytest.mark.parametrize(("at_zero", "bar"), [(0.0, 0.07), (0.5, 0.8), (-0.5, 0.8), (0.2, 0.2)])
def test_orders_known_up_to_a_whole_one_say_so(at_zero, bar):
    """At half an order the other is as likely: a chance of a half that all are one lower or higher.
    An even residual of .2 along the loads and .2 along the axes is .28 at the centre."""
    loads = np.array((100.0, 250.0, 400.0))
    images = [
        ImageFit(file="", load_n=p, order=0.01 * p + at_zero, standard_uncertainty=0.02, chi=1.0)
        for p in loads
    ]
    found, covariance = of_whole_orders(images)
    others = np.array((-2.0, -1.0, 1.0, 2.0))
    odds = np.exp((at_zero**2 - (at_zero + others) ** 2) / (2 * 2 * 0.2**2))
    shared = odds @ others**2 / (1.0 + odds.sum())
    np.testing.assert_allclose(covariance, shared + 0.02**2 * np.eye(3), rtol=1e-3)
    assert np.sqrt(shared) < bar
    assert [i.order for i in found] == [i.order for i in images]
    assert found[0].standard_uncertainty == pytest.approx(np.hypot(0.02, np.sqrt(shared)))
