"""`setup`: a local page on which a scene is set up on its frames, and its server. The loopback
address alone, a secret in every address, nothing else served. Other pages of the same browser can
send requests here too: they do not know the token, the browser names them as the Origin, and an
address of theirs that they let point here shows in Host."""

from __future__ import annotations

import base64
import hmac
import json
import secrets
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import asdict
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from numpy.typing import NDArray

from isochrome.drafting import CLEAR_CHI, FIELDS, KINDS, SET_KINDS
from isochrome.errors import InputError, IsochromeError, PhysicsError
from isochrome.frames import look_through
from isochrome.messages import message
from isochrome.output import plain, with_uncertainty
from isochrome.processing import (
    AnchorPreview,
    FrameResult,
    PatchOrders,
    anchor_preview,
    check,
    part_change,
    process_frame,
)
from isochrome.reporting import assemble_page, content_policy
from isochrome.scene import (
    LIBRARY,
    MAX_BYTES,
    Roi,
    Scene,
    parse_toml,
    read_text,
    scene_names,
    toml_text,
    with_table_list,
)
from isochrome.setup_page import edits
from isochrome.setup_page.session import (
    TABLES,
    SetSession,
    SetupSession,
    calibration_answer,
    round_by_spread,
    shown_frame,
)

_ORDER_STEP = 0.02
"""Fringes from level to level of a map as the page shows it."""

_WORTH_SAYING = 0.01
"""Share of the frame that is lost elsewhere from which it is said."""


def fit_answer(session: SetupSession, index: int) -> dict[str, Any]:
    """Fit the scene to one frame as `process` does; PhysicsError: it does not show the model."""
    scene = session.scene()
    if not scene.has_model:
        reason = scene.no_model_reason
        raise InputError("so_there_nothing_fit", name=scene.name, no_model_reason=reason)
    result = process_frame(session.frames, scene, index)
    rows: list[tuple[Any, ...]] = []
    pixel = result.frame.pixel_mm
    stated = scene.camera is not None and scene.camera.pixel_mm is not None
    if result.values and not stated and pixel is not None and scene.rim_diameter_mm is not None:
        value = float(f"{pixel:.6g}")
        rows.append(("camera.pixel_mm", value, f"{value:.6g} (by the rim)", False, False))
    for one in result.values:
        pair = one.value, one.standard_uncertainty
        texts = round_by_spread(*pair), with_uncertainty(*pair)
        rows.append((one.key, *texts, one.asked, one.refined))
    names = "key", "value", "text", "asked", "refined", "line"
    lines = [f"{key.partition('.')[2]} = {toml_text(value)}" for key, value, *_ in rows]
    values = [dict(zip(names, (*row, lines[k]), strict=True)) for k, row in enumerate(rows)]
    # not where it is not known; a load that is read against others has the misfit in its ±
    wrong = result.frame.fit is not None and result.frame.chi > CLEAR_CHI
    answer: dict[str, Any] = {"frame": index, "revision": session.revision}
    answer |= {"chi": result.frame.chi, "wrong": wrong, "summary_text": result.summary_text}
    answer["kept_share"] = result.row.get("kept_share")
    return answer | {"values": values, "warnings": list(result.frame.warnings)}


def check_answer(session: SetupSession, *, fringes: bool) -> dict[str, Any]:
    """What `isochrome check` says; `whole`: a frame was fitted too, where there is one to fit."""
    scene, revision = session.scene(), session.revision
    try:
        session.check_complete()
    except InputError as error:  # a set of which something is still open
        findings = [{"level": "error", "frame": None, "text": str(error)}]
        open_set = {"ok": False, "frames": 0, "findings": findings}
        return open_set | {"revision": revision, "whole": True}
    found = check(session.frames, scene) if fringes else look_through(session.frames, scene)
    whole = fringes or not (found.ok and scene.has_model)
    answer = found.to_json() | {"revision": revision, "whole": whole}
    if session.subject is not None:  # a set has its own model
        reason, findings = scene.no_model_reason, answer["findings"]
        answer["findings"] = [f for f in findings if not f["text"].startswith(reason)]
    return answer


