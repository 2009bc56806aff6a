"""Build slave and master of a trial from its config, for either clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.axis import Axis
from teleop_rt.config import TrialConfig
from teleop_rt.config_operator import DeviceOperator as DeviceConfig
from teleop_rt.contact.effects.user import library
from teleop_rt.link.channel import Endpoint, Role
from teleop_rt.link.impairment import ImpairedTransport, Impairment
from teleop_rt.link.keys import Keys
from teleop_rt.link.statistics import OVERTAKEN
from teleop_rt.link.transport import Transport
from teleop_rt.master.build import OpenDevice, cutoff_of, make_operator, make_port
from teleop_rt.master.coupling import make_coupling
from teleop_rt.master.device import DeviceOperator
from teleop_rt.master.master import Master
from teleop_rt.master.operators import Operator
from teleop_rt.master.outcome import outcome
from teleop_rt.master.passivity import Port
from teleop_rt.realtime.lateness import IN_TIME, ON_HARDWARE, STOP, Late, Lateness, late_ns
from teleop_rt.realtime.session import publish
from teleop_rt.signals import MASTER, MASTER_TOPIC, SLAVE, SLAVE_TOPIC
from teleop_rt.slave.estimate_log import EstimateLog
from teleop_rt.slave.faults import LATE_TICKS
from teleop_rt.slave.slave import Slave
from teleop_rt.trial.estimators import make_pipeline
from teleop_rt.trial.late import both, cause, late_outcome

_STREAMS: dict[Role, int] = {"slave": 1, "master": 2}
_OPERATOR_STREAM = 3


def make_endpoint(
    role: Role,
    trial: TrialConfig,
    transport: Transport,
    keys: Keys,
    now_ns: Callable[[], int],
) -> Endpoint:
    """Return one end of the link, with the trial's impairment on what it sends."""
    rng = np.random.default_rng([trial.seed, _STREAMS[role]])
    impairment = Impairment.one_way(trial.link)
    if impairment != Impairment():
        transport = ImpairedTransport(transport, impairment, now_ns, rng)
    declared_ms = trial.link.one_way_max_ms
    if role == "slave":
        rate_hz, stale_after_ms = trial.rig.rate_hz, trial.slave.hold_after_ms
    else:
        rate_hz, stale_after_ms = trial.master.rate_hz, trial.master.freeze_after_ms
    return Endpoint(
        role,
        transport,
        keys,
        now_ns,
        rate_hz=rate_hz,
        accepted_rates_hz=trial.link.accepted_rates_hz,
        one_way_max_ns=None if declared_ms is None else round(declared_ms * 1e6),
        stale_after_ns=round(stale_after_ms * 1e6),
    )


def make_slave(
    trial: TrialConfig,
    axis: Axis,
    endpoint: Endpoint,
    now_ns: Callable[[], int],
    session: Path,
    *,
    measure_work: bool,
    log_estimates: bool = True,
) -> Slave:
    """Return the slave, with its rings published in the session. Compiles the estimators."""
    pipeline = make_pipeline(trial)
    return Slave(
        trial,
        axis,
        endpoint,
        pipeline,
        now_ns,
        publish(session, SLAVE_TOPIC, SLAVE),
        EstimateLog(pipeline, partial(publish, session)) if log_estimates else None,
        measure_work=measure_work,
    )


def operator_of(
    trial: TrialConfig, folder: Path, open_device: OpenDevice | None = None
) -> Operator:
    """Return the trial's operator; `folder` is the trial file's.

    `open_device` opens a real one. Raises OperatorError, or AxisError for a device.
    """
    real = isinstance(trial.operator, DeviceConfig)
    return make_operator(
        trial.operator,
        folder=folder,
        period_s=1.0 / trial.master.rate_hz,
        rng=np.random.default_rng([trial.seed, _OPERATOR_STREAM]),
        open_device=open_device,
        device_cutoff_hz=cutoff_of(trial.master, real=real),
    )


def port_of(trial: TrialConfig, operator: Operator) -> Port:
    """Return how the operator's device senses and is driven: a real one's driver says it."""
    period_s, config = 1.0 / trial.master.rate_hz, trial.operator
    if isinstance(config, DeviceConfig) and isinstance(operator, DeviceOperator):
        return make_port(trial.master, period_s, config, operator.timing)
    return make_port(trial.master, period_s)


