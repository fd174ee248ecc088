"""What a figure for a paper is made of: grids of pictures, plots, and notes, each drawn on Axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from isochrome.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

FORMATS = ("png", "pdf", "svg", "tiff")
"""Formats of a figure for a paper, by the endings of its files."""

NARROWEST_MM, WIDEST_MM = 60.0, 400.0
"""Widths that a figure can have: a label beside a picture fits, and a poster's column."""
LEAST_DPI, MOST_DPI = 50.0, 2400.0


@dataclass(frozen=True, kw_only=True)
class FigureStyle:
    """How a figure for a paper is to be: its width, its frames, and its files.

    `paper_figure` and `save_figure` take it; a command's options --width, --frames, --format, --dpi
    and --numbers say the same.

    Parameters
    ----------
    width_mm : float, default 174.0
        Width of the figure, mm: 85 is usual for one column, 174 for two.
    frames : tuple of int, optional
        Numbers of the frames (states, images) that are shown, from 0; by default the first or
        evenly spaced ones.
    formats : tuple of str, default ('pdf', 'png')
        Files that are written: png, pdf, svg, tiff.
    dpi : float, default 600.0
        Dots per inch of png and tiff.
    numbers : bool, default False
        Whether the numbers of the panels stand below them.

    Raises
    ------
    InputError
        Where a value is not one of these.

    Examples
    --------
    >>> import isochrome
    >>> isochrome.FigureStyle(width_mm=85, formats=("svg",)).dpi
    600.0
    """

    width_mm: float = 174.0
    frames: tuple[int, ...] | None = None
    formats: tuple[str, ...] = ("pdf", "png")
    dpi: float = 600.0
    numbers: bool = False

    def __post_init__(self) -> None:
        if not NARROWEST_MM <= self.width_mm <= WIDEST_MM:
            raise InputError(
                f"width = {self.width_mm:g} mm of a figure: give {NARROWEST_MM:g} to "
                f"{WIDEST_MM:g} mm, such as 85mm (one column) or 174mm (two)"
            )
        if not LEAST_DPI <= self.dpi <= MOST_DPI:
            raise InputError(f"dpi = {self.dpi:g}: give {LEAST_DPI:g} to {MOST_DPI:g}, such as 600")
        wrong = [name for name in self.formats if name not in FORMATS]
        if wrong or not self.formats:
            given = ", ".join(wrong) or "none"
            raise InputError(f"format = {given} of a figure: give some of {', '.join(FORMATS)}")
        if self.frames is not None and (not self.frames or min(self.frames) < 0):
            given = ",".join(map(str, self.frames)) or "none"
            raise InputError(f"frames = {given} of a figure: give numbers from 0, such as 0,2,4")


@dataclass(frozen=True, kw_only=True)
class PictureKind:
    """Pictures of one kind, one an item, that share their colours.

    Parameters
    ----------
    name : str
        What they show.
    draw : callable
        Draws item k on Axes, with `show_image`, and returns the image.
    bar : str, default ''
        Label of their colour bar, with its unit; empty: there is none.
    """

    name: str
    draw: Callable[[Axes, int], AxesImage]
    bar: str = ""


@dataclass(frozen=True, kw_only=True)
class Plot:
    """A plot of curves or bars.

    Parameters
    ----------
    title : str
        What it shows.
    draw : callable
        Draws it on Axes.
    height_mm : float, default 40.0
        Height of its axes, mm.
    least_mm : float, default 22.0
        Height down to which its axes may be lowered where a page has no room, mm.
    spare : int, default 0
        Rank in which it goes where a page has no room for all: the largest first, 0 never.
    """

    title: str
    draw: Callable[[Axes], Any]
    height_mm: float = 40.0
    least_mm: float = 22.0
    spare: int = 0


@dataclass(frozen=True, kw_only=True)
class PaperPanels:
    """The panels of a figure for a paper.

    Parameters
    ----------
    kinds : sequence of PictureKind, optional
        Kinds of pictures, each with one of every item.
    labels : sequence of str, optional
        What the items are.
    plots : sequence of Plot, optional
        Plots below the pictures.
    plots_across : int, default 3
        Most plots beside each other.
    legend : sequence of str, optional
        Names of the lines, where the plots share one legend, below them.
    notes : sequence of str, optional
        The numbers of the panels and what holds for all, a paragraph each.
    """

    kinds: Sequence[PictureKind] = ()
    labels: Sequence[str] = ()
    plots: Sequence[Plot] = ()
    plots_across: int = 3
    legend: Sequence[str] = ()
    notes: Sequence[str] = ()


class WithPanels(Protocol):
    """A result that can be drawn for a paper."""

    @property
    def title(self) -> str:
        """What it is, in a line."""

    def panels(self, frames: tuple[int, ...] | None = None) -> PaperPanels:
        """Give the panels of some of its frames."""


def chosen_frames(
    frames: tuple[int, ...] | None, count: int, default: Sequence[int], *, items: str = "frames"
) -> list[int]:
    """Give the frames that a figure shows.

    Parameters
    ----------
    frames : tuple of int or None
        The numbers that were asked for.
    count : int
        How many there are.
    default : sequence of int
        Those that are shown where nobody asks.
    items : str, default 'frames'
        What they are called.

    Returns
    -------
    list of int
        Their numbers.

    Raises
    ------
    InputError
        Where there is no such frame.
    """
    if frames is None:
        return list(default)
    beyond = [k for k in frames if not 0 <= k < count]
    if beyond:
        raise InputError(f"frames = {beyond[0]} of a figure: its {items} are 0 to {count - 1}")
    return list(frames)