def order_map_of_points(session: SetupSession, index: int) -> tuple[NDArray[np.uint8], list[str]]:
    """Levels of a frame's order from known points alone, in 0.02 fringe plus 1; 0: not known. And
    what `process` says. InputError where no order is known anywhere."""
    scene = edits.without_model(session.scene(), session.text)
    if not scene.frames.orders_known:
        raise InputError("no_order_known_anywhere")
    result: FrameResult = process_frame(session.frames, scene, index)
    reading = result.frame.reading
    if reading is None:
        reason = result.frame.warnings[0] if result.frame.warnings else "no order was read"
        raise PhysicsError(f"frame {index}: " + reason)
    return shown_orders(reading.order), list(result.frame.warnings)


def shown_orders(order: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Orders, NaN = not known, as levels of the page, see `order_map_of_points`."""
    known = np.isfinite(order)
    level = np.rint(np.where(known, order, 0.0) / _ORDER_STEP) + 1.0
    return np.where(known, np.clip(level, 1, 255), 0).astype(np.uint8)


class ClickPreview:
    """What a known point or line would do to a map; the frame last asked of stays followed."""

    def __init__(self, session: SetupSession) -> None:
        self._session, self._lock = session, threading.Lock()
        self._key: tuple[Any, ...] | None = None
        self._preview: AnchorPreview | None = None
        self._before: tuple[Any, PatchOrders] | None = None

    def answer(self, index: int, request: edits.Request) -> dict[str, Any]:
        """What would become of the map of a frame: its `kind`, 'nothing' where no order is read.
        Asked: `points`, `lines` as they would stand, `at` (row, col) of the picture; without `at`
        the frame is only followed. Kinds: 'nothing', 'new', 'moved', 'changed', 'same', 'lost'."""
        session, revision = self._session, self._session.revision
        region = session.region(session.scene_or_none())
        down, right = -region.top_px, -region.left_px
        at, tables = request.get("at"), {}
        with edits.refused_as_asked("preview"):
            if at is not None:
                row, col = (float(place) for place in at)
                at = row + down, col + right
                for key, asked in (("known_order", "points"), ("known_line", "lines")):
                    tables[key] = edits.known_tables(key, request[asked], down, right)
        try:
            with self._lock:
                answer = self._found(index, at, tables, request.get("on_line") is True)
        except IsochromeError as error:  # what a click, or the map, would say as well
            answer = _nothing(str(error))
        return answer | {"revision": revision}

    def _found(
        self, index: int, at: edits.Point | None, tables: dict[str, list[Any]], on_line: bool
    ) -> dict[str, Any]:
        session, text = self._session, self._session.text
        now = edits.without_model(session.scene(text), text)
        preview = self._followed(now, index)
        if at is None:
            return {"kind": "ready", "words": preview.refusal}
        region, what = session.region(now), "this line" if on_line else "this point"
        size = region.height_px, region.width_px
        if not all(-0.5 <= place < most - 0.5 for place, most in zip(at, size, strict=True)):
            return _nothing(message("outside_region_would_anchor", what=what))
        for name, known in tables.items():
            text = with_table_list(text, f"frames.{name}", known)
        then = edits.without_model(session.scene(text), text)
        key = (self._key, now.frames.model_dump_json())
        if self._before is None or self._before[0] != key:  # read once a scene
            self._before = key, preview.orders(now)
        part = preview.part_at(*at, on_line=on_line)
        if not part.any():
            return _nothing(message("no_fringe_could_followed_here", what=what))
        before, after = self._before[1], preview.orders(then)
        extent, share = "frame" if now.frames.roi is None else "region", float(part.mean())
        under = message("part_under", share=100.0 * share, extent=extent)
        kind, words = part_change(before.order[part], after.order[part], under, what)
        lost = float(np.mean(~part & np.isfinite(before.order) & ~np.isfinite(after.order)))
        if lost > _WORTH_SAYING:
            words += message("elsewhere_would_not_known", mean=100.0 * lost, extent=extent)
        levels = shown_orders(np.where(part, after.order, np.nan))
        return {
            "kind": kind, "words": f"{words}.", "share": share,
            "said": [text for text in after.said if text not in before.said],
            "rows": after.rows.tolist(), "cols": after.cols.tolist(),
            "levels": base64.b64encode(levels.tobytes()).decode(),
        }  # fmt: skip

    def _followed(self, scene: Scene, index: int) -> AnchorPreview:
        """The frame's fringes, followed anew where frame or scene are others."""
        none = {"known_order": (), "known_line": (), "free_boundary": ()}
        bare = scene.model_copy(update={"frames": scene.frames.model_copy(update=none)})
        key = (index, bare.model_dump_json())
        known = scene.frames.model_dump_json()
        if self._preview is None or self._key not in (key, (*key, known)):
            self._preview = anchor_preview(self._session.frames, scene, index)
            self._key = (*key, known) if self._preview.depends_on_known else key
        return self._preview


def _nothing(words: str) -> dict[str, Any]:
    """The answer where a place would anchor nothing."""
    return {"kind": "nothing", "words": f"{words}.", "said": [], "share": 0.0}


ADDRESS = "127.0.0.1"

_IDLE_S = 60.0
"""Seconds that a connection may say nothing."""

_PULSE_S = 0.5
"""Seconds between two signs of life to a page, by which a closed one is noticed."""

_GRACE_S = 3.0
"""Seconds without a page after which the server ends: a page that is loaded anew takes less."""

_ROOM, _NAME = "isochrome.setup_page", "setup"
_SCRIPTS = ("view.js", "tools.js", "overlay.js", "preview.js", "panel.js", "find.js", "sets.js")
_ALLOWED = "connect-src 'self'; img-src data:"
_POLICY = (
    content_policy(_ROOM, _NAME, scripts=_SCRIPTS, policy=_ALLOWED) + "; frame-ancestors 'none'"
)
"""What the server says of the page's content, beside what stands in the page itself."""

_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class SetupServer(ThreadingHTTPServer):
    """Serves one session to one browser, on a port of the loopback address; 0: a free one."""

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, session: SetupSession, port: int = 0) -> None:
        super().__init__((ADDRESS, port), _Handler)
        self.session = session
        self.token = secrets.token_urlsafe(24)
        self.work = threading.Lock()  # one fit, check or map at a time
        self.preview = ClickPreview(session)  # beside them: it is to come at once
        # pages that are there, and since when there is none
        self.count, self.pages, self.is_ended = threading.Lock(), 0, False
        self.gone_at: float | None = None

    @property
    def hosts(self) -> tuple[str, str]:
        """What a request may name as its host."""
        return f"{ADDRESS}:{self.server_port}", f"localhost:{self.server_port}"

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self.hosts[0]}/{self.token}/"

    def run(self) -> None:
        """Serve until the page is closed, or `is_ended` is set, from any thread."""
        self.timeout = 0.1
        try:
            while not self.is_ended:
                self.handle_request()
                gone = self.gone_at
                self.is_ended |= gone is not None and time.monotonic() - gone > _GRACE_S
        finally:
            self.is_ended = True
            self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of connections that a browser breaks off."""


Picture = tuple[NDArray[np.uint8], Roi | None, Mapping[str, str]]
"""Grey levels, their region, and more headers."""

Route = Callable[[SetupServer, edits.Request], Mapping[str, Any] | Picture]
"""What answers a request: with a JSON object, or a picture."""


class _Refused(Exception):
    """A request that is not answered: its status, and why, as a message's code and values."""

    def __init__(self, status: HTTPStatus, code: str, **values: Any) -> None:
        super().__init__(message(code, **values))
        self.status = status


