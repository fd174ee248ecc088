"""The picture of a scale: the points that were found, and what the model leaves of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.calibration.scale.result import ScaleCalibration, ScalePicture
from isochrome.figures import (
    FRAME_MAP,
    LINE_COLOURS,
    OVERLAY_COLOUR,
    TITLE_PT,
    PaperPanels,
    PictureKind,
    budget_plot,
    chosen_frames,
    draw_budget,
    new_figure,
    plain_name,
    show_image,
    write_head,
)
from isochrome.output import with_uncertainty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

MOST_PICTURES = 4
"""Pictures that are shown, the first ones."""

_FOR_PAPER = 2
"""Those of a figure for a paper where nobody names them."""

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
    factor = _factor(calibration, shown)
    for axes, picture in zip(panels[:, 0], shown, strict=True):
        _draw_points(axes, picture, factor)
        axes.set_title(_title(picture, factor), fontsize=TITLE_PT, loc="left")
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


def scale_panels(calibration: ScaleCalibration, frames: tuple[int, ...] | None) -> PaperPanels:
    """The same for a paper.

    Parameters: `calibration`; `frames`, numbers of the pictures that are shown. Returns
    PaperPanels. Raises InputError where there is no such picture.
    """
    images = calibration.images
    few = range(min(len(images), _FOR_PAPER))
    shown = [images[k] for k in chosen_frames(frames, len(images), few, items="pictures")]
    factor = _factor(calibration, shown)

    def draw(axes: Axes, k: int) -> AxesImage:
        return _draw_points(axes, shown[k], factor)

    parts = {item.input: item.contribution for item in calibration.budget}
    values = "; ".join(
        f"{name} = {with_uncertainty(found.value, found.standard_uncertainty)}"
        for name, found in calibration.values.items()
    )
    return PaperPanels(
        kinds=[PictureKind(name="points", draw=draw)],
        labels=[plain_name(picture.file, 24) for picture in shown],
        plots=[budget_plot("budget of pixel_mm", parts, unit="mm")],
        notes=[f"{values}.", *(f"{_title(picture, factor)}." for picture in shown)],
    )


def _factor(calibration: ScaleCalibration, shown: Sequence[ScalePicture]) -> float:
    """How many times as long the residuals are drawn as they are."""
    largest = max(float(np.percentile(np.hypot(*p.residual_px.T), 95)) for p in shown)
    return _round(_LONGEST_ARROW * calibration.shape[1] / max(largest, 1e-9))


def _title(picture: ScalePicture, factor: float) -> str:
    rms = float(np.sqrt(np.mean(picture.residual_px**2)))
    return f"{plain_name(picture.file)}: residual {rms:.3f} px, drawn {factor:g} times as long"


def _draw_points(axes: Axes, picture: ScalePicture, factor: float) -> AxesImage:
    low, high = (float(v) for v in np.percentile(picture.image, [0.5, 99.5]))
    drawn = show_image(axes, picture.image, cmap=FRAME_MAP, vmin=low, vmax=high)
    pick = slice(None, None, -(-len(picture.places) // MOST_POINTS))
    (x, z), (u, v) = picture.places[pick].T, factor * picture.residual_px[pick].T
    axes.plot(x, z, "o", mfc="none", mec=LINE_COLOURS[4], ms=5)
    axes.quiver(
        x, z, u, v, color=OVERLAY_COLOUR, angles="xy", scale_units="xy", scale=1.0, width=0.003
    )
    rows, cols = picture.image.shape
    axes.set_xlim(-0.5, cols - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    return drawn


def _round(factor: float) -> float:
    """A magnification as a round number: 1, 2 or 5 times a power of ten, not above it."""
    decade = 10.0 ** np.floor(np.log10(factor))
    return float(max(step for step in (1.0, 2.0, 5.0) if step * decade <= factor * 1.0001) * decade)
