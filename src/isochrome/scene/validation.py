"""How the tables of a settings file become a scene's, and what is wrong with them in one sentence.

Of a measured number, { value = 14.6, standard_uncertainty = 0.066 }, a scene keeps the plain value,
so that all who use it see a float, and beside it the standard uncertainties by their dotted keys.

A tester's file of friction or load over the distance has 10^5 rows, most of their digits noise, and
a wear run ends a step at every point of a table. So a long file is followed by few straight lines:
of all continuous lines with bends at some of the rows it is that of least ∫ (v - line)² ds, which
keeps ∫ v ds, and stretches are halved until the mean of what is left, in each quarter of each of
them, is below `FOLLOWED` of the largest value and four standard errors of the file's own noise.
What is faster than that is averaged: noise, and whatever comes back within a few hundredths of the
way, such as a roller out of round.

The standard error of a mean over n rows is σ_b √(b/n), with σ_b that of means over b of them, a
quarter of one of FEW stretches: so noise that lasts over many rows is not followed either. It is
from second differences, which a smooth course hardly has, median |Δ²v| / (0.6745 √6).
"""

import datetime
import difflib
import math
import typing
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.output import GivenTable, read_given_table
from isochrome.scene.imaging import NUMBER, STRONGEST, TABLE

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


_COURSES = {
    "friction": ("coefficient", -STRONGEST, STRONGEST, "it is from -5 to 5"),
    "load": ("normal_n", math.ulp(0.0), math.inf, "it is above 0"),
}
"""Parts that a file may give: the key, which is its column, its least and largest value."""


def with_tables(data: Any, folder: Path | None) -> Any:
    """A scene's tables with those read that stand in files, and the files' names under FILES."""
    if not isinstance(data, dict):
        return data
    tables, files = dict(data), list(data.get(FILES, ()))
    for part, (key, *_) in _COURSES.items():
        table = tables.get(part)
        if not isinstance(table, dict) or not {FILE, SPEED} & set(table):
            continue
        name = table.get(FILE)
        if not isinstance(name, str) or not name:
            raise InputError(
                "not_allowed_name_csv", part=part, file=FILE, name=name, distance=_DISTANCE,
                time=_TIME, column=key,
            )  # fmt: skip
        if key in table:
            raise InputError("exclude_each_other_remove", part=part, file=FILE, key=key)
        given = read_given_table((folder or Path()) / name, f"the {part}")
        distance, value = _columns(given, part, _speed(part, table, tables.get("frames")))
        _refuse_gap(given, key, distance, value)
        distance, value = few_lines(distance, value, str(given.path))
        others = {name: entry for name, entry in table.items() if name not in (FILE, SPEED)}
        tables[part] = others | {key: {"distance_m": distance.tolist(), "value": value.tolist()}}
        files.append(name)
    return tables | {FILES: tuple(files)} if files else tables


def _speed(part: str, table: dict[str, Any], frames: Any) -> float | None:
    """The sliding speed (mm/s) for a file's times: the part's own, else that of the frames."""
    key, speed = f"{part}.{SPEED}", table.get(SPEED)
    if speed is None:
        key = f"frames.{SPEED}"
        speed = frames.get(SPEED) if isinstance(frames, dict) else getattr(frames, SPEED, None)
    number = isinstance(speed, int | float) and not isinstance(speed, bool)
    if speed is not None and not (number and 0.0 < speed < 1e30):
        raise InputError("not_allowed_above_mm", key=key, speed=speed)
    return speed