class _Handler(BaseHTTPRequestHandler):
    """One connection."""

    server: SetupServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "isochrome", ""
    timeout = _IDLE_S
    disable_nagle_algorithm = True

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing is logged: addresses hold the token."""

    def do_GET(self) -> None:
        """Give the page, a frame, or signs of life."""
        self._answer({"": None, "life": None, **GETS})

    def do_POST(self) -> None:
        """Do what the page asks for."""
        self._answer(POSTS)

    def _answer(self, routes: Mapping[str, Route | None]) -> None:
        """Answer by a route to plain values, or by what the connection itself sends."""
        try:
            name, request = self._asked(routes)
            if self.command == "POST":
                request = self._body()
            route = routes[name]
            if route is None:
                (self.send_life if name else self.send_page)()
                return
            with self.server.work if name in SLOW else nullcontext():
                answer = route(self.server, request)
            if isinstance(answer, tuple):
                picture, region, more = answer
                head: dict[str, Any] = {"X-Rows": picture.shape[0], "X-Cols": picture.shape[1]}
                if region is not None:
                    head |= {"X-Top": region.top_px, "X-Left": region.left_px}
                self._send(picture.tobytes(), "application/octet-stream", {**head, **more})
            else:
                self.send_json(answer)
        except _Refused as refused:
            self.close_connection = True
            self.send_json({"error": str(refused)}, refused.status)
        except IsochromeError as error:
            self.send_json({"error": str(error)}, HTTPStatus.UNPROCESSABLE_ENTITY)
        except (BrokenPipeError, ConnectionResetError, TimeoutError):
            self.close_connection = True

    def _asked(self, names: Collection[str]) -> tuple[str, dict[str, Any]]:
        """Which of the names was asked, and the query; _Refused for all that is not the page's."""
        hosts = self.headers.get_all("Host") or []
        if len(hosts) != 1 or hosts[0] not in self.server.hosts:
            raise _Refused(HTTPStatus.FORBIDDEN, "address_not_page")
        origin = self.headers.get("Origin")
        origins = [f"http://{host}" for host in self.server.hosts]
        if (origin is not None or self.command == "POST") and origin not in origins:
            raise _Refused(HTTPStatus.FORBIDDEN, "asked_another_page")
        parts = urlsplit(self.path)
        token, _, name = parts.path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            raise _Refused(HTTPStatus.FORBIDDEN, "address_token_wrong")
        if name not in names:  # names alone: no path is ever made of what is asked for
            raise _Refused(HTTPStatus.NOT_FOUND, "there_nothing_name")
        return name, {key: values[0] for key, values in parse_qs(parts.query).items()}

    def _body(self) -> dict[str, Any]:
        """The JSON object that was sent. Raises _Refused before a byte of one too long is read."""
        if self.headers.get("Transfer-Encoding") is not None:
            raise _Refused(HTTPStatus.NOT_IMPLEMENTED, "send_content_length")
        stated = self.headers.get_all("Content-Length") or []
        if len(stated) != 1 or not (stated[0].isascii() and stated[0].isdigit()):
            raise _Refused(HTTPStatus.LENGTH_REQUIRED, "send_one_content_length")
        if len(stated[0]) > 12 or int(stated[0]) > MAX_BYTES:
            raise _Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "bytes_most", most_bytes=MAX_BYTES)
        if (self.headers.get_content_type()) != "application/json":
            raise _Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "send_application_json")
        try:
            body = json.loads(self.rfile.read(int(stated[0])))
        except (ValueError, RecursionError) as error:
            raise _Refused(HTTPStatus.BAD_REQUEST, "body_no_json") from error
        if not isinstance(body, dict):
            raise _Refused(HTTPStatus.BAD_REQUEST, "body_no_json_object")
        return body

    def send_json(self, answer: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        """Send a JSON object; NaN as null."""
        data = json.dumps(plain(answer), allow_nan=False).encode()
        self._send(data, "application/json", status=status)

    def send_page(self) -> None:
        """Send the page itself; loaded anew, it shows what the file holds."""
        session = self.server.session
        session.read_again()
        subject, fields = session.subject, [asdict(field) for field in FIELDS]
        kinds = KINDS if subject is None else {subject: SET_KINDS[subject]}
        data = {"fields": fields, "kinds": kinds, "searched": edits.SEARCHED}
        values = {
            "scene_file": session.scene_file.name, "subject": subject, "data": data,
            "kinds": list(kinds.items()),
        }  # fmt: skip
        html = assemble_page(_ROOM, _NAME, scripts=_SCRIPTS, policy=_ALLOWED, values=values)
        self._send(html.encode(), "text/html; charset=utf-8")

    def send_life(self) -> None:
        """Send signs of life as long as the page is there: its end is the server's."""
        server, self.close_connection = self.server, True
        self._send(b"", "text/event-stream", ends=False)
        with server.count:
            server.pages, server.gone_at = server.pages + 1, None
        try:
            while not server.is_ended:
                self.wfile.write(b": here\n\n")
                self.wfile.flush()
                time.sleep(_PULSE_S)
        finally:
            with server.count:
                server.pages -= 1
                server.gone_at = None if server.pages else time.monotonic()

    def _send(
        self,
        data: bytes,
        kind: str,
        more: Mapping[str, Any] = {},
        status: HTTPStatus = HTTPStatus.OK,
        *,
        ends: bool = True,
    ) -> None:
        headers = {**_HEADERS, **more, "Content-Type": kind}
        if ends:
            headers |= {"Content-Length": len(data)}
        if self.close_connection:
            headers |= {"Connection": "close"}
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, str(value))
        self.end_headers()
        self.wfile.write(data)


