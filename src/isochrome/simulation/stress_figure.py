"""The picture of the principal stresses that `simulate` leaves where they were asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isochrome.figures import (
    BOLD_PT,
    DIFFERENCE_MAP,
    INK,
    LINE_COLOURS,
    PictureKind,
    add_colour_bar,
    centred_limit,
    new_figure,
    plain_name,
    show_image,
    write_head,
)
from isochrome.scene import Scene
from isochrome.stress import PixelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

    from isochrome.simulation.rendering import Rendered

_NAMES = {"sigma_1": r"$\sigma_1$ (MPa)", "sigma_2": r"$\sigma_2$ (MPa)"}
_PLAIN_NAMES = {"sigma_1": "σ₁", "sigma_2": "σ₂"}
"""The same in letters that are no smaller than the others'."""
_CARET_DOWN = 7
"""Matplotlib's marker with its tip, not its middle, at the place."""


def stress_figure(scene: Scene, pixels: PixelGrid, items: list[Rendered]) -> Figure:
    """Maps of sigma_1 above those of sigma_2, with the largest shear and the contact's edges.

    Red is tension, blue compression; the maps of each stress have one scale.
    Parameters: `scene`; `pixels`; `items`, up to six rendered states with components. Returns a
    Figure.
    """
    cols = min(3, len(items))
    rows = -(-len(items) // cols)
    height = 2 * rows * (3.5 * pixels.rows / pixels.cols + 0.75) + 0.5
    figure = new_figure(3.9 * cols + 1.3, height)
    halves: Any = figure.subfigures(2, 1)
    for half, (name, label) in zip(halves, _NAMES.items(), strict=True):
        axes = half.subplots(rows, cols, squeeze=False).ravel()
        maps = [item.components.maps[name] for item in items if item.components]
        limit = centred_limit(*maps, percentile=99.8)
        drawn = []
        for ax, item, image in zip(axes, items, maps, strict=False):
            drawn.append(_draw_stress(ax, item, image, pixels, limit, title=item.state.label))
        for ax in axes[len(items) :]:
            ax.set_visible(False)
        low, high = _range(maps)
        bar = add_colour_bar(drawn, label)
        bar.ax.set_ylim(max(low, -limit), min(high, limit))
    marks = "× largest shear" + (", ▼ edges of contact" if scene.indenter is not None else "")
    write_head(figure, f"{plain_name(scene.name)}, simulated: principal stresses\n{marks}")
    return figure


def stress_kinds(pixels: PixelGrid, items: Sequence[Rendered]) -> list[PictureKind]:
    """The maps for a paper; none where the principal stresses were not asked for.

    Parameters: `pixels`; `items`, the rendered states. Returns a list of PictureKind.
    """
    found = []
    for name, plain in _PLAIN_NAMES.items():
        maps = [item.components.maps[name] for item in items if item.components]
        if len(maps) == len(items):
            limit = centred_limit(*maps, percentile=99.8)

            def draw(axes: Axes, k: int, maps: Any = maps, limit: float = limit) -> AxesImage:
                return _draw_stress(axes, items[k], maps[k], pixels, limit)

            found.append(PictureKind(name=plain, draw=draw, bar=f"{plain} (MPa)"))
    return found


def _draw_stress(
    axes: Axes, item: Rendered, image: np.ndarray, pixels: PixelGrid, limit: float, title: str = ""
) -> AxesImage:
    """A map, red in tension and blue in compression, with its marks."""
    shown = show_image(
        axes,
        image,
        pixel_mm=pixels.pixel_mm,
        left_mm=pixels.left_mm,
        top_mm=pixels.top_mm,
        cmap=DIFFERENCE_MAP,
        vmin=-limit,
        vmax=limit,
        title=title,
    )
    _mark(axes, item, pixels)
    return shown


def _range(maps: list[np.ndarray]) -> tuple[float, float]:
    """Smallest and largest value of all maps, with zero between them; never empty."""
    low = min(0.0, *(float(np.nanmin(image)) for image in maps))
    high = max(0.0, *(float(np.nanmax(image)) for image in maps))
    return (low, high) if high > low else (-1.0, 1.0)


def _mark(ax: Axes, item: Rendered, pixels: PixelGrid) -> None:
    """A cross where the shear is largest; carets at the edges of contact, where in view."""
    assert item.components is not None
    peak, surface = item.components.peak, item.state.surface
    right = pixels.left_mm + pixels.cols * pixels.pixel_mm
    if surface is not None and pixels.top_mm <= 0.0:
        edges = [x for x in surface.edges_mm if pixels.left_mm <= x <= right]
        ax.plot(edges, [0.0] * len(edges), marker=_CARET_DOWN, color=INK, ls="", clip_on=False)
    ax.plot(peak.x_mm, peak.z_mm, "x", color=LINE_COLOURS[2], ms=8, mew=BOLD_PT, clip_on=False)
    ax.set_xlim(pixels.left_mm, right)
