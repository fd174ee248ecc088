"""A camera that is not square: where its pixels look, and the field that they see there."""

from dataclasses import replace

import numpy as np
import pytest

from isochrome.benchmarks import load_benchmarks
from isochrome.stress import (
    Lens,
    PixelGrid,
    make_field_grid,
    pixel_grid,
    seen_by,
    seen_nearly,
    stress_components,
    stress_difference,
)

OUTSIDE = load_benchmarks("outside_camera")
Defects, seen_places = OUTSIDE.Defects, OUTSIDE.seen_places

PLAIN = PixelGrid(60, 80, -0.8, 0.1, 0.02)
LENS = Lens(right_mm=0.8, down_mm=0.6, half_width_mm=0.8, half_height_mm=0.6)
BENT = {"roll_deg": 2.0, "distortion": -0.02, "keystone_x": 0.02, "keystone_z": -0.01}


def test_a_lens_that_does_nothing_looks_where_the_pixels_are():
    x, z = replace(PLAIN, lens=LENS).places
    np.testing.assert_allclose(x, np.broadcast_to(PLAIN.x_mm[None, :], x.shape), atol=1e-15)
    np.testing.assert_allclose(z, np.broadcast_to(PLAIN.z_mm[:, None], z.shape), atol=1e-15)


@pytest.mark.parametrize("keys", [*([key] for key in BENT), list(BENT)])
def test_what_a_pixel_looks_at_is_seen_there(keys):
    """By the way from the specimen to the picture, which another program goes."""
    bent = {key: BENT[key] for key in keys}
    x, z = replace(PLAIN, lens=replace(LENS, **bent)).places
    middle = PLAIN.left_mm + 0.8, PLAIN.top_mm + 0.6
    u, v = seen_places(x - middle[0], z - middle[1], (0.8, 0.6), Defects(**bent))
    # Newton's steps end at rounding
    np.testing.assert_allclose(u + middle[0], np.broadcast_to(PLAIN.x_mm, u.shape), atol=1e-13)
    np.testing.assert_allclose(
        v + middle[1], np.broadcast_to(PLAIN.z_mm[:, None], v.shape), atol=1e-13
    )


def test_strided_pixels_look_where_the_same_pixels_of_the_whole_look():
    whole = replace(PLAIN, lens=replace(LENS, **BENT))
    for all_, few in zip(whole.places, whole.every(3).places, strict=True):
        np.testing.assert_allclose(few, all_[::3, ::3], atol=1e-14)


def test_a_grid_around_holds_all_places_and_stays_for_a_small_change():
    grids = [replace(PLAIN, lens=replace(LENS, roll_deg=angle)).around() for angle in (0.50, 0.501)]
    assert grids[0] == grids[1]
    x, z = replace(PLAIN, lens=replace(LENS, roll_deg=0.5)).places
    grid = grids[0]
    assert grid.x_mm[0] < x.min() and grid.x_mm[-1] > x.max()
    assert grid.z_mm[0] < z.min() and grid.z_mm[-1] > z.max()
    # rows half a pixel below the surface, which the continuation above it relies on
    np.testing.assert_allclose((grid.z_mm / grid.pixel_mm) % 1.0, 0.5, atol=1e-9)


def seen_error(pixel_mm, depth_mm):
    """Largest error of a seen field from a depth on, over the largest pressure."""
    spacing, half = pixel_mm / 2, 0.4
    nodes = 2 * round(1.0 / spacing) + 1
    places = spacing * (np.arange(nodes) - nodes // 2)
    pressure = np.where(abs(places) < half, np.cos(0.5 * np.pi * places / half) ** 2, 0.0)
    rows = round(1.2 / pixel_mm)
    pixels = PixelGrid(rows, round(1.6 / pixel_mm), -0.8, -0.1, pixel_mm, replace(LENS, **BENT))
    plain = pixels.around()
    grid = make_field_grid(
        plain, left_mm=places[0], spacing_mm=spacing, nodes=nodes, dtype=np.complex128
    )
    seen = seen_by(stress_difference(grid, pressure), plain, pixels.places)
    x, z = pixels.places
    deep = np.flatnonzero(z > depth_mm)[::7]
    truth = stress_components(
        x.flat[deep], z.flat[deep], places, pressure, np.zeros(nodes)
    ).difference
    assert (seen[z < 0.0] == 0.0).all() and deep.size > 200
    return np.abs(seen.flat[deep] - truth).max()


def test_a_field_seen_through_a_lens_is_that_of_the_places():
    """By the direct sum there; cubic splines err by the fourth power of the pixel."""
    coarse, fine = seen_error(0.02, 0.1), seen_error(0.01, 0.1)
    assert coarse < 5e-5
    assert coarse / fine > 2.0**3.5


def test_two_pixels_below_the_surface_the_continuation_above_it_is_not_felt():
    assert seen_error(0.01, 0.02) < 4e-4


@pytest.mark.parametrize("top_mm", [-4.0, 3.0])
def test_a_picture_that_the_surface_does_not_cross_is_seen_as_a_whole(top_mm):
    """All above the surface, where nothing is, or all below: nothing is continued there."""
    pixels = PixelGrid(30, 40, -0.4, top_mm, 0.02, replace(LENS, roll_deg=1.0))
    grid = pixels.around()
    slope = np.broadcast_to(grid.z_mm[:, None], (grid.rows, grid.cols))
    z = pixels.places[1]
    # a cubic spline follows a straight line, but for its ends: .268 of a step a row, from four on
    np.testing.assert_allclose(
        seen_by(slope, grid, pixels.places),
        np.where(z >= 0.0, z, 0.0),
        rtol=0,
        atol=0.268**4 * 0.02,
    )


def test_a_small_change_is_seen_by_straight_lines_to_a_32nd_of_a_pixel():
    pixels = replace(PLAIN, left_mm=-0.8, top_mm=-0.1, lens=replace(LENS, **BENT))
    grid = pixels.around()
    plane = grid.x_mm[None, :] + 2j * grid.z_mm[:, None]
    seen, (x, z) = seen_nearly(plane, grid, pixels.places), pixels.places
    below = z >= 0.0
    error = np.abs(seen - (x + 2j * z))[below]
    # half of a 32nd along x, and twice that along z
    assert seen.dtype == np.complex64 and (seen[~below] == 0.0).all() and (~below).any()
    assert error.max() < 1.05 * np.hypot(1.0, 2.0) * grid.pixel_mm / 64.0


def test_a_picture_that_is_too_wide_for_straight_lines_is_seen_by_splines():
    lens = Lens(right_mm=330.0, down_mm=0.05, half_width_mm=330.0, half_height_mm=0.05)
    pixels = PixelGrid(5, 33_000, -330.0, 0.1, 0.02, replace(lens, distortion=1e-6))
    grid = pixels.around()
    wavy = np.cos(20.0 * (grid.x_mm[None, :] + grid.z_mm[:, None])).astype(np.float32)
    np.testing.assert_array_equal(
        seen_nearly(wavy, grid, pixels.places), seen_by(wavy, grid, pixels.places), strict=True
    )


def test_a_picture_without_a_lens_is_made_on_its_own_grid():
    from isochrome.scene import load_scene

    scene = load_scene("line-contact-wear")
    assert pixel_grid(scene).lens is None
    assert pixel_grid(scene.with_values({"camera.roll_deg": 0.1})).lens is not None
