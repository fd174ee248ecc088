"""Tractions of every frame of a fit, and what they leave on disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.fit.frame_set import FrameSet
from isochrome.fit.joint import JointFit
from isochrome.fit.result import Fit
from isochrome.fit.tractions import Tractions, invert_tractions
from isochrome.fit.tractions_figure import tractions_figure
from isochrome.optics import fringe_order
from isochrome.output import TiffWriter, write_csv, write_figure
from isochrome.scene import Scene

Array = NDArray[Any]

ASK_CHI = 1.1
"""Residual over noise of a model's fit from which tractions are the better description."""

_POOR_CHI = 3.0
"""Residual over noise from which a fit's place is no better than the scene's."""


def asked_for(result: Fit) -> tuple[str, ...]:
    """What to say of a contact's fit without tractions: whether they are called for."""
    poor = [i for i, chi in enumerate(result.frame_chi) if chi > ASK_CHI]
    if not poor or result.scene.model != "contact":
        return ()
    which = ", ".join(map(str, poor))
    return (
        f"chi = {max(result.frame_chi):.2f}: the contact model does not describe frame(s) {which}; "
        "--tractions finds the pressure and shear on the surface without one",
    )


def with_tractions(
    result: Fit,
    frames: FrameSet,
    joint: JointFit,
    given: list[Scene],
    *,
    free_top: bool,
    told: Callable[[], None],
) -> Fit:
    """A fit with the tractions of each of its frames.

    Parameters: `result`; `frames`; `joint`, whose scenes are where each frame's search starts;
    `given`, the frames' scenes before the fit; `free_top`, whether the surface's place is found
    too; `told`, called with each frame done. Returns a Fit.
    """
    plain, frames.plain = frames.plain, set()  # a poor model's light is not the frame's
    found = []
    for i, data in enumerate(frames):
        first, second = joint.scenes[i], given[i]
        if joint.frame_chi[i] > _POOR_CHI or i in joint.lost:
            first, second = second, first
        found.append(invert_tractions(data, first, others=(second,), free_top=free_top))
        told()
    frames.plain = plain
    several = len(found) > 1
    said = [
        f"tractions of frame {i}: {text}" if several else f"tractions: {text}"
        for i, one in enumerate(found)
        for text in one.warnings
    ]
    return replace(result, tractions=tuple(found), warnings=(*result.warnings, *said))


def write_tractions(folder: Path, frames: FrameSet, joint: JointFit, result: Fit) -> None:
    """Leave tractions.csv, the principal stresses and the order as TIFFs, and tractions.png.

    Parameters: `folder`; `frames`; `joint`, for the model beside; `result`, with tractions.
    """
    found = result.tractions
    write_csv(folder / "tractions.csv", _table(found))
    pixel = found[0].pixels.pixel_mm
    with (
        TiffWriter(folder / "sigma_1_mpa.tif", pixel_mm=pixel) as first,
        TiffWriter(folder / "sigma_2_mpa.tif", pixel_mm=pixel) as second,
        TiffWriter(folder / "fringe_order.tif", pixel_mm=pixel) as order,
    ):
        for one, scene in zip(found, joint.scenes, strict=True):
            for writer, image in zip((first, second, order), maps(one, scene), strict=True):
                writer.append(image)
    figure = tractions_figure(result.scene.name, frames, joint.scenes, found)
    write_figure(folder / "tractions.png", figure)


def maps(tractions: Tractions, scene: Scene) -> tuple[Array, Array, Array]:
    """sigma_1, sigma_2 (MPa) and the fringe order at every pixel, NaN above the surface, float32.

    Parameters: `tractions`; `scene`, for thickness and fringe value. Returns maps (rows, cols).
    """
    specimen, pixels = scene.specimen, tractions.pixels
    assert specimen.thickness_mm and specimen.fringe_value_n_per_mm
    stress = tractions.components()
    order = fringe_order(
        stress.difference,
        thickness_mm=specimen.thickness_mm,
        fringe_value_n_per_mm=specimen.fringe_value_n_per_mm,
    )
    material = (pixels.z_mm >= (0.5 - 1e-6) * pixels.pixel_mm)[:, None]
    one, two, three = (
        np.where(material, image, np.nan).astype(np.float32) for image in (*stress.principal, order)
    )
    return one, two, three


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
