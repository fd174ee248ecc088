"""The numbers of what is drawn: curves, bands, bars, one column each, read from their Axes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[Any]

_DATA_ONLY = "_data: "
"""In front of a name that no legend shows, as of all that begin with a line below."""


def data_name(words: str) -> str:
    """The label of a curve that has its name in the data alone, and in no legend."""
    return f"{_DATA_ONLY}{words}"


def curve_columns(axes: Axes) -> dict[str, Array]:
    """The data of the curves of a plot, as columns for a spreadsheet, NaN where one is shorter.

    x and y of each curve, the ends of its band or bar; several curves over one x have it once, and
    one that is drawn twice stands once.
    """
    columns: dict[str, Array] = {}
    last: Array | None = None
    across = " ".join(axes.get_xlabel().split()) or "x"
    seen: list[list[Array]] = []
    for name, up, x, values in _all_curves(axes):
        own = [x, *values.values()]
        if any(len(own) == len(old) and all(map(_same, own, old)) for old in seen):
            continue  # a line with a band, and its points with bars
        seen.append(own)
        if last is None or not _same(last, x):
            place = across if x.dtype.kind == "f" else "input"
            place = f"{name}: {place}" if place in columns and name else place
            columns[_free(columns, place)] = last = x
        for ending, column in values.items():
            columns[_free(columns, ": ".join(filter(None, (name, f"{up}{ending}"))))] = column
    longest = max((len(column) for column in columns.values()), default=0)
    return {
        name: np.concatenate([column, np.full(longest - len(column), np.nan)])
        if column.dtype.kind == "f"
        else np.concatenate([column, np.full(longest - len(column), "")])
        for name, column in columns.items()
    }


def _all_curves(axes: Axes) -> Iterator[tuple[str, str, Array, dict[str, Array]]]:
    """Curves of Axes and of those over them with a second scale: name, quantity, x, values."""
    others = [one for one in axes.get_shared_x_axes().get_siblings(axes) if one is not axes]
    for own in (axes, *others):
        bars = any(x.dtype.kind != "f" for _, x, _ in _curves(own))
        label = own.get_xlabel() if bars else own.get_ylabel()
        for name, x, values in _curves(own):
            yield name, " ".join(label.split()) or "y", x, values


def _curves(axes: Axes) -> Iterator[tuple[str, Array, dict[str, Array]]]:
    """Name, x and values of each curve, band and set of bars."""
    from matplotlib.collections import PolyCollection
    from matplotlib.container import BarContainer, ErrorbarContainer

    held = set[Any]()
    for bars in axes.containers:
        if isinstance(bars, ErrorbarContainer):
            line, caps, sticks = bars.lines
            held |= {line, *caps}
            x, y = (np.asarray(v, dtype=float) for v in (line.get_xdata(), line.get_ydata()))
            if not len(x):  # no frame is of this kind
                continue
            ends = [np.asarray(stick)[:, 1] for stick in sticks[0].get_segments()] if sticks else []
            values = {"": y}
            if len(ends) == len(y):
                values |= {" low": np.array(ends)[:, 0], " high": np.array(ends)[:, 1]}
            yield _name(bars), x, values
        elif isinstance(bars, BarContainer):
            yield from _bars(axes, bars)
    bands = {
        tuple(np.atleast_2d(band.get_facecolor())[0, :3].tolist()): _band(band)
        for band in axes.collections
        if isinstance(band, PolyCollection) and len(band.get_facecolor())
    }
    for line in axes.lines:
        x, y = (np.asarray(v, dtype=float) for v in (line.get_xdata(), line.get_ydata()))
        if line in held or line.get_transform() != axes.transData or not len(x):
            continue
        values = {"": y}
        band = bands.pop(_colour(line), None)
        if band is not None and len(x) == len(y):
            for ending, k in ((" low", 0), (" high", 1)):
                values[ending] = np.array([band.get(at, (np.nan, np.nan))[k] for at in x.tolist()])
        yield _name(line), x, values


def _bars(axes: Axes, bars: Any) -> Iterator[tuple[str, Array, dict[str, Array]]]:
    """Horizontal bars by the names at their axis."""
    names = [label.get_text().replace("\n", " ") for label in axes.get_yticklabels()]
    widths = np.array([patch.get_width() for patch in bars.patches], dtype=float)
    if len(names) == len(widths):
        yield "", np.array(names)[::-1], {"": widths[::-1]}


def _band(band: Any) -> dict[float, tuple[float, float]]:
    """Lower and upper end of a band at each of its x."""
    found: dict[float, tuple[float, float]] = {}
    for path in band.get_paths():
        for x, y in path.vertices.tolist():
            low, high = found.get(x, (y, y))
            found[x] = min(low, y), max(high, y)
    return found


def _colour(line: Any) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    return to_rgb(line.get_color())


def _name(artist: Any) -> str:
    """What a legend calls it, or would; empty where it has no name."""
    label = str(artist.get_label()).removeprefix(_DATA_ONLY)
    return "" if label.startswith("_") else " ".join(label.split())


def _same(one: Array, other: Array) -> bool:
    return one.shape == other.shape and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def _free(columns: dict[str, Array], name: str) -> str:
    """A name that no column has yet."""
    if name not in columns:
        return name
    return next(new for k in range(2, len(columns) + 3) if (new := f"{name} ({k})") not in columns)
