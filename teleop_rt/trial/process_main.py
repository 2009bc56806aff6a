"""The mains of slave and master on the machine's clock, each in a separate process."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_rt.axis import Axis
from teleop_rt.config.realtime import RealtimeConfig
from teleop_rt.config.rig import RigConfig
from teleop_rt.config.trial import TrialConfig
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.keys import PeerKeys
from teleop_rt.link.transport import UdpTransport
from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.histogram import TimingHistograms
from teleop_rt.realtime.loop import run_loop
from teleop_rt.realtime.scheduling import Privilege, prepare_process, remember_process
from teleop_rt.service.daemon import Daemon
from teleop_rt.service.notify import Notifier
from teleop_rt.slave.faults import State
from teleop_rt.slave.slave import Slave
from teleop_rt.trial.late import advice
from teleop_rt.trial.link_news import link_reported
from teleop_rt.trial.side import Configs, Side
from teleop_rt.trial.sides import (
    make_endpoint,
    make_slave,
    slave_outcome,
)

if TYPE_CHECKING:
    from teleop_rt.master.build import OpenDevice

MASTER_PRIORITY, RIG_PRIORITY = 50, 55
"""SCHED_FIFO priorities of master and simulated rig, where the system grants them."""

_FREE = "(0 takes a free one)"

ShouldStop = Callable[[], bool]
OpenAxis = Callable[[Callable[[], int]], Axis]
"""Opens the rig's axis, given the clock [ns] by which it stamps."""


@dataclass(frozen=True, slots=True)
class SlaveEnd:
    """The end of the slave; `again` requests another one, with the present config."""

    outcome: dict[str, Any]
    again: bool


def slave_main(
    side: Side,
    configs: Configs,
    open_axis: OpenAxis,
    keys: PeerKeys,
    should_stop: ShouldStop,
    *,
    arm: bool,
) -> SlaveEnd:
    """Run the slave until it is asked to stop; armed at once, only for the trial's duration.

    A slave that is armed at once also ends at a fault; one that is alone and waits for commands
    keeps the fault until it is reset. Raises AxisError or LinkError before anything moves: that
    refuses the config. Whatever is raised after `configs.begun`, the last thing that the axis
    hears is stop, and it is raised again.
    """
    trial, ring_folder, alone = side.trial, side.ring_folder, side.alone
    other_port = f"choose another link.slave_port {_FREE}"
    if alone is not None:
        other_port = "give both sides another link.slave_port"
    with _held(trial, open_axis, other_port, reloaded=configs.before is not None) as held:
        now_ns = time.monotonic_ns
        endpoint = make_endpoint("slave", trial, held.transport, keys, now_ns)
        slave = make_slave(trial, held.axis, endpoint, now_ns, ring_folder, measure_work=True)
        histograms = TimingHistograms(ring_folder, create=True)
        daemon = Daemon(slave, ring_folder, held.notifier, histograms, arm_at_once=arm)
        if alone is not None:
            alone.wait_ready()
        slave.configure()
        granted = _prepare(trial.rig.realtime)
        privileges = [privilege.describe() for privilege in granted]
        if alone is not None:
            alone.describe(trial, privileges, configs.refusal)
        side.emit("ready", privileges=privileges)
        held.notifier.going()
        held.goes_on = False
        configs.begun()
        last_tick = round(trial.duration_s * trial.rig.rate_hz) if arm else None
        held.goes_on = daemon.run(
            lambda: loop_clock(trial.rig, held.axis, endpoint),
            _finished(slave, should_stop, last_tick),
        )
        simulated = trial.plant is not None
        outcome = slave_outcome(slave, endpoint, _if_late(trial, granted), simulated=simulated)
        return SlaveEnd(outcome, again=held.goes_on)


