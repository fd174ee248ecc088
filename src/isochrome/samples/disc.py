"""The sample of a calibration with a disc: three diametral loads, the disc not in the middle."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np

from isochrome.optics import fringe_order
from isochrome.output import write_json, write_text
from isochrome.samples.sensor import CAMERA, dark_field, finer, make_sensor, write_png
from isochrome.samples.texts import DISC_SCENE, DISC_SET
from isochrome.scene import Scene, parse_scene
from isochrome.stress import disc_difference, pixel_grid

OFF_PX = (-5.2, 7.4)
"""True place of the disc's centre in the picture, (rows, cols) from the picture's middle."""

FAULTY, _POINTS = 8, 3


def render_disc(folder: Path, seed: int) -> None:
    """Write the images, the calibration set, a scene and the truth to a folder."""
    scene = true_scene()
    rows, cols = scene.get("camera.height_px"), scene.get("camera.width_px")
    sensor = make_sensor((rows, cols), np.random.default_rng([seed, 20]), faulty=FAULTY)
    fine = finer(scene, _POINTS)
    for i, item in enumerate(tomllib.loads(DISC_SET)["image"]):
        loaded = fine.with_values({"load.normal_n": item["load_n"]})
        order = fringe_order(
            disc_difference(loaded, pixel_grid(loaded)),
            thickness_mm=scene.get("specimen.thickness_mm"),
            fringe_value_n_per_mm=scene.get("specimen.fringe_value_n_per_mm"),
        )
        rng = np.random.default_rng([seed, 21, i])
        write_png(folder / item["file"], sensor.expose(dark_field(order, _POINTS), rng))
    write_text(folder / "set.toml", DISC_SET)
    write_text(folder / "scene.toml", DISC_SCENE)
    write_json(
        folder / "truth.json",
        {
            "rendered": "by Isochrome: every value below was put in, none was measured",
            "seed": seed,
            "fringe_value_n_per_mm": scene.get("specimen.fringe_value_n_per_mm"),
            "order_at_zero_load": 0.0,
            "camera.left_mm": scene.get("camera.left_mm"),
            "camera.top_mm": scene.get("camera.top_mm"),
            "centre_row_px": 0.5 * (rows - 1) + OFF_PX[0],
            "centre_col_px": 0.5 * (cols - 1) + OFF_PX[1],
            "camera": CAMERA.model_dump(exclude_unset=True),
            "camera_faults": {"dead_row_col": sensor.dead, "hot_row_col": sensor.hot},
        },
    )


def true_scene() -> Scene:
    """The disc's scene with the camera at its true place."""
    scene = parse_scene(DISC_SCENE, name="disc")
    grid, down, right = pixel_grid(scene), *OFF_PX
    return scene.with_values(
        {
            "camera.left_mm": round(grid.left_mm - right * grid.pixel_mm, 9),
            "camera.top_mm": round(grid.top_mm - down * grid.pixel_mm, 9),
        }
    )
