"""A profilometer's trace: heights along a line across the scar, read from text and checked.

Sources: ISO 25178-71:2017, Surface texture: areal, Part 71 (SDF), of which Stout et al. (1993),
EUR 15178 EN, is the origin; the form of one profile as the National Institute of Standards and
Technology's surface metrology pages describe it: keys, *, heights, *; scales in metres.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.output import MM_PER_UNIT, numbered_lines, read_given_text

Array = NDArray[Any]

MM = {unit: MM_PER_UNIT[unit] for unit in ("m", "mm", "um", "µm", "μm", "nm")}
"""Units of lengths that a column may have, in mm."""

_PLACES = ("x", "position", "distance", "lateral", "length")
_HEIGHTS = ("z", "height", "profile")

_FORM = "trace_has_line_names"

_LEAD = 60
"""Lines before the numbers in which the names may stand."""

_SDF = re.compile(r"\s*a(BCR?|ISO)-\d\.\d", re.I)
"""The first line of an ASCII file of ISO 25178-71, or of its origin."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.I)


def _are_numbers(row: Sequence[str]) -> bool:
    filled = [cell.strip() for cell in row if cell.strip()]
    return len(filled) > 1 and all(map(_NUMBER.fullmatch, filled))


def _table(text: str, path: Path) -> tuple[Array, Array]:
    """The two columns of a table of numbers: places (n,), mm, and heights (n,), µm."""
    rows = numbered_lines(text)
    if not rows:
        raise InputError("empty", path=path, form=message(_FORM))
    cells = _cells([line for _, line in rows])
    head = cells[: _LEAD + 1]
    first = next((k for k, row in enumerate(head) if _are_numbers(row)), None)
    if first is None:
        raise InputError(
            "no_line_numbers_first", path=path, cells_count=len(head), form=message(_FORM)
        )
    x_column, z_column, x_unit, z_unit = _columns(head[:first], path)
    values = []
    for (number, _), row in zip(rows[first:], cells[first:], strict=True):
        pair = [row[k] if k < len(row) else "" for k in (x_column, z_column)]
        for cell in pair:
            if not (_NUMBER.fullmatch(cell) and np.isfinite(float(cell))):
                raise InputError("line_has_where_finite", path=path, number=number, cell=cell[:30])
        values.append([float(cell) for cell in pair])
    x, z = np.array(values).T
    return x_unit * x, 1e3 * z_unit * z


def _cells(lines: Sequence[str]) -> list[list[str]]:
    """A table's lines cut into cells, with decimal points.

    By the last lines, which are numbers: tab or semicolon, comma, or blanks.
    """
    some, separator = lines[-5:], cast("str | None", ",")
    if all(re.search(r"[\d.]\s+[+-]?[\d.,]", line) for line in some):
        separator = None
    for mark in ("\t", ";"):
        if all(mark in line for line in some):
            separator = mark
    if separator != "," and any("," in line for line in some):
        lines = [line.replace(",", ".") for line in lines]
    return [[cell.strip().strip('"') for cell in line.split(separator)] for line in lines]


def _columns(head: Sequence[Sequence[str]], path: Path) -> tuple[int, int, float, float]:
    """The columns of places and heights, and their units in mm, from the lines before the numbers.

    The last such line that names both counts; their units stand in it or in the line below.
    """
    for k in range(len(head) - 1, -1, -1):
        places = [i for i, cell in enumerate(head[k]) if _name(cell) in _PLACES]
        heights = [i for i, cell in enumerate(head[k]) if _name(cell) in _HEIGHTS]
        if not (places and heights):
            continue
        if len(places) > 1 or len(heights) > 1:
            raise InputError("line_names_several_columns", path=path, head=", ".join(head[k]))
        x, z = places[0], heights[0]
        return x, z, _unit_mm(head[k:], x, "x_mm", path), _unit_mm(head[k:], z, "z_um", path)
    raise InputError("no_line_names_columns", path=path, form=message(_FORM))


def _unit_mm(lines: Sequence[Sequence[str]], column: int, example: str, path: Path) -> float:
    """A column's unit in mm, by its name's last word or the line below."""
    for row in lines[:2]:
        words = _words(row[column]) if column < len(row) else []
        if words and words[-1] in MM:
            return MM[words[-1]]
    raise InputError(
        "column_has_no_unit", path=path, lines=lines[0][column], example=example,
        metres=", ".join(u for u in MM if u.isascii()),
    )  # fmt: skip


def _words(cell: str) -> list[str]:
    return [word for word in re.split(r"[\s_\[\]()/,:]+", cell.strip().lower()) if word]


def _name(cell: str) -> str:
    return next(iter(_words(cell)), "")


