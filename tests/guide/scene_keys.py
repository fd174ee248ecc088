"""The page of all keys, made from the classes that check them: their fields and docstrings."""

import typing
from collections.abc import Iterator
from typing import Any, Literal

from annotated_types import Ge, Gt, Le, Lt, MinLen, MultipleOf
from numpydoc.docscrape import NumpyDocString
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from isochrome.calibration import CalibrationSet, ColourSet
from isochrome.runs import named_units
from isochrome.scene import Scene

SETS = {
    "A scene": (Scene, "for every command that takes `--scene` or SCENE"),
    "A calibration set of a beam or a disc": (
        CalibrationSet,
        "for `isochrome calibrate bending SET` and `calibrate disc SET`",
    ),
    "A calibration set of colours": (ColourSet, "for `isochrome calibrate colour SET`"),
}
NO_KEYS = ("folder", "name", "stated_uncertainty", "fringe_value_date")
LIKE_A_SCENE = ("camera", "polariscope", "frames")
"""Tables of a set that are a scene's."""
SPELT = {"mm2": "mm²", "um": "µm", "pixel": "px", "degree": "°"}

HEAD = """# Every key of a scene and of a calibration set

Scenes and sets are TOML files. The unit stands in the key. What has no default and is not optional
must be there where its table is. A table that is absent is not modelled and costs nothing; an
unknown key is refused. Any single measured number may be written with its standard uncertainty,
`{ value = 14.6, standard_uncertainty = 0.066 }`; that of `specimen.fringe_value_n_per_mm` also with
the day of its calibration, `date = "2026-11-25"` beside these. A value over sliding distance is a
number, or a table `{ distance_m = [0, 50], value = [44, 60] }`, straight in between and constant
beyond. Paths are relative to the file; write them with / or in single quotes.

"""


def page() -> str:
    parts = [HEAD]
    for title, (model, use) in SETS.items():
        parts.append(f"## {title}\n\nIt is {use}.\n\n")
        skipped = () if model is Scene else LIKE_A_SCENE
        if skipped:
            parts.append(
                "Its `[camera]`, `[polariscope]` and `[frames]` are those of a scene, above.\n\n"
            )
        parts += [_table(model, at, words) for at, model, words in tables(model, skipped)]
    return "".join(parts).rstrip("\n") + "\n"


def tables(
    model: type[BaseModel], skipped: tuple[str, ...] = (), at: str = ""
) -> Iterator[tuple[str, type[BaseModel], str]]:
    """The tables of a file: how each is written, its model, and what it is."""
    words = words_of(model)
    own = [name for name in model.model_fields if not (at == "" and name in (*NO_KEYS, *skipped))]
    plain = [name for name in own if model_inside(model.model_fields[name]) is None]
    if plain:
        yield (at or "[top]"), model, ""
    for name in own:
        inner = model_inside(model.model_fields[name])
        if inner is None:
            continue
        several = "tuple" in str(model.model_fields[name].annotation)
        dotted = f"{at.strip('[]')}.{name}" if at else name
        written = f"[[{dotted}]]" if several else f"[{dotted}]"
        for place, found, text in tables(inner, (), written):
            yield place, found, text or (words.get(name, "") if place == written else "")


def model_inside(field: FieldInfo) -> type[BaseModel] | None:
    """The table that a key holds; None for a value, and for one that may be over distance."""
    found = list(_models(field.annotation))
    return found[0] if len(found) == 1 and "distance_m" not in found[0].model_fields else None


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in typing.get_args(annotation):
        yield from _models(inner)


def words_of(model: type[BaseModel]) -> dict[str, str]:
    """What the docstrings of a table's class, and of those it is made from, say of each key."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not (issubclass(base, BaseModel) and base.__doc__ and "Parameters\n" in base.__doc__):
            continue
        text = "\n".join(line.removeprefix("    ") for line in base.__doc__.split("\n"))
        for parameter in NumpyDocString(text)["Parameters"]:
            for name in parameter.name.split(", "):
                found[name] = " ".join(" ".join(parameter.desc).split())
    return found


def _table(model: type[BaseModel], at: str, words: str) -> str:
    about = words or (model.__doc__ or "").strip().split("\n")[0]
    lines = [f"### `{at}`\n\n{about}\n\n" if at != "[top]" else "### in front of all tables\n\n"]
    lines.append("| key | type and range | unit | default | meaning |\n|---|---|---|---|---|\n")
    texts = words_of(model)
    for name, field in model.model_fields.items():
        if name in NO_KEYS or model_inside(field) is not None:
            continue
        cells = (f"`{name}`", kind(field), unit(name), default(field), texts.get(name, ""))
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n")
    return "".join(lines) + "\n"


def unit(name: str) -> str:
    """The unit of a key, as a reader writes it."""
    found = named_units(name).get("units")
    if found is None:
        return "–"
    above, _, below = found.removesuffix("-1").partition(" ")
    spelt = [SPELT.get(part, part) for part in (above, below) if part]
    return "/".join(spelt)


def default(field: FieldInfo) -> str:
    """What holds where a key is absent."""
    if field.is_required():
        return "must be given"
    value = None if field.default is PydanticUndefined else field.default
    if value is None or value == ():
        return "absent"
    return (
        f"`{str(value).lower()}`" if isinstance(value, bool) else f"`{value!r}`".replace("'", '"')
    )


def kind(field: FieldInfo) -> str:
    """The type of a key's values, and where they may lie."""
    found = list(dict.fromkeys(_kinds(field.annotation, field.metadata)))
    return " or ".join(found)


def _kinds(annotation: Any, metadata: Any = ()) -> Iterator[str]:
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        yield from _kinds(inner[0], inner[1:])
    elif origin is Literal:
        yield ", ".join(f'`"{v}"`' if isinstance(v, str) else f"`{v}`" for v in inner)
    elif origin is tuple:
        items = [a for a in inner if a is not Ellipsis]
        each = next(_kinds(items[0]))
        fixed = Ellipsis not in inner
        least = next((m.min_length for m in _limits(metadata) if isinstance(m, MinLen)), None)
        many = (
            f"{len(items)} numbers" if fixed else f"a list{f' of {least} or more' if least else ''}"
        )
        yield f"{many}: {each}"
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield "a table over distance"
    elif inner:
        for one in inner:
            if one is not type(None):
                yield from _kinds(one, metadata)
    else:
        names = {bool: "true or false", int: "whole number", float: "number", str: "text"}
        yield names.get(annotation, str(annotation)) + _range(metadata)


def _limits(metadata: Any) -> Iterator[Any]:
    """The limits in an annotation, those inside pydantic's Field among them."""
    for one in metadata:
        yield from one.metadata if isinstance(one, FieldInfo) else (one,)


def _range(metadata: Any) -> str:
    texts = []
    for one in _limits(metadata):
        if isinstance(one, Gt):
            texts.append(f"> {one.gt:g}")
        elif isinstance(one, Ge):
            texts.append(f"≥ {one.ge:g}")
        elif isinstance(one, Lt):
            texts.append(f"< {one.lt:g}")
        elif isinstance(one, Le):
            texts.append(f"≤ {one.le:g}")
        elif isinstance(one, MultipleOf):
            texts.append(f"in steps of {one.multiple_of:g}")
    return f" {', '.join(texts)}" if texts else ""
