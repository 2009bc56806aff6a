"""The server of the live page: its own process, loopback only unless told, read-only."""

from __future__ import annotations

import errno
import os
import signal
import socket
from collections.abc import Callable

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import Server
from bokeh.settings import settings
from jinja2 import Environment, PackageLoader, Template
from tornado.ioloop import PeriodicCallback

from teleop_rt.errors import RecordingError
from teleop_rt.view.live.feed import Feed
from teleop_rt.view.live.page import Page
from teleop_rt.view.style import DARK, LIGHT, Palette

FRAME_MS = 40
_JUDGE_MS = 200
_BROWSER_S = 0.008
"""Pace for many browsers: this much time per browser and frame, so that all get their share."""
_FORGET_MS = 60_000
"""A page that nobody looks at is kept so long: fifty browsers at once need a while to connect."""


def serve(feed: Feed, host: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve until interrupted; `ready` gets the address. Raises RecordingError for a port in use.

    Every browser on this machine may look; from elsewhere only with `host`, which is then the
    address that they must use. Nothing that a browser sends reaches anything but its own page.
    """
    settings.resources = "server"
    template = _template()

    def pace_s() -> float:
        browsers = sum(session.connection_count for session in server.get_sessions("/"))
        return max(0.75e-3 * FRAME_MS, _BROWSER_S * browsers)

    def open_page(document: Document) -> None:
        palette = _palette(document)
        page = Page(document, feed, palette, pace_s)
        document.template = template
        document.template_variables["palette"] = palette
        document.title = "teleop-rt live"
        document.add_periodic_callback(page.update, FRAME_MS)

    server = _server(Application(FunctionHandler(open_page)), host, port)
    PeriodicCallback(feed.poll, FRAME_MS).start()
    PeriodicCallback(feed.judge, _JUDGE_MS).start()
    os.nice(10)
    loop = server.io_loop
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
    server.start()
    ready(f"http://{host}:{server.port}/")
    loop.start()
    server.stop()


def _server(application: Application, host: str, port: int) -> Server:
    free = free_port(host, port)
    return Server(
        {"/": application},
        address=host,
        port=free,
        allow_websocket_origin=[f"{name}:{free}" for name in {host, "localhost", "127.0.0.1"}],
        unused_session_lifetime_milliseconds=_FORGET_MS,
        check_unused_sessions_milliseconds=_FORGET_MS // 6,
        session_token_expiration=3600,
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
            message = f"--host {host}: is no address of this machine"
        raise RecordingError(message) from None


def _palette(document: Document) -> Palette:
    request = getattr(document.session_context, "request", None)
    arguments = {} if request is None else request.arguments
    return DARK if arguments.get("theme", [b""])[0] == b"dark" else LIGHT


def _template() -> Template:
    pages = Environment(loader=PackageLoader("teleop_rt.view", "pages"), autoescape=False)  # noqa: S701 - bokeh's own template escapes
    return pages.get_template("live.html.j2")
