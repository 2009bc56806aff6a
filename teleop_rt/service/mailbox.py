"""Commands for the loop through shared memory: it looks at a few words a tick, and never waits.

A command server in another process writes a request; the loop obeys in its next tick and writes
its result. One request is under way at a time, and counts only while its server keeps it
alive: requests left by a killed server are not carried out. Stop has words of its own: it waits for
no other command, never expires, and requests before it are dropped.
"""

from __future__ import annotations

import mmap
import os
import time
from enum import IntEnum
from pathlib import Path

NAME = "commands.box"
ALIVE_NS = 500_000_000
"""A request counts for so long after its server last looked after it; it looks every 2 ms."""
_WORDS = 7  # of 8 bytes, by the names below
_REQUEST, _COMMAND, _ANSWERED, _REPLY, _ALIVE_UNTIL, _STOP, _STOPPED = range(_WORDS)


class Command(IntEnum):
    """Commands to the loop."""

    NONE = 0
    ARM = 1
    START = 2
    STOP = 3
    RESET = 4
    RELOAD = 5


class Reply(IntEnum):
    """Replies of the loop to a command."""

    DONE = 0
    NOT_DISARMED = 1
    NO_SAMPLE = 2
    FAULT_LATCHED = 3
    NOT_ARMED = 4
    NO_FAULT = 5
    POWERED = 6
    AXIS_REFUSED = 7
    TOO_LATE = 8
    STOPPED = 9


class CommandBox:
    """Both ends of the mailbox; the loop's end makes the file, the server's end only maps it."""

    def __init__(self, ring_folder: Path, *, create: bool = False) -> None:
        """Map the box in a ring folder. Raises FileNotFoundError where there is none."""
        self._path = ring_folder / NAME
        flags = os.O_RDWR | (os.O_CREAT | os.O_EXCL if create else 0)
        descriptor = os.open(self._path, flags, 0o600)
        try:
            if create:
                os.posix_fallocate(descriptor, 0, 8 * _WORDS)
            self._words = memoryview(mmap.mmap(descriptor, 8 * _WORDS)).cast("Q")
        finally:
            os.close(descriptor)
        self._seen = self._words[_REQUEST]

    def poll(self) -> Command:
        """Return a command that has come since the last call, or NONE (the loop's end)."""
        number = self._words[_REQUEST]
        if number == self._seen:
            return Command.NONE
        self._seen = number
        if time.monotonic_ns() > self._words[_ALIVE_UNTIL]:
            self.answer(Reply.TOO_LATE)
            return Command.NONE
        return Command(self._words[_COMMAND])

    def stop_asked(self) -> bool:
        """Return whether a stop is asked for and not carried out yet (the loop's end)."""
        return self._words[_STOP] != self._words[_STOPPED]

    def stopped(self) -> None:
        """Confirm that the axis was stopped, and drop earlier requests (the loop's end)."""
        asked = self._words[_STOP]
        if self._words[_REQUEST] != self._seen:
            self._seen = self._words[_REQUEST]
            self.answer(Reply.STOPPED)
        self._words[_STOPPED] = asked

    def answer(self, reply: Reply) -> None:
        """Answer the command that `poll` returned (the loop's end)."""
        self._words[_REPLY] = reply
        self._words[_ANSWERED] = self._seen

    def request(self, command: Command) -> int:
        """Give a command; returns its number (the server's end)."""
        number = self._words[_REQUEST] + 1
        self._words[_COMMAND] = command
        self.keep_alive()
        self._words[_REQUEST] = number
        return number

    def keep_alive(self) -> None:
        """Say that somebody still waits for the request's answer (the server's end)."""
        self._words[_ALIVE_UNTIL] = time.monotonic_ns() + ALIVE_NS

    def withdraw(self) -> None:
        """Take a command back that the loop has not seen (the server's end)."""
        self._words[_COMMAND] = Command.NONE
        self._words[_ALIVE_UNTIL] = 0

    def reply(self, number: int) -> Reply | None:
        """Return the result of a request, None while it is under way (the server's end)."""
        return Reply(self._words[_REPLY]) if self._words[_ANSWERED] == number else None

    def ask_to_stop(self) -> int:
        """Ask for a stop; returns its number (the server's end)."""
        number = self._words[_STOP] + 1
        self._words[_STOP] = number
        return number

    def has_stopped(self, number: int) -> bool:
        """Return whether a stop asked for was carried out (the server's end)."""
        return self._words[_STOPPED] >= number
