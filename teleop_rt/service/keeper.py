"""Keep a process beside the loop going: where it ends unasked, it is started again.

    python -m teleop_rt.service.keeper NAME RING_FOLDER MODULE ARGUMENTS...

The loop's process could not do this without stopping for it, so each helper has a keeper. It loads
the module once and forks a helper that runs the module's `main(ARGUMENTS)`: the next one is there
within milliseconds, also on a busy machine. The keeper passes its helper's output on, and leaves
in the ring folder how often that one had to be started again.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import selectors
import signal
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from teleop_rt.errors import ExpectedError
from teleop_rt.realtime.leftovers import began
from teleop_rt.realtime.parent import emit_to_parent, end_with_parent
from teleop_rt.realtime.state_file import found, leave

SUFFIX = ".keeper"
PAUSES_S = (0.0, 0.1, 0.2, 0.5, 1.0)
"""Waited before the first, second, ... start again; never as long as the rings hold rows (2 s)."""
CALM_S = 60.0
"""A helper that has run for so long is as good as new: its pauses begin again."""
_SIGNALS = (signal.SIGTERM, signal.SIGINT)
_PR_SET_NAME = 15  # of linux/prctl.h

Main = Callable[[Sequence[str]], None]


class Restarts:
    """Count of a helper's unexpected ends, and the pause before each restart."""

    def __init__(self, name: str, ring_folder: Path) -> None:
        self._name = name
        self._path = ring_folder / f"{name}{SUFFIX}"
        self._in_a_row = 0
        self._last_end: str | None = None
        self._helper: dict[str, int | None] | None = None
        self.count = 0
        self._leave()

    def runs(self, helper: int) -> None:
        """Publish the process of the helper that runs from now on."""
        self._helper = _identity(helper)
        self._leave()

    def next_pause_s(self, code: int, ran_s: float) -> float:
        """Count an end with this exit code after so long, report it, and return the pause [s]."""
        self._in_a_row = 0 if ran_s >= CALM_S else self._in_a_row
        pause_s = PAUSES_S[min(self._in_a_row, len(PAUSES_S) - 1)]
        self._in_a_row += 1
        self.count += 1
        self._last_end = end_in_words(code)
        state = self._leave()
        event = {"event": "restart", "stamp_ns": time.monotonic_ns(), **state, "pause_s": pause_s}
        print(json.dumps(event), file=sys.stderr, flush=True)
        return pause_s

    def _leave(self) -> dict[str, Any]:
        """Publish the helper's restarts, its process and its keeper for `status`."""
        state = {"name": self._name, "restarts": self.count, "last_end": self._last_end}
        processes = {"keeper": _identity(os.getpid()), "helper": self._helper}
        leave(self._path, state | processes)
        return state


def kept(ring_folder: Path, name: str) -> dict[str, Any]:
    """Return the number of a helper's restarts, and how it last ended."""
    state = found(ring_folder / f"{name}{SUFFIX}") or {}
    return {"restarts": state.get("restarts", 0), "last_end": state.get("last_end")}


def watched(ring_folder: Path, name: str) -> bool:
    """Return whether a helper's keeper runs; true if there is none yet."""
    state = found(ring_folder / f"{name}{SUFFIX}")
    return state is None or _same(state["keeper"])


def goes_on(ring_folder: Path, name: str) -> bool:
    """Return whether a helper runs: also without its keeper, until it notices the loss."""
    helper = (found(ring_folder / f"{name}{SUFFIX}") or {}).get("helper")
    return helper is not None and helper["began"] is not None and _same(helper)


def _same(process: Mapping[str, Any]) -> bool:
    return bool(process == _identity(process["pid"]))


def _identity(process: int) -> dict[str, int | None]:
    """Return a process's identity: its number and its beginning, None once it has ended."""
    return {"pid": process, "began": began(process)}


def name_of(helper: str) -> str:
    """Return the name by which `ps` shows the keeper of a helper."""
    return f"{helper}-keeper"


def end_in_words(code: int) -> str:
    """Return how a process ended, by its exit code."""
    return f"killed by signal {-code}" if code < 0 else f"ended with exit code {code}"


