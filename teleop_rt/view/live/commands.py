"""The command `live`: find a run's rings or read a recording, and serve its page."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from teleop_rt.errors import RecordingError
from teleop_rt.view.live.feed import Feed
from teleop_rt.view.live.server import free_port, serve
from teleop_rt.view.live.source import announce, open_source

_HOST = "127.0.0.1"
_WINDOW_S = 10.0
"""Time shown."""


def live(recording: Path | None, beside: int | None, host: str, port: int) -> None:
    """Serve the live page until interrupted; `beside` shows the run of that process alone.

    Without a recording it shows the run on this machine. Raises RecordingError where nothing
    runs, the file cannot be played back, or the port is in use.
    """
    source = open_source(recording, beside)
    serve(Feed(source, _WINDOW_S), host, port, lambda address: announce(source.name, address))


@contextmanager
def live_beside(port: int) -> Iterator[None]:
    """Serve the live page of this process's run from a process of its own, as long as it runs.

    Raises RecordingError where it cannot begin, for example for a port in use.
    """
    port = free_port(_HOST, port)
    command = [sys.executable, "-m", "teleop_rt", "live", "--beside", str(os.getpid())]
    with subprocess.Popen(  # noqa: S603 - our own interpreter and arguments
        [*command, "--port", str(port)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as page:
        try:
            assert page.stdout is not None  # noqa: S101 - opened as a pipe
            line = page.stdout.readline()
            if not line:
                raise RecordingError(
                    "the live page did not start: its own message is above; run without --live"
                )
            print(line, end="", file=sys.stderr)
            yield
        finally:
            page.terminate()
