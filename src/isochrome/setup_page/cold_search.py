"""What the page finds in a frame by itself: place, load, friction, field, gamma, quarter turns."""

import re
from collections.abc import Mapping
from typing import Any

from isochrome.drafting import (
    NEEDED,
    QUANTITIES,
    KnownValues,
    SceneDraft,
    draft_scene,
    known_values,
)
from isochrome.errors import InputError, IsochromeError
from isochrome.frames import likely_no_load, open_frames
from isochrome.messages import message
from isochrome.output import rounded_texts
from isochrome.scene import Scene
from isochrome.setup_page.edits import (
    FIELDS,
    LEFT,
    ROLL,
    TOP,
    new_scene_text,
    refused_as_asked,
    set_values,
    values_of_place,
)
from isochrome.setup_page.places import seen_at
from isochrome.setup_page.session import SetupSession
from isochrome.stress import pixel_grid

SEARCHED = tuple(shape for shape, names in NEEDED.items() if names)
"""Models that are searched for: of the others nothing must be known, and nothing is found."""

_FRICTION, _TURN = "friction.coefficient", "frames.rotate_deg"

_START_FRICTION = 0.1
"""Stands in a new scene while the search goes on, where the user has named none."""

_HELD = ("frames.channel", "frames.flip", "camera.bit_depth")
"""Keys of the scene that the search always takes as they are, besides the bodies and the load."""

_ON_REQUEST = ("polariscope.field", "frames.gamma", _TURN)
"""Keys that it finds, or takes as they are where the user says so."""

_OPTION = re.compile(r"--([a-z]+(?:-[a-z]+)*)")


def find_in_frames(
    session: SetupSession,
    index: int,
    *,
    form: tuple[str, Mapping[str, Any]] | None = None,
    held: bool = False,
) -> dict[str, Any]:
    """Search a frame for the scene, as `init` does, and put what is found into the scene's text.

    A key with a stated uncertainty stays, as friction does where none is shown. Frame 1 stands for
    0 where that stands still; `form`: what a new scene is made from; `held`: field, gamma, turns
    are known. Gives `frame`, `chi`, `found` (key, value with ±, note), `warnings`. Else InputError,
    the scene as it was, or PhysicsError: no contact's or disc's fringes.
    """
    started = session.text
    text, guessed = _start_text(session, form)
    scene = session.scene(text)
    count = session.count(scene)
    if not 0 <= index < count:
        raise InputError(message("frame_there_counted_from_2", index=index, count=count))
    still = scene.friction is not None and scene.friction.static_state_first
    known = _known(scene, 1 if still and index == 0 and count > 1 else index, held=held)
    draft = _drafted(session, scene, known)
    values, notes = _values(draft, scene, guessed=guessed)
    _refuse_turn(scene, draft)

    def edit(now: str) -> str:
        if now != started:
            raise InputError(message("scene_has_changed_during"))
        return _placed_text(session, set_values(text, values), draft)

    session.change(edit)
    shown = [v for v in draft.found if v.key in values or v.key in (LEFT, TOP)]
    return {
        "frame": draft.frame,
        "chi": draft.chi,
        "found": [{"key": v.key, "text": v.words, "note": page_words(v.note)} for v in shown],
        "warnings": [*notes, *map(page_words, draft.warnings)],
    }


def page_words(text: str) -> str:
    """A sentence of the command line in the page's words: fields in place of options."""
    labels = {field.key: field.label for field in FIELDS}
    keys = {name: quantity.key for name, quantity in QUANTITIES.items()}
    for key in (*_HELD, *_ON_REQUEST):
        keys[key.partition(".")[2]] = key

    def named(option: re.Match[str]) -> str:
        name = option[1].replace("-", "_")
        return f"'{labels[keys[name]]}'" if name in keys else name

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
        raise InputError(message("search_knows_contact_under", name=scene.name, what=what))
    names = {quantity.key: name for name, quantity in QUANTITIES.items()}
    names |= {key: key.partition(".")[2] for key in (*_HELD, *(_ON_REQUEST if held else ()))}
    given = {
        name: getattr(getattr(scene, key.partition(".")[0]), key.partition(".")[2], None)
        for key, name in names.items()
    }
    if given.get("gamma") == "unknown":
        given["gamma"] = None
    for key, name in names.items():
        if given[name] is not None and not isinstance(given[name], str | int | float):
            raise InputError(message("changes_distance_search_takes", name=scene.name, key=key))
    return known_values({"shape": scene.model, "frame": index, **given})


def _drafted(session: SetupSession, scene: Scene, known: KnownValues) -> SceneDraft:
    """The draft from the frames as they were captured, its refusals in the page's words."""
    try:
        with open_frames(
            session.frames,
            channel=known.channel,
            wavelength_nm=known.wavelength_nm,
            bit_depth=known.bit_depth,
            leave_out=session.left_out(scene),
        ) as reader:
            return draft_scene(reader, known)
    except IsochromeError as error:
        raise type(error)(page_words(str(error))) from error


def _values(draft: SceneDraft, scene: Scene, *, guessed: bool) -> tuple[dict[str, Any], list[str]]:
    """What goes into the scene, without the place; and what does not, in sentences."""
    values: dict[str, Any] = {}
    for v in draft.found:
        if v.key not in (LEFT, TOP):
            values[v.key] = v.value
            if v.standard_uncertainty and not isinstance(v.value, str):
                values[v.key] = float(rounded_texts(float(v.value), v.standard_uncertainty)[0])
    notes = []
    if values.get(_FRICTION) == 0.0:
        if guessed:
            raise InputError(message("frame_no_friction_seen", frame=draft.frame))
        del values[_FRICTION]
        if scene.friction is not None:
            notes.append(message("no_friction_seen_frame", frame=draft.frame, friction=_FRICTION))
    for key in set(values) & set(scene.uncertainties):
        notes.append(message("stated_own_stays_found", key=key, pop=values.pop(key)))
    values.setdefault(ROLL, None)  # the picture was explained without one
    values[_TURN] = draft.scene.frames.rotate_deg or None
    camera = scene.camera
    if scene.frames.roi is None and camera is not None and draft.scene.camera is not None:
        for name in ("width_px", "height_px"):
            if getattr(camera, name) is not None:
                values[f"camera.{name}"] = getattr(draft.scene.camera, name)
    return values, notes


def _refuse_turn(scene: Scene, draft: SceneDraft) -> None:
    """Refuse to turn a picture under what was set on it."""
    stated, turn = scene.frames, draft.scene.frames.rotate_deg
    on_it = stated.roi or stated.polygon_px or stated.orders_known
    if on_it and (stated.rotate_deg or 0) != (turn or 0):
        raise InputError(message("frame_explains_itself_turned", name=scene.name, turn=turn or 0))


def _placed_text(session: SetupSession, text: str, draft: SceneDraft) -> str:
    """The text with the place that was found, counted in the scene's own region."""
    camera = draft.scene.camera
    assert camera is not None and camera.height_px is not None and camera.width_px is not None
    row, col = seen_at(pixel_grid(draft.scene, (camera.height_px, camera.width_px)), 0.0, 0.0)
    scene = session.scene(text)
    region = session.region(scene)
    place = (row - region.top_px, col - region.left_px)
    return set_values(text, values_of_place(session.pixels(scene), place))