class Stop:
    """SIGTERM or SIGINT, as something that can be waited for beside a helper's output."""

    def __init__(self) -> None:
        self._reading, writing = os.pipe()
        os.set_blocking(writing, False)
        self.requested = False
        signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
        for number in _SIGNALS:
            signal.signal(number, self._request)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._reading, selectors.EVENT_READ)

    def wait(self, timeout_s: float | None, output: int | None = None) -> bool:
        """Wait for a signal or for output on this descriptor; true where output has come."""
        if output is not None:
            self._selector.register(output, selectors.EVENT_READ)
        try:
            ready = {key.fd for key, _ in self._selector.select(timeout_s)}
        finally:
            if output is not None:
                self._selector.unregister(output)
        if self._reading in ready:
            os.read(self._reading, 64)
        return output in ready

    def _request(self, *_: object) -> None:
        self.requested = True


class Keeper:
    """Runs a helper until a stop request; the helper's events go to standard output."""

    def __init__(self, name: str, ring_folder: Path, main: Main, arguments: Sequence[str]) -> None:
        self._name = name
        self._main = main
        self._arguments = arguments
        self._restarts = Restarts(name, ring_folder)
        self._stop = Stop()
        self._relied_on = False

    def keep(self) -> int:
        """Return the exit code of the helper's last run, after a stop request.

        A helper that was never ready is not restarted: its problem needs a person. A helper that is
        down when the stop request comes is started once more, to finish its work.
        """
        while True:
            began_s = time.monotonic()
            code = self._run()
            if self._stop.requested or not self._relied_on:
                return code
            pause_s = self._restarts.next_pause_s(code, time.monotonic() - began_s)
            resume_s = time.monotonic() + pause_s
            while (left_s := resume_s - time.monotonic()) > 0 and not self._stop.requested:
                self._stop.wait(left_s)

    def _run(self) -> int:
        """Run a helper to its end; the end is requested once, and not before it can obey."""
        reading, writing = os.pipe()
        helper = self._fork(writing)
        os.close(writing)
        ready = asked = False
        unfinished = b""
        while True:
            if self._stop.requested and not asked and (ready or not self._relied_on):
                os.kill(helper, signal.SIGTERM)
                asked = True
            if not self._stop.wait(None, reading):
                continue
            data = os.read(reading, 1 << 16)
            if not data:
                break
            *lines, unfinished = (unfinished + data).split(b"\n")
            for line in lines:
                ready = self._pass_on(json.loads(line)) or ready
        os.close(reading)
        return os.waitstatus_to_exitcode(os.waitpid(helper, 0)[1])

    def _fork(self, output: int) -> int:
        """Start a helper that writes to `output`; a signal that comes meanwhile reaches it."""
        signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        helper = os.fork()
        if helper == 0:
            os.dup2(output, sys.stdout.fileno())
            self._become_helper()
        self._restarts.runs(helper)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        return helper

    def _become_helper(self) -> NoReturn:
        signal.set_wakeup_fd(-1)
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        call_process(self._name)
        code = 1
        try:
            self._main(self._arguments)
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except ExpectedError as error:
            print(error, file=sys.stderr)
            code = error.code
        except BaseException:  # noqa: BLE001 - whatever it was, the fork must end here
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)

    def _pass_on(self, event: dict[str, Any]) -> bool:
        """Pass on a first event of its kind; true if the helper reports that it is ready."""
        name = event.pop("event")
        if name == "ready":
            if not self._relied_on:
                emit_to_parent(name, **event)
            self._relied_on = True
        elif name == "done" and self._stop.requested:
            emit_to_parent(name, **event, restarts=self._restarts.count)
        elif name == "problem" and not self._relied_on:
            emit_to_parent(name, **event)
        return bool(name == "ready")


def call_process(name: str) -> None:
    """Give this process the name by which `ps` and `top` show it; the kernel keeps 15 letters."""
    ctypes.CDLL(None).prctl(_PR_SET_NAME, name.encode(), 0, 0, 0)


def keep(name: str, ring_folder: Path, main: Main, arguments: Sequence[str]) -> int:
    """Be a helper's keeper in this process until a stop request; return the exit code."""
    end_with_parent()
    call_process(name_of(name))
    code = Keeper(name, ring_folder, main, arguments).keep()
    return code if code >= 0 else 1


def main() -> int:
    """Keep the helper that the command line names; return its exit code."""
    name, ring_folder, module, *arguments = sys.argv[1:]
    return keep(name, Path(ring_folder), importlib.import_module(module).main, arguments)


if __name__ == "__main__":
    sys.exit(main())
