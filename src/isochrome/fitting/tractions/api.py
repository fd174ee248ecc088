"""Tractions of every frame of a fit, and what they leave on disk."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from isochrome.fitting.arrays import Array
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame_set import PreparedFrames
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.fitting.result import Fit
from isochrome.fitting.tractions.figure import tractions_figure
from isochrome.fitting.tractions.surface_fit import Tractions, invert_tractions
from isochrome.messages import message
from isochrome.output import imagej_view, named_frames, write_csv, write_figure, write_tiff
from isochrome.scene import Scene
from isochrome.stress import PixelGrid

ASK_CHI = 1.1
"""Residual over noise of a model's fit from which tractions are the better description."""

_POOR_CHI = 3.0
"""Residual over noise from which a fit's place is no better than the scene's."""


def asked_for(result: Fit) -> tuple[str, ...]:
    """What to say of a contact's fit without tractions: whether they are called for."""
    poor = [i for i, chi in enumerate(result.frame_chi) if chi > ASK_CHI]
    if not poor or result.scene.indenter is None:
        return ()
    return (
        message(
            "chi_contact_model_does",
            frame_chi=max(result.frame_chi),
            named_frames=named_frames(poor),
        ),
    )


def with_tractions(
    result: Fit,
    frames: PreparedFrames,
    joint: JointFit,
    given: list[Scene],
    *,
    free_top: bool,
    progress: Callable[[], None],
) -> Fit:
    """A fit with the tractions of each of its frames.

    Parameters: `result`; `frames`; `joint`, whose scenes are where each frame's search starts;
    `given`, the frames' scenes before the fit; `free_top`, whether the surface's place is found
    too; `progress`, called with each frame done. Returns a Fit.
    """
    plain, frames.plain = frames.plain, set()  # a poor model's light is not the frame's
    outcome = []
    for i, data in enumerate(frames):
        first, second = joint.scenes[i], given[i]
        if joint.frame_chi[i] > _POOR_CHI or i in joint.lost:
            first, second = second, first
        outcome.append(invert_tractions(data, first, others=(second,), free_top=free_top))
        progress()
    frames.plain = plain
    several = len(outcome) > 1
    messages = [
        (f"tractions of frame {i}: " if several else "tractions: ") + text
        for i, one in enumerate(outcome)
        for text in one.warnings
    ]
    return replace(result, tractions=tuple(outcome), warnings=(*result.warnings, *messages))


def write_tractions(folder: Path, frames: PreparedFrames, joint: JointFit, result: Fit) -> None:
    """Leave tractions.csv, the principal stresses and the order as TIFFs, and tractions.png.

    Parameters: `folder`; `frames`; `joint`, for the model beside; `result`, with tractions.
    """
    outcome = result.tractions
    write_csv(folder / "tractions.csv", _table(outcome))
    pixel = outcome[0].pixels.pixel_mm
    stacks = zip(*map(maps, outcome, joint.scenes), strict=True)
    for name, stack in zip(("sigma_1_mpa", "sigma_2_mpa", "fringe_order"), stacks, strict=True):
        view = _view(name, stack, outcome[0].pixels)
        write_tiff(folder / f"{name}.tif", np.stack(stack), pixel_mm=pixel, metadata=view)
    figure = tractions_figure(result.scene.name, frames, joint.scenes, outcome)
    write_figure(folder / "tractions.png", figure)


def _view(name: str, stack: Sequence[Array], pixels: PixelGrid) -> dict[str, Any]:
    """What ImageJ is to know of a stack of frames whose first one stands on some `pixels`."""
    known = np.concatenate([image[np.isfinite(image)] for image in stack])
    return imagej_view(
        name,
        (float(known.min(initial=0.0)), float(known.max(initial=0.0))),
        labels=[f"frame {i}" for i in range(len(stack))],
        pixel_mm=pixels.pixel_mm,
        left_mm=float(pixels.x_mm[0]) - 0.5 * pixels.pixel_mm,
        top_mm=float(pixels.z_mm[0]) - 0.5 * pixels.pixel_mm,
    )


def maps(tractions: Tractions, scene: Scene) -> list[Array]:
    """sigma_1, sigma_2 (MPa) and the fringe order at every pixel, NaN above the surface, float32.

    Parameters: `tractions`; `scene`, for thickness and fringe value. Returns maps (rows, cols).
    """
    pixels, stress = tractions.pixels, tractions.components()
    order = scene_optics(scene).order(stress.difference)
    material = (pixels.z_mm >= (0.5 - 1e-6) * pixels.pixel_mm)[:, None]
    images = (*stress.principal, order)
    return [np.where(material, image, np.nan).astype(np.float32) for image in images]


def _table(found: tuple[Tractions, ...]) -> dict[str, Any]:
    names = (
        "x_mm",
        "pressure_mpa",
        "pressure_standard_uncertainty_mpa",
        "shear_mpa",
        "shear_standard_uncertainty_mpa",
    )
    frame = [np.full(len(one.x_mm), i) for i, one in enumerate(found)]
    columns = {name: np.concatenate([getattr(one, name) for one in found]) for name in names}
    return {"frame": np.concatenate(frame), **columns}
