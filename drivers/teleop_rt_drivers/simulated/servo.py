"""A position drive without a fieldbus profile: off, following, stopping, fault; it stops alone."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.plant import Plant

WATCHDOG_NS = 60_000_000
"""Silence after which the drive stops by itself."""
DECELERATION = 30.0
"""Of a stop [rig unit/s2]."""
OFF, FOLLOW, STOP = 0, 1, 2
"""Requests in the control field."""


class ServoState(IntEnum):
    """Values of the state field."""

    OFF = 0
    FOLLOWING = 1
    STOPPING = 2
    FAULT = 3


class PlainServo:
    """The drive's logic: commands come when they come, each interpolated over a period."""

    def __init__(self, plant: Plant, period_ns: int) -> None:
        self.state = ServoState.OFF
        self._plant = plant
        self.period_s = period_ns * 1e-9
        self._heard_ns = 0
        self._was_off = False

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""
        return self.state is ServoState.FOLLOWING

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self.state in (ServoState.FOLLOWING, ServoState.STOPPING)

    @property
    def actual(self) -> int:
        """Return the position in counts."""
        return round(self._plant.drive_counts)

    def restart(self) -> None:
        """Be as after power-on."""
        self._plant.power_off()
        self.state = ServoState.OFF
        self._was_off = False

    def fail(self) -> None:
        """Go into fault; the motor loses voltage until a restart."""
        self._plant.power_off()
        self.state = ServoState.FAULT

    def obey(self, control: int, target: int, now_ns: int) -> None:
        """Take a command; the drive follows only after a command `off`."""
        self._heard_ns = now_ns
        if self.state is ServoState.FAULT:
            return
        if control == OFF:
            self.restart()
            self._was_off = True
        elif control == STOP:
            self._stop()
        elif control == FOLLOW and self.state is ServoState.FOLLOWING:
            self._act(target)
        elif control == FOLLOW and self.state is ServoState.OFF and self._was_off:
            self._was_off = False
            self._hold()
            self.state = ServoState.FOLLOWING

    def run(self, now_ns: int) -> None:
        """Stop when commands stay away, and switch off when at rest."""
        if self.state is ServoState.FOLLOWING and now_ns - self._heard_ns > WATCHDOG_NS:
            self._stop()
        if self.state is ServoState.STOPPING and self._plant.at_rest:
            self._plant.power_off()
            self.state = ServoState.OFF

    # Commanded by a kernel instead (`line_answering.py`).

    def standing(self) -> tuple[int, int, int] | None:
        """Return the command of every cycle, the state, and when a command was heard last.

        None where other commands, or silence, change the state now.
        """
        if self.state is ServoState.FOLLOWING:
            return FOLLOW, int(self.state), self._heard_ns
        if self.state is ServoState.OFF and self._was_off:
            return OFF, int(self.state), self._heard_ns
        return None

    def resume(self, heard_ns: int) -> None:
        """Go on from there: a command was heard last then."""
        self._heard_ns = heard_ns

    def _act(self, target: int) -> None:
        self._plant.follow(self._plant.position_of(target), self.period_s)

    def _hold(self) -> None:
        self._plant.hold()

    def _stop(self) -> None:
        if self.state is ServoState.FOLLOWING:
            self._plant.slow_down(DECELERATION)
            self.state = ServoState.STOPPING


class ForceServo(PlainServo):
    """A drive that pushes, in millinewton; to stop is to push no more, and to lose voltage."""

    def __init__(self, plant: Plant, period_ns: int) -> None:
        super().__init__(plant, period_ns)
        self._pushed = 0

    @property
    def actual(self) -> int:
        """Return the force in millinewton."""
        return self._pushed if self.enabled else 0

    def _act(self, target: int) -> None:
        self._pushed = target
        self._plant.push(target * 1e-3)

    def _hold(self) -> None:
        self._act(0)

    def _stop(self) -> None:
        if self.state is ServoState.FOLLOWING:
            self.restart()