def _index(request: edits.Request) -> int:
    """The number of a frame that was asked for. Raises _Refused where it is none."""
    text = str(request.get("frame", ""))
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise _Refused(HTTPStatus.BAD_REQUEST, "frame_no_number_from")
    return int(text)


def _model(server: SetupServer, request: edits.Request) -> Picture:
    given = request.get("values") or {}
    if not isinstance(given, dict) or not all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in given.values()
    ):
        raise _Refused(HTTPStatus.BAD_REQUEST, "values_no_numbers")
    return *server.session.live(_index(request), given), {}


def _find(server: SetupServer, request: edits.Request) -> Mapping[str, Any]:
    values = request.get("values")
    if not (values is None or isinstance(values, dict)):
        raise _Refused(HTTPStatus.BAD_REQUEST, "values_no_form")
    form = None if values is None else (str(request.get("kind")), values)
    held = request.get("held") is True
    answer = edits.find_in_frames(server.session, _index(request), form=form, held=held)
    return answer | {"state": edits.session_state(server.session)}


def _map(server: SetupServer, request: edits.Request) -> Picture:
    shown, warnings = order_map_of_points(server.session, _index(request))
    words = json.dumps(warnings)  # escapes whatever is not ASCII
    region = server.session.region(server.session.scene_or_none())
    return shown, region, {"X-Said": words if len(words) < 2000 else "[]"}


