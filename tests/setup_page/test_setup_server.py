"""The server by plain sockets: who is let in, and what is refused before it is read."""

import json
import shutil
import signal
import socket
import subprocess
import sys
import time

import pytest

from isochrome.frames import look_through
from isochrome.samples import samples_path
from isochrome.scene import MAX_BYTES
from isochrome.setup_page import open_session
from runs.killing import listen

from .conftest import served


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A server on the sample's frames, for all of these tests."""
    folder = tmp_path_factory.mktemp("frames")
    shutil.copy(samples_path() / "line-contact-wear" / "captured.tif", folder)
    with served(open_session(folder / "captured.tif")) as own:
        yield own


def ask(server, method="GET", path=None, headers=None, body=b"", *, raw=None):
    """Status, headers and body of a request of its own connection."""
    host = f"127.0.0.1:{server.server_port}"
    given = {"Host": host, "Connection": "close"}
    if method == "POST":
        given |= {"Origin": f"http://{host}", "Content-Type": "application/json",
                  "Content-Length": str(len(body))}  # fmt: skip
    given |= headers or {}
    path = f"/{server.token}/" if path is None else path
    lines = [f"{name}: {value}" for name, value in given.items() if value is not None]
    text = "\r\n".join([f"{method} {path} HTTP/1.1", *lines, "", ""]).encode("latin-1") + body
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as link:
        link.sendall(text if raw is None else raw)
        data = b""
        while part := link.recv(65536):
            data += part
    head, _, rest = data.partition(b"\r\n\r\n")
    return int(head.split()[1]), head.decode("latin-1"), rest


def test_the_page_says_what_it_may_do(server):
    status, head, body = ask(server)
    assert status == 200 and b"<h1>Set up" in body
    policy = next(line for line in head.split("\r\n") if line.startswith("Content-Security-Policy"))
    assert "default-src 'none'" in policy and "connect-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy and "unsafe" not in policy
    for line in (
        "X-Content-Type-Options: nosniff",
        "Referrer-Policy: no-referrer",
        "Cache-Control: no-store",
        "Cross-Origin-Resource-Policy: same-origin",
    ):
        assert line in head
    assert server.token not in head and "Access-Control" not in head


def test_it_listens_to_this_machine_alone_and_to_one_host_and_origin(server):
    assert server.socket.getsockname()[0] == "127.0.0.1" and len(server.token) >= 32
    body = json.dumps({"tool": "undo"}).encode()
    status, _, _ = ask(server, "POST", f"/{server.token}/tool", {"Origin": None}, body)
    assert status == 403
    host = f"127.0.0.1:{server.server_port}"
    raw = f"GET /{server.token}/state HTTP/1.1\r\nHost: {host}\r\nHost: evil\r\n\r\n".encode()
    assert ask(server, raw=raw)[0] == 403


PATHS = [
    "/", "//", "/state", "/{wrong}/state", "/{token}", "/{token}/../state", "/{token}/%2e%2e/x",
    "/{token}/../../../../etc/passwd", "/{token}/captured.tif", "/{token}/./state",
    "/{token}/state/..", "/{token}//state", "/{token}/frame/../state", "http://evil/{token}/x",
    "/{token}/\x00", "/{token}/setup.js",
]  # fmt: skip


@pytest.mark.parametrize("path", PATHS)
def test_what_is_not_the_pages_is_refused(server, path):
    wrong = ("A" if server.token[0] != "A" else "B") + server.token[1:]
    path = path.replace("{token}", server.token).replace("{wrong}", wrong)
    status, _, body = ask(server, path=path)
    if path == f"/{server.token}":  # the page itself, without its last stroke
        assert status == 200
        return
    assert status in (400, 403, 404) and b"root:" not in body and b"specimen" not in body


HEADERS = [
    {"Host": None}, {"Host": "evil.example"}, {"Host": "127.0.0.1"}, {"Host": "127.0.0.1:1"},
    {"Host": "localhost.evil.example"}, {"Origin": "http://evil.example"}, {"Origin": "null"},
    {"Origin": "https://127.0.0.1:{port}"}, {"Origin": "http://127.0.0.1"},
]  # fmt: skip


@pytest.mark.parametrize("headers", HEADERS)
@pytest.mark.parametrize(
    ("method", "name"), [("GET", "state"), ("POST", "tool"), ("POST", "preview")]
)
def test_another_host_or_origin_is_refused(server, headers, method, name):
    given = {k: v and v.replace("{port}", str(server.server_port)) for k, v in headers.items()}
    body = json.dumps({"tool": "save"}).encode() if method == "POST" else b""
    status, _, _ = ask(server, method, f"/{server.token}/{name}", given, body)
    assert status == 403


@pytest.mark.parametrize("name", ["tool", "preview"])
@pytest.mark.parametrize("length", [MAX_BYTES + 1, 1_000_000_000, 10**30])
def test_a_body_of_a_gigabyte_is_refused_before_it_is_read(server, length, name):
    """None of it is sent, and the answer is there at once."""
    began = time.monotonic()
    status, head, _ = ask(
        server, "POST", f"/{server.token}/{name}", {"Content-Length": str(length)}, b""
    )
    assert status == 413 and "Connection: close" in head
    assert time.monotonic() - began < 5.0  # it does not wait for the body; the machine is slow


