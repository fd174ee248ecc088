"""Friction and load over the sliding distance from the file of a tester.

A tester stores 10^5 rows, most of their digits noise, and a wear run ends a step at every point of
a table. So a long file is followed by few straight lines: of all continuous lines with bends at
some of the rows it is that of least ∫ (v - line)² ds, which keeps ∫ v ds, and stretches are halved
until the mean of what is left, in each quarter of each of them, is below `FOLLOWED` of the largest
value and four standard errors of the file's own noise. What is faster than that is averaged: noise,
and whatever comes back within a few hundredths of the way, such as a roller out of round.

The standard error of a mean over n rows is σ_b √(b/n), with σ_b that of means over b of them, a
quarter of one of FEW stretches: so noise that lasts over many rows is not followed either. It is
from second differences, which a smooth course hardly has: median |v[i-1] - 2 v[i] + v[i+1]| /
(0.6745 √6).
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.output import GivenTable, read_given_table
from isochrome.scene.imaging import STRONGEST

Floats = NDArray[np.floating]

FILE, SPEED = "file", "sliding_speed_mm_per_s"
"""Keys of a part that is read from a file."""

FILES = "table_files"
"""The field of a scene that names the files; no key of a scene's file."""

FEW = 200
"""Rows that are used as they stand, and the points of a longer file's lines at most: a table of so
many noisy points costs a wear run seconds, and one of smooth ones nothing."""
FOLLOWED = 2e-4
"""Of the largest value: what a quarter of a stretch may be off in its mean."""
_STANDARD_ERRORS = 4.0
_AVERAGED = 0.1
"""Of the root mean square of a file: the largest one of what its lines average away."""
_QUARTERS = 4

_GAP, _GAP_CHANGE = 20.0, 0.02
"""A gap is a step of so many times the steps before and after it, over which the value changes by
so much of the largest value, and by more than noise: _STANDARD_ERRORS of its median changes."""

_DISTANCE, _TIME = "distance_m", "time_s"


@dataclass(frozen=True)
class _Kind:
    """What a file holds: the scene's part and key, which is its column, and allowed values."""

    part: str
    key: str
    low: float
    high: float
    allowed: str


_KINDS = (
    _Kind("friction", "coefficient", -STRONGEST, STRONGEST, "it is from -5 to 5"),
    _Kind("load", "normal_n", math.ulp(0.0), math.inf, "it is above 0"),
)

FROM_FILES = tuple(kind.part for kind in _KINDS)
"""Parts that a file may give."""


def with_tables(data: Any, folder: Path | None) -> Any:
    """A scene's tables with those read that stand in files, and the files' names under FILES."""
    if not isinstance(data, dict):
        return data
    tables, files = dict(data), list(data.get(FILES, ()))
    for kind in _KINDS:
        part = tables.get(kind.part)
        if not isinstance(part, dict) or not {FILE, SPEED} & set(part):
            continue
        name, speed = part.get(FILE), part.get(SPEED)
        if not isinstance(name, str) or not name:
            raise InputError(
                "not_allowed_name_csv", part=kind.part, file=FILE, name=name, distance=_DISTANCE,
                time=_TIME, column=kind.key,
            )  # fmt: skip
        if kind.key in part:
            raise InputError("exclude_each_other_remove", part=kind.part, file=FILE, key=kind.key)
        speed = _speed(kind, speed, tables.get("frames"))
        given = read_given_table((folder or Path()) / name, f"the {kind.part}")
        distance, value = _columns(given, kind, speed)
        _refuse_gap(given, kind, distance, value)
        distance, value = few_lines(distance, value, str(given.path))
        others = {key: value for key, value in part.items() if key not in (FILE, SPEED)}
        table = {"distance_m": distance.tolist(), "value": value.tolist()}
        tables[kind.part] = others | {kind.key: table}
        files.append(name)
    return tables | {FILES: tuple(files)} if files else tables


def _speed(kind: _Kind, stated: Any, frames: Any) -> float | None:
    """The sliding speed (mm/s) for a file's times: the part's own, else that of the frames."""
    key, speed = f"{kind.part}.{SPEED}", stated
    if stated is None:
        key = f"frames.{SPEED}"
        speed = frames.get(SPEED) if isinstance(frames, dict) else getattr(frames, SPEED, None)
    if speed is None:
        return None
    number = isinstance(speed, int | float) and not isinstance(speed, bool)
    if not number or not 0.0 < speed < 1e30:
        raise InputError("not_allowed_above_mm", key=key, speed=speed)
    return float(speed)


