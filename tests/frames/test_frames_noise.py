"""The noise of a rendered camera is found again, whatever the fringes."""

import cv2
import numpy as np
import pytest

from isochrome.errors import InputError
from isochrome.frames import NoiseModel, estimate_noise, noise_between_pixels

SHAPE = (240, 320)


def fringes(seed, *, finest=0.1, gamma=1.0, vignette=0.3, full=255, shape=SHAPE):
    """Ideal raw grey levels of a fringe frame, its finest gradient `finest` fringes a pixel."""
    rng = np.random.default_rng(seed)
    row, col = np.mgrid[: shape[0], : shape[1]].astype(float)
    x, z = col - shape[1] * rng.uniform(0.3, 0.7), row - shape[0] * rng.uniform(-0.1, 0.5)
    angle = rng.uniform(0, np.pi)
    order = 4 / (1 + (x * x + z * z) / 70**2) + 0.01 * (x * np.cos(angle) + z * np.sin(angle))
    order *= finest / np.hypot(*np.gradient(order)).max()
    radius = (col / shape[1] - 0.5) ** 2 + (row / shape[0] - 0.5) ** 2
    light = (0.05 + 0.85 * np.sin(np.pi * order) ** 2) * (1 - 2 * vignette * radius)
    return full * light ** (1 / gamma)


def captured(ideal, sigma, seed, full=255):
    noisy = ideal + sigma * np.random.default_rng(seed).standard_normal(ideal.shape)
    return np.clip(np.round(noisy), 0, full).astype(np.uint8 if full < 256 else np.uint16)


@pytest.mark.parametrize("gamma", [1.0, 2.2])
@pytest.mark.parametrize("sigma", [0.3, 1.0, 3.0, 15.0])
def test_sigma_is_found_within_three_percent_under_fringes(sigma, gamma):
    truth = np.hypot(sigma, np.sqrt(1 / 12))  # rounding adds its own variance
    for seed in range(5):
        ideal = fringes(seed, gamma=gamma)
        model = estimate_noise(captured(ideal, sigma, seed))
        inside = (ideal > 4 * sigma) & (ideal < 255 - 4 * sigma)
        found = np.sqrt(np.mean(model.sigma(ideal[inside]) ** 2))
        # 77 000 pixels, residuals correlated over 5 x 5: 0.8 % statistics; measured at most 1.3 %
        # with fringes of 0.1 a pixel; 3 % leaves chi trustworthy to 3 %.
        assert found == pytest.approx(truth, rel=0.03)


def test_hot_pixels_and_an_edge_hardly_matter():
    ideal = fringes(1, finest=0.2, gamma=2.2)
    found = np.median(estimate_noise(captured(ideal, 3.0, 1)).sigma(ideal))
    # The leak of the fringe through the filter, 5 % here, is the reason for the tolerance.
    assert found == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.1)
    ideal = fringes(3)
    ideal[:, 200:] = 20.0
    image = captured(ideal, 3.0, 3)
    rng = np.random.default_rng(0)
    image[rng.integers(0, SHAPE[0], 30), rng.integers(0, SHAPE[1], 30)] = 255
    found = np.median(estimate_noise(image).sigma(ideal))
    # Clipped at 4 sigma; what remains of 30 spots with 25 pixels each is below 1 %.
    assert found == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.05)


def test_shot_noise_is_found_at_every_level():
    full, ideal = 4095, fringes(2, full=4095)
    sigma = np.sqrt(25 + 0.5 * ideal)
    model = estimate_noise(captured(ideal, sigma, 2, full), bit_depth=12)
    levels = np.array([400.0, 1500.0, 3000.0])
    # Slope and offset share 77 000 pixels over 16 levels: 3 % a level, twice that allowed.
    np.testing.assert_allclose(model.sigma(levels), np.sqrt(25 + 0.5 * levels), rtol=0.06)


def test_what_lies_beside_a_pixel_counts_by_the_mask_too():
    image = captured(fringes(4), 3.0, 4)
    valid = np.ones(SHAPE, bool)
    valid[:, 100:220] = False
    image[:, 100:220] = np.random.default_rng(0).integers(0, 255, (SHAPE[0], 120))
    found = np.median(estimate_noise(image, valid).sigma(image[valid]))
    assert found == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.03)
    # strips of ten columns, every other one textured: residuals reach two pixels to each side
    image = captured(fringes(4, finest=0.05), 3.0, 4)
    valid = np.ones(SHAPE, bool)
    valid[:, np.arange(SHAPE[1]) % 20 >= 10] = False
    image[~valid] = np.random.default_rng(0).integers(0, 255, np.count_nonzero(~valid))
    found = np.median(estimate_noise(image, valid).sigma(image[valid]))
    # six columns of twenty are left, of which a level's variance is known to 3 %
    assert found == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.05)


def test_linear_sigma_follows_gamma_as_measured_over_many_frames():
    raw, gamma = np.full((200, 200), 120.0), 2.2
    image = captured(raw, 3.0, 5)
    predicted = estimate_noise(image).linear_sigma(120.0, bit_depth=8, gamma=gamma)
    measured = np.std((image / 255) ** gamma)
    # 40 000 samples each way, and a second order of (3 / 120)^2: 3 % covers both.
    assert float(predicted) == pytest.approx(measured, rel=0.03)


def test_noise_free_frame_keeps_the_floor_of_rounding():
    model = estimate_noise(np.full((32, 32), 7, np.uint8))
    assert float(model.sigma(7)) == pytest.approx(np.sqrt(1 / 12))


