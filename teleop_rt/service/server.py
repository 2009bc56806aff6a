"""The command server: a process beside the loop that answers on the control socket.

A request is one line of JSON, `{"command": "arm"}`, and so is the answer. Commands reach the loop
through the mailbox, status comes from rings and files in shared memory: the loop knows nothing of
sockets and waits for nobody.
"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from teleop_rt.realtime.parent import end_with_parent
from teleop_rt.realtime.ring import RingReader
from teleop_rt.service.local_socket import bind
from teleop_rt.service.mailbox import Command, CommandBox, Verdict
from teleop_rt.service.status import DESCRIPTION, PROBLEM, SLAVE_RING, read_status

LONGEST_REQUEST = 4096
_ANSWER_TIMEOUT_S = 10.0
_POLL_S = 0.002
_CLIENT_TIMEOUT_S = 2.0
_COMMANDS = {command.name.lower(): command for command in Command if command is not Command.NONE}
_SENTENCES = {
    Verdict.NOT_DISARMED: "the axis is armed already",
    Verdict.NO_SAMPLE: "no valid sample of position and force has come yet: check the devices",
    Verdict.FAULT_LATCHED: "a fault is latched: remove its cause, then `teleop-rt reset`",
    Verdict.NOT_ARMED: "the axis is not armed: `teleop-rt arm` first",
    Verdict.NO_FAULT: "there is no fault to reset",
    Verdict.POWERED: "the axis is armed: `teleop-rt stop` first",
}

Answer = dict[str, Any]

AGAIN: Answer = {"again": True}
"""Part of an answer that refuses only for now."""


class CommandServer:
    """Answers requests about one session."""

    def __init__(self, session: Path) -> None:
        self._session = session

    def answer(self, request: bytes) -> Answer:
        """Return the answer to one request; a bad one gets a sentence, not an exception."""
        try:
            content = json.loads(request)
            name = content["command"]
        except (ValueError, TypeError, KeyError, RecursionError):
            return _refused('a request is one line of JSON such as {"command": "status"}')
        command = _COMMANDS.get(name) if isinstance(name, str) else None
        if command is None and name != "status":
            known = ", ".join(("status", *_COMMANDS))
            return _refused(f"unknown command {name!r}; one of: {known}")
        try:
            if command is None:
                return self._status()
            description = json.loads((self._session / DESCRIPTION).read_text(encoding="utf-8"))
            box = CommandBox(self._session)
        except FileNotFoundError:  # nothing was done yet, so that it may be asked again
            return _refused("the daemon is starting, or is being stopped: ask again") | AGAIN
        if command is Command.RELOAD and (problem := _config_problem(description)):
            return _refused(f"the running config stays, the new one cannot be used:\n{problem}")
        return self._command(command, box)

    def _status(self) -> Answer:
        return {"ok": True, "status": read_status(self._session)}

    def _command(self, command: Command, box: CommandBox) -> Answer:
        number = box.request(command)
        deadline = time.monotonic() + _ANSWER_TIMEOUT_S
        while (verdict := box.verdict(number)) is None:
            if time.monotonic() > deadline:
                if command is not Command.STOP:  # nothing is to move once nobody expects it
                    box.withdraw()
                return _refused("the loop does not answer: it hangs, or is being stopped")
            time.sleep(_POLL_S)
        if verdict is Verdict.DONE:
            if command is not Command.RELOAD:
                self._await_a_tick(deadline)
            return self._status()
        sentence = _SENTENCES.get(verdict) or self._problem()
        if verdict is Verdict.FAULT_LATCHED:
            fault = read_status(self._session)["fault"]
            sentence = f"{sentence} ({fault['name']}: {fault['cause']}; {fault['next_step']})"
        return _refused(sentence)

    def _await_a_tick(self, deadline: float) -> None:
        """Wait for the row of a tick after the command: the last one tells of before it."""
        try:
            ring = RingReader(self._session / SLAVE_RING)
        except FileNotFoundError:
            return
        ring.skip()
        while not ring.waiting and time.monotonic() < deadline:
            time.sleep(_POLL_S)

    def _problem(self) -> str:
        path = self._session / PROBLEM
        return path.read_text(encoding="utf-8") if path.exists() else "the devices refuse"


def _config_problem(description: Mapping[str, Any]) -> str:
    """Return what is wrong with the config file as it is now; empty where nothing is."""
    changes = [part for change in description["overrides"] for part in ("--set", change)]
    done = subprocess.run(  # noqa: S603 - our own interpreter and arguments
        [sys.executable, "-m", "teleop_rt", "check", description["trial_file"], *changes],
        capture_output=True,
        text=True,
        check=False,
    )
    return (done.stderr or done.stdout).strip() if done.returncode else ""


def _refused(problem: str) -> Answer:
    return {"ok": False, "problem": problem}


class _Connections:
    """The control socket and its clients, none of which can hold up another."""

    def __init__(self, server: CommandServer, listening: socket.socket) -> None:
        self._server = server
        self._selector = selectors.DefaultSelector()
        self._selector.register(listening, selectors.EVENT_READ, None)
        self._received: dict[socket.socket, bytes] = {}
        self._since: dict[socket.socket, float] = {}

    def serve_once(self, timeout_s: float) -> None:
        """Take in what comes, answer whole requests, and drop clients that stay silent."""
        for key, _ in self._selector.select(timeout_s):
            peer: Any = key.fileobj
            if key.data is None:
                client, _ = peer.accept()
                client.settimeout(_CLIENT_TIMEOUT_S)
                self._selector.register(client, selectors.EVENT_READ, "client")
                self._received[client], self._since[client] = b"", time.monotonic()
            else:
                self._take(peer)
        late = time.monotonic() - _CLIENT_TIMEOUT_S
        for client in [one for one, since in self._since.items() if since < late]:
            self._drop(client)

    def _take(self, client: socket.socket) -> None:
        try:
            data = client.recv(LONGEST_REQUEST)
        except OSError:
            data = b""
        request = self._received[client] = self._received[client] + data
        if b"\n" in request or (request and len(request) >= LONGEST_REQUEST):
            answer = self._server.answer(request.partition(b"\n")[0])
            with contextlib.suppress(OSError):
                client.sendall(json.dumps(answer).encode() + b"\n")
            self._drop(client)
        elif not data:
            self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        self._selector.unregister(client)
        del self._received[client], self._since[client]
        client.close()


def serve(session: Path, place: Path) -> None:
    """Serve the socket `place` until the process that started this one ends."""
    stopping: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda other, _frame: stopping.append(other))
    end_with_parent()
    with bind(place) as listening:  # also after one that crashed: one daemon alone holds the rig
        connections = _Connections(CommandServer(session), listening)
        sys.stdout.write(json.dumps({"event": "ready"}) + "\n")
        sys.stdout.flush()
        while not stopping:
            connections.serve_once(0.5)


def main(arguments: Sequence[str]) -> None:
    """Serve the session, the first argument, at the socket, the second, until SIGTERM."""
    session, place = map(Path, arguments)
    os.umask(0o007)
    serve(session, place)
