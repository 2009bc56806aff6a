"""The parts that check the samples of a tick and limit its command, built over its record."""

from __future__ import annotations

import math
from typing import NamedTuple

from teleop_rt.config.trial import TrialConfig
from teleop_rt.slave.catch_up import CatchUp
from teleop_rt.slave.coupling import set_coupling
from teleop_rt.slave.guard import ContactGuard
from teleop_rt.slave.limiter import Limiter
from teleop_rt.slave.pace import latency_s, unknown_speed
from teleop_rt.slave.record import TickRecord
from teleop_rt.slave.reference import Reference
from teleop_rt.slave.safety import SafetyChain
from teleop_rt.slave.supervision import Supervision


class Protection(NamedTuple):
    """The parts in the order in which a tick asks them."""

    safety: SafetyChain
    supervision: Supervision
    reference: Reference
    guard: ContactGuard
    limiter: Limiter


def protect(trial: TrialConfig, record: TickRecord) -> Protection:
    """Return the parts for a trial; each writes its settings into the record."""
    rig, period_s = trial.rig, trial.rig.period_ns * 1e-9
    cap, stiffest = trial.slave.force_cap, rig.limits.stiffness_max
    guard = ContactGuard(
        cap,
        trial.slave.retreat_speed,
        rig.limits.position_max - rig.limits.position_min,
        period_s,
        record,
        acceleration=rig.limits.acceleration_max,
        unknown_speed=math.inf if stiffest is None else unknown_speed(rig, cap, stiffest),
        stiffest=stiffest or math.inf,
        late_s=latency_s(rig),
    )
    CatchUp(trial.slave.retreat_speed, period_s, record)
    parts = Protection(
        SafetyChain(rig.limits, rig.rate_hz, rig.realtime.late, record),
        Supervision(
            rig.supervision, rig.limits, rig.rate_hz, rig.axis.unsafe(), record,
            rig.sensors.position_resolution,
        ),
        Reference(rig.reference, rig.limits, period_s, record),
        guard,
        Limiter(rig.limits, period_s, record),
    )  # fmt: skip
    _write_settings(trial, record)
    return parts


def _write_settings(trial: TrialConfig, record: TickRecord) -> None:
    """Write the fields of a tick's record that none of the parts writes."""
    tick, rig = record.tick, trial.rig
    set_coupling(tick, trial.mode, trial.coupling)
    # A drive has run its last command out by then, or the axis holds before.
    tick.runs_out_ns = min(rig.period_ns, round(rig.realtime.late.hold_ms * 1e6))
    tick.hold_after_ms = trial.slave.hold_after_ms
    tick.retreat_after_ms = trial.slave.retreat_after_ms
    tick.nothing_free = rig.limits.position_min
    tick.supervised = rig.axis.executes
    tick.target = tick.written = math.nan
