"""Talk to a running daemon over its control socket."""

from __future__ import annotations

import json
from typing import Any

from teleop_rt.errors import ExpectedError
from teleop_rt.realtime.leftovers import alive, owner
from teleop_rt.service.local_socket import connect
from teleop_rt.service.place import Place, name_of, places

_TIMEOUT_S = 30.0


class DaemonError(ExpectedError):
    """There is no daemon to talk to, or more than one: says which and what to do next."""


def running() -> list[Place]:
    """Return the places of the daemons that answer."""
    return [place for place in places() if _answers(place)]


def _answers(place: Place) -> bool:
    try:
        connect(place.socket, _TIMEOUT_S).close()
    except OSError:
        return False
    return True


def find(rig: str | None, pid: int | None = None) -> Place:
    """Return the place of the daemon of a rig or process, or of the only one.

    Raises DaemonError.
    """
    found = running()
    if rig is not None:
        found = [place for place in found if place.name == name_of(rig)]
    if pid is not None:
        found = [
            place for place in found if ask(place, "status").get("status", {}).get("pid") == pid
        ]
    if not found:
        _look_for_deaf()
        which = f" of the rig {rig!r}" if rig else ""
        which += f" of process {pid}" if pid else ""
        raise DaemonError(
            f"no daemon{which} is running here, or you may not talk to it: start one with "
            "`teleop-rt slave TRIAL --key KEY`, or join its group"
        )
    if len(found) > 1:
        names = ", ".join(place.name for place in found)
        raise DaemonError(f"several daemons are running: say which with --rig, one of: {names}")
    return found[0]


def _look_for_deaf() -> None:
    """Raise DaemonError where a daemon runs whose command server is gone for good."""
    for place in places():
        process = owner(place.session.readlink().name, "teleop-rt-")
        if process is not None and alive(process) and not _answers(place):
            raise DaemonError(
                f"process {process} runs the rig {place.name!r} but takes no commands: it is just "
                "starting or ending, or its command server and that one's keeper were killed; "
                f"`kill {process}` (`systemctl stop`) stops the axis, then start it again"
            )


def _pid(place: Place) -> int | None:
    pid: int | None = ask(place, "status").get("status", {}).get("pid")
    return pid


def ask(place: Place, command: str) -> dict[str, Any]:
    """Return the daemon's answer to a command. Raises DaemonError where it is gone."""
    try:
        with connect(place.socket, _TIMEOUT_S) as connection:
            connection.sendall(json.dumps({"command": command}).encode() + b"\n")
            with connection.makefile("rb") as stream:
                answer: dict[str, Any] = json.loads(stream.readline() or b"{}")
    except (OSError, ValueError) as error:
        raise DaemonError(f"{place.socket}: the daemon does not answer: {error}") from None
    return answer or {"ok": False, "problem": "the daemon closed the connection without an answer"}
