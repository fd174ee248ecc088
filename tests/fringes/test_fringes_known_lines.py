"""Fringe lines of known order and free corners: what they settle, and what they must not.
The frames are closed forms of `outside_fields`, or formulae; lines are level curves of the truth.
"""

import re

import numpy as np
import pytest
from plain_frames import COLS, ROWS, SHAPE, SLOPE, assert_kept, kept, read
from skimage.measure import find_contours

from isochrome.benchmarks import load_benchmarks
from isochrome.fringes import KnownPlaces
from isochrome.processing import process_frame
from isochrome.scene import FreeBoundary, parse_scene

FIELDS, SILENT = load_benchmarks("outside_fields"), load_benchmarks("case_silent")
BENT = np.abs(ROWS - 80.0) / 44.0
"""A beam in pure bending, up to 1.8 fringes at its edges: N = 0 along its axis."""


def field(kind, seed, highest):
    """The order of a closed form, NaN where there is no specimen."""
    order, body = FIELDS.order_field(kind, SHAPE, seed, highest=highest, samples=1)
    return np.where(body, order, np.nan)


def along(order, level, places=5, *, stated=None, rng=None, slack=0.0):
    """A known line: places along the truth's longest line of a level, stated as `stated`."""
    longest = max(find_contours(order, level), key=len)
    at = longest[np.linspace(8, len(longest) - 9, places).round().astype(int)]
    if rng is not None:
        at = np.clip(at + slack * rng.normal(size=at.shape), 0.0, np.array(SHAPE) - 1.0)
    said = level if stated is None else stated
    return KnownPlaces(tuple(map(tuple, at.round(1).tolist())), said, "frames.known_line[1]")


def test_a_line_and_one_true_point_settle_a_disc_that_a_point_on_the_line_does_not():
    order = field("disc", 4, 3.0)
    line = along(order, 0.5)
    row, col = (round(v) for v in line.places[2])
    for refused in (read(order, [(row, col, 0.5)]), read(order, lines=[line])):
        assert not np.isfinite(refused.reading.order).any()
        assert "cannot decide on which side" in refused.said[-1]
    near = np.where(COLS > 90, np.abs(order - 0.25), np.nan)
    row, col = np.unravel_index(np.nanargmin(near), SHAPE)
    point = (int(row), int(col), 0.25)
    got = read(order, [point], [line])
    assert_kept(got, order)
    assert not got.said


def test_a_beams_line_of_order_1_does_not_hide_its_line_of_nought():
    """Mirrored about line 1 the map has no line of N = 0, as most bodies have none: no proof."""
    for got in (read(BENT, [(124, 110, 1.0)]), read(BENT, lines=[along(BENT, 1.0)])):
        assert not np.isfinite(got.reading.order).any()
        assert "cannot decide on which side" in got.said[0]
    axis = KnownPlaces(((80.4, 20.0), (79.1, 110.0), (80.8, 200.0)), 0.0, "frames.known_line[1]")
    for known in ((), [(124, 110, 1.0)]):
        got = read(BENT, known, [axis])
        assert_kept(got, BENT, 0.9, 0.05)
        assert not got.misses


@pytest.mark.parametrize("places", [3, 12])
def test_a_line_has_one_voice_and_a_wrong_one_is_named(places):
    order = field("half plane", 8, 4.0)
    points = [(r, c, round(float(order[r, c]), 2)) for r, c in ((60, 40), (110, 60), (120, 160))]
    got = read(order, points, [along(order, 1.5, places, stated=2.5)])
    assert_kept(got, order)
    (said,) = got.said
    assert said.startswith("frames.known_line[1] = 2.5") and "contradicted by 3 others" in said
    assert re.search(r"with which it would be 1\.(49|5)", said) and len(got.misses) == places


def test_a_line_that_lies_on_no_fringe_is_named_with_how_far_it_is_off():
    got = read(SLOPE, [(80, 130, 1.7)], [along(SLOPE, 1.25, stated=1.5)])
    assert "frames.known_line[1] = 1.5 at row" in got.said[0]
    assert "fits no fringe there" in got.said[0] and "0.2" in got.said[0].split(", ")[-1]
    assert_kept(got, SLOPE)


