"""The command line, and the only place that wires the core and the drivers together.

Each command lives in a module that is imported when it is called: one that talks to a running
daemon or makes a key does not wait for compilers and solvers that only other commands need.
"""

from __future__ import annotations

import errno
import logging
import resource
import sys

from teleop_rt.cli.lazy import LazyCommand, LazyGroup
from teleop_rt.cli.top import top_options
from teleop_rt.errors import FAULT, ExpectedError
from teleop_rt.terminal import pipe_that_may_close

_SIDES = "teleop_rt.cli.sides"
_RECORDED = "teleop_rt.cli.recordings"
_SERVICE = "teleop_rt.service.commands"
_DEVICES = "teleop_rt_drivers.commands"

_TRIAL, _RIG = "Run a trial", "On the rig"
_RECORDINGS, _TOOLS = "Recordings and runs", "Tools"
"""The panels of the help, in the order in which their first commands stand in the table."""

app = LazyGroup(
    "Real-time controller for 1-DOF model-mediated teleoperation.",
    {
        "run": LazyCommand(
            "teleop_rt.cli.running:run",
            "Run a whole trial: rig, slave, master and recorder, then the summary.",
            panel=_TRIAL,
        ),
        "new": LazyCommand(
            "teleop_rt.cli.new:new",
            "Copy a trial and its rig into a folder, to start from.",
            panel=_TRIAL,
        ),
        "new-rig": LazyCommand(
            "teleop_rt.cli.new_rig:new_rig",
            "Write a rig file for a drive, an adapter and a force sensor; asks for missing "
            "options.",
            panel=_RIG,
        ),
        "close-loop": LazyCommand(
            "teleop_rt.cli.closing:close_loop",
            "Run and diagnose a trial, extend its model, and report the errors of a fresh trial.",
            panel=_TRIAL,
        ),
        "study": LazyCommand("teleop_rt.cli.study:study", "Repeatable studies.", panel=_TRIAL),
        "check": LazyCommand(
            f"{_DEVICES}:check",
            "Check a config without moving anything: descriptions, limits, units, bus load.",
            panel=_TRIAL,
        ),
        "slave": LazyCommand(
            f"{_SIDES}:slave",
            "Run the slave daemon next to the rig; `arm`, `start`, `stop` and `status` command it.",
            panel=_RIG,
        ),
        "master": LazyCommand(
            f"{_SIDES}:master",
            "Run the master next to the operator until it is stopped, by Ctrl-C or SIGTERM.",
            panel=_RIG,
        ),
        "sim": LazyCommand(
            f"{_SIDES}:sim",
            "Run the simulated rig: a plant, and devices that exchange real bytes.",
            panel=_RIG,
        ),
        "arm": LazyCommand(
            f"{_SERVICE}:arm",
            "Power the drive of the running daemon; it holds its position until `start`.",
            panel=_RIG,
        ),
        "start": LazyCommand(
            f"{_SERVICE}:start",
            "Let the armed axis of the running daemon follow the master.",
            panel=_RIG,
        ),
        "stop": LazyCommand(
            f"{_SERVICE}:stop",
            "Stop the axis of the running daemon and power it off; the daemon keeps running.",
            panel=_RIG,
        ),
        "reset": LazyCommand(
            f"{_SERVICE}:reset",
            "Clear a fault of the running daemon; its devices are configured again, nothing moves.",
            panel=_RIG,
        ),
        "reload": LazyCommand(
            f"{_SERVICE}:reload",
            "Reload the config of the running daemon; an invalid config changes nothing.",
            panel=_RIG,
        ),
        "status": LazyCommand(
            f"{_SERVICE}:status",
            "Show the running daemon: its state, samples, cycle times and recorder.",
            panel=_RIG,
        ),
        "doctor": LazyCommand(
            f"{_DEVICES}:doctor",
            "Measure the machine, and a rig's buses, devices and link; nothing is armed.",
            panel=_RIG,
        ),
        "calibrate": LazyCommand(
            "teleop_rt.cli.calibrating:calibrate",
            "Calibrate a force sensor's scale and lag, a drivetrain, or an operator's device.",
            panel=_RIG,
        ),
        "make-safe": LazyCommand(
            f"{_SIDES}:make_safe",
            "Stop the axis of a rig that no daemon runs: "
            "systemd calls this after a daemon has ended.",
            panel=_RIG,
        ),
        "replay": LazyCommand(
            f"{_RECORDED}:replay", "Run the estimators over recordings.", panel=_RECORDINGS
        ),
        "diagnose": LazyCommand(
            f"{_RECORDED}:diagnose",
            "Name the effect that a model lacks, and report the errors without and with it.",
            panel=_RECORDINGS,
        ),
        "effects": LazyCommand(
            "teleop_rt.cli.effects:effects",
            "List the effects that diagnose can name, and that a model can be extended by.",
            panel=_RECORDINGS,
        ),
        "report": LazyCommand(
            "teleop_rt.cli.showing:report",
            "Write the report of a run from its folder, also after a fault or a crash.",
            panel=_RECORDINGS,
        ),
        "runs": LazyCommand(
            "teleop_rt.cli.showing:runs",
            "List the runs of a folder, the newest first: "
            "date, trial, verdict, model and felt error.",
            panel=_RECORDINGS,
        ),
        "live": LazyCommand(
            "teleop_rt.cli.showing:live",
            "Show a run, a daemon or a recording in a browser; the page controls nothing.",
            panel=_RECORDINGS,
        ),
        "export": LazyCommand(
            f"{_RECORDED}:export",
            "Export one channel of a recording as a table, or the recording for ROS 2 or LeRobot.",
            panel=_RECORDINGS,
        ),
        "recover": LazyCommand(
            f"{_RECORDED}:recover",
            "Repair a recording that is cut off or damaged; the original is kept.",
            panel=_RECORDINGS,
        ),
        "schema": LazyCommand(
            "teleop_rt.cli.schema:schema",
            "Print the JSON Schema of an input file (YAML) or of a command's JSON output.",
            panel=_TOOLS,
        ),
        "keygen": LazyCommand(
            "teleop_rt.cli.keygen:keygen",
            "Make a key for the link; both sides need the same.",
            panel=_TOOLS,
        ),
    },
    top_options(),
)


_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO}
"""Errors of a disk that cannot be written: full, quota, file limit, read-only, broken."""
_TOO_MANY = {errno.EMFILE, errno.ENFILE}
"""Errors of a process, or a computer, that may open no further file."""


def main() -> None:
    """Run the command line; every expected error becomes one message and an exit code."""
    # Its first import on a machine warns that it searches fonts, in the midst of a run's output.
    logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
    try:
        with pipe_that_may_close():
            app()
    except ExpectedError as error:
        print(error, file=sys.stderr)
        sys.exit(error.code)
    except OSError as error:
        if error.errno in _TOO_MANY:
            most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
            print(
                f"{error.strerror}: a process may open {most} here: raise the limit with `ulimit -n"
                " 1024`, or LimitNOFILE= in a systemd unit, and try again",
                file=sys.stderr,
            )
            sys.exit(FAULT)
        if error.errno not in _DISK:
            raise
        where = "a result" if error.filename is None else error.filename
        print(
            f"{where}: cannot be written: {error.strerror}: make room, or write to another disk",
            file=sys.stderr,
        )
        sys.exit(FAULT)
