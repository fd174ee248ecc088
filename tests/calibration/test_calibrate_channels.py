"""Colour images: a value for each channel, and light that is too broad is not passed over."""

import numpy as np
import pytest
import tifffile

from isochrome.calibration import calibrate_bending, calibrate_disc, load_set
from isochrome.errors import InputError

from .conftest import DIAMETER, F_SIGMA, assert_agrees, bending_load, disc_load

LINES = {"red": 640.0, "green": 546.0, "blue": 450.0}
"""A line a channel; F_SIGMA holds for the green one, and f_sigma goes with the wavelength."""

EDGES = (2.0, 3.5)
LOADS = [bending_load(e) for e in EDGES]
SMALL = {"shape": (100, 120), "pixel": 0.23}
SIZES = "[beam]\nheight_mm = 20.0\ninner_span_mm = 40.0\nouter_span_mm = 100.0\n"
CAMERA = "[camera]\npixel_mm = 0.23\nbit_depth = 8\n"
LIGHT = "[polariscope]\nwavelength_nm = 546.0\n"
THREE = LIGHT + "lines = { wavelength_nm = [450.0, 546.0, 640.0], power = [1.0, 1.0, 1.0] }\n"


def write(folder, head, images, loads):
    for i, (image, load) in enumerate(zip(images, loads, strict=True)):
        tifffile.imwrite(folder / f"c{i}.tif", image)
        head += f'[[image]]\nfile = "c{i}.tif"\nload_n = {load}\n'
    path = folder / "set.toml"
    path.write_text(head, "utf-8")
    return path


@pytest.fixture(scope="module")
def coloured(beam_frame):
    """Frames (rows, cols, 3) in the light of three lines, one a channel."""
    rng = np.random.default_rng(4)
    return [
        np.stack([beam_frame(e * 546.0 / w, rng, **SMALL) for w in LINES.values()], axis=-1)
        for e in EDGES
    ]


@pytest.mark.long
def test_each_channel_has_its_value(coloured, tmp_path):
    found = calibrate_bending(write(tmp_path, SIZES + CAMERA + THREE, coloured, LOADS))
    assert found.fringe_value_n_per_mm == pytest.approx(F_SIGMA, rel=1e-3)
    table = found.to_json()["channels"]
    for channel, wavelength in LINES.items():
        truth = F_SIGMA * wavelength / 546.0
        error = table[channel]["fringe_value_n_per_mm"] - truth
        assert abs(error) < 4 * table[channel]["standard_uncertainty"] < 4e-3 * truth
        assert table[channel]["wavelength_nm"] == wavelength
    assert any("green channel's" in w for w in found.warnings)


@pytest.mark.parametrize(
    ("more", "wavelength"),
    [('[frames]\nchannel = "red"\n', 640.0), ("[polariscope]\nwavelength_nm = 450.0\n", 450.0)],
    ids=["named", "one wavelength"],
)
def test_one_channel_where_it_is_named(coloured, tmp_path, more, wavelength):
    found = calibrate_bending(write(tmp_path, SIZES + CAMERA + more, coloured, LOADS))
    assert found.channels is None
    assert found.fringe_value_n_per_mm == pytest.approx(F_SIGMA * wavelength / 546.0, rel=1e-3)


def test_grey_images_saved_as_colour_have_one_value(beam_frame, tmp_path):
    rng = np.random.default_rng(4)
    frames = [np.repeat(beam_frame(e, rng, **SMALL)[..., None], 3, axis=2) for e in EDGES]
    path = write(tmp_path, SIZES + CAMERA, frames, LOADS)
    assert calibrate_bending(path).channels is None
    grey = [f[..., 0] for f in frames]
    path = write(tmp_path, SIZES + CAMERA + THREE, grey, LOADS)
    with pytest.raises(InputError, match="is grey"):
        calibrate_bending(path)


@pytest.mark.long
def test_white_light_is_a_band_of_each_channel(beam_frame, tmp_path):
    """Channels a hundred nanometres wide fade with the order: that is a band, no uneven light."""
    rng = np.random.default_rng(4)
    frames = []
    for edge in EDGES:
        channels = []
        for middle in LINES.values():
            waves = middle + np.linspace(-50.0, 50.0, 11)
            quiet = {**SMALL, "noise": 0.0}
            light = [beam_frame(edge * 546.0 / w, rng, **quiet).astype(float) for w in waves]
            noise = rng.normal(0.0, 2.0, SMALL["shape"])
            channels.append(np.clip(np.rint(np.mean(light, axis=0) + noise), 0, 255))
        frames.append(np.stack(channels, axis=-1).astype(np.uint8))
    path = write(tmp_path, SIZES + CAMERA, frames, LOADS)
    found = calibrate_bending(path)
    (cause,) = found.causes
    # each channel is 100 nm wide, of its middle, of even light: as wide as a Gaussian of 68 nm
    assert "band of wavelengths" in cause["cause"]
    assert cause["value"] == pytest.approx(0.5774 * 50.0 * 2.3548 / 546.0, rel=0.05)
    assert_agrees(found, times=3.0)


@pytest.mark.study
def test_a_disc_has_its_channels_too(disc_frame, tmp_path):
    rng = np.random.default_rng(4)
    frames = [
        np.stack([disc_frame(c * 546.0 / w, rng) for w in LINES.values()], axis=-1)
        for c in (2.0, 3.0)
    ]
    head = f"[disc]\ndiameter_mm = {DIAMETER}\n[camera]\nbit_depth = 8\n"
    found = calibrate_disc(write(tmp_path, head, frames, [disc_load(c) for c in (2.0, 3.0)]))
    for channel, wavelength in LINES.items():
        value = found.channels[channel]["fringe_value_n_per_mm"]
        assert value == pytest.approx(F_SIGMA * wavelength / 546.0, rel=1e-3)


def test_broad_light_in_the_set_is_refused(coloured, tmp_path):
    text = SIZES + CAMERA + '[polariscope]\nwavelength_nm = 546.0\nlight = "white"\n'
    path = write(tmp_path, text, coloured, LOADS)
    with pytest.raises(InputError, match="one wavelength"):
        load_set(path)
