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
from teleop_rt.link.bodies import NewestMotion, StoredMotion, StoredState, new_state_body
from teleop_rt.link.peer_clock import FIXED, PeerClock
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
NO_INPUTS = 0, 0, 0, 0, False, 0.0, False
"""In place of a tick's inputs, where the step is resumed."""
ZEROS, STOP_DRIVE, STAND, FOLLOW = range(4)
"""The action to take: advance the zeros and go on, stop the drive, stand, or follow."""
HOLD_CLOCK = 1 << 2
"""Bit of an action: the state of the link is to be held first, for the master leads."""
_ARMED, _RUN, _HOLD = int(faults.ARMED), int(faults.RUN), int(faults.HOLD)
_MOST = np.uint64(2**63 - 1)
"""The largest contact that the record can hold: a master's own number may be larger."""
_NOWHERE_FREE = -1e299
"""The detector's word for no free space seen yet lies below it."""


@kernel
def look_at_contact(tick: Tick, bank: estimation.BankState) -> None:
    """Take over the contact as the estimators see it, in encoder coordinates."""
    seen = bank.detector
    known = seen[detection.SURFACE_KNOWN] > 0.0
    tick.in_contact = seen[detection.IN_CONTACT] > 0.0
    tick.contact_id = int(seen[detection.CONTACT_ID])
    tick.surface = seen[detection.SURFACE] - tick.surface_shift if known else math.nan
    variance = detection.surface_variance(seen, False)  # noqa: FBT003 - a kernel takes no keyword
    tick.surface_deviation = math.sqrt(variance) if known else math.nan
    tick.surface_known = known
    tick.velocity = bank.q[estimation.VELOCITY]
    free = seen[detection.VERIFIED_FREE] - tick.surface_shift
    started = seen[detection.STARTED] > 0.0 and free > _NOWHERE_FREE and math.isfinite(free)
    tick.verified_free = free if started else tick.nothing_free
    tick.rig_force = bank.q[estimation.RIG_FORCE]
    tick.inadequate = bank.watch[watch.RAISED] > 0.0


@kernel
def read_motion(tick: Tick, motion: Any) -> None:
    """Take over the master's newest motion; its own number of a contact may be any."""
    tick.has_motion, tick.faulted = motion.known, 0
    if tick.has_motion == 0:
        return
    tick.lead, tick.lead_velocity = motion.target, motion.velocity
    tick.lead_force, tick.lead_energy_J = motion.force, motion.energy_J
    tick.acknowledged = min(motion.contact_id, _MOST)
    tick.engaged, tick.provisional = motion.engaged, motion.provisional
    tick.faulted = motion.faulted


@kernel
def is_led(tick: Tick) -> bool:
    """Return whether there is a motion of the master, fresh enough to be followed."""
    if tick.has_motion == 0 or tick.engaged == 0:
        return False
    return tick.silence_ns * 1e-6 < tick.hold_after_ms and joins(tick)


@kernel
def note_who_leads(tick: Tick) -> None:
    """Set whether the master leads, and when it last did; before a start nobody waits for it."""
    tick.led = is_led(tick)
    if tick.led > 0 or tick.state not in (_RUN, _HOLD):
        tick.led_stamp_ns = tick.now_ns


@kernel
def is_abandoned(tick: Tick) -> bool:
    """Return whether the tool is to draw back: for too long the master is silent, or leads no more.

    A master that has declutched still sends, and may lead again. One whose device was let go does
    not until it is started again: its tool draws back at once.
    """
    if tick.faulted > 0:
        return True
    alone_ns = max(tick.silence_ns, tick.now_ns - tick.led_stamp_ns)
    return alone_ns * 1e-6 > tick.retreat_after_ms


@kernel
def supervise(tick: Tick) -> None:
    """Stop where command, encoder, force sensor and drive do not agree under power."""
    if tick.supervised == 0 or not is_powered(tick.state):
        unpowered(tick)
        return
    moves = tick.state in (_RUN, _HOLD)
    fault = disagreement(tick, tick.position - tick.shift, tick.written, moves)
    if fault != 0:
        stop(tick, fault)


@kernel
def followed(tick: Tick) -> float:
    """Return where the master leads, as far as the guard lets it.

    Without a model the guard only draws back above the force cap: to wait for the wall that
    the master renders, or to know its depth, takes one.
    """
    if tick.mode == coupling.MODEL:
        if tick.following == 0 or tick.waiting_for > 0:
            tick.behind = 1
        target = caught_up(tick, tick.lead, tick.lead_velocity, tick.command)
        deepest = depth_cap(tick)
        tick.pace = pace(tick, deepest)
        acknowledged, probing = tick.acknowledged, tick.provisional > 0 or math.isinf(deepest)
    else:
        if tick.following == 0:
            coupling.couple(tick)
        target, deepest = coupling.coupled(tick), math.inf
        acknowledged, probing = tick.contact_id, False
    return guarded(
        tick,
        target,
        tick.command,
        tick.position,
        tick.force,
        tick.contact_id,
        acknowledged,
        tick.surface,
        deepest,
        probing,
    )


@kernel
def aim(tick: Tick) -> None:
    """Set the target: where the master leads, back to the surface, or where the axis stands."""
    tick.pace = math.inf
    if tick.state == _RUN:
        tick.target = followed(tick)
    elif tick.state == _HOLD and is_abandoned(tick):
        tick.target = retreated(tick, tick.command, tick.surface)
    else:
        tick.target = tick.command
    tick.following = tick.state == _RUN


