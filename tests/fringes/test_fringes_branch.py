"""The order on a model's branch, by itself: I = Ib + Ia sin^2(pi N) of closed forms, read back."""

import numpy as np
import pytest
from closed_forms import dark_field, disc, grey
from plain_frames import read_free

from isochrome.fringes import SURE, read_order
from isochrome.optics import FringeWave

SHAPE = (160, 200)
ROWS, COLS = np.indices(SHAPE, dtype=float)
NOISE = 3.0
SIGMA = float(np.sqrt(NOISE**2 + 1.0 / 12.0) / 255.0)
"""Noise and rounding, of full scale."""
BACKGROUND, AMPLITUDE = 0.05, 0.8


def captured(order, *, added=0.0, seed=0):
    """A frame of an order, with light added to it."""
    light = dark_field(np.nan_to_num(order), background=BACKGROUND, amplitude=AMPLITUDE)
    return grey(light + added, NOISE, np.random.default_rng([seed, 17]))


def read(light, model, **changed):
    """The reading of a frame on a model's branch."""
    given = {
        "illumination": np.full(SHAPE, AMPLITUDE), "background": np.full(SHAPE, BACKGROUND),
        "sigma": np.full(SHAPE, SIGMA), "valid": np.isfinite(model),
    }  # fmt: skip
    wave = FringeWave(0.5, -0.5, None, 2.0 * np.pi * np.nan_to_num(model))
    return read_order(light, model, wave, **(given | changed))


def ramp(slope):
    """An order that grows by `slope` fringes a pixel, slantwise."""
    return 1.0 + slope * (0.8 * COLS + 0.6 * ROWS)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def pulls(got, order, place=True):
    """Errors over their uncertainties, of the pixels that are known."""
    ratio = (got.order - order) / got.uncertainty
    return ratio[np.isfinite(ratio) & place]


@pytest.mark.parametrize("slope", [0.02, 0.1, 0.22])
@pytest.mark.parametrize("off", [0.0, 0.15])
def test_a_model_that_is_off_by_less_than_a_branch_is_read_right(slope, off):
    order = ramp(slope)
    got = read(captured(order), order + off)
    assert np.isfinite(got.order).mean() > 0.99 and got.kept > 0.99
    # noise alone leaves 0.0012; where both are large 0.005, on the crests of wide fringes
    assert rms((got.order - order)[np.isfinite(got.order)]) < 0.01
    # 32 000 pixels of 18 that share their noise: 0.98 to 1.03, 0.76 where both are large
    assert 0.75 < rms(pulls(got, order)) < 1.1


@pytest.mark.parametrize("off", [0.3, 0.45])
@pytest.mark.parametrize("slope", [0.05, 0.1, 0.22])
def test_a_model_that_is_off_by_more_than_a_branch_gives_nothing(slope, off):
    """The light's nearest answer is then another fringe's, or the same one's mirror image."""
    got = read(captured(ramp(slope)), ramp(slope) + off)
    assert not np.isfinite(got.order).any() and got.kept == 0.0 and not got.confidence.any()


@pytest.mark.parametrize("slope", [0.27, 0.3])
def test_fringes_finer_than_four_pixels_are_not_kept(slope):
    got = read(captured(ramp(slope)), ramp(slope))
    assert not np.isfinite(got.order).any()


def test_fringes_that_grow_finer_are_kept_until_four_pixels():
    order = 0.0007 * COLS**2  # 0.25 fringe a pixel at column 178
    known = np.isfinite(read(captured(order), order).order)
    assert known[:, 30:170].all() and not known[:, 182:].any()


def test_masked_pixels_and_what_is_no_specimen_are_not_known():
    order, valid = ramp(0.04), np.ones(SHAPE, bool)
    order[:, :30] = np.nan
    valid[60:80, 90:120] = False
    light = captured(order)
    light[~valid] = 9.0  # what is masked is not looked at
    got = read(light, order, valid=valid)
    assert not np.isfinite(got.order[:, :30]).any() and not np.isfinite(got.order[~valid]).any()
    far = np.isfinite(order) & valid
    assert np.nanmax(np.abs(got.order - order)[far]) < SURE
    # of the specimen, masked pixels among it; beside the mask half of a window is wanted
    assert got.kept == pytest.approx(np.isfinite(got.order).sum() / np.isfinite(order).sum())
    assert (got.confidence[~np.isfinite(got.order)] == 0.0).all()


def test_a_pixel_alone_among_masked_ones_is_not_known():
    valid = np.zeros(SHAPE, bool)
    valid[::6, ::6] = True
    order = ramp(0.04)
    assert not np.isfinite(read(captured(order), order, valid=valid).order).any()
    # A model that says nearly nothing: the light may ask for less, and an order has no sign
    order = np.full(SHAPE, 0.02) + 1e-4 * COLS
    got = read(captured(order), order)
    assert np.isfinite(got.order).any() and np.nanmin(got.order) >= 0.0


