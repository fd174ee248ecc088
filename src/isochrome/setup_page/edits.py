"""What the page's tools do to the scene's text, and how the scene looks on the picture.

A first scene from what the user fills in, commented; and a scene without its model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from isochrome.calibration import fit_circle
from isochrome.errors import InputError, IsochromeError
from isochrome.frames import likely_no_load
from isochrome.scene import (
    Scene,
    parse_scene,
    toml_text,
    with_table_list,
    with_value,
    without_value,
)
from isochrome.setup_page.page_state import (
    FIELDS,
    KINDS,
    SET_KINDS,
    STATED_SHAPES,
    SceneField,
    boundaries_on_picture,
    lines_on_picture,
    orders_on_picture,
    plain_values,
)
from isochrome.setup_page.places import (
    cut_out,
    moved,
    on_line,
    pixel_scale,
    placed_at,
    seen_at,
    surface_roll,
)
from isochrome.setup_page.session import SetupSession
from isochrome.setup_page.set_session import SetSession, with_loads
from isochrome.stress import PixelGrid

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


LEFT, TOP, ROLL = "camera.left_mm", "camera.top_mm", "camera.roll_deg"
_PIXEL, _PIXEL_SPREAD = "camera.pixel_mm", "uncertainty.pixel_mm"
_DIGITS = 6
"""Of lengths: a nanometre."""

_CLICK_PX = 0.5
"""Standard uncertainty of a point that a user sets on an edge, px."""

_FROM_ROLLERS, _FEWEST_COLS = 0.5, 20
"""Heights of a beam from a roller to where its stress is that of bending alone; columns to read."""

_AROUND_RIM = 1.08
"""Half the side of a disc's region over its radius: the rim is found against the air about it."""

Asked = Mapping[str, Any]
"""What a tool sends: plain JSON."""


def set_values(text: str, values: Mapping[str, Any]) -> str:
    """Give a scene's text with some values; None takes a key out.

    The ± of a set's scale goes with the scale that it was stated for.

    Parameters: `text`, TOML; `values` by the scene's keys. Returns TOML. Raises InputError.
    """
    if _PIXEL in values and _PIXEL_SPREAD not in values:
        text = without_value(text, _PIXEL_SPREAD)
    for key, value in values.items():
        if key.count(".") != 1:
            raise InputError(f"{key!r}: is no key of a scene; write it as 'load.normal_n'")
        if value is None or value == "":
            text = without_value(text, key)
        else:
            text = with_value(text, key, toml_text(value))
    return text


def _values(session: SetupSession, asked: Asked) -> None:
    given = asked["values"]
    session.change(lambda text: set_values(text, given))


def _new(session: SetupSession, asked: Asked) -> None:
    """A scene from the form, in place of none."""
    no_load = likely_no_load(session.beside())
    text = new_scene_text(asked["kind"], asked["values"], no_load)
    if isinstance(session, SetSession):
        if asked["kind"] != session.subject:
            raise InputError(f"kind = {asked['kind']!r}: this is a set of '{session.subject}'")
        text = with_loads(text, session.image_names, _loads_of(session, asked))
    session.change(lambda _: text)


def _text(session: SetupSession, asked: Asked) -> None:
    given = str(asked["text"])
    session.change(lambda _: given)


def _scale(session: SetupSession, asked: Asked) -> None:
    """Two points and a length; the place of the contact in the picture stays."""
    first, second = asked["points"]
    pixel = float(f"{pixel_scale(first, second, float(asked['length_mm'])):.6g}")
    scene = session.scene()
    values: dict[str, Any] = {_PIXEL: pixel}
    camera = scene.camera
    if camera is not None and camera.pixel_mm is not None:
        share = pixel / camera.pixel_mm
        for key, edge in ((LEFT, camera.left_mm), (TOP, camera.top_mm)):
            if edge is not None:
                values[key] = round(edge * share, _DIGITS)
    session.change(lambda text: set_values(text, values))


def _set_of(session: SetupSession) -> SetSession:
    """The session of a calibration set. Raises InputError for a scene's."""
    if not isinstance(session, SetSession):
        raise InputError("this tool is for calibration sets; start setup with --calibration")
    return session


def _loads_of(session: SetSession, asked: Asked) -> list[float | None]:
    """A load for each image; None for one that is not of the set."""
    given = [None if load is None else float(load) for load in asked["loads"]]
    if len(given) != len(session.image_names):
        raise InputError(f"loads: {len(given)}, and there are {len(session.image_names)} images")
    return given


def _loads(session: SetupSession, asked: Asked) -> None:
    own = _set_of(session)
    given = _loads_of(own, asked)
    session.change(lambda text: with_loads(text, own.image_names, given))


