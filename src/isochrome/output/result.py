"""What every command gives back: a table, JSON, warnings, a figure, and a report of a few lines.

Figures, and the record of what a result came from.
"""

from __future__ import annotations

import hashlib
import html
import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from isochrome.errors import InputError
from isochrome.output.files import replacing
from isochrome.output.tables import numbers

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

FIGURE_DPI = 150.0
"""Dots per inch of the pictures on disk."""

_MOST_VALUES = 8
"""Values in a report, so that it has at most 12 lines."""
_LONGEST_LINE = 110
_SMALL = 1e-4
"""Values below which a scene holds them with an exponent."""
_LEAST_SHARE = 0.001
"""Share of a picture below which its number says nothing: some pixels."""
_HEAD = 5
"""Rows of the table in a notebook."""


@dataclass(frozen=True, repr=False, kw_only=True)
class Result:
    """What a command found.

    A class of results has `columns`, those of the table that the command writes, units in their
    names; `warnings`, sentences; `title`, what it is; and `main_values`, what a report shows.

    Parameters
    ----------
    draw : callable, optional
        Makes the figure, of those that need more for it than they hold.
    """

    draw: Callable[[], Figure] | None = field(default=None, compare=False)

    if TYPE_CHECKING:  # a dataclass would take these for the defaults of fields of their names

        @property
        def columns(self) -> Mapping[str, Sequence[Any]]:
            """Name to values, as the table on disk has them."""

        @property
        def warnings(self) -> tuple[str, ...]:
            """What to beware of, in sentences."""

    @property
    def title(self) -> str:
        """What this is, in a line."""
        return type(self).__name__

    def main_values(self) -> Iterable[tuple[str, str]]:
        """Names and values, with their uncertainties, that a report shows."""
        return ()

    def to_json(self) -> dict[str, Any]:
        """What `--json` prints, besides the folder of the results."""
        raise NotImplementedError

    @property
    def uncertainty_basis(self) -> str:
        """What the ± of the main values are of, where they take an input as exact."""
        return ""

    @property
    def table(self) -> pd.DataFrame:
        """The columns of the table that the command writes, as a pandas DataFrame."""
        import pandas

        return pandas.DataFrame(dict(self.columns))

    def figure(self) -> Figure:
        """The picture that the command leaves, as a matplotlib Figure.

        That of an earlier run is its file, pixel by pixel. Raises InputError where there is none.
        """
        if self.draw is None:
            raise InputError("there_nothing_draw", title=self.title)
        return self.draw()

    def _report(self) -> list[tuple[str, str]]:
        """The main values, of many the first ones."""
        values = list(self.main_values())
        most = _MOST_VALUES - bool(self.uncertainty_basis)
        more = len(values) - most
        return values if more <= 0 else [*values[:most], (f"and {more} more", "")]

    def __repr__(self) -> str:
        """A few lines: what it is, the main values, and how many warnings there are."""
        rows = self._report()
        width = max((len(name) for name, _ in rows), default=0)
        lines = [self.title, *(f"  {name.ljust(width)}  {value}" for name, value in rows)]
        lines += wrap(self.uncertainty_basis, initial_indent="  ", subsequent_indent="    ",
                      width=_LONGEST_LINE)  # fmt: skip
        count = len(self.warnings)
        if count:
            lines.append(f"  {counted(count, 'warning')}: see .warnings")
        return "\n".join(_in_a_line(line) for line in lines)

    def _repr_html_(self) -> str:
        """For a notebook: the report, the first rows of the table, and the warnings."""
        import pandas

        columns = self.columns
        count = max((len(values) for values in columns.values()), default=0)
        head = pandas.DataFrame({name: values[:_HEAD] for name, values in columns.items()})
        rows = "".join(
            f"<tr><td>{html.escape(name)}</td><td>{html.escape(value)}</td></tr>"
            for name, value in self._report()
        )
        messages = "".join(f"<li>{html.escape(text)}</li>" for text in self.warnings)
        more = f"<p>{count} rows, see .table</p>" if count > _HEAD else ""
        return (
            f"<div><p><b>{html.escape(self.title)}</b></p><table>{rows}</table>"
            f"{f'<p>{html.escape(self.uncertainty_basis)}</p>' if self.uncertainty_basis else ''}"
            f"{head.to_html(index=False, max_cols=12, border=0)}{more}"
            f"{f'<ul>{messages}</ul>' if messages else ''}</div>"
        )


def _in_a_line(text: str) -> str:
    """Names of files may hold a new line, and be long."""
    indent = "  " if text.startswith("  ") else ""
    line = indent + " ".join(text.splitlines()).strip()
    return line if len(line) <= _LONGEST_LINE else f"{line[: _LONGEST_LINE - 1]}…"


