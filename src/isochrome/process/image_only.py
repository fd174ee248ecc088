"""A frame without a model: normalised, with its fringe skeleton, and no order."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames import Frame, estimate_noise, normalise, to_linear
from isochrome.fringes.skeleton import skeletons
from isochrome.process.result import Capture, ProcessedFrame
from isochrome.scene import Scene


def process_image_only(
    frame: Frame,
    scene: Scene,
    capture: Capture,
    *,
    inside: NDArray[np.bool_] | None = None,
) -> ProcessedFrame:
    """Normalise a frame without a model, and find its fringe skeleton.

    Parameters as in `process_with_model`; `inside`, True on the specimen where that is known.
    Returns a ProcessedFrame without a reading. A frame in which no fringe shows (an unloaded
    specimen) is kept as it is, and says so.
    """
    gamma, bit_depth = scene.frames.gamma, capture.bit_depth
    linear = to_linear(frame.image, bit_depth=bit_depth, gamma=gamma, name=frame.name)
    if inside is not None:
        linear = replace(linear, valid=linear.valid & inside)
    notes: tuple[str, ...] = ()
    try:
        field: Literal["dark", "bright"] = (
            "bright" if scene.polariscope.field == "bright" else "dark"
        )
        done = normalise(linear, capture.dark, capture.bright, field=field)
        model = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
        sigma = model.linear_sigma(frame.image, bit_depth=bit_depth, gamma=gamma)
        signal = done.signal
        noise = float(np.median(sigma[done.valid] / done.contrast[done.valid]))
        if done.blind:
            notes = ("normalised blind, without both no-load frames: rough where fringes are few",)
        lines = skeletons(np.clip(signal, 0.0, 1.0))
    except InputError as error:
        signal, lines, noise = np.where(linear.valid, linear.image, np.nan), [], float("nan")
        notes = (f"not normalised: {error}",)
    return ProcessedFrame(
        frame.index,
        frame.name,
        frame.name,
        float("nan"),
        signal.astype(np.float32),
        None,
        None,
        lines,
        noise,
        float("nan"),
        scene.camera.pixel_mm if scene.camera else None,
        notes,
    )