@dataclass(slots=True)
class _Held:
    """Resources that the slave holds; `goes_on` if another config follows."""

    transport: UdpTransport
    axis: Axis
    notifier: Notifier
    goes_on: bool

    def announce_end(self) -> None:
        """Notify the service manager whether this is a pause between two configs or the end."""
        if self.goes_on:
            self.notifier.standing(reloading=True)
        else:
            self.notifier.send(b"STOPPING=1")


@contextmanager
def _held(
    trial: TrialConfig, open_axis: OpenAxis, other_port: str, *, reloaded: bool
) -> Iterator[_Held]:
    """Take the port, the axis and the loop's privileges, and give all of it back.

    Whoever refuses meanwhile: the next config needs it. `other_port` is the next step where the
    port is taken. The axis is stopped before it is closed.
    """
    link = trial.link
    peer = (link.host, link.master_port) if link.master_port else None
    with ExitStack() as stack:
        stack.callback(remember_process())
        transport = stack.enter_context(
            closing(UdpTransport(link.bind_host, link.slave_port, peer, other_port))
        )
        axis = stack.enter_context(closing(open_axis(time.monotonic_ns)))
        stack.callback(axis.stop)
        notifier = stack.enter_context(closing(Notifier(trial.rig.period_ns)))
        held = _Held(transport, axis, notifier, goes_on=reloaded)
        stack.callback(held.announce_end)
        yield held


def _prepare(machine: RealtimeConfig) -> list[Privilege]:
    """Ask the system for the privileges of the rig's loop, and return its answer to each."""
    return prepare_process(machine.priority, machine.cpu, awake=machine.awake)


def _if_late(trial: TrialConfig, granted: list[Privilege]) -> str:
    rig = trial.rig
    return advice(granted, rig.rate_hz, rig.realtime.cpu, simulated=trial.plant is not None)


def loop_clock(rig: RigConfig, axis: Axis, endpoint: Endpoint) -> RealClock:
    """Return the loop's clock: while it waits, the link's packet is taken in ahead of the tick.

    Where stamps are paired, arrivals are noted meanwhile.
    """
    watch = getattr(axis, "watch", None) if rig.axis.paired else None
    return RealClock(rig.period_ns, round(rig.realtime.spin_us * 1e3), watch, endpoint.take_ahead)


def _finished(slave: Slave, should_stop: ShouldStop, last_tick: int | None) -> ShouldStop:
    """Return the condition for the end of the loop; without `last_tick` only a request ends it."""

    def finished() -> bool:
        over = last_tick is not None and (
            slave.tick >= last_tick or slave.safety.state == State.FAULT
        )
        return over or should_stop()

    return finished


def master_main(
    side: Side,
    folder: Path,
    keys: PeerKeys,
    should_stop: ShouldStop,
    open_device: OpenDevice | None = None,
) -> dict[str, Any]:
    """Run the master until a stop request; `folder` is the trial file's.

    Raises LinkError where its port cannot be opened, OperatorError where its operator cannot.
    """
    from teleop_rt.trial.master_side import (  # noqa: PLC0415 - a slave does not load it
        MasterSide,
        operator_of,
    )

    trial = side.trial
    operator = operator_of(trial, folder, open_device)
    link = trial.link
    peer = (link.host, link.slave_port)
    transport = UdpTransport(
        link.bind_host, link.master_port, peer, f"choose another link.master_port {_FREE}"
    )
    endpoint = make_endpoint("master", trial, transport, keys, time.monotonic_ns)
    master = MasterSide(trial, operator, endpoint, time.monotonic_ns, side.ring_folder)
    asked = prepare_process(MASTER_PRIORITY)
    side.emit("ready", privileges=[privilege.describe() for privilege in asked])
    reported: AbstractContextManager[None] = nullcontext()
    if side.alone is not None:
        reported = link_reported(lambda: endpoint.trouble_code(time.monotonic_ns()), side.emit)
    try:
        with reported:
            clock = RealClock(master.period_ns, ahead=master.master.take_ahead)
            run_loop(clock, master.cycle, should_stop)
    finally:
        master.close()
    return master.outcome()