@pytest.mark.parametrize("image", [np.zeros((4, 40), np.uint8), np.full((20, 20), np.nan)])
def test_frame_too_small_or_empty_is_refused(image):
    with pytest.raises(InputError, match="noise"):
        estimate_noise(image)


def mostly_at_an_end(seed, share, end):
    """Fringes in the left columns, and `share` of the picture at black or white with its noise."""
    rng = np.random.default_rng(seed)
    col = np.arange(200) + np.zeros((160, 1))
    lit = col < 200 * (1 - share)
    ideal = np.where(lit, 120 - 60 * np.cos(2 * np.pi * 0.05 * col), end)
    image = np.clip(np.round(ideal + 3.0 * rng.standard_normal(ideal.shape)), 0, 255)
    return image.astype(np.uint8), lit


@pytest.mark.parametrize("end", [0, 255], ids=["black", "white"])
@pytest.mark.parametrize("share", [0.6, 0.7, 0.85])
def test_noise_of_a_frame_that_is_mostly_black_or_white_is_that_of_its_lit_part(share, end):
    """Clipping hides noise: what lies at an end of the scale is left out."""
    images = [mostly_at_an_end(seed, share, end) for seed in range(4)]
    found = [np.mean(estimate_noise(image).sigma(image[lit]) ** 2) for image, lit in images]
    # 15 % of 32 000 pixels, in residuals that share 25 each: 4 % a frame, 2 % of four; thrice that
    assert np.sqrt(np.mean(found)) == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.06)
    # and so at either end of the lit levels, where a line is less certain: 2 to 8 % by share and
    # seed; a line that goes through the clipped noise is 12 to 18 % off
    ends = np.mean([estimate_noise(image).sigma([70.0, 170.0]) for image, _ in images], axis=0)
    assert ends == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.11)


@pytest.mark.parametrize("gamma", [1.0, 1.4, 2.2])
def test_light_at_black_has_an_uncertainty_under_any_gamma(gamma):
    """The slope of light against grey level is zero there, and one sigma above it is not."""
    model = NoiseModel(offset=9.0, slope=0.0, floor=1 / 12)
    at_black = float(model.linear_sigma(0.0, bit_depth=8, gamma=gamma))
    # by hand: gamma u^(gamma-1) u at u = 3/255
    assert at_black == pytest.approx(gamma * (3 / 255) ** gamma, rel=1e-12) and at_black > 0.0
    levels = model.linear_sigma(np.arange(256.0), bit_depth=8, gamma=gamma)
    assert (np.diff(levels) >= 0.0).all()  # nowhere less than at black


def test_a_slope_that_falls_below_the_rounding_is_held_at_it():
    """A line through few levels may turn negative at black; rounding is always there."""
    model = NoiseModel(offset=-2.0, slope=0.1, floor=1 / 12)
    np.testing.assert_allclose(model.sigma([0.0, 10.0, 60.0]), np.sqrt([1 / 12, 1 / 12, 4.0]))


def test_levels_up_to_which_clipping_reaches_are_those_of_the_sensor():
    """Ten bits in a file of sixteen: white is 1023, and not 65535."""
    rng = np.random.default_rng(2)
    col = np.arange(200) + np.zeros((160, 1))
    ideal = np.where(col < 80, 500 - 300 * np.cos(2 * np.pi * 0.05 * col), 1023.0)
    image = np.clip(np.round(ideal + 12.0 * rng.standard_normal(ideal.shape)), 0, 1023)
    model = estimate_noise(image.astype(np.uint16), bit_depth=10)
    # 3 % at either end of the lit levels by the count of pixels, see above; thrice that
    assert model.sigma([250.0, 750.0]) == pytest.approx([12.0, 12.0], rel=0.09)


@pytest.mark.parametrize("quality", [80, 85, 90])
@pytest.mark.parametrize("sigma", [4.0, 7.0])
def test_the_noise_that_a_lossy_file_keeps_between_pixels_is_found(sigma, quality):
    """JPEG drops the finest part: neighbours show a quarter of it at worst, squares most of it."""
    for seed in range(3):
        raw = captured(fringes(seed), sigma, seed)
        image = cv2.imdecode(
            cv2.imencode(".jpg", raw, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_UNCHANGED
        )
        model, valid = estimate_noise(image), np.ones(image.shape, dtype=bool)
        left = float(np.std(image - fringes(seed)))  # what the file kept of it, and its own steps
        found = noise_between_pixels(image, valid, model) * float(model.sigma(np.median(image)))
        # the quietest tenth of the squares speaks: it is not louder than the frame
        assert 0.75 * left < found < 1.2 * left


@pytest.mark.parametrize(("finest", "most"), [(0.05, 1.03), (0.2, 1.1)])
def test_of_white_noise_squares_show_no_more_than_neighbours(finest, most):
    """Nor do fringes: a tenth of the squares is as smooth as their polynomial."""
    for seed in range(3):
        raw = captured(fringes(seed, finest=finest), 3.0, seed)
        valid = np.ones(raw.shape, dtype=bool)
        # a decile of 800 squares of 154 degrees of freedom: .4 %, and the model's own 1 %; of
        # fringes of 5 pixels all over a frame, a quartic of 13 leaves some
        assert noise_between_pixels(raw, valid, estimate_noise(raw)) < most


def test_too_few_whole_squares_tell_no_noise_between_pixels():
    raw = captured(fringes(1), 3.0, 1)
    valid = np.zeros(raw.shape, dtype=bool)
    valid[:, 100:112] = True  # a strip that no square fits in
    assert noise_between_pixels(raw, valid, estimate_noise(raw)) == 1.0
    strip = raw[:12]  # lower than a square
    assert noise_between_pixels(strip, np.ones(strip.shape, bool), estimate_noise(strip)) == 1.0
