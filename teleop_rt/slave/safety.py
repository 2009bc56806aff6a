"""The safety chain: which state the slave is in, and why it stopped."""

from __future__ import annotations

import math
from typing import cast

from teleop_rt.axis import Sample, SampleFields
from teleop_rt.config.realtime import LateConfig
from teleop_rt.config.rig import Limits
from teleop_rt.kernels.jit import kernel
from teleop_rt.realtime import lateness
from teleop_rt.realtime.lateness import ON_HARDWARE, Counts, Lateness
from teleop_rt.slave import faults, hazards
from teleop_rt.slave.faults import Fault, State
from teleop_rt.slave.hazards import Patience
from teleop_rt.slave.record import Tick, TickRecord, place
from teleop_rt.slave.supervision import take_in

_POWERED = (faults.ARMED, faults.RUN, faults.HOLD)
_STATES = tuple(State)
_STATE_AT, _FAULT_AT, _HELD_BY_AT = place("state"), place("fault"), place("held_by")
_FOLLOWINGS_AT, _HOLDS_AT = place("followings"), place("holds")
# For kernels, which know numbers alone: states, demands, reactions to lateness, faults.
_SELFTEST, _DISARMED, _ARMED, _RUN, _HOLD, _SAFE_STOP, _FAULT = range(1, 8)
_NONE, _STOP = int(hazards.Demand.NONE), int(hazards.Demand.STOP)
_IN_TIME, _LATE_STOP = int(lateness.IN_TIME), int(lateness.LATE_STOP)
_LATE_TICKS, _SAMPLES_LOST = faults.LATE_TICKS.code, faults.SAMPLES_LOST.code
_FORCE_LIMIT, _POSITION_LIMIT = faults.FORCE_LIMIT.code, faults.POSITION_LIMIT.code
_FORCE_INVALID, _POSITION_INVALID = faults.FORCE_INVALID.code, faults.POSITION_INVALID.code


@kernel
def _held_by(lost: bool, late: bool, motion: bool) -> int:
    """Return the code of the obstacle to following; of several, that of the nearest."""
    if lost:
        return faults.STALE_SAMPLE
    if late:
        return faults.LATE_LOOP
    return faults.FOLLOWS if motion else faults.NO_MOTION


@kernel
def is_powered(state: int) -> bool:
    """Return whether the axis follows commands; in every other state it gets stop commands."""
    return state in (_ARMED, _RUN, _HOLD)


@kernel
def stop(tick: Tick, fault: int) -> None:
    """Stop for a reason; the first one is kept until a reset."""
    if tick.state not in (_SAFE_STOP, _FAULT):
        tick.state = _SAFE_STOP
        tick.fault = fault
        tick.stopping_ticks = 0


@kernel
def latch(tick: Tick) -> None:
    """Leave SAFE_STOP for FAULT once the drive is off, or has not said so for a second."""
    tick.stopping_ticks += 1
    if tick.enabled == 0 or tick.stopping_ticks >= tick.rate_hz:
        tick.state = _FAULT


@kernel
def reason_to_stop(tick: Tick, late: int, lost: int) -> int:
    """Return the fault of the first hazard that asks for a stop, 0 where none does.

    Lateness first: the devices' reports of our silence are its consequence.
    """
    if late == _LATE_STOP:
        return _LATE_TICKS
    if tick.axis_fault != 0:
        return faults.FIRST_OF_AXIS - 1 + tick.axis_fault
    if lost == _STOP:
        return _SAMPLES_LOST
    if hazards.force_exceeded(tick.force, tick.force_max) == _STOP:
        return _FORCE_LIMIT if math.isfinite(tick.force) else _FORCE_INVALID
    ends = tick.position_min, tick.position_max
    if hazards.position_exceeded(tick.position, *ends, tick.homed > 0) == _STOP:
        return _POSITION_LIMIT if math.isfinite(tick.position) else _POSITION_INVALID
    return 0


@kernel
def check_hazards(tick: Tick, late_record: Counts, on_hardware: Counts) -> None:
    """Stop for the first hazard, else follow or hold."""
    lost = hazards.samples_lost(tick.missing, tick.hold_missing, tick.stop_missing)
    late = lateness.judge_lateness(late_record, tick.late_ns)
    if on_hardware[lateness.STOPPED_AFTER] < 0:
        lateness.judge_lateness(on_hardware, tick.late_ns)
    fault = reason_to_stop(tick, late, lost)
    if fault != 0:
        stop(tick, fault)
        return
    if tick.state == _ARMED and not (tick.enabled > 0 and tick.homed > 0 and tick.started > 0):
        return
    before = tick.state
    in_time, motion = late == _IN_TIME, tick.led > 0
    tick.state = _RUN if motion and lost == _NONE and in_time else _HOLD
    tick.held_by = _held_by(lost != _NONE, not in_time, motion)
    if before != _RUN and tick.state == _RUN:
        tick.followings += 1
    if before == _RUN and tick.state == _HOLD:
        tick.holds += 1