def test_a_line_with_a_place_on_another_line_is_said_and_of_two_none_is_believed():
    right, other = along(SLOPE, 1.0, 4), along(SLOPE, 2.0, 1)
    mixed = KnownPlaces((*right.places, *other.places), 1.0, "frames.known_line[1]")
    point = (80, 130, 1.7)
    got = read(SLOPE, [point], [mixed])
    assert "1 of its 5 places contradict the others" in got.said[0] and "2.0" in got.said[0]
    assert_kept(got, SLOPE)
    pair = KnownPlaces((right.places[0], other.places[0]), 1.0, "frames.known_line[1]")
    got = read(SLOPE, lines=[pair])
    assert not np.isfinite(got.reading.order).any() and got.said


def test_a_line_along_an_open_seam_does_not_close_it():
    """N touches 1 along a row: beyond it the light leaves two answers, and the line is in both."""
    order = 1.0 + 6e-5 * (ROWS - 80.0) ** 2
    line = KnownPlaces(((80.0, 30.0), (80.0, 110.0), (80.0, 190.0)), 1.0, "frames.known_line[1]")
    got = read(order, [(5, 110, float(order[5, 110]))], [line], noise=0.13)
    assert "goes on or turns back at the line of order 1" in got.said[0]
    assert not np.isfinite(got.reading.order[110:]).any()


def judged(kind, seed):
    """(wrong pixels, kept share) with true points, with a true line more, and with another."""
    rng = np.random.default_rng([seed, 5])
    order = field(kind, [seed, 18], rng.uniform(1.2, 6.0))
    noise = float(np.exp(rng.uniform(np.log(0.03), np.log(0.2))))
    known, wrong, _ = SILENT.points(order, rng)
    known = [point for point, bad in zip(known, wrong, strict=True) if not bad]
    levels = [v for v in np.arange(0.5, np.nanmax(order), 0.5) if len(find_contours(order, v))]
    levels = [v for v in levels if max(map(len, find_contours(order, v))) > 40]
    rng.shuffle(levels)
    lines = [along(order, v, int(rng.integers(2, 7)), rng=rng, slack=1.0) for v in levels[:2]]
    rows = []
    for count in range(len(lines) + 1):
        got = read(order, known, lines[:count], noise=noise)
        error = np.abs(got.reading.order - order)
        rows.append((float(np.mean(error > 0.5)), kept(got, order)[0]))
    return rows


def never_worse(rows):
    (wrong, share), *more = rows
    for now_wrong, now_share in more:
        assert now_wrong <= wrong + 1e-3 and now_share >= share - 0.01
        wrong, share = now_wrong, now_share


@pytest.mark.long
@pytest.mark.parametrize(("kind", "seed"), [("crack", 26), ("beam", 10), ("hole", 24)])
def test_true_lines_never_make_a_map_worse(kind, seed):
    never_worse(judged(kind, seed))


@pytest.mark.study
@pytest.mark.parametrize("kind", FIELDS.KINDS)
def test_true_lines_never_make_maps_of_a_kind_worse(kind):
    for seed in range(5):
        never_worse(judged(kind, 100 + seed))


def corner_of(seed):
    """The order of a plate's free corner in a picture, and the corner as a boundary of 2 sides."""
    order = field("free corner", seed, 1.5 + seed % 4)
    half = 0.5 * np.radians(np.random.default_rng(seed).uniform(60.0, 105.0))
    row, col, reach = 0.5 * SHAPE[0] - 0.5, 0.05 * SHAPE[1] - 0.5, 70.0
    sides = [(row + s * reach * np.sin(half), col + reach * np.cos(half)) for s in (-1.0, 1.0)]
    rows, cols = zip(sides[0], (row, col), sides[1], strict=True)
    return order, FreeBoundary(row_px=rows, col_px=cols)


