"""Anybody on this machine may send anything to the live page: raw sockets, a real process."""

import json
import re
import socket
import struct
import subprocess
import sys

import pytest

from teleop_rt.cli.wiring import open_bench
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt_dev.trial.files import SILICONE, silicone

pytest.importorskip("bokeh")

from teleop_rt.view.live.bounded_http import LONGEST_MESSAGE, LONGEST_REQUEST, MOST_ASKING
from teleop_rt.view.live.server import MOST_BROWSERS, Audience

PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Give the port of a live page, and its process's standard error, once it has ended."""
    folder = tmp_path_factory.mktemp("strangers")
    trial = silicone("duration_s=1.0")
    write_trial(folder, trial)
    run_lockstep(trial, SILICONE, open_bench, folder, lambda _seconds: None)
    command = [sys.executable, "-m", "teleop_rt", "live", folder / "recording.mcap", "--port", "0"]
    with (
        (folder / "errors").open("w") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as server,
    ):
        try:
            yield int(re.search(r":(\d+)/", server.stdout.readline()).group(1))
        finally:
            server.terminate()
    assert (folder / "errors").read_text() == "", "whoever asks wrongly fills a log"


def connected(port):
    return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)


def request(port, path="/", host=None, *headers):
    lines = [f"GET {path} HTTP/1.1", f"Host: {host or f'127.0.0.1:{port}'}", *headers]
    return "\r\n".join(lines).encode() + b"\r\n\r\n"


def status(port, raw):
    """Return the code of the answer to a request; 0 where the connection is closed without one."""
    with connected(port) as line:
        try:
            line.sendall(raw)
            answer = line.recv(12)
        except ConnectionError:
            return 0
    return int(answer.split()[1]) if answer else 0


def line_to(port):
    """Open a line as a page does, and return it after its first frame has begun."""
    line = connected(port)
    line.sendall(
        request(
            port, "/frames", None, "Upgrade: websocket", "Connection: Upgrade",
            "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
            f"Origin: http://127.0.0.1:{port}",
        )
    )  # fmt: skip
    assert line.recv(12) == b"HTTP/1.1 101"
    return line


def message(payload, length=None, code=0x81):
    """Return a masked WebSocket frame that states a length of its own."""
    size = len(payload) if length is None else length
    if size < 126:
        return struct.pack(">BB4x", code, 0x80 | size) + payload
    return struct.pack(">BBQ4x", code, 0xFF, size) + payload


def ends(line):
    """Return whether the other end closes the line, whatever comes before."""
    try:
        while line.recv(1 << 16):
            pass
    except ConnectionError:
        pass
    return True


@pytest.mark.parametrize(
    ("path", "code"),
    [
        ("/", 200),
        ("/static/js/bokeh.min.js", 200),
        ("/static/../../../../../../etc/passwd", 404),
        ("/static/..%2f..%2f..%2fetc/passwd", 404),
        ("/static//etc/passwd", 404),
        ("/static/js/%00", 404),
        ("/static/js/bokeh.json", 404),
        ("/static/js/" + "a" * 5000, 404),
        ("/?theme=%ff%fe", 400),
        ("http://evil.example/", 404),
        ("/" + "a" * LONGEST_REQUEST, 0),
    ],
)
def test_the_page_and_its_scripts_are_given_and_nothing_else(page, path, code):
    assert status(page, request(page, path)) == code


@pytest.mark.parametrize(
    "host", ["evil", "127.0.0.1", "127.0.0.1:{}.", "a@127.0.0.1:{}", "[::1]:{}"]
)
def test_a_name_that_only_looks_like_ours_gets_nothing(page, host):
    assert status(page, request(page, "/", host.format(page))) in {400, 403}
    twice = request(page, "/", host.format(page), f"Host: 127.0.0.1:{page}")
    assert status(page, twice) in {400, 403}
    assert status(page, b"GET / HTTP/1.0\r\n\r\n") == 403


