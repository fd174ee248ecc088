"""The polariscope against explicit Jones products, and finite pixels against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isochrome.optics import fringe_order, make_chain, pixel_visibility, polariscope_signal
from isochrome.optics.polariscope import Chain
from isochrome.reference import contact_modulus, hertz_half_width, hertz_peak_pressure
from isochrome.scene import Polariscope, PolariscopeStep

angles = st.floats(-360.0, 360.0)
orders = st.floats(0.0, 50.0)


def rotated(matrix, angle):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    return turn @ matrix @ turn.T


def jones_retarder(retardance, axis):
    """A retarder as two phases along and across its axis: the textbook form, no half angles."""
    return rotated(np.diag([np.exp(-0.5j * retardance), np.exp(0.5j * retardance)]), axis)


def jones_intensity(step, order, theta, plate):
    """Analyser · plate · specimen · plate · polariser, multiplied out."""
    rad = np.deg2rad
    field = np.array([np.cos(rad(step.polariser_deg)), np.sin(rad(step.polariser_deg))], complex)
    if step.input_plate_deg is not None:
        field = jones_retarder(plate, rad(step.input_plate_deg)) @ field
    field = jones_retarder(2 * np.pi * order, theta) @ field
    if step.output_plate_deg is not None:
        field = jones_retarder(plate, rad(step.output_plate_deg)) @ field
    seen = np.array([np.cos(rad(step.analyser_deg)), np.sin(rad(step.analyser_deg))])
    return abs(seen @ field) ** 2


DARK = PolariscopeStep(
    polariser_deg=90.0, input_plate_deg=45.0, output_plate_deg=-45.0, analyser_deg=0.0
)
BRIGHT = DARK.model_copy(update={"analyser_deg": 90.0})


@pytest.mark.parametrize(("field", "elements"), [("dark", DARK), ("bright", BRIGHT)])
def test_ideal_circular_polariscope_is_sine_or_cosine_squared_whatever_the_direction(
    field, elements
):
    """The short way, the general chain and the multiplied matrices: all sin² or cos² to 1e-14."""
    order = np.linspace(0.0, 6.0, 241)
    theta = np.random.default_rng(0).uniform(-np.pi, np.pi, 241)
    truth = np.sin(np.pi * order) ** 2 if field == "dark" else np.cos(np.pi * order) ** 2
    ideal = make_chain(Polariscope(field=field))
    assert ideal.ideal == (1 if field == "dark" else -1)
    general = make_chain(Polariscope(step=[elements]), 0)
    assert general.ideal == 0
    # 1e-14: the bar of the issue; some ten roundings
    np.testing.assert_allclose(polariscope_signal(order, ideal), truth, rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        polariscope_signal(order, general, direction=theta), truth, rtol=0, atol=1e-14
    )
    brute = [jones_intensity(elements, n, t, np.pi / 2) for n, t in zip(order, theta, strict=True)]
    np.testing.assert_allclose(brute, truth, rtol=0, atol=1e-14)


def test_the_ideal_chains_amplitudes_are_those_of_its_elements():
    # whoever takes the short way's amplitudes gets the light of the general one, for any direction
    for field, elements in (("dark", DARK), ("bright", BRIGHT)):
        short, full = (
            make_chain(Polariscope(field=field)),
            make_chain(Polariscope(step=[elements]), 0),
        )
        theta = np.linspace(-2, 2, 9)
        order = np.linspace(0, 3, 9)
        plain = Chain(short.alpha, short.beta, short.gamma)
        np.testing.assert_allclose(
            polariscope_signal(order, plain, direction=theta),
            polariscope_signal(order, full, direction=theta),
            rtol=0,
            atol=1e-14,
        )


@settings(max_examples=200, deadline=None)
@given(
    order=orders,
    theta=st.floats(-np.pi, np.pi),
    polariser=angles,
    first=angles,
    second=angles,
    analyser=angles,
    ratio=st.floats(0.5, 1.5),
    plates=st.booleans(),
)
def test_any_chain_is_the_product_of_its_jones_matrices_and_keeps_the_energy(
    order, theta, polariser, first, second, analyser, ratio, plates
):
    """Misaligned elements, plates of another wavelength, with and without plates."""
    step = PolariscopeStep(
        polariser_deg=polariser,
        input_plate_deg=first if plates else None,
        output_plate_deg=second if plates else None,
        analyser_deg=analyser,
    )
    scope = Polariscope(wavelength_nm=600.0, plate_wavelength_nm=600.0 * ratio, step=[step])
    signal = polariscope_signal(np.array(order), make_chain(scope, 0), direction=np.array(theta))
    exact = jones_intensity(step, order, theta, 0.5 * np.pi * ratio)
    # angles up to 2 pi 50 rounded to 1e-16 each: 1e-13
    assert float(signal) == pytest.approx(exact, abs=1e-12)
    assert -1e-12 <= float(signal) <= 1.0 + 1e-12


@settings(max_examples=50, deadline=None)
@given(order=orders, theta=st.floats(-np.pi, np.pi), beta=angles)
def test_crossed_plane_polariscope_shows_isoclinics_and_isochromatics(order, theta, beta):
    """I = sin²(2 (theta - beta)) sin²(pi N), dark on isoclinics of any order."""
    step = PolariscopeStep(polariser_deg=beta + 90.0, analyser_deg=beta)
    signal = polariscope_signal(
        np.array(order), make_chain(Polariscope(step=[step]), 0), direction=np.array(theta)
    )
    exact = np.sin(2 * (theta - np.deg2rad(beta))) ** 2 * np.sin(np.pi * order) ** 2
    assert float(signal) == pytest.approx(exact, abs=1e-12)


def test_bright_and_dark_field_share_out_the_light():
    order = np.linspace(0, 50, 501)
    light = sum(
        polariscope_signal(order, make_chain(Polariscope(field=field)))
        for field in ("dark", "bright")
    )
    np.testing.assert_allclose(light, 1.0, rtol=0, atol=1e-15)


def test_plates_of_another_wavelength_leave_light_in_the_dark_field_only_with_direction():
    """Real quarter-wave plates: without stress the dark field stays dark, with it the isoclinics
    shine through by the square of the plates' error."""
    scope = Polariscope(wavelength_nm=587.0, plate_wavelength_nm=560.0)
    chain = make_chain(scope)
    assert chain.ideal == 0
    theta = np.linspace(-np.pi / 2, np.pi / 2, 181)
    dark = polariscope_signal(np.zeros(181), chain, direction=theta)
    np.testing.assert_allclose(dark, 0.0, rtol=0, atol=1e-15)
    half = polariscope_signal(np.full(181, 0.5), chain, direction=theta)
    error = 0.5 * np.pi * (560 / 587 - 1)
    # at N = 1/2 the matched pair transmits 1 less sin² of the error, times cos² 2 theta at most
    assert half.max() <= 1.0 + 1e-15
    assert 1 - half.min() == pytest.approx(np.sin(error) ** 2, rel=1e-6)


