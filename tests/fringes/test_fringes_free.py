"""One frame read without a model: against rendered specimens whose fringe order is known."""

from functools import lru_cache

import numpy as np
import pytest
from plain_frames import read_free

from isochrome.errors import InputError
from isochrome.fringes import SURE, FreeReading, OrderReading
from isochrome.fringes.single_frame.patches import Patches, binned, label_patches
from specimens import NAMES, Light, View, known_point, light_of, random_scene, shoot, view

RMS, MEDIAN, KEPT = 0.01, 0.002, 0.90
"""What a reading with no-load frames promises: fringes, fringes, share of the specimen."""
BLIND_RMS, BLIND_WRONG, BLIND_KEPT = 0.05, 0.005, 0.70
WRONG = 0.5
SCENES = 10

CUT = np.s_[100:260, 200:420]
"""A part of the contact's frame, where a test needs no whole one."""


def reading(
    name: str, ends: str = "both", said: float | str | None = None, **shot: float
) -> tuple[View, Light, FreeReading]:
    """A specimen, or the random scene of a number, as its frame and one known point tell it."""
    return _read(name, ends, said, tuple(sorted(shot.items())))


@lru_cache(maxsize=64)  # by one order of its arguments, whichever of them a test leaves out
def _read(
    name: str, ends: str, said: float | str | None, changes: tuple[tuple[str, float], ...]
) -> tuple[View, Light, FreeReading]:
    shot = dict(changes)
    seen, own = random_scene(int(name)) if name.isdigit() else (view(name), {})
    own = own | {"seed": int(name)} if name.isdigit() else own
    light = light_of(shoot(seen, **own, **shot), ends=ends, gamma=said)
    known = [known_point(seen, light.valid)]
    return seen, light, read_free(light.wave, light.wave_sigma, light.valid, known)


def errors(seen: View, got: OrderReading) -> np.ndarray:
    """|error| of what was kept of the specimen, fringes."""
    error = np.abs(got.order - seen.order)[seen.material]
    return error[np.isfinite(error)]


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def holds_the_promises(seen: View, got: FreeReading, *, kept: float) -> None:
    error = errors(seen, got.reading)
    assert error.size >= kept * np.count_nonzero(seen.material)
    assert np.count_nonzero(error > WRONG) == 0 and rms(error) <= RMS and np.median(error) <= MEDIAN


QUICK = ("hole",)
"""Specimens that every run reads; the others are for the long one."""


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.study)
        for name in (*NAMES, "disc 6", "beam 10")
    ],
)
def test_with_no_load_frames_the_order_is_right_and_nearly_all_is_kept(name):
    seen, _, got = reading(name)
    assert not got.misses
    holds_the_promises(seen, got, kept=KEPT)


POOR = {
    "glare": {"glare": 0.09}, "blur": {"blur": 2.0}, "gamma": {"gamma": 2.2},
    "noise": {"noise": 10.0}, "saturated": {"saturated": 0.09},
}  # fmt: skip


@pytest.mark.study
@pytest.mark.parametrize(
    ("name", "ends", "poor"),
    [
        # each with a contact and with a specimen whose fringes close
        ("contact", "both", "glare"),
        ("hole", "both", "glare"),
        ("worn contact, mu 0.3", "both", "blur"),
        ("disc", "both", "blur"),
        ("contact", "both", "gamma"),
        ("beam", "both", "gamma"),
        ("hole", "none", "blur"),
        ("worn contact, mu 0.3", "none", "gamma"),
        ("disc", "none", "gamma"),
        *((name, "none", "noise") for name in ("contact", "worn contact, mu 0.3", "disc", "beam")),
        *((name, "none", "saturated") for name in ("contact", "disc")),
        *((name, "none", "blur") for name in ("contact", "worn contact, mu 0.3", "disc", "beam")),
    ],
)
def test_a_poor_frame_shrinks_the_mask_and_not_the_promises(name, ends, poor):
    seen, light, got = reading(name, ends, **POOR[poor])
    error = errors(seen, got.reading)
    assert light.settled
    # a frame blurred by two pixels without no-load frames keeps 0.18 of the plate with a hole
    assert error.size > 0.1 * np.count_nonzero(seen.material)
    worst = RMS if ends == "both" else BLIND_RMS
    assert rms(error) <= worst
    assert np.mean(error > WRONG) <= (0.0 if ends == "both" else BLIND_WRONG)


