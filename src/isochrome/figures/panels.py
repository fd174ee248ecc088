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
    """Pictures of one kind, one an item, that share their colours."""

    name: str  # what they show
    draw: Callable[[Axes, int], AxesImage]  # item k, with `show_image`
    bar: str = ""  # label of their colour bar, with its unit; empty: there is none


@dataclass(frozen=True, kw_only=True)
class Plot:
    """A plot of curves or bars."""

    title: str  # what it shows
    draw: Callable[[Axes], Any]
    height_mm: float = 40.0  # of its axes
    least_mm: float = 22.0  # down to which they may be lowered where a page has no room
    spare: int = 0  # rank in which it goes where a page has no room: the largest first, 0 never


@dataclass(frozen=True, kw_only=True)
class PaperPanels:
    """The panels of a figure for a paper."""

    kinds: Sequence[PictureKind] = ()  # each with a picture of every item
    labels: Sequence[str] = ()  # what the items are
    plots: Sequence[Plot] = ()  # below the pictures
    plots_across: int = 3  # most plots beside each other
    legend: Sequence[str] = ()  # names of the lines, where the plots share one legend, below them
    notes: Sequence[str] = ()  # the panels' numbers and what holds for all, a paragraph each


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
    """The numbers of the frames that a figure shows: those asked for, or the default ones.

    `items` is what they are called. InputError where there is no such frame.
    """
    if frames is None:
        return list(default)
    beyond = [k for k in frames if not 0 <= k < count]
    if beyond:
        raise InputError(f"frames = {beyond[0]} of a figure: its {items} are 0 to {count - 1}")
    return list(frames)
