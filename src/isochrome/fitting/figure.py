"""The pictures that `fit` leaves: frame, model and what is left over; values over distance."""

from __future__ import annotations

from contextlib import closing
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
    add_legend,
    draw_budget,
    draw_values,
    new_figure,
    plain_name,
    show_image,
    style_axes,
    write_head,
)
from isochrome.fitting.arrays import Array, Mask
from isochrome.fitting.frame.model_frame import evaluate_model
from isochrome.fitting.frame_set import Lights, PreparedFrames
from isochrome.fitting.result import Fit
from isochrome.output import evenly_spaced
from isochrome.scene import FramesLike, Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN, _COLUMNS = 6, 3


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
    wanted = {i: frames[i] for i in shown}
    rows, cols = wanted[0].light.shape
    figure = new_figure(13.0, (3.9 * min(rows / cols, 1.6) + 0.75) * len(shown) + 0.5)
    axes: Any = figure.subplots(len(shown), 3, squeeze=False)
    for row, k in zip(axes, shown, strict=True):
        data, evaluated = wanted[k], evaluate_model(wanted[k], scenes[k])
        model = evaluated.background + evaluated.illumination * evaluated.signal(1)
        place = evaluated.pixels.scale
        top = float(np.percentile(data.light[data.valid], 99.8))
        for axis, image, valid, title in (
            (row[0], data.light, data.valid, f"frame {k}: captured"),
            (row[1], model, evaluated.picture.material, "fitted model"),
        ):
            shown_image = np.where(valid, image, np.nan)
            show_image(axis, shown_image, cmap=FRAME_MAP, vmin=0, vmax=top, title=title, **place)
        show_residual(
            row[2], data, model, evaluated.mask, title=f"chi = {evaluated.chi:.2f}", **place
        )
    write_head(figure, f"{plain_name(name)}: fit to the intensity")
    return figure


def show_residual(axis: Axes, data: FrameData, model: Array, mask: Mask, **options: Any) -> None:
    """A frame's light less a model's (rows, cols), over the noise, where the mask is True."""
    residual = np.where(mask, (data.light - model) / data.sigma, np.nan)
    label = "(captured - fitted) / noise"
    show_image(axis, residual, cmap=DIFFERENCE_MAP, vmin=-5, vmax=5, colour_label=label, **options)


def _panels(count: int, columns: int, width: float, height: float) -> tuple[Figure, list[Any]]:
    """A figure of `count` panels of a width and height (inches), and their axes."""
    rows = -(-count // columns)
    figure = new_figure(width * columns, height * rows + 0.4)
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axis in axes[count:]:
        axis.set_axis_off()
    return figure, axes


def over_distance_figure(name: str, result: Fit) -> Figure | None:
    """Each per-frame key, and the wear, over the distance; None where nothing is per frame."""
    values = result.over_frames
    keys = values.keys
    count = len(keys) + (result.wear_laws is not None)
    if len(result.frames) < 2 or not count:
        return None
    columns = min(_COLUMNS, -(-count // -(-count // _COLUMNS)))
    figure, axes = _panels(count, columns, 4.6, 3.5)
    for axis, key in zip(axes, keys, strict=False):
        draw_values(axis, values, key)
    if result.wear_laws is not None:
        _wear(axes[len(keys)], result)
    write_head(
        figure, f"{plain_name(name)}: values of each frame, band ± {BAND:g} standard uncertainties"
    )
    return figure


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
    style_axes(
        axis,
        x_label="sliding distance (m)",
        z_label="mean wear coefficient (mm²/N)",
        title="worn between frames, and by each law",
    )
    add_legend(axis)


def budget_figure(name: str, result: Fit) -> Figure:
    """Each value's uncertainty budget as bars; of several frames' own, the mean square."""
    keys = tuple(dict.fromkeys(budget.key for budget in result.budget))
    figure, axes = _panels(len(keys), min(_COLUMNS, len(keys)), 5.0, 3.0)
    for axis, key in zip(axes, keys, strict=False):
        squares: dict[str, list[float]] = {}
        for budget in result.budget:
            for item in budget.inputs if budget.key == key else ():
                squares.setdefault(item.input, []).append(item.contribution**2)
        sizes = {name: float(np.sqrt(np.mean(variances))) for name, variances in squares.items()}
        parts = dict(sorted(sizes.items(), key=lambda item: -item[1]))
        draw_budget(axis, parts, x_label=f"contribution to u({key})", title=key)
    write_head(figure, f"{plain_name(name)}: uncertainty budget")
    return figure
