"""The commands that talk to a running daemon."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any

import typer

from teleop_rt import __version__
from teleop_rt.errors import BAD_INPUT
from teleop_rt.service.client import DaemonError, request, request_reload
from teleop_rt.terminal import pipe_that_may_close, red

REFUSED = 1
"""Exit code of a command that the daemon does not execute."""
_UNSAFE = "unsafe: "
_RESULTS = {
    "DISARMED": "the drive has no power; `teleop-rt arm` powers it",
    "ARMED": "the drive has power, the axis holds its position; `teleop-rt start` lets it follow",
    "RUN": "the axis follows the master",
    "HOLD": "the axis holds its position until fresh motion comes from the master",
}
"""Meaning of the state in which a command leaves the axis."""

Lines = Callable[[Mapping[str, Any]], Iterator[str]]
"""Status -> its lines for people."""

Rig = Annotated[
    str | None, typer.Option("--rig", help="the rig's name, if several daemons are running")
]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object")]


def status(rig: Rig = None, as_json: Json = False) -> None:
    """Show the running daemon: its state, samples, cycle times and recorder."""
    _send("status", rig, lines, as_json=as_json)


def arm(rig: Rig = None, as_json: Json = False) -> None:
    """Power the drive of the running daemon; it holds its position until `start`."""
    _send("arm", rig, result, as_json=as_json)


def start(rig: Rig = None, as_json: Json = False) -> None:
    """Let the armed axis of the running daemon follow the master."""
    _send("start", rig, result, as_json=as_json)


def stop(rig: Rig = None, as_json: Json = False) -> None:
    """Stop the axis of the running daemon and power it off; the daemon keeps running."""
    _send("stop", rig, result, as_json=as_json)


def reset(rig: Rig = None, as_json: Json = False) -> None:
    """Clear a fault of the running daemon; its devices are configured again, nothing moves."""
    _send("reset", rig, result, as_json=as_json)


def reload(
    rig: Rig = None,
    pid: Annotated[int | None, typer.Option(help="the daemon's process id")] = None,
    as_json: Json = False,
) -> None:
    """Reload the config of the running daemon; an invalid config changes nothing."""
    print_answer(request_reload(rig, pid), as_json=as_json)


COMMANDS = (start, stop, arm, status, reset, reload)


def main() -> None:
    """Run one of these commands without loading the rest of the program."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    for command in COMMANDS:
        app.command()(command)
    try:
        with pipe_that_may_close():
            app()
    except DaemonError as error:
        print(error, file=sys.stderr)
        sys.exit(BAD_INPUT)


def _send(command: str, rig: str | None, give: Lines, *, as_json: bool) -> None:
    print_answer(request(command, rig), give, as_json=as_json)


def print_answer(answer: Mapping[str, Any], give: Lines | None = None, *, as_json: bool) -> None:
    """Print the daemon's answer: its status, or the problem, with which the command exits.

    `give` gives the lines of a status; all of them by default.
    """
    if as_json:
        print(json.dumps(answer["status"] if answer["ok"] else answer))
    elif answer["ok"]:
        show(answer["status"], give or lines)
    if not answer["ok"]:
        if not as_json:
            print(answer["problem"], file=sys.stderr)
        raise typer.Exit(REFUSED)


def show(status: Mapping[str, Any], give: Lines) -> None:
    """Print the status; that of a daemon of another version may hold less than is shown here."""
    try:
        shown = list(give(status))
    except KeyError as error:
        raise DaemonError(
            f"the daemon is teleop-rt {status.get('version', 'of an unknown version')} and this is "
            f"{__version__}, which misses {error} in its status: start the daemon again, "
            "or read its status with --json"
        ) from None
    print("\n".join(red(line) if line.startswith(_UNSAFE) else line for line in shown))


def result(status: Mapping[str, Any]) -> Iterator[str]:
    """Give the state in which a command left the axis, and any fault and alarm."""
    yield from _unsafe_of(status)
    state = status["state"]
    meaning = f": {_RESULTS[state]}" if state in _RESULTS else ""
    yield f"{status['rig']}: {state}{meaning}"
    yield from _fault(status)
    yield from (f"ALARM: {alarm}" for alarm in status["alarms"])


def lines(status: Mapping[str, Any]) -> Iterator[str]:
    """Give the status as lines for people."""
    units = status["units"]
    yield from _unsafe_of(status)
    yield f"{status['rig']}: {status['state']} (trial {status['trial']}, process {status['pid']})"
    yield from _fault(status)
    if (last := status["last_fault"]) is not None:
        yield _last_fault(last)
    position = _quantity(status["position"], units["position"])
    force = _quantity(status["force"], units["force"])
    contact = "in contact" if status["in_contact"] else "free"
    yield f"position {position}, force {force}, {contact}, {status['tick']} ticks"
    yield from _link(status["link"])
    for kind, spread in status["timing_us"].items():
        if spread is not None:
            times = f"p50 {spread['p50']:.0f}, p99 {spread['p99']:.0f}, max {spread['max']:.0f} us"
            yield f"{kind.replace('_', ' ')}: {times}"
    dropped = sum(status["recorder"]["dropped"].values())
    yield f"recording in {status['folder']}, {dropped} rows dropped"
    yield from (f"ALARM: {alarm}" for alarm in status["alarms"])
    yield from (line for line in status["privileges"] if "refused" in line)


def _unsafe_of(status: Mapping[str, Any]) -> Iterator[str]:
    yield from (f"{_UNSAFE}{sentence}" for sentence in status.get("unsafe", ()))


def _fault(status: Mapping[str, Any]) -> Iterator[str]:
    fault = status["fault"]
    if fault["code"]:
        yield f"fault: {fault['name']}: {fault['cause']}; {fault['next_step']}"


def _last_fault(last: Mapping[str, Any]) -> str:
    """Give the time of the axis' last stop for a fault, and the device's report of it."""
    ago_s = (time.monotonic_ns() - last["stamp_ns"]) * 1e-9
    said = f"; {last['said']}" if last["said"] else ""
    return f"last fault: {last['fault']}, {ago_s:.0f} s ago{said}"


def _link(link: Mapping[str, Any]) -> Iterator[str]:
    """Give the link: its trouble with the next step, or its quality; then its counts."""
    silence_ms = link["silence_ms"]
    ago = "unknown" if silence_ms is None else f"{max(0.0, silence_ms):.3g} ms"
    if link["trouble"]:
        cause, _, next_step = link["cause"].partition(": ")
        yield f"link: {cause}"
        if next_step:
            yield f"  next: {next_step}"
    else:
        yield f"link: last packet {ago} ago"
    sent = link["packets_lost"] + link["packets_received"]
    yield f"packets: {link['packets_lost']} of {sent} lost, {link['packets_rejected']} refused"
    yield (
        f"axis: followed the master {link['followings']} times, held {link['holds']} times without"
        " fresh motion"
    )


def _quantity(value: float | None, unit: str) -> str:
    return "unknown" if value is None else f"{value:.6g} {unit}"
