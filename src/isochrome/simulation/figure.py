"""The picture that `simulate` leaves: the fringes of each state, pressure and worn depth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import (
    BOLD_PT,
    FINE_PT,
    FRAME_MAP,
    LINE_COLOURS,
    add_legend,
    new_figure,
    plain_name,
    show_image,
    style_axes,
    write_head,
)
from isochrome.scene import Scene
from isochrome.stress import PixelGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from isochrome.simulation.rendering import Rendered


def simulation_figure(scene: Scene, pixels: PixelGrid, items: list[Rendered]) -> Figure:
    """Simulated frames on millimetre axes; for a contact, pressure and worn depth below them.

    Parameters: `scene`; `pixels`; `items`, up to six rendered states. Returns a Figure.
    """
    cols = min(3, len(items))
    image_rows = -(-len(items) // cols)
    curves = items[0].state.surface is not None
    aspect = pixels.rows / pixels.cols
    height = image_rows * (3.6 * aspect + 0.7) + (3.2 if curves else 0.3) + 0.4
    figure = new_figure(max(3.9 * cols + 0.5, 7.5 if curves else 0.0), height)
    upper: Any = figure
    lower: Any = None
    if curves:
        both: Any = figure.subfigures(2, 1, height_ratios=[height - 3.6, 3.2])
        upper, lower = both
    axes = upper.subplots(image_rows, cols, squeeze=False).ravel()
    bits = scene.camera.bit_depth if scene.camera is not None else None
    for ax, item in zip(axes, items, strict=False):
        largest = float(np.nanmax(item.picture.order))
        show_image(
            ax,
            item.frames[0],
            pixel_mm=pixels.pixel_mm,
            left_mm=pixels.left_mm,
            top_mm=pixels.top_mm,
            cmap=FRAME_MAP,
            vmin=0,
            vmax=1.0 if bits is None else 2**bits - 1,
            title=f"{item.state.label}: N up to {largest:.2f}",
        )
    for ax in axes[len(items) :]:
        ax.set_visible(False)
    if lower is not None:
        _curves(lower.subplots(1, 2), items)
        if len(items) > 1:
            handles, labels = lower.axes[0].get_legend_handles_labels()
            add_legend(lower, handles, labels, loc="outside right center")
    steps = len(scene.polariscope.step)
    which = f"rendered frames, the first of {steps} steps" if steps > 1 else "rendered frames"
    write_head(upper, f"{plain_name(scene.name)}, simulated ({which})")
    return figure


def _curves(axes: np.ndarray, items: list[Rendered]) -> None:
    """Pressure and worn depth along the surface, one line a state."""
    widest = 0.0
    for item, colour in zip(items, LINE_COLOURS * 2, strict=False):
        surface = item.state.surface
        assert surface is not None
        x = surface.grid.x_mm
        widest = max(widest, *(abs(edge) for edge in surface.edges_mm))
        axes[0].plot(x, surface.pressure_mpa, color=colour, lw=BOLD_PT, label=item.state.label)
        axes[1].plot(
            x, 1e3 * surface.wear_depth_mm, color=colour, lw=BOLD_PT, label=item.state.label
        )
    axes[1].invert_yaxis()
    for ax, name in zip(axes, ("pressure p (MPa)", "worn depth h (µm)"), strict=True):
        style_axes(ax, x_label="x (mm)", z_label=name)
        ax.set_xlim(-1.25 * widest, 1.25 * widest)
        ax.grid(alpha=0.3, lw=FINE_PT)
