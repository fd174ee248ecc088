"""Scenes to signals: what `picture_signal` makes of light, elements and a camera's colour."""

from functools import cache

import numpy as np
import pytest

from isochrome.optics import expose
from isochrome.reference import disc_centre_difference, disc_stress
from isochrome.scene import parse_scene
from isochrome.simulation import make_picture, picture_signal, scene_states, state_difference
from isochrome.stress import pixel_grid
from scene_texts import camera_text, disc_text

DISC = disc_text(240.0, fringe_value=12.0) + "[polariscope]\nwavelength_nm = 587.0\n"
DISC += camera_text(121, 121, 0.18)


@cache
def disc():
    scene = parse_scene(DISC, name="disc")
    pixels = pixel_grid(scene)
    (state,) = scene_states(scene)
    return scene, make_picture(scene, state_difference(scene, state, pixels), pixels)


def signal_of(**values):
    scene, picture = disc()
    changed = scene.with_values({k.replace("__", "."): v for k, v in values.items()})
    return picture_signal(changed, picture)


def centre_order():
    field = disc_centre_difference(load_n=240.0, diameter_mm=20.0, thickness_mm=6.0)
    return field * 6.0 / 12.0


def test_a_colour_frame_has_three_channels_and_no_light_outside():
    signal = signal_of(camera__colour=True, polariscope__light="white")
    assert signal.shape == (121, 121, 3)
    assert signal_of(polariscope__light="white").shape == (121, 121)  # by a grey camera
    material = disc()[1].material
    assert not signal[~material].any()
    assert (signal[material] >= -1e-6).all() and (signal[material] <= 1 + 1e-6).all()
    # its lines of equal order have colours: the channels differ
    assert np.abs(signal[..., 0] - signal[..., 2]).max() > 0.5
    seen = expose(signal, disc()[0].with_values({"camera.bit_depth": 8}).camera)
    assert seen.shape == signal.shape and seen.dtype == np.uint8


def bent_over_a_pixel():
    """The mean of the closed form over the middle pixel, by Gauss points, over its middle."""
    place = 0.5 * pixel_grid(disc()[0]).pixel_mm * np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
    field = disc_stress(
        place[None, :], place[:, None], load_n=240.0, diameter_mm=20.0, thickness_mm=6.0
    )
    difference = np.hypot(field.sigma_x - field.sigma_z, 2 * field.tau_xz)
    weight = np.array([5.0, 8.0, 5.0]) / 18.0
    return weight @ difference @ weight / difference[1, 1]


def test_the_middle_of_a_disc_has_the_colour_of_its_order():
    """8 P/(pi D f) in the middle, and each channel's integral of it."""
    order = centre_order() * bent_over_a_pixel()
    wavelength = np.linspace(400.0, 700.0, 30_001)
    signal = signal_of(camera__colour=True, polariscope__light="white")[60, 60]
    dark = np.sin(np.pi * order * 587.0 / wavelength) ** 2
    for channel, (peak, width) in enumerate(((600, 35), (540, 33), (460, 30))):
        response = np.exp(-0.5 * ((wavelength - peak) / width) ** 2)
        exact = np.trapezoid(dark * response) / np.trapezoid(response)
        # the middle is a saddle of the order, without slope to the pixel; a table's cubics, 1e-7,
        # and what the bend over a pixel leaves out, of fourth order, 2.5e-7
        assert signal[channel] == pytest.approx(exact, abs=1e-6)


def test_one_wavelength_in_colour_is_the_grey_frame_three_times():
    grey, colour = signal_of(), signal_of(camera__colour=True)
    for channel in range(3):
        np.testing.assert_allclose(colour[..., channel], grey, rtol=0, atol=1e-14)


def test_the_plane_field_of_a_disc_is_black_along_its_axes():
    """On the load's line and across it the principal axes are upright: isoclinic of 0 and 90."""
    signal = signal_of(polariscope__field="plane")
    assert np.abs(signal[60, 1:-1]).max() < 1e-12
    assert np.abs(signal[5:-5, 60]).max() < 1e-12
    # turned by 45 degrees the same lines show the whole fringe
    turned = signal_of(polariscope__field="plane", polariscope__axis_deg=45.0)
    dark = signal_of()
    np.testing.assert_allclose(turned[60], dark[60], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("bits", "kind"), [(8, np.float32), (10, np.float32), (12, np.float64)])
def test_precision_follows_the_cameras_bits(bits, kind):
    scene, picture = disc()
    from dataclasses import replace

    single = replace(
        picture,
        mean_order=picture.mean_order.astype(np.float32),
        visibility=picture.visibility.astype(np.float32),
    )
    signal = picture_signal(scene.with_values({"camera.bit_depth": bits}), single)
    assert signal.dtype == kind
    exact = 0.5 - 0.5 * picture.visibility * np.cos(2 * np.pi * picture.mean_order)
    known = picture.material & (picture.order < 50.0)
    # N of up to 50 is known to 2e-6 in single precision: 6e-6 of light, an eightieth of the half
    # level of 10 bits, 5e-4
    assert np.abs(signal - exact)[known].max() < 1e-5
