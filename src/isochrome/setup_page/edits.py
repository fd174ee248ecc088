"""How a scene or set stands on the page, what tools do to its text, what is found in a frame."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

import numpy as np

from isochrome.calibration import fit_circle
from isochrome.drafting import (
    FIELDS,
    KINDS,
    NEEDED,
    OPTIONS,
    SET_KINDS,
    STATED_SHAPES,
    KnownValues,
    SceneDraft,
    draft_scene,
    known_values,
    scene_text,
)
from isochrome.errors import InputError, IsochromeError
from isochrome.frames import likely_no_load
from isochrome.messages import message
from isochrome.output import rounded_texts
from isochrome.scene import (
    Roi,
    Scene,
    parse_scene,
    parse_toml,
    toml_text,
    with_table_list,
    with_value,
    without_value,
)
from isochrome.setup_page.session import SetSession, SetupSession, moved, plain_table, with_loads
from isochrome.stress import PixelGrid, pixel_grid

Point = tuple[float, float]
"""A place as (row, col), px."""

_NEAREST_PX = 2.0
"""Points nearer than this are one: half a pixel of each would be a quarter of the scale."""


def pixel_scale(first: Point, second: Point, length_mm: float) -> float:
    """Side of a pixel, mm, from two points (row, col) a known length apart; InputError for none."""
    apart = math.hypot(second[0] - first[0], second[1] - first[1])
    if not apart >= _NEAREST_PX:
        raise InputError("two_points_scale_px", apart=apart, nearest_px=_NEAREST_PX)
    if not 0.0 < length_mm < math.inf:
        raise InputError("length_mm_give_distance", length_mm=length_mm)
    return length_mm / apart


def seen_at(pixels: PixelGrid, x_mm: float, z_mm: float) -> Point:
    """The point (row, col) of the region that looks at a place."""
    from scipy.optimize import root

    unit = pixels.pixel_mm
    start = (z_mm - pixels.top_mm) / unit - 0.5, (x_mm - pixels.left_mm) / unit - 0.5
    if pixels.lens is None:
        return start

    def away(at: Any) -> Any:
        """How far the point looks beside the place, px."""
        return np.subtract(pixels.place(at[0], at[1]), (x_mm, z_mm)) / unit

    row, col = root(away, start, tol=1e-12).x.tolist()
    return row, col


def surface_roll(first: Point, second: Point) -> float:
    """The camera's roll, degrees counter-clockwise, by two points; InputError beyond 45."""
    first_end, second_end = sorted((first, second), key=lambda point: point[1])
    across, down = second_end[1] - first_end[1], second_end[0] - first_end[0]
    if across < _NEAREST_PX or abs(down) > across:
        raise InputError("two_points_surface_lie")
    # a picture that is turned counter-clockwise has the right end of the surface higher
    return math.degrees(math.atan2(-down, across)) + 0.0


def session_state(session: SetupSession) -> dict[str, Any]:
    """How a scene stands, as plain values; places are (row, col) of the whole picture."""
    scene = session.scene_or_none()
    reader, region = session.reader(scene), session.region(scene)
    of_scene: dict[str, Any] = {
        "model": None, "values": {}, "polygon": [], "known_order": [], "known_line": [],
        "free_boundary": [], "pixel_mm": None, "place": None, "surface": None,
    }  # fmt: skip
    if scene is not None:
        corner = region.top_px, region.left_px
        of_scene |= {"model": scene.model, "values": plain_values(session.text)}
        of_scene |= {"polygon": moved(scene.frames.polygon_px or (), *corner)}
        of_scene |= known_on_picture(scene, *corner)
        with suppress(InputError):  # the scale is not known yet
            pixels = session.pixels(scene)
            of_scene["pixel_mm"] = pixels.pixel_mm
            if scene.has_model:
                half = 0.5 * pixels.cols * pixels.pixel_mm
                points = [seen_at(pixels, x, 0.0) for x in (0.0, -half, half)]
                of_scene["place"], *of_scene["surface"] = moved(points, *corner)
    images = []
    if isinstance(session, SetSession):
        pairs = zip(session.image_names, session.loads(), strict=True)
        images = [{"file": name, "load_n": load} for name, load in pairs]
    return {
        "revision": session.revision, "text": session.text, "saved": session.is_saved,
        "scene_file": session.scene_file.name, "has_scene": scene is not None,
        "frames": {
            "count": session.count(scene), "rows": reader.shape[0], "cols": reader.shape[1],
            "bit_depth": reader.bit_depth, "pixel_mm": reader.pixel_mm,
        },
        "region": region.model_dump(), "beside": session.beside(), "subject": session.subject,
        "images": images, **of_scene,
    }  # fmt: skip