@pytest.mark.study
@pytest.mark.parametrize(
    ("ends", "most", "wrong"), [("both", RMS, 0.0), ("none", BLIND_RMS, BLIND_WRONG)]
)
def test_of_ten_random_scenes_all_are_read_and_none_has_a_failure_that_is_not_masked(
    ends, most, wrong
):
    """One of twenty may fail: of ten, not one of these."""
    for seed in range(SCENES):
        seen, light, got = reading(str(seed), ends)
        error = errors(seen, got.reading)
        assert light.settled
        assert rms(error) <= most and np.mean(error > WRONG) <= wrong, seed
        # masking everything would pass the line above
        assert error.size >= BLIND_KEPT * np.count_nonzero(seen.material), seed


@pytest.mark.study
@pytest.mark.parametrize("ends", ["both", "none"])
def test_of_the_pixels_said_to_be_sure_at_least_as_many_are_right(ends):
    """Pooled over specimens, noises and random scenes; a whole specimen may not be sure and off."""
    pools = [reading(name, ends) for name in (*NAMES, *map(str, range(SCENES)))]
    pools += [reading(name, ends, noise=10.0) for name in NAMES]
    said, right = [], []
    for seen, light, got in pools:
        if light.settled:
            kept = np.isfinite(got.reading.order) & seen.material
            said.append(got.reading.confidence[kept])
            right.append(np.abs(got.reading.order - seen.order)[kept] <= SURE)
    shares = [float(r[c >= 0.95].mean()) for c, r in zip(said, right, strict=True)]
    said, right = np.concatenate(said), np.concatenate(right)
    assert np.mean(said >= 0.95) > 0.8  # and few pixels are called sure would pass as well
    assert right[said >= 0.95].mean() >= 0.95 and min(shares) >= 0.90
    # the less sure ones: right at least as often as is said, on average
    less = said < 0.95
    assert right[less].mean() >= said[less].mean()


@pytest.mark.long
def test_errors_are_as_large_as_their_uncertainties_say():
    seen, _, got = reading("contact, mu 0.3")
    ratio = (got.reading.order - seen.order) / got.reading.uncertainty
    spread = np.nanmedian(np.abs(ratio)) / 0.6745  # a normal deviate's median is 0.6745
    assert 0.5 < spread < 1.2  # on the safe side by 2 at most


@pytest.mark.long
def test_orders_beyond_ten_are_read_where_the_pixels_allow():
    seen, _, got = reading("beam 12")
    high = seen.material & (seen.order > 10.5)
    error = np.abs(got.reading.order - seen.order)[high]
    assert np.isfinite(error).mean() > 0.9 and np.nanmax(error) < SURE


@pytest.mark.study
def test_beside_isotropic_points_the_order_is_right_or_masked():
    """Where a bulk pressure makes up for the contact's stress; N is a cone there."""
    seen, _, got = reading("contact, bulk")
    deep = seen.material & (np.arange(seen.order.shape[0]) > 60)[:, None]
    low = deep & (seen.order < 0.1)
    assert np.count_nonzero(low) > 200  # a cone's tip is in view, below the contact's edges
    error = np.abs(got.reading.order - seen.order)[low]
    assert np.isfinite(error).any() and np.nanmax(error) < SURE


@pytest.mark.long
def test_without_a_known_point_inside_the_frame_or_of_noise_nothing_is_known():
    _, light, _ = reading("contact, mu 0.3")
    got = read_free(light.wave[CUT], light.wave_sigma[CUT], light.valid[CUT], [])
    assert not np.isfinite(got.reading.order).any()
    assert got.reading.kept == 0.0 and not got.reading.confidence.any()
    frame, _, (_, _, order) = part(80, 30)
    got = read_free(*frame, [(900, 900, order)])
    assert got.misses == ((900, 900, order),) and not np.isfinite(got.reading.order).any()
    wave = np.random.default_rng(4).normal(size=(160, 220))
    got = read_free(wave, np.full(wave.shape, 0.03), np.ones(wave.shape, bool), [(50, 50, 0.25)])
    assert not np.isfinite(got.reading.order).any()


