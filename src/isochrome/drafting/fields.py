"""What is asked for of a bench: by the set-up page, by `init`, and by its command line."""

import tomllib
from dataclasses import dataclass
from importlib import resources
from typing import Any

_TABLES: dict[str, Any] = tomllib.loads(
    (resources.files("isochrome.drafting") / "fields.toml").read_text("utf-8")
)

KINDS: dict[str, str] = _TABLES["kinds"]
"""What may stand in front of the camera, by the page's words."""

SET_KINDS: dict[str, str] = _TABLES["set_kinds"]
"""What a calibration set may hold, by the page's words."""

STATED_SHAPES = ("disc", "ring", "beam", "other")
"""Kinds that the scene names in specimen.shape."""


@dataclass(frozen=True, kw_only=True)
class SceneField:
    """A value that is asked for."""

    key: str  # of the scene
    label: str  # what the page calls it
    group: str  # the head it stands under
    kinds: tuple[str, ...] = (*KINDS, *SET_KINDS)  # of KINDS and SET_KINDS, for which it is asked
    unit: str = ""
    usual: str = ""  # stands in the field at first; empty: only the user knows it
    hint: str = ""  # a usual range, or where it is known from
    needed: bool = False  # by a scene of this kind
    choices: tuple[str, ...] = ()  # empty for a number or a list of them
    option: str = ""  # its name among what `init` asks for; empty: it does not
    words: str = ""  # what it is, where there is no page
    range: str = ""  # what it usually is

    @property
    def title(self) -> str:
        """What the page calls it, with its unit."""
        return f"{self.label}{self.unit and f', {self.unit}'}"

    @property
    def question(self) -> str:
        """What to ask for: words, unit and the usual range."""
        return f"{self.words}{self.unit and f' ({self.unit})'}, usually {self.range}"


FIELDS = tuple(
    SceneField(
        **{"hint": entry.get("range", "")}
        | {n: tuple(v) if isinstance(v, list) else v for n, v in entry.items()}
    )
    for entry in _TABLES["field"]
)
"""All of them, in the order of the page."""

OPTIONS = {field.option: field for field in FIELDS if field.option}
"""What `init` takes of them, by the name of its field in KnownValues."""

QUANTITIES = {name: field for name, field in OPTIONS.items() if field.words}
"""What of that a user can look up or measure."""
