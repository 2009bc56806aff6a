"""The command server: a process beside the loop that answers on the control socket.

A request is one line of JSON, `{"command": "arm"}`, and so is the answer. Commands reach the loop
through the mailbox, status comes from rings and files in shared memory: the loop knows nothing of
sockets and waits for nobody.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

from teleop_rt.realtime.parent import end_with_parent
from teleop_rt.realtime.ring import RingReader
from teleop_rt.service.config_check import ConfigCheck
from teleop_rt.service.connections import POLL_S, Answer, Answering, Connections
from teleop_rt.service.local_socket import bind
from teleop_rt.service.mailbox import Command, CommandBox, Reply
from teleop_rt.service.status import DESCRIPTION, PROBLEM, SLAVE_RING, read_status

_ANSWER_TIMEOUT_S = 10.0
"""Longest wait for the loop to execute a command."""
_NO_ANSWER = "the loop does not answer: it hangs, or is being stopped"
_COMMANDS = {command.name.lower(): command for command in Command if command is not Command.NONE}
_SENTENCES = {
    Reply.NOT_DISARMED: "the axis is armed already",
    Reply.NO_SAMPLE: "no valid sample of position and force has come yet: check the devices",
    Reply.FAULT_LATCHED: "a fault is latched: remove its cause, then `teleop-rt reset`",
    Reply.NOT_ARMED: "the axis is not armed: `teleop-rt arm` first",
    Reply.NO_FAULT: "there is no fault to reset",
    Reply.TOO_LATE: "the loop was busy for too long: ask again, if it still is to be done",
    Reply.STOPPED: "a stop came meanwhile: nothing was done",
    Reply.POWERED: "the axis is armed: `teleop-rt stop` first",
}

AGAIN: Answer = {"again": True}
"""Part of an answer that refuses only for now."""


def _asked(request: bytes) -> object:
    """Return the command of a request; one that names a key twice could mean either.

    Raises ValueError, TypeError, KeyError or RecursionError for one without a command.
    """
    content = json.loads(request.decode("utf-8"), object_pairs_hook=_distinct)
    return content["command"]


def _distinct(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Return an object of JSON. Raises ValueError where a key is there twice."""
    content = dict(pairs)
    if len(content) < len(pairs):
        raise ValueError("a key is there twice")
    return content


class CommandServer:
    """Answers requests to one loop. It runs no check itself, and a stop waits for nothing."""

    def __init__(self, ring_folder: Path) -> None:
        self._ring_folder = ring_folder
        self._occupied = False
        self._stops = 0

    def answer(self, request: bytes) -> Answer:
        """Return the answer to one request, however long it takes."""
        answering = self.handle(request)
        while True:
            try:
                next(answering)
            except StopIteration as done:
                answer: Answer = done.value
                return answer
            time.sleep(POLL_S)

    def handle(self, request: bytes) -> Answering:
        """Answer one request in steps; a bad one gets a sentence, not an exception.

        Steps without waiting are done before the first pause: a stop reaches the loop at once.
        """
        try:
            name = _asked(request)
        except (ValueError, TypeError, KeyError, RecursionError):
            return _refused('a request is one line of JSON such as {"command": "status"}')
        command = _COMMANDS.get(name) if isinstance(name, str) else None
        if command is None and name != "status":
            known = ", ".join(("status", *_COMMANDS))
            return _refused(f"unknown command {name!r}; one of: {known}")
        try:
            if command is None:
                yield
                return self._status()
            box = CommandBox(self._ring_folder)
            if command is Command.STOP:
                return (yield from self._stop(box))
            description = json.loads((self._ring_folder / DESCRIPTION).read_text(encoding="utf-8"))
        except FileNotFoundError:  # nothing was done yet, so that it may be asked again
            return _refused("the daemon is starting, or is being stopped: ask again") | AGAIN
        return (yield from self._in_turn(command, box, description))

    def _status(self) -> Answer:
        return {"ok": True, "status": read_status(self._ring_folder)}

    def _stop(self, box: CommandBox) -> Answering:
        """Stop at once, also while another command is under way, which is then dropped."""
        self._stops += 1
        number = box.ask_to_stop()
        deadline_s = time.monotonic() + _ANSWER_TIMEOUT_S
        while not box.has_stopped(number):
            if time.monotonic() > deadline_s:
                return _refused(_NO_ANSWER)
            yield
        yield from self._await_a_tick(deadline_s)
        return self._status()

    def _in_turn(
        self, command: Command, box: CommandBox, description: Mapping[str, Any]
    ) -> Answering:
        """Carry commands out one after another; a stop drops those that wait."""
        stops = self._stops
        while self._occupied:
            yield
        if stops != self._stops:
            return _refused(_SENTENCES[Reply.STOPPED])
        self._occupied = True
        try:
            if command is Command.RELOAD and (problem := (yield from self._check(description))):
                return _refused(f"the running config stays, the new one cannot be used:\n{problem}")
            if stops != self._stops:
                return _refused(_SENTENCES[Reply.STOPPED])
            return (yield from self._command(command, box))
        finally:
            self._occupied = False

    def _check(self, description: Mapping[str, Any]) -> Generator[None, None, str]:
        """Return the problems of the config file as it is now; empty for none."""
        check = ConfigCheck(description)
        try:
            while check.running:
                yield
            return check.problem()
        finally:
            check.end()

    def _command(self, command: Command, box: CommandBox) -> Answering:
        number = box.request(command)
        deadline_s = time.monotonic() + _ANSWER_TIMEOUT_S
        try:
            while (reply := box.reply(number)) is None:
                if time.monotonic() > deadline_s:
                    return _refused(_NO_ANSWER)
                box.keep_alive()
                yield
        finally:  # nothing is to move once nobody expects it
            if box.reply(number) is None:
                box.withdraw()
        if reply is Reply.DONE:
            if command is not Command.RELOAD:
                yield from self._await_a_tick(deadline_s)
            return self._status()
        sentence = _SENTENCES.get(reply) or self._problem()
        if reply is Reply.FAULT_LATCHED:
            fault = read_status(self._ring_folder)["fault"]
            sentence = f"{sentence} ({fault['name']}: {fault['cause']}; {fault['next_step']})"
        return _refused(sentence)

    def _await_a_tick(self, deadline_s: float) -> Generator[None, None, None]:
        """Wait for the row of a tick after the command: the last row may be older."""
        try:
            ring = RingReader(self._ring_folder / SLAVE_RING)
        except FileNotFoundError:
            return
        ring.skip()
        while not ring.waiting and time.monotonic() < deadline_s:
            yield

    def _problem(self) -> str:
        path = self._ring_folder / PROBLEM
        return path.read_text(encoding="utf-8") if path.exists() else "the devices refuse"


def _refused(problem: str) -> Answer:
    return {"ok": False, "problem": problem}


def serve(ring_folder: Path, place: Path) -> None:
    """Serve the socket `place` until the process that started this one ends."""
    stopping: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda other, _frame: stopping.append(other))
    end_with_parent()
    with bind(place) as listening:  # also after one that crashed: one daemon alone holds the rig
        connections = Connections(CommandServer(ring_folder).handle, listening)
        sys.stdout.write(json.dumps({"event": "ready"}) + "\n")
        sys.stdout.flush()
        while not stopping:
            connections.serve_once(0.5)


def main(arguments: Sequence[str]) -> None:
    """Serve the ring folder, the first argument, at the socket, the second, until SIGTERM."""
    ring_folder, place = map(Path, arguments)
    os.umask(0o007)
    serve(ring_folder, place)
