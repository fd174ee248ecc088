"""Measured numbers with what is not known of them: { value = 14.6, standard_uncertainty = 0.066 }.

A scene keeps the plain number, so that all who use it see a float, and beside it the standard
uncertainties by their dotted keys. The material fringe value, which ages with the material, may
carry the day of its calibration too.
"""

import datetime
import math
import typing
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from isochrome.messages import message

VALUE, SPREAD = "value", "standard_uncertainty"
PAIRS = "stated_uncertainty"
"""The field that holds the uncertainties; no key of a file."""
DATED, DATE = "specimen.fringe_value_n_per_mm", "date"
"""The key that may carry the day of its calibration, and how that is called there."""
DATE_FIELD = "fringe_value_date"
"""The field that holds that day; no key of a file."""

_MOST = 1e30
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
    valid = {key: u for key, u in pairs.items() if _is_number(plain, key)}
    if valid or PAIRS in data:
        plain[PAIRS] = tuple(sorted(valid.items()))
    return plain


def split_uncertainties(
    model: type[BaseModel], data: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, float]]:
    """A settings file's tables with plain values, and the standard uncertainties by dotted key.

    These are in the keys' units. ValueError for a form that is not allowed, and for a key that is
    no measured number.
    """
    plain, pairs = dict(data), {}
    for part, table in data.items():
        if part == PAIRS or not isinstance(table, dict):
            continue
        table_model = _table_model(model, part)
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
    """A measured number, not checked yet, and its standard uncertainty from their form in a file.

    ValueError for a form that is not allowed.
    """
    if set(value) != {VALUE, SPREAD}:
        raise ValueError(
            message("not_allowed_measured_number", key=key, dict=dict(value), form=_FORM)
        )
    number, spread = value[VALUE], value[SPREAD]
    if isinstance(number, dict | list | str):
        raise ValueError(message("value_not_allowed_only", key=key, number=number))
    number_like = isinstance(spread, int | float) and not isinstance(spread, bool)
    if not number_like or not math.isfinite(spread) or not 0 <= spread <= _MOST:
        raise ValueError(message("standard_uncertainty_not_allowed_number", key=key, spread=spread))
    return number, float(spread)


def as_text(value: float, standard_uncertainty: float, date: str | None = None) -> str:
    """A value with its uncertainty, and the day of its calibration, as in a TOML file."""
    import tomli_w

    table = {VALUE: value, SPREAD: standard_uncertainty} | ({DATE: date} if date else {})
    lines = tomli_w.dumps(table).split("\n")
    return "{ " + ", ".join(line for line in lines if line) + " }"


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
    return data | {part: table | {name: others}}, _day(value[DATE])


def _day(given: Any) -> str:
    """A day as ISO text. Raises ValueError for all but a date of TOML, or its text."""
    text = given.isoformat() if type(given) is datetime.date else given
    try:
        if datetime.date.fromisoformat(text).isoformat() == text:
            return str(text)
    except (TypeError, ValueError):
        pass  # the same refusal as for other forms of a date
    raise ValueError(
        message("not_allowed_day_calibration", dated=DATED, date=DATE, given=str(given)[:60])
    )


def _table_model(model: type[BaseModel], part: str) -> type[BaseModel] | None:
    """The model of a table, None where there is no such table or its numbers are not measured."""
    if part not in model.model_fields:
        return None
    annotation = model.model_fields[part].annotation
    for kind in (annotation, *typing.get_args(annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _is_measured(annotation: Any) -> bool:
    """Whether a key holds one number that is no count."""
    if typing.get_origin(annotation) is tuple:
        return False
    return annotation is float or any(_is_measured(a) for a in typing.get_args(annotation))


def _is_number(data: Mapping[str, Any], key: str) -> bool:
    """Whether tables hold a plain number at a dotted key."""
    part, _, name = key.partition(".")
    table = data.get(part)
    value = table.get(name) if isinstance(table, dict) else getattr(table, name, None)
    return isinstance(value, int | float) and not isinstance(value, bool)
