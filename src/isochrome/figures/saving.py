"""A figure for a paper as files: fonts embedded, text as text, and the data of its curves."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isochrome.figures.curve_data import curve_columns
from isochrome.figures.layout import PAGE_MM
from isochrome.figures.panels import FigureStyle, WithPanels
from isochrome.figures.paper import MM_PER_INCH, figure_for_page, panel_of_plot
from isochrome.output import replacing, write_csv

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EMBEDDED: Any = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "isochrome"}
"""Fonts as TrueType, which journals take, and text as text; the same file again."""

_UNDATED = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


def save_figure(
    result: WithPanels, path: str | Path, style: FigureStyle | None = None
) -> tuple[Path, ...]:
    """Write a result's figure for a paper, and beside it the data of each plot as CSV.

    PDF and SVG hold text as text, with the fonts of a PDF in it. A figure that would be taller
    than a page (230 mm) is laid out closer; a UserWarning says which plots have no room, or how
    tall it is still.

    Parameters
    ----------
    result : Comparison, ScarComparison, Processed, Simulation or a calibration
        What `compare`, `process`, `simulate` or `calibrate_...` found.
    path : str or Path
        The files' name without its ending, such as 'paper/figure-3'.
    style : FigureStyle, optional
        Width, frames, formats; by default 174 mm, as PDF and PNG.

    Returns
    -------
    tuple of Path
        The files: one a format, and one a plot, NAME_LETTER.csv.

    Raises
    ------
    InputError
        Where the result has no such picture or no such frame, or a file cannot be written.

    Examples
    --------
    >>> import isochrome
    >>> scene = isochrome.load_scene("ring").with_values({
    ...     "load.normal_n": 60.0, "camera.width_px": 128, "camera.height_px": 128,
    ...     "camera.pixel_mm": 0.36, "camera.noise_grey": 1.0})
    >>> style = isochrome.FigureStyle(width_mm=85, formats=("svg",))
    >>> files = isochrome.save_figure(isochrome.simulate(scene), "ring", style)
    >>> [file.name for file in files]
    ['ring.svg']
    """
    style = style or FigureStyle()
    figure, left_out = figure_for_page(result, style)
    if left_out:
        say = f"a page has no room for: {', '.join(left_out)}; a wider figure has"
        warnings.warn(say, UserWarning, stacklevel=2)
    tall = MM_PER_INCH * figure.get_figheight()
    if tall > PAGE_MM:
        say = f"the figure is {tall:.0f} mm tall; choose fewer --frames"
        warnings.warn(say, UserWarning, stacklevel=2)
    base = Path(path)
    files = []
    for form in dict.fromkeys(style.formats):
        file = base.with_name(f"{base.name}.{form}")
        with replacing(file) as beside:
            Path(beside).write_bytes(_content(figure, form, style.dpi))
        files.append(file)
    tables = _tables(figure, base)
    for file, columns in tables.items():
        write_csv(file, {name: column.tolist() for name, column in columns.items()})
    return (*files, *tables)


def _tables(figure: Figure, base: Path) -> dict[Path, dict[str, Any]]:
    """The data of each plot, by the file beside the figure that is to hold them."""
    found = {}
    for axes in figure.axes:
        letter = panel_of_plot(axes)
        columns = curve_columns(axes) if letter else {}
        if columns:
            found[base.with_name(f"{base.name}_{letter}.csv")] = columns
    return found


def _content(figure: Figure, form: str, dpi: float) -> bytes:
    """A figure as the bytes of a file."""
    from matplotlib import rc_context
    from matplotlib.image import AxesImage

    more: dict[str, Any] = {"metadata": _UNDATED[form]} if form in _UNDATED else {}
    if form == "tiff":
        more["pil_kwargs"] = {"compression": "tiff_lzw"}
    drawn: list[Any] = figure.findobj(AxesImage)
    ways = [image.get_interpolation() for image in drawn]
    content = io.BytesIO()
    with rc_context(_EMBEDDED), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from font")
        for image in drawn if form in _UNDATED else ():
            image.set_interpolation("none")  # the pixels themselves, which no printer blurs
        figure.savefig(content, format=form, dpi=dpi, **more)
        for image, way in zip(drawn, ways, strict=True):
            image.set_interpolation(way)
    return content.getvalue()
