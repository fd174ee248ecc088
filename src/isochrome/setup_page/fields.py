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
    """A value that the page asks for.

    Parameters
    ----------
    key : str
        Its key of the scene.
    label : str
        What the page calls it.
    group : str
        Under which head it stands.
    kinds : tuple of str, optional
        For which of KINDS and SET_KINDS it is asked; by default for all.
    unit : str, default ''
        Its unit.
    usual : str, default ''
        A value that is usual, as it stands in the field at first; empty where only the user
        knows it.
    hint : str, default ''
        A usual range, or where it is known from.
    needed : bool, default False
        Whether a scene of this kind needs it.
    choices : tuple of str, default ()
        What may be chosen; empty for a number or a list of them.
    """

    key: str
    label: str
    group: str
    kinds: tuple[str, ...] = (*KINDS, *SET_KINDS)
    unit: str = ""
    usual: str = ""
    hint: str = ""
    needed: bool = False
    choices: tuple[str, ...] = ()


def _made(own: dict[str, Any]) -> SceneField:
    given: dict[str, Any] = {n: tuple(v) if isinstance(v, list) else v for n, v in own.items()}
    return SceneField(**given)


FIELDS = tuple(map(_made, _TABLES["field"]))
"""All of them, in the order of the page."""


def field_rows() -> list[dict[str, Any]]:
    """List the fields as plain dictionaries, as the page takes them.

    Returns
    -------
    list of dict
        One for each.
    """
    return [asdict(field) for field in FIELDS]
