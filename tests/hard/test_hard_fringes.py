"""Hard cases of the picture: fringes of order 50, contacts below a pixel, spikes at the surface."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from hard.hard_cases import HALF_WIDTH, PEAK, RADIUS, contact_scene, worn, write_profile
from isochrome.errors import PhysicsError
from isochrome.reference import (
    hertz_half_width,
    hertz_largest_difference,
    hertz_peak_pressure,
    hertz_stress,
)
from isochrome.simulation import simulate

# load and thickness together, so that the pressure is the paper's and only the order grows
THICK = 65.0
HERTZ = hertz_largest_difference(half_width_mm=HALF_WIDTH, peak_pressure_mpa=PEAK)


def camera(pixel, cols, rows, rest=""):
    return (
        f"[camera]\nwidth_px = {cols}\nheight_px = {rows}\npixel_mm = {pixel}\nbit_depth = 8\n"
        f"{rest}\n[polariscope]\nwavelength_nm = 587.0\n"
    )


def thick(pixel, cols, rows):
    return contact_scene(camera(pixel, cols, rows), load=11.0 * THICK, thickness=THICK)


def hertz_order(pixels, half_width, peak, scale):
    stress = hertz_stress(
        pixels.x_mm[None, :], pixels.z_mm[:, None], half_width_mm=half_width, peak_pressure_mpa=peak
    )
    return scale * np.hypot(stress.sigma_x - stress.sigma_z, 2.0 * stress.tau_xz)


@pytest.mark.long
def test_order_fifty_is_right_in_every_pixel_and_counted_in_the_frame():
    """Goes wrong: single precision, or fringes finer than the grid of the tractions."""
    out = simulate(thick(0.001, 901, 501))
    # 0.60057 p0 d/f, 0.786 a deep; half a pixel off the top of it changes nothing to 1e-5
    scale = THICK / 14.6
    assert out.history["n_max"][0] == pytest.approx(scale * HERTZ.difference_mpa, rel=2e-5)
    assert scale * HERTZ.difference_mpa > 50.0
    assert out.history["n_max_z_mm"][0] == pytest.approx(HERTZ.depth_mm, abs=0.003)
    exact = hertz_order(out.pixels, HALF_WIDTH, PEAK, scale)
    error = np.abs(out.orders[0] - exact)
    # half a pixel from the contact's edge the pressure's root is cut at a node: its own size there
    # is (h/a)^0.5 = 0.05 of p0, and a fifth of that the bar; 20 nodes below, 0.01 fringe, which no
    # frame of 8 bits shows
    assert error.max() < 0.2 * 0.05 * scale * PEAK and error[20:].max() < 0.01
    # the frame: the light that the closed form sends through each pixel, by 9 x 9 points of it,
    # along the axis, where the first fringes are 2.2 pixels wide and the order turns at 50.2
    points = (np.arange(9) - 4) / 9.0 * 0.001
    middle = slice(440, 461)
    strip = replace(out.pixels, cols=21, left_mm=out.pixels.left_mm + 440 * 0.001)
    light = np.zeros((501, 21))
    for dx, dz in itertools.product(points, points):
        moved = replace(strip, left_mm=strip.left_mm + dx, top_mm=dz)
        light += np.sin(np.pi * hertz_order(moved, HALF_WIDTH, PEAK, scale)) ** 2 * 255.0 / 81.0
    # half a level of rounding, and a half for a gradient that changes within a pixel
    assert np.abs(out.frames[0, 20:, middle] - light[20:]).max() < 1.0
    # and the dark fringes on the way down, counted as a user would
    top, column = int(np.argmax(exact[:, 450])), out.frames[0, :, 450].astype(int)
    dark = np.flatnonzero((column[1:] >= 60) & (column[:-1] < 60))
    assert np.count_nonzero(dark > top) == int(exact[top, 450]) - int(exact[-1, 450])


@pytest.mark.parametrize("pixel", [0.003, 0.006, 0.05, 0.3])
def test_order_fifty_on_pixels_too_coarse_for_it_is_refused_not_aliased(pixel):
    """Goes wrong: sin² of order 50 sampled every few orders looks like a fine picture of few."""
    scene = thick(pixel, max(8, round(0.9 / pixel)), max(6, round(0.5 / pixel)))
    with pytest.raises(PhysicsError, match=r"fringes finer than two pixels .* smaller pixels"):
        simulate(scene)


@pytest.mark.study
def test_millionth_of_the_load_is_a_point_force_to_the_camera():
    """Goes wrong: a contact of 0.7 um under pixels of 6 um fills the memory, or is lost."""
    pixel = 0.00607
    out = simulate(contact_scene(camera(pixel, 33, 17), load=44e-6))
    a = hertz_half_width(11e-6, RADIUS, 2473.1908)
    peak = hertz_peak_pressure(11e-6, RADIUS, 2473.1908)
    exact = hertz_order(out.pixels, a, peak, 4.0 / 14.6)
    # (h/a)^1.5 of the pressure and 5e-7 of the largest traction, which is 8 times the field's most
    np.testing.assert_allclose(out.orders[0], exact, rtol=0, atol=1e-5 * exact.max())
    # and a force at a point, N = 2 P' d cos/(pi r f), up to (a/r)²
    r = np.hypot(out.pixels.x_mm[None, :], out.pixels.z_mm[:, None])
    flamant = 2 * 11e-6 / np.pi * out.pixels.z_mm[:, None] / r**2 * 4.0 / 14.6
    assert np.abs(out.orders[0] / flamant - 1.0).max() < 2.0 * (a / r.min()) ** 2


def test_contact_wider_than_the_picture_is_refused():
    """Goes wrong: nearly conforming, the picture shows a stretch of even pressure and no edge."""
    scene = contact_scene(camera(0.02, 200, 100), indenter="radius_mm = 1e4")
    with pytest.raises(PhysicsError, match=r"wider than the picture .* widen the camera"):
        simulate(scene)


@pytest.mark.long
def test_ledge_and_worn_corners_leave_no_hole_in_the_picture(tmp_path):
    """Goes wrong: a jump of traction is a logarithm of stress at the surface: inf, NaN, black."""
    line = write_profile(tmp_path, [-2.0, 0.05, 0.05 + 1e-9, 2.0], [0.0, 0.0, 2e-4, 2e-4])
    view = camera(0.01, 160, 80)
    ledge = contact_scene(view, indenter=f"radius_mm = {RADIUS}\n{line}", folder=tmp_path)
    flat = contact_scene(
        view + worn([0.0, 233.0], spacing=0.005), indenter='shape = "flat"\nhalf_width_mm = 0.5'
    )
    for scene in (ledge, flat):
        out = simulate(scene)
        assert np.isfinite(out.orders).all() and out.frames.any()
        # N <= (d/f) times the largest stress difference, itself below 2 p_max but for corners
        assert out.orders.max() < 4.0 / 14.6 * 2.0 * max(out.history["p_max_mpa"])
