"""Light of several wavelengths: against sums and integrals that are written out here."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from isochrome.errors import InputError
from isochrome.optics import Response, camera_response, make_chain, make_light, spectral_signal
from isochrome.scene import Camera, Polariscope, parse_scene
from refusals import refusal

REFERENCE = 587.0
GREY = Response(("grey",))
GENERIC = camera_response(Camera(colour=True))
WHITE = Polariscope(wavelength_nm=REFERENCE, light="white")


def seen(order, scope, response=GREY, *, highest=None, **given):
    """The channels' signals of a scene's light."""
    order = np.atleast_2d(np.asarray(order, dtype=float))
    light = make_light(scope, response, highest_order=highest or float(order.max()))
    chains = [make_chain(scope, wavelength_nm=w) for w in light.wavelength_nm]
    return spectral_signal(order, light, chains, reference_nm=REFERENCE, **given)


def gaussians(wavelength):
    """The generic response, as its documentation gives it."""
    peak, width = np.array([600.0, 540.0, 460.0]), np.array([35.0, 33.0, 30.0])
    return np.exp(-0.5 * ((wavelength - peak) / width) ** 2)


def integral(function, low, high, breaks=()):
    ends = [low, *breaks, high]
    return sum(
        quad(function, a, b, epsabs=1e-11, epsrel=1e-11, limit=2000)[0]
        for a, b in itertools.pairwise(ends)
    )


@given(
    order=st.floats(0.0, 50.0),
    power=st.tuples(*[st.floats(0.1, 5.0)] * 3),
    field=st.sampled_from(["dark", "bright"]),
)
def test_lines_add_up_by_their_power(order, power, field):
    """A mercury lamp: each line's fringes at its own spacing, N l0/l."""
    lines = (435.8, 546.1, 578.0)
    scope = Polariscope(
        wavelength_nm=REFERENCE, field=field, lines={"wavelength_nm": lines, "power": power}
    )
    dark = [np.sin(np.pi * order * REFERENCE / line) ** 2 for line in lines]
    exact = np.dot(power, dark if field == "dark" else [1 - d for d in dark]) / sum(power)
    # angles up to 2 pi 70 rounded to 1e-16 each
    assert seen(order, scope)[0, 0, 0] == pytest.approx(exact, abs=1e-12)


def test_a_colour_camera_weighs_lines_by_its_response():
    lines, power = np.array([450.0, 550.0, 620.0]), np.array([1.0, 2.0, 0.5])
    scope = Polariscope(wavelength_nm=REFERENCE, lines={"wavelength_nm": lines, "power": power})
    order = np.array([[0.0, 0.4, 1.7, 3.3]])
    signal = seen(order, scope, GENERIC)
    assert signal.shape == (1, 4, 3)
    weights = np.array([power[i] * gaussians(line) for i, line in enumerate(lines)])
    dark = np.sin(np.pi * order[0][:, None] * REFERENCE / lines) ** 2
    np.testing.assert_allclose(signal[0], dark @ weights / weights.sum(axis=0), rtol=0, atol=1e-13)


def test_a_fine_pixel_takes_more_from_a_shorter_wavelength():
    """Two lines on straight fringes of up to 0.2 a pixel, against the mean over the pixel."""
    lines = (480.0, 640.0)
    scope = Polariscope(
        wavelength_nm=REFERENCE, lines={"wavelength_nm": lines, "power": (1.0, 1.0)}
    )
    place = (np.arange(400) + 0.5) / 400 - 0.5
    for slope, error in ((0.1, 2.1e-5), (0.2, 3.3e-4)):
        order = np.linspace(0.0, 5.0, 101)
        visibility = np.full((1, 101), np.sinc(slope))
        exact = np.mean(
            [
                np.sin(np.pi * (order[:, None] + slope * place) * REFERENCE / line) ** 2
                for line in lines
            ],
            axis=(0, 2),
        )
        signal = seen(order, scope, visibility=visibility)[0, :, 0]
        # V^(k²) for sinc(k g): (pi g)⁴ (k⁴ - k²)/360 of the contrast, k = 1.22; the 400
        # midpoints add (pi g/400)²/12
        assert np.abs(signal - exact).max() < error