def _columns(given: GivenTable, kind: _Kind, speed: float | None) -> tuple[Floats, Floats]:
    """Distances (m) and values (n,), checked row by row."""
    place = _DISTANCE if _DISTANCE in given.names else _TIME
    if place not in given.names or kind.key not in given.names:
        raise InputError(
            "has_columns_needs_name", path=given.path, header=given.header, part=kind.part,
            file=FILE, distance=_DISTANCE, time=_TIME, column=kind.key,
        )  # fmt: skip
    at, value = given.column(place), given.column(kind.key)
    if len(at) < 2:
        raise InputError("has_rows_numbers_give", path=given.path, at_count=len(at))
    for column, values, wrong, allowed in (
        (place, at, at < 0.0, "it is 0 or more"),
        (place, at, np.r_[False, np.diff(at) <= 0.0], message("must_rise_from_row")),
        (kind.key, value, (value < kind.low) | (value > kind.high), kind.allowed),
    ):
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(
                "line_not_allowed_correct", path=given.path, lines=given.lines[row], column=column,
                values=values[row], allowed=allowed,
            )  # fmt: skip
    if place == _DISTANCE:
        return at, value
    if speed is None:
        raise InputError(
            "has_times_only_sliding", path=given.path, part=kind.part, speed=SPEED,
            distance=_DISTANCE,
        )  # fmt: skip
    return 1e-3 * speed * at, value


def _refuse_gap(given: GivenTable, kind: _Kind, distance: Floats, value: Floats) -> None:
    """Refuse a long step without rows over which the value has changed."""
    step, change = np.diff(distance), np.abs(np.diff(value))
    if len(step) < 3:
        return
    beside = np.maximum(np.r_[0.0, step[:-1]], np.r_[step[1:], 0.0])
    much = max(
        _GAP_CHANGE * float(np.abs(value).max()), _STANDARD_ERRORS * float(np.median(change))
    )
    gap = np.flatnonzero((step > _GAP * beside) & (change > much))
    if len(gap):
        row = int(gap[0])
        raise InputError(
            "lines_apart_over_times", path=given.path, lines=given.lines[row],
            lines_2=given.lines[row + 1], step=step[row], gap=_GAP, column=kind.key,
            value=value[row], value_2=value[row + 1],
        )  # fmt: skip


def few_lines(distance_m: Floats, value: Floats, label: str) -> tuple[Floats, Floats]:
    """Bends (m), the ends among them, and values of few straight lines that follow a curve.

    The least ∫ (v - Σ c_k hat_k(s))² ds over the c_k; stretches between bends are halved until none
    asks for it (see the module), or FEW bends are used. One of up to FEW points is left as it is.
    InputError where what would be averaged away is more than a tenth of the values.
    """
    count = len(value)
    if count <= FEW:
        return distance_m, value
    from scipy.interpolate import make_lsq_spline

    block = max(1, count // (_QUARTERS * FEW))
    means = value[: count // block * block].reshape(-1, block).mean(axis=1)
    noise = float(np.median(np.abs(np.diff(means, 2)))) / 0.6745 * (block / 6.0) ** 0.5
    allowed = FOLLOWED * float(np.abs(value).max()) + np.finfo(float).tiny
    bends = np.unique(np.linspace(0, count - 1, 5).round().astype(int))
    weight = np.convolve(np.diff(distance_m), [0.5, 0.5]) ** 0.5  # of the trapezoids beside a row
    while True:
        knots = distance_m[[0, *bends, -1]]  # of a spline of the first degree
        fitted = np.asarray(make_lsq_spline(distance_m, value, knots, k=1, w=weight).c)
        residual = value - np.interp(distance_m, distance_m[bends], fitted)
        # of each stretch (m-1,) the largest mean of a quarter, over what is allowed there
        parts = np.arange(_QUARTERS + 1) * np.diff(bends)[:, None] // _QUARTERS + bends[:-1, None]
        rows = np.maximum(np.diff(parts, axis=1), 1)
        over = np.abs(np.diff(np.r_[0.0, np.cumsum(residual)][parts], axis=1)) / rows
        over /= allowed + _STANDARD_ERRORS * noise / np.sqrt(rows)
        worst = np.where(
            np.diff(bends) > 1, over.max(axis=1), 0.0
        )  # nothing lies between neighbours
        order = np.argsort(-worst)[: FEW - len(bends)]
        chosen = order[worst[order] > 1.0]
        if not len(chosen):
            break
        bends = np.union1d(bends, (bends[chosen] + bends[chosen + 1]) // 2)
    residual_rms, size = (float(np.sqrt(np.mean(v**2))) for v in (residual, value))
    if residual_rms > _AVERAGED * size:
        raise InputError(
            "swings_rms_about_mean", label=label, residual_rms=residual_rms, size=size, few=FEW,
            averaged=_AVERAGED,
        )  # fmt: skip
    return distance_m[bends], fitted
