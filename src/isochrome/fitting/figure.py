"""The pictures that `fit` leaves: frame, model and what is left over; values over distance."""

from __future__ import annotations

from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.estimation import FrameData
from isochrome.figures import (
    BAND,
    BOLD_PT,
    DIFFERENCE_MAP,
    FRAME_MAP,
    GREY,
    INK,
    LINE_COLOURS,
    PaperPanels,
    PictureKind,
    Plot,
    add_legend,
    budget_plot,
    panels_figure,
    plain_name,
    show_image,
    style_axes,
    values_plots,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.model_frame import evaluate_model
from isochrome.fitting.frame_set import Lights, PreparedFrames
from isochrome.fitting.result import Fit
from isochrome.output import evenly_spaced
from isochrome.runs import named_units
from isochrome.scene import FramesLike, Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

_SHOWN = 6
"""Frames that are drawn."""


def figure_of_frames(
    path: FramesLike, scene: Scene, plain: frozenset[int], lights: Lights, scenes: tuple[Scene, ...]
) -> Figure:
    """`fit_figure` of frames that are read once more: they may be many, or gone (InputError)."""
    with closing(PreparedFrames(path, scene)) as frames:
        frames.plain, frames.lights = set(plain), lights
        return fit_figure(scene.name, frames, scenes)


def fit_figure(name: str, frames: PreparedFrames, scenes: tuple[Scene, ...]) -> Figure:
    """Captured light, fitted light, and their difference over the noise, for up to six frames."""
    shown = evenly_spaced(range(len(scenes)), _SHOWN)
    wanted = [frames[k] for k in shown]
    models = [evaluate_model(data, scenes[k]) for k, data in zip(shown, wanted, strict=True)]

    def draw(axes: Axes, k: int, column: int) -> AxesImage:
        data, model = wanted[k], models[k]
        light, place = model.background + model.illumination * model.signal(1), model.pixels.scale
        if column == 2:
            return show_residual(axes, data, light, model.mask, **place)
        pictures = ((data.light, data.valid), (light, model.picture.material))
        image, valid = pictures[column]
        look: dict[str, Any] = {"cmap": FRAME_MAP, "vmin": 0}
        look["vmax"] = float(np.percentile(data.light[data.valid], 99.8))
        return show_image(axes, np.where(valid, image, np.nan), **look, **place)

    bars = {"captured": "", "fitted model": "", "residual": RESIDUAL_LABEL}
    panels = PaperPanels(
        kinds=[
            PictureKind(name=kind, draw=partial(draw, column=column), bar=bar)
            for column, (kind, bar) in enumerate(bars.items())
        ],
        labels=[f"frame {k}, χ = {m.chi:.2f}" for k, m in zip(shown, models, strict=True)],
    )
    return panels_figure(panels, f"{plain_name(name)}: fit to the intensity")


RESIDUAL_LABEL = "(captured - fitted) / noise"


def show_residual(
    axis: Axes, data: FrameData, model: Array, mask: Mask, **options: Any
) -> AxesImage:
    """A frame's light less a model's (rows, cols), over the noise, where the mask is True."""
    residual = np.where(mask, (data.light - model) / data.sigma, np.nan)
    return show_image(axis, residual, cmap=DIFFERENCE_MAP, vmin=-5, vmax=5, **options)


def over_distance_figure(name: str, result: Fit) -> Figure | None:
    """Each per-frame key, and the wear, over the distance; None where nothing is per frame."""
    values = result.over_frames
    if len(result.frames) < 2 or not (values.keys or result.wear_laws):
        return None
    plots = values_plots(values)
    if result.wear_laws is not None:
        title = "worn between frames, and by each law"
        plots.append(Plot(title=title, draw=partial(_wear, result=result)))
    head = f"{plain_name(name)}: values of each frame, band ± {BAND:g} standard uncertainties"
    return panels_figure(PaperPanels(plots=plots), f"{head}\nsquares: static")


def _wear(axis: Axes, result: Fit) -> None:
    """What was worn between the frames, with its band, and what each law gives there."""
    assert result.wear_laws is not None
    between = result.wear_laws.between
    edges = np.array([item["from_m"] for item in between] + [between[-1]["to_m"]])
    value, spread = (
        np.array([item[part] for item in between]) for part in ("value", "standard_uncertainty")
    )
    low, high = (np.repeat(value + sign * BAND * spread, 2) for sign in (-1.0, 1.0))
    x = np.repeat(edges, 2)[1:-1]
    axis.fill_between(x, low, high, color=GREY, alpha=0.35, lw=0)
    axis.stairs(value, edges, color=INK, lw=BOLD_PT, baseline=None, label="between frames")
    for law, colour, style in zip(
        result.wear_laws.laws, LINE_COLOURS[1:], ("--", "-.", ":", (0, (6, 1))), strict=False
    ):
        label = f"{law.law}: ln Z {law.log_evidence:+.3g}" if law.log_evidence else law.law
        axis.stairs(
            law.between, edges, color=colour, ls=style, lw=BOLD_PT, baseline=None, label=label
        )
    style_axes(axis, x_label="sliding distance (m)", z_label="mean wear coefficient (mm²/N)")
    add_legend(axis)


def budget_figure(name: str, result: Fit) -> Figure:
    """Each value's uncertainty budget as bars; of several frames' own, the mean square."""
    plots = []
    for key in dict.fromkeys(budget.key for budget in result.budget):
        squares: dict[str, list[float]] = {}
        for budget in result.budget:
            for item in budget.inputs if budget.key == key else ():
                squares.setdefault(item.input, []).append(item.contribution**2)
        sizes = {name: float(np.sqrt(np.mean(variances))) for name, variances in squares.items()}
        parts = dict(sorted(sizes.items(), key=lambda item: -item[1]))
        plots.append(budget_plot(key, parts, unit=named_units(key).get("units", "1")))
    return panels_figure(PaperPanels(plots=plots), f"{plain_name(name)}: uncertainty budget")
