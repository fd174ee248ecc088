"""One frame of few fringes in uneven light: no-load frames of any exposure, and none.
The frames are rendered here: sin² of a smooth field, a lamp of 1.7 : 1 with a bright bar."""

import numpy as np
import pytest
from plain_frames import seeds

from isochrome.fringes import find_no_load_exposure
from isochrome.processing import process_frame, says_a_half
from isochrome.scene import parse_scene

SHAPE = (96, 128)
NOISE, WHOLE = np.full(SHAPE, 1.0 / 255.0), np.ones(SHAPE, bool)
SCENE = "[specimen]\nshape = 'other'\nthickness_mm = 4.0\n[camera]\nbit_depth = 8\n"
ANY = ((1.0, 1.0, 1.0), (1.0, 0.385, 0.385), (0.385, 1.0, 1.0), (0.6, 1.0, 0.5))
"""Exposures of a frame and of its bright and its dark no-load frame."""


def places():
    return np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in SHAPE), indexing="ij")


def stored(signal, exposure, rng):
    z, x = places()
    lamp = 1.0 - 0.1 * (x**2 + z**2) + 0.7 * np.exp(-(((x + 0.4) / 0.25) ** 2))
    light = exposure * (0.75 * lamp / lamp.max() * signal + 0.04)
    grey = np.rint(255.0 * light + rng.normal(size=SHAPE))
    return np.clip(grey, 0, 255).astype(np.uint8)


def field(rng, lowest=0.2, highest=1.1):
    """A bent slope of the order from the lowest to the highest."""
    z, x = places()
    turn, (a, b, c) = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.3, 0.3, 3)
    bent = np.cos(turn) * x + np.sin(turn) * z + a * x * z + b * x * x + c * z * z
    return lowest + (highest - lowest) * (bent - bent.min()) / np.ptp(bent)


def shot(order, exposures, rng):
    """Frame of an order, and the bright and dark no-load frame."""
    signals = np.sin(np.pi * order) ** 2, np.ones(SHAPE), np.zeros(SHAPE)
    return [stored(s, e, rng) for s, e in zip(signals, exposures, strict=True)]


def drawn(seed, exposures, *, highest=1.1):
    """Order, frame, and the bright and dark no-load frame."""
    rng = np.random.default_rng(seed)
    order = field(rng, highest=highest)
    return order, *shot(order, exposures, rng)


def read(order, image, ends):
    """What `process` makes of it, with three points of known order."""
    points = []
    for value in (0.3, 0.7, 0.9):
        away = np.abs(order - value)
        away[:8], away[-8:], away[:, :8], away[:, -8:] = (np.inf,) * 4
        row, col = np.unravel_index(np.argmin(away), SHAPE)
        points.append({"row_px": int(row), "col_px": int(col), "order": float(order[row, col])})
    return processed(image, ends, points)


def processed(image, ends, points, more=None):
    """What `process` makes of a frame with its dark and bright no-load frame and known points."""
    light = dict(zip(("frames.no_load_dark", "frames.no_load_bright"), ends, strict=True))
    scene = parse_scene(SCENE).with_values({"frames.known_order": tuple(points)} | (more or {}))
    return process_frame(image, scene.with_values(light), 0).frame


def errors(found, order):
    """Errors of the pixels that are called known, and what is stated of them."""
    if found.reading is None:
        return np.zeros(0), np.zeros(0)
    known = np.isfinite(found.reading.order)
    return np.abs(found.reading.order - order)[known], found.reading.uncertainty[known]


def assert_not_silent(error, stated):
    assert np.sum((error > 0.05) & (error > 3.0 * stated)) <= 0.005 * len(error)


@pytest.mark.parametrize("exposures", ANY)
@pytest.mark.parametrize("seed", range(5))
def test_crests_and_troughs_tell_the_exposures(seed, exposures):
    _, image, bright, dark = (part / 255.0 for part in drawn(seed, exposures))
    own, of_bright, of_dark = exposures
    found = find_no_load_exposure(image, NOISE, WHOLE, dark=dark, bright=bright)
    assert found.told and abs(found.bright * of_bright / own - 1.0) < 0.02
    if of_bright == own == of_dark:
        assert found.ends is None and found.bright == found.dark == 1.0
    else:
        spread = np.sqrt(np.median(found.ends.variance[0, 0])) / np.median(dark)
        assert abs(found.dark - own / of_dark) < 3.0 * spread


def test_an_untold_background_leaves_out_what_it_might_turn_over():
    """The dark frame is exposed twice as long as taken: unsaid, the order turned back at 1."""
    order, image, bright, dark = drawn(67, (0.6, 1.0, 0.5))
    found = read(order, image, (dark, bright))
    left_out = [line for line in found.warnings if "no dark fringe tells" in line]
    assert len(left_out) == 1
    beyond = np.isfinite(found.reading.order) & (order > 1.0)
    assert not beyond.any()
    assert_not_silent(*errors(found, order))
    order, image, bright, dark = drawn(0, (1.0, 1.0, 1.0), highest=0.42)
    found = read(np.clip(order, 0.0, 0.42), image, (dark, bright))
    assert any(
        "do not tell whether it is exposed as its no-load frames" in w for w in found.warnings
    )


def ridge(exposures, known, *, top=0.35, more=None):
    """What `process` makes of an order that stays below 1/2, highest along a line, and the order.
    One known point, at the share `known` of the way up; `more`, further keys of the scene."""
    z, x = places()
    order = top - 0.15 * z**2 - 0.0015 * x**2
    image, bright, dark = shot(order, exposures, np.random.default_rng(7))
    wanted = order.min() + known * np.ptp(order)
    row = 10 + int(np.argmin(np.abs(order[10:-10, 64] - wanted)))
    point = {"row_px": row, "col_px": 64, "order": round(float(order[row, 64]), 2)}
    return processed(image, (dark, bright), [point], more), order