@pytest.mark.parametrize("order", [0.0, 0.31, 1.72, 4.9, 12.3, 50.2])
def test_white_light_in_three_channels_is_its_integral(order):
    """Equal energy, 400 to 700 nm, generic response, by adaptive quadrature."""
    signal = seen(order, WHITE, GENERIC)[0, 0]
    for channel in range(3):

        def weight(wavelength, channel=channel):
            return gaussians(wavelength)[channel]

        light = integral(
            lambda w: weight(w) * np.sin(np.pi * order * REFERENCE / w) ** 2, 400.0, 700.0
        )
        # stated: 1e-7 of the table's cubics (measured 1.5e-8), 1e-9 of the integral
        assert signal[channel] == pytest.approx(light / integral(weight, 400.0, 700.0), abs=1e-7)


@pytest.mark.parametrize("order", [0.5, 2.6, 20.4])
def test_a_measured_spectrum_and_response_are_linear_between_their_samples(order):
    """Samples of the lamp and of the sensor that do not coincide, and a lamp beyond the sensor."""
    lamp = {"wavelength_nm": (420.0, 500.0, 610.0, 720.0), "power": (0.1, 1.0, 0.8, 0.3)}
    sensor = Response(("grey",), np.array([450.0, 540.0, 690.0]), np.array([[0.2, 1.0, 0.4]]))
    scope = Polariscope(wavelength_nm=REFERENCE, spectrum=lamp, field="bright")

    def weight(w):
        return np.interp(w, lamp["wavelength_nm"], lamp["power"]) * np.interp(
            w, [450.0, 540.0, 690.0], [0.2, 1.0, 0.4], left=0.0, right=0.0
        )

    breaks = (500.0, 540.0, 610.0)
    light = integral(
        lambda w: weight(w) * np.cos(np.pi * order * REFERENCE / w) ** 2, 450.0, 690.0, breaks
    )
    exact = light / integral(weight, 450.0, 690.0, breaks)
    assert seen(order, scope, sensor)[0, 0, 0] == pytest.approx(exact, abs=1e-7)


REAL = Polariscope(
    wavelength_nm=REFERENCE, light="white", plate_wavelength_nm=560.0, polariser_error_deg=3.0,
    input_plate_error_deg=-2.0, output_plate_error_deg=1.0, analyser_error_deg=-1.5,
)  # fmt: skip


@pytest.mark.parametrize(
    "scope",
    [REAL, Polariscope(wavelength_nm=REFERENCE, light="white", field="plane", axis_deg=30.0)],
)
def test_real_plates_in_white_light_are_the_sum_of_their_jones_matrices(scope, jones_intensity):
    """Plates that are quarter-wave at one wavelength only, every element off by its own angle."""
    rng = np.random.default_rng(3)
    order, theta = rng.uniform(0, 6, (1, 12)), rng.uniform(-np.pi, np.pi, (1, 12))
    signal = seen(order, scope, GENERIC, direction=theta)
    angles = (93.0, 43.0, -44.0, -1.5) if scope is REAL else (30.0, None, None, 120.0)
    nodes, weights = np.polynomial.legendre.leggauss(120)
    wavelength = 550.0 + 150.0 * nodes
    response = gaussians(wavelength[:, None]) * weights[:, None]
    for i in range(12):
        light = np.array(
            [
                jones_intensity(
                    angles, order[0, i] * REFERENCE / w, theta[0, i], 0.5 * np.pi * 560.0 / w
                )
                for w in wavelength
            ]
        )
        exact = light @ response / response.sum(axis=0)
        np.testing.assert_allclose(signal[0, i], exact, rtol=0, atol=1e-7)


