"""Tractions of every frame of a fit, their picture, and what they leave on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.estimation import FrameData
from isochrome.figures import (
    BOLD_PT,
    DIFFERENCE_MAP,
    FINE_PT,
    INK,
    LINE_COLOURS,
    LINE_PT,
    add_legend,
    centred_limit,
    new_figure,
    plain_name,
    show_image,
    style_axes,
    write_head,
)
from isochrome.fitting.arrays import Array
from isochrome.fitting.figure import RESIDUAL_LABEL, show_residual
from isochrome.fitting.frame.model_frame import evaluate_model
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.frame_set import PreparedFrames
from isochrome.fitting.joint.joint_fit import JointFit
from isochrome.fitting.result import Fit
from isochrome.fitting.tractions.inversion import Tractions, invert_tractions, node_runs
from isochrome.messages import message
from isochrome.output import (
    evenly_spaced,
    imagej_view,
    named_frames,
    write_csv,
    write_figure,
    write_tiff,
)
from isochrome.scene import Scene
from isochrome.simulation import scene_states
from isochrome.stress import PixelGrid, StressComponents

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = 4


def tractions_figure(
    name: str, frames: Iterable[FrameData], scenes: tuple[Scene, ...], found: tuple[Tractions, ...]
) -> Figure:
    """Tractions with 95 % bands, residual and principal stresses, beside the models of `scenes`."""
    shown = evenly_spaced(range(len(found)), _SHOWN)
    pixels = found[0].pixels
    height = 2.0 * (4.6 * min(pixels.rows / pixels.cols, 1.6) + 0.75)
    figure = new_figure(12.5, height * len(shown) + 0.4)
    parts: Any = figure.subfigures(len(shown), 1, squeeze=False)
    wanted = {i: data for i, data in enumerate(frames) if i in shown}
    for part, i in zip(parts[:, 0], shown, strict=True):
        axes: Any = part.subplots(2, 2)
        one, scene = found[i], scenes[i]
        stress = one.components()
        _draw_tractions(axes[0, 0], one, scene, f"frame {i}: tractions on the specimen")
        _draw_residual(axes[0, 1], wanted[i], one, stress)
        _draw_principal(axes[1], one, stress)
    write_head(figure, f"{plain_name(name)}: pressure and shear without a contact model")
    return figure


def _draw_tractions(ax: Axes, one: Tractions, scene: Scene, title: str) -> None:
    pixels = one.pixels
    surface = scene_states(scene)[-1].surface
    assert surface is not None
    for label, values, spread, model, colour in (
        ("pressure p", one.pressure_mpa, one.pressure_standard_uncertainty_mpa,
         surface.pressure_mpa, LINE_COLOURS[0]),
        ("shear q", one.shear_mpa, one.shear_standard_uncertainty_mpa,
         surface.shear_mpa, LINE_COLOURS[1]),
    ):  # fmt: skip
        ax.plot(
            surface.grid.x_mm, model, color=colour, lw=LINE_PT, ls="--", label=f"{label}, model"
        )
        for i, j in node_runs(np.ones(len(one.x_mm), bool), one.x_mm):
            x, p, u = one.x_mm[i:j], values[i:j], 1.96 * spread[i:j]  # 95 %
            ax.fill_between(x, p - u, p + u, color=colour, alpha=0.25, lw=0)
            ax.plot(x, p, color=colour, lw=BOLD_PT, label=label if i == 0 else None)
    ax.axhline(0.0, color=INK, lw=FINE_PT)
    ax.set_xlim(pixels.left_mm, pixels.left_mm + pixels.cols * pixels.pixel_mm)
    style_axes(ax, x_label="x (mm)", z_label="traction (MPa)", title=title)
    add_legend(ax)


def _draw_residual(ax: Axes, data: FrameData, one: Tractions, stress: StressComponents) -> None:
    seen = evaluate_model(data, one.scene, difference=stress.difference)
    model = seen.illumination * seen.signal(1) + seen.background
    title = f"residual, chi = {one.chi:.2f}"
    look = {"title": title, "colour_label": RESIDUAL_LABEL}
    show_residual(ax, data, model, seen.mask, **look, **one.pixels.scale)


def _draw_principal(axes: Any, one: Tractions, stress: StressComponents) -> None:
    pixels = one.pixels
    material = (pixels.z_mm >= 0.5 * pixels.pixel_mm)[:, None]
    for ax, image, name in zip(axes, stress.principal, ("σ₁", "σ₂"), strict=True):
        shown = np.where(material, image, np.nan)
        limit = centred_limit(shown, percentile=99.8)
        show_image(
            ax, shown, cmap=DIFFERENCE_MAP, vmin=-limit, vmax=limit,
            title=f"principal stress {name}", colour_label=f"{name} (MPa), tension positive",
            **pixels.scale,
        )  # fmt: skip


ASK_CHI = 1.1
"""Residual over noise of a model's fit from which tractions are the better description."""


def asked_for(result: Fit) -> tuple[str, ...]:
    """What to say of a contact's fit without tractions: whether they are called for."""
    poor = [i for i, chi in enumerate(result.frame_chi) if chi > ASK_CHI]
    if not poor or result.scene.indenter is None:
        return ()
    worst, frames = max(result.frame_chi), named_frames(poor)
    return (message("chi_contact_model_does", frame_chi=worst, named_frames=frames),)


def with_tractions(
    result: Fit,
    frames: PreparedFrames,
    joint: JointFit,
    given: list[Scene],
    *,
    free_top: bool,
    progress: Callable[[], None],
) -> Fit:
    """A fit with each frame's tractions, from the `joint` fit's scenes, then those `given`."""
    plain, frames.plain = frames.plain, set()  # a poor model's light is not the frame's
    outcome = []
    for i, data in enumerate(frames):
        outcome.append(invert_tractions(data, joint.scenes[i], given[i], free_top=free_top))
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
    """Leave tractions.csv, the principal stresses and the order as TIFFs, and tractions.png."""
    outcome = result.tractions
    nodes = [len(one.x_mm) for one in outcome]
    columns: dict[str, Any] = {"frame": np.repeat(np.arange(len(outcome)), nodes)}
    for field in fields(Tractions)[:5]:  # what is known of each node
        columns[field.name] = np.concatenate([getattr(one, field.name) for one in outcome])
    write_csv(folder / "tractions.csv", columns)
    pixel = outcome[0].pixels.pixel_mm
    stacks = zip(*map(maps, outcome), strict=True)
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


def maps(tractions: Tractions) -> list[Array]:
    """sigma_1, sigma_2 (MPa) and the order at every pixel (rows, cols), NaN above the surface."""
    pixels, stress = tractions.pixels, tractions.components()
    order = scene_optics(tractions.scene).order(stress.difference)
    material = (pixels.z_mm >= (0.5 - 1e-6) * pixels.pixel_mm)[:, None]
    images = (*stress.principal, order)
    return [np.where(material, image, np.nan).astype(np.float32) for image in images]
