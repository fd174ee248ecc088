"""What every command gives back: a table, JSON, warnings, a figure, and a report of a few lines;
and its words: frames as sentences name them, values with their uncertainties."""

from __future__ import annotations

import hashlib
import html
import math
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, median
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

import isochrome
from isochrome.errors import InputError
from isochrome.messages import reworded
from isochrome.output.files import numbers, replacing

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

T = TypeVar("T")

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
        if count := len(self.warnings):
            lines.append(f"  {counted(count, 'warning')}: see .warnings")
        return "\n".join(_in_a_line(line) for line in lines)

    def _repr_html_(self) -> str:
        """For a notebook: the report, the first rows of the table, and the warnings."""
        import pandas

        columns = self.columns
        count = max((len(values) for values in columns.values()), default=0)
        head = pandas.DataFrame({name: values[:_HEAD] for name, values in columns.items()})
        cells = (map(html.escape, row) for row in self._report())
        rows = "".join(f"<tr><td>{name}</td><td>{value}</td></tr>" for name, value in cells)
        basis = [self.uncertainty_basis] if self.uncertainty_basis else []
        more = [f"{count} rows, see .table"] if count > _HEAD else []
        return "".join((
            "<div>", f"<p><b>{html.escape(self.title)}</b></p><table>{rows}</table>",
            *(f"<p>{html.escape(text)}</p>" for text in basis),
            head.to_html(index=False, max_cols=12, border=0),
            *(f"<p>{html.escape(text)}</p>" for text in (*more, *self.warnings)), "</div>",
        ))  # fmt: skip


def _in_a_line(text: str) -> str:
    """Names of files may hold a new line, and be long."""
    line = ("  " if text.startswith("  ") else "") + " ".join(text.splitlines()).strip()
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


def evenly_spaced(items: Sequence[T], most: int) -> list[T]:
    """At most so many of some items, the first and the last among them."""
    places = np.linspace(0, len(items) - 1, min(len(items), most))
    return [items[round(place)] for place in places.tolist()]


def counted(count: int, item: str) -> str:
    """A number of items with their noun in the right number: '1 frame', '2 frames'."""
    return f"{count} {item}" if count == 1 else f"{count} {item}s"


def per_cent(share: float) -> str:
    """A small share of a picture, such as '1.2 %'; of a few pixels 'less than 0.1 %'."""
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
    """A value to the last decimal of its uncertainty's two digits, or in five where none is
    known."""
    if not (spread and math.isfinite(spread) and math.isfinite(value)):
        return f"{value:.5g}"
    return with_uncertainty(value, spread).partition(" ± ")[0]


def agree(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two values agree within two of their combined standard uncertainties."""
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
    """A column as a report shows it: mean and span (`digits`), and the median standard
    uncertainty."""
    values = list(values)
    _, mean, *ends, spread = row_of("", values, spreads)
    if mean is None:
        return "not known"
    text = f"{mean:.{digits}g}" if spread is None else with_uncertainty(mean, spread)
    count = int(np.isfinite(numbers(values)).sum())
    if count == 1:
        return text
    span = (to_last_digit(end, spread) if spread else f"{end:.{digits}g}" for end in ends)
    each = "" if spread is None else " each"
    return f"{text}{each} (mean of {count} {items}, {' to '.join(span)})"


def write_figure(path: str | Path, figure: Figure, *, dpi: float = FIGURE_DPI) -> None:
    """Write a matplotlib Figure as PNG by the Agg back-end, without pyplot and its state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with replacing(path) as beside, warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from font")
        canvas: Any = FigureCanvasAgg(figure)
        before, figure.dpi = figure.dpi, dpi
        # `savefig` would draw and lay out all twice, and a smaller file takes three times the time
        canvas.print_png(beside, pil_kwargs={"compress_level": 3})
        figure.dpi = before


class Digested(Protocol):
    """What is read in place of a file, and knows the hash of its content."""

    def digest(self) -> str:
        """Its SHA-256 as hexadecimal text."""


InputContent = str | Path | Digested
"""A file, a folder, or what is read in place of one."""


def provenance(
    scene_toml: str | None, inputs: Iterable[InputContent] = (), seed: int | None = None
) -> dict[str, Any]:
    """What a result came from: version, resolved scene, hashes of the inputs (of a folder its
    files), seed."""
    hashes: dict[str, str] = {}
    for place in inputs:
        if not isinstance(place, str | Path):
            hashes[f"{place} ({len(hashes) + 1})"] = place.digest()
            continue
        path = Path(place)
        files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
        hashes |= {str(file): sha256(file) for file in files}
    number = isochrome.__version__
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


_SPANS = 8
"""Spans of frames that a sentence names; of more it says how many."""


_NUMBER = re.compile(
    r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?: ± [\d.]+(?:e[-+]?\d+)?)?(?!\w)"
)
"""A number of a sentence, with its uncertainty where it has one."""