def _frame(server: SetupServer, request: edits.Request) -> Picture:
    session = server.session
    return shown_frame(session.frame(_index(request), session.scene_or_none()).image), None, {}


GETS: Mapping[str, Route] = {
    "state": lambda server, _: edits.session_state(server.session),
    "frame": _frame,
}

POSTS: Mapping[str, Route] = {
    "model": _model,
    "tool": lambda server, request: edits.apply_tool(server.session, request),
    "find": _find,
    "fit": lambda server, request: fit_answer(server.session, _index(request)),
    "calibrate": lambda server, _: calibration_answer(edits.set_of(server.session)),
    "outlines": lambda server, request: {
        "outlines": edits.set_of(server.session).outlines(_index(request))
    },
    "check": lambda server, request: check_answer(
        server.session, fringes=request.get("fringes") is True
    ),
    "map": _map,
    "preview": lambda server, request: server.preview.answer(_index(request), request),
}
"""All that can be asked for, by its name behind the token, beside the page and its life."""

SLOW = ("find", "fit", "calibrate", "check", "map")
"""What takes a while: one at a time."""


_NEW_SCENE, _NEW_SET = "scene.toml", "set.toml"
"""What a scene, and a calibration set, is called that is made on the page."""

SUBJECTS = {table: kind for kind, table in TABLES.items()}
"""What may be calibrated, and its kind of set."""


