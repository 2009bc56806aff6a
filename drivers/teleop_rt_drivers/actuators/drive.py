"""The drive of a maker's protocol: orders as real numbers, and a torque beside the position."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt_drivers.framed.drive import ForceDrive, FramedDrive
from teleop_rt_drivers.quantity import Scale

if TYPE_CHECKING:
    from teleop_rt.axis import Sample
    from teleop_rt_drivers.actuators.part import ActuatorPart
    from teleop_rt_drivers.actuators.port import ActuatorPort
    from teleop_rt_drivers.framed.source import Values


class ActuatorDrive(FramedDrive):
    """A drive that takes positions, in its own unit and not rounded, and says its torque."""

    _as_sent = staticmethod(Scale.raw)

    def __init__(
        self,
        part: ActuatorPart,
        port: ActuatorPort,
        scale: tuple[Scale, Scale],
        counters: dict[str, int],
    ) -> None:
        answer = port.sources["drive"]
        super().__init__(part.drive, port, answer, scale, counters)
        self._speaker = port
        self._torque = 0.0
        self._torque_slot = answer.slot("torque")
        self._gain = part.sign * part.force_per_torque
        self._has_sensor = part.force is None
        answer.listen(self._take_torque)

    def _take_torque(self, values: Values, _: int) -> None:
        self._torque = values[self._torque_slot]

    def fill(self, sample: Sample) -> None:
        """Write also the force that the motor's torque makes, to be compared with a sensor's."""
        super().fill(sample)
        if self._has_sensor and self.known:
            sample.drive_force = self._gain * self._torque

    @property
    def complaint(self) -> str:
        """The drive's own description of its fault."""
        return self._speaker.complaint


class ActuatorForceDrive(ForceDrive):
    """The same drive in an operator's device: it takes torques [Nm], and says its own."""

    _as_sent = staticmethod(Scale.raw)

    def __init__(
        self,
        part: ActuatorPart,
        port: ActuatorPort,
        scale: tuple[Scale, Scale],
        counters: dict[str, int],
    ) -> None:
        super().__init__(part.force_drive, port, port.sources["drive"], scale, counters)
        self._speaker = port

    @property
    def complaint(self) -> str:
        """The drive's own description of its fault."""
        return self._speaker.complaint
