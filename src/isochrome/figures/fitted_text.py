"""Texts of a figure broken into lines that fit, and numbers at axes that do not touch."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import TYPE_CHECKING

from isochrome.figures.style import PAPER_LINE_MM, PAPER_PT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.text import Text

_UNIT = re.compile(r"(?<=\d) (?=(?:m|mm|µm|N|px|fringes?)\b|%)")
"""The space between a number and its unit, where no line ends."""
_PT_PER_MM = 72.0 / 25.4
_LEGEND_SHARE, _KEY_MM = 0.7, 9.0
"""Widest legend over its axes, and the room of a line beside its name."""
_LEAST_MM = 15.0
"""A line of text that is never broken further."""
_TICK_MM, _BETWEEN_MM = 10.0, 3.0
"""Least room of a number at a horizontal axis, and what is free between two of them."""
_BAR = "<colorbar>"
"""What Matplotlib calls the axes of a colour bar."""
_FOR_THREE, _MOST_NUMBERS = 3.5, 6
"""Room, in numbers, for three of them; and the most."""
_STEPS = [1, 2, 2.5, 5, 10]
"""Round steps from number to number."""
_OVER_MM = 0.5
"""How far one of two numbers may stand out beyond its axis."""
_EDGE_MM = 1.5
"""What stays free at the figure's edge."""
_TICK_DOWN_MM = 7.0
"""Room of a number at a vertical axis."""


