"""The slave's cycle: sense, decide, act."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.axis import Axis, AxisError, AxisFault, EndOfRecording, Sample
from teleop_rt.config.trial import TrialConfig
from teleop_rt.estimation.contact_found import Contact
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.kernels.jit import bound
from teleop_rt.link.bodies import new_state_body
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.messages import Kind
from teleop_rt.realtime.ring import RingWriter
from teleop_rt.realtime.row import NamedRow
from teleop_rt.signals import SLAVE, columns
from teleop_rt.slave import driver_error, faults
from teleop_rt.slave.estimate_log import EstimateLog
from teleop_rt.slave.feed import feed_of
from teleop_rt.slave.model_sender import ModelSender
from teleop_rt.slave.protection import protect
from teleop_rt.slave.record import TickRecord, place
from teleop_rt.slave.recorded_row import row_recorder
from teleop_rt.slave.step import (
    CHECK,
    FOLLOW,
    HOLD_CLOCK,
    LEAD,
    NO_INPUTS,
    STOP_DRIVE,
    ZEROS,
    decide,
)

# Where the fields that this module reads one by one are in the record of a tick.
_LATE, _RUNS_OUT = place("late_ns"), place("runs_out_ns")
_POSITION, _WRITTEN = place("position"), place("written")
_CALM = place("calm")
_KIND = Kind.STATE
_HOLDS = frozenset({faults.ARMED, faults.RUN, faults.HOLD})

_COLUMN = columns(SLAVE)
_COMMAND_COLUMN = _COLUMN["command"]


class Slave:
    """One axis in contact with an unknown object, led by a master.

    `cycle()` is one tick. Everything it needs is allocated here; it never blocks.
    """

    def __init__(
        self,
        trial: TrialConfig,
        axis: Axis,
        endpoint: Endpoint,
        pipeline: Pipeline,
        now_ns: Callable[[], int],
        row_ring: RingWriter,
        estimate_log: EstimateLog | None,
        *,
        measure_work: bool,
    ) -> None:
        rig = trial.rig
        self._axis = axis
        self._endpoint = endpoint
        self._pipeline = pipeline
        self._shifts = pipeline.shifts
        self._now_ns = now_ns
        self._row_ring = row_ring
        self._estimate_log = estimate_log
        self._log_next = None if estimate_log is None else estimate_log.turns
        self._measure_work = measure_work
        self._sample = Sample()
        self._feed = feed_of(pipeline, rig.period_ns, self._sample)
        self.record = record = TickRecord()
        self._floats, self._counts = record.floats, record.counts
        self._allocate_outputs()
        self._models = models = ModelSender(
            pipeline.streaming, endpoint, rig.sensors.force_noise, trial.slave.force_cap,
            trial.link, now_ns, record,
        )  # fmt: skip
        self._record_row = row_recorder(row_ring, self._row, models.stored)
        parts = protect(trial, record)
        self.limiter, self.guard, self.safety = parts.limiter, parts.guard, parts.safety
        self.supervision, self.reference = parts.supervision, parts.reference
        self._has_zeros = self.reference.used
        self.unsafe = rig.unsafe
        self.tick = 0
        self.missed_ticks = 0
        self._stamp_ns = 0
        self._force_from_drive = rig.axis.force_from_drive
        self.stopped = faults.NOT_STOPPED
        self._raised = driver_error.NONE_RAISED
        self._work_us = math.nan
        self._bind_step()

    def _allocate_outputs(self) -> None:
        """Allocate a tick's outputs: its recorded row and the message on its state."""
        self._row = NamedRow(SLAVE)
        self._columns = self._row.values
        self._body = new_state_body()
        self._body_bytes = self._body.view(np.uint8).data

    def _bind_step(self) -> None:
        """Bind the compiled step to its arrays, and run it once: no tick compiles or loads it."""
        self._decide = bound(decide, self._arrays(), CHECK, *NO_INPUTS)
        self._decide(CHECK, *NO_INPUTS[:-1], self.reference.homed)
        self.record.tick.invalid_in_a_row = 0
        self.limiter.reset(self.limiter.position)

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        """Return the arrays of `decide`, in the order of its arguments."""
        return (
            self.record.stored,
            self._sample.stored,
            self._pipeline.stored,
            self.safety.late.record,
            self.safety.on_hardware.record,
            self._endpoint.statistics.words,
            self._endpoint.words,
            self._endpoint.clock.words,
            self._endpoint.newest_motion.stored,
            self._row.stored,
            self._body,
        )

    @property
    def sample(self) -> Sample:
        """The newest sample."""
        return self._sample

    @property
    def fault(self) -> faults.Fault:
        """Why the axis was stopped; while nothing moves, why it cannot be armed."""
        latched = self.safety.fault
        return faults.of_axis(self._sample.fault) if latched is faults.NO_FAULT else latched

    @property
    def commands_limited(self) -> int:
        """How many commands the last stage had to change."""
        return self.limiter.limited

    @property
    def work_us(self) -> float:
        """How long the last cycle worked [us]; not-a-number where it is not measured."""
        return self._work_us

    @property
    def models_sent(self) -> int:
        """How many messages carried a model."""
        return self._models.models_sent

    def close(self) -> None:
        """Close the rings for their readers."""
        self._row_ring.close()
        if self._estimate_log is not None:
            self._estimate_log.close()

    def configure(self) -> None:
        """Find and configure the devices; nothing moves. Raises AxisError."""
        self._axis.configure()
        self._endpoint.forget_waiting()
        self.safety.configured()

    def arm(self, *, start: bool = True) -> bool:
        """Arm the axis at its present position; false where state or tare do not allow it yet.

        It holds there until it is started, at once or by `safety.start()`, and then follows the
        master. Raises AxisError where the axis refuses; nothing is armed then.
        """
        if self.safety.state != faults.DISARMED or not self.reference.tared:
            return False
        if (fault := faults.of_axis(self._sample.fault)) is not faults.NO_FAULT:
            raise AxisError(f"cannot arm: {fault.name}: {fault.cause}; {fault.next_step}")
        self._axis.arm()
        self.limiter.reset(self._sample.position)
        self._endpoint.fix_clock()
        self.safety.arm()
        if start:
            self.safety.start()
        return True

    @property
    def resettable(self) -> bool:
        """Whether a reset is of use: a fault is latched, here or, while disarmed, in the axis."""
        disarmed = self.safety.state in {faults.SELFTEST, faults.DISARMED}
        lost = disarmed and self._sample.fault != AxisFault.NONE
        return lost or self.safety.state == faults.FAULT

    def reset(self) -> bool:
        """Configure the devices again and be DISARMED; false where there is nothing to reset.

        It takes as long as the devices do, so it comes between two loops. Raises AxisError.
        """
        if not self.resettable:
            return False
        self._axis.configure()
        self._endpoint.forget_waiting()
        self.guard.reset()
        self.safety.reset()
        self._raised = driver_error.NONE_RAISED
        return True

    @property
    def contact(self) -> Contact:
        """The contact as the estimators see it."""
        return self._pipeline.contact

    def cycle(self, skipped: int = 0, wake_latency_ns: int = 0) -> None:
        """Run one tick; `skipped` ticks were missed before it."""
        started_ns = time.perf_counter_ns() if self._measure_work else 0
        self.tick += 1 + skipped
        self.missed_ticks += skipped
        ready = self._sense()
        shift = self._pipeline.shift if self._shifts else 0.0
        action = self._decide(
            CHECK, self.tick, self._stamp_ns, skipped, wake_latency_ns, ready, shift,
            self.reference.homed,
        )  # fmt: skip
        if action != FOLLOW:
            if action == ZEROS:
                action = self._advance_zeros()
            action = self._hold_clock(action)
        self._act(action)
        last = self.stopped
        if not (
            self._counts[_CALM]
            and last.fault is faults.NO_FAULT
            and self._sample.complaint == last.said
        ):  # seldom
            self._note_fault()
        self._write_row(wake_latency_ns)
        if self._measure_work:
            self._work_us = (time.perf_counter_ns() - started_ns) * 1e-3

    def stop(self, fault: faults.Fault) -> None:
        """Stop the axis for a reason; may be called from outside the cycle."""
        self.safety.stop(fault)
        self._stop_axis()

    def disarm(self) -> None:
        """Stop the axis in good order, at the end of a trial."""
        self.safety.disarm()
        self._stop_axis()

    def _stop_axis(self) -> None:
        """Stop the axis, and stand in a fault where its driver raises: the loop goes on."""
        try:
            self._axis.stop()
        except Exception as error:  # noqa: BLE001 - whatever another's driver raises
            self._driver_raised(error)

    def _sense(self) -> bool:
        """Take in all news; return whether the sample counts: its zeros are known."""
        sample = self._sample
        try:
            self._axis.read_into(sample)
        except EndOfRecording:
            raise
        except Exception as error:  # noqa: BLE001 - whatever another's driver raises
            self._driver_raised(error)
        if self._has_zeros:
            self.reference.apply(sample)
        self._stamp_ns = self._now_ns()
        self._endpoint.poll()
        # Most rigs have neither zeros to find nor a force from the drive: no calls for those.
        ready = (not self._has_zeros or self.reference.ready) and (
            not self._force_from_drive or self._is_of_contact(sample)
        )
        self._feed(ready)
        return ready

    def _is_of_contact(self, sample: Sample) -> bool:
        """Return whether a drive's own force is that of contact: not once it lets go."""
        return sample.enabled and self.safety.state in _HOLDS

    def _advance_zeros(self) -> int:
        """Advance tare and homing between the checks and the rest of the step."""
        if self._counts[_LATE] >= self._counts[_RUNS_OUT]:
            self.reference.stand()
        refused = self.reference.update(self.safety.state, self._sample)
        if refused is not None:
            self.safety.stop(refused)
        self._floats[_POSITION] = self._sample.position
        return self._decide(LEAD, *NO_INPUTS)

    def _hold_clock(self, action: int) -> int:
        """Keep the link's state at arming, or at the first motion led, until the axis is off.

        A link that could become slower while the axis follows would let old motion pass for news.
        Return the action without its bit.
        """
        if action == STOP_DRIVE:
            self._endpoint.clock.release()
        elif action & HOLD_CLOCK:
            self._endpoint.fix_clock()
        return action & ~HOLD_CLOCK

    def _driver_raised(self, error: Exception) -> None:
        """Stop for an error of the driver, which gave no sample or took no command."""
        self._sample.valid = False
        self.safety.stop(faults.DRIVER)
        with suppress(Exception):  # a driver that fails may fail here, too
            self._axis.stop()
        if self._raised is driver_error.NONE_RAISED:
            self._raised = driver_error.in_words(error)

    def _act(self, action: int) -> None:
        try:
            if action == FOLLOW:
                self._axis.write(self._floats[_WRITTEN])
            elif action == STOP_DRIVE:
                self._axis.stop()
            else:
                self._stand()
        except Exception as error:  # noqa: BLE001 - as above
            self._driver_raised(error)
        self._endpoint.send_body(_KIND, self._body_bytes)
        self._models.update(self._floats[_POSITION])

    def _stand(self) -> None:
        """Command where the axis stands before it follows: where it is, or where homing leads."""
        command = self.reference.command(self._sample)
        self.limiter.reset(command)
        here = self.limiter.position
        written = self.reference.raw(here if self.reference.homed else command)
        self._floats[_WRITTEN], self._columns[_COMMAND_COLUMN] = written, here
        self._axis.write(written)

    def _note_fault(self) -> None:
        """Note the time of a fault, its device's report, and its reset."""
        sample, last = self._sample, self.stopped
        fault, said, trace = self.fault, sample.complaint, ""
        if fault is faults.DRIVER:
            said, trace = self._raised.said, self._raised.traceback
        if fault is faults.SAMPLES_LOST or self.safety.state == faults.HOLD:
            said = said or sample.stale
        if fault is last.fault and fault is not faults.NO_FAULT:
            said = said or last.said  # the device may be back; the fault is still its doing
        if fault is not last.fault or said != last.said:
            self.stopped = faults.Stopped(fault, self._stamp_ns, said, trace)

    def _write_row(self, wake_latency_ns: int) -> None:
        """Complete the row that the step has written, and record it."""
        stamp_ns = self._stamp_ns
        wake_us = wake_latency_ns * 1e-3 if self._measure_work else math.nan
        self._record_row(self._endpoint.trouble_code(stamp_ns), self._work_us, wake_us)
        if self._log_next is not None:
            next(self._log_next)(stamp_ns)
