"""The report as one HTML page: nothing is fetched, and nothing of a run is ever code in it."""

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.output import write_text
from isochrome.reporting.content import ReportContent, warnings_with_remedies
from isochrome.reporting.pictures import ROOM_BYTES, encode_frames


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


MOST_BYTES = 10_000_000
"""Of a report, whatever the run's length."""

_LONGEST_SCENE = 300_000
"""Letters: a scene may hold a measured course of a hundred thousand rows."""

_LARGEST_PICTURE = 6_000_000
"""Bytes of a run's own figure, beside what else is in a report without frames."""


def write_report(path: str | Path, content: ReportContent) -> Path:
    """Write a report, whole or not at all; InputError where it cannot be, or is over 10 MB."""
    text = report_html(content)
    size = len(text.encode())
    if size > MOST_BYTES:
        raise InputError(
            "report_would_take_mb", path=path, size=size / 1e6, most_bytes=MOST_BYTES / 1e6
        )
    write_text(path, text)
    return Path(path)


def report_html(content: ReportContent) -> str:
    """The page of a report.

    Its policy of content allows the one style and the one script that are in it, by their hashes,
    and pictures that are in it; no address is ever asked.
    """
    frames = encode_frames(content.frames, room=ROOM_BYTES)
    maps = (one[name] for one in frames for name in ("order", "model_order") if one[name])
    for_script = [  # its pictures stand in the page
        one | {"panes": [{"key": p["key"], "label": p["label"]} for p in one["panes"]]}
        for one in frames
    ]
    return assemble_page(
        "isochrome.reporting",
        "report",
        scripts=("report.js",),
        policy="img-src data:",
        values={
            "content": content,
            "frames": frames,
            "data": {"frames": for_script},
            "strides": sorted({one["stride"] for one in frames}),
            "steps": sorted({one["step"] for one in maps}),  # that orders are rounded to
            "curves": content.curves,
            "groups": warnings_with_remedies(content.warnings),
            "picture": _picture(content.picture),
            "scene": content.scene[:_LONGEST_SCENE],
            "scene_is_cut": len(content.scene) > _LONGEST_SCENE,
        },
    )


def _picture(png: bytes | None) -> str:
    """A PNG as base64; made smaller where it takes too much room."""
    if png is None:
        return ""
    while len(png) * 4 // 3 > _LARGEST_PICTURE:
        import io

        from PIL import Image

        file = io.BytesIO()
        with Image.open(io.BytesIO(png)) as picture:
            small = picture.convert("RGB").resize((picture.width // 2, picture.height // 2))
            small.quantize(128).save(file, "PNG")
        png = file.getvalue()
    return base64.b64encode(png).decode()
