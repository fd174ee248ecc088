"""A captured ring in white light whose lamp and camera nobody described: order against load."""

import json

import numpy as np
import pytest
import tifffile
from scipy.optimize import least_squares

from isochrome.calibration import calibrate_colour, save_calibration
from isochrome.processing import process
from isochrome.reference import ring_stress
from real_frames import REAL, needs_real

RING = REAL / "ring-five-loads"
LOADS_KN = (0.981, 1.962, 2.943, 3.924)

pytestmark = [pytest.mark.study, pytest.mark.long, needs_real]


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
    save_calibration(calibrate_colour(place / "set.toml"), place / "table")
    gamma = json.loads((place / "table" / "calibration.json").read_text())["gamma"]
    (place / "scene.toml").write_text(
        f'[specimen]\nshape = "ring"\n{light}[frames]\nmask = "mask.tif"\ngamma = {gamma}\n'
        'colour_table = "table/colour_table.csv"\nno_load_dark = "table/background.tif"\n'
        'no_load_bright = "table/illumination.tif"\n'
    )
    process(RING, place / "scene.toml", place / "out")
    return tifffile.imread(place / "out" / "fringe_order.tif")


def test_without_load_the_order_is_near_zero_and_most_of_the_ring_is_read(orders):
    known = orders[0][np.isfinite(orders[0])]
    assert known.size > 20_000 and np.median(known) < 0.05 and np.percentile(known, 99.0) < 0.1
    # the ring and its load are the same on both sides but for the frame's own tilt
    for order in orders[1:]:
        assert np.isfinite(order).sum() > 0.9 * np.isfinite(orders[0]).sum()


def ring_difference(place):
    """sigma_1 - sigma_2 for P/(R d) = 1, and which pixels lie away from the edges and the loads.
    `place`: column and row of the centre, outer radius (px), hole over it, tilt of the load (rad).
    """
    col, row, radius, hole, tilt = place
    z, x = (np.mgrid[:224, :224] - np.array([row, col])[:, None, None]) / radius
    x, z = x * np.cos(tilt) + z * np.sin(tilt), z * np.cos(tilt) - x * np.sin(tilt)
    field = ring_stress(x, z, load_n=1.0, diameter_mm=2.0, hole_mm=2.0 * hole, thickness_mm=1.0)
    away, loads = np.hypot(x, z), np.hypot(x, np.abs(z) - 1.0)
    inside = (away > hole + 0.06) & (away < 0.94) & (loads > 0.3)
    return field.principal_difference, inside


def test_the_orders_are_those_of_the_closed_form_times_the_load(orders):
    """One place for all frames, and one factor each: what load, thickness and material make.
    No size but the shape of the ring is known, and no fringe value; the factors over the loads
    must be one number."""
    begun = np.array([111.6, 111.5, 111.5, 0.51, 0.0])
    room = np.array([5.0, 5.0, 3.0, 0.03, 0.2])
    used = ring_difference(begun)[1] & np.isfinite(orders[1:])

    def factors_and_misfits(place):
        model = ring_difference(place)[0]
        factors, misfits = [], []
        for order, own in zip(orders[1:], used, strict=True):
            shape = model[own]
            factors.append(order[own] @ shape / (shape @ shape))
            misfits.append(order[own] - factors[-1] * shape)
        return np.array(factors), misfits

    place = least_squares(
        lambda place: np.concatenate(factors_and_misfits(place)[1]), begun,
        bounds=(begun - room, begun + room), x_scale=room,
    ).x  # fmt: skip
    factors, misfits = factors_and_misfits(place)
    rms = [np.sqrt(np.mean(misfit**2)) for misfit in misfits]
    # a table of colours reads to some hundredths of a fringe, of 2.5 at the highest
    assert max(rms) < 0.05
    # of which 0.02 is 6 % of the first frame's own order, 0.3 on average
    each = factors / LOADS_KN
    assert np.abs(each[1:] / each[1:].mean() - 1.0).max() < 0.015
    assert abs(each[0] / each[1:].mean() - 1.0) < 0.08
