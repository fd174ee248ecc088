"""A page of one file: its style and script stand in it, and its policy allows these alone."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any


def assemble_page(
    room: str, name: str, *, scripts: Sequence[str], policy: str, values: dict[str, Any]
) -> str:
    """A page of a room's NAME.html.jinja, NAME.css and scripts, in which every value is escaped.

    The scripts are one, in this order; for `policy` see `content_policy`.
    """
    from markupsafe import Markup

    style, script = _part(room, f"{name}.css"), _joined(room, tuple(scripts))
    return str(
        _template(room, name).render(
            # hashes are of the plain letters of base64
            policy=Markup(content_policy(room, name, scripts=scripts, policy=policy)),
            style=Markup(style),
            script=Markup(script),
            **values,
        )
    )


def content_policy(room: str, name: str, *, scripts: Sequence[str], policy: str) -> str:
    """The policy of a page's content: its one style and script by their hashes.

    `policy` is what else is allowed, such as "img-src data:"; all that is not named is forbidden.
    Source: W3C (2024), Content Security Policy Level 3, section 2.3.1, for the hashes.
    """
    style, script = _part(room, f"{name}.css"), _joined(room, tuple(scripts))
    return (
        f"default-src 'none'; {policy}; style-src {_hash(style)}; script-src {_hash(script)}; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    """What a policy calls a text by."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _joined(room: str, scripts: tuple[str, ...]) -> str:
    return "\n".join(_part(room, name) for name in scripts)


@cache
def _part(room: str, name: str) -> str:
    """A file of a room."""
    return (resources.files(room) / name).read_text("utf-8")


@cache
def _template(room: str, name: str) -> Any:
    """A page's template, in which every value is escaped."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(_part(room, f"{name}.html.jinja"))
