"""The sample of the main job: the paper's six states as a camera might have captured them.

The sample of a film: a sliding contact that wears while its load swings, a frame a second.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.optics import fringe_order
from isochrome.output import write_text
from isochrome.samples.sensor import (
    CAMERA,
    Sensor,
    block_mean,
    dark_field,
    finer,
    make_sensor,
    sample_text,
    write_small_tiff,
    write_truth,
)
from isochrome.scene import DistanceTable, Scene, load_scene, parse_scene
from isochrome.simulation import SceneState, scene_states, state_difference
from isochrome.stress import pixel_grid

Array = NDArray[np.floating]
Grey = NDArray[np.uint8]

SCENE = "line-contact-wear"
LOAD, WEAR = 1.015, 1.03
"""True load and wear coefficient over their nominal values."""

FRICTION = (0.236, 0.241, 0.246, 0.250, 0.252)
"""True friction coefficient at the scene's distances."""

LEFT_PX = (4.30, 4.42, 4.51, 4.65, 4.71, 4.77)
TOP_PX = (-2.60, -2.65, -2.56, -2.51, -2.47, -2.42)
"""True place of each frame less the nominal one: off by some pixels, and drifting."""

FAULTY, GLARE, AVERAGED = 20, (372.0, 538.0, 4.0), 16
ORDER_STEP = 2.0**-13
"""The stored order is rounded to this, fringes, so that it compresses."""

_POINTS, _TOLERANCE = 3, 1e-6
"""Points along a pixel's side; the truth's contact is solved finer than any fit's."""


