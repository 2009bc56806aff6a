"""The position's zero: the tool goes to a switch, or touches something, whose place is known."""

from __future__ import annotations

from enum import Enum

from teleop_rt.axis import Sample
from teleop_rt.config.reference import HomingConfig
from teleop_rt.config.rig import Limits
from teleop_rt.slave import faults
from teleop_rt.slave.faults import Fault
from teleop_rt.slave.limiter import Limiter


class Phase(Enum):
    """Where homing is."""

    FREE = "draws back, as it began where it wants to go"
    SEEK = "searches for it"
    BACK_OFF = "draws back from it"
    APPROACH = "comes again, slowly"
    CLEAR = "draws back for good"
    DONE = "knows its zero"


class Homing:
    """One search, in the encoder's own coordinates; commands run on from where the tool stands.

    `command` is the position to command, `shift` the correction of the encoder's position once
    `phase` is DONE.
    """

    def __init__(self, config: HomingConfig, limits: Limits, period_s: float) -> None:
        self._config = config
        self._limits = limits
        self._period_s = period_s
        self.phase = Phase.SEEK
        self.command = self.shift = 0.0
        self._limiter = self._limited(0.0, config.speed)
        self._target = self._found = 0.0
        self._arrived = False

    def start(self, sample: Sample) -> None:
        """Begin where the tool stands, under power and at rest."""
        config, here = self._config, sample.position
        self.command = here
        self._arrived = False
        self._limiter = self._limited(here, config.speed)
        closed = self._triggered(sample)
        self.phase = Phase.FREE if closed else Phase.SEEK
        self._target = here + config.direction * config.search * (-1 if closed else 1)

    def update(self, sample: Sample) -> Fault | None:
        """Advance by one cycle; return why it failed."""
        if self.phase is Phase.DONE:
            return None
        if not abs(self.command - sample.position) <= self._config.back_off:
            return faults.HOMING_STUCK
        fault = self._advance(sample)
        before, self.command = self.command, self._limiter.update(self._target)
        self._arrived = before == self.command == self._target
        return fault

    def stand(self) -> None:
        """Go on from rest: the drive has run out of commands."""
        self._limiter.stand()

    def _advance(self, sample: Sample) -> Fault | None:
        """Go from phase to phase."""
        config = self._config
        away = -config.direction * config.back_off
        triggered = sample.valid and self._triggered(sample)
        arrived = self._arrived
        match self.phase:
            case Phase.FREE if sample.valid and not triggered:
                self._go(Phase.SEEK, sample.position + config.direction * config.search)
            case Phase.SEEK if triggered:
                self._go(Phase.BACK_OFF, sample.position + away)
            case Phase.BACK_OFF if arrived and triggered:
                return faults.HOMING_STUCK
            case Phase.BACK_OFF if arrived:
                self._limiter = self._limited(self.command, config.slow_speed)
                self._go(Phase.APPROACH, self.command - 2.0 * away)
            case Phase.APPROACH if triggered:
                self._found = sample.position
                self._limiter = self._limited(self.command, config.speed)
                self._go(Phase.CLEAR, self._found + away)
            case Phase.CLEAR if arrived:
                self.phase = Phase.DONE
                self.shift = config.position - self._found
            case Phase.FREE | Phase.SEEK | Phase.APPROACH if arrived:
                return faults.HOMING_NOT_FOUND
            case _:
                pass
        return None

    def _go(self, phase: Phase, target: float) -> None:
        self.phase, self._target, self._arrived = phase, target, False

    def _triggered(self, sample: Sample) -> bool:
        config = self._config
        if config.touch_force is None:
            return sample.switch
        return config.direction * sample.force >= config.touch_force

    def _limited(self, here: float, speed: float) -> Limiter:
        """Return a limiter from rest at `here`, for a way whose ends are not the rig's yet.

        The encoder's own coordinates are no config: they may be as large, or as small, as they are.
        """
        reach = 2.0 * (self._config.search + self._config.back_off)
        limits = Limits.model_construct(
            position_min=here - reach,
            position_max=here + reach,
            velocity_max=speed,
            acceleration_max=self._limits.acceleration_max,
            force_max=self._limits.force_max,
        )
        limiter = Limiter(limits, self._period_s)
        limiter.reset(here)
        return limiter