def setup(
    frames: str | Path | Sequence[str | Path],
    scene: str | Path | None = None,
    *,
    calibration: str | None = None,
    browser: bool = True,
    port: int = 0,
    announce: Callable[[str], None] | None = None,
) -> Path | None:
    """Open a local page on which a scene is set up on its frames.

    On the picture are set: the scale, the surface, the contact, the region of interest, a mask, and
    places of known order. The model's fringes lie over it and follow the sliders, a frame can be
    fitted, and `check` says what it thinks. With `calibration` it is a calibration set that is set
    up, of images at several loads: their loads, the beam's edges and rollers or the disc's rim, and
    what `calibrate` finds. The page is served to this machine alone; it reads the
    frames and the scene, and writes the scene when Save is pressed, comments kept. The call comes
    back when the page is closed, or on Ctrl-C.

    Parameters
    ----------
    frames : str, Path or sequence of them
        The captured frames, as for `open_frames`.
    scene : str or Path, optional
        A scene file, which need not be there yet, or the name of a scene of the package, whose copy
        becomes scene.toml. By default scene.toml beside the frames, or set.toml. A file that holds
        a calibration set is set up as one; it may stand alone in place of the frames.
    calibration : {'beam', 'disc'}, optional
        What is calibrated, where a calibration set is to be made.
    browser : bool, default True
        Whether to open the page in the browser.
    port : int, default 0
        Port on the loopback address; 0: a free one.
    announce : callable, optional
        Called with the page's address once it can be opened.

    Returns
    -------
    Path or None
        The scene file; None where nothing was saved.

    Raises
    ------
    InputError
        Where the frames or the scene cannot be read, or the port is taken.

    Examples
    --------
    >>> import isochrome
    >>> isochrome.setup("captured.tif", browser=False, announce=print)  # doctest: +SKIP
    http://127.0.0.1:40325/R9dEzNpqYTHa5FgYgbHkcrnLhLxBr6dQ/
    PosixPath('scene.toml')
    """
    session = open_session(frames, scene, calibration=calibration)
    try:
        server = SetupServer(session, port)
    except (OSError, OverflowError) as error:
        raise InputError("port_cannot_used_machine", port=port, error=error) from error
    if announce is not None:
        announce(server.url)
    if browser:
        import webbrowser

        webbrowser.open(server.url)
    with suppress(KeyboardInterrupt):  # the user's way to end it, as good as closing the page
        server.run()
    return session.scene_file if session.saves else None


def open_session(
    frames: str | Path | Sequence[str | Path],
    scene: str | Path | None = None,
    *,
    calibration: str | None = None,
) -> SetupSession:
    """Open the frames, and the scene or set where there is one; a set names its frames."""
    if calibration is not None and calibration not in SUBJECTS:
        names = ", ".join(SUBJECTS)
        raise InputError("calibration_none_name_one", calibration=calibration, subjects=names)
    given = frames if isinstance(frames, str | Path) else tuple(frames)
    if scene is None and isinstance(given, str | Path) and Path(given).suffix.lower() == ".toml":
        scene, given = given, _images_of(Path(given))
    first = Path(given if isinstance(given, str | Path) else given[0])
    folder = first if first.is_dir() else first.parent
    if scene is not None and str(scene) in scene_names() and not Path(scene).exists():
        text = (LIBRARY / f"{scene}.toml").read_text("utf-8")
        return SetupSession(given, folder / _NEW_SCENE, text, saved=False)
    place = Path(scene or folder / (_NEW_SET if calibration else _NEW_SCENE))
    return _session_of(given, place, calibration)


def _session_of(
    given: str | Path | tuple[str | Path, ...], place: Path, calibration: str | None
) -> SetupSession:
    """The session on a scene's or set's file, there or not yet; its line ends stay."""
    if place.is_dir() or not place.parent.is_dir():
        raise InputError("scene_cannot_written_there", place=place)
    text, saved = "", place.is_file()
    if saved:
        read_text(place)  # its refusals: too large, a picture, not UTF-8
        text = place.read_bytes().decode("utf-8-sig")
    holds = parse_toml(text, str(place)).keys() if text.strip() else ()
    (subject,) = [kind for kind, table in TABLES.items() if table in holds] or (None,)
    if calibration is not None:
        if holds and subject != SUBJECTS[calibration]:
            raise InputError("holds_no_so_no", place=place, calibration=calibration)
        subject = SUBJECTS[calibration]
    session = (
        SetupSession(given, place, text, saved=saved)
        if subject is None
        else SetSession(given, place, text, saved=saved, subject=subject)
    )
    if saved:
        session.scene()  # what is wrong with it is said before a page opens
    return session


def _images_of(place: Path) -> tuple[Path, ...]:
    images = parse_toml(read_text(place), str(place)).get("image")
    listed = images if isinstance(images, list) else ()
    files = [one.get("file") for one in listed if isinstance(one, dict)]
    if not files or not all(isinstance(file, str) for file in files):
        raise InputError("names_no_image_so", place=place)
    return tuple(place.parent / str(file) for file in files)
