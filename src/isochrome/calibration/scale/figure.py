"""The picture of a scale: the points that were found, and what the model leaves of each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.calibration.scale.result import ScaleCalibration, ScalePicture
from isochrome.figures import (
    FRAME_MAP,
    LINE_COLOURS,
    OVERLAY_COLOUR,
    draw_budget,
    new_figure,
    plain_name,
    show_image,
    write_head,
)
from isochrome.output import with_uncertainty

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PICTURES = 4
"""Pictures that are shown, the first ones."""

MOST_POINTS = 150
"""Points of a picture that are drawn."""

_LONGEST_ARROW = 0.06
"""Length of the longest arrows, over the picture's width."""


def scale_figure(calibration: ScaleCalibration) -> Figure:
    """Draw each picture with its points and their residuals magnified, and the budget beside it.

    Parameters: `calibration`. Returns a Matplotlib Figure; save it with `output.write_figure`.
    """
    shown = calibration.images[:MOST_PICTURES]
    tall = 7.5 * calibration.shape[0] / calibration.shape[1] + 0.7
    figure = new_figure(13.0, min(max(tall, 3.0), 9.0) * len(shown) + 0.9)
    panels: Any = figure.subplots(len(shown), 2, squeeze=False, width_ratios=[2.2, 1])
    largest = max(float(np.percentile(np.hypot(*p.residual_px.T), 95)) for p in shown)
    factor = _round(_LONGEST_ARROW * calibration.shape[1] / max(largest, 1e-9))
    for axes, picture in zip(panels[:, 0], shown, strict=True):
        _draw_points(axes, picture, factor)
    parts = {item.input: item.contribution for item in calibration.budget}
    title = "uncertainty budget of pixel_mm"
    draw_budget(panels[0, 1], parts, x_label="contribution to u (mm)", title=title)
    for axes in panels[1:, 1]:
        axes.set_axis_off()
    rows = list(calibration.values.items())
    texts = [
        f"{name} = {with_uncertainty(found.value, found.standard_uncertainty)}"
        for name, found in rows
    ]
    head = ["    ".join(texts[:1] + texts[4:]), "    ".join(texts[1:4])]
    write_head(figure, "\n".join(line for line in head if line))
    return figure


def _draw_points(axes: Any, picture: ScalePicture, factor: float) -> None:
    low, high = (float(v) for v in np.percentile(picture.image, [0.5, 99.5]))
    rms = float(np.sqrt(np.mean(picture.residual_px**2)))
    name = f"{plain_name(picture.file)}: residual {rms:.3f} px, drawn {factor:g} times as long"
    show_image(axes, picture.image, cmap=FRAME_MAP, vmin=low, vmax=high, title=name)
    pick = slice(None, None, -(-len(picture.places) // MOST_POINTS))
    (x, z), (u, v) = picture.places[pick].T, factor * picture.residual_px[pick].T
    axes.plot(x, z, "o", mfc="none", mec=LINE_COLOURS[4], ms=5)
    axes.quiver(
        x, z, u, v, color=OVERLAY_COLOUR, angles="xy", scale_units="xy", scale=1.0, width=0.003
    )
    rows, cols = picture.image.shape
    axes.set_xlim(-0.5, cols - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)


def _round(factor: float) -> float:
    """A magnification as a round number: 1, 2 or 5 times a power of ten, not above it."""
    decade = 10.0 ** np.floor(np.log10(factor))
    return float(max(step for step in (1.0, 2.0, 5.0) if step * decade <= factor * 1.0001) * decade)
