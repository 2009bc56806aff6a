"""The rig's zeros, from tare and homing, applied to every sample and every command."""

from __future__ import annotations

from typing import Any

from teleop_rt.axis import Sample
from teleop_rt.config.reference import ReferenceConfig
from teleop_rt.config.rig import Limits
from teleop_rt.kernels.jit import kernel
from teleop_rt.slave import faults
from teleop_rt.slave.faults import Fault, State
from teleop_rt.slave.homing import Homing, Phase
from teleop_rt.slave.record import Tick, TickRecord
from teleop_rt.slave.tare import Tare


@kernel
def joins(tick: Tick) -> bool:
    """Return whether a master's target can be followed.

    For a round trip after homing its targets count from the encoder's old zero: it is followed
    once it asks for no more than a step of homing.
    """
    if tick.homed > 0 and abs(tick.lead - tick.position) <= tick.homing_step:
        tick.joined = 1
    return tick.joined > 0


class Reference:
    """Tare before arming, homing before following; both are lost with any fault.

    Until `ready`, positions are the encoder's own and forces may have an offset, so that neither
    may reach estimators or limits.
    """

    def __init__(
        self,
        config: ReferenceConfig,
        limits: Limits,
        period_s: float,
        record: TickRecord | None = None,
    ) -> None:
        self._tare = None if config.tare is None else Tare(config.tare, period_s)
        self._homing = None if config.homing is None else Homing(config.homing, limits, period_s)
        self._tick = tick = (record or TickRecord()).tick
        tick.homing_step = 0.0 if config.homing is None else config.homing.speed * period_s
        self._started = False
        self.homed = config.homing is None
        tick.homed = tick.joined = self.homed
        self.used = config.tare is not None or config.homing is not None
        tick.has_zeros = self.used
        self._shift = 0.0

    @property
    def tared(self) -> bool:
        """Return whether the force's zero is known: only then may the axis be armed."""
        return self._tare is None or self._tare.done

    @property
    def ready(self) -> bool:
        """Return whether both zeros are known."""
        return self.tared and self.homed

    def apply(self, sample: Sample) -> None:
        """Turn an axis' newest readings into true force and position, as far as known."""
        if self._tare is not None and self._tare.done:
            sample.force -= self._tare.offset
        sample.position += self._shift

    def raw(self, position: float) -> float:
        """Return a position in the encoder's own coordinates, as the axis is commanded."""
        return position - self._shift

    def update(self, state: State, sample: Sample) -> Fault | None:
        """Advance by one cycle, with a sample that was `apply`ed; return why a zero is refused."""
        if state == faults.FAULT:
            self._forget()
        elif state in (faults.SELFTEST, faults.DISARMED):
            self._started = False
            if self._tare is not None and not self._tare.done and sample.valid:
                return self._tare.update(sample.force)
        elif state == faults.ARMED and self._homing is not None and sample.enabled:
            return self._home(self._homing, sample)
        return None

    def stand(self) -> None:
        """Let homing go on from rest: the drive has run out of commands."""
        if self._homing is not None:
            self._homing.stand()

    def _home(self, homing: Homing, sample: Sample) -> Fault | None:
        if self.homed:
            return None
        if not self._started:
            self._started = True
            homing.start(sample)  # the first command under power is where the tool stands
            return None
        fault = homing.update(sample)
        if homing.phase is Phase.DONE:
            self.homed = True
            self._shift = self._tick.shift = homing.shift
            sample.position += self._shift
        return fault

    def command(self, sample: Sample) -> float:
        """Return where to stand before the axis follows: where it is, or where homing leads."""
        if self._homing is not None and self._started:
            return self._homing.command + self._shift
        return sample.position

    def outcome(self) -> dict[str, Any]:
        """Return tare and homing for the summary; None for those that are not configured."""
        tare, shift = self._tare, self._shift
        found = None
        if tare is not None:
            found = {"offset": tare.offset, "noise": tare.noise, "drift": tare.drift}
        return {"tare": found, "shift": None if self._homing is None else shift}

    def _forget(self) -> None:
        self._started = False
        if self._tare is not None:
            self._tare.reset()
        if self._homing is not None:
            self.homed = False
            self._tick.joined = 0
            self._shift = self._tick.shift = 0.0
