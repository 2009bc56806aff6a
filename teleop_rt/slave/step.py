"""The slave's decisions of a tick in one compiled step: from the inputs to the command and row.

Each rule is a small kernel in the module of its own; here they are called in their order.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from teleop_rt.axis import Sample, StoredSample
from teleop_rt.contact import detection
from teleop_rt.estimation import selection, watch
from teleop_rt.estimation import state as estimation
from teleop_rt.kernels.jit import kernel
from teleop_rt.link import intake
from teleop_rt.link import statistics as counted
from teleop_rt.link.bodies import NewestMotion, StoredMotion, StoredState, new_state
from teleop_rt.realtime.lateness import ON_HARDWARE, PERIOD_NS, Counts, Lateness, late_ns
from teleop_rt.realtime.row import NamedRow, StoredRow
from teleop_rt.signals import SLAVE
from teleop_rt.slave import coupling, faults
from teleop_rt.slave.catch_up import caught_up
from teleop_rt.slave.depth import depth_cap
from teleop_rt.slave.guard import guarded, retreated
from teleop_rt.slave.limiter import limit, stand_at
from teleop_rt.slave.pace import pace
from teleop_rt.slave.record import StoredTick, Tick, TickRecord
from teleop_rt.slave.reference import joins
from teleop_rt.slave.safety import check_safety, is_powered, stop
from teleop_rt.slave.supervision import disagreement, take_in, unpowered

CHECK, LEAD = range(2)
"""Where a step begins: at its start, or after the zeros have been advanced."""
ZEROS, STOP_DRIVE, STAND, FOLLOW = range(4)
"""The action to take: advance the zeros and go on, stop the drive, stand, or follow."""
_ARMED, _RUN, _HOLD = int(faults.ARMED), int(faults.RUN), int(faults.HOLD)
_MOST = np.uint64(2**63 - 1)
"""The largest contact that the record can hold: a master's own number may be larger."""
_NOWHERE_FREE = -1e299
"""The detector's word for no free space seen yet lies below it."""


@kernel
def look_at_contact(t: Tick, bank: estimation.BankState) -> None:
    """Take over the contact as the estimators see it, in encoder coordinates."""
    seen = bank.detector
    known = seen[detection.SURFACE_KNOWN] > 0.0
    t.in_contact, t.contact_id = seen[detection.IN_CONTACT] > 0.0, int(seen[detection.CONTACT_ID])
    t.surface = seen[detection.SURFACE] - t.surface_shift if known else math.nan
    t.surface_known = known
    t.velocity = bank.q[estimation.VELOCITY]
    free = seen[detection.VERIFIED_FREE] - t.surface_shift
    started = seen[detection.STARTED] > 0.0 and free > _NOWHERE_FREE and math.isfinite(free)
    t.verified_free = free if started else t.nothing_free
    t.rig_force = bank.q[estimation.RIG_FORCE]
    t.inadequate = bank.watch[watch.RAISED] > 0.0


@kernel
def hear(t: Tick, motion: Any) -> None:
    """Take over the master's newest motion; its own number of a contact may be any."""
    t.has_motion = motion.known
    if t.has_motion == 0:
        return
    t.lead, t.lead_velocity = motion.target, motion.velocity
    t.lead_force, t.lead_energy_J = motion.force, motion.energy_J
    t.acknowledged = min(motion.contact_id, _MOST)
    t.engaged, t.provisional = motion.engaged, motion.provisional


@kernel
def is_led(t: Tick) -> bool:
    """Return whether there is a motion of the master, fresh enough to be followed."""
    if t.has_motion == 0 or t.engaged == 0:
        return False
    return t.silence_ns * 1e-6 < t.hold_after_ms and joins(t)


@kernel
def supervise(t: Tick) -> None:
    """Stop where command, encoder, force sensor and drive do not agree under power."""
    if t.supervised == 0 or not is_powered(t.state):
        unpowered(t)
        return
    fault = disagreement(t, t.position - t.shift, t.written, t.state in (_RUN, _HOLD))
    if fault != 0:
        stop(t, fault)


@kernel
def followed(t: Tick) -> float:
    """Return where the master leads, as far as the guard lets it.

    Without a model the guard only draws back above the force cap: to wait for the wall that
    the master renders, or to know its depth, takes one.
    """
    if t.mode == coupling.MODEL:
        if t.following == 0 or t.waiting_for > 0:
            t.behind = 1
        target, deepest = caught_up(t, t.lead, t.lead_velocity, t.command), depth_cap(t)
        t.pace = pace(t, deepest)
        acknowledged, probing = t.acknowledged, t.provisional > 0 or math.isinf(deepest)
    else:
        if t.following == 0:
            coupling.couple(t)
        target, deepest = coupling.coupled(t), math.inf
        acknowledged, probing = t.contact_id, False
    return guarded(
        t,
        target,
        t.command,
        t.position,
        t.force,
        t.contact_id,
        acknowledged,
        t.surface,
        deepest,
        probing,
    )