@pytest.mark.parametrize(("darkest", "error"), [(1.0, 1e-7), (0.93, 1e-4), (0.75, 1e-3)])
def test_the_table_of_a_spectrum_is_its_sum(darkest, error):
    """Where pixels average too: V^(k²) is taken as linear in k² about each channel's mean.

    0.93 and 0.75 are the visibilities of 0.2 and 0.4 fringes a pixel; measured 2e-8 in the first
    case, which has no visibility, 4.5e-5 and 5e-4 in the others.
    """
    rng = np.random.default_rng(1)
    order = rng.uniform(0.0, 6.0, (30, 40))
    given = {
        "direction": rng.uniform(-2.0, 2.0, order.shape),
        "visibility": rng.uniform(darkest, 1.0, order.shape),
        "reference_nm": REFERENCE,
    }
    light = make_light(REAL, GENERIC, highest_order=6.0)
    chains = [make_chain(REAL, wavelength_nm=w) for w in light.wavelength_nm]
    table = spectral_signal(order, light, chains, **given)
    summed = spectral_signal(order, replace(light, continuous=False), chains, **given)
    assert np.abs(table - summed).max() < error
    assert table.min() > -error and table.max() < 1.0 + error


@pytest.mark.parametrize(("contrast", "error"), [(0.3, 1.5e-4), (0.01, 2e-3)])
def test_a_high_order_of_little_contrast_is_still_that_order(contrast, error):
    """A filter of 14 nm: beside a pixel of order 0.5, one of 4.9 that has lost most contrast."""
    low, high, order = 580.0, 594.0, 4.9
    spectrum = {"wavelength_nm": (low, high), "power": (1.0, 1.0)}
    scope = Polariscope(wavelength_nm=REFERENCE, spectrum=spectrum)
    seen_light = seen([0.5, order], scope, visibility=np.array([[1.0, contrast]]))[0, 1, 0]

    def light(w):
        k = REFERENCE / w
        return 0.5 - 0.5 * contrast ** (k * k) * np.cos(2.0 * np.pi * k * order)

    exact = integral(light, low, high) / (high - low)
    # V^(k²) is taken as linear in k²: measured 5e-5 and 8e-4 of the contrast
    assert seen_light == pytest.approx(exact, abs=error * contrast)
    assert abs(seen_light - 0.5) > 0.2 * contrast  # a fringe is there to be seen


def test_no_visibility_leaves_grey():
    order = np.full((3, 4), 1.3)
    signal = seen(order, WHITE, GENERIC, visibility=np.zeros_like(order))
    np.testing.assert_allclose(signal, 0.5, rtol=0, atol=1e-13)


def test_a_response_file_is_read_for_the_cameras_channels(tmp_path):
    path = tmp_path / "sensor.csv"
    path.write_text("wavelength_nm,red,green,blue\n400,0,0,1\n550,0.1,1,0.2\n700,1,0,0\n")
    found = camera_response(Camera(colour=True, response="sensor.csv"), path)
    assert found.names == ("red", "green", "blue")
    np.testing.assert_allclose(
        found.at(np.array([390.0, 475.0, 700.0])), [[0, 0.05, 1], [0, 0.5, 0], [0, 0.6, 0]], rtol=0,
        atol=1e-15,
    )  # fmt: skip
    for mark in (b"", b"\xef\xbb\xbf"):  # a spreadsheet's "CSV UTF-8" begins with three bytes
        path.write_bytes(mark + b"wavelength_nm,grey\r\n400,1\r\n700,0.5\r\n")
        grey = camera_response(Camera(response="sensor.csv"), path)
        assert grey.names == ("grey",)
        np.testing.assert_array_equal(grey.at(np.array([400.0, 550.0])), [[1.0, 0.75]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "the camera's response cannot be read .*check its name"),
        ("wavelength_nm,grey\n400,1\n700,1\n", "columns wavelength_nm, red, green, blue"),
        ("wavelength_nm,red,green,blue\n400,1,1,1\n", "two rows or more"),
        ("wavelength_nm,red,green,blue\n700,1,1,1\n400,1,1,1\n", "rising wavelength_nm"),
        ("wavelength_nm,red,green,blue\n400,1,1,nan\n700,1,1,1\n", "finite"),
        ("wavelength_nm,red,green,blue\n400,1,1,x\n700,1,1,1\n", "line 2: blue = 'x'"),
        ("wavelength_nm,red,green,blue\n400,1,1,-1\n700,1,1,1\n", "must not be negative"),
        ("wavelength_nm,red,green,blue\n400,1,1,0\n700,1,1,0\n", "nor zero all over a channel"),
        (b"\xff\xfe\x00\x01", "cannot be read"),
    ],
)
def test_a_response_file_that_cannot_be_used_is_named(tmp_path, text, words):
    path = tmp_path / "sensor.csv"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=rf"sensor\.csv: .*{words}"):
        camera_response(Camera(colour=True, response="sensor.csv"), path)