@lru_cache(maxsize=4096)
def width_mm(text: str) -> float:
    """Width of a line of text in the figure's font and size."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    if not text.strip():
        return 0.0
    path = TextPath((0.0, 0.0), text, size=PAPER_PT, prop=FontProperties(), usetex=False)
    return float(path.get_extents().width) / _PT_PER_MM


def wrap_note(text: str, room_mm: float) -> str:
    """Break a text at its spaces, its own line breaks too, into lines that fit.

    A word that is too long stands alone, and is broken where it must be.
    """
    lines, line = list[str](), ""
    held = _UNIT.sub("\u00a0", " ".join(text.splitlines()))
    for word in held.split(" "):
        longer = f"{line} {word}".strip()
        if line and width_mm(longer) > room_mm:
            lines.append(line)
            longer = word
        while width_mm(longer) > room_mm and len(longer) > 1:
            fitting = next(
                n
                for n in range(len(longer) - 1, 0, -1)
                if n == 1 or width_mm(longer[:n]) <= room_mm
            )
            lines.append(longer[:fitting])
            longer = longer[fitting:]
        line = longer
    return "\n".join([*lines, line])


class FittedTexts:
    """The titles, labels, legends and numbers of a figure, fitted to its axes again and again.

    The figure's texts have the paper's size.
    """

    def __init__(self, figure: Figure) -> None:
        from matplotlib.axes import Axes
        from matplotlib.ticker import AutoLocator

        self.figure = figure
        self.axes = [axes for axes in figure.findobj(Axes) if axes.get_visible() and axes.axison]
        self._whole = {text: text.get_text() for axes in self.axes for text in _texts(axes)}
        self._thinned = [
            (axes, axis)
            for axes in self.axes
            for axis in (axes.xaxis, axes.yaxis)
            if isinstance(axis.get_major_locator(), AutoLocator)
            or (axes.get_label() == _BAR and axis is axes.xaxis)
        ]

    def fit(self) -> None:
        """Break what is longer than its axes, and give the numbers at axes their room."""
        for text, words in self._whole.items():
            text.set_text("x"[: len(words)])  # so that no text pushes the axes that it is to fit
        self.figure.draw_without_rendering()
        self.wrap()
        for axes, axis in self._thinned:
            wide, high = _size_mm(axes)
            if axis is axes.xaxis:
                longest = max(
                    (width_mm(text.get_text()) for text in axis.get_ticklabels()), default=0
                )
                _thin(axis, wide / max(_TICK_MM, longest + _BETWEEN_MM))
                _give_two(axis, wide, width_mm)
            else:
                _thin(axis, high / _TICK_DOWN_MM)
                _give_two(axis, high, _height_mm)

    def wrap(self) -> None:
        """Break what is longer than its axes are now: the texts at the sides have made them so."""
        for axes in self.axes:
            wide, high = _size_mm(axes)
            title, across, up, *names = _texts(axes)
            beside = _free_beside_mm(axes)
            for text, middle in ((title, 0.0), (across, 0.5)):
                more = min(max(width_mm(self._whole[text]) - wide, 0.0), beside)
                text.set_x(middle - (1.0 - middle) * more / wide)
                text.set_text(wrap_note(self._whole[text], max(wide + more, _LEAST_MM)))
            for text, room in ((up, high), *((n, _LEGEND_SHARE * wide - _KEY_MM) for n in names)):
                text.set_text(wrap_note(self._whole[text], max(room, _LEAST_MM)))


def _texts(axes: Axes) -> list[Text]:
    """The title at the left, which setting it to what it is gives; labels; names of a legend."""
    title = axes.set_title(axes.get_title(loc="left"), loc="left", fontsize=PAPER_PT)
    legend = axes.get_legend()
    return [title, axes.xaxis.label, axes.yaxis.label, *(legend.get_texts() if legend else ())]


def _free_beside_mm(axes: Axes) -> float:
    """Room at the left of axes for their title and label, mm: names of bars leave them narrow.

    That of a picture in a grid may be its neighbour's.
    """
    part = axes.figure
    assert part is not None
    if len({tuple(own.get_position(original=True).bounds) for own in part.axes}) > 1:
        return 0.0
    start = float(axes.get_position(original=True).x0 * part.bbox.width)
    return max(0.0, start * 25.4 / part.figure.dpi - _EDGE_MM)


def _size_mm(axes: Axes) -> tuple[float, float]:
    """Width and height of the place of axes, which a picture fills in the end, mm.

    A colour bar has a shape of its own, and does not fill its place.
    """
    place, part = axes.get_position(original=axes.get_label() != _BAR), axes.figure
    assert part is not None
    scale = 25.4 / part.figure.dpi
    return place.width * part.bbox.width * scale, place.height * part.bbox.height * scale


def _height_mm(text: str) -> float:
    """Height of a number, mm."""
    return PAPER_LINE_MM if text else 0.0


def _give_two(axis: Axis, long_mm: float, size_mm: Callable[[str], float]) -> None:
    """Two numbers where there would be one, which tells no scale: the outermost that have room.

    Parameters: `axis`; its length `long_mm`; `size_mm` of a number along it. A number stands
    within its axis, for there may be others beside it.
    """
    from matplotlib.ticker import FixedLocator, MaxNLocator

    low, high = sorted(axis.get_view_interval())
    scale = long_mm / (high - low)
    if len(_inside(axis.get_major_locator().tick_values(low, high), low, high)) > 1:
        return
    for most in range(2, 2 * _MOST_NUMBERS):  # the roundest first
        found = MaxNLocator(most, steps=_STEPS, min_n_ticks=1).tick_values(low, high)
        values = _inside(found, low, high)
        halves = [0.5 * size_mm(text) for text in axis.get_major_formatter().format_ticks(values)]
        whole = [
            (value, half)
            for value, half in zip(values, halves, strict=True)
            if min(value - low, high - value) * scale > half - _OVER_MM
        ]
        if len(whole) < 2:
            continue
        (first, own), (last, other) = whole[0], whole[-1]
        if (last - first) * scale >= own + other + _BETWEEN_MM:
            axis.set_major_locator(FixedLocator([first, last]))
            return


def _inside(values: Iterable[float], low: float, high: float) -> list[float]:
    """Those of some numbers that an axis from `low` to `high` shows."""
    close = 1e-9 * (high - low)
    return [float(value) for value in values if low - close <= value <= high + close]


def _thin(axis: Axis, room: float) -> None:
    """As many numbers at an axis as there is room for."""
    from matplotlib.ticker import MaxNLocator

    least = 3 if room >= _FOR_THREE else 1
    most = max(1, min(int(room), _MOST_NUMBERS))
    axis.set_major_locator(MaxNLocator(most, steps=_STEPS, min_n_ticks=least))