def part(row: int, col: int) -> tuple[tuple[np.ndarray, ...], np.ndarray, tuple]:
    """The cut of the contact's frame, its true order, and a known point in it."""
    seen, light, _ = reading("contact, mu 0.3")
    order = seen.order[CUT]
    frame = (light.wave[CUT].copy(), light.wave_sigma[CUT], light.valid[CUT].copy())
    return frame, order, (row, col, float(order[row, col]))


@pytest.mark.long
def test_any_true_point_gives_the_same_orders():
    frame, _, first = part(80, 30)
    _, _, second = part(120, 180)
    one, two, both = (
        read_free(*frame, known).reading.order for known in ([first], [second], [first, second])
    )
    assert np.isfinite(one).mean() > KEPT
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, both)


@pytest.mark.long
def test_a_roughly_counted_point_does_as_well_and_moves_nothing():
    frame, _, (row, col, order) = part(80, 30)
    exact = read_free(*frame, [(row, col, order)])
    rough = read_free(*frame, [(row, col, order + 0.08)])
    np.testing.assert_array_equal(exact.reading.order, rough.reading.order)


@pytest.mark.long
def test_two_known_points_that_contradict_each_other_are_told():
    frame, _, (row, col, order) = part(80, 30)
    wrong = (row, col, order + 0.4)  # on no branch of the light there
    got = read_free(*frame, [wrong])
    assert got.misses == (wrong,) and not np.isfinite(got.reading.order).any()
    other = part(120, 180)[2]
    shifted = (other[0], other[1], other[2] + 1.0)
    got = read_free(*frame, [(row, col, order), shifted])
    assert got.misses and not np.isfinite(got.reading.order).any()


@pytest.mark.long
def test_of_two_separate_parts_only_the_one_with_a_known_point_is_known():
    (wave, sigma, valid), order, left = part(80, 30)
    valid[:, 100:112] = False
    got = read_free(wave, sigma, valid, [left])
    known = np.isfinite(got.reading.order)
    assert known[:, :100].mean() > KEPT and not known[:, 100:].any()
    right = part(120, 180)[2]
    both = read_free(wave, sigma, valid, [left, right]).reading.order
    assert np.isfinite(both[:, 112:]).mean() > KEPT and np.nanmax(np.abs(both - order)) < SURE


@pytest.mark.long
def test_pixels_that_hold_no_number_are_masked_and_harm_none_beside_them():
    (wave, sigma, valid), order, point = part(80, 30)
    whole_frame = read_free(wave, sigma, valid, [point]).reading.order
    valid[30:34, 40:45] = False
    wave[30:34, 40:45] = np.nan
    got = read_free(wave, sigma, valid, [point]).reading.order
    assert not np.isfinite(got[30:34, 40:45]).any() and np.nanmax(np.abs(got - order)) < SURE
    far = np.s_[60:, 80:]
    np.testing.assert_allclose(got[far], whole_frame[far], atol=1e-3)  # well within the noise


@pytest.mark.parametrize(
    ("level", "known"),
    # at 0 the order would be 1/4 from the next whole or half one: any point lies on a branch
    [(1.0, []), (0.0, []), (1.3, []), (1.0, [(50, 50, 0.4)]), (1.3, [(50, 50, 0.4)])],
    ids=["dark", "middling", "beyond the ends", "dark, a point", "beyond the ends, a point"],
)
def test_a_constant_frame_tells_nothing(level, known):
    rng = np.random.default_rng(3)
    sigma = np.full((160, 220), 0.03)
    noise = sigma * rng.normal(size=sigma.shape)
    for wave in (np.full_like(sigma, level), level + noise):
        got = read_free(wave, sigma, np.ones(sigma.shape, bool), known)
        assert not np.isfinite(got.reading.order).any() and got.misses == tuple(known)


