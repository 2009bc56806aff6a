"""The program: `teleop-rt`, or `python -m teleop_rt`."""

from __future__ import annotations

import sys

FAULT = 1


def main() -> None:
    """Run the command line; an interrupt while a command is still being loaded ends it quietly."""
    try:
        from teleop_rt.cli import main as command_line  # noqa: PLC0415 - as above

        command_line()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(FAULT)


if __name__ == "__main__":
    main()
