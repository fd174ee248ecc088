"""Texts of a figure broken into lines that fit, and numbers at axes that do not touch."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from isochrome.figures.style import PAPER_PT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PT_PER_MM = 72.0 / 25.4
_TICK_MM = 10.0
"""Room of a number at a horizontal axis."""
_TICK_DOWN_MM = 7.0
"""Room of a number at a vertical axis."""


@lru_cache(maxsize=4096)
def width_mm(text: str) -> float:
    """Measure a line of text in the figure's font and size.

    Parameters
    ----------
    text : str
        One line.

    Returns
    -------
    float
        Its width, mm.
    """
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    if not text.strip():
        return 0.0
    path = TextPath((0.0, 0.0), text, size=PAPER_PT, prop=FontProperties(), usetex=False)
    return float(path.get_extents().width) / _PT_PER_MM


def wrap_note(text: str, room_mm: float) -> str:
    """Break a text at its spaces into lines that fit.

    Parameters
    ----------
    text : str
        The text; its own line breaks are spaces.
    room_mm : float
        Width of a line, mm.

    Returns
    -------
    str
        The lines. A word that is too long stands alone, and is broken where it must be.
    """
    lines, line = list[str](), ""
    for word in " ".join(text.splitlines()).replace(" %", "\u00a0%").split(" "):
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


def fit_texts(figure: Figure) -> None:
    """Break titles and labels that are longer than their axes, and thin their numbers.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        A figure whose texts have the paper's size.
    """
    from matplotlib.axes import Axes

    figure.draw_without_rendering()
    per_mm = figure.dpi / 25.4
    for axes in figure.findobj(Axes):
        assert isinstance(axes, Axes)
        if not axes.get_visible() or not axes.axison:
            continue
        box = axes.get_window_extent()
        wide, high = box.width / per_mm, box.height / per_mm
        left = axes.get_title(loc="left")
        if left:
            axes.set_title(wrap_note(left, wide), loc="left", fontsize=PAPER_PT)
        axes.set_xlabel(wrap_note(axes.get_xlabel(), max(wide, 15.0)))
        axes.set_ylabel(wrap_note(axes.get_ylabel(), max(high, 15.0)))
        _thin_numbers(axes, wide, high)


def _thin_numbers(axes: Axes, wide: float, high: float) -> None:
    """As many numbers at an axis as there is room for."""
    from matplotlib.ticker import AutoLocator, MaxNLocator

    rooms: tuple[tuple[Any, float], ...] = (
        (axes.xaxis, wide / _TICK_MM),
        (axes.yaxis, high / _TICK_DOWN_MM),
    )
    for axis, room in rooms:
        if isinstance(axis.get_major_locator(), AutoLocator):
            axis.set_major_locator(MaxNLocator(max(1, min(int(room), 6)), steps=[1, 2, 2.5, 5, 10]))
