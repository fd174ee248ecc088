"""The scale bar of a picture."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from isochrome.figures.style import BOLD_PT, INK, PAPER_PT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHARE = 0.3
"""Longest bar, over the picture's width."""


def bar_length_mm(width_mm: float) -> float:
    """Length of a scale bar: 1, 2 or 5 times a power of ten, at most 0.3 of the picture's width."""
    decade = 10.0 ** math.floor(math.log10(_SHARE * width_mm))
    return decade * max(s for s in (1.0, 2.0, 5.0) if s * decade <= _SHARE * width_mm * 1.000001)


def bar_label(length_mm: float) -> str:
    """The words at a scale bar: its length in mm, or in µm below a tenth of that."""
    return f"{length_mm:g} mm" if length_mm >= 0.1 else f"{1000.0 * length_mm:g} µm"


def add_scale_bar(axes: Axes) -> None:
    """Draw a scale bar on a picture in mm, on a white ground that shows on any picture.

    A picture in pixels gets none.
    """
    from matplotlib.font_manager import FontProperties
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    if "(mm)" not in axes.get_xlabel():
        return
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    length = bar_length_mm(abs(right - left))
    bar = AnchoredSizeBar(
        axes.transData, length, bar_label(length), "lower right", pad=0.25, borderpad=0.3, sep=2.0,
        size_vertical=0.015 * abs(top - bottom), color=INK,
        fontproperties=FontProperties(size=PAPER_PT),
    )  # fmt: skip
    bar.patch.set(facecolor="white", edgecolor="none", linewidth=BOLD_PT)
    axes.add_artist(bar)
