"""A first scene from what the user fills in, commented; and a scene without its model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from isochrome.errors import InputError
from isochrome.scene import Scene, parse_scene, toml_text, with_value, without_value
from isochrome.setup_page.fields import FIELDS, KINDS, SET_KINDS, STATED_SHAPES, SceneField

_ORDER = (
    "specimen", "beam", "disc", "indenter", "load", "friction", "wear", "polariscope", "camera",
    "frames", "uncertainty",
)  # fmt: skip

_OF_A_MODEL = ("indenter", "friction", "wear", "scar", "load", "frames.known_loads_n")
"""Tables and keys that make a scene one of a model."""

_NOUGHT = (False, 0, "")
"""What is as good as nothing said: the scene's own default."""


def new_scene_text(kind: str, values: Mapping[str, Any], no_load: Mapping[str, str]) -> str:
    """A scene or set as TOML from the page's form, each line commented with its unit or meaning.

    Values and files without load go by the scene's keys, None where not filled in. InputError names
    all that such a scene needs.
    """
    kinds = KINDS | SET_KINDS
    if kind not in kinds:
        raise InputError(f"what stands in front of the camera: '{kind}'; one of {', '.join(kinds)}")
    asked = [field for field in FIELDS if kind in field.kinds]
    given = {f.key: values.get(f.key) for f in asked if values.get(f.key) not in (None, *_NOUGHT)}
    missing = [field.label for field in asked if field.needed and field.key not in given]
    if missing:
        what = "set" if kind in SET_KINDS else "scene"
        raise InputError(f"fill in: {', '.join(missing)}; a {what} of {kinds[kind]} needs them")
    given |= no_load
    if "wear.distances_m" not in given:
        given.pop("wear.coefficient_mm2_per_n", None)
    if "wear.distances_m" in given and "friction.coefficient" not in given:
        raise InputError("fill in: Friction coefficient, about; what wears has slid")
    labels = {field.key: field for field in asked}
    return "".join(_lines(kind, given, labels))


def _lines(kind: str, given: Mapping[str, Any], fields: Mapping[str, SceneField]) -> Iterator[str]:
    yield f"# {(KINDS | SET_KINDS)[kind]}; made on the page of `isochrome setup`\n"
    for table in _ORDER:
        own = {key: value for key, value in given.items() if key.startswith(f"{table}.")}
        if not own and (table != "specimen" or kind in SET_KINDS):
            continue
        yield f"\n[{table}]\n"
        if table == "specimen" and kind in STATED_SHAPES:
            yield f"shape = {toml_text(kind)}\n"
        for key, value in own.items():
            line = f"{key.partition('.')[2]} = {toml_text(value)}"
            field = fields.get(key)
            yield f"{line:<33} # {_comment(key, field)}\n"


def _comment(key: str, field: SceneField | None) -> str:
    if field is None:
        return "the unloaded specimen"  # its field stands in the key
    return f"{field.label}, {field.unit}" if field.unit else field.label


def without_model(scene: Scene, text: str) -> Scene:
    """A scene without its model: what remains is read from the image alone.

    InputError where the text's layout cannot be edited.
    """
    if scene.model is None:
        return scene
    for part in _OF_A_MODEL:
        text = without_value(text, part)
    if scene.specimen.shape is not None:
        text = with_value(text, "specimen.shape", '"other"')
    return parse_scene(text, name=scene.name, folder=scene.folder)
