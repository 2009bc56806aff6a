"""The parts that every simulated drive with a protocol of its maker has."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.actuators.part import ActuatorPart
    from teleop_rt_drivers.simulated.plant import Plant


class MakersDrive:
    """A drive of this id on this plant; `send` takes the id and the bytes of its frames.

    `id_key` names the key of its config that holds the id.
    """

    id_key = "servo_id"

    def __init__(
        self,
        config: ActuatorPart,
        plant: Plant,
        send: Callable[[int, bytes], None],
        period_ns: int,
    ) -> None:
        self.refuses = False
        self._id = int(config.model_dump()[self.id_key])
        self._plant = plant
        self._send = send
        self._period_s = period_ns * 1e-9
        self._deliver()

    def _deliver(self) -> None:
        """Set the state in which the drive is delivered."""