def messages_of_frames(messages: Iterable[tuple[int, str]], *, single: bool = False) -> list[str]:
    """Say what is to be said of frames, each cause once, with the frames that it is of. Sentences
    that differ in their numbers alone have one cause, and their numbers become spans."""
    if single:
        return list(dict.fromkeys(text for _, text in messages))
    causes: dict[str, list[tuple[int, str]]] = {}
    for number, text in messages:
        # without its numbers, and without the plurals that go with them
        cause = re.sub(r"(?<=\w)s\b", "", _NUMBER.sub("#", text))
        causes.setdefault(cause, []).append((number, text))
    lines = []
    for entries in causes.values():
        texts = list(dict.fromkeys(text for _, text in entries))
        apart = len({number for number, _ in entries}) < len(entries)
        for text in texts if apart else [_spanned(texts)]:
            frames = [number for number, words in entries if words == text or not apart]
            total = f" ({len(frames)} in all)" if len(frames) > 1 else ""
            lines.append(f"{named_frames(frames)}{total}: " + text)
    return lines


def _spanned(texts: list[str]) -> str:
    """Sentences of one cause as one, with spans for the numbers in which they differ."""
    numbers = [_NUMBER.findall(text) for text in texts]
    spans = []
    for column in zip(*numbers, strict=True):
        low, high = (end(column, key=_value) for end in (min, max))
        spans.append(low if _value(low) == _value(high) else f"{low} to {high}")
    place = iter(spans)
    # of many there is a plural
    most = max(range(len(texts)), key=lambda k: [_value(number) for number in numbers[k]])
    return reworded(texts[most], _NUMBER.sub(lambda _: next(place), texts[most]))


def _value(number: str) -> float:
    return float(number.partition(" ± ")[0])


