"""One state of a phase-stepped set: its frames, one a step, to fringe order and isoclinic angle."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.frames import Frame, FrameReader, estimate_noise, open_no_load_steps, to_linear
from isochrome.fringes import ResidualStress, make_design, read_residual, read_steps
from isochrome.optics import Chain, make_chain
from isochrome.processing.kinds.kind import ISOCLINIC, FrameKind
from isochrome.processing.kinds.largest_order import LARGEST, order_columns
from isochrome.processing.result import Capture, ProcessedFrame, frame_fields
from isochrome.runs import Layer
from isochrome.scene import Scene
from isochrome.simulation import make_picture, scene_states, state_difference
from isochrome.stress import pixel_grid, principal_direction

Array = NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class PhaseStepped(FrameKind):
    """States of several frames, one a phase step, which tell order and isoclinic angle."""

    def check(self, scene: Scene) -> None:
        """Refuse steps that cannot tell the order. Raises InputError."""
        super().check(scene)
        try:
            make_design(_chains(scene))
        except InputError as error:
            raise InputError(f"{scene.name}: " + error.message) from error

    def prepare(self, scene: Scene, reader: FrameReader) -> Capture:
        """The residual stress that the no-load steps show."""
        name = scene.frames.no_load_steps
        if name is None:
            return Capture(reader.bit_depth)
        with open_no_load_steps(scene, reader.full_shape) as unloaded:
            light, valid, sigma = _stacked(list(unloaded), scene, Capture(unloaded.bit_depth))
        result = read_residual(light, _chains(scene), sigma=sigma, valid=valid)
        if not np.isfinite(result.field).any():
            raise InputError("frames_no_load_steps_has_no", path=scene.path(name))
        return Capture(reader.bit_depth, residual=result)

    def read(self, frames: Sequence[Frame], scene: Scene, capture: Capture) -> ProcessedFrame:
        """Order and isoclinic angle of a state."""
        light, valid, sigma = _stacked(frames, scene, capture)
        residual = capture.residual
        result = read_steps(
            light, _chains(scene), sigma=sigma, valid=valid,
            known_order=[(k.row_px, k.col_px, k.order) for k in scene.frames.known_order],
            model=_model(scene, (light.shape[1], light.shape[2]), residual), residual=residual,
        )  # fmt: skip
        name = f"{frames[0].name} to {frames[-1].name}"
        contrast = result.contrast[np.isfinite(result.order)]
        columns = {
            "kept_share": result.reading.kept,
            "isoclinic_share": float(np.isfinite(result.isoclinic).mean()),
            "whole_order_from": result.parts[0].source if result.parts else "none",
            **order_columns(result.order, result.reading.uncertainty),
            **({} if residual is None else {"residual_order_max": residual.largest}),
        }
        return ProcessedFrame(
            **frame_fields(replace(frames[0], name=name), scene),
            normalised=result.dark_field, reading=result.reading, chi=result.chi,
            # of the dark field (1 - cos δ)/2, mid-way between its ends
            noise=float(sigma / np.median(contrast)) if contrast.size else float("nan"),
            warnings=result.warnings, isoclinic=result.isoclinic, columns=columns,
        )  # fmt: skip

    def values(self, scene: Scene) -> tuple[str, ...]:
        """What is read, and the largest residual order."""
        residual = ("residual_order_max",) if scene.frames.no_load_steps is not None else ()
        return ("kept_share", "isoclinic_share", "whole_order_from", *LARGEST, *residual)

    def layers(self, scene: Scene) -> tuple[Layer, ...]:
        """The isoclinic angle too."""
        return (*super().layers(scene), ISOCLINIC)


def _chains(scene: Scene) -> list[Chain]:
    """The elements of each step."""
    return [make_chain(scene.polariscope, step) for step in range(len(scene.polariscope.step))]


def _stacked(frames: Sequence[Frame], scene: Scene, capture: Capture) -> tuple[Array, Array, float]:
    """Light of the steps and where it is good (steps, rows, cols each), and the noise."""
    gamma, bit_depth = scene.frames.stated_gamma, capture.bit_depth
    images, valid, variance = [], [], []
    for frame in frames:
        linear = to_linear(frame, bit_depth=bit_depth, gamma=gamma, allow_blank=True)
        if not linear.valid.any():
            raise InputError("frame_has_no_pixel_can", name=frame.name)
        noise = estimate_noise(frame.image, linear.valid, bit_depth=bit_depth)
        sigma = noise.linear_sigma(frame.image, bit_depth=bit_depth, gamma=gamma)
        images.append(linear.image)
        valid.append(linear.valid)
        variance.append(float(np.mean(np.square(sigma[linear.valid]))))
    light, good = np.stack(images), np.stack(valid)
    low, high = (
        end(np.where(good, light, np.nan), axis=0) for end in (np.fmin.reduce, np.fmax.reduce)
    )
    if not (high > low).any():
        raise InputError("frames_same_light_every", name=frames[0].name, name_2=frames[-1].name)
    return light, good, float(np.sqrt(np.mean(variance)))


def _model(
    scene: Scene, shape: tuple[int, int], residual: ResidualStress | None
) -> Callable[[], Array] | None:
    """The order that frames of the scene's own model would show, for who asks; None without one."""
    if not scene.has_model or scene.camera is None or scene.camera.pixel_mm is None:
        return None

    def order() -> Array:
        pixels = pixel_grid(scene, shape)
        (state, *_) = scene_states(scene)
        picture = make_picture(scene, state_difference(scene, state, pixels), pixels)
        if residual is None:
            return picture.order
        twice = np.exp(2j * principal_direction(picture.difference))
        return np.asarray(np.abs(picture.order * twice + residual.field))

    return order
