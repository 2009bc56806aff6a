"""The slave's cycle: sense, decide, act."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from teleop_rt.axis import Axis, AxisError, AxisFault, Sample
from teleop_rt.config import TrialConfig
from teleop_rt.estimation.grid import SampleGrid
from teleop_rt.estimation.pairing import Pairing
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.messages import Motion
from teleop_rt.link.messages import State as StateMessage
from teleop_rt.realtime.lateness import late_ns
from teleop_rt.realtime.ring import RingWriter
from teleop_rt.slave import faults
from teleop_rt.slave.coupling import make_coupling
from teleop_rt.slave.estimate_log import EstimateLog
from teleop_rt.slave.guard import DEPTH_SHARE, CatchUp, ContactGuard
from teleop_rt.slave.limiter import Limiter
from teleop_rt.slave.model_sender import ModelSender
from teleop_rt.slave.reference import Reference
from teleop_rt.slave.safety import SafetyChain
from teleop_rt.slave.supervision import Supervision


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
        rig, period_s = trial.rig, trial.rig.period_ns * 1e-9
        self._config = trial.slave
        self._axis = axis
        self._endpoint = endpoint
        self._pipeline = pipeline
        self._now_ns = now_ns
        self._row_ring = row_ring
        self._estimate_log = estimate_log
        self._measure_work = measure_work
        self._sample = Sample()
        self._grid = SampleGrid(rig.period_ns)
        self._pairing = pipeline.settings.pairing(rig.period_ns)
        self._contact = pipeline.contact
        self._limiter = Limiter(rig.limits, period_s)
        self._guard = ContactGuard(
            trial.slave.force_cap,
            trial.slave.retreat_speed,
            rig.limits.position_max - rig.limits.position_min,
            period_s,
        )
        self._catch_up = CatchUp(trial.slave.retreat_speed, period_s)
        self._coupling = make_coupling(trial.mode, trial.coupling)
        self._coupled = False
        self._period_s, self._period_ns = period_s, rig.period_ns
        # A drive has run its last command out by then, or the axis holds before.
        self._runs_out_ns = min(rig.period_ns, round(rig.realtime.late.hold_ms * 1e6))
        self._models = ModelSender(
            pipeline, endpoint, rig.sensors.force_noise, trial.slave.force_cap, trial.link, now_ns
        )
        self.safety = SafetyChain(rig.limits, rig.rate_hz, rig.realtime.late)
        lacks = rig.axis.unsafe()
        self.supervision = Supervision(rig.supervision, rig.limits, rig.rate_hz, lacks)
        self.unsafe = rig.unsafe
        self._executes = rig.axis.executes
        self._written = math.nan
        self.reference = Reference(rig.reference, rig.limits, period_s)
        self._nothing_free = rig.limits.position_min
        self.tick = 0
        self.missed_ticks = 0
        self._target = math.nan
        self._stamp_ns = 0
        self._valid = self._homed = False
        self.stopped = faults.NOT_STOPPED
        self._work_us = math.nan

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
        return self._limiter.limited

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
        self._limiter.reset(self._sample.position)
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
        self._guard.reset()
        self.safety.reset()
        return True

    def cycle(self, skipped: int = 0, wake_latency_ns: int = 0) -> None:
        """Run one tick; `skipped` ticks were missed before it."""
        started_ns = time.perf_counter_ns() if self._measure_work else 0
        self.tick += 1 + skipped
        self.missed_ticks += skipped
        self._sense()
        self._decide(late_ns(skipped, wake_latency_ns, self._period_ns))
        self._act()
        self._note_fault()
        self._record(wake_latency_ns)
        if self._measure_work:
            self._work_us = (time.perf_counter_ns() - started_ns) * 1e-3

    def stop(self, fault: faults.Fault) -> None:
        """Stop the axis for a reason; may be called from outside the cycle."""
        self.safety.stop(fault)
        self._axis.stop()

    def disarm(self) -> None:
        """Stop the axis in good order, at the end of a trial."""
        self.safety.disarm()
        self._axis.stop()

    def _sense(self) -> None:
        sample = self._sample
        self._axis.read_into(sample)
        self.reference.apply(sample)
        self._stamp_ns = self._now_ns()
        self._endpoint.poll()
        self._valid = sample.valid and self.reference.ready
        if self._pairing is not None:
            self._estimate_pair(self._pairing)
        elif self._valid:
            if (gap := self._grid.gap(sample.stamp_ns)) > 0:
                self._pipeline.skip(gap)
            self._pipeline.update(sample.position, sample.force, valid=True)
        else:
            self._grid.passed()
            self._pipeline.update(sample.position, sample.force, valid=False)
        self._contact = self._pipeline.contact

    def _estimate_pair(self, pairing: Pairing) -> None:
        """Give each new force of a slow sensor to the estimators once, with its own position."""
        sample = self._sample
        if self._valid and pairing.take(
            sample.position, sample.position_stamp_ns, sample.force, sample.force_stamp_ns
        ):
            self._pipeline.skip(pairing.gap)
            self._pipeline.update(pairing.position, pairing.force, valid=True)

    def _decide(self, late_ns: int) -> None:
        motion = self._endpoint.motion
        silence_ms = self._endpoint.silence_ns(self._stamp_ns) * 1e-6
        led = (
            motion is not None
            and motion.engaged
            and silence_ms < self._config.hold_after_ms
            and self.reference.joins(motion.target, self._sample.position)
        )
        self._homed = self.reference.homed
        if late_ns >= self._runs_out_ns:
            self._limiter.stand()
            self.reference.stand()
        state = self.safety.check(self._sample, late_ns, motion=led, homed=self._homed)
        self._hold_clock(led=led)
        if (refused := self.reference.update(state, self._sample)) is not None:
            self.safety.stop(refused)
            state = self.safety.state
        state = self._supervise(state)
        contact = self._contact
        if state == faults.RUN and motion is not None:
            self._target = self._follow(motion)
        elif state == faults.HOLD and silence_ms > self._config.retreat_after_ms:
            self._target = self._guard.retreat(
                command=self._limiter.position, surface=contact.surface
            )
        else:
            self._target = self._limiter.position
        self._coupled = state == faults.RUN

    def _hold_clock(self, *, led: bool) -> None:
        """Keep what the link was like when the axis was armed, or led first, until it is off.

        A link that could become slower while the axis follows would let old motion pass for news.
        """
        if not self.safety.powered:
            self._endpoint.clock.release()
        elif led:
            self._endpoint.fix_clock()

    def _supervise(self, state: faults.State) -> faults.State:
        """Stop where command, encoder, force sensor and drive do not agree under power."""
        if not self.safety.powered or not self._executes:
            self.supervision.reset()
            return state
        position = self.reference.raw(self._sample.position)
        follows = state in {faults.RUN, faults.HOLD}
        fault = self.supervision.check(self._sample, position, self._written, follows=follows)
        if fault is not None:
            self.safety.stop(fault)
        return self.safety.state

    def _follow(self, motion: Motion) -> float:
        """Return where the master leads, as far as the guard lets it.

        Without a model the guard only draws back above the force cap: to wait for the wall that
        the master renders, or to know its depth, takes one.
        """
        contact, force, command = self._contact, self._sample.force, self._limiter.position
        position = self._sample.position
        target, coupling = motion.target, self._coupling
        if not self._coupled:
            self._catch_up.start()
        if coupling is None:
            target = self._catch_up.update(target, motion.velocity, command)
        else:
            if not self._coupled:
                coupling.start(position, motion)
            target = coupling.update(motion, command, position, force, self._period_s)
        modelled = coupling is None
        depth_cap = self._depth_cap() if modelled else math.inf
        return self._guard.update(
            target=target,
            command=command,
            position=position,
            force=force,
            contact_id=contact.contact_id,
            acknowledged=motion.contact_id if modelled else contact.contact_id,
            surface=contact.surface,
            depth_cap=depth_cap,
            probing=modelled and (motion.provisional or math.isinf(depth_cap)),
        )

    def _depth_cap(self) -> float:
        """Return the depth at which the force cap is reached, by the model and by what is measured.

        In contact the model only says how much further the measured force leaves room: so an error
        of the surface, or of the stiffness so far, is none of the cap.
        """
        contact, sample, models = self._contact, self._sample, self._models
        depth_cap = models.depth_of(DEPTH_SHARE * self._config.force_cap, contact.velocity)
        if contact.in_contact and math.isfinite(depth_cap):
            room = depth_cap - models.depth_of(sample.force, contact.velocity)
            depth_cap = min(depth_cap, sample.position - contact.surface + room)
        return depth_cap

    def _act(self) -> None:
        if not self.safety.powered:
            self._limiter.reset(self._sample.position)
            self._axis.stop()
        elif self.safety.state == faults.ARMED and not (self._sample.enabled and self._homed):
            command = self.reference.command(self._sample)
            self._limiter.reset(command)
            self._write(self._limiter.position if self.reference.homed else command)
        else:
            self._write(self._limiter.update(self._target))
        contact = self._contact
        self._endpoint.send(
            StateMessage(
                position=self._sample.position,
                force=self._sample.force - self._pipeline.rig_force,
                contact_id=contact.contact_id,
                in_contact=contact.in_contact,
                following=self.safety.state == faults.RUN,
                safety_state=int(self.safety.state),
                fault=self.safety.fault.code,
                verified_free=(
                    contact.verified_free
                    if math.isfinite(contact.verified_free)
                    else self._nothing_free
                ),
                velocity=contact.velocity,
                energy_J=0.0 if self._coupling is None else self._coupling.energy_J,
                inadequate=self._pipeline.inadequate,
            )
        )
        self._models.update(contact, self._sample.position)

    def _write(self, position: float) -> None:
        self._written = self.reference.raw(position)
        self._axis.write(self._written)

    def _note_fault(self) -> None:
        """Note when a fault came, what a device adds to it, and that it was reset."""
        sample, fault, last = self._sample, self.fault, self.stopped
        said = sample.complaint
        if fault is faults.SAMPLES_LOST or self.safety.state == faults.HOLD:
            said = said or sample.stale
        if fault is last.fault and fault is not faults.NO_FAULT:
            said = said or last.said  # the device may be back; the fault is still its doing
        if fault is not last.fault or said != last.said:
            self.stopped = faults.Stopped(fault, self._stamp_ns, said)

    def _record(self, wake_latency_ns: int) -> None:
        sample, contact, pipeline, safety = self._sample, self._contact, self._pipeline, self.safety
        endpoint, statistics, now_ns = self._endpoint, self._endpoint.statistics, self._stamp_ns
        selected = pipeline.selected
        predicted = selected >= 0 and contact.in_contact
        self._row_ring.push(
            [  # in the order of SLAVE
                self.tick,
                now_ns,
                sample.stamp_ns,
                (now_ns - sample.position_stamp_ns) * 1e-6,
                (now_ns - sample.force_stamp_ns) * 1e-6,
                self._valid,
                sample.position,
                sample.force,
                pipeline.inadequate,
                pipeline.rig_force,
                pipeline.filtered_force,
                contact.velocity,
                contact.in_contact,
                contact.contact_id,
                contact.surface,
                selected if selected >= 0 else math.nan,
                pipeline.predicted_force(selected) if predicted else math.nan,
                self._target,
                self._limiter.position,
                safety.state,
                self.fault.code,
                sample.missing,
                self._models.sequence,
                endpoint.silence_ns(now_ns) * 1e-6,
                statistics.received,
                statistics.lost,
                statistics.refused,
                endpoint.trouble_code(now_ns),
                safety.followings,
                safety.holds,
                safety.held_by,
                self._work_us,
                wake_latency_ns * 1e-3 if self._measure_work else math.nan,
            ]
        )
        if self._estimate_log is not None:
            self._estimate_log.update(now_ns)
