"""One captured frame: the scene's model fitted to it, and its fringe order read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from isochrome.errors import PhysicsError
from isochrome.fit.explain import Explained, explain_frame
from isochrome.fit.frame_data import FrameData, prepare_frame
from isochrome.fit.frame_fit import FrameFit, fit_frame
from isochrome.fit.local import GAMMA
from isochrome.fit.smooth import smooth_frame_fit
from isochrome.frames import Frame
from isochrome.fringes.branch import OrderReading, read_order
from isochrome.process.image_only import process_image_only
from isochrome.process.place import placed_disc
from isochrome.process.result import Capture, ProcessedFrame
from isochrome.scene import Scene

POOR_CHI = 1.3
"""Residual over noise beyond which the model does not describe the frame within its noise."""

LOST = 0.12
"""Residual over contrast beyond which a model cannot name the branch of a pixel: nothing is read.
A right model leaves the noise, about 0.02; one that is 3 % off in load 0.05; wrong ones 0.15 on."""


def process_with_model(frame: Frame, scene: Scene, capture: Capture) -> ProcessedFrame:
    """Fit a one-state scene to a frame, and read the fringe order on the branch it names.

    Parameters: `frame`; `scene`, see `isochrome.fit.one_state.frame_scene`; `capture`, how the set
    was captured. Returns a ProcessedFrame. Raises InputError on a blank frame, PhysicsError where
    the scene's fringes are not in it.
    """
    data = prepare_frame(
        frame,
        scene,
        bit_depth=capture.bit_depth,
        no_load=(capture.dark, capture.bright),
        gamma_found=True,
    )
    fit, scene, notes = _fitted(data, scene, frame)
    if fit.scene.frames.stated_gamma != data.gamma:
        data = data.toned(fit.scene.frames.stated_gamma)
    if fit.plain:
        data = data.plain()
    seen = explain_frame(data, fit.scene)
    gain = np.where(seen.illumination > 0.0, seen.illumination, np.nan)
    noise = float(np.nanmedian((data.sigma / gain)[seen.mask])) if fit.positive else float("nan")
    lost = not fit.positive or fit.chi * noise > LOST
    reading = _read(data, seen, lost)
    if frame.mask is not None:
        own = seen.picture.material & frame.mask
        kept = float(np.isfinite(reading.order).sum() / max(1, int(own.sum())))
        reading = replace(reading, kept=kept)
    warnings = (*notes, *_warnings(fit, reading, lost))
    if lost:
        # the place that the lost fit ended at says nothing: the specimen is where it began
        begun = scene.with_values({GAMMA: data.gamma})
        inside = explain_frame(data, begun).picture.material
        rest = process_image_only(frame, scene, capture, inside=inside)
        return replace(
            rest,
            reading=reading,
            fit=_without_values(fit, scene),
            chi=fit.chi,
            pixel_mm=seen.pixels.pixel_mm,
            warnings=(*warnings, *rest.warnings),
        )
    inside = data.valid & seen.picture.material
    signal = np.where(inside, (data.light - seen.background) / gain, np.nan)
    return ProcessedFrame(
        frame.index,
        frame.name,
        frame.name,
        float("nan"),
        signal.astype(np.float32),
        reading,
        fit,
        [],
        noise,
        fit.chi,
        seen.pixels.pixel_mm,
        warnings,
    )


def _fitted(data: FrameData, scene: Scene, frame: Frame) -> tuple[FrameFit, Scene, list[str]]:
    """The fit, the scene that it began with (a disc's placed by its rim), and what to say."""
    notes: list[str] = []
    if scene.model == "disc":
        scene, notes = placed_disc(scene, data)
    try:
        fit = fit_frame(data, scene)
        fit, said = smooth_frame_fit(data, fit)
        return fit, scene, [*notes, *said]
    except PhysicsError as error:
        raise PhysicsError(f"frame {frame.index} ({frame.name}): {error}") from error


def _read(data: FrameData, seen: Explained, lost: bool) -> OrderReading:
    """The order of each pixel; none where the model was lost."""
    return read_order(
        data.light,
        seen.picture.order,
        seen.response,
        illumination=seen.illumination,
        background=seen.background,
        sigma=data.sigma,
        valid=seen.mask & (seen.illumination > 0.0) & (not lost),
    )


def _without_values(fit: FrameFit, scene: Scene) -> FrameFit:
    """A fit that was lost: only the place it began with is left of it, and its chi."""
    values = [scene.get(key) if key.startswith("camera.") else None for key in fit.keys]
    kept = np.array([np.nan if value is None else value for value in values], dtype=float)
    return replace(fit, scene=scene, values=kept, standard_uncertainty=np.full(len(kept), np.nan))


def _warnings(fit: FrameFit, reading: OrderReading, lost: bool) -> list[str]:
    found = []
    if fit.chi > POOR_CHI:
        found.append(
            f"chi = {fit.chi:.2f}: the model does not describe this frame within its noise "
            "(another load, residual stress, gamma, or a wrong basin); use its orders with care"
        )
    if not fit.positive:
        found.append("the scene's fringes are not in this frame")
    elif fit.plain:
        found.append(
            "no smooth illumination fits with this model, so that one amplitude stands for all the "
            "frame; give no-load frames"
        )
    near = [m for m in fit.others if m.chi < 1.05 * fit.chi]
    if near:
        found.append(
            f"{len(near)} other solution(s) fit nearly as well; give the load more closely"
        )
    if not fit.converged:
        found.append("the fit did not converge fully")
    if lost:
        found.append("the model is too far off to name the branches: no order was read")
    elif reading.kept < 0.5:
        found.append(f"only {100 * reading.kept:.0f} % of the specimen's pixels could be read")
    return found