def test_a_chain_that_needs_the_direction_says_so():
    chain = make_chain(Polariscope(wavelength_nm=587.0, plate_wavelength_nm=560.0))
    with pytest.raises(ValueError, match="direction of sigma_1"):
        polariscope_signal(np.zeros(3), chain)


def test_plates_of_the_lights_own_wavelength_are_the_ideal_ones():
    assert make_chain(Polariscope(wavelength_nm=587.0, plate_wavelength_nm=587.0)).ideal == 1


# --- stress-optic law ---------------------------------------------------------------------------


def test_fringe_order_is_difference_times_thickness_over_fringe_value():
    # 0.6006 p0 of the paper's contact through 4 mm at 14.6 N/mm per fringe: N = 3.086
    modulus = contact_modulus(2100.0, 0.4, 210000.0, 0.3)
    p0 = hertz_peak_pressure(11.0, 24.61, modulus)
    assert hertz_half_width(11.0, 24.61, modulus) == pytest.approx(0.37332, abs=5e-6)
    order = fringe_order(
        np.array([0.6006 * p0 * np.exp(0.7j)]), thickness_mm=4.0, fringe_value_n_per_mm=14.6
    )
    assert order[0] == pytest.approx(3.086, abs=1e-3)


@given(sx=st.floats(-100, 100), sz=st.floats(-100, 100), txz=st.floats(-100, 100))
def test_fringe_order_counts_the_principal_difference(sx, sz, txz):
    low, high = np.linalg.eigvalsh(np.array([[sx, txz], [txz, sz]]))
    order = fringe_order(
        np.array([(sx - sz) + 2j * txz]), thickness_mm=3.0, fringe_value_n_per_mm=10.0
    )
    assert order[0] == pytest.approx(0.3 * (high - low), abs=1e-12)