def test_a_channel_that_sees_nothing_of_the_light_is_refused():
    sensor = Response(
        ("red", "green", "blue"),
        np.array([400.0, 500.0, 600.0, 700.0]),
        np.array([[0, 0, 1, 1], [0, 1, 1, 0], [1.0, 0, 0, 0]]),
    )
    scope = Polariscope(wavelength_nm=REFERENCE)
    with pytest.raises(InputError, match="blue channel sees nothing of the light"):
        make_light(scope, sensor, highest_order=1.0)
    with pytest.raises(InputError, match="wavelength_nm is missing"):
        make_light(Polariscope(), GENERIC, highest_order=1.0)


def test_what_needs_one_wavelength_refuses_several():
    with pytest.raises(InputError, match=r"several wavelengths .*needs one"):
        make_chain(WHITE)
    chain = make_chain(REAL, wavelength_nm=500.0)
    light = make_light(REAL, GREY, highest_order=1.0)
    with pytest.raises(ValueError, match="direction of sigma_1"):
        spectral_signal(
            np.ones((2, 2)), light, [chain] * len(light.wavelength_nm), reference_nm=REFERENCE
        )


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("axis_deg = 30.0", "axis_deg is the polariser's azimuth of field = 'plane' alone"),
        (
            'field = "plane"\naxis_deg = 30.0\n[[polariscope.step]]\npolariser_deg = 0\n'
            "analyser_deg = 90",
            "without steps",
        ),
        ('field = "plane"\ninput_plate_error_deg = 1.0', "input_plate_error_deg needs plates"),
        ('field = "plane"\nwavelength_nm = 587.0\nplate_wavelength_nm = 560.0',
         "plate_wavelength_nm needs plates"),
        ('light = "white"', "light needs wavelength_nm, at which the fringe value holds"),
        ("spectrum = {wavelength_nm = [400, 700], power = [1, 1]}", "spectrum needs wavelength_nm"),
        (
            'wavelength_nm = 587.0\nlight = "white"\n'
            "lines = {wavelength_nm = [400, 700], power = [1, 1]}",
            "light and lines exclude each other",
        ),
        ("wavelength_nm = 587.0\nlines = {wavelength_nm = [400, 500, 700], power = [1, 1]}",
         "has 3 numbers and power has 2"),
        ('wavelength_nm = 587.0\nlight = "red"', "polariscope.light = 'red'"),
        ("analyser_eror_deg = 1", "did you mean 'analyser_error_deg'"),
        ("wavelength_nm = 587.0\nspectrum = {wavelength = [400, 700], power = [1, 1]}",
         "did you mean 'wavelength_nm'"),
    ],
)  # fmt: skip
def test_keys_that_do_not_agree_are_refused_by_name(keys, words):
    text = f"[specimen]\nthickness_mm = 4.0\n[polariscope]\n{keys}\n"
    said = refusal(parse_scene, text, name="my")
    assert "my" in said and re.search(words, said)