@pytest.mark.parametrize("seed", range(3))
def test_the_corners_free_sides_of_the_closed_form_are_free(seed):
    """On a free side stress runs along it, and what is normal to it stays 0 from the tip on."""
    half = 0.5 * np.radians(np.random.default_rng(seed).uniform(60.0, 105.0))
    r, h = np.linspace(0.2, 1.5, 40), 1e-5

    def e(w):
        return FIELDS.free_corner(w - 0.9, np.random.default_rng(seed))[0]

    for tangent in (np.exp(1j * (half - 1e-9)), np.exp(-1j * (half - 1e-9))):
        w = r * tangent
        along_side = -e(w) * tangent**2
        size = np.abs(along_side).max()
        assert np.abs(along_side.imag).max() < 1e-6 * size
        # equilibrium: the sum of the stresses changes by 2 Re(de/d conj(w) t) on the way, and the
        # tangential stress, all there is, by as much
        x, y = ((e(w + d) - e(w - d)) / (2.0 * h) for d in (h, 1j * h))
        of_sum = 2.0 * (0.5 * (x + 1j * y) * tangent).real
        of_side = (-(e(w + h * tangent) - e(w - h * tangent)) / (2.0 * h) * tangent**2).real
        assert np.abs(of_sum - of_side).max() < 1e-5 * size
    assert abs(e(1e-3 * np.exp(0.3j * half))) < 2e-3 * size


@pytest.mark.parametrize("seed", [0, 1, 2, 4])
def test_a_free_corner_alone_says_the_order_of_all_that_hangs_together_with_it(seed):
    order, boundary = corner_of(seed)
    got = read(order, corners=boundary.corners)
    share, worst = kept(got, order)
    assert len(boundary.corners) == 1 and share > 0.9 and worst < 0.06 and not got.said


def test_a_corner_that_is_not_dark_is_not_used_nor_one_among_fringes_on_all_sides():
    order, boundary = corner_of(1)
    loaded = read(order + 0.6, corners=boundary.corners)
    assert not np.isfinite(loaded.reading.order).any()
    assert "corner at row 79.5, column 10.5: the light beside it is not that" in loaded.said[0]
    inside = FreeBoundary(row_px=(60.0, 60.0, 110.0), col_px=(60.0, 110.0, 110.0))
    assert len(inside.corners) == 1
    got = read(SLOPE, corners=inside.corners)
    assert not np.isfinite(got.reading.order).any()
    assert "fringes are followed outside of it" in got.said[0]


def test_a_corner_beyond_fringes_too_dense_to_follow_is_not_carried_over_them():
    """From 0 at the corner to 3 within 20 px, and then flat as a dark line is."""
    away = np.hypot(ROWS - 20.0, COLS - 20.0)
    order = np.where((ROWS > 20) & (COLS > 20), 3.0 * np.tanh(away / 9.0) + COLS / 300.0, np.nan)
    boundary = FreeBoundary(row_px=(159.0, 20.0, 20.0), col_px=(20.0, 20.0, 219.0))
    got = read(order, corners=boundary.corners)
    assert kept(got, order)[1] < 0.1 and "corner at row 20, column 20" in got.said[0]


def processed(order, toml):
    """What `process` makes of an order with both no-load frames and a scene's keys."""
    body = np.isfinite(order)
    rng = np.random.default_rng(3)
    signal = np.where(body, np.sin(np.pi * np.nan_to_num(order)) ** 2, 0.0)

    def stored(s):
        light = 20.0 + 200.0 * s + 2.0 * rng.normal(size=SHAPE)
        return np.clip(np.rint(light), 0.0, 255.0).astype(np.uint8)

    dark, bright = (stored(np.full(SHAPE, s)) for s in (0.0, 1.0))
    scene = parse_scene('[specimen]\nshape = "other"\n[camera]\nbit_depth = 8\n' + toml)
    values = {"frames.no_load_dark": dark, "frames.no_load_bright": bright}
    if not body.all():
        values["frames.mask"] = 255 * body.astype(np.uint8)
    return process_frame(stored(signal), scene.with_values(values), 0).frame


@pytest.mark.long
def test_process_reads_by_the_scenes_lines_and_by_its_free_corners():
    line = "[[frames.known_line]]\nrow_px = [{}]\ncol_px = [{}]\norder = {}\n"
    axis = line.format("80, 80", "30, 190", "0")
    found = processed(BENT, axis + line.format("124, 124.4", "30, 190", 1.0))
    assert_kept(found, BENT)
    assert not found.warnings
    wrong = processed(BENT, axis + line.format("124, 124.4", "30, 190", 2.0))
    assert any("frames.known_line[2] = 2" in said for said in wrong.warnings)
    order, boundary = corner_of(2)
    rows, cols = (", ".join(map(str, v)) for v in (boundary.row_px, boundary.col_px))
    found = processed(order, f"[[frames.free_boundary]]\nrow_px = [{rows}]\ncol_px = [{cols}]\n")
    assert_kept(found, order)