def _columns(given: GivenTable, part: str, speed: float | None) -> tuple[Floats, Floats]:
    """Distances (m) and values (n,), checked row by row."""
    key, low, high, allowed = _COURSES[part]
    place = _DISTANCE if _DISTANCE in given.names else _TIME
    if place not in given.names or key not in given.names:
        raise InputError(
            "has_columns_needs_name", path=given.path, header=given.header, part=part, file=FILE,
            distance=_DISTANCE, time=_TIME, column=key,
        )  # fmt: skip
    at, value = given.column(place), given.column(key)
    if len(at) < 2:
        raise InputError("has_rows_numbers_give", path=given.path, at_count=len(at))
    for column, values, wrong, right in (
        (place, at, at < 0.0, "it is 0 or more"),
        (place, at, np.r_[False, np.diff(at) <= 0.0], message("must_rise_from_row")),
        (key, value, (value < low) | (value > high), allowed),
    ):
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(
                "line_not_allowed_correct", path=given.path, lines=given.lines[row], column=column,
                values=values[row], allowed=right,
            )  # fmt: skip
    if place == _DISTANCE:
        return at, value
    if speed is None:
        raise InputError(
            "has_times_only_sliding", path=given.path, part=part, speed=SPEED, distance=_DISTANCE
        )
    return 1e-3 * float(speed) * at, value


def _refuse_gap(given: GivenTable, key: str, distance: Floats, value: Floats) -> None:
    """Refuse a long step without rows over which the value has changed."""
    step, change = np.diff(distance), np.abs(np.diff(value))
    if len(step) < 3:
        return
    beside = np.maximum(np.r_[0.0, step[:-1]], np.r_[step[1:], 0.0])
    noise = _STANDARD_ERRORS * float(np.median(change))
    much = max(_GAP_CHANGE * float(np.abs(value).max()), noise)
    gap = np.flatnonzero((step > _GAP * beside) & (change > much))
    if len(gap):
        row = int(gap[0])
        raise InputError(
            "lines_apart_over_times", path=given.path, lines=given.lines[row],
            lines_2=given.lines[row + 1], step=step[row], gap=_GAP, column=key,
            value=value[row], value_2=value[row + 1],
        )  # fmt: skip


def few_lines(distance_m: Floats, value: Floats, label: str) -> tuple[Floats, Floats]:
    """Bends (m), the ends among them, and values of few straight lines that follow a curve (see the
    module): the least ∫ (v - Σ c_k hat_k(s))² ds over the c_k, with FEW bends at most; up to FEW
    points stay as they are. InputError: more than a tenth of the values would be averaged away."""
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
        # nothing lies between neighbours
        worst = np.where(np.diff(bends) > 1, over.max(axis=1), 0.0)
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


VALUE, SPREAD = "value", "standard_uncertainty"
PAIRS = "stated_uncertainty"
"""The field that holds the uncertainties; no key of a file."""
DATED, DATE = "specimen.fringe_value_n_per_mm", "date"
"""The key that may carry the day of its calibration, and how that is called there."""
DATE_FIELD = "fringe_value_date"
"""The field that holds that day; no key of a file."""

_UNMEASURED = ("numerics",)
"""Tables whose numbers nobody measures."""

_FORM = "{ value = 14.6, standard_uncertainty = 0.066 }"


def with_pairs(model: type[BaseModel], data: Any) -> Any:
    """A scene's tables with plain values, and all uncertainties as sorted pairs under PAIRS. One
    stated before stays where the value is still a number; the day of the fringe value's
    calibration, under DATE_FIELD, goes with a value and uncertainty that are stated anew."""
    if not isinstance(data, dict):
        return data
    data, date = _without_date(data)
    plain, stated = split_uncertainties(model, data)
    if DATED in stated:
        plain.pop(DATE_FIELD, None)
    if date is not None:
        plain[DATE_FIELD] = date
    pairs = dict(data.get(PAIRS, ())) | stated
    valid = {}
    for key, spread in pairs.items():
        part, _, name = key.partition(".")
        table = plain.get(part)
        value = table.get(name) if isinstance(table, dict) else getattr(table, name, None)
        if isinstance(value, int | float) and not isinstance(value, bool):
            valid[key] = spread
    if valid or PAIRS in data:
        plain[PAIRS] = tuple(sorted(valid.items()))
    return plain


