"""From grey levels to light and to fringe signal; the no-load frames."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isochrome.errors import InputError
from isochrome.frames import Linear, find_outliers, load_no_load, normalise, to_linear
from isochrome.output import write_tiff
from isochrome.scene import parse_scene

ROWS, COLS = 120, 160
ROW, COL = np.mgrid[:ROWS, :COLS].astype(float)
VIGNETTE = 1 - 0.6 * ((COL / COLS - 0.5) ** 2 + (ROW / ROWS - 0.5) ** 2)
DARK = 0.05 * VIGNETTE
BRIGHT = 0.9 * VIGNETTE
ORDER = 5 / (1 + ((COL - 80) ** 2 + (ROW + 20) ** 2) / 60**2)


@given(bits=st.integers(1, 16), gamma=st.floats(0.5, 3))
@settings(max_examples=40, deadline=None)
def test_gamma_and_full_scale_are_undone_for_any_sensor(bits, gamma):
    full = 2**bits - 1
    raw = np.linspace(0, full, 60).round().astype(np.uint16).reshape(6, 10)
    linear = to_linear(raw, bit_depth=bits, gamma=gamma)
    # float32 holds 6e-8; the power multiplies a relative error by gamma, at most 3.
    np.testing.assert_allclose(linear.image, (raw / full) ** gamma, rtol=2e-6, atol=1e-7)
    assert linear.valid.all()  # a ramp that ends at full scale has no plateau there


def test_ten_bits_in_sixteen_are_scaled_by_the_sensor():
    raw = np.full((4, 4), 500, np.uint16)
    raw[0, 0] = 1
    assert to_linear(raw, bit_depth=10).image[2, 2] == pytest.approx(500 / 1023, rel=1e-6)


@pytest.mark.parametrize(
    ("value", "words"), [(0, "all black"), (255, "all white"), (90, "constant"), (np.nan, "NaN")]
)
def test_blank_frame_is_refused_by_name(value, words):
    image = np.full((8, 8), value, float if np.isnan(value) else np.uint8)
    with pytest.raises(InputError, match=f"frame 3.*{words}"):
        to_linear(image, bit_depth=8, name="frame 3")


def test_saturated_and_nan_pixels_are_masked():
    assert to_linear(np.zeros((8, 8), np.uint8), bit_depth=8, allow_blank=True).valid.all()
    with pytest.raises(InputError, match="NaN"):
        to_linear(np.full((8, 8), np.nan), bit_depth=None, allow_blank=True)
    image = np.tile(np.linspace(0.1, 0.9, 20, dtype=np.float32), (10, 1))
    image[2, 3], image[5, 6:9] = np.nan, 1.0
    linear = to_linear(image, bit_depth=None)
    assert not linear.valid[2, 3] and not linear.valid[5, 6:9].any()
    assert np.isnan(linear.image[2, 3]) and linear.valid.sum() == 200 - 4
    with pytest.raises(InputError, match=r"camera\.bit_depth"):
        to_linear(np.array([[0.0, 200.0]]), bit_depth=None)


def noisy(ideal, seed, sigma=3.0):
    raw = 255 * ideal + sigma * np.random.default_rng(seed).standard_normal(ideal.shape)
    return np.clip(raw.round(), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("per_pixel", [0.02, 0.1, 0.2, 0.35])
@pytest.mark.parametrize("angle", [0.0, 30.0, 45.0, 90.0])
def test_fine_fringes_are_not_taken_for_dead_pixels(per_pixel, angle):
    turn = np.deg2rad(angle)
    phase = np.pi * per_pixel * (COL * np.cos(turn) + ROW * np.sin(turn))
    assert not find_outliers(noisy(0.05 + 0.85 * np.sin(phase) ** 2, 0)).any()


def test_dead_and_hot_pixels_are_found_single_and_in_pairs():
    image = noisy(DARK + (BRIGHT - DARK) * np.sin(np.pi * 0.02 * COL) ** 2, 1)
    spots = [(20, 30), (20, 31), (50, 77), (90, 120), (100, 5)]
    for row, col in spots:
        image[row, col] = 0 if image[row, col] > 120 else 254
    assert sorted(zip(*np.nonzero(find_outliers(image)), strict=True)) == sorted(spots)


def trusted(light):
    """Light of which every pixel is to be trusted."""
    return Linear(light, np.ones(light.shape, bool))


@pytest.mark.parametrize("field", ["dark", "bright"])
def test_signal_is_exact_with_both_no_load_frames(field):
    signal = np.sin(np.pi * ORDER) ** 2 if field == "dark" else np.cos(np.pi * ORDER) ** 2
    result = normalise(*map(trusted, (DARK + (BRIGHT - DARK) * signal, DARK, BRIGHT)))
    # The signal is stored as float32.
    np.testing.assert_allclose(result.signal, signal, atol=1e-6)
    assert result.valid.all()


@given(scale=st.floats(0.05, 20), shift=st.floats(-3, 3))
@settings(max_examples=30, deadline=None)
def test_signal_does_not_change_with_exposure_and_offset(scale, shift):
    light = DARK + (BRIGHT - DARK) * np.sin(np.pi * ORDER) ** 2
    parts = light, DARK, BRIGHT
    first = normalise(*map(trusted, parts)).signal
    second = normalise(*(trusted(scale * part + shift) for part in parts)).signal
    np.testing.assert_allclose(first, second, atol=2e-6)  # float32


def test_pixels_without_contrast_are_nan_and_wrong_no_load_frames_refused():
    bright = BRIGHT.copy()
    bright[:, :10] = DARK[:, :10]
    frame = to_linear(noisy(DARK + (BRIGHT - DARK) * 0.5, 3), bit_depth=8)
    frame.valid[50, 60] = False
    result = normalise(frame, trusted(DARK), trusted(bright))
    assert not result.valid[:, :10].any() and not result.valid[50, 60]
    np.testing.assert_array_equal(np.isnan(result.signal), ~result.valid)
    with pytest.raises(InputError, match="swapped"):
        normalise(trusted(DARK), trusted(BRIGHT), trusted(DARK))


SCENE = """
[specimen]
[camera]
bit_depth = 12
[frames]
gamma = 2.2
no_load_dark = "dark.tif"
no_load_bright = "bright.tif"
roi = {top_px = 10, left_px = 20, height_px = 50, width_px = 60}
"""


def test_no_load_frames_are_read_like_the_frames_and_stacks_averaged(tmp_path):
    full = 4095
    dark = np.round(full * DARK ** (1 / 2.2)).astype(np.uint16)
    bright = np.round(full * BRIGHT ** (1 / 2.2)).astype(np.uint16)
    write_tiff(tmp_path / "dark.tif", dark[None])
    write_tiff(tmp_path / "bright.tif", np.stack([bright - 40, bright + 40]))
    found = load_no_load(parse_scene(SCENE, folder=tmp_path), full_shape=(ROWS, COLS))
    # Rounding to 12 bits: 2.2 / 2 / 4095 at most.
    np.testing.assert_allclose(found[0].image, DARK[10:60, 20:80], atol=3e-4)
    # The mean of two frames 40 levels either side; the power's curvature leaves 1e-4.
    np.testing.assert_allclose(found[1].image, BRIGHT[10:60, 20:80], atol=1e-3)
    with pytest.raises(InputError, match=r"no_load_dark is \(120, 160\)"):
        load_no_load(parse_scene(SCENE, folder=tmp_path), full_shape=(ROWS, COLS + 1))
    assert load_no_load(parse_scene("[specimen]\n")) == (None, None)


def test_missing_small_or_overexposed_no_load_frames_are_refused(tmp_path):
    scene = parse_scene(SCENE, folder=tmp_path)
    with pytest.raises(InputError, match=r"dark\.tif"):
        load_no_load(scene)
    write_tiff(tmp_path / "dark.tif", np.zeros((1, ROWS, COLS), np.uint16))
    write_tiff(tmp_path / "bright.tif", np.zeros((1, 30, 30), np.uint16))
    with pytest.raises(InputError, match="roi"):
        load_no_load(scene)
    write_tiff(tmp_path / "bright.tif", np.full((1, ROWS, COLS), 4095, np.uint16))
    with pytest.raises(InputError, match="saturated all over"):
        load_no_load(scene)


def test_light_below_zero_is_not_valid_under_a_gamma():
    """A background was subtracted: what the tone curve made of it is not known."""
    image = np.tile(np.linspace(-0.1, 0.9, 21), (10, 1))
    image[:, 2] = 0.0
    bent = to_linear(image, bit_depth=None, gamma=2.2)
    assert not bent.valid[:, :2].any() and bent.valid[:, 2:].all() and (bent.image >= 0.0).all()
    plain = to_linear(image, bit_depth=None)
    assert plain.valid.all()  # of a linear camera it is light like any other
    np.testing.assert_allclose(plain.image[:, 0], -0.1, rtol=1e-6)


@pytest.mark.parametrize(("share", "valid"), [(0.04, False), (0.06, True)])
def test_a_contrast_of_a_twentieth_of_the_usual_is_the_least(share, valid):
    dark, bright = np.full((20, 30), 0.1), np.full((20, 30), 0.9)
    bright[:, :4] = 0.1 + share * 0.8
    found = normalise(*map(trusted, (0.5 * (dark + bright), dark, bright)))
    assert found.valid[:, 4:].all()
    assert found.valid[:, :4].all() == found.valid[:, :4].any() == valid


def test_the_usual_contrast_is_that_of_valid_pixels():
    """Off the specimen the no-load frames may show anything."""
    dark, bright = np.full((20, 30), 0.1), np.full((20, 30), 0.16)
    bright[:, :18] = 2.1  # more than half of the picture, not to be trusted
    valid = np.ones((20, 30), bool)
    valid[:, :18] = False
    light = Linear(np.full((20, 30), 0.12), valid)
    found = normalise(light, trusted(dark), trusted(bright))
    np.testing.assert_array_equal(found.valid, valid)


@pytest.mark.parametrize("level", [0.0, 1.0], ids=["dead", "hot"])
def test_an_odd_pixel_beside_pixels_without_a_number_is_found(level):
    """NaN beside it is neither as dark nor as bright as it: it does not make a pair of it."""
    rng = np.random.default_rng(1)
    image = (0.4 + 0.2 * np.sin(COL / 9.0) + 0.004 * rng.standard_normal(COL.shape)).astype("f4")
    for row, col in ((20, 30), (60, 90)):
        image[row, col] = 0.99 * level
        image[row, col + 1] = image[row + 1, col] = image[row - 1, col] = np.nan
    light = to_linear(image, bit_depth=None)
    wrong = np.isnan(image)
    wrong[[20, 60], [30, 90]] = True
    np.testing.assert_array_equal(light.valid, ~wrong)


def test_a_flaw_of_six_sigmas_is_noise_and_one_of_twelve_is_not():
    """Eight sigmas beyond the second of its neighbours: of 20 000 pixels none is by chance."""
    rng = np.random.default_rng(2)
    image = 0.5 + 0.01 * rng.uniform(-1.0, 1.0, COL.shape)  # a sigma of 0.0058, ends at 0.01
    image[30, 40], image[60, 80] = 0.51 + 6 * 0.0058, 0.51 + 12 * 0.0058
    found = find_outliers(image)
    assert found[60, 80] and found.sum() == 1


@pytest.mark.parametrize("excess", [1, 3])
def test_one_grey_level_is_no_flaw_in_a_computed_frame(excess):
    """Without noise, rounding alone decides: two levels at least."""
    image = np.full((20, 20), 100, np.uint8)
    image[10, 10] = 100 + excess
    assert find_outliers(image).any() == (excess > 2)


def test_a_pixel_that_one_of_several_no_load_frames_spoils_is_not_valid(tmp_path):
    rng = np.random.default_rng(3)
    frames = (100 + 2 * rng.standard_normal((3, 20, 30))).astype(np.uint8)
    frames[1, 4, 5] = 255  # saturated in the second alone
    write_tiff(tmp_path / "dark.tif", frames)
    text = '[specimen]\n[frames]\nno_load_dark = "dark.tif"\n'
    dark, bright = load_no_load(parse_scene(text, folder=tmp_path))
    assert bright is None and np.argwhere(~dark.valid).tolist() == [[4, 5]]