class MasterSide:
    """The master with its ring: one `cycle()` runs and records a tick."""

    def __init__(
        self,
        trial: TrialConfig,
        operator: Operator,
        endpoint: Endpoint,
        now_ns: Callable[[], int],
        session: Path,
    ) -> None:
        self.period_ns = round(1e9 / trial.master.rate_hz)
        self.endpoint = endpoint
        self._operator = operator
        device = trial.operator if isinstance(trial.operator, DeviceConfig) else None
        rig = trial.rig if device is None else device.rig
        self.late = Lateness(rig.realtime.late, self.period_ns)
        self.on_hardware = Lateness(ON_HARDWARE, self.period_ns)
        self.ring = publish(session, MASTER_TOPIC, MASTER)
        self.missed_ticks = 0
        self._master = Master(
            trial.master,
            trial.rig.limits,
            self.period_ns,
            operator,
            endpoint,
            now_ns,
            make_coupling(trial.mode, trial.coupling),
            library(Path(trial.effects_file) if trial.effects_file else None),
            port_of(trial, operator),
        )

    def cycle(self, skipped: int = 0, wake_latency_ns: int = 0) -> None:
        """Run one tick and record it."""
        self.missed_ticks += skipped
        late = self._judge(late_ns(skipped, wake_latency_ns, self.period_ns))
        self._master.cycle(skipped, stalled=late is not IN_TIME)
        self.ring.push(self._master.row)

    def _judge(self, late_ns: int) -> Late:
        """Judge how late a tick began, while a device pushes back; one that must stop is let go."""
        operator = self._operator
        device = operator if isinstance(operator, DeviceOperator) else None
        felt = self._master.engagement.coupled if device is None else device.powered
        if not felt:
            return IN_TIME
        if not self.on_hardware.stopped:
            self.on_hardware.update(late_ns)
        late = self.late.update(late_ns)
        if late is STOP and device is not None:
            device.give_up()
        return late

    def outcome(self) -> dict[str, Any]:
        """Return what the master side counted, for the summary."""
        return {
            "link": link_outcome(self.endpoint),
            "missed_ticks": self.missed_ticks,
            "late": both(self.late, self.on_hardware),
            "rendering": outcome(self._master),
        }

    def let_go(self) -> None:
        """Stop and release the operator's device, if there is a real one."""
        if isinstance(self._operator, DeviceOperator):
            self._operator.close()

    def close(self) -> None:
        """Release the device, close the ring for its readers, and close the link."""
        self.let_go()
        self.ring.close()
        self.endpoint.close()


def link_outcome(endpoint: Endpoint) -> dict[str, Any]:
    """Return what an end of the link counted; an overtaken packet came after a newer one."""
    statistics = endpoint.statistics
    reasons = {why: count for why, count in statistics.rejected.items() if why not in OVERTAKEN}
    round_trip_ns = statistics.round_trip_ns
    return {
        "trouble": endpoint.trouble,
        "sent": statistics.sent,
        "received": statistics.received,
        "lost": statistics.lost,
        "overtaken": statistics.overtaken,
        "rejected": statistics.refused,
        "rejected_by_reason": reasons,
        "round_trip_ms": round_trip_ns * 1e-6 if round_trip_ns >= 0 else None,
        "take_overs": statistics.take_overs,
    }


def slave_outcome(slave: Slave, endpoint: Endpoint, if_late: str = "") -> dict[str, Any]:
    """Return what the slave side counted, for the summary.

    `if_late` is what would help this machine's loop where lateness stopped it.
    """
    fault, late = slave.safety.fault, late_outcome(slave.safety)
    by_lateness = fault is LATE_TICKS and late["stop"] is not None
    return {
        "link": link_outcome(endpoint),
        "missed_ticks": slave.missed_ticks,
        "late": late,
        "safety": {
            "state": slave.safety.state.name,
            "fault": {
                "code": fault.code,
                "name": fault.name,
                "cause": cause(late) if by_lateness else fault.cause,
                "next_step": (if_late if by_lateness else "") or fault.next_step,
                "said": slave.sample.complaint or None,
            },
            "unsafe": slave.unsafe,
            "commands_limited": slave.commands_limited,
            "samples_rejected": slave.sample.rejected,
            "followings": slave.safety.followings,
            "holds": slave.safety.holds,
            "reference": slave.reference.outcome(),
        },
    }


def merge_outcomes(
    clock: str,
    slave: dict[str, Any],
    master: dict[str, Any],
    recorder: dict[str, Any],
    privileges: Sequence[str] = (),
    began_ns: int | None = None,
) -> dict[str, Any]:
    """Return the outcome of a run of both sides, with the link as seen by the slave.

    Refused packets are those of both ends.

    `privileges` is what the system granted to the slave's process, or refused; `began_ns` when the
    command was given, on the clock of the recording's stamps.
    """
    link = dict(slave["link"])
    link["master"] = master["link"]
    safety, handle = dict(slave["safety"]), (master.get("rendering") or {}).get("handle")
    if handle is not None and handle["fault"]["code"] and not safety["fault"].get("code"):
        safety["fault"] = handle["fault"] | {"said": None}
    if unsafe := (handle or {}).get("unsafe"):
        safety["unsafe"] = [*safety.get("unsafe", ()), *unsafe]
    ends = [end["rejected"] for end in (slave["link"], master["link"])]
    link["refused"] = None if None in ends else sum(ends)
    return {
        "clock": clock,
        "missed_ticks": slave.get("missed_ticks"),
        "late": slave.get("late"),
        "link": link,
        "safety": safety,
        "master_late": master.get("late"),
        "rendering": master.get("rendering"),
        "recorder": recorder,
        "privileges": list(privileges),
        "began_ns": began_ns,
    }