def known_on_picture(scene: Scene, top_px: int, left_px: int) -> dict[str, list[dict[str, Any]]]:
    """Known points, known lines and free edges by their keys, (row, col) of the whole picture."""
    frames, corner = scene.frames, (top_px, left_px)
    points = [
        {"row": k.row_px + top_px, "col": k.col_px + left_px, "order": k.order,
         "extremum": k.extremum}
        for k in frames.known_order
    ]  # fmt: skip
    lines = [{"points": moved(k.places, *corner), "order": k.order} for k in frames.known_line]
    edges = [{"points": moved(k.places, *corner)} for k in frames.free_boundary]
    return {"known_order": points, "known_line": lines, "free_boundary": edges}


def plain_values(text: str) -> dict[str, Any]:
    """The values of a scene's text by dotted key, without what is not known of them."""
    known = {field.key for field in FIELDS}
    known |= {"frames.no_load_dark", "frames.no_load_bright", "specimen.shape"}
    values = {
        f"{table}.{name}": value
        for table, entries in parse_toml(text, "scene").items()
        for name, value in (plain_table(entries).items() if isinstance(entries, dict) else ())
    }
    return {key: value for key, value in values.items() if key in known}


_OF_A_MODEL = ("indenter", "contact", "friction", "wear", "scar", "load", "frames.known_loads_n")
"""Tables and keys that make a scene one of a model."""


def new_scene_text(kind: str, values: Mapping[str, Any], no_load: Mapping[str, str]) -> str:
    """A scene or set as commented TOML from the page's form, values and no-load files by keys.
    InputError names all that such a scene needs."""
    kinds = KINDS | SET_KINDS
    if kind not in kinds:
        raise InputError("what_stands_front_camera", kind=kind, kinds=", ".join(kinds))
    fields = [field for field in FIELDS if kind in field.kinds]
    # what is false or nought is as good as nothing said: the scene's own default
    given = {field.key: value for field in fields if (value := values.get(field.key))}
    missing = [field.label for field in fields if field.needed and field.key not in given]
    if missing:
        names, what = ", ".join(missing), ("scene", "set")[kind in SET_KINDS]
        raise InputError("fill_needs_them", missing=names, what=what, kinds=kinds[kind])
    if "wear.distances_m" not in given:
        given.pop("wear.coefficient_mm2_per_n", None)
    elif "friction.coefficient" not in given:
        raise InputError("fill_friction_coefficient_about")
    words = {field.key: field.title for field in fields} | {"specimen.shape": kinds[kind]}
    words |= dict.fromkeys(no_load, "the unloaded specimen")
    shape = {"specimen.shape": kind} if kind in STATED_SHAPES else {}
    lines = [(key, toml_text(v), words[key]) for key, v in (shape | given | dict(no_load)).items()]
    return scene_text([f"{kinds[kind]}; made on the page of `isochrome setup`"], lines)


def without_model(scene: Scene, text: str) -> Scene:
    """A scene without its model, read from the image alone; InputError: text not editable."""
    if not scene.has_model:
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

Request = Mapping[str, Any]
"""What a tool sends: plain JSON."""