@pytest.mark.long
def test_a_frame_of_which_nothing_is_trusted_is_all_masked():
    (wave, sigma, valid), _, point = part(80, 30)
    got = read_free(wave, sigma, np.zeros_like(valid), [point])
    assert not np.isfinite(got.reading.order).any() and got.misses == (point,)


@pytest.mark.parametrize("shape", [(1, 1), (5, 40), (40, 12)])
def test_a_frame_smaller_than_a_patch_is_refused_with_its_size(shape):
    wave = np.zeros(shape)
    with pytest.raises(InputError, match=f"{shape[0]} x {shape[1]}"):
        read_free(wave, wave + 0.03, np.ones(shape, bool), [(0, 0, 0.25)])


def small_frame(shape):
    """A slanted order in a small frame, as the light shows it to a reading with one known point."""
    rows, cols = np.indices(shape)
    order = 0.2 + 0.02 * cols + 0.01 * rows
    sigma = np.full(shape, 0.03)
    wave = np.cos(2.0 * np.pi * order) + sigma * np.random.default_rng(5).normal(size=shape)
    return order, read_free(wave, sigma, np.ones(shape, bool), [(0, 0, 0.2)])


@pytest.mark.parametrize(("shape", "kept"), [((24, 24), 0.5), ((40, 30), 0.6), ((60, 60), 0.8)])
def test_a_small_frame_is_read(shape, kept):
    """Goes wrong: a binned frame that is smaller than a patch."""
    order, got = small_frame(shape)
    error = np.abs(got.reading.order - order)
    assert np.isfinite(error).mean() > kept and not got.misses and np.nanmax(error) < SURE


@pytest.mark.parametrize("shape", [(13, 13), (20, 14)])
def test_a_frame_of_fewer_patches_than_a_part_needs_is_a_miss(shape):
    _, got = small_frame(shape)
    assert got.reading.order.shape == shape
    assert not np.isfinite(got.reading.order).any() and got.misses == ((0, 0, 0.2),)


def a_lattice(slope, chi):
    """Patches of an order that rises along the columns: its slope from column to column (16,)."""
    places = 6 + 5 * np.arange(16)
    ones = np.ones((16, 16))
    terms = np.zeros((16, 16, 6))
    terms[..., 0], terms[..., 1] = np.cumsum(5.0 * slope), slope
    spread = np.broadcast_to([1e-3, 1e-4, 1e-4, 1e-5, 1e-5, 1e-5], terms.shape)
    return Patches(
        rows=places, cols=places, terms=terms, spread=spread, chi=chi, filled=ones, contrast=ones,
        body=np.ones((16, 16), dtype=int),
    )  # fmt: skip


def test_a_patch_that_its_quadratic_does_not_describe_is_left_out():
    chi = np.ones((16, 16))
    chi[5:9, 5:9] = 2.0
    part = label_patches(a_lattice(np.full(16, 0.02), chi)).part
    assert (part[chi > 1.0] == -1).all() and (part[chi == 1.0] == 0).all()


def test_neighbours_whose_slopes_disagree_are_not_joined():
    """The slope leaps from 0.02 to 0.1 fringe a pixel, eighty times what it is known to."""
    slope = np.where(np.arange(16) < 8, 0.02, 0.1)
    part = label_patches(a_lattice(slope, np.ones((16, 16)))).part
    left, right = set(part[:, :8].ravel()), set(part[:, 8:].ravel())
    assert len(left) == len(right) == 1 and left | right == {0, 1}


def test_a_bin_that_holds_a_masked_pixel_is_masked():
    wave, valid = np.arange(24.0).reshape(4, 6), np.ones((4, 6), bool)
    valid[1, 2] = False
    mean, sigma, whole = binned(wave, np.full((4, 6), 0.2), valid, 2)
    assert whole.tolist() == [[True, False, True], [True, True, True]]
    assert mean[whole] == pytest.approx([3.5, 7.5, 15.5, 17.5, 19.5])
    assert sigma[whole] == pytest.approx(0.1)
