"""The safety chain: which state the slave is in, and why it stopped."""

from __future__ import annotations

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.config_rig import LateConfig, Limits
from teleop_rt.realtime import lateness
from teleop_rt.realtime.lateness import ON_HARDWARE, Late, Lateness
from teleop_rt.slave import faults, hazards
from teleop_rt.slave.faults import Fault, State
from teleop_rt.slave.hazards import Demand, Patience

_NO_AXIS_FAULT = AxisFault.NONE
_POWERED = (faults.ARMED, faults.RUN, faults.HOLD)


class SafetyChain:
    """BOOT, SELFTEST, DISARMED, ARMED, RUN, HOLD, SAFE_STOP, FAULT; the first fault is kept.

    `late` judges lateness under power by the rig's bounds, and `on_hardware`, which has
    no effect, by the default bounds.
    """

    def __init__(self, limits: Limits, rate_hz: int, late: LateConfig = ON_HARDWARE) -> None:
        self._limits = limits
        self._rate_hz = rate_hz
        period_ns = round(1e9 / rate_hz)
        # Devices that stall with the machine, as simulated ones do, are waited for as the loop is.
        self._patience = Patience.at(rate_hz, late.stop_ms)
        self.late = Lateness(late, period_ns)
        self.on_hardware = Lateness(ON_HARDWARE, period_ns)
        self._started = False
        self._stopping_ticks = 0
        self.state = faults.BOOT
        self.fault: Fault = faults.NO_FAULT
        self.followings = self.holds = 0
        self.held_by = faults.FOLLOWS

    @property
    def powered(self) -> bool:
        """True where the axis follows commands; in every other state it gets stop commands."""
        return self.state in _POWERED

    def configured(self) -> None:
        """Leave BOOT for SELFTEST: the devices answered and are configured."""
        if self.state == faults.BOOT:
            self.state = faults.SELFTEST

    def selftest_passed(self) -> None:
        """Leave SELFTEST for DISARMED: a first valid sample has come."""
        if self.state == faults.SELFTEST:
            self.state = faults.DISARMED

    def arm(self) -> bool:
        """Leave DISARMED for ARMED; refused (false) in any other state."""
        if self.state != faults.DISARMED:
            return False
        self.late.reset()
        self.on_hardware.reset()
        self._started = False
        self.state = faults.ARMED
        return True

    def start(self) -> bool:
        """Let an armed axis follow the master; refused (false) where it is not armed."""
        if not self.powered:
            return False
        self._started = True
        return True

    def disarm(self) -> None:
        """Leave motion in good order for DISARMED; a fault stays what it is."""
        if self.powered:
            self.state = faults.DISARMED

    def reset(self) -> bool:
        """Leave FAULT for DISARMED, never for motion; refused (false) in any other state."""
        if self.state != faults.FAULT:
            return False
        self.state = faults.DISARMED
        self.fault = faults.NO_FAULT
        return True

    def stop(self, fault: Fault) -> None:
        """Stop for a reason; the first one is kept until a reset."""
        if self.state not in {faults.SAFE_STOP, faults.FAULT}:
            self.state = faults.SAFE_STOP
            self.fault = fault
            self._stopping_ticks = 0

    def check(self, sample: Sample, late_ns: int, *, motion: bool, homed: bool = True) -> State:
        """Advance by one cycle; `motion` is true while the master's motion is fresh.

        `late_ns` is how late the cycle began, whole periods for ticks that were skipped. An axis
        that is not `homed` yet stays armed, and its position cannot be compared with the limits.
        """
        if self.state == faults.SELFTEST and sample.valid:
            self.selftest_passed()
        if self.state == faults.SAFE_STOP:
            self._latch(sample)
        if self.powered:
            self._check_hazards(sample, late_ns, motion=motion, homed=homed)
        return self.state

    def _latch(self, sample: Sample) -> None:
        """Leave SAFE_STOP for FAULT once the drive is off, or has not said so for a second."""
        self._stopping_ticks += 1
        if not sample.enabled or self._stopping_ticks >= self._rate_hz:
            self.state = faults.FAULT

    def _check_hazards(self, sample: Sample, late_ns: int, *, motion: bool, homed: bool) -> None:
        lost = hazards.samples_lost(sample, self._patience)
        late = self.late.update(late_ns)
        if not self.on_hardware.stopped:
            self.on_hardware.update(late_ns)
        stop = self._reason_to_stop(sample, late, lost, homed=homed)
        if stop is not None:
            self.stop(stop)
            return
        if self.state == faults.ARMED and not (sample.enabled and homed and self._started):
            return
        before = self.state
        follows = motion and lost == hazards.NONE and late is lateness.IN_TIME
        self.state = faults.RUN if follows else faults.HOLD
        self.held_by = faults.held_by(
            lost=lost is not hazards.NONE, late=late is not lateness.IN_TIME, motion=motion
        )
        self.followings += before != faults.RUN and self.state == faults.RUN
        self.holds += before == faults.RUN and self.state == faults.HOLD

    def _reason_to_stop(
        self, sample: Sample, late: Late, lost: Demand, *, homed: bool
    ) -> Fault | None:
        """Return the fault of the first hazard that asks for a stop, None where none does.

        Lateness first: the devices' reports of our silence are its consequence.
        """
        if late is lateness.STOP:
            return faults.LATE_TICKS
        if sample.fault != _NO_AXIS_FAULT:
            return faults.of_axis(sample.fault)
        if lost is hazards.STOP:
            return faults.SAMPLES_LOST
        if hazards.force_exceeded(sample, self._limits) is hazards.STOP:
            return faults.FORCE_LIMIT
        if hazards.position_exceeded(sample, self._limits, homed=homed) is hazards.STOP:
            return faults.POSITION_LIMIT
        return None