def named_frames(frames: Sequence[int]) -> str:
    """Name frames as 'frame 3' or 'frames 0-4, 7', after eight spans how many more."""
    if len(frames) == 1:
        return f"frame {frames[0]}"
    runs = np.split(np.array(frames), np.flatnonzero(np.diff(frames) > 1) + 1)
    spans = [f"{run[0]}" if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    more = f" and {len(spans) - _SPANS} more" if len(spans) > _SPANS else ""
    return f"frames {', '.join(spans[:_SPANS])}{more}"


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameValues:
    """Fitted values of n frames.

    Parameters
    ----------
    keys : tuple of str
        The scene's keys that were fitted.
    values : ndarray, shape (n, keys)
        Their values, each in the unit of its key; NaN = not known.
    standard_uncertainty : ndarray, shape (n, keys)
        Their standard uncertainties, NaN = not known.
    chi : ndarray, shape (n,)
        Residual over noise of each frame.
    distance_m : ndarray, shape (n,)
        Distance slid, m; NaN where nothing slides.
    searched : ndarray of bool, shape (n,)
        Frames of a tracked video that a full search had to find.
    whole : ndarray of bool, shape (n,)
        Key frames of a tracked video.
    """

    keys: tuple[str, ...]
    values: NDArray[np.float64]
    standard_uncertainty: NDArray[np.float64]
    chi: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    searched: NDArray[np.bool_]
    whole: NDArray[np.bool_]

    def summary(self) -> dict[str, list[Any]]:
        """For each key its mean, least and most value, and the median standard uncertainty.

        Column name to values, None where none is known.
        """
        columns = zip(self.keys, self.values.T, self.standard_uncertainty.T, strict=True)
        rows = [row_of(*column) for column in columns]
        return {name: [row[k] for row in rows] for k, name in enumerate(_SUMMARY)}


@dataclass(frozen=True, repr=False, kw_only=True)
class FittedResult(Result):
    """What was fitted to frames.

    A class of these has `over_frames`, what each frame has of its own; `taken_as_exact`, keys of
    the measured numbers whose uncertainty is in no ±; and what else it says.
    """

    if TYPE_CHECKING:

        @property
        def scene(self) -> Any:
            """What stood in front of the camera."""

        @property
        def taken_as_exact(self) -> tuple[str, ...]:
            """Keys of the measured numbers whose uncertainty is in no ±."""

    @property
    def over_frames(self) -> FrameValues:
        """The values of each frame, to be drawn and summed up as those of other commands."""
        raise NotImplementedError

    @property
    def rows(self) -> list[Sequence[Any]]:
        """Of each fitted key what a sentence says of it, see `spoken`."""
        return list(zip(*self.summary().values(), strict=True))

    @property
    def causes(self) -> list[str] | None:
        """What the frames asked for besides; None where nobody asked them."""
        return None

    @property
    def refined(self) -> list[str]:
        """What the frames know better than the scene states it, and agree with."""
        return []

    @property
    def besides(self) -> list[str]:
        """What else than the pictures the ± are of."""
        return []

    def summary(self) -> dict[str, list[Any]]:
        """What the frames come to."""
        return self.over_frames.summary()

    def main_values(self) -> Iterable[tuple[str, str]]:
        """Each key over the frames."""
        table = self.over_frames
        columns = zip(table.keys, table.values.T, table.standard_uncertainty.T, strict=True)
        yield from ((key, over_items(values, spreads)) for key, values, spreads in columns)

    @property
    def uncertainty_basis(self) -> str:
        """What the ± are of, and what was taken as exact; empty where nothing was."""
        exact, count = self.taken_as_exact, len(self.over_frames.chi)
        if not exact:
            return ""
        pictures = "the picture" if count == 1 else "the pictures"
        source = " and ".join((pictures, *self.besides)) if self.besides else f"{pictures} alone"
        verb = "was" if len(exact) == 1 else "were"
        return f"± from {source}: {_listed(exact)} {verb} taken as exact"

    @property
    def summary_text(self) -> str:
        """What was found as a sentence, the same on the terminal and in a report.

        Such as 'load 62.00 ± 0.28 N; causes found: none'; of several frames the mean, the least and
        the most, and the ± of one of them.
        """
        rows, count = self.rows, len(self.over_frames.chi)
        text = ", ".join(spoken(*row) for row in rows)
        clauses = [f"mean of {count} frames, ± of each: {text}" if count > 1 and text else text]
        known = any(mean is not None and mean == mean for _, mean, *_ in rows)
        if known and self.uncertainty_basis:
            clauses.append(self.uncertainty_basis)
        if self.refined:
            clauses.append(f"refined: {_listed(self.refined)}")
        if self.causes is not None:
            clauses.append(f"causes found: {', '.join(self.causes) or 'none'}")
        return "; ".join([clauses[0] or "nothing fitted", *clauses[1:]])


WORDS = {
    "load.normal_n": ("load", " N"),
    "friction.coefficient": ("friction", ""),
    "wear.coefficient_mm2_per_n": ("wear coefficient", " mm²/N"),
    "camera.left_mm": ("left edge", " mm"),
    "camera.top_mm": ("upper edge", " mm"),
    "specimen.fringe_value_n_per_mm": ("fringe value", " N/mm"),
}
"""What a sentence calls a value, and its unit; others go by their keys, which hold theirs."""


Row = tuple[str, Any, Any, Any, Any]
"""Key, mean, least, most and median standard uncertainty of a value, None where none is known."""

_SUMMARY = ("key", "mean", "least", "most", "standard_uncertainty")


def row_of(key: str, values: Iterable[float | None], spreads: Iterable[float | None]) -> Row:
    """What a value comes to over frames."""
    known, each = (column[np.isfinite(column)] for column in map(numbers, (values, spreads)))
    mean, least, most = (float(f(known)) if known.size else None for f in (np.mean, np.min, np.max))
    return key, mean, least, most, float(np.median(each)) if each.size else None


def spoken(key: str, mean: Any, least: Any, most: Any, spread: Any) -> str:
    """A value with its name, unit and, where it has one, span, such as 'load 62.00 ± 0.28 N'."""
    word, unit = WORDS.get(key, (key, ""))
    if mean is None or mean != mean:
        return f"{word} not known"
    text = with_uncertainty(mean, float("nan") if spread is None else spread)
    ends = dict.fromkeys(to_last_digit(end, spread) for end in (least, most))
    span = f" ({' to '.join(ends)})" if len(ends) > 1 else ""
    return f"{word} {text}{unit}{span}"


def refined_texts(
    rows: Iterable[Sequence[Any]], stated: Mapping[str, tuple[float, float]]
) -> list[str]:
    """Which values are known better than stated, as far as two digits of a ± tell, surest first."""
    better = []
    for key, mean, _, _, spread in rows:
        value, before = stated[key]
        if float(f"{spread:.1e}") < float(f"{before:.1e}"):
            text = f"{spoken(key, mean, mean, mean, spread)} (stated "
            better.append((spread / before, f"{text}{with_uncertainty(value, before)})"))
    return [text for _, text in sorted(better)]


def rows_by_key(table: Mapping[str, Sequence[Any]]) -> dict[str, Row]:
    """Columns of fit.csv as rows: over the frames where each has its own."""
    by_key: dict[str, tuple[list[Any], list[Any]]] = {}
    columns = (table[n] for n in ("key", "value", "standard_uncertainty"))
    for key, *pair in zip(*columns, strict=True):
        for items, item in zip(by_key.setdefault(key, ([], [])), pair, strict=True):
            items.append(item)
    return {key: row_of(key, *columns) for key, columns in by_key.items()}


def sentence_of_orders(table: Mapping[str, Sequence[Any]]) -> str:
    """What was read without a model: mean share of the pixels, highest order, median ±."""
    count = len(table["frame"])
    head = f"in {count} frames: " if count > 1 else ""
    if not {"kept_share", "fringe_lines"} & set(table):
        return f"{head}no order could be read"
    if "kept_share" not in table:
        lines = sum(int(n or 0) for n in table["fringe_lines"])
        return (
            f"{head}{lines} fringe lines, and no order: no point of known order is given "
            "(`isochrome guide without-model`)"
        )
    columns = (numbers(table[name]) for name in ("kept_share", "n_max", "order_uncertainty"))
    shares, highest, spreads = ([v for v in values.tolist() if v == v] for values in columns)
    if not highest:
        return f"{head}no order could be read"
    largest = max(highest)
    sources = zip(table["n_max"], table.get("n_max_from", ()), strict=False)  # older runs say none
    least = (largest, "at least") in sources
    most = f"up to {'at least ' * least}{largest:.2f} fringes"
    typical = f", ± {median(spreads):.2g} typically" if spreads else ""
    return f"{head}order read in {100 * fmean(shares):.0f} % of the pixels, {most}{typical}"


def _listed(items: Sequence[str]) -> str:
    """Some names, of many the first three, so that a sentence can be read."""
    more = len(items) - 3
    return ", ".join(items) if more < 2 else f"{', '.join(items[:3])} and {more} more"