def set_values(text: str, values: Mapping[str, Any]) -> str:
    """A scene's text with values by its keys; None takes one out, and a ± goes with its scale."""
    if _PIXEL in values and _PIXEL_SPREAD not in values:
        text = without_value(text, _PIXEL_SPREAD)
    for key, value in values.items():
        if key.count(".") != 1:
            raise InputError("no_key_scene_write", key=key)
        if value is None or value == "":
            text = without_value(text, key)
        else:
            text = with_value(text, key, toml_text(value))
    return text


def _set_values(session: SetupSession, values: Mapping[str, Any]) -> None:
    session.change(lambda text: set_values(text, values))


def _make_new(session: SetupSession, request: Request) -> None:
    text = new_scene_text(request["kind"], request["values"], likely_no_load(session.beside()))
    if isinstance(session, SetSession):
        if request["kind"] != session.subject:
            raise InputError("kind_set", kind=request["kind"], subject=session.subject)
        text = _with_loads(session, request, text)
    session.change(lambda _: text)


def _set_scale(session: SetupSession, request: Request) -> None:
    """Two points and a length; the place of the contact in the picture stays."""
    first, second = request["points"]
    pixel = float(f"{pixel_scale(first, second, float(request['length_mm'])):.6g}")
    values: dict[str, Any] = {_PIXEL: pixel}
    camera = session.scene().camera
    if camera is not None and camera.pixel_mm is not None:
        edges, larger = {LEFT: camera.left_mm, TOP: camera.top_mm}, pixel / camera.pixel_mm
        values |= {k: round(mm * larger, _DIGITS) for k, mm in edges.items() if mm is not None}
    _set_values(session, values)


def set_of(session: SetupSession) -> SetSession:
    """The session of a calibration set. Raises InputError for a scene's."""
    if not isinstance(session, SetSession):
        raise InputError("tool_calibration_sets_start")
    return session


def _with_loads(session: SetSession, request: Request, text: str) -> str:
    """A set's text with a load for each image; None for one that is not of the set."""
    given = [None if load is None else float(load) for load in request["loads"]]
    count, images = len(given), len(session.image_names)
    if count != images:
        raise InputError("loads_there_images", given_count=count, image_names_count=images)
    return with_loads(text, session.image_names, given)


def _set_loads(session: SetupSession, request: Request) -> None:
    session.change(partial(_with_loads, set_of(session), request))


def _sized(session: SetupSession, request: Request, key: str) -> dict[str, Any]:
    """The scale, and its uncertainty, by two points that are a length of the beam's apart."""
    length = plain_values(session.text).get(key)
    if length is None:
        raise InputError("not_known_yet_fill", key=key)
    first, second = request["points"]
    pixel = pixel_scale(first, second, float(length))
    spread = pixel * pixel * _CLICK_PX * math.sqrt(2.0) / float(length)
    return {_PIXEL: float(f"{pixel:.6g}"), _PIXEL_SPREAD: float(f"{spread:.2g}")}


def _set_rollers(session: SetupSession, request: Request) -> None:
    """The inner rollers: their distance gives the scale, and between them is what is read."""
    values = _sized(set_of(session), request, "beam.inner_span_mm")
    left_px, right_px = sorted(col for _, col in request["points"])
    away = _FROM_ROLLERS * plain_values(session.text)["beam.height_mm"] / values[_PIXEL]
    rows, cols = session.reader(session.scene()).shape
    first, last = max(0, math.ceil(left_px + away)), min(cols - 1, math.floor(right_px - away))
    if last - first < _FEWEST_COLS:
        raise InputError("between_two_rollers_half")
    roi = {"top_px": 0, "left_px": first, "height_px": rows, "width_px": last - first + 1}
    _set_values(session, values | {"frames.roi": roi})


def _set_rim(session: SetupSession, request: Request) -> None:
    """Three points or more on a disc's rim: the region is the square about it, with some air."""
    set_of(session)
    circle = fit_circle(np.array(request["points"], dtype=float))
    half = _AROUND_RIM * circle.radius
    place = {"top_px": circle.row - half, "left_px": circle.col - half}
    _set_region(session, {"region": place | {"height_px": 2.0 * half, "width_px": 2.0 * half}})