def _sized(session: SetupSession, asked: Asked, key: str) -> dict[str, Any]:
    """The scale, and its uncertainty, by two points that are a length of the beam's apart."""
    length = plain_values(session.text).get(key)
    if length is None:
        raise InputError(f"{key} is not known yet; fill it in first")
    first, second = asked["points"]
    pixel = pixel_scale(first, second, float(length))
    spread = pixel * pixel * _CLICK_PX * math.sqrt(2.0) / float(length)
    return {
        _PIXEL: float(f"{pixel:.6g}"),
        _PIXEL_SPREAD: float(f"{spread:.2g}"),
    }


def _edges(session: SetupSession, asked: Asked) -> None:
    """A point on each edge of a beam, one above the other: its height gives the scale."""
    values = _sized(_set_of(session), asked, "beam.height_mm")
    session.change(lambda text: set_values(text, values))


def _rollers(session: SetupSession, asked: Asked) -> None:
    """The inner rollers: their distance gives the scale, and between them is what is read."""
    values = _sized(_set_of(session), asked, "beam.inner_span_mm")
    left, right = sorted(col for _, col in asked["points"])
    away = _FROM_ROLLERS * plain_values(session.text)["beam.height_mm"] / values[_PIXEL]
    rows, cols = session.reader(session.scene()).shape
    first, last = max(0, math.ceil(left + away)), min(cols - 1, math.floor(right - away))
    if last - first < _FEWEST_COLS:
        raise InputError(
            "between the two rollers, and half a height away from each, nothing is left to read; "
            "set the points on the two inner rollers"
        )
    values["frames.roi"] = {
        "top_px": 0, "left_px": first, "height_px": rows, "width_px": last - first + 1,
    }  # fmt: skip
    session.change(lambda text: set_values(text, values))


def _rim(session: SetupSession, asked: Asked) -> None:
    """Three points or more on a disc's rim: the region is the square about it, with some air."""
    _set_of(session)
    circle = fit_circle(np.array(asked["points"], dtype=float))
    half = _AROUND_RIM * circle.radius
    box = {
        "top_px": circle.row - half, "left_px": circle.col - half,
        "height_px": 2.0 * half, "width_px": 2.0 * half,
    }  # fmt: skip
    _region(session, {"region": box})


def values_of_place(pixels: PixelGrid, point: Sequence[float]) -> dict[str, float]:
    """Give the keys that put the contact, or a body's top, at a point of the region.

    Parameters: `pixels`, the region's; `point`, its row and column, px. Returns values (mm) by key.
    """
    left, top = placed_at(pixels, (point[0], point[1]))
    return {LEFT: round(left, _DIGITS), TOP: round(top, _DIGITS)}


def _contact(session: SetupSession, asked: Asked) -> None:
    """The point of the picture where x = z = 0."""
    scene = session.scene()
    region = session.region(scene)
    ((row, col),) = moved([asked["point"]], -region.top_px, -region.left_px)
    values = values_of_place(session.pixels(scene), (row, col))
    session.change(lambda text: set_values(text, values))


def _surface(session: SetupSession, asked: Asked) -> None:
    """Two points of the surface: the roll, and its height at the contact."""
    scene = session.scene()
    region = session.region(scene)
    first, second = moved(asked["points"], -region.top_px, -region.left_px)
    roll = round(surface_roll((first[0], first[1]), (second[0], second[1])), 3)
    before = session.pixels(scene)
    _, col = seen_at(before, 0.0, 0.0)
    turned: dict[str, Any] = {ROLL: roll or None}
    place = (on_line((first[0], first[1]), (second[0], second[1]), col), col)

    def edit(text: str) -> str:
        text = set_values(text, turned)
        return set_values(text, values_of_place(session.pixels(session.scene(text)), place))

    session.change(edit)


def _region(session: SetupSession, asked: Asked) -> None:
    """The region of interest; all that is counted in it stays where it is in the picture."""
    scene = session.scene()
    rows, cols = session.reader(scene).shape
    old = session.region(scene)
    box = asked.get("region")
    new = {"top_px": 0, "left_px": 0, "height_px": rows, "width_px": cols}
    if box is not None:
        top, left = max(0, round(box["top_px"])), max(0, round(box["left_px"]))
        new = {
            "top_px": top,
            "left_px": left,
            "height_px": min(rows - top, round(box["height_px"])),
            "width_px": min(cols - left, round(box["width_px"])),
        }
    down, right = old.top_px - new["top_px"], old.left_px - new["left_px"]
    values: dict[str, Any] = {"frames.roi": new if box is not None else None}
    camera = scene.camera
    if camera is not None and (camera.left_mm is not None or camera.top_mm is not None):
        pixels = session.pixels(scene)
        row, col = seen_at(pixels, 0.0, 0.0)
        cut = cut_out(pixels, new["height_px"], new["width_px"])
        values |= values_of_place(cut, (row + down, col + right))
    for key, size in (("height_px", "height_px"), ("width_px", "width_px")):
        if camera is not None and getattr(camera, key) is not None:
            values[f"camera.{key}"] = new[size]
    polygon = scene.frames.polygon_px
    if polygon is not None:
        values["frames.polygon_px"] = moved(polygon, down, right)
    shift = {"top_px": -down, "left_px": -right}
    orders = orders_on_picture(scene, 0, 0)
    paths = {
        "frames.known_line": lines_on_picture(scene, 0, 0),
        "frames.free_boundary": boundaries_on_picture(scene, 0, 0),
    }

    def edit(text: str) -> str:
        text = set_values(text, values)
        if orders:
            text = with_table_list(text, "frames.known_order", order_tables(orders, shift))
        for key, lines in paths.items():
            if lines:
                text = with_table_list(text, key, line_tables(lines, shift))
        return text

    session.change(edit)


