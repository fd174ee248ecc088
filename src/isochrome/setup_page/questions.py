"""What the page asks of a frame: its fit, `check`, and what known points say or would say."""

from __future__ import annotations

import base64
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.output import with_uncertainty
from isochrome.processing import (
    AnchorPreview,
    FrameResult,
    FrameValue,
    PatchOrders,
    anchor_preview,
    check,
    part_change,
    process_frame,
)
from isochrome.scene import Roi, Scene, toml_text, with_table_list
from isochrome.setup_page.edits import line_tables, order_tables, refused_as_asked
from isochrome.setup_page.new_scene import without_model
from isochrome.setup_page.places import round_by_spread
from isochrome.setup_page.session import SetupSession

_WRONG_CHI = 3.0
"""chi of a fit from which its values are not taken into the scene together: the model is wrong."""

_ORDER_STEP = 0.02
"""Fringes from level to level of a map as the page shows it."""

_UNKNOWN = 0
"""Level of a pixel whose order is not known."""

_WORTH_SAYING = 0.01
"""Share of the frame that is lost elsewhere from which it is said."""

_FARTHEST = 1e9
"""Pixels, or orders, that nobody means."""


def fit_answer(session: SetupSession, index: int) -> dict[str, Any]:
    """Fit the scene to one frame, from 0, as `process` does, and say what was found.

    `values`: key, value, its ± as text, the TOML line that states it, and whether the frame asked
    for it, or refines it; `summary_text`, all of it as a sentence; `chi`, whether it is `wrong`,
    `kept_share`, and `warnings`. PhysicsError where the frame does not show the model.
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
        "summary_text": found.summary_text,
        "kept_share": found.row.get("kept_share"),
        "values": [*_scale_row(scene, found), *map(_value_row, found.values)],
        "warnings": list(found.frame.warnings),
    }


def _value_row(one: FrameValue) -> dict[str, Any]:
    value = round_by_spread(one.value, one.standard_uncertainty)
    return {
        "key": one.key,
        "value": value,
        "text": with_uncertainty(one.value, one.standard_uncertainty),
        "line": f"{one.key.partition('.')[2]} = {toml_text(value)}",
        "asked": one.asked,
        "refined": one.refined,
    }


def _scale_row(scene: Scene, found: FrameResult) -> list[dict[str, Any]]:
    """The scale that a round specimen's rim gives, where the scene states none."""
    pixel = found.frame.pixel_mm
    stated = scene.camera is not None and scene.camera.pixel_mm is not None
    if stated or pixel is None or scene.rim_diameter_mm is None or not found.values:
        return []
    value = float(f"{pixel:.6g}")
    row = {"key": "camera.pixel_mm", "value": value, "text": f"{value:.6g} (by the rim)"}
    return [row | {"line": f"pixel_mm = {toml_text(value)}", "asked": False, "refined": False}]


def check_answer(session: SetupSession) -> dict[str, Any]:
    """What `isochrome check` says of the frames and the scene as it is on the page.

    `ok`, `count`, `findings`, and the `revision` of the scene that was checked; InputError where
    there is none yet.
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

    Of the region, order over 0.02 fringe plus 1, at most 255, 0 where none is known, in the parts
    that hang together with a known point; and what `process` says. InputError where no order is
    known anywhere.
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
    return shown_orders(reading.order), list(found.frame.warnings)


def shown_orders(order: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Orders, NaN = not known, as levels of the page, see `order_map_of_points`."""
    known = np.isfinite(order)
    level = np.rint(np.where(known, order, 0.0) / _ORDER_STEP) + 1.0
    return np.where(known, np.clip(level, 1, 255), _UNKNOWN).astype(np.uint8)