@pytest.mark.parametrize(
    "origin",
    [
        *("null", "", "http://evil", "http://[::1", "http://127.0.0.1:{}@evil", "//127.0.0.1:{}"),
        *("http://evil@127.0.0.1:{}", "http://evil\\@127.0.0.1:{}", "javascript://127.0.0.1:{}/"),
        *("https://127.0.0.1:{}", "http://127.0.0.1:{}, http://evil"),
    ],
)
def test_an_origin_that_only_looks_like_ours_opens_no_line(page, origin):
    for fetched in ("cross-site", "same-origin"):
        raw = request(
            page, "/frames", None, "Upgrade: websocket", "Connection: Upgrade",
            "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
            f"Origin: {origin.format(page)}", f"Sec-Fetch-Site: {fetched}",
        )  # fmt: skip
        assert status(page, raw) == 403


def test_a_body_is_refused_before_it_is_read(page):
    for header in ("Content-Length: 90000000", "Content-Length: 1"):
        assert status(page, request(page, "/", None, header)) == 400
    assert (
        status(page, request(page, "/", None, "Transfer-Encoding: chunked") + b"1\r\na\r\n") == 400
    )


def test_who_never_finishes_a_request_makes_room_and_is_dropped(page):
    """Hundreds used to stay for an hour; beyond 1024 the page was lost and its log grew by MB/s."""
    waiting = [connected(page) for _ in range(MOST_ASKING + 50)]
    for one in waiting:
        one.sendall(b"GET / HTTP/1.1\r\nHost: ")
    assert status(page, request(page)) == 200
    assert all(ends(one) for one in waiting)
    for one in waiting:
        one.close()


@pytest.mark.parametrize(
    "sent",
    [
        message(b"", 2**63),
        message(b"", 2**62),
        message(b"9" * (LONGEST_MESSAGE + 1)),
        message(b"9" * LONGEST_MESSAGE, code=0x01) + message(b"9", code=0x80),
        message(b"\xff\xfe"),
    ],
)
def test_a_message_longer_than_any_of_a_page_ends_the_line_unread(page, sent):
    with line_to(page) as line:
        line.sendall(sent)
        assert ends(line)


@pytest.mark.parametrize(
    "text",
    [
        *("[" * 1000, "9" * 900, '{"estimator": 1e400}', '{"estimator": -1}', '{"seek": NaN}'),
        *('{"seek": Infinity}', f'{{"seek": {"9" * 900}}}', '{"speed": -1e308}', '{"seek": {}}'),
    ],
)
def test_what_no_page_asks_changes_nothing_and_the_line_stays(page, text):
    with line_to(page) as line:
        line.sendall(message(text.encode()) + message(b"still here", code=0x89))
        seen = b""
        while b"still here" not in seen:
            piece = line.recv(1 << 16)
            assert piece
            seen = seen[-20:] + piece
    assert status(page, request(page)) == 200


def test_hundreds_of_lines_that_never_read_keep_nobody_from_looking(page):
    lines = [line_to(page) for _ in range(MOST_BROWSERS + 20)]
    with line_to(page) as another:
        seen = b""
        while b"whole" not in seen:  # its first frame
            piece = another.recv(1 << 16)
            assert piece
            seen = seen[-20:] + piece
    assert status(page, request(page)) == 200
    for one in lines:
        one.close()


class Line:
    """A browser's line that takes its frames, or does not."""

    def __init__(self, *, free):
        self.free, self.row, self.dropped = free, None, False

    def drop(self):
        self.dropped = True


def test_beyond_the_bound_one_that_does_not_read_makes_room_or_else_the_first():
    audience = Audience(None)
    lines = [Line(free=at != 7) for at in range(MOST_BROWSERS)]
    for line in lines:
        audience.join(line)
    assert not any(line.dropped for line in lines)
    audience.join(Line(free=True))
    assert [line.dropped for line in lines].index(True) == 7
    audience.join(Line(free=True))
    assert [at for at, line in enumerate(lines) if line.dropped] == [0, 7]


def test_wishes_between_two_looks_at_them_are_one_and_the_last_counts():
    audience = Audience(None)
    for place_s in range(1000):
        audience.wish({"seek": float(place_s), "x": json.dumps("y" * place_s)})
    audience.wish({"play": False})
    assert audience.take_wishes() == {"seek": 999.0, "play": False}
    assert audience.take_wishes() == {}