def placed_at(pixels: PixelGrid, point: Point) -> tuple[float, float]:
    """The outer edges left_mm and top_mm for which a point (row, col) looks at x = z = 0."""
    x, z = pixels.place(*point)
    return pixels.left_mm - x, pixels.top_mm - z


def values_of_place(pixels: PixelGrid, point: Point) -> dict[str, float]:
    """The keys (mm) that put the contact, or a body's top, at a (row, col) of the region."""
    left_mm, top_mm = placed_at(pixels, point)
    return {LEFT: round(left_mm, _DIGITS), TOP: round(top_mm, _DIGITS)}


def _set_contact(session: SetupSession, request: Request) -> None:
    scene = session.scene()
    ((row, col),) = _in_region(session.region(scene), [request["point"]])
    _set_values(session, values_of_place(session.pixels(scene), (row, col)))


def _set_surface(session: SetupSession, request: Request) -> None:
    """Two points of the surface: the roll, and its height at the contact."""
    scene = session.scene()
    region = session.region(scene)
    first, second = ((row, col) for row, col in _in_region(region, request["points"]))
    roll = round(surface_roll(first, second), 3)
    _, col = seen_at(session.pixels(scene), 0.0, 0.0)
    share = (col - first[1]) / (second[1] - first[1])
    place = first[0] + share * (second[0] - first[0]), col

    def edit(text: str) -> str:
        text = set_values(text, {ROLL: roll or None})
        return set_values(text, values_of_place(session.pixels(session.scene(text)), place))

    session.change(edit)


def _set_region(session: SetupSession, request: Request) -> None:
    """The region of interest; all that is counted in it stays where it is in the picture."""
    scene, box = session.scene(), request.get("region")
    old, (rows, cols) = session.region(scene), session.reader(scene).shape
    new = {"top_px": 0, "left_px": 0, "height_px": rows, "width_px": cols}
    if box is not None:
        for edge, side in (("top_px", "height_px"), ("left_px", "width_px")):
            new[edge] = max(0, round(box[edge]))
            new[side] = min(new[side] - new[edge], round(box[side]))
    down, right = old.top_px - new["top_px"], old.left_px - new["left_px"]
    values: dict[str, Any] = {"frames.roi": new if box is not None else None}
    camera, place = scene.camera, None
    if camera is not None and (camera.left_mm is not None or camera.top_mm is not None):
        row, col = seen_at(session.pixels(scene), 0.0, 0.0)
        place = row + down, col + right
    sides = [k for k in ("height_px", "width_px") if getattr(camera, k, None) is not None]
    values |= {f"camera.{key}": new[key] for key in sides}
    if scene.frames.polygon_px is not None:
        values["frames.polygon_px"] = moved(scene.frames.polygon_px, down, right)
    known = known_on_picture(scene, 0, 0)

    def edit(text: str) -> str:
        text = set_values(text, values)
        for key, items in known.items():
            if items:
                text = with_table_list(text, f"frames.{key}", known_tables(key, items, down, right))
        if place is not None:  # a lens looks from the new middle
            text = set_values(text, values_of_place(session.pixels(session.scene(text)), place))
        return text

    session.change(edit)


def _in_region(region: Roi, points: Sequence[Sequence[float]]) -> list[list[float]]:
    return moved(points, -region.top_px, -region.left_px)


def _set_polygon(session: SetupSession, request: Request) -> None:
    points = _in_region(session.region(session.scene()), request["points"])
    _set_values(session, {"frames.polygon_px": points or None})


def _set_known(session: SetupSession, request: Request, key: str) -> None:
    """Known points, known lines, or free edges, whose order the fringes that meet them tell."""
    region = session.region(session.scene())
    items = request["points" if key == "known_order" else "lines"]
    tables = known_tables(key, items, -region.top_px, -region.left_px)
    session.change(lambda text: with_table_list(text, f"frames.{key}", tables))


