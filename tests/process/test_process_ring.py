"""A captured ring in white light whose lamp and camera nobody described: order against load."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile

from isochrome.calibrate import calibrate_colour, save_colour_calibration
from isochrome.process import process

RING = Path(__file__).resolve().parents[2].parent / "shared" / "real" / "ring-five-loads"
LOADS_KN = (0.981, 1.962, 2.943, 3.924)
MIDDLE_ROW, HOLE_LEFT, HOLE_RIGHT = 112, 54.8, 168.4
"""Row of the hole's middle, and its edges there, by how much of a pixel is dark (columns)."""

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not RING.is_dir(), reason="no captured frames here"),
]


@pytest.fixture(scope="module")
def orders(tmp_path_factory):
    """The frames' orders by the table of their own colours; the loads are nowhere in it."""
    place = tmp_path_factory.mktemp("ring")
    row, col = np.mgrid[:224, :224]
    away = np.hypot(row - 111.5, col - 111.6)
    # off the glare of both rims; the loading plates are above row 24 and below row 212
    ring = (away > 58.0) & (away < 108.0) & (row > 24) & (row < 212)
    tifffile.imwrite(place / "mask.tif", 255 * ring.astype(np.uint8))
    light = '[polariscope]\nwavelength_nm = 540.0\nlight = "white"\n[camera]\ncolour = true\n'
    files = sorted(RING.glob("*.bmp"), key=lambda path: int(path.stem))
    images = "".join(f'[[image]]\nfile = "{path}"\n' for path in files)
    (place / "set.toml").write_text(f'{light}[frames]\nmask = "mask.tif"\n{images}')
    save_colour_calibration(calibrate_colour(place / "set.toml"), place / "table")
    gamma = json.loads((place / "table" / "calibration.json").read_text())["gamma"]
    (place / "scene.toml").write_text(
        f'[specimen]\nshape = "ring"\n{light}[frames]\nmask = "mask.tif"\ngamma = {gamma}\n'
        'colour_table = "table/colour_table.csv"\nno_load_dark = "table/background.tif"\n'
        'no_load_bright = "table/illumination.tif"\n'
    )
    process(RING, place / "scene.toml", place / "out")
    return tifffile.imread(place / "out" / "fringe_order.tif")


def at_edge(order, side):
    """The order at the hole's edge: a parabola through the ten pixels beside it that are known.

    The mask ends 1 to 2 pixels before the edge; where pixels there are not known, a few more.
    """
    edge = HOLE_LEFT if side == "left" else HOLE_RIGHT
    col = np.arange(order.shape[1])
    inside = (col < edge) if side == "left" else (col > edge)
    away = np.abs(col - edge)
    line = order[MIDDLE_ROW]
    known = np.flatnonzero(inside & np.isfinite(line) & (away < 16.0))
    known = known[np.argsort(away[known])][:10]
    assert away[known].min() < 6.0
    return np.polynomial.Polynomial.fit(away[known], line[known], 2)(0.0)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_order_at_the_holes_edge_is_in_proportion_to_the_load(orders, side):
    each = np.array([at_edge(order, side) for order in orders[1:]]) / LOADS_KN
    assert np.abs(each / each.mean() - 1.0).max() < 0.05


def test_without_load_the_order_is_near_zero(orders):
    known = orders[0][np.isfinite(orders[0])]
    assert known.size > 20_000
    assert np.median(known) < 0.05 and np.percentile(known, 99.0) < 0.1


def test_most_of_the_ring_is_read_and_both_halves_agree(orders):
    """The ring and its load are the same on both sides but for the frame's own tilt."""
    for order in orders[1:]:
        assert np.isfinite(order).sum() > 0.9 * np.isfinite(orders[0]).sum()
