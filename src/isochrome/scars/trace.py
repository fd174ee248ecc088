"""A profilometer's trace: heights along a line across the scar, read from a file and checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isochrome.errors import InputError
from isochrome.scars.trace_text import parse_trace

Array = NDArray[Any]

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
        x, z = _numbers(self.x_mm), _numbers(self.z_um)
        if len(x) > 1 and x[-1] < x[0]:
            x, z = x[::-1], z[::-1]
        _check(x, z, self.name)
        object.__setattr__(self, "x_mm", x)
        object.__setattr__(self, "z_um", z)

    @property
    def length_mm(self) -> float:
        """From the first point to the last, mm."""
        return float(self.x_mm[-1] - self.x_mm[0])


def read_trace(path: str | Path) -> Trace:
    """Read a trace from a text file, and name it after the file.

    A line of names, such as `x_mm,z_um` (x, position, distance; z, height), units m, mm, µm (um) or
    nm in the name, in brackets or in a line of their own; cells between commas, semicolons, tabs or
    blanks; decimals by a point, or a comma where cells are not; # begins a comment. Or one profile
    in the ASCII form of ISO 25178-71 (SDF). InputError names the file, the line and the fix.
    """
    place = Path(path)
    x_mm, z_um = parse_trace(place)
    return Trace(x_mm=x_mm, z_um=z_um, name=str(path))


def _numbers(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=np.float64).ravel()


def _check(x: Array, z: Array, name: str) -> None:
    """Raise InputError for what is no trace."""
    if len(x) != len(z):
        raise InputError(f"{name}: {len(x)} places and {len(z)} heights; give as many of each")
    if len(x) < FEWEST:
        raise InputError(
            f"{name}: has {len(x)} points, and a trace needs {FEWEST} at least; export all of them"
        )
    if not (np.isfinite(x).all() and np.isfinite(z).all()):
        bad = int(np.argmin(np.isfinite(x) & np.isfinite(z)))
        raise InputError(
            f"{name}: point {bad + 1} is {x[bad]:g}, {z[bad]:g}, and all must be finite numbers; "
            "leave out what was not measured"
        )
    steps = np.diff(x)
    if not (steps > 0.0).all():
        bad = int(np.argmin(steps > 0.0))
        raise InputError(
            f"{name}: x goes from {x[bad]:.6g} to {x[bad + 1]:.6g} mm at point {bad + 2}, and must "
            "go one way throughout; give one trace a file, in its order"
        )
    length = float(x[-1] - x[0])
    if not _SHORTEST_MM <= length <= _LONGEST_MM:
        raise InputError(
            f"{name}: is {length:.4g} mm long, where {_SHORTEST_MM:g} to {_LONGEST_MM:g} mm is a "
            "trace over a scar; check the unit of x (mm, µm) in its column's name"
        )
    if float(np.ptp(z)) > 1e3 * _STEEPEST * length:
        raise InputError(
            f"{name}: its heights span {np.ptp(z):.4g} µm over {length:.4g} mm, which is no worn "
            "surface; check the unit of z (µm, mm) in its column's name"
        )
    if float(steps.max()) > _WIDEST_GAP * length:
        bad = int(np.argmax(steps))
        raise InputError(
            f"{name}: nothing was measured from {x[bad]:.4g} to {x[bad + 1]:.4g} mm, a gap of over "
            f"{100 * _WIDEST_GAP:g} % of the trace; measure it again without the gap"
        )
