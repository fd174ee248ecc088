"""A frame without a model: normalised, its fringe skeleton, and its order from known points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames import Frame, Linear, estimate_noise, normalise, to_linear
from isochrome.fringes.ends import fit_ends
from isochrome.fringes.free import FreeReading, read_free
from isochrome.fringes.skeleton import skeletons
from isochrome.process.result import Capture, ProcessedFrame, largest_pixel
from isochrome.scene import Scene

Array = NDArray[Any]

NO_ANCHOR = (
    "no order: the light alone leaves a whole number open; give a point whose order you know "
    "(a free corner, a counted line) as [[frames.known_order]]"
)

NOT_SETTLED = "no order was read; give no-load frames, or mask what is not the specimen"
FLAWS = 0.015
"""What dust, texture and compression add to any frame, over its contrast: a lossy file hides its
noise, and what no smooth order can follow would be taken for fringes lost."""


@dataclass(frozen=True)
class _Signal:
    """The fringe signal 0..1 (rows, cols), its noise, where it is trusted, and what to say.

    `settled`, False where background and illumination could not be found.
    """

    signal: Array
    sigma: Array
    valid: NDArray[np.bool_]
    settled: bool
    notes: tuple[str, ...]


def process_image_only(
    frame: Frame,
    scene: Scene,
    capture: Capture,
    *,
    inside: NDArray[np.bool_] | None = None,
) -> ProcessedFrame:
    """Normalise a frame without a model, find its fringe skeleton, and read its order.

    The order is read where `frames.known_order` gives a point that it hangs together with.
    Parameters as in `process_with_model`; `inside`, True on the specimen where that is known.
    Returns a ProcessedFrame, without a reading where no order is known. A frame in which no fringe
    shows (an unloaded specimen) is kept as it is, and says so.
    """
    linear = to_linear(
        frame.image,
        bit_depth=capture.bit_depth,
        gamma=scene.frames.gamma,
        name=frame.name,
        mask=frame.mask,
    )
    if inside is not None:
        linear = replace(linear, valid=linear.valid & inside)
    pixel = scene.camera.pixel_mm if scene.camera else None
    blank = ProcessedFrame(
        frame.index,
        frame.name,
        frame.name,
        float("nan"),
        np.where(linear.valid, linear.image, np.nan).astype(np.float32),
        None,
        None,
        [],
        float("nan"),
        float("nan"),
        pixel,
        (),
    )
    try:
        seen = _signal(frame, linear, scene, capture)
    except InputError as error:
        return replace(blank, warnings=(f"not normalised: {error}",))
    lines = skeletons(np.clip(seen.signal, 0.0, 1.0))
    found, warnings = _read(seen, scene)
    return replace(
        blank,
        normalised=seen.signal.astype(np.float32),
        reading=found.reading if found else None,
        lines=lines,
        noise=float(np.median(seen.sigma[seen.valid])),
        warnings=(*seen.notes, *warnings),
        columns=_columns(found, len(lines)) if found else {},
    )


def _signal(frame: Frame, linear: Linear, scene: Scene, capture: Capture) -> _Signal:
    """Background and illumination out, by no-load frames where there are, else by the fringes."""
    gamma, bit_depth = scene.frames.gamma, capture.bit_depth
    model = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
    sigma = model.linear_sigma(frame.image, bit_depth=bit_depth, gamma=gamma)
    low, high = np.percentile(linear.image[linear.valid], [1.0, 99.0])
    sigma = np.maximum(sigma, FLAWS * (high - low))
    dark, bright = capture.dark, capture.bright
    notes: tuple[str, ...] = ()
    settled = True
    if dark is None or bright is None:
        valid = linear.valid
        for no_load in (dark, bright):
            valid = valid & no_load.valid if no_load else valid
        ends = fit_ends(
            linear.image,
            sigma,
            valid,
            dark=dark.image if dark else None,
            bright=bright.image if bright else None,
        )
        dark, bright = Linear(ends.dark, valid), Linear(ends.bright, valid)
        notes = ("normalised by its own fringes, without both no-load frames",)
        settled = ends.settled
        if not settled:
            notes = (f"{notes[0]}, which did not settle: {NOT_SETTLED}",)
    done = normalise(linear, dark, bright)
    noise = sigma / np.where(done.valid, done.contrast, 1.0)
    return _Signal(done.signal, noise, done.valid, settled, notes)


def _read(seen: _Signal, scene: Scene) -> tuple[FreeReading | None, tuple[str, ...]]:
    """The order from the known points, and what to say of it."""
    known = [(k.row_px, k.col_px, k.order) for k in scene.frames.known_order]
    if not known:
        return None, (NO_ANCHOR,)
    if not seen.settled:
        return None, ()
    turn = -1.0 if scene.polariscope.field == "bright" else 1.0
    wave = np.where(seen.valid, turn * (1.0 - 2.0 * seen.signal), 0.0)
    sigma = np.where(seen.valid, 2.0 * seen.sigma, 1.0)
    found = read_free(wave, sigma, seen.valid, known)
    warnings = [
        f"frames.known_order = {order:g} at row {row}, column {col}: fits no fringe there; check it"
        for row, col, order in found.misses
    ]
    if found.anchored < 0.9:
        warnings.append(
            f"{100 * (1.0 - found.anchored):.0f} % of what could be followed hangs together with no"
            " known point; add [[frames.known_order]] there"
        )
    return found, tuple(warnings)


def _columns(found: FreeReading, lines: int) -> dict[str, Any]:
    """The frame's columns of frames.csv."""
    order = found.reading.order
    columns: dict[str, Any] = {"kept_share": found.reading.kept, "fringe_lines": lines}
    return columns | largest_pixel(order) if np.isfinite(order).any() else columns