def render_contact(folder: Path, seed: int) -> None:
    """Write the stack, its no-load frames, its scene and its truth to a folder."""
    nominal = load_scene(SCENE)
    truth = true_contact(nominal)
    pixel = truth.get("camera.pixel_mm")
    states = scene_states(truth)
    shape = (truth.get("camera.height_px"), truth.get("camera.width_px"))
    sensor = make_sensor(shape, np.random.default_rng([seed, 0]), faulty=FAULTY, glare=GLARE)
    frames, orders = [], []
    for i, state in enumerate(states):
        order = fine_order(placed_contact(truth, nominal, i), state, _POINTS)
        rng = np.random.default_rng([seed, 1, i])
        frames.append(sensor.expose(dark_field(order, _POINTS), rng))
        middle = order[_POINTS // 2 :: _POINTS, _POINTS // 2 :: _POINTS]
        orders.append((np.rint(middle / ORDER_STEP) * ORDER_STEP).astype(np.float32))
        if i == 0:
            material = np.isfinite(order)
    write_small_tiff(folder / "captured.tif", np.stack(frames), pixel_mm=pixel)
    write_small_tiff(folder / "true_fringe_order.tif", np.stack(orders), pixel_mm=pixel)
    _write_no_load(folder, material, sensor, (seed, 2), pixel)
    write_truth(folder, seed, _true_values(truth, nominal, states), sensor)


def _write_no_load(
    folder: Path, material: NDArray[np.bool_], sensor: Sensor, seed: tuple[int, int], pixel: float
) -> None:
    """Write the unloaded specimen in the dark and in the bright field."""
    lit = block_mean(material.astype(float), _POINTS)
    for number, (name, signal) in enumerate((("dark", 0.0 * lit), ("bright", lit))):
        image = sensor.average(signal, np.random.default_rng([*seed, number]), count=AVERAGED)
        write_small_tiff(folder / f"no-load-{name}.tif", image[None], pixel_mm=pixel)


def true_contact(nominal: Scene) -> Scene:
    """The contact as it truly was: other load, wear and friction than the nominal scene's."""
    assert nominal.wear is not None
    table = DistanceTable(distance_m=nominal.wear.distances_m, value=FRICTION)
    return nominal.with_values(
        {
            "load.normal_n": round(LOAD * nominal.get("load.normal_n"), 9),
            "friction.coefficient": table,
            "wear.coefficient_mm2_per_n": float(
                f"{WEAR * nominal.get('wear.coefficient_mm2_per_n'):.9g}"
            ),
        }
    ).model_copy(update={"numerics": nominal.numerics.model_copy(update={"tolerance": _TOLERANCE})})


def placed_contact(scene: Scene, nominal: Scene, index: int) -> Scene:
    """A scene with its camera at the true place of frame `index`."""
    pixel = nominal.get("camera.pixel_mm")
    left_mm = nominal.get("camera.left_mm") + LEFT_PX[index] * pixel
    top = nominal.get("camera.top_mm") + TOP_PX[index] * pixel
    return scene.with_values({"camera.left_mm": round(left_mm, 9), "camera.top_mm": round(top, 9)})


def fine_order(scene: Scene, state: SceneState, points: int) -> Array:
    """Fringe order at points x points of every pixel; NaN above the surface."""
    pixels = pixel_grid(finer(scene, points))
    order = fringe_order(
        state_difference(scene, state, pixels),
        thickness_mm=scene.get("specimen.thickness_mm"),
        fringe_value_n_per_mm=scene.get("specimen.fringe_value_n_per_mm"),
    )
    return np.where((pixels.z_mm >= 0.0)[:, None], order, np.nan)


def _true_values(truth: Scene, nominal: Scene, states: list[SceneState]) -> dict[str, Any]:
    """The true values, by the scene's keys; a list has one value a frame."""
    places = [placed_contact(truth, nominal, i) for i in range(len(states))]
    return {
        "load.normal_n": truth.get("load.normal_n"),
        "wear.coefficient_mm2_per_n": truth.get("wear.coefficient_mm2_per_n"),
        "frames": [s.label for s in states],
        "distance_m": [s.distance_m for s in states],
        "friction.coefficient": [s.surface.friction for s in states if s.surface],
        "camera.left_mm": [p.get("camera.left_mm") for p in places],
        "camera.top_mm": [p.get("camera.top_mm") for p in places],
        "camera": CAMERA.model_dump(exclude_unset=True),
        "fringe_order_step": ORDER_STEP,
    }


FILM, FRAMES, FRAMES_PER_S = "film.avi", 200, 1.0
"""The film's file, its length, and how fast it was taken."""

LOAD_N, SWING, PERIOD = 44.7, 0.08, 45.0
"""Mean load, its swing as a share of that, and the frames of a swing."""

FILM_FRICTION = (0.21, 0.25)
"""Friction coefficient at the first and at the last frame; it runs in."""

WEAR_MM2_PER_N = 6.2e-9
FILM_LEFT_PX, FILM_TOP_PX = 1.7, -0.8
"""True place of all frames less the nominal one."""

FILM_CAMERA = CAMERA.model_copy(update={"noise_grey": 1.5})
"""The camera of all samples, at a lower gain."""

FILM_FAULTY, _FILM_TOLERANCE = 6, 1e-5
_NODES = 8
"""Nodes of the surface from one point of a pixel to the next."""


def render_film(folder: Path, seed: int) -> None:
    """Write the film, its no-load frames, its scene and its truth to a folder."""
    nominal = parse_scene(sample_text("film-scene.toml"), name="film")
    truth = true_film(nominal)
    shape = truth.get("camera.height_px"), truth.get("camera.width_px")
    sensor = make_sensor(shape, np.random.default_rng([seed, 40]), faulty=FILM_FAULTY)
    sensor = replace(sensor, camera=FILM_CAMERA)
    frames = []
    for i, state in enumerate(scene_states(truth)):
        order = fine_order(truth, state, _POINTS)
        rng = np.random.default_rng([seed, 41, i])
        frames.append(sensor.expose(dark_field(order, _POINTS), rng))
    _write_film(folder / FILM, frames)
    _write_no_load(folder, np.isfinite(order), sensor, (seed, 42), truth.get("camera.pixel_mm"))
    write_text(folder / "scene.toml", sample_text("film-scene.toml"))
    write_truth(folder, seed, _film_values(truth), sensor)


def true_film(nominal: Scene) -> Scene:
    """The contact as it truly was, a state a frame."""
    assert nominal.frames.sliding_speed_mm_per_s is not None
    seconds = np.arange(FRAMES) / FRAMES_PER_S
    distance = tuple((1e-3 * nominal.frames.sliding_speed_mm_per_s * seconds).round(9).tolist())
    load = LOAD_N * (1.0 + SWING * np.sin(2.0 * np.pi * seconds / PERIOD))
    first, last = FILM_FRICTION
    friction = last + (first - last) * np.exp(-5.0 * seconds / seconds[-1])
    pixel = nominal.get("camera.pixel_mm")
    fine = {"tolerance": _FILM_TOLERANCE, "spacing_mm": pixel / (_POINTS * _NODES)}
    numerics = nominal.numerics.model_copy(update=fine)
    return nominal.with_values(
        {
            "load.normal_n": DistanceTable(distance_m=distance, value=_rounded(load, 6)),
            "friction.coefficient": DistanceTable(distance_m=distance, value=_rounded(friction, 6)),
            "wear.coefficient_mm2_per_n": WEAR_MM2_PER_N,
            "wear.distances_m": distance,
            "camera.left_mm": round(nominal.get("camera.left_mm") + FILM_LEFT_PX * pixel, 9),
            "camera.top_mm": round(nominal.get("camera.top_mm") + FILM_TOP_PX * pixel, 9),
        }
    ).model_copy(update={"numerics": numerics})


def _rounded(values: NDArray[np.floating], digits: int) -> tuple[float, ...]:
    return tuple(values.round(digits).tolist())


def _film_values(truth: Scene) -> dict[str, Any]:
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
        raise InputError(message("cannot_opened_film_opencv", path=path))
    for frame in frames:
        film.write(frame)
    film.release()
