"""The server of the live page: a separate process, loopback by default, read-only."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import os
import signal
import socket
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from teleop_rt.errors import RecordingError
from teleop_rt.view.live.bounded_http import LONGEST_MESSAGE, BoundedServer, keep_quiet, scripts
from teleop_rt.view.live.feed import Feed
from teleop_rt.view.live.frames import Frames
from teleop_rt.view.live.page import page
from teleop_rt.view.style import DARK, LIGHT

FRAME_MS = 40
"""Between two frames of the page, 25 a second."""
FULL_RATE_BROWSERS = 20
"""Browsers that get every frame; with more of them, each gets fewer."""
MOST_BROWSERS = 200
"""Beyond them the longest without an interest makes room: one that does not read, or the first."""
_JUDGE_MS = 200
"""Between two judgements of the residual."""
_WISH_MS = 100
"""Period at which wishes for a playback are fulfilled: to seek is to read a part of the file."""
_WISHES = ("play", "speed", "loop", "seek")


class Audience:
    """Everybody who looks: one frame per tick for all of them, composed once."""

    def __init__(self, frames: Frames) -> None:
        self._frames = frames
        self._ticks = 0
        self._lines: dict[Line, bool] = {}
        self._wishes: dict[str, Any] = {}

    def join(self, line: Line) -> None:
        """Add a browser; its first frame contains everything."""
        if len(self._lines) >= MOST_BROWSERS:
            deaf = (one for one in self._lines if not one.free)
            other = next(deaf, next(iter(self._lines)))
            self.leave(other)
            other.drop()
        self._lines[line] = False

    def leave(self, line: Line) -> None:
        """Forget a browser."""
        self._lines.pop(line, None)

    def wish(self, asked: Mapping[str, Any]) -> None:
        """Keep a browser's request to a playback; the last request counts."""
        self._wishes |= {name: asked[name] for name in _WISHES if name in asked}

    def take_wishes(self) -> Mapping[str, Any]:
        """Return the requests since the last call."""
        wishes, self._wishes = self._wishes, {}
        return wishes

    @property
    def share(self) -> int:
        """Of how many ticks one makes a frame, so that the many do not stall each other."""
        return max(1, -(-len(self._lines) // FULL_RATE_BROWSERS))

    def restart(self) -> None:
        """Send everything to every browser with the next frame."""
        self._frames.forget()
        self._lines = dict.fromkeys(self._lines, False)

    def tick(self) -> None:
        """Send the next frame; a browser that has not taken the last one gets everything later."""
        self._ticks += 1
        if self._ticks % self.share:
            return
        note = self._note()
        self._frames.chosen = frozenset(one.row for one in self._lines if one.row is not None)
        text, whole = self._frames.next(note), ""
        for line, follows in list(self._lines.items()):
            if not line.free:
                self._lines[line] = False
                continue
            if not follows:
                whole = whole or self._frames.whole(note)
            line.send(text if follows else whole)
            self._lines[line] = True

    def _note(self) -> str:
        if self.share == 1:
            return ""
        rate = 1000 / (FRAME_MS * self.share)
        return f"{len(self._lines)} browsers look: {rate:.0f} frames/s for each"


def refuse_foreigners(handler: RequestHandler, names: frozenset[str]) -> None:
    """Refuse a request for another name, or of a page of another origin.

    A page elsewhere may have its own name lead to this machine, and may open a line to any address.
    """
    origin = handler.request.headers.get("Origin")
    if handler.request.host not in names:
        handler.send_error(403, reason="this page has another name")
    elif origin is not None and origin not in {f"http://{name}" for name in names}:
        handler.send_error(403, reason="a page of another site may not look")


class Line(WebSocketHandler):
    """The line to one browser: it may move the playback of a recording, and nothing else.

    `row` is the estimator that it looks at, None for the one that is selected.
    """

    def initialize(self, audience: Audience, names: frozenset[str]) -> None:
        """`names` are those under which a page of this server may be open."""
        self._audience, self._names = audience, names
        self._under_way: asyncio.Future[None] | None = None
        self.row: int | None = None

    def prepare(self) -> None:
        """Give nothing to a request for another name, or of another page."""
        refuse_foreigners(self, self._names)

    def open(self, *_: str) -> None:
        """Begin to look."""
        self.set_nodelay(True)
        self._audience.join(self)

    def on_close(self) -> None:
        """Look no more."""
        self._audience.leave(self)

    def on_message(self, message: str | bytes) -> None:
        """Take the choice of an estimator and requests to a playback; ignore the rest."""
        try:
            asked = json.loads(message)
        except (ValueError, RecursionError):
            return
        if not isinstance(asked, dict):
            return
        if "estimator" in asked:
            row = asked["estimator"]
            self.row = row if isinstance(row, int) and not isinstance(row, bool) else None
        else:
            self._audience.wish(asked)

    @property
    def free(self) -> bool:
        """True once the browser has received the last frame."""
        return self._under_way is None or self._under_way.done()

    def drop(self) -> None:
        """End the line at once: a closing message might never be read."""
        if self.ws_connection is not None and self.ws_connection.stream is not None:
            self.ws_connection.stream.close()

    def send(self, text: str) -> None:
        """Send a frame, without waiting for it."""
        with contextlib.suppress(WebSocketClosedError):
            self._under_way = asyncio.ensure_future(_delivered(self.write_message(text)))


async def _delivered(sent: Awaitable[None]) -> None:
    with contextlib.suppress(WebSocketClosedError):
        await sent


class PageHandler(RequestHandler):
    """The page, on a light or a dark ground."""

    def initialize(self, window_s: float, names: frozenset[str]) -> None:
        """`window_s` is how much of the past the page shows."""
        self._window_s, self._names = window_s, names

    def prepare(self) -> None:
        """Give nothing to a request for another name, or of another page."""
        refuse_foreigners(self, self._names)

    def get(self) -> None:
        """Give the page; any address of another kind is none of ours."""
        palette = DARK if self.get_query_argument("theme", "light") == "dark" else LIGHT
        self.set_header("Cache-Control", "no-store")
        self.finish(page(palette, self._window_s))


def serve(feed: Feed, host: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve until interrupted; `ready` gets the address. Raises RecordingError for a port in use.

    Every browser on this machine may look; from elsewhere only with `host`, which is then the
    address that they must use. A browser may move the playback of a recording, nothing else.
    """
    audience = Audience(Frames(feed))
    port = free_port(host, port)
    names = frozenset(f"{name}:{port}" for name in (host, "localhost", "127.0.0.1"))
    keep_quiet()

    def tick() -> None:
        if feed.again():
            audience.restart()
        feed.poll()
        audience.tick()

    def fulfil() -> None:
        wishes = audience.take_wishes()
        if wishes and feed.ask(wishes):
            audience.restart()

    server = BoundedServer(_application(audience, feed.window_s, names))
    loop = IOLoop.current()
    PeriodicCallback(tick, FRAME_MS).start()
    PeriodicCallback(feed.judge, _JUDGE_MS).start()
    PeriodicCallback(fulfil, _WISH_MS).start()
    os.nice(10)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
    server.listen(port, host)
    ready(f"http://{host}:{port}/")
    loop.start()
    server.stop()


def _application(audience: Audience, window_s: float, names: frozenset[str]) -> Application:
    """Return the page and its line of frames, both only under these names."""
    return Application(
        [
            ("/", PageHandler, {"window_s": window_s, "names": names}),
            ("/frames", Line, {"audience": audience, "names": names}),
            scripts(),
        ],
        websocket_max_message_size=LONGEST_MESSAGE,
    )


def free_port(host: str, port: int) -> int:
    """Return `port`, or one that is free for 0. Raises RecordingError where it cannot be had."""
    try:
        with socket.create_server((host, port)) as probe:
            free: int = probe.getsockname()[1]
            return free
    except OSError as error:
        if error.errno in {errno.EADDRINUSE, errno.EACCES}:
            reason = os.strerror(error.errno)
            message = f"--port {port}: {reason}: choose another, or 0 for any"
        else:
            message = f"--host {host}: is no address of this machine: choose another, or 127.0.0.1"
        raise RecordingError(message) from None
