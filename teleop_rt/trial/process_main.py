"""What each process of a trial does on the machine's clock: slave, master and recorder."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from teleop_rt.axis import Axis, EndOfRecording
from teleop_rt.config import TrialConfig
from teleop_rt.link.transport import UdpTransport
from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.loop import run_loop
from teleop_rt.realtime.parent import tell_parent
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.realtime.session import Recorder
from teleop_rt.slave.faults import INTERNAL, State
from teleop_rt.slave.slave import Slave
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt.trial.event_log import EventLog
from teleop_rt.trial.sides import (
    MASTER_TOPIC,
    SLAVE_TOPIC,
    MasterSide,
    make_endpoint,
    make_slave,
    operator_of,
    slave_outcome,
)

SLAVE_PRIORITY, MASTER_PRIORITY, RIG_PRIORITY = 60, 50, 55
_RECORDER_PERIOD_S = 0.05
_SETTLING_TICKS = 50

ShouldStop = Callable[[], bool]


def slave_main(
    trial: TrialConfig,
    open_axis: Callable[[Callable[[], int]], Axis],
    key: bytes,
    session: Path,
    should_stop: ShouldStop,
    *,
    arm: bool,
) -> dict[str, Any]:
    """Run the slave until its duration, a fault, the end of a recording or a stop request.

    Raises AxisError or LinkError before anything moves. Whatever is raised later, the last
    thing that the axis hears is stop, and the cause is raised again.
    """
    link = trial.link
    peer = (link.host, link.master_port) if link.master_port else None
    transport = UdpTransport(link.bind_host, link.slave_port, peer)
    axis = open_axis(time.monotonic_ns)
    try:
        endpoint = make_endpoint(
            "slave", trial, transport, key, time.monotonic_ns, repeatable=False
        )
        slave = make_slave(trial, axis, endpoint, time.monotonic_ns, session, measure_work=True)
        slave.configure()
        privileges = prepare_process(SLAVE_PRIORITY)
        tell_parent("ready", privileges=[p.describe() for p in privileges])
        _slave_loop(trial, slave, should_stop, arm=arm)
        return slave_outcome(slave, endpoint)
    finally:
        axis.stop()
        axis.close()
        transport.close()


def _slave_loop(trial: TrialConfig, slave: Slave, should_stop: ShouldStop, *, arm: bool) -> None:
    clock = RealClock(trial.rig.period_ns)
    last_tick = round(trial.duration_s * trial.rig.rate_hz)

    def finished() -> bool:
        return should_stop() or slave.tick >= last_tick or slave.safety.state == State.FAULT

    def cycle(skipped: int, wake_latency_ns: int) -> None:
        slave.cycle(skipped, wake_latency_ns)
        if arm and slave.safety.state == State.DISARMED:
            slave.arm()

    try:
        run_loop(clock, cycle, finished)
        slave.disarm()
        settled = slave.tick + _SETTLING_TICKS
        run_loop(clock, slave.cycle, lambda: slave.tick >= settled)
    except EndOfRecording:
        slave.disarm()
    except BaseException:
        slave.stop(INTERNAL)
        raise
    finally:
        slave.close()


def master_main(
    trial: TrialConfig, folder: Path, key: bytes, session: Path, should_stop: ShouldStop
) -> dict[str, Any]:
    """Run the master until a stop request; `folder` is the trial file's.

    Raises LinkError where its port cannot be had, OperatorError where its operator cannot.
    """
    operator = operator_of(trial, folder)
    link = trial.link
    peer = (link.host, link.slave_port)
    transport = UdpTransport(link.bind_host, link.master_port, peer)
    endpoint = make_endpoint("master", trial, transport, key, time.monotonic_ns, repeatable=False)
    side = MasterSide(trial, operator, endpoint, time.monotonic_ns, session)
    prepare_process(MASTER_PRIORITY)
    tell_parent("ready")
    try:
        run_loop(RealClock(side.period_ns), side.cycle, should_stop)
    finally:
        side.close()
    return side.outcome()


def recorder_main(
    trial: TrialConfig, session: Path, recording: Path, should_stop: ShouldStop
) -> dict[str, Any]:
    """Record every ring of the session until a stop request, then what is left in them."""
    log = EventLog()
    watchers = {SLAVE_TOPIC: log.watch_slave, MASTER_TOPIC: log.watch_master}
    recorder = Recorder(
        session, RecordingWriter(recording, trial.rig.units, recording_metadata(trial)), watchers
    )
    tell_parent("ready")
    try:
        while not should_stop():
            recorder.discover()
            if recorder.drain():
                recorder.flush()
            time.sleep(_RECORDER_PERIOD_S)
    finally:
        recorder.close()
    return {"dropped": recorder.dropped}
