"""The report as one HTML page: nothing is fetched, and nothing of a run is ever code in it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from isochrome.errors import InputError
from isochrome.output import write_text
from isochrome.reporting.assembly import assemble_page
from isochrome.reporting.content import ReportContent, warnings_with_remedies
from isochrome.reporting.pictures import ROOM_BYTES, encode_frames

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
            f"{path}: the report would take {size / 1e6:.1f} MB, and {MOST_BYTES / 1e6:.0f} MB are "
            "allowed; its texts are too long"
        )
    write_text(path, text)
    return Path(path)


def report_html(content: ReportContent) -> str:
    """The page of a report.

    Its policy of content allows the one style and the one script that are in it, by their hashes,
    and pictures that are in it; no address is ever asked.
    """
    frames = encode_frames(content.frames, room=ROOM_BYTES)
    strides = sorted({one["stride"] for one in frames})
    return assemble_page(
        "isochrome.reporting",
        "report",
        scripts=("report.js",),
        policy="img-src data:",
        values={
            "content": content,
            "frames": frames,
            "data": {"frames": [_for_script(one) for one in frames]},
            "strides": strides,
            "steps": _steps(frames),
            "curves": [curve.drawing() for curve in content.curves],
            "groups": warnings_with_remedies(content.warnings),
            "picture": _picture(content.picture),
            "scene": content.scene[:_LONGEST_SCENE],
            "scene_is_cut": len(content.scene) > _LONGEST_SCENE,
        },
    )


def _steps(frames: Sequence[dict[str, Any]]) -> list[float]:
    """What the orders are rounded to, the finest first."""
    maps = (frame[name] for frame in frames for name in ("order", "model_order"))
    return sorted({one["step"] for one in maps if one})


def _for_script(frame: dict[str, Any]) -> dict[str, Any]:
    """What the script needs of a frame: its pictures stand in the page."""
    panes = [{"key": p["key"], "label": p["label"]} for p in frame["panes"]]
    return frame | {"panes": panes}


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
