"""What the page asks of a frame: its fit, what `check` says, and the order map of known points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, PhysicsError
from isochrome.output import with_uncertainty
from isochrome.processing import FrameResult, FrameValue, check, process_frame
from isochrome.scene import Scene, parse_scene, toml_text, with_value, without_value
from isochrome.setup_page.session import SetupSession

_OF_A_MODEL = ("indenter", "friction", "wear", "scar", "load")
"""Tables that make a scene one of a model."""

_WRONG_CHI = 3.0
"""chi of a fit from which its values are not taken into the scene together: the model is wrong."""

_ORDER_STEP = 0.02
"""Fringes from level to level of a map as the page shows it."""

_UNKNOWN = 0
"""Level of a pixel whose order is not known."""


def fit_answer(session: SetupSession, index: int) -> dict[str, Any]:
    """Fit the scene to one frame, as `process` does, and say what was found.

    Parameters
    ----------
    session : SetupSession
        The scene and its frames.
    index : int
        The frame, from 0.

    Returns
    -------
    dict
        `values`: key, value, its ± as text, the TOML line that states it, and whether the frame
        asked for it; `chi`, whether it is `wrong`, `kept_share`, and `warnings`.

    Raises
    ------
    InputError
        Where the scene or the frame is wrong.
    PhysicsError
        Where the frame does not show the scene's model.
    """
    scene = session.scene()
    if scene.model is None:
        raise InputError(
            f"{scene.name}: {scene.no_model_reason}, so there is nothing to fit; look at the map "
            "of the known points instead"
        )
    found = process_frame(session.frames, scene, index)
    return {
        "frame": index,
        "revision": session.revision,
        "chi": found.frame.chi,
        # not where it is not known; a load that is read against others has the misfit in its ±
        "wrong": found.frame.fit is not None and found.frame.chi > _WRONG_CHI,
        "kept_share": found.row.get("kept_share"),
        "values": [*_scale_row(scene, found), *map(_value_row, found.values)],
        "warnings": list(found.frame.warnings),
    }


def _value_row(one: FrameValue) -> dict[str, Any]:
    value = _rounded(one.value, one.standard_uncertainty)
    return {
        "key": one.key,
        "value": value,
        "text": with_uncertainty(one.value, one.standard_uncertainty),
        "line": f"{one.key.partition('.')[2]} = {toml_text(value)}",
        "asked": one.asked,
    }


def _scale_row(scene: Scene, found: FrameResult) -> list[dict[str, Any]]:
    """The scale that a round specimen's rim gives, where the scene states none."""
    pixel = found.frame.pixel_mm
    stated = scene.camera is not None and scene.camera.pixel_mm is not None
    if stated or pixel is None or scene.rim_diameter_mm is None or not found.values:
        return []
    value = float(f"{pixel:.6g}")
    row = {"key": "camera.pixel_mm", "value": value, "text": f"{value:.6g} (by the rim)"}
    return [row | {"line": f"pixel_mm = {toml_text(value)}", "asked": False}]


def _rounded(value: float, spread: float) -> float:
    """A value two digits beyond its uncertainty's first."""
    if not (np.isfinite(spread) and spread > 0.0):
        return value
    return float(np.round(value, max(0, 2 - int(np.floor(np.log10(spread))))))


def check_answer(session: SetupSession) -> dict[str, Any]:
    """Say what `isochrome check` says of the frames and the scene as it is on the page.

    Parameters
    ----------
    session : SetupSession
        The scene and its frames.

    Returns
    -------
    dict
        `ok`, `count` and `findings`, and the `revision` of the scene that was checked.

    Raises
    ------
    InputError
        Where there is no scene yet.
    """
    scene, revision = session.scene(), session.revision
    try:
        session.check_complete()
    except InputError as error:  # a set of which something is still open
        finding = {"level": "error", "frame": None, "text": str(error)}
        return {"ok": False, "frames": 0, "findings": [finding], "revision": revision}
    found = check(session.frames, scene).to_json() | {"revision": revision}
    if session.subject is not None:  # a set has its own model
        told = found["findings"]
        found["findings"] = [f for f in told if not f["text"].startswith(scene.no_model_reason)]
    return found


def order_map_of_points(session: SetupSession, index: int) -> tuple[NDArray[np.uint8], list[str]]:
    """Read the order of one frame from its known points alone, as it would be without a model.

    Parameters
    ----------
    session : SetupSession
        The scene and its frames.
    index : int
        The frame, from 0.

    Returns
    -------
    tuple of ndarray of uint8 (rows, cols) and list of str
        Order over 0.02 fringe plus 1, at most 255, 0 where none is known, of the region; and what
        `process` says. The parts that hang together with a known point are those that are known.

    Raises
    ------
    InputError
        Where the scene or the frame is wrong, or no order is known anywhere.
    """
    scene = without_model(session.scene(), session.text)
    if not scene.frames.orders_known:
        raise InputError(
            "no order is known anywhere: set a point whose order you know, such as 0 in a free "
            "corner, or a fringe line"
        )
    found: FrameResult = process_frame(session.frames, scene, index)
    reading = found.frame.reading
    if reading is None:
        said = found.frame.warnings[0] if found.frame.warnings else "no order was read"
        raise PhysicsError(f"frame {index}: {said}")
    known = np.isfinite(reading.order)
    level = np.rint(np.where(known, reading.order, 0.0) / _ORDER_STEP) + 1.0
    shown = np.where(known, np.clip(level, 1, 255), _UNKNOWN).astype(np.uint8)
    return shown, list(found.frame.warnings)


def without_model(scene: Scene, text: str) -> Scene:
    """Give a scene without its model: what remains is read from the image alone.

    Parameters
    ----------
    scene : Scene
        The scene, for its name and folder.
    text : str
        Its text.

    Returns
    -------
    Scene
        A scene without a model.

    Raises
    ------
    InputError
        Where the text's layout cannot be edited.
    """
    if scene.model is None:
        return scene
    for table in _OF_A_MODEL:
        text = without_value(text, table)
    if scene.specimen.shape is not None:
        text = with_value(text, "specimen.shape", '"other"')
    return parse_scene(text, name=scene.name, folder=scene.folder)
