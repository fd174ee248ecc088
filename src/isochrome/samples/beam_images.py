"""The sample of a calibration in four-point bending: a beam seen a little tilted, at four loads."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from isochrome.output import write_text
from isochrome.reference import beam_stress
from isochrome.samples.sensor import (
    CAMERA,
    dark_field,
    make_sensor,
    sample_text,
    write_png,
    write_truth,
)

Array = NDArray[np.floating]

SHAPE = (440, 480)
FRINGE_VALUE = 14.6
TILT_DEG = 1.3
"""True tilt of the beam, counter-clockwise as the camera sees it."""

MIDDLE_PX = (222.6, 239.5)
"""True row of the neutral axis at the middle column."""

RESIDUAL_ORDER = 0.05
"""Order at the edge that is there without load, spread over the height as bending is."""

FAULTY, _POINTS = 8, 3


def render_bending(folder: Path, seed: int) -> None:
    """Write the images, the calibration set and the truth to a folder."""
    text = sample_text("bending-set.toml")
    given = tomllib.loads(text)
    pixel = given["camera"]["pixel_mm"]
    sensor = make_sensor(SHAPE, np.random.default_rng([seed, 10]), faulty=FAULTY)
    for i, item in enumerate(given["image"]):
        order = true_order(item["load_n"], given["beam"], pixel, points=_POINTS)
        rng = np.random.default_rng([seed, 11, i])
        write_png(folder / item["file"], sensor.expose(dark_field(order, _POINTS), rng))
    write_text(folder / "set.toml", text)
    truth = {
        "fringe_value_n_per_mm": FRINGE_VALUE,
        "order_at_zero_load": RESIDUAL_ORDER,
        "tilt_deg": TILT_DEG,
        "neutral_axis_row_px": MIDDLE_PX[0],
        "camera": CAMERA.model_dump(exclude_unset=True),
    }
    write_truth(folder, seed, truth, sensor)


def true_order(load_n: float, beam: dict[str, float], pixel_mm: float, *, points: int) -> Array:
    """Fringe order at points x points places in every pixel, NaN outside the beam.

    Parameters: `load_n`; `beam`, its sizes as in the set; `pixel_mm`; `points` along a pixel's
    side. Returns (points rows, points cols), fringes.
    """
    row, col = ((np.arange(n * points) + 0.5) / points - 0.5 for n in SHAPE)
    down = pixel_mm * (row - MIDDLE_PX[0])[:, None]
    right = pixel_mm * (col - MIDDLE_PX[1])[None, :]
    tilt = np.radians(TILT_DEG)
    eta = down * np.cos(tilt) + right * np.sin(tilt)
    stress = beam_stress(eta, load_n=load_n, **beam)
    residual = RESIDUAL_ORDER * eta / (0.5 * beam["height_mm"])
    result: Array = np.abs(stress * beam["thickness_mm"] / FRINGE_VALUE + residual)
    return result
