"""One captured frame: the scene's model fitted to it, and its fringe order read."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from isochrome import fitting
from isochrome.calibration import Circle, find_rim, fit_circle
from isochrome.errors import InputError, PhysicsError
from isochrome.estimation import ALIKE_CHI, POOR_CHI, FrameData, prepare_frame
from isochrome.frames import Frame
from isochrome.fringes import OrderReading, read_order
from isochrome.messages import message
from isochrome.output import counted
from isochrome.processing.kinds.image_only import read_alone
from isochrome.processing.kinds.kind import FrameKind
from isochrome.processing.kinds.largest_order import LARGEST_BY_MODEL, PRESSURE, largest_with_model
from isochrome.processing.result import (
    CAUSES,
    LOOKS_LIKE,
    REFINED,
    SPREAD,
    Capture,
    ProcessedFrame,
    frame_fields,
    pages_text,
    value_columns,
)
from isochrome.scene import Scene

Explained = Literal["well enough", "not at all", "with a slip"]
"""How far a scene explains a frame; by a slip in it, it is another scene that does."""

Nearest = tuple[tuple[str, float], ...]
"""Names of what a residual looks like, each with the share of it that it alone explains."""

_NO_ORDER = "model_too_far_off_name"


@dataclass(frozen=True, kw_only=True)
class WithModel(FrameKind):
    """Frames of a scene with a model, whose unknowns are fitted to each. `apparatus`, what the
    frames of a video have in common, where that was asked of one of them, and so of no other."""

    apparatus: fitting.Apparatus | None = None

    refines: ClassVar[bool] = True
    """Whether frames may know better than the scene states it."""

    def read(self, frames: Sequence[Frame], scene: Scene, capture: Capture) -> ProcessedFrame:
        """Fit a one-state scene to a frame, and read the order on the branch it names."""
        frame, apparatus = frames[0], self.apparatus
        data = _prepared(frame, scene, capture)
        if apparatus is not None:
            data = apparatus.seen(data)
        held = self.as_stated or apparatus is not None
        data, fit, scene, notes, looks = _fitted(data, scene, frame, as_stated=held)
        has_slip = looks is None
        data, model = _held(data, fit)
        reading, noise, lost = read_frame(frame, data, model, chi=fit.chi, positive=fit.positive)
        inside = data.valid & model.picture.material & (not lost)
        gain = np.where(model.illumination > 0.0, model.illumination, np.nan)
        signal = np.where(inside, (data.light - model.background) / gain, np.nan)
        largest, of_largest = largest_with_model(reading, model, fit.scene, fit)
        notes += [] if has_slip else _warnings(fit, reading, lost)
        columns = {"kept_share": reading.kept, LOOKS_LIKE: pages_text(looks or ())} | largest
        if not lost and np.isfinite(fit.values).all():  # of a lost fit only where it began is left
            columns |= value_columns(fit.keys, fit.values, fit.standard_uncertainty)
        result = ProcessedFrame(
            **frame_fields(frame) | {"pixel_mm": model.pixels.pixel_mm}, fit=fit, chi=fit.chi,
            normalised=signal.astype(np.float32), reading=reading, noise=noise, columns=columns,
            warnings=(*(apparatus.warnings if apparatus else ()), *notes, *of_largest),
        )  # fmt: skip
        if not lost:
            return result
        # as the image alone shows it; the place that the lost fit ended at says nothing: the
        # specimen is where it began, and only that place and its chi are left of it
        began = fitting.evaluate_model(data, scene.with_values({fitting.GAMMA: data.gamma}))
        image = read_alone(frame, scene, capture, inside=began.picture.material)[0]
        place = [scene.get(k) if k.startswith("camera.") else None for k in fit.keys]
        values, unknown = np.array(place, dtype=float), np.full(len(place), np.nan)
        return replace(
            result, normalised=image.normalised, lines=image.lines, noise=image.noise,
            fit=replace(fit, scene=scene, values=values, standard_uncertainty=unknown),
            warnings=(*result.warnings, *(() if has_slip else image.warnings)),
        )  # fmt: skip

    def values(self, scene: Scene) -> tuple[str, ...]:
        """What is fitted to a frame, the unknowns of each frame's own state; what frames refine."""
        keys = fitting.free_keys(fitting.sliding_scene(scene))
        keys = (*keys, fitting.GAMMA) if scene.frames.gamma == "unknown" else keys
        values = (name for key in keys for name in (key, f"{key} {SPREAD}"))
        pressure = PRESSURE if scene.is_contact else ()
        refined = (REFINED,) if self.refines and fitting.stated_pairs(scene) else ()
        return ("kept_share", *LARGEST_BY_MODEL, *pressure, *values, CAUSES, LOOKS_LIKE, *refined)


