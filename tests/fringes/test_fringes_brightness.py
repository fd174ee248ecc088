"""How bright frames of an unknown light are against each other, before their orders are known."""

import numpy as np
import pytest

from isochrome.fringes import ColourShots
from isochrome.fringes.colour_table import NUMBERS, SENSOR
from isochrome.fringes.unknown_light import unknowns
from isochrome.fringes.windows import ALIKE

ROW, COL = np.mgrid[:60, :80].astype(float)
FRAMES = slice(NUMBERS + 1, NUMBERS + 4)


def fringes(highest):
    """Light of three bands (rows, cols, 3) whose order goes from 0 to `highest`."""
    order = highest * COL[..., None] / COL.max() / np.array([1.1, 1.0, 0.85])
    return 0.9 * np.sin(np.pi * order) ** 2


def test_a_dark_first_frame_is_no_measure_of_the_others():
    """A specimen without load is dark: all others were said to be exposed 70 times as long."""
    raw = np.stack([fringes(0.05), fringes(3.0), 0.7 * fringes(2.5)])
    noise = np.full(raw.shape, 0.004)
    known = unknowns(
        ColourShots(raw, noise, np.ones(raw.shape, bool)),
        SENSOR, 1.0, fixed=True, bright_field=False,
    )  # fmt: skip
    # fringes of different heights reach nearly the same light: to a few per cent
    assert known.start[FRAMES] == pytest.approx([0.0, 0.0, np.log(0.7)], abs=0.05)
    assert (known.expected[FRAMES] == 0.0).all()
    # the brightest frame is the measure; the others are free, and expected to be alike
    held = np.diag(known.hold_of(known.start) - known.hold)[FRAMES]
    assert held == pytest.approx(1.0 / (ALIKE**2 + known.start[FRAMES] ** 2), rel=1e-12)
    assert np.flatnonzero(np.diag(known.hold)[FRAMES] > 0.0).tolist() == [1]