def split_uncertainties(
    model: type[BaseModel], data: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, float]]:
    """Plain tables, and the uncertainties by dotted key, in the keys' units. ValueError."""
    plain, pairs = dict(data), {}
    for part, table in data.items():
        if part == PAIRS or not isinstance(table, dict):
            continue
        field = model.model_fields.get(part)
        table_model = _model_inside(field.annotation) if field is not None else None
        stated = {n: v for n, v in table.items() if isinstance(v, dict) and SPREAD in v}
        for name, value in stated.items():
            if table_model is not None and name in table_model.model_fields:
                key = f"{part}.{name}"
                annotation = table_model.model_fields[name].annotation
                if part in _UNMEASURED or not _is_measured(annotation):
                    raise ValueError(message("no_measured_number_has", key=key))
                pairs[key] = plain_value(key, value)[1]
        plain[part] = table | {n: v.get(VALUE) for n, v in stated.items()}
    return plain, pairs


def plain_value(key: str, value: Mapping[str, Any]) -> tuple[Any, float]:
    """A measured number, not checked yet, and its uncertainty; ValueError: another form."""
    if set(value) != {VALUE, SPREAD}:
        raise ValueError(
            message("not_allowed_measured_number", key=key, dict=dict(value), form=_FORM)
        )
    number, spread = value[VALUE], value[SPREAD]
    if isinstance(number, dict | list | str):
        raise ValueError(message("value_not_allowed_only", key=key, number=number))
    number_like = isinstance(spread, int | float) and not isinstance(spread, bool)
    if not number_like or not math.isfinite(spread) or not 0 <= spread <= LARGEST:
        raise ValueError(message("standard_uncertainty_not_allowed_number", key=key, spread=spread))
    return number, float(spread)


def _without_date(data: dict[str, Any]) -> tuple[dict[str, Any], str | None]:
    """A scene's tables without the day of the fringe value's calibration, and that day as text."""
    part, _, name = DATED.partition(".")
    table = data.get(part)
    value = table.get(name) if isinstance(table, dict) else None
    if not isinstance(table, dict) or not isinstance(value, dict) or DATE not in value:
        return data, None
    others = dict(value)
    given = others.pop(DATE)
    if SPREAD not in others:
        raise ValueError(
            message("not_allowed_measured_number_written", dated=DATED, value=value, form=_FORM)
        )
    text = given.isoformat() if type(given) is datetime.date else given
    with suppress(TypeError, ValueError):  # the same refusal as for other forms of a date
        if datetime.date.fromisoformat(text).isoformat() == text:
            return data | {part: table | {name: others}}, str(text)
    raise ValueError(
        message("not_allowed_day_calibration", dated=DATED, date=DATE, given=str(given)[:60])
    )


def _is_measured(annotation: Any) -> bool:
    """Whether a key holds one number that is no count."""
    if typing.get_origin(annotation) is tuple:
        return False
    return annotation is float or any(_is_measured(a) for a in typing.get_args(annotation))


NO_KEYS = ("folder", "name", PAIRS, DATE_FIELD, FILES)
"""Fields of a scene that are no keys of its file."""

LARGEST = 1e30
"""In any unit, what is beyond is a slip."""

OTHER_NAMES = {
    "fsigma": "fringe_value_n_per_mm", "fs": "fringe_value_n_per_mm",
    "materialfringevalue": "fringe_value_n_per_mm", "fringevalue": "fringe_value_n_per_mm",
    "mu": "coefficient", "youngsmodulus": "young_gpa", "nu": "poisson", "poissonratio": "poisson",
}  # fmt: skip
"""What other texts call a key, without underscores."""
OTHER_NAMES_UNITS = {
    "fringe_value_n_per_mm": "in N/mm per fringe (1 kN/m per fringe is 1 N/mm)",
    "coefficient": "a number without a unit",
    "young_gpa": "in GPa (1000 MPa are 1 GPa)",
    "poisson": "a number without a unit",
}
UNITS = {
    "mm": "mm", "um": "µm", "m": "m", "cm": "cm", "nm": "nm", "gpa": "GPa", "mpa": "MPa",
    "pa": "Pa", "n": "N", "kn": "kN", "deg": "degrees", "rad": "radians", "px": "pixels",
}  # fmt: skip
"""Endings of keys that are units."""