def _prepared(frame: Frame, scene: Scene, capture: Capture) -> FrameData:
    no_load = capture.dark, capture.bright
    return prepare_frame(
        frame, scene, bit_depth=capture.bit_depth, no_load=no_load, gamma_found=True
    )


def read_frame(
    frame: Frame, data: FrameData, model: fitting.ModelFrame, *, chi: float, positive: bool
) -> tuple[OrderReading, float, bool]:
    """A frame's orders on the branches of its model, however that was found, the noise over the
    illumination, and whether the model is too far off to name branches."""
    noise, lost = _is_lost(data, model, chi=chi, positive=positive)
    reading = read_order(
        data.light, model.picture.order, model.wave, illumination=model.illumination,
        background=model.background, sigma=data.sigma,
        valid=model.mask & (model.illumination > 0.0) & (not lost),
    )  # fmt: skip
    if frame.mask is not None:
        specimen = model.picture.material & frame.mask
        selected = float(np.isfinite(reading.order).sum() / max(1, int(specimen.sum())))
        reading = replace(reading, kept=selected)
    return reading, noise, lost


def _fitted(
    data: FrameData, scene: Scene, frame: Frame, *, as_stated: bool
) -> tuple[FrameData, fitting.FrameFit, Scene, list[str], Nearest | None]:
    """The frame as it was fitted, the fit, the scene that it began with (a disc's placed by its
    rim), what to say, and what its residual as stated looks like; None where a slip in the scene
    was found: the fit says nothing then."""
    notes: list[str] = []
    if scene.rim_diameter_mm is not None:
        scene, notes = placed_disc(scene, data)
    looks: Nearest | None = ()
    try:
        if as_stated:
            fit = fitting.fit_frame(data, scene)
        else:
            extended = fitting.fit_with_causes(data, scene, past=True)
            data, fit = extended.data, extended.fit
            looks = None if extended.slip is not None else extended.nearest
            notes += fitting.cause_messages(extended)
    except PhysicsError as error:
        raise PhysicsError(f"frame {frame.index} ({frame.name}): " + error.message) from error
    if fit.positive and looks is not None:  # the shear may point the other way than the scene's
        for key, *pair in zip(fit.keys, fit.values, fit.standard_uncertainty, strict=True):
            text = fitting.opposite_shear(scene, key, *map(float, pair))
            notes += [] if text is None else [text]
    return data, fit, scene, notes, looks


def placed_disc(scene: Scene, data: FrameData) -> tuple[Scene, list[str]]:
    """Give the scene the disc's place in a frame by its rim, and the pixel where it has none. Where
    no rim is found, the scene's own place is taken, and that is said."""
    camera, diameter = scene.camera, scene.rim_diameter_mm
    if camera is None:
        raise InputError("camera_missing_picture_needs", name=scene.name)
    assert diameter is not None
    try:
        rim = find_rim(data)
    except PhysicsError:
        if camera.pixel_mm is None or camera.left_mm is None or camera.top_mm is None:
            raise
        return scene, [message("disc_rim_not_found")]
    rim = sharp_rim(data, rim)
    pixel = camera.pixel_mm or diameter / (2.0 * rim.radius)
    notes = []
    if abs(2.0 * rim.radius * pixel / diameter - 1.0) > 0.05:
        notes.append(message("rim_mm_wide_camera", pixel=2 * rim.radius * pixel, diameter=diameter))
    values = {
        "camera.pixel_mm": pixel,
        "camera.left_mm": -(rim.col + 0.5) * pixel,
        "camera.top_mm": 0.5 * diameter - (rim.row + 0.5) * pixel,
    }
    return scene.with_values(values), notes


