"""The program: `teleop-rt`, or `python -m teleop_rt`."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
from contextlib import suppress
from typing import NoReturn

from teleop_rt.errors import FAULT
from teleop_rt.interrupts import INTERRUPTED, INTERRUPTS, interrupt, interrupted

_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
_STREAMS = {"stdin": (0, "r"), "stdout": (1, "w"), "stderr": (2, "w")}
_COLLECT_AFTER = 500_000
"""Objects made since the last collection: loading a command makes fewer. Python's 700 would look
through all modules many times while they are loaded, a fifth of the time to start."""


def main() -> None:
    """Run the command line; an interrupt ends it quietly, and changes no exit code any more then.

    SIGTERM and SIGHUP are taken as Ctrl-C is, where a command does not do so itself.
    Linear algebra here is many small problems: more than one thread only makes them wait for each
    other, half as fast again and in the way of everything else on the machine.
    """
    _open_closed_streams()
    for variable in _ONE_THREAD:
        os.environ.setdefault(variable, "1")
    gc.set_threshold(_COLLECT_AFTER)
    for number in INTERRUPTS:
        signal.signal(number, interrupt)
    try:
        from teleop_rt.cli import main as command_line  # noqa: PLC0415 - as above

        command_line()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    finally:
        for number in INTERRUPTS:
            signal.signal(number, signal.SIG_IGN)


def _open_closed_streams() -> None:
    """Let standard streams that are closed lead nowhere.

    Their numbers would be given to a socket or a log, into which any library's messages then go.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= _STREAMS["stderr"][0]:
        pass
    os.close(number)
    for name, (number, mode) in _STREAMS.items():
        if getattr(sys, name) is None:
            stream = open(number, mode, encoding="utf-8", closefd=False)  # noqa: SIM115 - to the end
            setattr(sys, name, stream)


def program() -> None:
    """Run the command line; after an interrupt leave without taking the compiler down.

    Python's last collections are to find nothing: they would look through all modules, which took
    a third of the time of a short command.
    An interrupt between two calls of the compiler can leave it with objects that it would release
    twice at the end of the process, which is then killed by a segmentation fault.
    """
    try:
        main()
    except SystemExit as leaving:
        if interrupted():
            _leave(leaving.code)
        raise
    finally:
        gc.freeze()
    if interrupted():
        _leave(None)


def _leave(code: str | int | None) -> NoReturn:
    atexit._run_exitfuncs()  # noqa: SLF001 - Python would call it, too, before it takes all down
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # nobody reads it any more
            stream.flush()
    os._exit(code if isinstance(code, int) else FAULT if code else 0)


if __name__ == "__main__":
    program()
