"""A drafted scene as TOML: a line a value with where it comes from, open lines as comments."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import tomli_w

from isochrome.drafting.scene_draft import DraftValue, OpenKey, SceneDraft
from isochrome.output import rounded_texts, with_uncertainty
from isochrome.scene import parse_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLES = ("specimen", "indenter", "load", "friction", "polariscope", "camera", "frames")
"""The tables of a scene, in the order in which they stand."""

_COMMENT_AT, _WIDTH = 34, 100
"""Column of the comments, and the length of a line."""

_WORDS = {"file": "as the file has it", "given": "as given", "found": "found"}


def written_draft(
    head: Sequence[str],
    values: Sequence[DraftValue],
    open_keys: Sequence[OpenKey],
    *,
    warnings: Sequence[str],
    frame: int,
    chi: float | None,
    draw: Callable[[], Figure],
) -> SceneDraft:
    """Write a scene, and read it back as a draft.

    Parameters: `head`, `values` and `open_keys` as in `scene_text`; the others as in SceneDraft.
    """
    text = scene_text(head, values, open_keys)
    return SceneDraft(
        text=text,
        scene=parse_scene(text, name="scene"),
        values=tuple(values),
        open=tuple(open_keys),
        warnings=tuple(warnings),
        frame=frame,
        chi=chi,
        draw=draw,
    )


def scene_text(
    head: Sequence[str], values: Sequence[DraftValue], open_keys: Sequence[OpenKey]
) -> str:
    """Write a scene.

    Parameters: `head`, sentences that stand above it; `values` and `open_keys`, in the order in
    which their tables' lines stand. Returns TOML.
    """
    parts = ["\n".join(line for sentence in head for line in _comment(sentence))]
    for table in TABLES:
        lines = [line for value in values if _table(value.key) == table for line in _line(value)]
        lines += [line for key in open_keys if _table(key.key) == table for line in _open(key)]
        if lines:
            parts.append("\n".join([f"[{table}]", *lines]))
    return "\n\n".join(parts) + "\n"


def _table(key: str) -> str:
    return key.partition(".")[0]


def _line(value: DraftValue) -> list[str]:
    """A value's line; a comment that is too long for it stands above."""
    text, spread = _toml(value)
    words = f"{_WORDS[value.origin]}{f', ± {spread}' if spread else ''}"
    words += f"; {value.note}" if value.note else ""
    entry = f"{value.key.partition('.')[2]} = {text}"
    line = f"{entry.ljust(_COMMENT_AT - 1)} # {words}"
    return [line] if len(line) <= _WIDTH else [*_comment(words), entry]


def _open(key: OpenKey) -> list[str]:
    """A line to fill in, which is a comment until then."""
    return [*_comment(f"fill in: {key.hint}"), f"# {key.key.partition('.')[2]} ="]


def _toml(value: DraftValue) -> tuple[str, str]:
    """A value as TOML, and its uncertainty; as many digits as that allows."""
    if value.standard_uncertainty and not isinstance(value.value, str):
        number, spread = float(value.value), value.standard_uncertainty
        shown = with_uncertainty(number, spread).partition(" ± ")[2]
        return rounded_texts(number, spread)[0], shown
    return tomli_w.dumps({"v": value.value}).removeprefix("v = ").strip(), ""


def _comment(text: str) -> list[str]:
    plain = "".join(c if c.isprintable() else " " for c in text)  # a file's name may hold anything
    hanging = textwrap.TextWrapper(
        _WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False
    )
    return hanging.wrap(plain)
