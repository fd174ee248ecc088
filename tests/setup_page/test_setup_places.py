"""Points of the picture and values of the scene: held to the lens's own rendering and by hand."""

import math

import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.scene import parse_scene
from isochrome.setup_page import pixel_scale, placed_at, seen_at, surface_roll
from isochrome.stress import pixel_grid


def pixels_of(**camera):
    lines = {"width_px": 659, "height_px": 494, "pixel_mm": 0.00607, "left_mm": -1.9,
             "top_mm": -0.05} | camera  # fmt: skip
    text = "[specimen]\nthickness_mm = 4.0\n[camera]\n"
    return pixel_grid(parse_scene(text + "".join(f"{k} = {v!r}\n" for k, v in lines.items())))


BENT = {"roll_deg": 3.0, "distortion": -0.004, "keystone_x": 0.003, "keystone_z": -0.002}


def test_a_pixels_place_is_the_renderers():
    for camera in ({}, BENT):
        pixels = pixels_of(**camera)
        x, z = (np.broadcast_to(v, (494, 659)) for v in pixels.places)
        for row, col in ((0, 0), (493, 658), (100, 300)):
            wanted = pytest.approx((x[row, col], z[row, col]), abs=1e-9)
            assert pixels.place(row, col) == wanted


@pytest.mark.parametrize("camera", [{}, BENT])
def test_there_and_back(camera):
    pixels = pixels_of(**camera)
    x, z = pixels.place(123.4, 456.7)
    assert seen_at(pixels, x, z) == pytest.approx((123.4, 456.7), abs=1e-6)  # px
    left, top = placed_at(pixels, (20.0, 300.0))
    placed = pixels_of(**camera | {"left_mm": left, "top_mm": top})
    assert placed.place(20.0, 300.0) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_contact_between_two_pixels_and_a_scale_by_hand():
    left, top = placed_at(pixels_of(), (9.5, 299.5))  # the edge after 10 rows and 300 columns
    assert (left, top) == pytest.approx((-300 * 0.00607, -10 * 0.00607), abs=1e-12)
    assert pixel_scale((0.0, 0.0), (30.0, 40.0), 2.5) == 0.05


@pytest.mark.parametrize("roll", [-4.0, 0.0, 2.5])
def test_the_roll_of_a_surface_that_the_camera_sees_turned(roll):
    """The pixels that look at the surface of a rolled camera give its roll again."""
    pixels = pixels_of(roll_deg=roll)
    ends = [seen_at(pixels, x, 0.0) for x in (-1.0, 1.2)]
    assert surface_roll(*ends) == pytest.approx(roll, abs=1e-9)
    assert surface_roll(*reversed(ends)) == pytest.approx(roll, abs=1e-9)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: pixel_scale((1.0, 1.0), (1.0, 2.5), 1.0), "1.5 px apart, and 2 px"),
        (lambda: pixel_scale((1.0, 1.0), (1.0, 9.0), 0.0), "length = 0 mm"),
        (lambda: pixel_scale((1.0, 1.0), (1.0, 9.0), math.inf), "length = inf mm"),
        (lambda: pixel_scale((math.nan, 1.0), (1.0, 9.0), 1.0), "px apart"),
        (lambda: surface_roll((0.0, 5.0), (50.0, 6.0)), "one above the other"),
    ],
)
def test_points_that_say_nothing_are_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()
