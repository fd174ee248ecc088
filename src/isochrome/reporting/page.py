"""The report as one HTML page: nothing is fetched, and nothing of a run is ever code in it."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.output import write_text
from isochrome.reporting.content import ReportContent, warnings_with_remedies
from isochrome.reporting.pictures import ROOM_BYTES, STEP, encode_frames

MOST_BYTES = 10_000_000
"""Of a report, whatever the run's length."""

_LONGEST_SCENE = 300_000
"""Letters: a scene may hold a measured course of a hundred thousand rows."""

_LARGEST_PICTURE = 6_000_000
"""Bytes of a run's own figure, beside what else is in a report without frames."""


def write_report(path: str | Path, content: ReportContent) -> Path:
    """Write a report, whole or not at all.

    Parameters
    ----------
    path : str or Path
        The file.
    content : ReportContent
        What it says.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        Where it cannot be written, or would be larger than 10 MB.
    """
    text = report_html(content)
    size = len(text.encode())
    if size > MOST_BYTES:
        raise InputError(
            f"{path}: the report would take {size / 1e6:.1f} MB, and {MOST_BYTES / 1e6:.0f} MB are "
            "allowed; its texts are too long"
        )
    write_text(path, text)
    return Path(path)


def report_html(content: ReportContent) -> str:
    """Make the page of a report.

    Its policy of content allows the one style and the one script that are in it, by their hashes,
    and pictures that are in it; no address is ever asked.

    Parameters
    ----------
    content : ReportContent
        What it says.

    Returns
    -------
    str
        HTML.

    Notes
    -----
    Source: W3C (2024), Content Security Policy Level 3, section 2.3.1, for the hashes.
    """
    from markupsafe import Markup

    style, script = _part("report.css"), _part("report.js")
    frames = encode_frames(content.frames, room=ROOM_BYTES)
    strides = sorted({one["stride"] for one in frames})
    policy = (
        "default-src 'none'; img-src data:; "
        f"style-src {_hash(style)}; script-src {_hash(script)}; base-uri 'none'; form-action 'none'"
    )
    return str(
        _template().render(
            content=content,
            policy=Markup(policy),  # hashes are of the plain letters of base64
            style=Markup(style),
            script=Markup(script),
            frames=frames,
            data={"step": STEP, "frames": [_for_script(one) for one in frames]},
            strides=strides,
            step=STEP,
            curves=[curve.drawing() for curve in content.curves],
            groups=warnings_with_remedies(content.warnings),
            picture=_picture(content.picture),
            scene=content.scene[:_LONGEST_SCENE],
            scene_is_cut=len(content.scene) > _LONGEST_SCENE,
        )
    )


def _for_script(frame: dict[str, Any]) -> dict[str, Any]:
    """What the script needs of a frame: its pictures stand in the page."""
    panes = [{"key": p["key"], "label": p["label"]} for p in frame["panes"]]
    return {name: value for name, value in frame.items() if name != "notes"} | {"panes": panes}


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


def _hash(text: str) -> str:
    """What a policy calls a text by."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _part(name: str) -> str:
    """A file of this room."""
    return (resources.files("isochrome.reporting") / name).read_text("utf-8")


@cache
def _template() -> Any:
    """The page's template, in which every value is escaped."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(_part("report.html.jinja"))
