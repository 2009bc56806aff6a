"""Run a trial on the machine's clock: start its processes, watch them, end them in order."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from teleop_rt.errors import ExpectedError
from teleop_rt.interrupts import deferred_interrupts
from teleop_rt.realtime.scheduling import keep_off
from teleop_rt.service.keeper import end_in_words, keep
from teleop_rt.trial.forked import Forked

_READY_TIMEOUT_S = 300.0
"""Longest wait for a process to be ready: a first run compiles its kernels in it."""
END_TIMEOUT_S = 10.0
"""Longest wait for a process to end by itself."""
_POLL_S = 0.2
"""Time between two looks at the processes."""
_KEEPER = "teleop_rt.service.keeper"
_RECORDER = "teleop_rt.trial.recorder_main"
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""A thread pool beside a real-time loop steals its core."""


class ProcessFailedError(ExpectedError):
    """A process of the trial ended by itself; `code` is the exit code for the whole run."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


@dataclass
class Child:
    """One process of a trial, which reports its events as lines of JSON."""

    name: str
    process: subprocess.Popen[bytes] | Forked
    events: dict[str, dict[str, Any]] = field(default_factory=dict)
    ended: bool = False
    _unfinished: bytes = b""

    @property
    def output(self) -> IO[bytes]:
        """The pipe of its events."""
        assert self.process.stdout is not None  # noqa: S101 - opened as a pipe
        return self.process.stdout

    def take_events(self) -> None:
        """Take the events in the pipe; waits for one to come. Marks the end of the pipe."""
        data = os.read(self.output.fileno(), 1 << 16)
        self.ended = not data
        *lines, self._unfinished = (self._unfinished + data).split(b"\n")
        for line in lines:
            event = json.loads(line)
            self.events[event.pop("event")] = event


class TrialProcesses:
    """Starts the processes of a trial and ends all of them when one ends.

    `leader` names the process whose end in good order is the end of the trial. All others keep off
    the core `loop_cpu`, where the loop has one of its own.
    """

    def __init__(self, log: Path, leader: str | None = None, loop_cpu: int | None = None) -> None:
        self._leader = leader
        self._loop_cpu = loop_cpu
        self._selector = selectors.DefaultSelector()  # first: refused, it leaves no file open
        self._log = log.open("a", encoding="utf-8")
        self.children: list[Child] = []

    def start(self, name: str, main: Callable[[], None]) -> Child:
        """Run `main` in a fork of this process; `wait_ready` waits until it can be relied on.

        The fork imports nothing: four processes that each import compilers and drivers occupy the
        two cores of a small machine for seconds.
        """
        return self._start(name, lambda: Forked(name, main, self._log))

    def start_kept(
        self, name: str, ring_folder: Path, module: str, arguments: Sequence[str]
    ) -> Child:
        """Start a module's `main` under a keeper, which starts it again where it ends unasked.

        Both are small beside a daemon that goes on for months: a program of their own.
        """
        program = [_KEEPER, name, str(ring_folder), module, *arguments]
        return self._start(name, lambda: self._program(program))

    def fork_kept(
        self,
        name: str,
        ring_folder: Path,
        main: Callable[[Sequence[str]], None],
        arguments: list[str],
    ) -> Child:
        """Run `main` under a keeper as `start_kept` does, in forks of this process."""

        def kept() -> None:
            sys.exit(keep(name, ring_folder, main, arguments))

        return self.start(name, kept)

    def _program(self, program: Sequence[str]) -> subprocess.Popen[bytes]:
        return subprocess.Popen(  # noqa: S603 - our own interpreter and arguments
            [sys.executable, "-m", *program],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._log,
            bufsize=0,
            start_new_session=True,
            env=os.environ | _ONE_THREAD,
        )

    def _start(self, name: str, begin: Callable[[], subprocess.Popen[bytes] | Forked]) -> Child:
        with deferred_interrupts():  # or a process would run that nobody knows of
            process = begin()
            child = Child(name, process)
            self.children.append(child)
        if self._loop_cpu is not None and name != self._leader:
            keep_off(process.pid, self._loop_cpu)
        self._selector.register(child.output, selectors.EVENT_READ, child)
        return child

    def wait_ready(self, *children: Child) -> None:
        """Wait until each says that it is ready.

        Raises ProcessFailedError where one ends or stays silent instead.
        """
        deadline = time.monotonic() + _READY_TIMEOUT_S
        while waiting := [child.name for child in children if "ready" not in child.events]:
            self.watch(_POLL_S)
            if time.monotonic() > deadline:
                message = (
                    f"{waiting[0]} was not ready after {_READY_TIMEOUT_S:.0f} s: see"
                    f" {self._log.name}, and start again"
                )
                raise ProcessFailedError(message, 1)

    def watch(self, timeout_s: float) -> None:
        """Wait for events; raises ProcessFailedError when a process that should run has ended."""
        for key, _ in self._selector.select(max(0.0, timeout_s)):
            child: Child = key.data
            child.take_events()
            if child.ended:
                self._selector.unregister(child.output)
                self._judge_end(child)

    def _judge_end(self, child: Child) -> None:
        """Accept the end of the process that decides how long a trial lasts, and of no other."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.process.wait(END_TIMEOUT_S)
        code = child.process.poll()
        if child.name == self._leader and "done" in child.events and code == 0:
            return
        problem = child.events.get("problem", {})
        how = "does not end" if code is None else end_in_words(code)
        message = problem.get("message") or f"{how}; see {self._log.name}"
        raise ProcessFailedError(f"{child.name}: {message}", 2 if code == 2 else 1)

    def run_until(self, done: Callable[[], bool]) -> None:
        """Watch until `done()`; raises ProcessFailedError when a process ends before."""
        while not done():
            self.watch(_POLL_S)

    def end(self, names: Sequence[str]) -> None:
        """End the named processes in order, each before the next; kill one that does not end."""
        for name in names:
            for child in self.children:
                if child.name == name:
                    self._end(child)

    def close(self) -> None:
        """End whatever still runs."""
        for child in self.children:
            self._end(child)
        for child in self.children:
            child.output.close()
        self._selector.close()
        self._log.close()

    def _end(self, child: Child) -> None:
        if child.process.poll() is None:
            child.process.send_signal(signal.SIGTERM)
        try:
            child.process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            child.process.kill()
            child.process.wait()
        while not child.ended:
            child.take_events()
        with contextlib.suppress(KeyError):
            self._selector.unregister(child.output)


class Gate:
    """Lets one fork of this process wait for the others; made before it."""

    def __init__(self) -> None:
        self._reading, self._writing = os.pipe()

    def wait(self) -> None:
        """Wait, in the fork, until the gate opens; leave where it was closed instead."""
        os.close(self._writing)
        opened = os.read(self._reading, 1)
        os.close(self._reading)
        if not opened:
            sys.exit(1)

    def open(self) -> None:
        """Let the fork go on."""
        os.write(self._writing, b"1")

    def close(self) -> None:
        """Release the gate; a fork that still waits leaves."""
        os.close(self._writing)
        os.close(self._reading)


def start_recorder(processes: TrialProcesses, ring_folder: Path, folder: Path) -> Child:
    """Start the recorder of a ring folder, once that is described, into a run folder."""
    return processes.start_kept("recorder", ring_folder, _RECORDER, [str(ring_folder), str(folder)])
