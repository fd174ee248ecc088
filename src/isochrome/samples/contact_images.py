"""The sample of the main job: the paper's six states as a camera might have captured them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.optics import fringe_order
from isochrome.samples.sensor import (
    CAMERA,
    block_mean,
    dark_field,
    finer,
    make_sensor,
    write_small_tiff,
    write_truth,
)
from isochrome.scene import DistanceTable, Scene, load_scene
from isochrome.simulation import SceneState, scene_states, state_difference
from isochrome.stress import pixel_grid

Array = NDArray[np.floating]

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
    lit = block_mean(material.astype(float), _POINTS)
    for number, (name, signal) in enumerate((("dark", 0.0 * lit), ("bright", lit))):
        rng = np.random.default_rng([seed, 2, number])
        image = sensor.average(signal, rng, count=AVERAGED)
        write_small_tiff(folder / f"no-load-{name}.tif", image[None], pixel_mm=pixel)
    write_truth(folder, seed, _true_values(truth, nominal, states), sensor)


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
