"""The polariscope against explicit Jones products and closed forms; the stress-optic law."""

from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isochrome.optics import fringe_order, make_chain, polariscope_signal
from isochrome.scene import Polariscope, PolariscopeStep

angles = st.floats(-360.0, 360.0)
orders = st.floats(0.0, 50.0)


def angles_of(step):
    return step.polariser_deg, step.input_plate_deg, step.output_plate_deg, step.analyser_deg


DARK = PolariscopeStep(
    polariser_deg=90.0, input_plate_deg=45.0, output_plate_deg=-45.0, analyser_deg=0.0
)
BRIGHT = DARK.model_copy(update={"analyser_deg": 90.0})


@settings(max_examples=200, deadline=None)
@given(
    order=orders, theta=st.floats(-np.pi, np.pi), polariser=angles, first=angles, second=angles,
    analyser=angles, ratio=st.floats(0.5, 1.5), plates=st.booleans(),
)  # fmt: skip
def test_any_chain_is_the_product_of_its_jones_matrices_and_keeps_the_energy(
    jones_intensity, order, theta, polariser, first, second, analyser, ratio, plates
):
    """Misaligned elements, plates of another wavelength, with and without plates."""
    step = PolariscopeStep(
        polariser_deg=polariser, input_plate_deg=first if plates else None,
        output_plate_deg=second if plates else None, analyser_deg=analyser,
    )  # fmt: skip
    scope = Polariscope(wavelength_nm=600.0, plate_wavelength_nm=600.0 * ratio, step=[step])
    signal = polariscope_signal(np.array(order), make_chain(scope, 0), direction=np.array(theta))
    exact = jones_intensity(angles_of(step), order, theta, 0.5 * np.pi * ratio)
    # angles up to 2 pi 50 rounded to 1e-16 each: 1e-13
    assert float(signal) == pytest.approx(exact, abs=1e-12)
    assert -1e-12 <= float(signal) <= 1.0 + 1e-12


@settings(max_examples=50, deadline=None)
@given(order=orders, theta=st.floats(-np.pi, np.pi), axis=st.none() | angles)
def test_the_plane_field_is_crossed_about_its_axis(order, theta, axis):
    """I = sin²(2 (theta - axis)) sin²(pi N), with the polariser upright where no axis is given."""
    scope = Polariscope(field="plane", axis_deg=axis)
    signal = polariscope_signal(np.array(order), make_chain(scope), direction=np.array(theta))
    upright = 90.0 if axis is None else axis
    exact = np.sin(2 * (theta - np.deg2rad(upright))) ** 2 * np.sin(np.pi * order) ** 2
    assert float(signal) == pytest.approx(exact, abs=1e-12)


errors = st.floats(-20.0, 20.0)


@settings(max_examples=200, deadline=None)
@given(
    order=orders, theta=st.floats(-np.pi, np.pi), wrong=st.tuples(errors, errors, errors, errors),
    ratio=st.floats(0.7, 1.4),
    field=st.sampled_from(["dark", "bright", "plane", "step", "plane step"]),
)  # fmt: skip
def test_an_elements_error_turns_it_and_no_other(
    jones_intensity, order, theta, wrong, ratio, field
):
    """The nominal angles and the errors, added up here and multiplied out."""
    nominal = {
        "dark": (90.0, 45.0, -45.0, 0.0), "bright": (90.0, 45.0, -45.0, 90.0),
        "plane": (90.0, None, None, 180.0), "step": (80.0, 30.0, -40.0, 20.0),
        "plane step": (80.0, None, None, 20.0),
    }[field]  # fmt: skip
    names = ("polariser", "input_plate", "output_plate", "analyser")
    keys = {f"{n}_error_deg": e for n, e in zip(names, wrong, strict=True)}
    if field == "plane":
        keys = {k: v for k, v in keys.items() if "plate" not in k}
    else:
        keys |= {"wavelength_nm": 600.0, "plate_wavelength_nm": 600.0 * ratio}
    if "step" in field:
        step = {f"{n}_deg": a for n, a in zip(names, nominal, strict=True)}
        chain = make_chain(Polariscope(step=[step], **keys), 0)
    else:
        chain = make_chain(Polariscope(field=field, **keys))
    signal = polariscope_signal(np.array(order), chain, direction=np.array(theta))
    stand = tuple(None if a is None else a + e for a, e in zip(nominal, wrong, strict=True))
    exact = jones_intensity(stand, order, theta, 0.5 * np.pi * ratio)
    # angles up to 2 pi 50 rounded to 1e-16 each: 1e-13
    assert float(signal) == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize(
    ("keys", "ideal"),
    [
        ({"analyser_error_deg": 0.0}, 1),
        ({"analyser_error_deg": 90.0}, -1),  # a dark field that is the bright one
        ({"plate_wavelength_nm": 587.0}, 1),  # the light's own
        ({"plate_wavelength_nm": 560.0}, 0),
    ],
)
def test_what_leaves_a_field_ideal_needs_no_direction(keys, ideal):
    chain = make_chain(Polariscope(wavelength_nm=587.0, **keys))
    assert chain.ideal == ideal
    needed = pytest.raises(ValueError, match="direction of sigma_1")
    with nullcontext() if ideal else needed:
        polariscope_signal(np.zeros(3), chain)


@pytest.mark.parametrize("field", ["dark", "bright"])
def test_the_ideal_field_keeps_its_digits_at_any_order(field):
    """Order 50 as exact as order 1: N is a whole number and a binary fraction, so that the truth
    is known from the fraction alone."""
    fraction = np.arange(64) / 64.0
    truth = np.sin(np.pi * fraction) ** 2
    truth = truth if field == "dark" else 1.0 - truth
    for whole in (0, 1, 50, 1000):
        signal = polariscope_signal(whole + fraction, make_chain(Polariscope(field=field)))
        np.testing.assert_allclose(signal, truth, rtol=0, atol=1e-15)
        general = make_chain(Polariscope(step=[DARK if field == "dark" else BRIGHT]), 0)
        light = polariscope_signal(whole + fraction, general, direction=0.3 + fraction)
        np.testing.assert_allclose(light, truth, rtol=0, atol=1e-14)


def test_single_precision_stays_single_and_far_below_a_grey_level():
    order = np.random.default_rng(0).uniform(0.0, 50.0, (200, 300)).astype(np.float32)
    visibility = np.full_like(order, 0.9)
    signal = polariscope_signal(order, make_chain(Polariscope()), visibility=visibility)
    assert signal.dtype == np.float32
    exact = 0.5 - 0.5 * 0.9 * np.cos(2 * np.pi * order.astype(float))
    # roundings of single precision, 6e-8 each; half a level of 10 bits is 5e-4
    assert np.abs(signal - exact).max() < 3e-7


@given(sx=st.floats(-100, 100), sz=st.floats(-100, 100), txz=st.floats(-100, 100))
def test_fringe_order_counts_the_principal_difference(sx, sz, txz):
    low, high = np.linalg.eigvalsh(np.array([[sx, txz], [txz, sz]]))
    order = fringe_order(
        np.array([(sx - sz) + 2j * txz]), thickness_mm=3.0, fringe_value_n_per_mm=10.0
    )
    assert order[0] == pytest.approx(0.3 * (high - low), abs=1e-12)
