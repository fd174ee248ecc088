"""What is wrong with a settings file, as one sentence: key, value, what is allowed, the fix.

Of a measured number, { value = 14.6, standard_uncertainty = 0.066 }, a scene keeps the plain value,
so that all who use it see a float, and beside it the standard uncertainties by their dotted keys.
"""

import datetime
import difflib
import math
import typing
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from isochrome.errors import InputError
from isochrome.messages import message
from isochrome.scene.imaging import NUMBER, TABLE
from isochrome.scene.measured_course import FILE, FILES, FROM_FILES, SPEED

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
    """A scene's tables with plain values, and all uncertainties as sorted pairs under PAIRS.

    An uncertainty stated before stays where the value is still a number. The day of the fringe
    value's calibration comes under DATE_FIELD; one stated before goes with a value and uncertainty
    that are stated anew. ValueError, see `split_uncertainties`.
    """
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
    """Tables with plain values, and the uncertainties by dotted key, in the keys' units.

    ValueError for a form that is not allowed, and for a key that is no measured number.
    """
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
    others = {entry: stated for entry, stated in value.items() if entry != DATE}
    if SPREAD not in others:
        raise ValueError(
            message("not_allowed_measured_number_written", dated=DATED, value=value, form=_FORM)
        )
    given = value[DATE]
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
    """Check a dictionary against a pydantic model; InputError names the first mistake.

    `reserved` are fields that are no keys; names of files are relative to `folder`.
    """
    for key in reserved:
        if key in data:
            raise InputError("unknown_key_remove", label=label, key=key)
    try:
        return model.model_validate(data, context=folder)
    except ValidationError as error:
        raise InputError(f"{label}: " + _sentence(model, error)) from error


def check_reach(data: Any, label: str, key: str = "") -> None:
    """Refuse numbers of a settings file whose powers would be beyond all numbers; `key` is where
    `data` is.
    """
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
    return known + ([FILE, SPEED] if loc and loc[0] in FROM_FILES else [])


def _model_inside(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inside = (_model_inside(a) for a in typing.get_args(annotation))
    return next((a for a in inside if a is not None), None)


def nearest(word: str, known: list[str]) -> str | None:
    """The known word most like a misspelt one, or None where none is near."""
    matches = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return matches[0] if matches else None
