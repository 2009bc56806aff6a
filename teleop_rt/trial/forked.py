"""A process forked from this one: this one's modules are loaded in it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from typing import IO, BinaryIO

from teleop_rt.errors import ExpectedError
from teleop_rt.service.keeper import call_process

_FORK = multiprocessing.get_context("fork")
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Forked:
    """Runs a function in a fork of this process, with the methods of `subprocess.Popen`.

    Its standard output is a pipe, `stdout`; its errors go to a file. Must be made while this
    process has one thread: of others a fork keeps the locks.
    """

    def __init__(self, name: str, main: Callable[[], None], errors: IO[str]) -> None:
        reading, writing = os.pipe()
        self._process = _FORK.Process(
            target=_become, args=(name, main, reading, writing, errors.fileno()), name=name
        )
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)  # until it can obey them
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(writing)
        self.stdout: BinaryIO = os.fdopen(reading, "rb", buffering=0)

    @property
    def pid(self) -> int:
        """The process id."""
        assert self._process.pid is not None  # noqa: S101 - it was started
        return self._process.pid

    def poll(self) -> int | None:
        """Return the exit code, minus the signal that killed it; None while it runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; return the exit code. Raises subprocess.TimeoutExpired."""
        self._process.join(timeout)
        if (code := self._process.exitcode) is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it whatever it does."""
        self.send_signal(signal.SIGKILL)


def _become(name: str, main: Callable[[], None], reading: int, writing: int, errors: int) -> None:
    """Be a process of its own: nothing of the terminal, the signals and the output stays shared."""
    os.setsid()
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    call_process(name)
    os.close(reading)
    os.dup2(writing, 1)
    os.dup2(errors, 2)
    os.close(writing)
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - open to the end
    sys.stderr = open(2, "w", encoding="utf-8", buffering=1, closefd=False)  # noqa: SIM115
    try:
        main()
    except ExpectedError as error:
        print(error, file=sys.stderr)
        sys.exit(error.code)
