"""A simulated servo on a half-duplex serial line: asked, it answers; else it is silent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from teleop_rt_drivers.framed.stream import StreamGoneError
from teleop_rt_drivers.simulated.actuator_network import Actuator, ActuatorNetwork
from teleop_rt_drivers.simulated.dynamixel import SimulatedDynamixel
from teleop_rt_drivers.simulated.feetech import SimulatedFeetech

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.actuators.part import ActuatorPart
    from teleop_rt_drivers.framed.stream import ByteStream
    from teleop_rt_drivers.simulated.plant import Plant

    MakeDrive = Callable[[ActuatorPart, Plant, Callable[[int, bytes], None], int], "LineDrive"]


class LineDrive(Actuator, Protocol):
    """A simulated drive on a serial line."""

    def receive(self, data: bytes, now_ns: int) -> bool:
        """Take bytes; return whether they asked for a measurement."""

    def packed(self, whom: int, content: bytes) -> bytes:
        """Return a status packet: its error and registers behind header, id and length."""


SIMULATED: dict[str, MakeDrive] = {"dynamixel": SimulatedDynamixel, "feetech": SimulatedFeetech}
"""Which device answers a driver on a serial line."""


class LineActuatorNetwork(ActuatorNetwork):
    """One drive, alone on its line."""

    drive: LineDrive

    def __init__(
        self,
        config: ActuatorPart,
        plant: Plant,
        stream: ByteStream,
        now_ns: Callable[[], int],
        period_ns: int,
        seed: int,
        latched: Callable[[], None],
    ) -> None:
        self._stream = stream
        drive = SIMULATED[config.driver](config, plant, self._send, period_ns)
        super().__init__(config, plant, drive, now_ns, seed, latched)

    def _broken(self, fault: str) -> bool:
        if fault == "unplug":
            self._stream.close()
        return fault == "unplug"

    def _mend(self) -> None:
        """Leave a cable that was pulled where it is: the daemon opens another line."""

    def _receive(self, now_ns: int) -> None:
        if self._off:
            return
        try:
            data = self._stream.read()
        except StreamGoneError:
            return
        if data and self.drive.receive(data, now_ns):
            self._latched()

    def descriptors(self) -> list[int]:
        """Return the descriptor that becomes readable when there is something to do."""
        fileno = getattr(self._stream, "fileno", None)
        return [] if self._off or fileno is None else [fileno()]

    def close(self) -> None:
        """Release the line."""
        if not self._off:
            self._stream.close()

    def _send(self, whom: int, content: bytes) -> None:
        self.faults.send(self.drive.packed(*self._spoilt(whom, content)))

    def _transmit(self, packed: bytes) -> None:
        """Send a packet; one that the line does not take is lost, as on a wire."""
        if self._off:
            return
        try:
            if not self._stream.write(packed):
                self.lost_frames += 1
        except StreamGoneError:
            self.lost_frames += 1