def known_tables(
    key: str, items: Sequence[Request], down: float, right: float
) -> list[dict[str, Any]]:
    """Known points, lines or free edges of the picture, moved by px, as the scene has them."""
    if key == "known_order":  # on whole pixels
        return [
            {"row_px": round(one["row"]) + down, "col_px": round(one["col"]) + right}
            | {"order": float(one["order"])}
            | ({"extremum": one["extremum"]} if one.get("extremum") else {})
            for one in items
        ]
    places = [moved(one["points"], down, right) for one in items]
    return [
        {"row_px": [row for row, _ in at], "col_px": [col for _, col in at]}
        | ({"order": float(one["order"])} if "order" in one else {})
        for one, at in zip(items, places, strict=True)
    ]


TOOLS: Mapping[str, Callable[[SetupSession, Request], None]] = {
    "new": _make_new,
    "values": lambda session, request: _set_values(session, request["values"]),
    "text": lambda session, request: session.change(lambda _: str(request["text"])),
    "loads": _set_loads,
    # a point on each edge of a beam, one above the other: its height gives the scale
    "edges": lambda session, request: _set_values(
        session, _sized(set_of(session), request, "beam.height_mm")
    ),
    "rollers": _set_rollers,
    "rim": _set_rim,
    "scale": _set_scale,
    "contact": _set_contact,
    "surface": _set_surface,
    "region": _set_region,
    "polygon": _set_polygon,
    **{key: partial(_set_known, key=key) for key in ("known_order", "known_line", "free_boundary")},
    "undo": lambda session, _: session.undo(),
    "save": lambda session, _: session.save(),
}
"""What each tool does, by its name."""


def apply_tool(session: SetupSession, request: Request) -> dict[str, Any]:
    """Do what a tool of TOOLS is asked for; gives the `session_state` that it leaves. Points are
    (row, col) of the whole picture. InputError: the scene is as it was."""
    tool = TOOLS.get(str(request.get("tool")))
    if tool is None:
        raise InputError("tool_none_one", request=request.get("tool"), tools=", ".join(TOOLS))
    with refused_as_asked(str(request["tool"])):
        tool(session, request)
    return session_state(session)


@contextmanager
def refused_as_asked(tool: str) -> Iterator[None]:
    """Say of values that a tool cannot read that they are none of its own; refusals stay."""
    try:
        yield
    except IsochromeError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError("tool_asked_values_none", tool=tool, error=error) from error


SEARCHED = tuple(shape for shape, names in NEEDED.items() if names)
"""Models that are searched for: of the others nothing must be known, and nothing is found."""

_FRICTION, _TURN = "friction.coefficient", "frames.rotate_deg"

_START_FRICTION = 0.1
"""Stands in a new scene while the search goes on, where the user has named none."""

_ON_REQUEST = ("field", "gamma", "rotate_deg")
"""What the search finds, or takes as the scene has it where the user says so."""

_OPTION = re.compile(r"--([a-z]+(?:-[a-z]+)*)")


def find_in_frames(
    session: SetupSession,
    index: int,
    *,
    form: tuple[str, Mapping[str, Any]] | None = None,
    held: bool = False,
) -> dict[str, Any]:
    """Search a frame as `init` does, and put what is found into the scene's text. A key with a
    stated uncertainty stays. Frame 1 stands for 0 where that stands still; `form`: what a new scene
    is made from; `held`: field, gamma, turns are known. InputError or PhysicsError: the scene is as
    it was."""
    started = session.text
    text, guessed = _start_text(session, form)
    scene = session.scene(text)
    session.frame(index, scene)  # whether it is there
    still = scene.friction is not None and scene.friction.static_state_first
    still &= index == 0 and session.count(scene) > 1
    known = _known(scene, 1 if still else index, held=held)
    try:
        draft = draft_scene(session.frames, known, session.left_out(scene))
    except IsochromeError as error:
        raise type(error)(page_words(str(error))) from error
    values, notes = _values(draft, scene, guessed=guessed)
    stated, turn = scene.frames, draft.scene.frames.rotate_deg
    if (stated.roi or stated.polygon_px or stated.orders_known) and stated.rotate_deg != turn:
        raise InputError("frame_explains_itself_turned", name=scene.name, turn=turn)
    row, col = seen_at(pixel_grid(draft.scene), 0.0, 0.0)

    def edit(now: str) -> str:
        if now != started:
            raise InputError("scene_has_changed_during")
        edited = set_values(text, values)
        scene = session.scene(edited)
        region = session.region(scene)
        place = (row - region.top_px, col - region.left_px)
        return set_values(edited, values_of_place(session.pixels(scene), place))

    session.change(edit)
    shown = [v for v in draft.found if v.key in values or v.key in (LEFT, TOP)]
    found = [{"key": v.key, "text": v.words, "note": page_words(v.note)} for v in shown]
    warnings = [*notes, *map(page_words, draft.warnings)]
    return {"frame": draft.frame, "chi": draft.chi, "found": found, "warnings": warnings}


