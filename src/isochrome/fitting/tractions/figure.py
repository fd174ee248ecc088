"""The picture of tractions: what presses and rubs, the residual, the principal stresses apart."""

from __future__ import annotations

from collections.abc import Iterable
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
from isochrome.fitting.figure import picture_place, show_residual
from isochrome.fitting.frame.model_frame import fitted_light
from isochrome.fitting.frame.renderer import scene_optics
from isochrome.fitting.tractions.continuation import node_runs
from isochrome.fitting.tractions.surface_fit import Tractions
from isochrome.optics import mean_order, pixel_visibility
from isochrome.scene import Scene
from isochrome.simulation import scene_states
from isochrome.stress import StressComponents

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_SHOWN = 4
_WIDE = 1.96


def tractions_figure(
    name: str, frames: Iterable[FrameData], scenes: tuple[Scene, ...], found: tuple[Tractions, ...]
) -> Figure:
    """Tractions with their 95 % bands, residual, and both principal stresses, for four frames.

    Parameters: `name` of the scene; `frames`; `scenes`, one state each, whose model is drawn
    beside; `found`, their tractions. Returns a Figure.
    """
    count = min(_SHOWN, len(found))
    shown = np.unique(np.linspace(0, len(found) - 1, count).round().astype(int))
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
        _draw_residual(axes[0, 1], wanted[i], one, scene, stress)
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
        step = np.diff(one.x_mm)
        for i, j in node_runs(np.ones(len(one.x_mm), bool), step <= 1.5 * step.min(initial=np.inf)):
            x, p, u = one.x_mm[i:j], values[i:j], _WIDE * spread[i:j]
            ax.fill_between(x, p - u, p + u, color=colour, alpha=0.25, lw=0)
            ax.plot(x, p, color=colour, lw=BOLD_PT, label=label if i == 0 else None)
    ax.axhline(0.0, color=INK, lw=FINE_PT)
    ax.set_xlim(pixels.left_mm, pixels.left_mm + pixels.cols * pixels.pixel_mm)
    style_axes(ax, x_label="x (mm)", z_label="traction (MPa)", title=title)
    add_legend(ax)


def _draw_residual(
    ax: Axes, data: FrameData, one: Tractions, scene: Scene, stress: StressComponents
) -> None:
    pixels, optics = one.pixels, scene_optics(scene)
    if scene.frames.stated_gamma != data.gamma:
        data = data.toned(scene.frames.stated_gamma)
    order = optics.order(stress.difference).astype(float)
    visibility = pixel_visibility(order)[0]
    signal = optics.signal(stress.difference, order=mean_order(order), visibility=visibility)
    mask = data.valid & (pixels.z_mm >= 0.5 * pixels.pixel_mm)[:, None]
    illumination, background, _ = fitted_light(data, signal, mask)
    title = f"residual, chi = {one.chi:.2f}"
    model = illumination * signal + background
    show_residual(ax, data, model, mask, title=title, **picture_place(pixels))


def _draw_principal(axes: Any, one: Tractions, stress: StressComponents) -> None:
    pixels = one.pixels
    material = (pixels.z_mm >= 0.5 * pixels.pixel_mm)[:, None]
    for ax, image, name in zip(axes, stress.principal, ("σ₁", "σ₂"), strict=True):
        shown = np.where(material, image, np.nan)
        limit = centred_limit(shown, percentile=99.8)
        show_image(
            ax, shown, cmap=DIFFERENCE_MAP, vmin=-limit, vmax=limit,
            title=f"principal stress {name}", colour_label=f"{name} (MPa), tension positive",
            **picture_place(pixels),
        )  # fmt: skip