def _surface_data(text: str, path: Path) -> tuple[Array, Array]:
    """One profile in the ASCII form of ISO 25178-71."""
    head, star, body = text.partition("*")
    pairs = (line.partition("=") for line in head.splitlines()[1:])
    keys = {re.sub(r"[\s_-]", "", key).lower(): value.strip() for key, sign, value in pairs if sign}
    missing = [k for k in ("numpoints", "numprofiles", "xscale", "zscale") if k not in keys]
    if missing or not star:
        raise InputError(
            "sdf_file_without_export", path=path, words=missing[0] if missing else "its heights"
        )
    try:
        points, profiles = int(keys["numpoints"]), int(keys["numprofiles"])
        x_scale, z_scale = float(keys["xscale"]), float(keys["zscale"])
    except ValueError as error:
        raise InputError("scale_count_head_no", path=path, error=error) from error
    if profiles != 1:
        raise InputError("holds_profiles_export_one", path=path, profiles=profiles)
    cells = body.partition("*")[0].split()
    if len(cells) != points:
        raise InputError("has_heights_where_head", path=path, cells_count=len(cells), points=points)
    bad = next((cell for cell in cells if not _NUMBER.fullmatch(cell)), None)
    if bad is not None:
        raise InputError("has_among_heights_all", path=path, bad=bad[:30])
    heights = np.array(cells, dtype=np.float64)
    return 1e3 * x_scale * np.arange(float(points)), 1e6 * z_scale * heights


FEWEST = 50
"""Points of a trace: below, there is no telling of roughness from form."""

_SHORTEST_MM, _LONGEST_MM = 0.05, 200.0
"""Lengths of a trace across a scar: others are in another unit."""

_STEEPEST = 0.3
"""Heights over the length: a tilt of 17 degrees, at which no stylus goes."""

_WIDEST_GAP = 0.05
"""Largest step between two points, over the trace's length."""


@dataclass(frozen=True, eq=False)
class Trace:
    """Heights of a surface along a line, their places put in rising order.

    InputError for what is no trace: too few points, numbers that are not finite, places that do not
    rise, a length or heights that must be in another unit, a gap. Messages have its `name`.
    """

    x_mm: Array
    z_um: Array  # up out of the specimen
    name: str = "trace"

    def __post_init__(self) -> None:
        x, z = (np.asarray(v, dtype=np.float64).ravel() for v in (self.x_mm, self.z_um))
        if len(x) > 1 and x[-1] < x[0]:
            x, z = x[::-1], z[::-1]
        _check(x, z, self.name)
        object.__setattr__(self, "x_mm", x)
        object.__setattr__(self, "z_um", z)


def read_trace(path: str | Path) -> Trace:
    """Read a trace from a text file, and name it after the file; InputError names line and fix.

    A line of names, such as `x_mm,z_um`, with units in the name, in brackets or in the line below;
    cells between commas, semicolons, tabs or blanks; # begins a comment. Or one profile in the
    ASCII form of ISO 25178-71 (SDF).
    """
    text = read_given_text(Path(path), "the trace", fallback="latin-1")  # µ of an older program
    x_mm, z_um = (_surface_data if _SDF.match(text) else _table)(text, Path(path))
    return Trace(x_mm=x_mm, z_um=z_um, name=str(path))


def _check(x: Array, z: Array, name: str) -> None:
    """Raise InputError for what is no trace."""
    if len(x) != len(z):
        raise InputError("places_heights_give_many", name=name, x_count=len(x), z_count=len(z))
    if len(x) < FEWEST:
        raise InputError("has_points_trace_needs", name=name, x_count=len(x), fewest=FEWEST)
    if not (np.isfinite(x).all() and np.isfinite(z).all()):
        bad = int(np.argmin(np.isfinite(x) & np.isfinite(z)))
        raise InputError("point_all_must_finite", name=name, bad=bad + 1, x=x[bad], z=z[bad])
    steps = np.diff(x)
    if not (steps > 0.0).all():
        bad = int(np.argmin(steps > 0.0))
        raise InputError("goes_from_mm_point", name=name, x=x[bad], x_2=x[bad + 1], bad=bad + 2)
    length = float(x[-1] - x[0])
    least, most = _SHORTEST_MM, _LONGEST_MM
    if not least <= length <= most:
        raise InputError(
            "mm_long_where_mm", name=name, length=length, shortest_mm=least, longest_mm=most
        )
    if float(np.ptp(z)) > 1e3 * _STEEPEST * length:
        raise InputError("heights_span_over_mm", name=name, ptp=np.ptp(z), length=length)
    if float(steps.max()) > _WIDEST_GAP * length:
        bad, gap = int(np.argmax(steps)), 100 * _WIDEST_GAP
        raise InputError(
            "nothing_measured_from_mm", name=name, x=x[bad], x_2=x[bad + 1], widest_gap=gap
        )