def saved_picture(path: Path) -> Figure:
    """A picture on disk as a Figure with nothing around it, one dot a pixel."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    try:
        picture = imread(path, format="png")
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError("no_readable_picture_run", path=path, error=error) from error
    rows, cols = picture.shape[:2]
    figure = Figure(figsize=(cols / FIGURE_DPI, rows / FIGURE_DPI), dpi=FIGURE_DPI)
    FigureCanvasAgg(figure)
    figure.figimage(picture)
    return figure


def counted(count: int, item: str) -> str:
    """A number of items with their noun in the right number: '1 frame', '2 frames'."""
    return f"{count} {item}" if count == 1 else f"{count} {item}s"


def per_cent(share: float) -> str:
    """A small share of a picture, such as '1.2 %'; of a few pixels 'less than 0.1 %', never '0.0
    %'.
    """
    return f"{100.0 * share:.1f} %" if share >= _LEAST_SHARE else "less than 0.1 %"


def with_uncertainty(value: float, spread: float) -> str:
    """A value with its standard uncertainty of two digits, as '14.600 ± 0.066'; NaN = not known."""
    if not (math.isfinite(value) and math.isfinite(spread) and spread > 0.0):
        return f"{value:.6g} ± {spread:.2g}"
    last = _exponent(spread) - 1  # of the uncertainty's second digit
    largest = max(_exponent(value), last + 1) if value else last + 1
    if -4 <= largest < 6:
        decimals = max(0, -last)
        value, spread = round(value, -last) + 0.0, round(spread, -last)
        return f"{value:.{decimals}f} ± {spread:.{decimals}f}"
    return f"{value:.{max(_exponent(value) - last, 0) if value else 0}e} ± {spread:.1e}"


def to_last_digit(value: float, spread: float | None) -> str:
    """A value to the last decimal that its standard uncertainty has with two digits.

    With five digits where that is not known.
    """
    if not (spread and math.isfinite(spread) and math.isfinite(value)):
        return f"{value:.5g}"
    return with_uncertainty(value, spread).partition(" ± ")[0]


def agree(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two values agree within two of their combined standard uncertainties.

    Of true values and uncertainties 1 in 20 does not.
    """
    return abs(one[0] - other[0]) <= 2.0 * math.hypot(one[1], other[1])


def rounded_texts(value: float, spread: float) -> tuple[str, str]:
    """A value and its uncertainty as a scene holds them, two digits beyond the latter's first."""
    if 0.0 < abs(value) < _SMALL:
        exponent = int(np.floor(np.log10(abs(value))))
        parts = rounded_texts(value / 10.0**exponent, spread / 10.0**exponent)
        return f"{parts[0]}e{exponent}", f"{parts[1]}e{exponent}"
    digits = max(1, 2 - int(np.floor(np.log10(spread)))) if spread > 0 else 6
    return f"{value:.{digits}f}", f"{spread:.{digits}f}"


def _exponent(value: float) -> int:
    """Power of ten of a value's first digit, once it is rounded to two."""
    return int(f"{value:.1e}".partition("e")[2])


def over_items(
    values: Iterable[float | None],
    spreads: Iterable[float | None] = (),
    *,
    items: str = "frames",
    digits: int = 5,
) -> str:
    """A column as a report shows it: mean and span, with the median standard uncertainty.

    `digits`, of values without an uncertainty.
    """
    known, each = (column[np.isfinite(column)] for column in map(numbers, (values, spreads)))
    if not known.size:
        return "not known"
    mean = float(known.mean())
    spread = float(np.median(each)) if each.size else 0.0
    text = with_uncertainty(mean, spread) if each.size else f"{mean:.{digits}g}"
    if known.size == 1:
        return text
    ends = (
        to_last_digit(end, spread) if spread else f"{end:.{digits}g}"
        for end in (float(known.min()), float(known.max()))
    )
    many = f"mean of {known.size} {items}, {' to '.join(ends)}"
    return f"{text}{' each' if each.size else ''} ({many})"


def write_figure(path: str | Path, figure: Figure, *, dpi: float = FIGURE_DPI) -> None:
    """Write a matplotlib Figure as PNG by the Agg back-end, without pyplot and its state.

    Letters of a file's name that the font does not have are drawn as boxes.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with replacing(path) as beside, warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from font")
        FigureCanvasAgg(figure).print_figure(beside, format="png", dpi=dpi)


class Digested(Protocol):
    """What is read in place of a file, and knows the hash of its content."""

    def digest(self) -> str:
        """Its SHA-256 as hexadecimal text."""


InputContent = str | Path | Digested
"""A file, a folder, or what is read in place of one."""


def provenance(
    scene_toml: str | None, inputs: Iterable[InputContent] = (), seed: int | None = None
) -> dict[str, Any]:
    """Record what a result came from: version, resolved scene, hashes of the inputs, seed.

    A folder among the inputs stands for the files in it.
    """
    from importlib.metadata import PackageNotFoundError, version

    try:
        number = version("isochrome")
    except PackageNotFoundError:  # run from a source tree
        number = "unknown"
    hashes: dict[str, str] = {}
    for place in inputs:
        if not isinstance(place, str | Path):
            hashes[f"{place} ({len(hashes) + 1})"] = place.digest()
            continue
        path = Path(place)
        files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
        hashes |= {str(file): sha256(file) for file in files}
    return {"isochrome": number, "scene": scene_toml, "inputs_sha256": hashes, "seed": seed}


def sha256(path: str | Path) -> str:
    """The SHA-256 of a file as hexadecimal text."""
    try:
        if Path(path).exists() and not Path(path).is_file():  # a pipe would never end
            raise InputError("not_file_name_file", path=path)
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError("cannot_read_check_name_2", path=path, error=error.strerror) from error
