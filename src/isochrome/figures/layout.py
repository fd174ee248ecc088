"""How the panels of a figure for a paper stand: rows, columns and heights, low enough for a page.

Pictures stand in a grid, plots flow in rows below it. What is taller than a page is laid out
closer: pictures beside each other, lower plots, and at last without the plots that may be missing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from isochrome.figures.fitted_text import width_mm, wrap_note
from isochrome.figures.panels import FigureStyle, PaperPanels, Plot
from isochrome.figures.style import PAPER_LINE_MM

PAGE_MM = 230.0
"""Height that a journal's page leaves for a figure."""
_BESIDE_MM = 36.0
"""Narrowest picture whose kinds stand beside each other."""
_LEAST_MM, _LEAST_OF_COLUMN_MM = 40.0, 24.0
"""Narrowest picture of several items, in a wide figure and in one of a column."""
_COLUMN_MM = 120.0
"""Width below which a figure is one of a column."""
_PLOT_MM = 70.0
"""Narrowest plot, with its labels."""
_KEY_MM = 14.0
"""Room of a line in a legend, and between its columns."""
_AROUND_MM = 12.0
"""Room of a picture's title and numbers, to begin with."""
_SLACK_MM = 1.0
"""How far pictures, drawn again, may come out taller."""
_STEPS = 50
"""Heights of plots that are tried, from the full one to the lowest."""


@dataclass(frozen=True)
class FigureLayout:
    """How the panels stand, for a width."""

    panels: PaperPanels
    style: FigureStyle
    is_close: bool = False  # pictures stand beside each other at the narrowest
    lowered: float = 0.0  # how far the plots are, 0 to 1: to the least height of each
    left_out: tuple[Plot, ...] = ()  # no room on the page

    @cached_property
    def notes(self) -> str:
        """The notes, in lines of the figure's width; empty where they are not asked for."""
        if not (self.panels.notes and self.style.numbers):
            return ""
        return "\n".join(wrap_note(note, self.style.width_mm - 2.0) for note in self.panels.notes)

    @property
    def blocks(self) -> dict[str, float]:
        """The blocks of a figure, from the top, with their first heights in mm."""
        found: dict[str, float] = {}
        if self.panels.kinds:
            rows, cols = self.grid
            found["pictures"] = rows * (0.75 * self.style.width_mm / cols + _AROUND_MM) + _AROUND_MM
        if self.panels.plots:
            found["plots"] = sum(map(self.plot_height, self.plot_rows)) + self.legend_height
        if self.notes:
            found["notes"] = PAPER_LINE_MM * (self.notes.count("\n") + 1.5)
        return found

    @cached_property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the pictures: the kinds beside each other where they fit, else the
        items, of which all rows of a kind come together.
        """
        kinds, items = len(self.panels.kinds), len(self.panels.labels)
        width = self.style.width_mm
        if items == 1:
            least = _LEAST_OF_COLUMN_MM if self.is_close else _BESIDE_MM
            across = max(1, min(kinds, int(width / least)))
            return math.ceil(kinds / across), across
        if self._is_row_an_item:
            return items, kinds
        least = _LEAST_OF_COLUMN_MM if width < _COLUMN_MM else _LEAST_MM
        most = max(1, int(width / least))
        across = math.ceil(items / math.ceil(items / most))  # rows of one length, or nearly
        return kinds * math.ceil(items / across), across

    @property
    def _is_row_an_item(self) -> bool:
        """Whether kinds of several items stand beside each other, a row an item."""
        kinds = len(self.panels.kinds)
        return kinds > 2 and self.style.width_mm / kinds >= _BESIDE_MM

    @property
    def places(self) -> dict[tuple[int, int], tuple[int, int]]:
        """Row and column of each kind's picture of each item."""
        rows, cols = self.grid
        kinds, items = len(self.panels.kinds), len(self.panels.labels)
        pairs = [(j, k) for j in range(kinds) for k in range(items)]
        if items == 1:
            return {(j, k): (j // cols, j % cols) for j, k in pairs}
        if self._is_row_an_item:
            return {(j, k): (k, j) for j, k in pairs}
        own = rows // kinds
        return {(j, k): (j * own + k // cols, k % cols) for j, k in pairs}

    @cached_property
    def plot_rows(self) -> list[list[Plot]]:
        """Plots in rows, as many beside each other as fit."""
        plots = [plot for plot in self.panels.plots if plot not in self.left_out]
        most = max(1, min(int(self.style.width_mm / _PLOT_MM), self.panels.plots_across))
        down = math.ceil(len(plots) / most)
        across = math.ceil(len(plots) / down)
        return [plots[k : k + across] for k in range(0, len(plots), across)]

    def plot_height(self, row: Sequence[Plot]) -> float:
        """Height of a row of plots with their titles and labels, mm; lower in a column's figure."""
        share = 1.0 if self.style.width_mm >= _COLUMN_MM else 0.8
        full = [share * plot.height_mm for plot in row]
        least = [min(own, plot.least_mm) for own, plot in zip(full, row, strict=True)]
        pairs = zip(full, least, strict=True)
        return max(a + self.lowered * (b - a) for a, b in pairs) + 4.0 * PAPER_LINE_MM

    @cached_property
    def legend_columns(self) -> int:
        """Columns of the legend below the plots."""
        names = self.panels.legend
        longest = max(map(width_mm, names)) + _KEY_MM
        return max(1, min(len(names), int(self.style.width_mm / longest)))

    @property
    def legend_height(self) -> float:
        """Height of the legend below the plots, mm; 0 where there is none."""
        if not self.panels.legend:
            return 0.0
        lines = math.ceil(len(self.panels.legend) / self.legend_columns)
        return (1.4 * lines + 0.6) * PAPER_LINE_MM

    def closer(self) -> FigureLayout:
        """Give the layout with its pictures as near to each other as they may be."""
        return replace(self, is_close=True)

    def within_page(self, tall_mm: float) -> FigureLayout:
        """Give a layout whose plots leave the figure low enough for a page.

        Parameters: `tall_mm`, the height that the figure has by this one. Returns the one that
        leaves out the fewest plots and lowers them the least; this one where none is low enough.
        """
        if tall_mm <= PAGE_MM:
            return self
        rest = tall_mm - self.blocks.get("plots", 0.0)
        room = PAGE_MM - _SLACK_MM - rest
        return next((one for one in self._lower() if one.blocks.get("plots", 0.0) <= room), self)

    def _lower(self) -> Iterator[FigureLayout]:
        """Layouts with lower and lower plots, then with fewer and fewer of them."""
        plots = sorted(self.panels.plots, key=lambda plot: -plot.spare)
        spare = [plot for plot in plots if plot.spare]
        for count in range(len(spare) + 1):
            for step in range(_STEPS + 1):
                left_out = tuple(spare[:count])
                yield replace(self, left_out=left_out, lowered=step / _STEPS)
