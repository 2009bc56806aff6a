"""The program: `teleop-rt`, or `python -m teleop_rt`."""

from __future__ import annotations

import gc
import os
import signal
import sys
from types import FrameType

FAULT = 1
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
_COLLECT_AFTER = 50_000
"""Objects made since the last collection. Python's 700 would look through all modules many times
while they are loaded, a tenth of the time to start."""


_INTERRUPTS = (signal.SIGTERM, signal.SIGHUP)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line; an interrupt ends it quietly, and changes no exit code any more then.

    SIGTERM and SIGHUP are taken as Ctrl-C is, where a command does not do so itself.
    Linear algebra here is many small problems: more than one thread only makes them wait for each
    other, half as fast again and in the way of everything else on the machine.
    """
    for variable in _ONE_THREAD:
        os.environ.setdefault(variable, "1")
    gc.set_threshold(_COLLECT_AFTER)
    for number in _INTERRUPTS:
        signal.signal(number, _interrupt)
    try:
        from teleop_rt.cli import main as command_line  # noqa: PLC0415 - as above

        command_line()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(FAULT)
    finally:
        for number in (signal.SIGINT, *_INTERRUPTS):
            signal.signal(number, signal.SIG_IGN)


if __name__ == "__main__":
    main()
