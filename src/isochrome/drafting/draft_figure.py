"""The preview of a draft: the frame as the scene takes it, and the scene's fringes beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.drafting.scene_draft import DraftValue
from isochrome.estimation import FrameData
from isochrome.figures import (
    FRAME_MAP,
    LINE_PT,
    OVERLAY_COLOUR,
    Place,
    add_legend,
    new_figure,
    show_image,
    write_head,
)
from isochrome.fitting import evaluate_model
from isochrome.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.floating]

_WIDTH_IN, _IN_A_LINE = 6.0, 3
"""Width of a picture, and values in a line of the head."""


def draft_figure(data: FrameData, scene: Scene, values: Sequence[DraftValue]) -> Figure:
    """Draw a frame beside what a scene says of it, its surface and middle over both.

    The `data` are the frame as the scene, of one state, takes it.
    """
    model_frame = evaluate_model(data, scene)
    light = model_frame.background + model_frame.illumination * np.nan_to_num(model_frame.signal)
    stored = np.maximum(light, 0.0) ** (1.0 / scene.frames.stated_gamma)
    model = np.where(model_frame.picture.material, stored, np.nan)
    rows, cols = data.shape
    figure = new_figure(2.0 * _WIDTH_IN, _WIDTH_IN * rows / cols + 0.9)
    place: Place = {
        "pixel_mm": model_frame.pixels.pixel_mm,
        "left_mm": model_frame.pixels.left_mm,
        "top_mm": model_frame.pixels.top_mm,
    }
    low, high = (float(v) for v in np.percentile(data.raw, [0.5, 99.5]))
    panels: Any = figure.subplots(1, 2)
    for axes, image, title in zip(
        panels, (data.raw, model), ("the frame", "the scene that was found"), strict=True
    ):
        show_image(axes, image, cmap=FRAME_MAP, vmin=low, vmax=high, title=title, **place)
        _draw_zeros(axes)
    write_head(figure, _head(values))
    add_legend(figure, *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _head(values: Sequence[DraftValue]) -> str:
    """What was found besides the place, which the axes show."""
    texts = [
        f"{value.key} = {value.words}"
        for value in values
        if value.origin == "found" and value.key not in ("camera.left_mm", "camera.top_mm")
    ]
    lines = (texts[k : k + _IN_A_LINE] for k in range(0, len(texts), _IN_A_LINE))
    return "\n".join("    ".join(line) for line in lines)


def _draw_zeros(axes: Any) -> None:
    """The surface and the middle of what presses on it, as far as the picture shows them."""
    ends = axes.get_xlim(), axes.get_ylim()
    look: dict[str, Any] = {"color": OVERLAY_COLOUR, "lw": LINE_PT}
    axes.axhline(0.0, ls="-", label="surface, or top (z = 0)", **look)
    axes.axvline(0.0, ls=":", label="middle (x = 0)", **look)
    axes.set_xlim(ends[0])
    axes.set_ylim(ends[1])


def frame_figure(image: Floats) -> Figure:
    """Draw a frame (rows, cols), of which nothing is known."""
    rows, cols = image.shape
    figure = new_figure(_WIDTH_IN, _WIDTH_IN * rows / cols + 0.9)
    low, high = (float(v) for v in np.nanpercentile(image, [0.5, 99.5]))
    axes = figure.subplots()
    show_image(axes, image, cmap=FRAME_MAP, vmin=low, vmax=high, title="the frame")
    return figure