@kernel
def aim(t: Tick) -> None:
    """Set the target: where the master leads, back to the surface, or where the axis stands."""
    t.pace = math.inf
    if t.state == _RUN:
        t.target = followed(t)
    elif t.state == _HOLD and t.silence_ns * 1e-6 > t.retreat_after_ms:
        t.target = retreated(t, t.command, t.surface)
    else:
        t.target = t.command
    t.following = t.state == _RUN


@kernel
def act(t: Tick) -> int:
    """Set the command; return the action to take with it."""
    if not is_powered(t.state):
        stand_at(t, t.position)
        return STOP_DRIVE
    if t.state == _ARMED and not (t.enabled > 0 and t.homed > 0):
        return STAND
    t.written = limit(t, t.target) - t.shift
    return FOLLOW


@kernel
def write_state(t: Tick, body: Any) -> None:
    """Write the body of the state that the master gets, without the force that the rig adds."""
    body.position, body.force = t.position, t.force - t.rig_force
    body.verified_free, body.velocity = t.verified_free, t.velocity
    body.energy_J, body.contact_id = t.energy_J, t.contact_id
    body.in_contact, body.following = t.in_contact > 0, t.following > 0
    body.safety_state, body.fault, body.inadequate = t.state, t.fault, t.inadequate > 0


@kernel
def write_row(t: Tick, bank: estimation.BankState, link: Counts, row: Any) -> None:
    """Write the step's results into the recorded row; `link` are the words of its statistics."""
    row.tick, row.stamp_ns, row.sample_stamp_ns = t.tick, t.now_ns, t.sample_stamp_ns
    row.valid = t.usable
    row.packets_received, row.packets_lost = link[counted.RECEIVED], link[counted.LOST]
    row.packets_rejected = link[counted.REFUSED]
    chosen = int(bank.choice[selection.SELECTED])
    row.position_age_ms = (t.now_ns - t.position_stamp_ns) * 1e-6
    row.force_age_ms = (t.now_ns - t.force_stamp_ns) * 1e-6
    row.position, row.force = t.position, t.force
    row.inadequate, row.rig_force = t.inadequate, t.rig_force
    row.filtered_force, row.velocity = bank.motion[estimation.MF], t.velocity
    row.in_contact, row.contact_id, row.surface = t.in_contact, t.contact_id, t.surface
    row.selected = chosen if chosen >= 0 else math.nan
    predicted = chosen >= 0 and t.in_contact > 0
    row.predicted_force = bank.records[chosen, selection.PREDICTED] if predicted else math.nan
    row.target, row.command = t.target, t.command
    row.state, row.missing = t.state, t.missing
    row.fault = t.fault
    if t.fault == 0 and t.axis_fault > 0:
        row.fault = faults.FIRST_OF_AXIS - 1 + t.axis_fault
    row.silence_ms = t.silence_ns * 1e-6
    row.followings, row.holds, row.held_by = t.followings, t.holds, t.held_by


@kernel
def decide(
    stored: StoredTick,
    samples: StoredSample,
    estimators: estimation.StateArray,
    late: Counts,
    on_hardware: Counts,
    link: Counts,
    end: Counts,
    motion: StoredMotion,
    rows: StoredRow,
    bodies: StoredState,
    stage: int,
) -> int:
    """Advance safety, supervision, guard and limiter by one cycle; return the action to take.

    `link` are the words of an end's statistics, and `end` its own.
    With ZEROS, `Reference.update` is to be called and the step to be resumed at LEAD.
    """
    t: Any = stored[0]
    if stage == CHECK:
        t.late_ns = late_ns(t.skipped, t.wake_latency_ns, late[PERIOD_NS])
        take_in(t, samples[0])
        look_at_contact(t, estimators[0])
        t.silence_ns = intake.silence_of(end, t.now_ns)
        hear(t, motion[0])
        t.led = is_led(t)
        if t.late_ns >= t.runs_out_ns:
            t.command_velocity = 0.0
        check_safety(t, late, on_hardware)
        if t.has_zeros > 0 and t.state not in (_RUN, _HOLD):
            return ZEROS
    supervise(t)
    t.calm = t.fault == 0 and t.axis_fault == 0 and t.state != _HOLD
    aim(t)
    action = act(t)
    write_row(t, estimators[0], link, rows[0])
    write_state(t, bodies[0])
    return action


def compile_step() -> None:
    """Compile the step, and the stop of the axis, into the cache, before a slave needs it."""
    late = Lateness(ON_HARDWARE, 1_000_000).record
    record, row, link = TickRecord(), NamedRow(SLAVE).stored, counted.Statistics().words
    motion, end = NewestMotion().stored, intake.new_words(0, 0)
    state, body = estimation.new_state()[0], new_state()
    decide(record.stored, Sample().stored, state, late, late, link, end, motion, row, body, LEAD)
    stand_at(record.tick, 0.0)