class ClickPreview:
    """What a point or line of known order would do to the map of a frame, before it is set.

    The frame that was asked of last stays followed, so that each place is answered at once.
    """

    def __init__(self, session: SetupSession) -> None:
        self._session = session
        self._lock = threading.Lock()
        self._key: tuple[Any, ...] | None = None
        self._preview: AnchorPreview | None = None
        self._before: tuple[Any, PatchOrders] | None = None

    def answer(self, index: int, asked: Mapping[str, Any]) -> dict[str, Any]:
        """What would become of the map of a frame: its `kind`, 'nothing' where no order is read.

        Asked: `points`, `lines` as they would stand; `at` (row, col) of the picture, `on_line`:
        what is set; without `at` the frame is only followed, for the next answer. Kinds: 'nothing',
        'new', 'moved', 'changed', 'same', 'lost'; also `words`, `said`, `share` of the frame, the
        part's patches as `rows`, `cols`, `levels` (`order_map_of_points`), and the `revision`.
        """
        with refused_as_asked("preview"):
            asked = _plainly(asked)
        revision = self._session.revision
        try:
            with self._lock:
                found = self._found(index, asked)
        except IsochromeError as error:  # what a click, or the map, would say as well
            found = _nothing(str(error))
        return found | {"revision": revision}

    def _found(self, index: int, asked: Mapping[str, Any]) -> dict[str, Any]:
        """The answer without the revision. Raises InputError, PhysicsError."""
        session, text = self._session, self._session.text
        now = without_model(session.scene(text), text)
        preview = self._followed(now, index)
        if asked["at"] is None:
            return {"kind": "ready", "words": preview.refusal}
        place = _Place.of(asked, now, session.region(now))
        if not place.is_inside:
            return _nothing(f"outside of the region: {place.what} would anchor nothing")
        then = self._stated(text, asked)
        return _what_becomes(preview, self._orders_now(preview, now), then, place)

    def _followed(self, scene: Scene, index: int) -> AnchorPreview:
        """The frame's fringes, followed anew where frame or scene are others."""
        none = {"known_order": (), "known_line": (), "free_boundary": ()}
        bare = scene.model_copy(update={"frames": scene.frames.model_copy(update=none)})
        key = (index, bare.model_dump_json())
        known = scene.frames.model_dump_json()
        old = self._preview
        if old is None or self._key not in (key, (*key, known)):
            self._preview = old = anchor_preview(self._session.frames, scene, index)
            self._key = (*key, known) if old.depends_on_known else key
        return old

    def _orders_now(self, preview: AnchorPreview, scene: Scene) -> PatchOrders:
        """The orders as the scene has them, read once a scene. Raises InputError."""
        key = (self._key, scene.frames.model_dump_json())
        if self._before is None or self._before[0] != key:
            self._before = key, preview.orders(scene)
        return self._before[1]

    def _stated(self, text: str, asked: Mapping[str, Any]) -> Scene:
        """The scene as it would be, without its model. Raises InputError."""
        session = self._session
        region = session.region(session.scene(text))
        shift = {"top_px": region.top_px, "left_px": region.left_px}
        points = order_tables(asked["points"], shift)
        text = with_table_list(text, "frames.known_order", points)
        text = with_table_list(text, "frames.known_line", line_tables(asked["lines"], shift))
        return without_model(session.scene(text), text)


def _plainly(asked: Mapping[str, Any]) -> dict[str, Any]:
    """What was asked, as numbers. Raises KeyError, TypeError, ValueError where it is none."""
    if asked.get("at") is None:
        return {"at": None}
    points = [
        {name: _finite(one[name]) for name in ("row", "col", "order")}
        | {"extremum": one.get("extremum") and str(one["extremum"])}
        for one in asked["points"]
    ]
    lines = [
        {"points": [[*map(_finite, pair)] for pair in one["points"]], "order": float(one["order"])}
        for one in asked["lines"]
    ]
    row, col = map(_finite, asked["at"])
    at, on_line = (row, col), asked.get("on_line") is True
    return {"at": at, "points": points, "lines": lines, "on_line": on_line}


def _finite(value: Any) -> float:
    """A number. Raises TypeError, ValueError where it is none."""
    number = float(value)
    if not abs(number) < _FARTHEST:
        raise ValueError(f"{number} is beyond all pictures")
    return number


@dataclass(frozen=True)
class _Place:
    """A place of the region that is set, and what it is called."""

    row: float
    col: float
    on_line: bool
    is_inside: bool
    whole: str

    @classmethod
    def of(cls, asked: Mapping[str, Any], scene: Scene, region: Roi) -> _Place:
        """The place that was `asked` of, on the picture, in the `region` of a `scene`."""
        row, col = asked["at"][0] - region.top_px, asked["at"][1] - region.left_px
        inside = -0.5 <= row < region.height_px - 0.5 and -0.5 <= col < region.width_px - 0.5
        whole = "frame" if scene.frames.roi is None else "region"
        return cls(row, col, asked["on_line"], inside, whole)

    @property
    def what(self) -> str:
        """What is set there."""
        return "this line" if self.on_line else "this point"


def _what_becomes(
    preview: AnchorPreview, before: PatchOrders, then: Scene, place: _Place
) -> dict[str, Any]:
    """What becomes of the part under a place, and how it is said."""
    what, whole = place.what, place.whole
    part = preview.part_at(place.row, place.col, on_line=place.on_line)
    if not part.any():
        return _nothing(f"no fringe could be followed here: {what} would anchor nothing")
    after = preview.orders(then)
    share = float(part.mean())
    under = f"the part under it, {100.0 * share:.0f} % of the {whole},"
    kind, words = part_change(before.order[part], after.order[part], under, what)
    lost = ~part & np.isfinite(before.order) & ~np.isfinite(after.order)
    if lost.mean() > _WORTH_SAYING:
        words += f"; {100.0 * lost.mean():.0f} % of the {whole} elsewhere would not be known then"
    said = [text for text in after.said if text not in before.said]
    levels = shown_orders(np.where(part, after.order, np.nan))
    return {
        "kind": kind, "words": f"{words}.", "said": said, "share": share,
        "rows": after.rows.tolist(), "cols": after.cols.tolist(),
        "levels": base64.b64encode(levels.tobytes()).decode(),
    }  # fmt: skip


def _nothing(words: str) -> dict[str, Any]:
    """The answer where a place would anchor nothing."""
    return {"kind": "nothing", "words": f"{words}.", "said": [], "share": 0.0}
