"""The samples of calibrations: a beam in four-point bending seen a little tilted, at four loads; a
disc under three diametral loads, not in the middle.
"""

import tomllib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from isochrome.optics import fringe_order
from isochrome.output import write_text
from isochrome.reference import beam_stress
from isochrome.samples.sensor import (
    CAMERA,
    dark_field,
    finer,
    make_sensor,
    sample_text,
    write_png,
    write_truth,
)
from isochrome.scene import Scene, parse_scene
from isochrome.specimens import specimen_model
from isochrome.stress import pixel_grid

Array = NDArray[np.floating]

SHAPE = (440, 480)
FRINGE_VALUE = 14.6
TILT_DEG = 1.3
"""True tilt of the beam, counter-clockwise as the camera sees it."""

MIDDLE_PX = (222.6, 239.5)
"""True row of the neutral axis at the middle column."""

RESIDUAL_ORDER = 0.05
"""Order at the edge that is there without load, spread over the height as bending is."""

OFF_PX = (-5.2, 7.4)
"""True place of the disc's centre in the picture, (rows, cols) from the picture's middle."""

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
    """Fringe order (points rows, points cols) at points x points places in every pixel.

    NaN outside the beam, whose sizes are those of the set.
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


def render_disc(folder: Path, seed: int) -> None:
    """Write the images, the calibration set, a scene and the truth to a folder."""
    scene = true_scene()
    rows, cols = scene.get("camera.height_px"), scene.get("camera.width_px")
    sensor = make_sensor((rows, cols), np.random.default_rng([seed, 20]), faulty=FAULTY)
    fine = finer(scene, _POINTS)
    for i, item in enumerate(tomllib.loads(sample_text("disc-set.toml"))["image"]):
        loaded = fine.with_values({"load.normal_n": item["load_n"]})
        order = fringe_order(
            specimen_model(loaded).difference(loaded, None, pixel_grid(loaded)),
            thickness_mm=scene.get("specimen.thickness_mm"),
            fringe_value_n_per_mm=scene.get("specimen.fringe_value_n_per_mm"),
        )
        rng = np.random.default_rng([seed, 21, i])
        write_png(folder / item["file"], sensor.expose(dark_field(order, _POINTS), rng))
    for name in ("set.toml", "scene.toml"):
        write_text(folder / name, sample_text(f"disc-{name}"))
    truth = {
        "fringe_value_n_per_mm": scene.get("specimen.fringe_value_n_per_mm"),
        "order_at_zero_load": 0.0,
        "camera.left_mm": scene.get("camera.left_mm"),
        "camera.top_mm": scene.get("camera.top_mm"),
        "centre_row_px": 0.5 * (rows - 1) + OFF_PX[0],
        "centre_col_px": 0.5 * (cols - 1) + OFF_PX[1],
        "camera": CAMERA.model_dump(exclude_unset=True),
    }
    write_truth(folder, seed, truth, sensor)


def true_scene() -> Scene:
    """The disc's scene with the camera at its true place."""
    scene = parse_scene(sample_text("disc-scene.toml"), name="disc")
    grid, down, right = pixel_grid(scene), *OFF_PX
    return scene.with_values(
        {
            "camera.left_mm": round(grid.left_mm - right * grid.pixel_mm, 9),
            "camera.top_mm": round(grid.top_mm - down * grid.pixel_mm, 9),
        }
    )
