"""The sample of a film: a sliding contact that wears while its load swings, a frame a second."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.output import write_text
from isochrome.samples.contact_images import AVERAGED, fine_order
from isochrome.samples.sensor import (
    CAMERA,
    block_mean,
    dark_field,
    make_sensor,
    sample_text,
    write_small_tiff,
    write_truth,
)
from isochrome.scene import DistanceTable, Scene, parse_scene
from isochrome.simulation import scene_states

Grey = NDArray[np.uint8]

FILM, FRAMES, FRAMES_PER_S = "film.avi", 200, 1.0
"""The film's file, its length, and how fast it was taken."""

LOAD_N, SWING, PERIOD = 44.7, 0.08, 45.0
"""Mean load, its swing as a share of that, and the frames of a swing."""

FRICTION = (0.21, 0.25)
"""Friction coefficient at the first and at the last frame; it runs in."""

WEAR_MM2_PER_N = 6.2e-9
LEFT_PX, TOP_PX = 1.7, -0.8
"""True place of all frames less the nominal one."""

FILM_CAMERA = CAMERA.model_copy(update={"noise_grey": 1.5})
"""The camera of all samples, at a lower gain."""

FAULTY, _POINTS, _TOLERANCE = 6, 3, 1e-5
_NODES = 8
"""Nodes of the surface from one point of a pixel to the next."""


def render_film(folder: Path, seed: int) -> None:
    """Write the film, its no-load frames, its scene and its truth to a folder."""
    nominal = parse_scene(sample_text("film-scene.toml"), name="film")
    truth = true_film(nominal)
    shape = truth.get("camera.height_px"), truth.get("camera.width_px")
    sensor = make_sensor(shape, np.random.default_rng([seed, 40]), faulty=FAULTY)
    sensor = replace(sensor, camera=FILM_CAMERA)
    frames = []
    for i, state in enumerate(scene_states(truth)):
        order = fine_order(truth, state, _POINTS)
        rng = np.random.default_rng([seed, 41, i])
        frames.append(sensor.expose(dark_field(order, _POINTS), rng))
    _write_film(folder / FILM, frames)
    lit = block_mean(np.isfinite(order).astype(float), _POINTS)
    for number, (name, signal) in enumerate((("dark", 0.0 * lit), ("bright", lit))):
        rng = np.random.default_rng([seed, 42, number])
        image = sensor.average(signal, rng, count=AVERAGED)
        write_small_tiff(
            folder / f"no-load-{name}.tif", image[None], pixel_mm=truth.get("camera.pixel_mm")
        )
    write_text(folder / "scene.toml", sample_text("film-scene.toml"))
    write_truth(folder, seed, _true_values(truth), sensor)


def true_film(nominal: Scene) -> Scene:
    """The contact as it truly was, a state a frame."""
    assert nominal.frames.sliding_speed_mm_per_s is not None
    seconds = np.arange(FRAMES) / FRAMES_PER_S
    distance = tuple((1e-3 * nominal.frames.sliding_speed_mm_per_s * seconds).round(9).tolist())
    load = LOAD_N * (1.0 + SWING * np.sin(2.0 * np.pi * seconds / PERIOD))
    first, last = FRICTION
    friction = last + (first - last) * np.exp(-5.0 * seconds / seconds[-1])
    pixel = nominal.get("camera.pixel_mm")
    fine = {"tolerance": _TOLERANCE, "spacing_mm": pixel / (_POINTS * _NODES)}
    numerics = nominal.numerics.model_copy(update=fine)
    return nominal.with_values(
        {
            "load.normal_n": DistanceTable(distance_m=distance, value=_rounded(load, 6)),
            "friction.coefficient": DistanceTable(distance_m=distance, value=_rounded(friction, 6)),
            "wear.coefficient_mm2_per_n": WEAR_MM2_PER_N,
            "wear.distances_m": distance,
            "camera.left_mm": round(nominal.get("camera.left_mm") + LEFT_PX * pixel, 9),
            "camera.top_mm": round(nominal.get("camera.top_mm") + TOP_PX * pixel, 9),
        }
    ).model_copy(update={"numerics": numerics})


def _rounded(values: NDArray[np.floating], digits: int) -> tuple[float, ...]:
    return tuple(values.round(digits).tolist())


def _true_values(truth: Scene) -> dict[str, Any]:
    """The true values, by the scene's keys; a list has one value a frame."""
    load, friction = truth.get("load.normal_n"), truth.get("friction.coefficient")
    return {
        "distance_m": list(load.distance_m),
        "load.normal_n": list(load.value),
        "friction.coefficient": list(friction.value),
        "wear.coefficient_mm2_per_n": truth.get("wear.coefficient_mm2_per_n"),
        "camera.left_mm": truth.get("camera.left_mm"),
        "camera.top_mm": truth.get("camera.top_mm"),
        "camera": FILM_CAMERA.model_dump(exclude_unset=True),
    }


def _write_film(path: Path, frames: list[Grey]) -> None:
    """Write frames as they are, uncompressed: OpenCV reads that by itself, and hides no damage."""
    import cv2

    rows, cols = frames[0].shape
    codec = cv2.VideoWriter.fourcc(*"Y800")
    film = cv2.VideoWriter(str(path), codec, FRAMES_PER_S, (cols, rows), isColor=False)
    if not film.isOpened():
        raise InputError(f"{path}: cannot be opened as a film by this OpenCV")
    for frame in frames:
        film.write(frame)
    film.release()
