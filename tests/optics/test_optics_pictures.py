"""Scenes to signals: what `picture_signal` makes of light, elements and a camera's colour."""

from functools import cache

import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.optics import expose
from isochrome.reference import disc_centre_difference, disc_stress
from isochrome.scene import parse_scene
from isochrome.simulation import make_picture, picture_signal, scene_states, state_difference
from isochrome.stress import pixel_grid

DISC = """
[specimen]
shape = "disc"
diameter_mm = 20.0
thickness_mm = 6.0
fringe_value_n_per_mm = 12.0
[load]
normal_n = 240.0
[polariscope]
wavelength_nm = 587.0
[camera]
width_px = 121
height_px = 121
pixel_mm = 0.18
"""


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


def test_a_response_file_stands_beside_the_scene(tmp_path):
    (tmp_path / "sensor.csv").write_text("wavelength_nm,grey\n580,1\n590,1\n", "utf-8")
    text = DISC.replace("[camera]", 'light = "white"\n[camera]\nresponse = "sensor.csv"')
    scene = parse_scene(text, name="disc", folder=tmp_path)
    narrow = picture_signal(scene, disc()[1])
    assert narrow.shape == (121, 121)
    # 10 nm about 585 nm: a filter; cos 2 pi N washes out by (pi N 10/587)²/6 and its middle is off
    # by 2/587, 2 pi N 2/587 in phase
    near = disc()[1].order < 2.0
    bound = 0.5 * (2 * np.pi * 2.0 * 2 / 587) + (np.pi * 2.0 * 10 / 587) ** 2 / 12
    assert np.abs(narrow - signal_of())[near & disc()[1].material].max() < 1.2 * bound
    with pytest.raises(InputError, match=r"sensor\.csv: .*cannot be read"):
        picture_signal(scene.model_copy(update={"folder": tmp_path / "no"}), disc()[1])


def test_the_plane_field_of_a_disc_is_black_along_its_axes():
    """On the load's line and across it the principal axes are upright: isoclinic of 0 and 90."""
    signal = signal_of(polariscope__field="plane")
    assert np.abs(signal[60, 1:-1]).max() < 1e-12
    assert np.abs(signal[5:-5, 60]).max() < 1e-12
    # turned by 45 degrees the same lines show the whole fringe
    turned = signal_of(polariscope__field="plane", polariscope__axis_deg=45.0)
    dark = signal_of()
    np.testing.assert_allclose(turned[60], dark[60], rtol=0, atol=1e-12)


def test_an_analysers_error_mixes_the_direction_into_the_dark_field():
    """I = [1 - V (cos 2e cos δ + sin 2e cos 2θ sin δ)]/2 for an analyser off by e behind ideal
    plates. Source: Patterson & Wang (1991), Strain 27, 49, with φ = -45, β = e degrees; the sign of
    δ is that of a retarder whose fast axis is along sigma_1."""
    error = 4.0
    signal = signal_of(polariscope__analyser_error_deg=error)
    scene, picture = disc()
    pixels = pixel_grid(scene)
    field = disc_stress(
        pixels.x_mm[None, :],
        (pixels.z_mm - 10.0)[:, None],
        load_n=240.0,
        diameter_mm=20.0,
        thickness_mm=6.0,
    )
    turn, delta = np.deg2rad(2 * error), 2 * np.pi * picture.mean_order
    difference = field.sigma_x - field.sigma_z
    cosine = difference / np.hypot(difference, 2 * field.tau_xz)
    wave = np.cos(turn) * np.cos(delta) + np.sin(turn) * cosine * np.sin(delta)
    exact = 0.5 - 0.5 * picture.visibility * wave
    known = picture.material & (picture.order < 50.0)
    # angles of up to 2 pi 50 and the closed form's own roundings
    np.testing.assert_allclose(signal[known], exact[known], rtol=0, atol=1e-11)


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
