"""The page's server: the loopback address alone, a secret in every address, nothing else served.

Other pages of the same browser can send requests here too. They do not know the token, the browser
names them as the Origin, and an address of theirs that they let point here shows in Host.
"""

from __future__ import annotations

import hmac
import json
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from numpy.typing import NDArray

from isochrome.errors import IsochromeError
from isochrome.output import plain
from isochrome.reporting import assemble_page, content_policy
from isochrome.setup_page.cold_search import SEARCHED, find_in_frames
from isochrome.setup_page.edits import apply_tool
from isochrome.setup_page.fields import KINDS, SET_KINDS, field_rows
from isochrome.setup_page.page_state import session_state
from isochrome.setup_page.questions import (
    ClickPreview,
    check_answer,
    fit_answer,
    order_map_of_points,
)
from isochrome.setup_page.session import SetupSession
from isochrome.setup_page.set_session import SetSession, calibration_answer

ADDRESS = "127.0.0.1"

MOST_BYTES = 1_000_000
"""Of a request's body: a scene's text with room to spare."""

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

_TYPE = "application/octet-stream"


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
        self._pages = 0
        self._gone_at: float | None = None
        self._count = threading.Lock()
        self._ended = threading.Event()

    @property
    def hosts(self) -> tuple[str, str]:
        """What a request may name as its host."""
        return f"{ADDRESS}:{self.server_port}", f"localhost:{self.server_port}"

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self.hosts[0]}/{self.token}/"

    def run(self) -> None:
        """Serve until the page is closed, or `end` is called."""
        watch = threading.Thread(target=self._watch, daemon=True)
        watch.start()
        try:
            self.serve_forever(poll_interval=0.1)
        finally:
            self._ended.set()
            self.server_close()

    def end(self) -> None:
        """End serving, from any other thread."""
        self._ended.set()
        self.shutdown()

    @property
    def is_ended(self) -> bool:
        """Whether the server is about to end."""
        return self._ended.is_set()

    def page_opened(self) -> None:
        """Count a page that is there."""
        with self._count:
            self._pages += 1
            self._gone_at = None

    def page_closed(self) -> None:
        """Count a page that is gone."""
        with self._count:
            self._pages -= 1
            if self._pages == 0:
                self._gone_at = time.monotonic()

    def _watch(self) -> None:
        while not self._ended.wait(0.2):
            with self._count:
                gone = self._gone_at
            if gone is not None and time.monotonic() - gone > _GRACE_S:
                self.end()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of connections that a browser breaks off."""


class _Refused(Exception):
    """A request that is not answered: its status, and why."""

    def __init__(self, status: HTTPStatus, why: str) -> None:
        super().__init__(why)
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
        self._answer(GETS)

    def do_POST(self) -> None:
        """Do what the page asks for."""
        self._answer(POSTS)

    def _answer(self, routes: Mapping[str, Callable[[_Handler, Any], None]]) -> None:
        try:
            route, query = self._route(routes)
            asked = self._body() if self.command == "POST" else query
            route(self, asked)
        except _Refused as refused:
            self.close_connection = True
            self.send_json({"error": str(refused)}, refused.status)
        except IsochromeError as error:
            self.send_json({"error": str(error)}, HTTPStatus.UNPROCESSABLE_ENTITY)
        except (BrokenPipeError, ConnectionResetError, TimeoutError):
            self.close_connection = True

    def _route(
        self, routes: Mapping[str, Callable[[_Handler, Any], None]]
    ) -> tuple[Callable[[_Handler, Any], None], dict[str, str]]:
        """What answers a request, and its query. Raises _Refused for all that is not the page's."""
        hosts = self.headers.get_all("Host") or []
        if len(hosts) != 1 or hosts[0] not in self.server.hosts:
            raise _Refused(HTTPStatus.FORBIDDEN, "this address is not the page's")
        origin = self.headers.get("Origin")
        own = [f"http://{host}" for host in self.server.hosts]
        if (origin is not None or self.command == "POST") and origin not in own:
            raise _Refused(HTTPStatus.FORBIDDEN, "asked by another page")
        parts = urlsplit(self.path)
        token, _, name = parts.path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            raise _Refused(HTTPStatus.FORBIDDEN, "the address's token is wrong")
        route = routes.get(name)  # names alone: no path is ever made of what is asked for
        if route is None:
            raise _Refused(HTTPStatus.NOT_FOUND, "there is nothing of this name")
        query = {key: values[0] for key, values in parse_qs(parts.query).items()}
        return route, query

    def _body(self) -> dict[str, Any]:
        """The JSON object that was sent. Raises _Refused before a byte of one too long is read."""
        if self.headers.get("Transfer-Encoding") is not None:
            raise _Refused(HTTPStatus.NOT_IMPLEMENTED, "send a Content-Length")
        stated = self.headers.get_all("Content-Length") or []
        if len(stated) != 1 or not (stated[0].isascii() and stated[0].isdigit()):
            raise _Refused(HTTPStatus.LENGTH_REQUIRED, "send one Content-Length")
        if len(stated[0]) > 12 or int(stated[0]) > MOST_BYTES:
            raise _Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"{MOST_BYTES} bytes are the most")
        if (self.headers.get_content_type()) != "application/json":
            raise _Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "send application/json")
        try:
            asked = json.loads(self.rfile.read(int(stated[0])))
        except (ValueError, RecursionError) as error:
            raise _Refused(HTTPStatus.BAD_REQUEST, "the body is no JSON") from error
        if not isinstance(asked, dict):
            raise _Refused(HTTPStatus.BAD_REQUEST, "the body is no JSON object")
        return asked

    def send_json(self, answer: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        """Send a JSON object; NaN as null."""
        data = json.dumps(plain(answer), allow_nan=False).encode()
        self._send(data, "application/json", status, {})

    def send_picture(self, picture: NDArray[np.uint8], more: Mapping[str, str]) -> None:
        """Send grey levels as raw bytes, row by row, with what more is said of them."""
        rows, cols = picture.shape
        size = {"X-Rows": str(rows), "X-Cols": str(cols)}
        self._send(picture.tobytes(), _TYPE, HTTPStatus.OK, size | dict(more))

    def send_page(self) -> None:
        """Send the page itself."""
        session = self.server.session
        own = session.subject
        kinds = KINDS if own is None else {own: SET_KINDS[own]}
        html = assemble_page(
            _ROOM,
            _NAME,
            scripts=_SCRIPTS,
            policy=_ALLOWED,
            values={
                "scene_file": session.scene_file.name,
                "subject": session.subject,
                "kinds": list(kinds.items()),
                "data": {"fields": field_rows(), "kinds": kinds, "searched": SEARCHED},
            },
        )
        data = html.encode()
        self._send(data, "text/html; charset=utf-8", HTTPStatus.OK, {})

    def _send(self, data: bytes, kind: str, status: HTTPStatus, more: Mapping[str, str]) -> None:
        self.send_response(status)
        for name, value in (_HEADERS | dict(more)).items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(data)

    def send_life(self) -> None:
        """Send signs of life as long as the page is there: its end is the server's."""
        self.close_connection = True
        self.send_response(HTTPStatus.OK)
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", "text/event-stream")
        self.end_headers()
        self.server.page_opened()
        try:
            while not self.server.is_ended:
                self.wfile.write(b": here\n\n")
                self.wfile.flush()
                time.sleep(_PULSE_S)
        finally:
            self.server.page_closed()


def _page(handler: _Handler, _: Any) -> None:
    handler.server.session.read_again()  # a page that is loaded anew shows what the file holds
    handler.send_page()


def _frame(handler: _Handler, query: Mapping[str, str]) -> None:
    handler.send_picture(handler.server.session.picture(_index(query)), {})


def _index(asked: Mapping[str, Any]) -> int:
    """The number of a frame that was asked for. Raises _Refused where it is none."""
    text = str(asked.get("frame", ""))
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise _Refused(HTTPStatus.BAD_REQUEST, "frame is no number from 0")
    return int(text)


def _model(handler: _Handler, asked: Mapping[str, Any]) -> None:
    given = asked.get("values") or {}
    if not isinstance(given, dict) or not all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in given.values()
    ):
        raise _Refused(HTTPStatus.BAD_REQUEST, "values are no numbers")
    picture, region = handler.server.session.live(_index(asked), given)
    handler.send_picture(picture, {"X-Top": str(region.top_px), "X-Left": str(region.left_px)})


