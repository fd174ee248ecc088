"""One colour frame in light of several wavelengths: its absolute fringe order, without a model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.estimation import LEVEL_PX, POOR_CHI
from isochrome.frames import (
    CHANNELS,
    Frame,
    FrameReader,
    Linear,
    estimate_noise,
    load_no_load,
    to_linear,
)
from isochrome.fringes import ColourReading, read_colour, read_table, spectral_table
from isochrome.messages import message
from isochrome.optics import camera_response
from isochrome.processing.kinds.kind import FrameKind
from isochrome.processing.kinds.largest_order import LARGEST, order_columns
from isochrome.processing.result import Capture, ProcessedFrame, frame_fields
from isochrome.scene import Scene
from isochrome.specimens import specimen_model
from isochrome.stress import pixel_grid

Array = NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class ColourLight(FrameKind):
    """Frames in light of several wavelengths, whose colours tell the order."""

    channels = CHANNELS

    def check(self, scene: Scene) -> None:
        """Refuse frames that do not tell colours. Raises InputError."""
        where = message("polariscope_light_several_wavelengths", name=scene.name)
        if scene.camera is None or not scene.camera.colour or scene.frames.channel is not None:
            raise InputError("can_processed_colours_alone", where=where)
        if scene.polariscope.step:
            raise InputError("has_no_phase_steps", where=where)
        if scene.polariscope.field == "plane":
            raise InputError("needs_circular_dark_bright", where=where)
        super().check(scene)

    def prepare(self, scene: Scene, reader: FrameReader) -> Capture:
        """The colour table, and the no-load frames of each channel."""
        if reader.channel is None:
            raise InputError("grey_camera_colour_says", path=reader.path)
        assert scene.camera is not None
        pairs = [
            load_no_load(scene.with_values({"frames.channel": name}), full_shape=reader.full_shape)
            for name in CHANNELS
        ]
        dark, bright = map(_in_colour, zip(*pairs, strict=True))
        camera, name = scene.camera, scene.frames.colour_table
        if name is not None:
            return Capture(reader.bit_depth, dark, bright, read_table(scene.path(name)))
        path = scene.path(camera.response) if camera.response is not None else None
        table = spectral_table(scene.polariscope, camera_response(camera, path))
        return Capture(reader.bit_depth, dark, bright, table)

    def read(self, frames: Sequence[Frame], scene: Scene, capture: Capture) -> ProcessedFrame:
        """The order that the colours tell; a model of the scene is not used."""
        light, valid, sigma = _stacked(frames, scene, capture)
        first = frames[0]
        assert capture.table is not None
        for part in (capture.dark, capture.bright):
            valid = valid & part.valid if part else valid
        low, high = (part.image if part else None for part in (capture.dark, capture.bright))
        camera, body, table = scene.camera, first.mask, capture.table
        if scene.indenter is not None and camera is not None and camera.pixel_mm is not None:
            rows, cols = first.image.shape
            below = specimen_model(scene).inside(pixel_grid(scene, (rows, cols)))
            body = np.broadcast_to(below, (rows, cols)) & (body is None or body)
        try:
            result = read_colour(
                light, table, sigma=sigma, dark=low, bright=high, valid=valid, specimen=body
            )
        except InputError as error:
            raise InputError(f"frame {first.index} ({first.name}): " + error.message) from error
        trusted = np.isfinite(result.signal)
        count = np.maximum(trusted.sum(axis=-1), 1)
        mean = np.where(trusted, result.signal, 0.0).sum(axis=-1) / count
        columns = {"kept_share": result.kept, "strange_share": result.strange}
        return ProcessedFrame(
            **frame_fields(first, scene),
            normalised=np.where(trusted.any(axis=-1), mean, np.nan).astype(np.float32),
            reading=result, noise=result.noise, chi=result.chi, warnings=tuple(_warnings(result)),
            columns=columns | order_columns(result.order, result.uncertainty),
        )  # fmt: skip

    def values(self, scene: Scene) -> tuple[str, ...]:
        """What is read, and how much of it has colours that the table has not."""
        return ("kept_share", "strange_share", *LARGEST)


def _in_colour(channels: Sequence[Linear | None]) -> Linear | None:
    """As one of (rows, cols, 3)."""
    known = [part for part in channels if part is not None]
    if len(known) < len(channels):
        return None
    image = np.stack([part.image for part in known], axis=-1)
    return Linear(image, np.stack([part.valid for part in known], axis=-1))


def _stacked(
    frames: Sequence[Frame], scene: Scene, capture: Capture
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Light, trusted pixels and noise of the channels, (rows, cols, 3) each."""
    from scipy.ndimage import gaussian_filter

    gamma, bit_depth = scene.frames.stated_gamma, capture.bit_depth
    light, valid, sigma = [], [], []
    for frame, name in zip(frames, CHANNELS, strict=True):
        linear = to_linear(frame, bit_depth=bit_depth, gamma=gamma, name=f"{frame.name}, {name}")
        noise = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
        raw = np.where(np.isfinite(frame.image), frame.image, 0.0).astype(np.float32)
        level = gaussian_filter(raw, LEVEL_PX)  # a pixel's weight must not follow its own noise
        light.append(linear.image)
        valid.append(linear.valid)
        sigma.append(noise.linear_sigma(level, bit_depth=bit_depth, gamma=gamma))
    return np.stack(light, axis=-1), np.stack(valid, axis=-1), np.stack(sigma, axis=-1)


def _warnings(reading: ColourReading) -> Iterator[str]:
    if reading.lost:
        yield message("colours_pixels_not_table", strange=100 * reading.strange, chi=reading.chi)
    elif reading.chi > POOR_CHI:
        yield message("chi_table_does_not", chi=reading.chi)
    if reading.exposure.factor != 1.0:
        yield message("exposed_times_long_no", factor=reading.exposure.factor)
    elif not reading.exposure.told:
        yield message("colours_do_not_tell")
    if reading.blind:
        yield message("illumination_found_from_frame")
    if not reading.lost and reading.kept < 0.5:
        yield message("only_lit_pixels_could", kept=100 * reading.kept)
