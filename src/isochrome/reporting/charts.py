"""Values over distance or frames as drawings in the page, with their bands, however many."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isochrome.figures import (
    BAND,
    FINE_PT,
    KEY_LABELS,
    LINE_COLOURS,
    LINE_PT,
    PALE,
    frame_axis,
    new_figure,
    style_axes,
)
from isochrome.output import FrameValues

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[Any]

MOST_POINTS = 240
"""Points of a curve: more than a drawing has pixels to tell them apart."""

_INCHES = 4.0, 2.3
"""Of a drawing, whose letters are then those of a page where a telephone shows it."""

_SVG: Any = {"svg.fonttype": "path", "svg.hashsalt": "isochrome", "text.parse_math": False}
"""The same drawing on every machine and each time; a `$` in a name is no formula."""

_UNDATED = dict.fromkeys(("Date", "Creator", "Format", "Type"))


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A quantity over distance or frames; each point (n,) is some neighbours together where there
    are many.
    """

    label: str  # name and unit of the quantity
    across: str  # name and unit of the horizontal axis
    place: Array
    value: Array  # their mean
    least: Array  # envelope of the values
    most: Array
    low: Array  # envelope of the bands
    high: Array
    together: int  # how many values are one point, at most
    has_band: bool  # the values have uncertainties

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The points as a table: place, value, least, most, low, high."""
        columns = self.place, self.value, self.least, self.most, self.low, self.high
        return [tuple(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True)]

    def draw(self, axes: Axes) -> None:
        """Draw the line between its envelope and its band; few points have dots."""
        colour = LINE_COLOURS[0]
        axes.fill_between(self.place, self.low, self.high, color=colour, alpha=0.25, lw=0)
        axes.fill_between(self.place, self.least, self.most, color=colour, alpha=0.35, lw=0)
        dot = "o" if len(self.place) <= MOST_POINTS // 6 else ""
        axes.plot(self.place, self.value, color=colour, lw=LINE_PT, marker=dot, ms=4)

    @property
    def svg(self) -> str:
        """The drawing as base64: a picture of its own, as the page's policy forbids its styles."""
        from matplotlib import rc_context

        content = io.BytesIO()
        with rc_context(_SVG):
            figure = new_figure(*_INCHES)
            axes = figure.subplots()
            self.draw(axes)
            axes.ticklabel_format(useOffset=False)
            axes.locator_params(nbins=5)  # numbers of a long run have room beside each other
            axes.grid(color=PALE, alpha=0.5, lw=FINE_PT)
            axes.set_axisbelow(True)
            style_axes(axes, x_label=self.across)
            figure.savefig(content, format="svg", metadata=_UNDATED)
        return base64.b64encode(content.getvalue()).decode()


def curves_of(found: FrameValues) -> list[Curve]:
    """The curves of fitted values, each with its band, and one of chi.

    One for each key that is known in two frames at least; a tracked video's places too.
    """
    place, across = frame_axis(found)
    place = np.where(np.isfinite(place), place, 0.0)  # what stands still has slid by nothing
    columns: list[tuple[str, Array, Array | None]] = [
        (KEY_LABELS.get(key, key), found.values[:, j], found.standard_uncertainty[:, j])
        for j, key in enumerate(found.keys)
    ]
    columns.append(("chi (residual over noise)", found.chi, None))
    return [
        make_curve(label, across, place, values, own)
        for label, values, own in columns
        if np.isfinite(values).sum() > 1
    ]


def make_curve(
    label: str, across: str, place: Array, values: Array, spread: Array | None = None
) -> Curve:
    """A quantity's curve: what is not known is left out, and many are put together.

    At least one value is known; `spread` is their standard uncertainties, None: they have none.
    """
    own = np.zeros(len(values)) if spread is None else spread
    known = np.flatnonzero(np.isfinite(values))
    known = known[np.argsort(place[known], kind="stable")]
    half = BAND * np.where(np.isfinite(own), own, 0.0)
    together = -(-len(known) // MOST_POINTS)
    starts = np.arange(0, len(known), together)
    counts = np.diff([*starts, len(known)])
    return Curve(
        label=label,
        across=across,
        place=np.add.reduceat(place[known], starts) / counts,
        value=np.add.reduceat(values[known], starts) / counts,
        least=np.minimum.reduceat(values[known], starts),
        most=np.maximum.reduceat(values[known], starts),
        low=np.minimum.reduceat((values - half)[known], starts),
        high=np.maximum.reduceat((values + half)[known], starts),
        together=together,
        has_band=spread is not None,
    )
