"""Pixels of finite size: fringes averaged, never aliased, against integrals over the pixel."""

import numpy as np
import pytest

from isochrome.optics import make_chain, mean_order, pixel_visibility, polariscope_signal
from isochrome.reference import disc_centre_difference, disc_stress
from isochrome.scene import Polariscope
from pixel_means import gauss_mean

DARK = make_chain(Polariscope())
INNER = np.s_[1:-1, 1:-1]
"""Pixels with neighbours on all sides: at the borders slopes are one-sided, of first order."""


def supersampled(order_at, rows, cols, samples=16):
    """The mean of sin²(pi N) over each pixel, by samples² midpoints."""
    fine = (np.arange(samples) + 0.5) / samples - 0.5
    z = np.arange(rows)[:, None, None, None] + fine[None, None, :, None]
    x = np.arange(cols)[None, :, None, None] + fine[None, None, None, :]
    return (np.sin(np.pi * order_at(x, z)) ** 2).mean(axis=(2, 3))


def averaged(order):
    """The signal of pixels by their mean order and visibility."""
    return polariscope_signal(mean_order(order), DARK, visibility=pixel_visibility(order)[0])


@pytest.mark.parametrize("gradient", [(0.0, 0.3), (0.2, 0.0), (0.25, 0.33), (0.45, 0.1)])
def test_straight_fringes_lose_contrast_as_the_sinc_of_their_gradient(gradient):
    def order_at(x, z):
        return 3.0 + gradient[1] * x + gradient[0] * z

    rows, cols = np.indices((12, 13))
    order = order_at(cols, rows)
    visibility, too_fine = pixel_visibility(order)
    signal = polariscope_signal(order, DARK, visibility=visibility)
    # exact for straight fringes; the samples' own midpoint error is (pi g/16)²/6 of the contrast
    np.testing.assert_allclose(signal, supersampled(order_at, 12, 13), rtol=0, atol=1.5e-3)
    assert too_fine == 0.0


def test_fringes_finer_than_two_pixels_are_counted_not_aliased():
    _, cols = np.indices((20, 20))
    for gradient, share in ((0.4, 0.0), (0.6, 1.0)):
        visibility, too_fine = pixel_visibility(gradient * cols)
        assert too_fine == share
        assert (visibility >= 0).all() and (visibility <= 1).all()


@pytest.mark.parametrize("gradient", [1.2, 1.5, 1.9])
def test_fringes_finer_than_a_pixel_leave_grey_and_none_turned_round(gradient):
    """sinc(g) is negative between one and two fringes a pixel: dark where it is bright."""
    _, cols = np.indices((8, 9))
    order = gradient * cols
    visibility, _ = pixel_visibility(order)
    np.testing.assert_array_equal(visibility, 0.0)
    np.testing.assert_array_equal(polariscope_signal(order, DARK, visibility=visibility), 0.5)


def test_the_edge_of_the_specimen_is_no_fringe():
    """A step from N = 3 to nothing must neither grey the edge pixels nor count as too fine."""
    order = np.full((20, 20), 3.0)
    order[:, 12:] = np.nan
    order[7, 5] = np.nan
    visibility, too_fine = pixel_visibility(order)
    assert too_fine == 0.0
    np.testing.assert_array_equal(visibility[np.isfinite(order)], 1.0)