def sharp_rim(data: FrameData, rim: Circle) -> Circle:
    """A rim where the light falls most steeply along rays within a tenth of the radius, if these
    places lie on one circle to 1 % of its radius. A free rim without residual stress is as dark as
    the air and shows no such fall: then the circle stays as it was."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    blurred = gaussian_filter(data.light, max(1.0, 0.004 * rim.radius))
    radii = rim.radius * np.linspace(0.9, 1.06, 161)
    angles = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    rows = rim.row + np.outer(np.sin(angles), radii)
    cols = rim.col + np.outer(np.cos(angles), radii)
    fall = -np.diff(map_coordinates(blurred, [rows, cols], order=1, mode="nearest"), axis=1)
    steepest = fall.argmax(axis=1)
    radius = 0.5 * (radii[steepest] + radii[steepest + 1])
    points = np.stack(
        [rim.row + radius * np.sin(angles), rim.col + radius * np.cos(angles)], axis=1
    )
    result = fit_circle(points[fall.max(axis=1) > 0.5 * np.median(fall.max(axis=1))])
    return result if result.scatter < 0.01 * result.radius else rim


def _held(data: FrameData, fit: fitting.FrameFit) -> tuple[FrameData, fitting.ModelFrame]:
    """The frame as its fit read it, and the fit at every pixel."""
    data = data.as_fitted(fit.scene)
    if fit.plain:
        data = data.plain()
    return data, fitting.evaluate_model(data, fit.scene)


def _is_lost(
    data: FrameData, model: fitting.ModelFrame, *, chi: float, positive: bool
) -> tuple[float, bool]:
    """The noise over the contrast, and whether a model's values and branches say nothing."""
    noise = model.contrast_noise(data.sigma) if positive else float("nan")
    return noise, not positive or chi * noise > fitting.TOO_FAR


def frame_causes(
    frame: Frame, scene: Scene, capture: Capture
) -> tuple[list[str], Explained] | None:
    """What `process` will say of how a scene explains a frame; None where it shows no fringes."""
    data = _prepared(frame, scene, capture)
    data, fit, _, notes, looks = _fitted(data, scene, frame, as_stated=False)
    if looks is None:
        return notes, "with a slip"
    if not (fit.positive or notes):
        return None
    _, lost = _is_lost(*_held(data, fit), chi=fit.chi, positive=fit.positive)
    notes += [*_of_chi(fit), *([message(_NO_ORDER)] if lost else [])]
    return notes, "not at all" if lost else "well enough"


def _of_chi(fit: fitting.FrameFit) -> Iterator[str]:
    """What is said where the model leaves more than the frame's noise."""
    if fit.chi > POOR_CHI:
        yield message("chi_model_does_not_describe", chi=fit.chi)


def _warnings(fit: fitting.FrameFit, reading: OrderReading, lost: bool) -> Iterator[str]:
    yield from _of_chi(fit)
    if not fit.positive:
        yield message("scene_fringes_not_frame_2", correct=message("correct_scene_load_place"))
    elif fit.plain:
        yield message("no_smooth_illumination_fits")
    if near := [m for m in fit.others if m.chi < ALIKE_CHI * fit.chi]:
        count, verb = counted(len(near), "other solution"), "s" * (len(near) == 1)
        yield message("fit_nearly_well_give", counted=count, value=verb)
    if not fit.converged:
        yield message("fit_did_not_converge")
    yield from [message(_NO_ORDER)] if lost else of_share(reading)


def of_share(reading: OrderReading) -> Iterator[str]:
    """What is said where few of the specimen's pixels could be read."""
    if reading.kept < 0.5:
        yield message("only_specimen_pixels_could_read_mask", kept=100 * reading.kept)
