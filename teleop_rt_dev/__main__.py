"""Tools for the developers of teleop-rt: benches, campaigns, documentation, schemas."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

COMMANDS = {
    "bench": "measure speed against bars and peers",
    "campaign": "run a campaign: many trials, faults, attacks, recordings",
    "docs": "build the documentation, or make its pictures, gallery, notebook",
    "path": "print the path from `run` to a tick, and write it into CONTRIBUTING.md",
    "schemas": "write the JSON Schemas that the shipped YAML files name",
}
"""Name and help of each command; its code is `main` of `teleop_rt_dev.NAME.command`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the first argument names; the others are its own."""
    parser = argparse.ArgumentParser(prog="teleop-rt-dev", description=__doc__, add_help=False)
    parser.add_argument("command", nargs="?", choices=COMMANDS, metavar="COMMAND")
    parser.add_argument("-h", "--help", action="store_true")
    given = list(sys.argv[1:] if arguments is None else arguments)
    chosen = parser.parse_args(given[:1])
    if chosen.command is None:
        print(f"usage: teleop-rt-dev COMMAND [--help]\n\n{__doc__}\n")
        print("\n".join(f"  {name:10} {meaning}" for name, meaning in COMMANDS.items()))
        return 0 if chosen.help else 2
    command = importlib.import_module(f"teleop_rt_dev.{chosen.command}.command")
    code: int = command.main(given[1:])
    return code


if __name__ == "__main__":
    sys.exit(main())