@kernel
def check_safety(tick: Tick, late_record: Counts, on_hardware: Counts) -> None:
    """Advance the chain by one cycle: see `SafetyChain.check`."""
    if tick.state == _SELFTEST and tick.valid > 0:
        tick.state = _DISARMED
    if tick.state == _SAFE_STOP:
        latch(tick)
    if is_powered(tick.state):
        check_hazards(tick, late_record, on_hardware)


class SafetyChain:
    """BOOT, SELFTEST, DISARMED, ARMED, RUN, HOLD, SAFE_STOP, FAULT; the first fault is kept.

    `late` judges lateness under power by the rig's bounds, and `on_hardware`, which has
    no effect, by the default bounds.
    """

    def __init__(
        self,
        limits: Limits,
        rate_hz: int,
        late: LateConfig = ON_HARDWARE,
        record: TickRecord | None = None,
    ) -> None:
        record = record or TickRecord()
        self._tick = tick = record.tick
        self._counts = record.counts
        period_ns = round(1e9 / rate_hz)
        # Devices that stall with the machine, as simulated ones do, are waited for as the loop is.
        patience = Patience.at(rate_hz, late.stop_ms)
        tick.hold_missing, tick.stop_missing = patience.hold, patience.stop
        tick.position_min, tick.position_max = limits.position_min, limits.position_max
        tick.force_max, tick.rate_hz = limits.force_max, rate_hz
        self.late = Lateness(late, period_ns)
        self.on_hardware = Lateness(ON_HARDWARE, period_ns)

    @property
    def state(self) -> State:
        """The state of the chain."""
        return _STATES[self._counts[_STATE_AT]]

    @property
    def fault(self) -> Fault:
        """Why it stopped, kept until a reset."""
        return faults.FAULTS[self._counts[_FAULT_AT]]

    @property
    def patience_ms(self) -> float:
        """For how long there may be no usable sample before the axis stops [ms]."""
        return 1e3 * self._tick.stop_missing / self._tick.rate_hz

    @property
    def followings(self) -> int:
        """How often the axis began to follow."""
        return self._counts[_FOLLOWINGS_AT]

    @property
    def holds(self) -> int:
        """How often the axis stopped following, and held."""
        return self._counts[_HOLDS_AT]

    @property
    def held_by(self) -> int:
        """The code of the reason for which the axis last held."""
        return self._counts[_HELD_BY_AT]

    @property
    def powered(self) -> bool:
        """True where the axis follows commands; in every other state it gets stop commands."""
        return self.state in _POWERED

    def configured(self) -> None:
        """Leave BOOT for SELFTEST: the devices answered and are configured."""
        if self.state == faults.BOOT:
            self._tick.state = faults.SELFTEST

    def arm(self) -> bool:
        """Leave DISARMED for ARMED; refused (false) in any other state."""
        if self.state != faults.DISARMED:
            return False
        self.late.reset()
        self.on_hardware.reset()
        self._tick.started = 0
        self._tick.state = faults.ARMED
        return True

    def start(self) -> bool:
        """Let an armed axis follow the master; refused (false) where it is not armed."""
        if not self.powered:
            return False
        self._tick.started = 1
        return True

    def disarm(self) -> None:
        """Leave motion in good order for DISARMED; a fault stays."""
        if self.powered:
            self._tick.state = faults.DISARMED

    def reset(self) -> bool:
        """Leave FAULT for DISARMED, never for motion; refused (false) in any other state."""
        if self.state != faults.FAULT:
            return False
        self._tick.state = faults.DISARMED
        self._tick.fault = faults.NO_FAULT.code
        return True

    def stop(self, fault: Fault) -> None:
        """Stop for a reason; the first one is kept until a reset."""
        stop(self._tick, fault.code)

    def check(self, sample: Sample, late_ns: int, *, motion: bool, homed: bool = True) -> State:
        """Advance by one cycle; `motion` is true while the master's motion is fresh.

        `late_ns` is how late the cycle began, whole periods for ticks that were skipped. An axis
        that is not `homed` yet stays armed, and its position cannot be compared with the limits.
        """
        tick = self._tick
        take_in(tick, cast("SampleFields", sample.stored[0]))
        tick.late_ns, tick.led, tick.homed = late_ns, motion, homed
        check_safety(tick, self.late.record, self.on_hardware.record)
        return self.state
