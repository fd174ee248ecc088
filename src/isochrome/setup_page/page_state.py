"""How a scene or set stands, as the page takes it: its values, and where its parts lie.

The values that the page asks for: their words, units and usual ranges.
"""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from importlib import resources
from typing import Any

from isochrome.errors import InputError
from isochrome.scene import Scene, parse_toml
from isochrome.setup_page.places import moved, seen_at
from isochrome.setup_page.session import SetupSession
from isochrome.setup_page.set_session import SetSession

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


def session_state(session: SetupSession) -> dict[str, Any]:
    """How a scene stands: its text and values, and where its parts lie in the picture.

    Plain values, as the page takes them; places are (row, col) of the whole picture.
    """
    scene = session.scene_or_none()
    reader, region = session.reader(scene), session.region(scene)
    rows, cols = reader.shape
    candidates = session.beside()
    state: dict[str, Any] = {
        "revision": session.revision,
        "text": session.text,
        "saved": session.is_saved,
        "scene_file": session.scene_file.name,
        "has_scene": scene is not None,
        "model": scene.model if scene is not None else None,
        "frames": {
            "count": session.count(scene), "rows": rows, "cols": cols,
            "bit_depth": reader.bit_depth, "pixel_mm": reader.pixel_mm,
        },
        "region": region.model_dump(),
        "beside": candidates,
        "values": plain_values(session.text) if scene is not None else {},
        "subject": session.subject,
        "images": _image_rows(session),
        "place": None, "surface": None, "polygon": [], "known_order": [], "known_line": [],
        "free_boundary": [],
    }  # fmt: skip
    return state | (_on_picture(session, scene) if scene is not None else {})


def _image_rows(session: SetupSession) -> list[dict[str, Any]]:
    """The images of a set, and their loads; none of a scene."""
    if not isinstance(session, SetSession):
        return []
    pairs = zip(session.image_names, session.loads(), strict=True)
    return [{"file": name, "load_n": load} for name, load in pairs]


def _on_picture(session: SetupSession, scene: Scene) -> dict[str, Any]:
    """Where the parts of a scene lie in the picture."""
    region = session.region(scene)
    top, left = region.top_px, region.left_px
    found: dict[str, Any] = {
        "polygon": moved(scene.frames.polygon_px or (), top, left),
        "known_order": orders_on_picture(scene, top, left),
        "known_line": lines_on_picture(scene, top, left),
        "free_boundary": boundaries_on_picture(scene, top, left),
        "pixel_mm": None,
    }
    try:
        pixels = session.pixels(scene)
    except InputError:
        return found
    found["pixel_mm"] = pixels.pixel_mm
    if scene.model is None:
        return found
    half = 0.5 * pixels.cols * pixels.pixel_mm
    ends = (seen_at(pixels, x, 0.0) for x in (-half, half))
    place = moved([seen_at(pixels, 0.0, 0.0), *ends], top, left)
    return found | {"place": place[0], "surface": place[1:]}


def orders_on_picture(scene: Scene, top: int, left: int) -> list[dict[str, Any]]:
    """The known points, (row, col) of the whole picture."""
    return [
        {"row": k.row_px + top, "col": k.col_px + left, "order": k.order, "extremum": k.extremum}
        for k in scene.frames.known_order
    ]


def lines_on_picture(scene: Scene, top: int, left: int) -> list[dict[str, Any]]:
    """The known lines, (row, col) of the whole picture."""
    return [
        {"points": moved(line.places, top, left), "order": line.order}
        for line in scene.frames.known_line
    ]


def boundaries_on_picture(scene: Scene, top: int, left: int) -> list[dict[str, Any]]:
    """The free edges' lines, (row, col) of the whole picture."""
    return [{"points": moved(one.places, top, left)} for one in scene.frames.free_boundary]


def plain_values(text: str) -> dict[str, Any]:
    """The values of a scene's text by dotted key, without what is not known of them."""
    tables = parse_toml(text, "scene")
    known = {field.key for field in FIELDS} | {"frames.no_load_dark", "frames.no_load_bright"}
    known |= {"specimen.shape"}
    found = {}
    for table, own in tables.items():
        for name, value in own.items() if isinstance(own, dict) else ():
            if f"{table}.{name}" not in known:
                continue
            pair = isinstance(value, dict) and "value" in value
            found[f"{table}.{name}"] = value["value"] if pair else value
    return found