def _polygon(session: SetupSession, asked: Asked) -> None:
    region = session.region(session.scene())
    points = moved(asked["points"], -region.top_px, -region.left_px)
    session.change(lambda text: set_values(text, {"frames.polygon_px": points or None}))


def _boundary(session: SetupSession, asked: Asked) -> None:
    """Lines along free edges, where the order is known from the fringes that meet them."""
    region = session.region(session.scene())
    shift = {"top_px": region.top_px, "left_px": region.left_px}
    tables = line_tables(asked["lines"], shift)
    session.change(lambda text: with_table_list(text, "frames.free_boundary", tables))


def _known_order(session: SetupSession, asked: Asked) -> None:
    region = session.region(session.scene())
    shift = {"top_px": region.top_px, "left_px": region.left_px}
    tables = order_tables(asked["points"], shift)
    session.change(lambda text: with_table_list(text, "frames.known_order", tables))


def _known_line(session: SetupSession, asked: Asked) -> None:
    region = session.region(session.scene())
    shift = {"top_px": region.top_px, "left_px": region.left_px}
    tables = line_tables(asked["lines"], shift)
    session.change(lambda text: with_table_list(text, "frames.known_line", tables))


def order_tables(points: Sequence[Asked], shift: Mapping[str, int]) -> list[dict[str, Any]]:
    """Known points as the scene writes them: whole pixels of the region.

    Parameters: `points` of the picture; `shift`, the region's place. Returns tables.
    """
    return [
        {
            "row_px": round(point["row"]) - shift["top_px"],
            "col_px": round(point["col"]) - shift["left_px"],
            "order": float(point["order"]),
        }
        | ({"extremum": point["extremum"]} if point.get("extremum") else {})
        for point in points
    ]


def line_tables(lines: Sequence[Asked], shift: Mapping[str, int]) -> list[dict[str, Any]]:
    """Known lines as the scene writes them. Parameters, returns: as for points."""
    found = []
    for line in lines:
        points = moved(line["points"], -shift["top_px"], -shift["left_px"])
        found.append(
            {
                "row_px": [row for row, _ in points],
                "col_px": [col for _, col in points],
            }
            | ({"order": float(line["order"])} if "order" in line else {})
        )
    return found


def _undo(session: SetupSession, _: Asked) -> None:
    session.undo()


def _save(session: SetupSession, _: Asked) -> None:
    session.save()


TOOLS: Mapping[str, Callable[[SetupSession, Asked], None]] = {
    "new": _new,
    "values": _values,
    "text": _text,
    "loads": _loads,
    "edges": _edges,
    "rollers": _rollers,
    "rim": _rim,
    "scale": _scale,
    "contact": _contact,
    "surface": _surface,
    "region": _region,
    "polygon": _polygon,
    "known_order": _known_order,
    "known_line": _known_line,
    "free_boundary": _boundary,
    "undo": _undo,
    "save": _save,
}
"""What each tool does, by its name."""


def apply_tool(session: SetupSession, asked: Asked) -> None:
    """Do what a tool of the page asks for; InputError where it cannot be, the scene as it was.

    `asked`: `tool`, one of TOOLS, and what it needs; points are (row, col) of the whole picture.
    """
    tool = TOOLS.get(str(asked.get("tool")))
    if tool is None:
        raise InputError(f"tool = {asked.get('tool')!r}: is none; one of {', '.join(TOOLS)}")
    with refused_as_asked(str(asked["tool"])):
        tool(session, asked)


@contextmanager
def refused_as_asked(tool: str) -> Iterator[None]:
    """Say of values that a tool cannot read that they are none of its own; refusals stay.

    Parameters: `tool`, its name. Raises InputError.
    """
    try:
        yield
    except IsochromeError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"the tool {tool!r} was asked for with values that are none of its own "
            f"({error}); see its fields"
        ) from error