M = typing.TypeVar("M", bound=BaseModel)


def validate(
    model: type[M],
    data: dict[str, Any],
    label: str,
    *,
    reserved: tuple[str, ...] = (),
    folder: Path | None = None,
) -> M:
    """Check a dictionary; InputError: its first mistake. `reserved` are fields, no keys."""
    for key in reserved:
        if key in data:
            raise InputError("unknown_key_remove", label=label, key=key)
    try:
        return model.model_validate(data, context=folder)
    except ValidationError as error:
        raise InputError(f"{label}: " + _sentence(model, error)) from error


def check_reach(data: Any, label: str, key: str = "") -> None:
    """Refuse numbers of a settings file whose powers are beyond all numbers; `key`, their place."""
    if isinstance(data, dict):
        for name, value in data.items():
            check_reach(value, label, f"{key}.{name}" if key else str(name))
    elif isinstance(data, list | tuple):
        for number, value in enumerate(data, start=1):
            check_reach(value, label, f"{key}[{number}]")
    elif isinstance(data, float) and data and not 1 / LARGEST <= abs(data) <= LARGEST:
        raise InputError(
            "not_allowed_size_should", label=label, key=key, data=data, largest=1 / LARGEST,
            largest_2=LARGEST,
        )  # fmt: skip


def _sentence(model: type[BaseModel], error: ValidationError) -> str:
    """The first mistake of a validation as one sentence, unknown keys before all others."""
    errors = error.errors(include_url=False)
    first = next((e for e in errors if e["type"] == "extra_forbidden"), errors[0])
    known = _keys_beside(model, first["loc"])
    key = ""
    for item in first["loc"]:
        if isinstance(item, int):
            key += f"[{item + 1}]"
        elif item not in (NUMBER, TABLE):
            key += f".{item}" if key else item
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    if first["type"] == "extra_forbidden":
        return f"unknown key '{key}'; {_meant(str(first['loc'][-1]), known)}{more}"
    if first["type"] == "missing":
        return message("key_missing_add", key=key, more=more)
    text = first["msg"].removeprefix("Value error, ")
    if not key:
        return f"{text}{more}"
    if first["type"] == "value_error":
        return f"[{key}] {text}{more}"
    value, allowed = " ".join(repr(first["input"]).split()), text[0].lower() + text[1:]
    value = value if len(value) <= 60 else value[:57] + "..."
    return message("not_allowed_correct", key=key, value=value, allowed=allowed, more=more)


def _meant(word: str, known: list[str]) -> str:
    """What an unknown key should be: by another name of the field, in another unit, or misspelt."""
    field = OTHER_NAMES.get(word.lower().replace("_", ""))
    if field in known:
        return f"it is called '{field}' here, {OTHER_NAMES_UNITS[field]}"
    near = nearest(word, known)
    if near is None:
        return "known here: " + ", ".join(known)
    given, wanted = (name.rpartition("_") for name in (word, near))
    other = given[0] == wanted[0] and given[2] in UNITS and wanted[2] in UNITS
    unit = f" It is in {UNITS[wanted[2]]}, not {UNITS[given[2]]}" if other else ""
    return f"did you mean '{near}'?{unit}"


def _keys_beside(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """Keys that are known in the table where an error's place lies."""
    here: type[BaseModel] = model
    for item in loc[:-1]:
        if isinstance(item, str) and item in here.model_fields:
            inner = _model_inside(here.model_fields[item].annotation)
            if inner is None:
                break
            here = inner
    known = [k for k in here.model_fields if k not in NO_KEYS]
    return known + ([FILE, SPEED] if loc and loc[0] in _COURSES else [])


def _model_inside(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_model_inside, typing.get_args(annotation))), None)


def nearest(word: str, known: list[str]) -> str | None:
    """The known word most like a misspelt one, or None where none is near."""
    return next(iter(difflib.get_close_matches(word, known, n=1, cutoff=0.6)), None)