def page_words(text: str) -> str:
    """A sentence of the command line in the page's words: fields in place of options."""

    def named(option: re.Match[str]) -> str:
        name = option[1].replace("-", "_")
        return f"'{OPTIONS[name].label}'" if name in OPTIONS else name

    return _OPTION.sub(named, text).replace("run init again", "search again")


def _start_text(
    session: SetupSession, form: tuple[str, Mapping[str, Any]] | None
) -> tuple[str, bool]:
    """The scene's text, or the form's; and whether nobody has named its friction."""
    if session.text.strip() or form is None:
        return session.text, False
    kind, values = form
    guessed = bool(values.get("wear.distances_m")) and not values.get(_FRICTION)
    if guessed:  # what wears has slid: the search says how
        values = {**values, _FRICTION: _START_FRICTION}
    with refused_as_asked("find"):
        return new_scene_text(kind, values, likely_no_load(session.beside())), guessed


def _known(scene: Scene, index: int, *, held: bool) -> KnownValues:
    """What the scene says of all that no frame tells."""
    if scene.model not in SEARCHED:
        what = f"a {scene.model}" if scene.model else scene.no_model_reason
        raise InputError("search_knows_contact_under", name=scene.name, what=what)
    given = {}
    for name, one in OPTIONS.items():
        part, _, entry = one.key.partition(".")
        value = getattr(getattr(scene, part), entry, None)
        if value is not None and not isinstance(value, str | int | float):
            raise InputError("changes_distance_search_takes", name=scene.name, key=one.key)
        if (held or name not in _ON_REQUEST) and (name, value) != ("gamma", "unknown"):
            given[name] = value
    return known_values({"shape": scene.model, "frame": index, **given})


def _values(draft: SceneDraft, scene: Scene, *, guessed: bool) -> tuple[dict[str, Any], list[str]]:
    """What goes into the scene, without the place; and what does not, in sentences."""
    values: dict[str, Any] = {v.key: v.value for v in draft.found if v.key not in (LEFT, TOP)}
    for v in draft.found:
        if v.key in values and v.standard_uncertainty and not isinstance(v.value, str):
            values[v.key] = float(rounded_texts(float(v.value), v.standard_uncertainty)[0])
    notes = []
    if values.get(_FRICTION) == 0.0:
        if guessed:
            raise InputError("frame_no_friction_seen", frame=draft.frame)
        del values[_FRICTION]
        if scene.friction is not None:
            notes.append(message("no_friction_seen_frame", frame=draft.frame, friction=_FRICTION))
    for key in set(values) & set(scene.uncertainties):
        notes.append(message("stated_own_stays_found", key=key, pop=values.pop(key)))
    values.setdefault(ROLL, None)  # the picture was explained without one
    values[_TURN] = draft.scene.frames.rotate_deg or None
    for name in ("width_px", "height_px") if scene.frames.roi is None else ():
        if getattr(scene.camera, name, None) is not None:
            values[f"camera.{name}"] = draft.scene.get(f"camera.{name}")
    return values, notes
