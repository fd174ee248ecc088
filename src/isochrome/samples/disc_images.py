"""The sample of a calibration with a disc: three diametral loads, the disc not in the middle."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np

from isochrome.optics import fringe_order
from isochrome.output import write_text
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

OFF_PX = (-5.2, 7.4)
"""True place of the disc's centre in the picture, (rows, cols) from the picture's middle."""

FAULTY, _POINTS = 8, 3


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
