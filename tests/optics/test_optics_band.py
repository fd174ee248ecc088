"""A band of wavelengths: contrast that falls with order, against the mean over the band."""

import numpy as np
import pytest
from pydantic import ValidationError

from isochrome.optics import make_chain, polariscope_signal
from isochrome.scene import Polariscope

ORDER = np.linspace(0.0, 5.0, 201)
DIRECTION = np.linspace(-1.5, 1.5, 201)


def mean_over_band(chain_of, width_nm, points=80):
    """Gauss and Hermite's sum over the wavelengths, N ~ 1/wavelength."""
    places, weights = np.polynomial.hermite_e.hermegauss(points)
    sigma = width_nm / (2.0 * np.sqrt(2.0 * np.log(2.0))) / 587.0
    found = [
        polariscope_signal(ORDER / (1.0 + sigma * p), chain_of, direction=DIRECTION) for p in places
    ]
    return np.tensordot(weights / weights.sum(), np.array(found), 1)


@pytest.mark.parametrize(
    "errors", [{}, {"input_plate_error_deg": 4.0, "output_plate_error_deg": 3.0}]
)
@pytest.mark.parametrize("width", [10.0, 40.0])
def test_a_band_is_the_mean_over_its_wavelengths(width, errors):
    plain = Polariscope(wavelength_nm=587.0, **errors)
    wide = make_chain(Polariscope(wavelength_nm=587.0, bandwidth_nm=width, **errors))
    seen = polariscope_signal(ORDER, wide, direction=DIRECTION)
    truth = mean_over_band(make_chain(plain), width)
    # what is left out of 1/(1+x): 2 pi N s³ of a turn, times some for its third moment
    assert (
        np.abs(seen - truth).max() < 4.0 * 2.0 * np.pi * 5.0 * (width / 2.355 / 587.0) ** 3 + 1e-9
    )
    assert np.ptp(seen[-40:]) < np.ptp(
        polariscope_signal(ORDER, make_chain(plain), direction=DIRECTION)[-40:]
    )


def test_no_band_is_no_band():
    plain, none = (
        Polariscope(wavelength_nm=587.0),
        Polariscope(wavelength_nm=587.0, bandwidth_nm=0.0),
    )
    np.testing.assert_array_equal(
        polariscope_signal(ORDER, make_chain(plain)), polariscope_signal(ORDER, make_chain(none))
    )


def test_a_band_needs_its_wavelength_and_no_other_light():
    with pytest.raises(ValidationError, match="bandwidth_nm needs wavelength_nm"):
        Polariscope(bandwidth_nm=10.0)
    with pytest.raises(ValidationError, match="light and bandwidth_nm exclude each other"):
        Polariscope(wavelength_nm=587.0, bandwidth_nm=10.0, light="white")
