"""What slave and master do on the machine's clock, each in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teleop_rt.axis import Axis
from teleop_rt.config import TrialConfig
from teleop_rt.link.transport import UdpTransport
from teleop_rt.master.build import OpenDevice
from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.histogram import TimingHistograms
from teleop_rt.realtime.loop import run_loop
from teleop_rt.realtime.parent import Tell
from teleop_rt.realtime.scheduling import prepare_process, remember_process
from teleop_rt.service.daemon import Daemon
from teleop_rt.service.notify import Notifier
from teleop_rt.slave.faults import State
from teleop_rt.trial.alone import Alone
from teleop_rt.trial.sides import (
    MasterSide,
    make_endpoint,
    make_slave,
    operator_of,
    slave_outcome,
)

MASTER_PRIORITY, RIG_PRIORITY = 50, 55

ShouldStop = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class SlaveEnd:
    """How the slave ended; `again` asks for another one, with the config as it is now."""

    outcome: dict[str, Any]
    again: bool


def slave_main(
    trial: TrialConfig,
    open_axis: Callable[[Callable[[], int]], Axis],
    key: bytes,
    session: Path,
    should_stop: ShouldStop,
    tell: Tell,
    *,
    arm: bool,
    alone: Alone | None = None,
    reloaded: bool = False,
    refusal: str = "",
    begun: Callable[[], None] | None = None,
) -> SlaveEnd:
    """Run the slave until it is asked to stop; armed at once, only for the trial's duration.

    A slave that is armed at once also ends at a fault; one that is alone and waits for commands
    keeps the fault until it is reset. Raises AxisError or LinkError before anything moves.
    Whatever is raised later, the last thing that the axis hears is stop, and it is raised again.
    `reloaded` says that the config before this one is gone back to where this one is refused, and
    `refusal` why another one was, for the status. `begun` is called where the loop is about to
    begin: what is raised before it refuses the config.
    """
    link = trial.link
    peer = (link.host, link.master_port) if link.master_port else None
    goes_on = reloaded
    with (
        ExitStack() as held
    ):  # what was taken is given back, whoever refuses: the next one needs it
        held.callback(remember_process())
        transport = held.enter_context(closing(UdpTransport(link.bind_host, link.slave_port, peer)))
        axis = held.enter_context(closing(open_axis(time.monotonic_ns)))
        held.callback(axis.stop)
        notifier = held.enter_context(closing(Notifier(trial.rig.period_ns)))
        try:
            endpoint = make_endpoint(
                "slave", trial, transport, key, time.monotonic_ns, repeatable=False
            )
            slave = make_slave(trial, axis, endpoint, time.monotonic_ns, session, measure_work=True)
            histograms = TimingHistograms(session, create=True)
            daemon = Daemon(slave, session, notifier, histograms, arm_at_once=arm)
            if alone is not None:
                alone.wait_ready()
            slave.configure()
            machine = trial.rig.realtime
            asked = prepare_process(machine.priority, machine.cpu, awake=machine.awake)
            privileges = [privilege.describe() for privilege in asked]
            if alone is not None:
                alone.describe(trial, privileges, refusal)
            tell("ready", privileges=privileges)
            notifier.going()
            last_tick = round(trial.duration_s * trial.rig.rate_hz)

            def finished() -> bool:
                over = arm and (slave.tick >= last_tick or slave.safety.state == State.FAULT)
                return over or should_stop()

            spin_ns = round(machine.spin_us * 1e3)
            goes_on = False
            if begun is not None:
                begun()
            goes_on = daemon.run(lambda: RealClock(trial.rig.period_ns, spin_ns), finished)
            return SlaveEnd(slave_outcome(slave, endpoint), again=goes_on)
        finally:
            if goes_on:
                notifier.standing(reloading=True)
            else:
                notifier.send(b"STOPPING=1")


def master_main(
    trial: TrialConfig,
    folder: Path,
    key: bytes,
    session: Path,
    should_stop: ShouldStop,
    tell: Tell,
    open_device: OpenDevice | None = None,
) -> dict[str, Any]:
    """Run the master until a stop request; `folder` is the trial file's.

    Raises LinkError where its port cannot be had, OperatorError where its operator cannot.
    """
    operator = operator_of(trial, folder, open_device)
    link = trial.link
    peer = (link.host, link.slave_port)
    transport = UdpTransport(link.bind_host, link.master_port, peer)
    endpoint = make_endpoint("master", trial, transport, key, time.monotonic_ns, repeatable=False)
    side = MasterSide(trial, operator, endpoint, time.monotonic_ns, session)
    asked = prepare_process(MASTER_PRIORITY)
    tell("ready", privileges=[privilege.describe() for privilege in asked])
    try:
        run_loop(RealClock(side.period_ns), side.cycle, should_stop)
    finally:
        side.close()
    return side.outcome()