def _tool(handler: _Handler, asked: Mapping[str, Any]) -> None:
    session = handler.server.session
    apply_tool(session, asked)
    handler.send_json(session_state(session))


def _fit(handler: _Handler, asked: Mapping[str, Any]) -> None:
    with handler.server.work:
        answer = fit_answer(handler.server.session, _index(asked))
    handler.send_json(answer)


def _check(handler: _Handler, _: Any) -> None:
    with handler.server.work:
        answer = check_answer(handler.server.session)
    handler.send_json(answer)


def _calibrate(handler: _Handler, _: Any) -> None:
    with handler.server.work:
        answer = calibration_answer(_set_of(handler))
    handler.send_json(answer)


def _outlines(handler: _Handler, asked: Mapping[str, Any]) -> None:
    handler.send_json({"outlines": _set_of(handler).outlines(_index(asked))})


def _set_of(handler: _Handler) -> SetSession:
    """The session of a calibration set. Raises _Refused for a scene's."""
    session = handler.server.session
    if not isinstance(session, SetSession):
        raise _Refused(HTTPStatus.BAD_REQUEST, "this page sets up a scene")
    return session


def _find(handler: _Handler, asked: Mapping[str, Any]) -> None:
    """The scene of a frame by a cold search, and the state that it leaves."""
    session, values = handler.server.session, asked.get("values")
    if not (values is None or isinstance(values, dict)):
        raise _Refused(HTTPStatus.BAD_REQUEST, "values are no form")
    form = None if values is None else (str(asked.get("kind")), values)
    with handler.server.work:
        found = find_in_frames(session, _index(asked), form=form, held=asked.get("held") is True)
    handler.send_json(found | {"state": session_state(session)})


def _map(handler: _Handler, asked: Mapping[str, Any]) -> None:
    session = handler.server.session
    with handler.server.work:
        shown, said = order_map_of_points(session, _index(asked))
    region = session.region(session.scene_or_none())
    place = {"X-Top": str(region.top_px), "X-Left": str(region.left_px)}
    words = json.dumps(said)  # escapes whatever is not ASCII
    handler.send_picture(shown, place | {"X-Said": words[:2000] if len(words) < 2000 else "[]"})


def _preview(handler: _Handler, asked: Mapping[str, Any]) -> None:
    handler.send_json(handler.server.preview.answer(_index(asked), asked))


GETS: Mapping[str, Callable[[_Handler, Any], None]] = {
    "": _page,
    "life": lambda handler, _: handler.send_life(),
    "state": lambda handler, _: handler.send_json(session_state(handler.server.session)),
    "frame": _frame,
}

POSTS: Mapping[str, Callable[[_Handler, Any], None]] = {
    "model": _model,
    "tool": _tool,
    "find": _find,
    "fit": _fit,
    "calibrate": _calibrate,
    "outlines": _outlines,
    "check": _check,
    "map": _map,
    "preview": _preview,
}
"""All that can be asked for, by its name behind the token."""
