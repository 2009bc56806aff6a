"""Talk to a running daemon over its control socket."""

from __future__ import annotations

import json
import time
from typing import Any

from teleop_rt.errors import ExpectedError
from teleop_rt.realtime.leftovers import alive
from teleop_rt.realtime.rig_locks import name_of
from teleop_rt.service.local_socket import connect
from teleop_rt.service.place import DaemonFiles, places

PATIENCE_S = 10.0
"""Time for which a running daemon is asked again: between two configs it takes no commands."""
_PAUSE_S = 0.05
"""Between two questions whether a daemon is there, or has ended."""
_TIMEOUT_S = {"reload": 75.0, "stop": 2.0}
"""More than a check of a config may take; a stop that is late is asked for again."""
_USUAL_TIMEOUT_S = 12.0
"""All else is answered within 10 s."""
_HARMLESS = ("status", "stop")


class DaemonError(ExpectedError):
    """There is no daemon to talk to, or more than one; the message gives the next step."""


class _NotNowError(DaemonError):
    """The daemon lives, and nothing came of asking it: it may be asked again."""


def request(command: str, rig: str | None, pid: int | None = None) -> dict[str, Any]:
    """Return the answer to a command of the daemon of a rig or process, or of the only one.

    One that is just beginning with a config, as after a reload, is waited for, for a while. Raises
    DaemonError.
    """
    last_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            answer = ask(find(rig, pid), command)
            if not answer.get("again") or time.monotonic() > last_s:
                return answer
        except _NotNowError:
            if time.monotonic() > last_s:
                raise
        time.sleep(_PAUSE_S)


def request_reload(rig: str | None, pid: int | None = None) -> dict[str, Any]:
    """Let a daemon reload its config, and return its status once it runs with it.

    Or with the one before, where the devices refused the new one; or as it was where it takes
    longer than one waits. Raises DaemonError.
    """
    answer = request("reload", rig, pid)
    last_s = time.monotonic() + PATIENCE_S
    while answer["ok"] and time.monotonic() < last_s:
        now = request("status", rig, pid)
        if now["ok"] and now["status"]["folder"] != answer["status"]["folder"]:
            return now
        time.sleep(_PAUSE_S)
    return answer


def find(rig: str | None = None, pid: int | None = None) -> DaemonFiles:
    """Return the place of the daemon of a rig or process, or of the only one.

    Raises DaemonError.
    """
    found = [place for place in places() if place.process and alive(place.process)]
    if rig is not None:
        found = [place for place in found if place.name == name_of(rig)]
    if pid is not None:
        found = [place for place in found if place.process == pid]
    if not found:
        which = f" of the rig {rig!r}" if rig else ""
        which += f" of process {pid}" if pid else ""
        raise DaemonError(
            f"no daemon{which} is running here, or you may not command it: start one with "
            "`teleop-rt slave TRIAL --key KEY` (it needs some seconds before it is found here), or"
            " join its group"
        )
    found = [place for place in found if place.takes_commands] or found
    found = [place for place in found if place.socket.exists()] or found
    if len(found) > 1:
        names = ", ".join(place.name for place in found)
        raise DaemonError(f"several daemons are running: choose one with --rig, one of: {names}")
    return found[0]


def ask(place: DaemonFiles, command: str) -> dict[str, Any]:
    """Return the daemon's answer to a command. Raises DaemonError where there is none."""
    if not place.takes_commands:
        raise DaemonError(_a_run(place))
    try:
        connection = connect(place.socket, _TIMEOUT_S.get(command, _USUAL_TIMEOUT_S))
    except PermissionError:
        raise DaemonError(
            f"{place.socket}: you may not command this daemon: join its group"
        ) from None
    except OSError:
        raise _NotNowError(_deaf(place)) from None
    try:
        with connection, connection.makefile("rb") as stream:
            connection.sendall(json.dumps({"command": command}).encode() + b"\n")
            answer: dict[str, Any] = json.loads(stream.readline())
    except (OSError, ValueError) as error:
        # Whether a command was carried out nobody knows; these do no harm twice.
        kind = _NotNowError if command in _HARMLESS else DaemonError
        raise kind(
            f"{place.socket}: the daemon does not answer: {error}; `kill {place.process}`"
            " (`systemctl stop`) stops the axis and ends it"
        ) from None
    return answer


def _a_run(place: DaemonFiles) -> str:
    return (
        f"process {place.process} runs a trial on the rig {place.name!r} and takes no commands: "
        f"`teleop-rt live` shows it, Ctrl-C there or `kill {place.process}` ends it in good order"
    )


def _deaf(place: DaemonFiles) -> str:
    process = place.process
    return (
        f"process {process} runs the rig {place.name!r} but takes no commands: it is just starting "
        "or ending, or its command server and that one's keeper were killed; "
        f"`kill {process}` (`systemctl stop`) stops the axis, then start it again"
    )