def test_beside_an_edge_the_gradient_is_one_sided():
    _, cols = np.indices((6, 30))
    order = 0.2 * cols.astype(float)
    whole, _ = pixel_visibility(order)
    cut = np.where(cols < 14, order, np.nan)
    part, _ = pixel_visibility(cut)
    # a straight line has one gradient from either side: rounding
    np.testing.assert_allclose(part[:, :14], whole[:, :14], rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", [(1, 9), (9, 1), (1, 1)])
def test_a_picture_one_pixel_thin_has_a_visibility(shape):
    visibility, _ = pixel_visibility(np.ones(shape))
    np.testing.assert_array_equal(visibility, np.ones(shape))


def disc_order(highest_at_centre):
    """Order of a disc of 20 mm as a function of place, from its closed form."""
    scale = highest_at_centre / disc_centre_difference(
        load_n=100.0, diameter_mm=20.0, thickness_mm=6.0
    )

    def order_at(x, z):
        field = disc_stress(x, z, load_n=100.0, diameter_mm=20.0, thickness_mm=6.0)
        return scale * np.hypot(field.sigma_x - field.sigma_z, 2 * field.tau_xz)

    return order_at


def quadrant(pixels):
    """Pixels of a quarter of a disc's middle 12 mm, and three beyond each axis: it is symmetric."""
    return (12.0 / pixels * (np.arange(pixels) + 0.5) - 6.0)[pixels // 2 - 3 :]


@pytest.mark.parametrize(
    ("centre", "pixels", "error", "at_borders"),
    # measured 2.8e-5, 1.0e-4, 2.7e-4 and 1.2e-3, by the visibility alone 2.3e-4, 3.7e-4, 5.7e-4
    # and 1.8e-3; bars a quarter above
    [
        (20.0, 400, 3.5e-5, 5.5e-4),
        (32.0, 400, 1.3e-4, 1.2e-3),
        (45.0, 400, 3.4e-4, 2.3e-3),
        (32.0, 200, 1.5e-3, 7e-3),
    ],
)
def test_a_discs_fine_fringes_are_those_of_the_pixels_areas(centre, pixels, error, at_borders):
    """Hard case: fringes of order 31 to 70, up to 0.2, 0.32, 0.45 and 0.64 fringes a pixel. Sampled
    in the pixels' middles they would be wrong by up to 0.03, 0.08, 0.15 and 0.27."""
    place = quadrant(pixels)
    order_at = disc_order(centre)
    order = order_at(place[None, :], place[:, None])
    assert order.max() > 1.5 * centre
    exact = gauss_mean(order_at, place, place, 12.0 / pixels)
    off = np.abs(averaged(order) - exact)
    assert off[INNER].max() < error and off.max() < at_borders
    assert np.abs(np.sin(np.pi * order) ** 2 - exact)[INNER].max() > 20 * error


def test_the_error_of_fine_fringes_falls_with_the_fourth_power_of_the_pixel():
    """What is left out beyond slope and bend is of fourth order in the pixel's size."""
    order_at, errors = disc_order(20.0), []
    for pixels in (100, 200, 400):
        place = quadrant(pixels)
        order = order_at(place[None, :], place[:, None])
        exact = gauss_mean(order_at, place, place, 12.0 / pixels)
        errors.append(np.abs(averaged(order) - exact)[INNER].max())
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    # measured 3.15 and 3.68; coarse pixels are not yet small beside the fringes
    assert rates[0] > 2.8 and rates[1] > 3.4


@pytest.mark.parametrize("stride", [1, 2, 5])
def test_the_mean_order_of_a_bowl_is_that_of_its_area(stride):
    """N = a x² + b z² + c x + d has the mean N + (a + b)/12 over a pixel, at every stride."""
    rows, cols = stride * np.indices((9, 11))
    order = 0.003 * cols**2 - 0.001 * rows**2 + 0.1 * cols + 1.0
    order[0, :4] = np.nan
    known = np.isfinite(order)
    found = mean_order(order, stride=stride)
    np.testing.assert_array_equal(np.isfinite(found), known)
    # beside an edge too, for the bend is the same everywhere
    np.testing.assert_allclose((found - order)[known], 0.002 / 12.0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("shape", [(1, 1), (2, 7), (7, 2)])
def test_a_picture_too_thin_for_a_bend_has_the_order_of_its_middles(shape):
    order = np.arange(float(np.prod(shape))).reshape(shape)
    np.testing.assert_allclose(mean_order(order), order, rtol=0, atol=1e-12)


def test_single_and_double_precision_agree_in_visibility_and_share():
    rows, cols = np.indices((150, 130))
    order = 0.0026 * ((cols - 40.0) ** 2 + (rows - 20.0) ** 2)
    double, share = pixel_visibility(order)
    single, single_share = pixel_visibility(order.astype(np.float32))
    assert single.dtype == np.float32
    # N of 60 in single precision is known to 4e-6, and so is its slope; dV/dg <= 1.4 pi
    np.testing.assert_allclose(single, double, rtol=0, atol=4e-5)
    assert 0.0 < share < 1.0 and single_share == pytest.approx(share, abs=1e-3)


def test_blocks_of_rows_leave_no_seams():
    """The same picture upside down and from another row on: other blocks, equal pixels."""
    rows, cols = np.indices((200, 40))
    order = 0.0009 * ((cols - 10.0) ** 2 + (rows - 77.0) ** 2)
    order[90:95, 5:9] = np.nan
    visibility, share = pixel_visibility(order)
    upturned, upturned_share = pixel_visibility(order[::-1].copy())
    known = np.isfinite(order)
    np.testing.assert_allclose(upturned[::-1][known], visibility[known], rtol=0, atol=1e-14)
    assert upturned_share == share
    shifted, _ = pixel_visibility(order[13:].copy())
    np.testing.assert_allclose(
        shifted[1:][known[14:]], visibility[14:][known[14:]], rtol=0, atol=1e-14
    )