@pytest.mark.parametrize(
    ("headers", "body", "wanted"),
    [
        ({"Content-Length": None}, b"", 411), ({"Content-Length": "-5"}, b"", 411),
        ({"Content-Length": "1e3"}, b"", 411),
        ({"Transfer-Encoding": "chunked", "Content-Length": None}, b"0\r\n\r\n", 501),
        ({"Content-Type": "text/plain"}, b"{}", 415),
        ({"Content-Type": "application/x-www-form-urlencoded"}, b"{}", 415), ({}, b"{", 400),
        ({}, b"[1]", 400), ({}, b"[" * 100_000, 400), ({}, b"\xff\xfe", 400),
    ],
)  # fmt: skip
def test_a_body_that_is_no_json_object_is_refused(server, headers, body, wanted):
    assert ask(server, "POST", f"/{server.token}/tool", headers, body)[0] == wanted


@pytest.mark.parametrize(
    ("name", "asked", "wanted"),
    [
        ("tool", {}, 422), ("tool", {"tool": ["save"]}, 422),
        ("tool", {"tool": "values", "values": 3}, 422),
        ("tool", {"tool": "values", "values": {"load.normal_n": {"a": [1]}}}, 422),
        ("tool", {"tool": "text", "text": "load = ["}, 422),
        ("tool", {"tool": "scale", "points": [[0, 0]], "length_mm": "x"}, 422),
        ("model", {"frame": 0, "values": {"load.normal_n": "rm"}}, 400),
        ("model", {"frame": 0, "values": {}}, 422), ("model", {"frame": "../0"}, 400),
        ("fit", {"frame": -1}, 400), ("fit", {"frame": 0}, 422), ("check", {}, 422),
        ("map", {"frame": 99}, 422), ("preview", {"frame": "x"}, 400),
        ("preview", {"frame": 0, "at": [1, 2], "points": 3, "lines": []}, 422),
        ("find", {"frame": "x"}, 400), ("find", {"frame": 0, "values": 3}, 400),
        ("find", {"frame": 0}, 422),
        ("find", {"frame": 0, "kind": "contact", "values": {"load.normal_n": [None]}}, 422),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_said_in_a_line(server, name, asked, wanted):
    status, _, body = ask(
        server, "POST", f"/{server.token}/{name}", body=json.dumps(asked).encode()
    )
    assert status == wanted
    said = json.loads(body)["error"]
    assert said and "\n" not in said and "Traceback" not in said


def test_a_check_that_comes_by_itself_fits_no_frame(made, monkeypatch):
    """It comes after each change, and what a user asks for next waits for it."""
    fitted = []
    monkeypatch.setattr(
        "isochrome.setup_page.server.check",
        lambda frames, scene: fitted.append(True) or look_through(frames, scene),
    )
    with served(made) as server:
        for asked in ({}, {"fringes": False}, {"fringes": True}):
            path = f"/{server.token}/check"
            status, _, body = ask(server, "POST", path, body=json.dumps(asked).encode())
            answer = json.loads(body)
            assert status == 200 and answer["ok"] and answer["frames"] == 6
            assert answer["whole"] is bool(fitted) is (asked.get("fringes") is True)


def test_a_frame_is_its_grey_levels(server):
    status, head, body = ask(server, path=f"/{server.token}/frame?frame=2")
    assert status == 200 and "X-Rows: 494" in head and "X-Cols: 659" in head
    assert len(body) == 494 * 659 and max(body) == 255
    assert ask(server, path=f"/{server.token}/frame?frame=6")[0] == 422
    assert ask(server, path=f"/{server.token}/frame")[0] == 400


def test_the_server_ends_when_its_page_is_gone(fresh, monkeypatch):
    monkeypatch.setattr("isochrome.setup_page.server._GRACE_S", 0.3)
    with served(open_session(fresh / "captured.tif")) as own:
        text = f"GET /{own.token}/life HTTP/1.1\r\nHost: 127.0.0.1:{own.server_port}\r\n\r\n"
        with socket.create_connection(("127.0.0.1", own.server_port), timeout=10) as link:
            link.sendall(text.encode())
            assert b"text/event-stream" in link.recv(4096)
            time.sleep(0.5)
            assert not own.is_ended
        for _ in range(100):
            if own.is_ended:
                break
            time.sleep(0.1)
        assert own.is_ended


@pytest.mark.long
def test_ctrl_c_ends_the_command_and_says_that_nothing_was_saved(fresh):
    command = [sys.executable, "-m", "isochrome", "setup", str(fresh / "captured.tif"),
               "--no-browser", "--json"]  # fmt: skip
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=None if sys.platform == "win32" else listen,
    )  # fmt: skip
    assert "http://127.0.0.1:" in process.stderr.readline()
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert (process.returncode, json.loads(out), err) == (0, {"scene": None}, "")
    assert not (fresh / "scene.toml").exists()
