"""Uncertainties beside the values of a calibration set: the same as under [uncertainty]."""

import pytest

from isochrome.calibration import CalibrationSet, Uncertainty
from isochrome.errors import InputError
from isochrome.scene import validate

BEAM = {
    "thickness_mm": 6.0,
    "height_mm": {"value": 20.0, "standard_uncertainty": 0.02},
    "inner_span_mm": {"value": 40.0, "standard_uncertainty": 0.3},
    "outer_span_mm": {"value": 100.0, "standard_uncertainty": 0.4},
}
CAMERA = {"pixel_mm": {"value": 0.05, "standard_uncertainty": 1e-4}}
IMAGES = [
    {"file": "0.tif", "load_n": 0.0},
    {"file": "1.tif", "load_n": {"value": 100.0, "standard_uncertainty": 1.0}},
    {"file": "2.tif", "load_n": {"value": 200.0, "standard_uncertainty": 2.0}},
]


def made(**changed):
    data = {"beam": BEAM, "camera": CAMERA, "image": IMAGES} | changed
    return validate(CalibrationSet, data, "set.toml")


def test_values_are_plain_and_uncertainties_are_the_budgets_inputs():
    found = made()
    assert found.beam.height_mm == 20.0 and found.camera.pixel_mm == 0.05
    assert [image.load_n for image in found.image] == [0.0, 100.0, 200.0]
    known = found.uncertainty
    assert (known.height_mm, known.pixel_mm) == (0.02, 1e-4)
    assert known.load_percent == pytest.approx(1.0)
    # both spans together, by whose difference the moment goes, are 0.5 mm uncertain
    assert known.span_mm * 2.0**0.5 == pytest.approx(0.5)
    assert known.thickness_mm is None


def test_what_stands_under_uncertainty_stays():
    assert made(uncertainty={"thickness_mm": 0.01}).uncertainty.thickness_mm == 0.01
    assert made(uncertainty={"thickness_mm": 0.01}).uncertainty.height_mm == 0.02
    with pytest.raises(InputError, match=r"uncertainty\.height_mm is stated beside its value too"):
        made(uncertainty={"height_mm": 0.02})


def test_a_set_without_uncertainties_is_as_before():
    plain = {key: value["value"] for key, value in BEAM.items() if isinstance(value, dict)}
    images = [IMAGES[0], {"file": "1.tif", "load_n": 100.0}]
    found = made(beam=BEAM | plain, camera={"pixel_mm": 0.05}, image=images)
    assert found.uncertainty == Uncertainty()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"camera": CAMERA | {"gamma": {"value": 1.0, "standard_uncertainty": 0.1}}},
         r"camera\.gamma is no input of a calibration's budget"),
        ({"camera": CAMERA | {"bit_depth": {"value": 8, "standard_uncertainty": 1}}},
         r"camera\.bit_depth is no measured number"),
        ({"uncertainty": 0.3}, r"uncertainty = 0\.3"),
        ({"image": [{"file": "1.tif", "load_n": {"value": 1.0, "standard_uncertainty": -1.0}}]},
         r"image\[1\]\.load_n\.standard_uncertainty = -1\.0 is not allowed"),
        ({"beam": BEAM | {"height_mm": {"value": -2.0, "standard_uncertainty": 0.1}}},
         r"beam\.height_mm = -2\.0 is not allowed"),
    ],
)  # fmt: skip
def test_wrong_forms_are_refused_by_key(changed, message):
    with pytest.raises(InputError, match=message):
        made(**changed)