@pytest.mark.parametrize("exposures", ANY[:3])
def test_a_ridge_of_the_order_is_not_taken_for_a_crest(exposures):
    """Its light is all but even along it: it was N = 1/2 under .8 of the light, orders .28 off."""
    found, _ = ridge(exposures, 0.6)
    assert found.reading is None
    assert any("its brightest line has" in line for line in found.warnings)


def test_a_known_order_on_a_ridge_or_the_scene_says_that_all_are_exposed_alike():
    for known, more in ((1.0, None), (0.6, {"frames.no_load_exposure": "same"})):
        found, order = ridge(ANY[0], known, more=more)
        error, _ = errors(found, order)
        assert len(error) > 0.8 * order.size and np.sqrt(np.mean(error**2)) < 0.01
    assert not any("expos" in line for line in found.warnings)


def test_a_known_order_that_another_exposure_alone_explains_is_not_ignored():
    """A dome of the order has no line; at .385 of the light it was read as .2, which was said."""
    z, x = places()
    order = 0.4 - 0.15 * z**2 - 0.15 * x**2
    image, bright, dark = shot(order, ANY[2], np.random.default_rng(7))
    point = {"row_px": 48, "col_px": 64, "order": 0.4}
    found = processed(image, (dark, bright), [point])
    assert found.reading is None
    assert any("the known orders say that it is not" in line for line in found.warnings)


@pytest.mark.parametrize(
    ("orders", "said"),
    [
        ((), False), ((0.3,), False), ((0.52,), True), ((1.5,), True), ((1.0,), False),
        ((0.3, 0.7), True), ((0.44, 0.7), False), ((0.41, 0.58), False), ((0.6, 1.4), False),
        ((0.6, 1.7), True), ((0.0, 3.0), True),
    ],
)  # fmt: skip
def test_known_orders_say_that_a_half_is_between_them(orders, said):
    assert says_a_half([*orders]) is said


@pytest.mark.parametrize("longer", [1.5, 2.5])
def test_a_flat_top_of_the_order_below_a_crest_is_none(longer):
    """Its light is 4 % below a crest's, and changes along it as it does across."""
    z, x = places()
    signal = np.sin(np.pi * (0.44 - 0.25 * z**2 - 0.25 * (x / longer) ** 2)) ** 2
    bright, dark = np.full(SHAPE, 0.8), np.full(SHAPE, 0.01)
    image = dark + (bright - dark) * signal + np.random.default_rng(5).normal(0.0, 0.004, SHAPE)
    sigma, valid = np.full(SHAPE, 0.004), np.ones(SHAPE, bool)
    assert not find_no_load_exposure(image, sigma, valid, dark=dark, bright=bright).told


@pytest.mark.parametrize("lamp", [1.7, 4.0])
def test_a_lamps_bright_spot_does_not_move_the_exposure(lamp):
    """Smoothing the bright frame by 3 pixels takes 2 % off such a spot, and gave 2 % too much."""
    z, x = places()
    spot = 1.0 + (lamp - 1.0) * np.exp(-((x / 0.15) ** 2))
    signal = np.sin(np.pi * (0.5 + 0.4 * (x + 0.3 * z))) ** 2
    rng = np.random.default_rng(3)
    bright, image = (
        0.8 * part * spot / lamp + rng.normal(0.0, 1.0 / 255.0, SHAPE)
        for part in (np.ones(SHAPE), 0.7 * signal)
    )
    found = find_no_load_exposure(image, NOISE, WHOLE, dark=np.zeros(SHAPE), bright=bright)
    assert abs(found.bright / 0.7 - 1.0) < 0.006  # twice its systematic uncertainty


@pytest.mark.parametrize("seed", range(5))
def test_below_a_crest_nothing_is_made_of_the_exposure(seed):
    _, image, bright, dark = (part / 255.0 for part in drawn(seed, (0.7, 1.0, 1.0), highest=0.35))
    found = find_no_load_exposure(image, NOISE, WHOLE, dark=dark, bright=bright)
    assert not found.told and found.ends is None


def judge(seed, exposures):
    order, image, bright, dark = drawn(seed, exposures)
    found = read(order, image, (dark, bright))
    error, stated = errors(found, order)
    assert len(error) > 0.1 * order.size and np.sqrt(np.mean(error**2)) < 0.02
    assert_not_silent(error, stated)
    said = any("exposed" in line for line in found.warnings)
    assert said == (exposures != ANY[0])


@pytest.mark.parametrize("exposures", ANY)
def test_few_fringes_are_read_with_no_load_frames_of_any_exposure(exposures):
    judge(0, exposures)


@pytest.mark.parametrize("seed", [4, 88])
def test_a_flat_crest_of_a_small_frame_is_passed(seed):
    """The order goes on through 1/2 by .007 a pixel; small patches alone took it to turn back."""
    judge(seed, ANY[seed % len(ANY)])


@pytest.mark.study
@pytest.mark.parametrize("seed", range(100))
def test_few_fringes_of_many_fields_are_read_with_no_load_frames_of_any_exposure(seed):
    judge(seed, ANY[seed % len(ANY)])


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(100, 2))
def test_few_fringes_without_no_load_frames_are_not_silently_wrong(seed):
    order, image, *_ = drawn(seed, ANY[0])
    assert_not_silent(*errors(read(order, image, (None, None)), order))