def test_confidence_is_the_probability_to_be_right_to_a_twentieth():
    """On the crests of wide fringes under much noise: not all are sure."""
    order = ramp(0.012)
    rng = np.random.default_rng(4)
    light = dark_field(order) + 0.09 * rng.standard_normal(SHAPE)
    got = read(light, order, sigma=np.full(SHAPE, 0.09))
    known = np.isfinite(got.order)
    right = np.abs(got.order - order)[known] < SURE
    # normal errors of 0.03 at most: erf(0.05/(0.03 sqrt 2)) = 0.904
    assert got.confidence[known].min() == pytest.approx(0.904, abs=0.01)
    assert right.mean() == pytest.approx(got.confidence[known].mean(), abs=0.02)


# Light that neither the model nor the no-load frames hold

SPECIMENS = {
    "disc": np.abs(disc(SHAPE, 78.0, 3.0)), "beam": np.abs(ROWS - 75.3) / 20.0, "ramp": ramp(0.09),
}  # fmt: skip
PLACES = ((50, 70), (85, 110))


def glare(place, width_px, size):
    """A round spot of light, `size` of full scale in its middle."""
    away = (ROWS - place[0]) ** 2 + (COLS - place[1]) ** 2
    return size * np.exp(-away / (2.0 * width_px**2))


def beside_glares(reader, order, width_px, size):
    """Pulls of what is known within the spots, and what share of it."""
    ratios, seen = [], 0
    for place in PLACES:
        added = glare(place, width_px, size)
        near = (added > 0.3 * size) & np.isfinite(order)
        ratios.append(pulls(reader(captured(order, added=added, seed=1)), order, near))
        seen += np.count_nonzero(near)
    ratios = np.concatenate(ratios)
    return ratios, ratios.size / seen


@pytest.mark.parametrize("size", [0.02, 0.04, 0.09])
@pytest.mark.parametrize("name", SPECIMENS)
def test_beside_a_glare_the_error_is_covered(name, size):
    """A fringe's flank takes added light for order, and only crests tell; pulls were 5 to 17."""
    order = SPECIMENS[name]
    ratios, share = beside_glares(lambda light: read(light, order), order, 12.0, size)
    assert rms(ratios) < 1.3 and np.mean(np.abs(ratios) < 3.0) > 0.98
    # neither by knowing nothing, nor by uncertainties that cover anything
    assert share > 0.5 and rms(ratios) > 0.7


@pytest.mark.parametrize("size", [0.04, 0.09])
def test_between_crests_a_small_glare_is_a_bump_that_is_doubted(size):
    """90 pixels a fringe: no crest is within a spot's reach, and pulls were 10 and 24."""
    order = (ROWS + 30.0) / 90.0
    ratios, share = beside_glares(lambda light: read(light, order), order, 6.0, size)
    # 1.3 and 1.5 of two places; what is wider than its surroundings show is covered less
    assert rms(ratios) < 2.5 and share > 0.3


def test_a_model_that_is_off_is_no_glare():
    """Off by 3 %, 0.07 fringe at most: that is followed, and doubted little."""
    order = SPECIMENS["disc"]
    light = captured(order)
    right, off = read(light, order), read(light, 1.03 * order)
    assert 0.5 < rms(pulls(off, order)) < 1.2
    ratio = np.nanmedian(off.uncertainty) / np.nanmedian(right.uncertainty)
    assert ratio < 3.0 and off.kept > 0.95 * right.kept


@pytest.mark.long
@pytest.mark.parametrize("size", [0.02, 0.04])
@pytest.mark.parametrize("name", ["beam", "ramp"])
def test_without_a_model_a_glare_is_covered_too(name, size):
    order = SPECIMENS[name]
    row, col = np.unravel_index(np.abs(order - 1.25).argmin(), SHAPE)

    def free(light):
        wave = 1.0 - 2.0 * (light - BACKGROUND) / AMPLITUDE
        sigma = np.full(SHAPE, 2.0 * SIGMA / AMPLITUDE)
        known = [(int(row), int(col), float(order[row, col]))]
        return read_free(wave, sigma, np.ones(SHAPE, bool), known).reading

    ratios, share = beside_glares(free, order, 12.0, size)
    assert rms(ratios) < 1.5 and share > 0.5


def test_light_that_is_not_the_models_is_not_known():
    """A sheet before a part of the specimen: its light is even, and no order explains it."""
    order = ramp(0.09)
    light = captured(order)
    light[60:100, 80:130] = 0.4
    got = read(light, order)
    assert not np.isfinite(got.order[66:94, 86:124]).any()
    assert np.isfinite(got.order[:50]).mean() > 0.999  # all but the corners


def test_the_order_is_as_uncertain_as_the_light_scatters_not_as_was_stated():
    order = ramp(0.09)
    got = read(captured(order), order, sigma=np.full(SHAPE, 0.5 * SIGMA))
    assert 0.85 < rms(pulls(got, order)) < 1.15


def test_where_no_crest_is_in_sight_the_order_is_read_all_the_same():
    """2000 pixels a fringe, from 0.28 to 0.42: no window tells a glare, and none is made up."""
    order = 0.28 + 0.0005 * COLS + 0.00025 * ROWS
    got = read(captured(order), order)
    assert got.kept > 0.99 and 0.8 < rms(pulls(got, order)) < 1.1
