"""The program: `teleop-rt`, or `python -m teleop_rt`."""

from __future__ import annotations

import os
import sys

FAULT = 1
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


def main() -> None:
    """Run the command line; an interrupt while a command is still being loaded ends it quietly.

    Linear algebra here is many small problems: more than one thread only makes them wait for each
    other, half as fast again and in the way of everything else on the machine.
    """
    for variable in _ONE_THREAD:
        os.environ.setdefault(variable, "1")
    try:
        from teleop_rt.cli import main as command_line  # noqa: PLC0415 - as above

        command_line()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(FAULT)


if __name__ == "__main__":
    main()
