"""The values that the page asks for: their words, units and usual ranges."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from importlib import resources
from typing import Any

_TABLES = tomllib.loads(
    (resources.files("isochrome.setup_page") / "fields.toml").read_text("utf-8")
)

KINDS: dict[str, str] = _TABLES["kinds"]
"""What may stand in front of the camera, by the page's words."""

SET_KINDS: dict[str, str] = _TABLES["set_kinds"]
"""What a calibration set may hold, by the page's words."""

STATED_SHAPES = ("disc", "ring", "beam", "other")
"""Kinds that the scene names in specimen.shape."""


@dataclass(frozen=True, kw_only=True)
class SceneField:
    """A value that the page asks for."""

    key: str  # of the scene
    label: str  # what the page calls it
    group: str  # the head it stands under
    kinds: tuple[str, ...] = (*KINDS, *SET_KINDS)  # of KINDS and SET_KINDS, for which it is asked
    unit: str = ""
    usual: str = ""  # stands in the field at first; empty: only the user knows it
    hint: str = ""  # a usual range, or where it is known from
    needed: bool = False  # by a scene of this kind
    choices: tuple[str, ...] = ()  # empty for a number or a list of them


def _made(own: dict[str, Any]) -> SceneField:
    given: dict[str, Any] = {n: tuple(v) if isinstance(v, list) else v for n, v in own.items()}
    return SceneField(**given)


FIELDS = tuple(map(_made, _TABLES["field"]))
"""All of them, in the order of the page."""


def field_rows() -> list[dict[str, Any]]:
    """The fields as plain dictionaries, as the page takes them."""
    return [asdict(field) for field in FIELDS]
