"""One state of a phase-stepped set: its frames, one a step, to fringe order and isoclinic angle."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames import Frame, FrameReader, estimate_noise, to_linear
from isochrome.fringes.stepped import SteppedReading, read_steps
from isochrome.optics import make_chain
from isochrome.process.result import Capture, ProcessedFrame, largest_pixel
from isochrome.scene import Scene
from isochrome.simulate import make_picture, scene_states, state_difference
from isochrome.stress import pixel_grid

Array = NDArray[Any]


def states_of(reader: FrameReader, scene: Scene) -> Iterator[list[Frame]]:
    """The frames of a phase-stepped set, those of one state together.

    Parameters: `reader`, of frames that follow each other step by step, then state by state;
    `scene`, with [[polariscope.step]]. Yields lists of as many frames as there are steps.
    """
    steps, together = len(scene.polariscope.step), list[Frame]()
    for frame in reader:
        together.append(frame)
        if len(together) == steps:
            yield together
            together = []


def process_stepped(
    frames: Sequence[Frame], scene: Scene, capture: Capture, *, index: int
) -> ProcessedFrame:
    """Fringe order and isoclinic angle of one state from the frames of its steps.

    Parameters: `frames`, one a step in the scene's order; `scene`, of this one state; `capture`,
    how the set was captured (no-load frames are not needed: the steps tell background and
    illumination); `index` of the state. A pixel that is saturated or faulty in one frame is masked.
    Returns a ProcessedFrame. Raises InputError on a blank set, or steps that cannot tell the order.
    """
    light, valid, sigma = _stacked(frames, scene, capture)
    polariscope = scene.polariscope
    chains = [make_chain(polariscope, step) for step in range(len(polariscope.step))]
    found = read_steps(
        light,
        chains,
        sigma=sigma,
        valid=valid,
        known_order=[(k.row_px, k.col_px, k.order) for k in scene.frames.known_order],
        model=_model(scene, (light.shape[1], light.shape[2])),
    )
    name = f"{frames[0].name} to {frames[-1].name}"
    contrast = found.contrast[np.isfinite(found.order)]
    return ProcessedFrame(
        index,
        name,
        name,
        float("nan"),
        found.dark_field,
        found.reading,
        None,
        [],
        # of the dark field (1 - cos δ)/2, mid-way between its ends
        float(sigma / np.median(contrast)) if contrast.size else float("nan"),
        found.chi,
        scene.camera.pixel_mm if scene.camera else None,
        found.warnings,
        isoclinic=found.isoclinic,
        columns=_columns(found),
    )


def _stacked(frames: Sequence[Frame], scene: Scene, capture: Capture) -> tuple[Array, Array, float]:
    """Light of the steps (steps, rows, cols), pixels good in all of them, and the noise."""
    gamma, bit_depth = scene.frames.gamma, capture.bit_depth
    images, valid, variance = [], [], []
    for frame in frames:
        linear = to_linear(
            frame.image,
            bit_depth=bit_depth,
            gamma=gamma,
            name=frame.name,
            allow_blank=True,
            mask=frame.mask,
        )
        noise = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
        sigma = noise.linear_sigma(frame.image, bit_depth=bit_depth, gamma=gamma)
        images.append(linear.image)
        valid.append(linear.valid)
        variance.append(float(np.mean(np.square(sigma[linear.valid]))))
    light, good = np.stack(images), np.logical_and.reduce(valid)
    if not np.ptp(light[:, good], axis=0).any():
        raise InputError(
            f"frames {frames[0].name} to {frames[-1].name}: the same light in every step, or none; "
            "check that the frames are the steps of [[polariscope.step]], in their order"
        )
    return light, good, float(np.sqrt(np.mean(variance)))


def _model(scene: Scene, shape: tuple[int, int]) -> Callable[[], Array] | None:
    """The scene's own fringe order, as it stands in the scene, for who asks; None without one."""
    if scene.model is None or scene.camera is None or scene.camera.pixel_mm is None:
        return None

    def order() -> Array:
        pixels = pixel_grid(scene, shape)
        (state, *_) = scene_states(scene)
        return make_picture(scene, state_difference(scene, state, pixels), pixels).order

    return order


def _columns(found: SteppedReading) -> dict[str, Any]:
    """The state's columns of frames.csv."""
    return {
        "kept_share": found.reading.kept,
        "isoclinic_share": float(np.isfinite(found.isoclinic).mean()),
        "whole_order_from": found.parts[0].source if found.parts else "none",
        **largest_pixel(found.order),
    }
