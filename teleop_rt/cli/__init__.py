"""The command line, and the only place that wires the core and the drivers together.

Each command lives in a module that is imported when it is called: what talks to a running daemon
or makes a key does not wait for compilers and solvers that only other commands need.
"""

from __future__ import annotations

import sys

from teleop_rt.cli.lazy import LazyCommand, LazyGroup
from teleop_rt.errors import ExpectedError
from teleop_rt.terminal import pipe_that_may_close

_SIDES = "teleop_rt.cli.sides"
_OFFLINE = "teleop_rt.offline.commands"
_SERVICE = "teleop_rt.service.commands"
_DEVICES = "teleop_rt_drivers.commands"

app = LazyGroup(
    "Real-time controller for 1-DOF model-mediated teleoperation.",
    {
        "run": LazyCommand(
            "teleop_rt.cli.running:run",
            "Run a whole trial: rig, slave, master and recorder, then the summary.",
        ),
        "slave": LazyCommand(
            f"{_SIDES}:slave",
            "Run the slave daemon next to the rig; `start`, `stop`, `arm` and `status` talk to it.",
        ),
        "master": LazyCommand(f"{_SIDES}:master", "Run the master next to the operator."),
        "sim": LazyCommand(
            f"{_SIDES}:sim", "Run the simulated rig: a plant behind devices that speak real bytes."
        ),
        "start": LazyCommand(
            f"{_SERVICE}:start", "Let the armed axis of the running daemon follow the master."
        ),
        "stop": LazyCommand(
            f"{_SERVICE}:stop",
            "Stop the axis of the running daemon and take its power away; the daemon goes on.",
        ),
        "arm": LazyCommand(
            f"{_SERVICE}:arm",
            "Power the drive of the running daemon; it holds its position until `start`.",
        ),
        "status": LazyCommand(
            f"{_SERVICE}:status",
            "Tell how the running daemon is: its state, its samples, its times, its recorder.",
        ),
        "reset": LazyCommand(
            f"{_SERVICE}:reset",
            "Clear a fault of the running daemon; its devices are configured again, nothing moves.",
        ),
        "reload": LazyCommand(
            f"{_SERVICE}:reload",
            "Let the running daemon load its config again; one that is not valid changes nothing.",
        ),
        "make-safe": LazyCommand(
            f"{_SIDES}:make_safe",
            "Stop the axis of a rig that no daemon runs: "
            "what systemd calls after a daemon has ended.",
        ),
        "replay": LazyCommand(f"{_OFFLINE}:replay", "Run the estimators over recordings."),
        "diagnose": LazyCommand(
            f"{_OFFLINE}:diagnose",
            "Find what a model leaves unexplained, name the effect, and tell the error with it.",
        ),
        "close-loop": LazyCommand(
            "teleop_rt.cli.closing:close_loop",
            "Run a trial, find what its model lacks, add it, and tell the error on a fresh trial.",
        ),
        "study": LazyCommand("teleop_rt.cli.study:study", "Repeatable studies."),
        "report": LazyCommand(
            "teleop_rt.cli.showing:report",
            "Write the report of a run from its folder, also of a run that ended badly.",
        ),
        "live": LazyCommand(
            "teleop_rt.cli.showing:live",
            "Show what runs on this machine, or a recording, in a browser; it controls nothing.",
        ),
        "check": LazyCommand(
            f"{_DEVICES}:check",
            "Find out all that can be known of a config without moving anything.",
        ),
        "doctor": LazyCommand(
            f"{_DEVICES}:doctor",
            "Find out what this machine, the rig's buses and the link really do; nothing is armed.",
        ),
        "recover": LazyCommand(
            f"{_OFFLINE}:recover",
            "Make a recording whole that was cut off by a crash; the original stays as it is.",
        ),
        "export": LazyCommand(f"{_OFFLINE}:export", "Write one channel of a recording as a table."),
        "schema": LazyCommand(
            "teleop_rt.cli.schema:schema",
            "Print the JSON Schema of a YAML file that is read, or of the JSON that is printed.",
        ),
        "keygen": LazyCommand(
            "teleop_rt.cli.keygen:keygen", "Make a key for the link; both sides need the same."
        ),
    },
)


def main() -> None:
    """Run the command line; every expected error becomes one message and an exit code."""
    try:
        with pipe_that_may_close():
            app()
    except ExpectedError as error:
        print(error, file=sys.stderr)
        sys.exit(error.code)