# --- pixels of finite size -----------------------------------------------------------------------


def supersampled(order_at, rows, cols, samples=16):
    """The mean of sin²(pi N) over each pixel, by samples² midpoints."""
    fine = (np.arange(samples) + 0.5) / samples - 0.5
    z = np.arange(rows)[:, None, None, None] + fine[None, None, :, None]
    x = np.arange(cols)[None, :, None, None] + fine[None, None, None, :]
    return (np.sin(np.pi * order_at(x, z)) ** 2).mean(axis=(2, 3))


@pytest.mark.parametrize("gradient", [(0.0, 0.3), (0.2, 0.0), (0.25, 0.33), (0.45, 0.1)])
def test_straight_fringes_lose_contrast_as_the_sinc_of_their_gradient(gradient):
    def order_at(x, z):
        return 3.0 + gradient[1] * x + gradient[0] * z

    rows, cols = np.indices((12, 13))
    order = order_at(cols, rows)
    visibility, too_fine = pixel_visibility(order)
    signal = polariscope_signal(order, make_chain(Polariscope()), visibility=visibility)
    # exact for straight fringes; the samples' own midpoint error is (pi g/16)²/6 of the contrast
    np.testing.assert_allclose(signal, supersampled(order_at, 12, 13), rtol=0, atol=1.5e-3)
    assert too_fine == 0.0


def test_curved_fringes_are_averaged_over_the_pixel_not_sampled():
    """Rings that run from broad to a third of a fringe a pixel; point samples would alias."""

    def order_at(x, z):
        return 0.0028 * ((x - 10.0) ** 2 + (z + 4.0) ** 2)

    rows, cols = np.indices((50, 50))
    order = order_at(cols, rows)
    visibility, _ = pixel_visibility(order)
    signal = polariscope_signal(order, make_chain(Polariscope()), visibility=visibility)
    exact = supersampled(order_at, 50, 50)
    inner = np.s_[1:-1, 1:-1]
    # what curvature adds is pi N'' / 12 = 1.5e-3; one-sided differences at the border are worse
    assert np.abs(signal - exact)[inner].max() < 3e-3
    pointwise = np.sin(np.pi * order) ** 2
    assert np.abs(pointwise - exact)[inner].max() > 0.05


def test_order_fifty_is_rendered_to_rounding():
    """Hard case: order-50 fringes; the phase loses no digits that a camera could see."""
    order = np.full((5, 5), 50.25)
    visibility, _ = pixel_visibility(order)
    signal = polariscope_signal(order, make_chain(Polariscope()), visibility=visibility)
    np.testing.assert_allclose(signal, 0.5, rtol=0, atol=1e-13)


def test_fringes_finer_than_two_pixels_are_counted_not_aliased():
    _, cols = np.indices((20, 20))
    for gradient, share in ((0.4, 0.0), (0.6, 1.0)):
        visibility, too_fine = pixel_visibility(gradient * cols)
        assert too_fine == share
        assert (visibility >= 0).all() and (visibility <= 1).all()


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
