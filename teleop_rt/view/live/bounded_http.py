"""An HTTP server that other users of this machine can neither occupy nor fill with data.

A request has a header and no body, and comes whole within seconds. Connections beyond a bound close
the oldest one that still asks; lines to browsers (WebSockets) are counted by whoever keeps them.
"""

from __future__ import annotations

import logging
from typing import Any

from bokeh.settings import settings
from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.web import Application, RequestHandler, StaticFileHandler

MOST_ASKING = 200
"""Connections that ask for something; with as many lines, below the usual 1024 descriptors."""
LONGEST_REQUEST = 16 << 10
"""Bytes of a request's header."""
WHOLE_WITHIN_S = 10.0
"""A request that has not come by then is dropped, and so is a connection that asks nothing more."""
LONGEST_MESSAGE = 1024
"""Bytes of a message from a browser; the requests of a page are shorter."""
SCRIPTS = r"/static/(js/bokeh[a-z-]*\.min\.js)"
"""Files of bokeh that the page names, and no other path."""


class BoundedServer(HTTPServer):
    """Closes the oldest connection that asks where there are too many."""

    def initialize(self, application: Application) -> None:  # type: ignore[override] # fewer options
        """Serve the application, with bounds on each request."""
        super().initialize(
            application,
            max_header_size=LONGEST_REQUEST,
            max_buffer_size=4 * LONGEST_REQUEST,
            max_body_size=0,
            idle_connection_timeout=WHOLE_WITHIN_S,
            body_timeout=WHOLE_WITHIN_S,
        )
        self._asking: list[IOStream] = []

    def handle_stream(self, stream: IOStream, address: Any) -> None:
        """Take another connection in."""
        if len(self._asking) >= MOST_ASKING:
            self._asking.pop(0).close()
        self._asking.append(stream)
        super().handle_stream(stream, address)

    def on_close(self, server_conn: Any) -> None:
        """Forget a connection that has closed, or has become a line."""
        super().on_close(server_conn)
        if server_conn.stream in self._asking:
            self._asking.remove(server_conn.stream)


def scripts() -> tuple[str, type[RequestHandler], dict[str, str]]:
    """Return the route to the scripts of the page."""
    return SCRIPTS, StaticFileHandler, {"path": str(settings.bokehjs_path())}


def keep_quiet() -> None:
    """Log no refused request: whoever sends them would fill the disk."""
    for name in ("tornado.access", "tornado.general"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
