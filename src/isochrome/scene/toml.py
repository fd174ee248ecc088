"""Scenes in and out of TOML, with errors that name the file, the key, the value and the fix."""

from __future__ import annotations

import difflib
import tomllib
import typing
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from isochrome.errors import InputError
from isochrome.scene.scene import Scene

MAX_BYTES = 1_000_000
"""A settings file of over a megabyte is not one."""

M = typing.TypeVar("M", bound=BaseModel)


def load_scene(scene: str | Path | Scene) -> Scene:
    """Read a scene: a TOML file's path, or the name of one inside the package.

    Parameters: `scene`, a path, a name such as 'line-contact-wear', or a Scene (returned as it is).
    Returns the validated Scene. Raises InputError that names the file, key, value and fix.
    """
    if isinstance(scene, Scene):
        return scene
    path = Path(scene)
    if str(scene) in scene_names():
        text = (resources.files("isochrome.scene") / "library" / f"{scene}.toml").read_text("utf-8")
        return parse_scene(text, name=str(scene))
    if not path.is_file():
        near = nearest(str(scene), scene_names())
        hint = f"did you mean '{near}'?" if near else "scenes by name: " + ", ".join(scene_names())
        raise InputError(f"{scene}: no such scene file; {hint}")
    return parse_scene(read_text(path), name=path.stem, folder=path.parent, label=str(path))


def parse_scene(
    text: str, *, name: str = "scene", folder: Path | None = None, label: str | None = None
) -> Scene:
    """Make a scene from TOML text; `label` names it in errors, `folder` anchors its paths."""
    data = parse_toml(text, label or name)
    scene = validate(Scene, data, label or name, reserved=("folder", "name"))
    return scene.model_copy(update={"name": name, "folder": folder})


def dump_scene(scene: Scene) -> str:
    """Write a scene as TOML text; reading it back gives an equal scene."""
    import tomli_w

    return tomli_w.dumps(scene.model_dump(mode="json", exclude_none=True, exclude_unset=True))


def scene_names() -> list[str]:
    """Names of the scenes that ship inside the package."""
    folder = resources.files("isochrome.scene") / "library"
    return sorted(
        p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")
    )


def read_text(path: Path) -> str:
    """Text of a settings file; InputError where it is missing, too large or not UTF-8."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES} bytes; is it a settings file?")
        return path.read_text("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text; save it as UTF-8") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its name") from error


def parse_toml(text: str, label: str) -> dict[str, Any]:
    """TOML text as a dictionary; InputError with the line where it is not TOML."""
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{label}: not valid TOML: {error}; correct that line") from error


def validate(
    model: type[M], data: dict[str, Any], label: str, *, reserved: tuple[str, ...] = ()
) -> M:
    """Check a dictionary against a pydantic model; one InputError that names the first mistake."""
    for key in reserved:
        if key in data:
            raise InputError(f"{label}: unknown key '{key}'; remove it")
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{label}: {_sentence(model, error)}") from error


def _sentence(model: type[BaseModel], error: ValidationError) -> str:
    """The first mistake of a validation as one sentence, unknown keys before all others."""
    found = error.errors(include_url=False)
    first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
    known = _keys_beside(model, first["loc"])
    key = _dotted(first["loc"])
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    if first["type"] == "extra_forbidden":
        near = nearest(str(first["loc"][-1]), known)
        hint = f"did you mean '{near}'?" if near else "known here: " + ", ".join(known)
        return f"unknown key '{key}'; {hint}{more}"
    if first["type"] == "missing":
        return f"the key '{key}' is missing; add it{more}"
    message = first["msg"].removeprefix("Value error, ")
    if not key:
        return f"{message}{more}"
    if first["type"] == "value_error":
        return f"[{key}] {message}{more}"
    allowed = message[0].lower() + message[1:]
    return f"{key} = {_short(first['input'])} is not allowed: {allowed}; correct it{more}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _dotted(loc: tuple[int | str, ...]) -> str:
    text = ""
    for item in loc:
        if isinstance(item, int):
            text += f"[{item + 1}]"
        elif item not in ("DistanceTable", "float") and not item.startswith("constrained"):
            text += f".{item}" if text else item
    return text


def _keys_beside(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """Keys that are known in the table where an error's place lies."""
    here: type[BaseModel] = model
    for item in loc[:-1]:
        if isinstance(item, str) and item in here.model_fields:
            inner = _model_inside(here.model_fields[item].annotation)
            if inner is None:
                break
            here = inner
    return [k for k in here.model_fields if k not in ("folder", "name")]


def _model_inside(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inside = (_model_inside(a) for a in typing.get_args(annotation))
    return next((a for a in inside if a is not None), None)


def nearest(word: str, known: list[str]) -> str | None:
    """The known word most like a misspelt one, or None where none is near."""
    found = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return found[0] if found else None