@kernel
def act(tick: Tick) -> int:
    """Set the command; return the action to take with it."""
    if not is_powered(tick.state):
        stand_at(tick, tick.position)
        return STOP_DRIVE
    if tick.state == _ARMED and not (tick.enabled > 0 and tick.homed > 0):
        return STAND
    tick.written = limit(tick, tick.target) - tick.shift
    return FOLLOW


@kernel
def prepared(tick: Tick, clock: Counts, action: int) -> int:
    """Return an action with HOLD_CLOCK where the master leads and its clock is not fixed."""
    holds = action != STOP_DRIVE and tick.led > 0 and clock[FIXED] == 0
    return action | HOLD_CLOCK if holds else action


@kernel
def write_state(tick: Tick, body: Any) -> None:
    """Write the body of the state that the master gets, without the force that the rig adds."""
    body.position, body.force = tick.position, tick.force - tick.rig_force
    body.verified_free, body.velocity = tick.verified_free, tick.velocity
    body.energy_J, body.contact_id = tick.energy_J, tick.contact_id
    body.in_contact, body.following = tick.in_contact > 0, tick.following > 0
    body.safety_state, body.fault, body.inadequate = tick.state, tick.fault, tick.inadequate > 0


@kernel
def write_row(tick: Tick, bank: estimation.BankState, link: Counts, row: Any) -> None:
    """Write the step's results into the recorded row; `link` are the words of its statistics."""
    row.tick, row.stamp_ns, row.sample_stamp_ns = tick.tick, tick.now_ns, tick.sample_stamp_ns
    row.valid = tick.usable
    row.packets_received, row.packets_lost = link[counted.RECEIVED], link[counted.LOST]
    row.packets_rejected = link[counted.REFUSED]
    chosen = int(bank.choice[selection.SELECTED])
    row.position_age_ms = (tick.now_ns - tick.position_stamp_ns) * 1e-6
    row.force_age_ms = (tick.now_ns - tick.force_stamp_ns) * 1e-6
    row.position, row.force = tick.position, tick.force
    row.inadequate, row.rig_force = tick.inadequate, tick.rig_force
    row.filtered_force, row.velocity = bank.motion[estimation.MF], tick.velocity
    row.in_contact, row.contact_id, row.surface = tick.in_contact, tick.contact_id, tick.surface
    row.surface_deviation = tick.surface_deviation
    row.selected = chosen if chosen >= 0 else math.nan
    predicted = chosen >= 0 and tick.in_contact > 0
    row.predicted_force = bank.records[chosen, selection.PREDICTED] if predicted else math.nan
    row.target, row.command = tick.target, tick.command
    row.state, row.missing = tick.state, tick.missing
    row.fault = tick.fault
    if tick.fault == 0 and tick.axis_fault > 0:
        row.fault = faults.FIRST_OF_AXIS - 1 + tick.axis_fault
    row.silence_ms = tick.silence_ns * 1e-6
    row.followings, row.holds, row.held_by = tick.followings, tick.holds, tick.held_by


@kernel
def decide(
    stored: StoredTick,
    samples: StoredSample,
    estimators: estimation.StateArray,
    late: Counts,
    on_hardware: Counts,
    link: Counts,
    end: Counts,
    clock: Counts,
    motion: StoredMotion,
    rows: StoredRow,
    bodies: StoredState,
    stage: int,
    number: int,
    now_ns: int,
    skipped: int,
    wake_latency_ns: int,
    ready: bool,
    surface_shift: float,
    homed: bool,
) -> int:
    """Advance safety, supervision, guard and limiter by one cycle; return the action to take.

    `link` are the words of an end's statistics, `end` its own, and `clock` those of its peer's
    clock; the action has the bit HOLD_CLOCK while that is not fixed. The arguments after the stage
    are the inputs of the tick of this number; LEAD takes those of CHECK, whatever it is given.
    With ZEROS, `Reference.update` is to be called and the step to be resumed at LEAD.
    """
    tick: Any = stored[0]
    if stage == CHECK:
        tick.tick, tick.now_ns, tick.skipped = number, now_ns, skipped
        tick.wake_latency_ns = wake_latency_ns
        tick.ready, tick.surface_shift, tick.homed = ready, surface_shift, homed
        tick.late_ns = late_ns(tick.skipped, tick.wake_latency_ns, late[PERIOD_NS])
        take_in(tick, samples[0])
        look_at_contact(tick, estimators[0])
        tick.silence_ns = intake.silence_of(end, tick.now_ns)
        read_motion(tick, motion[0])
        note_who_leads(tick)
        if tick.late_ns >= tick.runs_out_ns:
            tick.command_velocity = 0.0
        check_safety(tick, late, on_hardware)
        if tick.has_zeros > 0 and tick.state not in (_RUN, _HOLD):
            return ZEROS
    supervise(tick)
    tick.calm = tick.fault == 0 and tick.axis_fault == 0 and tick.state != _HOLD
    aim(tick)
    action = act(tick)
    write_row(tick, estimators[0], link, rows[0])
    write_state(tick, bodies[0])
    return prepared(tick, clock, action)


def compile_step() -> None:
    """Compile the step, and the stop of the axis, into the cache, before a slave needs it."""
    late = Lateness(ON_HARDWARE, 1_000_000).record
    record, row, link = TickRecord(), NamedRow(SLAVE).stored, counted.Statistics().words
    motion, end, clock = NewestMotion().stored, intake.new_words(0, 0), PeerClock().words
    state, body = estimation.new_state()[0], new_state_body()
    ends = link, end, clock, motion
    arrays = record.stored, Sample().stored, state, late, late, *ends, row, body
    decide(*arrays, LEAD, *NO_INPUTS)
    stand_at(record.tick, 0.0)
