"""The program: `teleop-rt`, or `python -m teleop_rt`."""

from __future__ import annotations

import sys

FAULT = 1
TO_A_DAEMON = {"start", "stop", "arm", "status", "reset", "reload"}


def main() -> None:
    """Run the command line; an interrupt while it is still being loaded ends it quietly.

    Loading it takes seconds on a busy machine; what talks to a running daemon does not wait.
    """
    try:
        if len(sys.argv) > 1 and sys.argv[1] in TO_A_DAEMON:
            from teleop_rt.service.commands import main as command_line  # noqa: PLC0415 - as above
        else:
            from teleop_rt.cli import main as command_line  # noqa: PLC0415 - as above
        command_line()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(FAULT)


if __name__ == "__main__":
    main()
