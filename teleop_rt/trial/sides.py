"""Build slave and master of a trial from its config, for either clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.axis import Axis, AxisFault
from teleop_rt.config.trial import TrialConfig
from teleop_rt.link.channel import Endpoint, Role
from teleop_rt.link.impairment import ImpairedTransport, Impairment
from teleop_rt.link.keys import PeerKeys
from teleop_rt.link.statistics import OVERTAKEN
from teleop_rt.link.transport import Transport
from teleop_rt.realtime.ring_folder import publish
from teleop_rt.signals import SLAVE, SLAVE_TOPIC
from teleop_rt.slave.estimate_log import EstimateLog
from teleop_rt.slave.faults import (
    DRIVE_SILENT,
    DRIVER,
    LATE_TICKS,
    SAMPLES_LOST,
    Fault,
    of_axis,
)
from teleop_rt.slave.simulated_advice import next_step_of
from teleop_rt.slave.slave import Slave
from teleop_rt.trial.estimators import make_pipeline
from teleop_rt.trial.late import cause, late_outcome

_STREAMS: dict[Role, int] = {"slave": 1, "master": 2}


def make_endpoint(
    role: Role,
    trial: TrialConfig,
    transport: Transport,
    keys: PeerKeys,
    now_ns: Callable[[], int],
) -> Endpoint:
    """Return one end of the link, with the trial's impairment on its packets."""
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
    ring_folder: Path,
    *,
    measure_work: bool,
    log_estimates: bool = True,
) -> Slave:
    """Return the slave, with its rings published in their folder. Compiles the estimators."""
    pipeline = make_pipeline(trial)
    return Slave(
        trial,
        axis,
        endpoint,
        pipeline,
        now_ns,
        publish(ring_folder, SLAVE_TOPIC, SLAVE),
        EstimateLog(pipeline, partial(publish, ring_folder)) if log_estimates else None,
        measure_work=measure_work,
    )


def link_outcome(endpoint: Endpoint) -> dict[str, Any]:
    """Return the counts of an end of the link; an overtaken packet came after a newer one."""
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


def _behind(slave: Slave) -> Fault:
    """Return the slave's fault, or the one behind it: with a device lost, no drive is enabled."""
    if slave.fault is DRIVE_SILENT and slave.sample.fault is AxisFault.DEVICE_LOST:
        return of_axis(AxisFault.DEVICE_LOST)
    return slave.fault


def _cause(slave: Slave, fault: Fault) -> str:
    """Return the cause of a fault, with the bound that was in force."""
    if fault is not SAMPLES_LOST:
        return fault.cause
    return f"no usable sample of position and force for {slave.safety.patience_ms:.3g} ms"


def slave_outcome(
    slave: Slave, endpoint: Endpoint, if_late: str = "", *, simulated: bool
) -> dict[str, Any]:
    """Return the counts of the slave's side, for the summary.

    `if_late` is the advice for this machine's loop where lateness stopped it; `simulated` says
    whether the rig is.
    """
    fault, late = slave.fault, late_outcome(slave.safety)
    by_lateness = fault is LATE_TICKS and late["stop"] is not None
    behind = _behind(slave)
    said = slave.stopped.said if fault in (DRIVER, SAMPLES_LOST) else slave.sample.complaint
    return {
        "link": link_outcome(endpoint),
        "missed_ticks": slave.missed_ticks,
        "late": late,
        "safety": {
            "state": slave.safety.state.name,
            "fault": {
                "code": fault.code,
                "name": fault.name,
                "cause": cause(late) if by_lateness else _cause(slave, behind),
                "next_step": (if_late if by_lateness else "")
                or next_step_of(behind, simulated=simulated),
                "said": said or None,
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
    *,
    interrupted: bool = False,
) -> dict[str, Any]:
    """Return the outcome of a run of both sides, with the link as seen by the slave.

    Refused packets are those of both ends.

    `privileges` are those granted or refused to the slave's process; `began_ns` when the
    command was given, on the clock of the recording's stamps; `interrupted` whether somebody ended
    the run before its time.
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
        "interrupted": interrupted,
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
